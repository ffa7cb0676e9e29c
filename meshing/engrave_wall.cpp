// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>
#include <map>

#include <fmt/format.h>

#include "core/check.hpp"
#include "meshing/detail/groove_triangles.hpp"
#include "meshing/engraving.hpp"

namespace maquette::meshing {
namespace {

using detail::FlatPoint;
using heightmap::ModelField;
using std::ptrdiff_t;

/// One wall, seen from outside: u to the right, z up. u is x or y, or the same negated, so that no
/// rounding comes in.
class Wall {
 public:
  Wall(const ModelField& surface, const NodeWindow& window, WallSide side)
      : surface_(surface), window_(window), side_(side) {}

  [[nodiscard]] bool along_x() const {
    return side_ == WallSide::south || side_ == WallSide::north;
  }
  [[nodiscard]] ptrdiff_t edges() const { return along_x() ? last_col() : last_row(); }
  /// Of the outline, from its left end.
  [[nodiscard]] std::uint64_t first_edge() const {
    switch (side_) {
      case WallSide::south:
        return 0;
      case WallSide::east:
        return static_cast<std::uint64_t>(last_col());
      case WallSide::north:
        return static_cast<std::uint64_t>(last_col() + last_row());
      case WallSide::west:
        return static_cast<std::uint64_t>(2 * last_col() + last_row());
    }
    return 0;
  }
  /// Of node i from the left.
  [[nodiscard]] double u(ptrdiff_t i) const {
    switch (side_) {
      case WallSide::south:
        return x(i);
      case WallSide::east:
        return y(i);
      case WallSide::north:
        return -x(edges() - i);
      case WallSide::west:
        return -y(edges() - i);
    }
    return 0.0;
  }
  /// Of node i from the left, `deep` nodes behind the wall.
  [[nodiscard]] double z(ptrdiff_t i, ptrdiff_t deep) const {
    switch (side_) {
      case WallSide::south:
        return height(deep, i);
      case WallSide::east:
        return height(i, last_col() - deep);
      case WallSide::north:
        return height(last_row() - deep, last_col() - i);
      case WallSide::west:
        return height(last_row() - i, deep);
    }
    return 0.0;
  }
  [[nodiscard]] Vec3 point(FlatPoint p, double depth) const {
    switch (side_) {
      case WallSide::south:
        return {p[0], y(0) + depth, p[1]};
      case WallSide::east:
        return {x(last_col()) - depth, p[0], p[1]};
      case WallSide::north:
        return {-p[0], y(last_row()) - depth, p[1]};
      case WallSide::west:
        return {x(0) + depth, -p[0], p[1]};
    }
    return {};
  }
  [[nodiscard]] std::string_view name() const {
    constexpr std::array<std::string_view, 4> kNames{"southern", "eastern", "northern", "western"};
    return kNames[static_cast<std::size_t>(side_)];
  }
  [[nodiscard]] double length_mm() const { return wall_length_mm(surface_, window_, side_); }
  [[nodiscard]] double behind_mm() const {
    return wall_length_mm(surface_, window_, along_x() ? WallSide::east : WallSide::south);
  }
  [[nodiscard]] double spacing_mm() const { return surface_.spacing.value(); }

 private:
  // Rows and columns count from the window's first ones.
  [[nodiscard]] ptrdiff_t last_row() const { return window_.rows() - 1; }
  [[nodiscard]] ptrdiff_t last_col() const { return window_.cols() - 1; }
  [[nodiscard]] double x(ptrdiff_t col) const { return surface_.x_mm(window_.col0 + col); }
  [[nodiscard]] double y(ptrdiff_t row) const { return surface_.y_mm(window_.row0 + row); }
  [[nodiscard]] double height(ptrdiff_t row, ptrdiff_t col) const {
    return static_cast<double>(surface_.z_mm(window_.row0 + row, window_.col0 + col));
  }

  const ModelField& surface_;
  NodeWindow window_;
  WallSide side_;
};

/// Between grooves and everything else, along the wall and upright.
double margin_mm(const EngravingStyle& s) {
  return std::fmax(s.stroke_mm(), 0.5);
}
/// From the ends of a wall: grooves of two walls must not meet.
double end_mm(const EngravingStyle& s) {
  return std::fmax(s.letter.value(), 2.0 * s.depth.value());
}

/// Where a mark stands: lower left corner, and the nodes whose wall is made anew.
struct Place {
  double u = 0.0, z = 0.0;
  ptrdiff_t first = 0, last = 0;
};

/// Nodes whose wall a mark takes that begins at u.
void span_nodes(const Wall& wall, const WallMark& mark, double beyond, Place& p) {
  const double d = wall.spacing_mm();
  p.first = std::clamp<ptrdiff_t>(
      static_cast<ptrdiff_t>(std::floor((p.u - beyond - wall.u(0)) / d)), 0, wall.edges() - 1);
  p.last = std::clamp<ptrdiff_t>(
      static_cast<ptrdiff_t>(std::ceil((p.u + mark.width_mm + beyond - wall.u(0)) / d)),
      p.first + 1, wall.edges());
}

/// From its end of the wall on to where no hole is in the way.
Result<void> place_along(const Wall& wall, const WallMark& mark, const EngravingStyle& s,
                         std::span<const EngravedWall> taken, Place& p) {
  const double end = end_mm(s), half = 0.5 * s.stroke_mm(), beyond = half + margin_mm(s);
  const double first = wall.u(0) + end + half,
               last = wall.u(wall.edges()) - end - half - mark.width_mm;
  p.u = mark.at_right ? last : first;
  const auto left = static_cast<ptrdiff_t>(wall.first_edge());
  for (bool moved = true; moved;) {
    moved = false;
    span_nodes(wall, mark, beyond, p);
    for (const EngravedWall& t : taken) {
      const ptrdiff_t from = static_cast<ptrdiff_t>(t.first_edge) - left,
                      to = from + static_cast<ptrdiff_t>(t.edges);
      if (to <= 0 || from >= wall.edges() || from >= p.last || to <= p.first) continue;
      // A hair more, so that rounding does not bring it back.
      constexpr double kHair_mm = 1e-6;
      p.u = mark.at_right ? wall.u(from) - beyond - mark.width_mm - kHair_mm
                          : wall.u(to) + beyond + kHair_mm;
      moved = true;
      if (p.u < first || p.u > last)
        return fail(kLabelDoesNotFit,
                    fmt::format("{} of {:.1f} mm finds no place between the holes of the {} wall "
                                "({:g} mm); smaller letters, a shorter text, another side or fewer "
                                "holes would do",
                                mark.name, mark.width_mm, wall.name(), wall.length_mm()));
      break;
    }
  }
  return {};
}

Result<Place> place_mark(const Wall& wall, double base, const WallMark& mark,
                         const EngravingStyle& s, std::span<const EngravedWall> taken) {
  const double end = end_mm(s), half = 0.5 * s.stroke_mm();
  const double needed = mark.width_mm + 2.0 * (end + half);
  if (needed > wall.length_mm())
    return fail(
        kLabelDoesNotFit,
        fmt::format("{} is {:.1f} mm long with its margins, the {} wall {:g} mm; letters of "
                    "{:.2g} mm, a shorter text or another side would do",
                    mark.name, needed, wall.name(), wall.length_mm(),
                    0.99 * s.letter.value() * wall.length_mm() / needed));
  Place p;
  MAQUETTE_TRY_VOID(place_along(wall, mark, s, taken, p));
  const double d = wall.spacing_mm(), beyond = half + margin_mm(s);
  const auto deep = static_cast<ptrdiff_t>(std::ceil((s.depth.value() + margin_mm(s)) / d));
  double lowest = INFINITY;
  for (ptrdiff_t k = 0; k <= std::min(deep, static_cast<ptrdiff_t>(wall.behind_mm() / d + 0.5));
       ++k)
    for (ptrdiff_t i = p.first; i <= p.last; ++i) lowest = std::fmin(lowest, wall.z(i, k));
  const double room = lowest - base, high = mark.height_mm + 2.0 * beyond;
  if (high > room)
    return fail(
        kLabelDoesNotFit,
        fmt::format("{} is {:.1f} mm high with its margins, the {} wall {:.1f} mm there; "
                    "smaller letters or a base thicker by {:.1f} mm would do",
                    mark.name, high, wall.name(), room, std::ceil(10.0 * (high - room)) / 10.0));
  p.z = base + 0.5 * (room - mark.height_mm);
  return p;
}

/// What is cut, in space. Numbers of corners as EngravedWall has them.
void raise(const Wall& wall, const detail::Grooves& g, std::size_t rim, double depth,
           EngravedWall& out) {
  std::map<std::uint32_t, std::uint32_t> above, below;  // vertices at the wall, at the floor
  const auto add = [&](std::uint32_t i, double at) {
    out.vertices_mm.push_back(wall.point(g.points[i - rim], at));
    return static_cast<std::uint32_t>(rim + out.vertices_mm.size() - 1);
  };
  const auto at_wall = [&](std::uint32_t i) {
    if (i < rim) return i;
    const auto [it, fresh] = above.try_emplace(i, 0);
    if (fresh) it->second = add(i, 0.0);
    return it->second;
  };
  const auto at_floor = [&](std::uint32_t i) {
    const auto [it, fresh] = below.try_emplace(i, 0);
    if (fresh) it->second = add(i, depth);
    return it->second;
  };
  for (const auto& t : g.wall)
    out.triangles.push_back({at_wall(t[0]), at_wall(t[1]), at_wall(t[2])});
  std::map<std::array<std::uint32_t, 2>, int> edges;
  for (const auto& t : g.floor) {
    out.triangles.push_back({at_floor(t[0]), at_floor(t[1]), at_floor(t[2])});
    for (std::size_t k = 0; k < 3; ++k) ++edges[{t[k], t[(k + 1) % 3]}];
    const auto p = [&](std::size_t k) { return g.points[t[k] - rim]; };
    out.floor_area_mm2 += 0.5 * ((p(1)[0] - p(0)[0]) * (p(2)[1] - p(0)[1]) -
                                 (p(2)[0] - p(0)[0]) * (p(1)[1] - p(0)[1]));
  }
  for (const auto& [edge, count] : edges) {
    const auto [a, b] = edge;
    if (edges.contains({b, a})) continue;  // within the floor
    out.triangles.push_back({at_floor(b), at_floor(a), at_wall(a)});
    out.triangles.push_back({at_floor(b), at_wall(a), at_wall(b)});
  }
  out.volume_mm3 = depth * out.floor_area_mm2;
}

Result<EngravedWall> engrave(const Wall& wall, double base, const WallMark& mark,
                             const Place& place, const EngravingStyle& style) {
  // Lower rim from left to right, upper one back.
  std::vector<FlatPoint> outline;
  for (ptrdiff_t i = place.first; i <= place.last; ++i) outline.push_back({wall.u(i), base});
  for (ptrdiff_t i = place.last; i >= place.first; --i)
    outline.push_back({wall.u(i), wall.z(i, 0)});
  std::vector<std::vector<FlatPoint>> lines = mark.lines_mm;
  for (auto& line : lines)
    for (FlatPoint& p : line) p = {p[0] + place.u, p[1] + place.z};
  // Where grooves touch in a point only, others that are a hair narrower do not.
  std::optional<detail::Grooves> grooves;
  for (const double share : {1.0, 0.997, 0.991, 0.983, 0.971}) {
    grooves = detail::groove_triangles(outline,
                                       detail::stroke_outlines(lines, share * style.stroke_mm()));
    if (grooves) break;
  }
  if (!grooves)
    return fail(kLabelDoesNotFit,
                fmt::format("{}: strokes of {:g} mm give no clean grooves; others would", mark.name,
                            style.stroke_mm()));
  // Upper corners were numbered from right to left.
  const auto nodes = static_cast<std::uint32_t>(place.last - place.first + 1);
  for (auto* part : {&grooves->wall, &grooves->floor})
    for (auto& t : *part)
      for (std::uint32_t& v : t)
        if (v >= nodes && v < 2 * nodes) v = 3 * nodes - 1 - v;
  EngravedWall out;
  out.first_edge = wall.first_edge() + static_cast<std::uint64_t>(place.first);
  out.edges = static_cast<std::uint64_t>(place.last - place.first);
  out.from_mm = {place.u, place.z};
  raise(wall, *grooves, outline.size(), style.depth.value(), out);
  return out;
}

}  // namespace

Result<std::vector<EngravedWall>> engrave_wall(const ModelField& surface, Millimetres base_z,
                                               const std::vector<WallMark>& marks,
                                               const EngravingStyle& style, const RunContext& run) {
  return engrave_wall(surface, all_nodes(surface), base_z, marks, style, {}, run);
}

Result<std::vector<EngravedWall>> engrave_wall(const ModelField& surface, const NodeWindow& window,
                                               Millimetres base_z,
                                               const std::vector<WallMark>& marks,
                                               const EngravingStyle& style,
                                               std::span<const EngravedWall> taken,
                                               const RunContext& run) {
  const Wall wall(surface, window, style.side);
  const double deepest = 0.25 * std::fmin(wall.behind_mm(), wall.length_mm());
  if (!(style.depth.value() <= deepest))
    return fail(kLabelDoesNotFit,
                fmt::format("grooves of {:g} mm in a part of {:g} x {:g} mm; at most {:.2g} mm",
                            style.depth.value(), wall.length_mm(), wall.behind_mm(), deepest));
  std::vector<Place> places;
  for (const WallMark& mark : marks) {
    MAQUETTE_TRY(const Place p, place_mark(wall, base_z.value(), mark, style, taken));
    places.push_back(p);
  }
  for (std::size_t i = 0; i < marks.size(); ++i)
    for (std::size_t k = 0; k < i; ++k)
      if (places[i].first < places[k].last && places[k].first < places[i].last)
        return fail(kLabelDoesNotFit,
                    fmt::format("{} ({:.1f} mm) and {} ({:.1f} mm) meet on the {} wall of {:g} mm; "
                                "smaller letters or a shorter text would do",
                                marks[k].name, marks[k].width_mm, marks[i].name, marks[i].width_mm,
                                wall.name(), wall.length_mm()));
  std::vector<EngravedWall> pieces;
  for (std::size_t i = 0; i < marks.size(); ++i) {
    if (run.stopped()) return fail(kCancelled, "engraving was stopped");
    MAQUETTE_TRY(EngravedWall piece, engrave(wall, base_z.value(), marks[i], places[i], style));
    pieces.push_back(std::move(piece));
    run.progress(static_cast<double>(i + 1) / static_cast<double>(marks.size()));
  }
  return pieces;
}

}  // namespace maquette::meshing
