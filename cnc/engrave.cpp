// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/engrave.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <fmt/format.h>

#include "cnc/cutter_location.hpp"
#include "cnc/linking.hpp"
#include "cnc/pass_sampler.hpp"
#include "cnc/piece_order.hpp"
#include "core/check.hpp"

namespace maquette::cnc {
namespace {

using heightmap::ModelField;
using Point = std::array<double, 2>;

constexpr double kShortest_mm = 0.005;  // of chords that are halved

double turn(const Point& a, const Point& b, const Point& c) {
  return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
}

/// A. M. Andrew, "Another efficient algorithm for convex hulls in two dimensions", Inf. Process.
/// Lett. 9, 1979, doi:10.1016/0020-0190(79)90072-3.
std::vector<Point> convex_hull(std::vector<Point> points) {
  std::sort(points.begin(), points.end());
  points.erase(std::unique(points.begin(), points.end()), points.end());
  if (points.size() < 3) return points;
  std::vector<Point> hull;
  for (int side = 0; side < 2; ++side) {
    const std::size_t base = hull.size();
    for (const Point& p : points) {
      while (hull.size() >= base + 2 && turn(hull[hull.size() - 2], hull.back(), p) <= 0.0)
        hull.pop_back();
      hull.push_back(p);
    }
    hull.pop_back();
    std::reverse(points.begin(), points.end());
  }
  return hull;
}

bool inside(const std::vector<Point>& convex, const Point& p) {
  for (std::size_t i = 0; i < convex.size(); ++i)
    if (turn(convex[i], convex[(i + 1) % convex.size()], p) < 0.0) return false;
  return convex.size() > 2;
}

Result<void> check(const EngraveOptions& o) {
  const auto range = [](const char* name, double value, double least, double most,
                        const char* unit) -> Result<void> {
    if (value >= least && value <= most) return {};
    return fail(kEngraveOptionOutOfRange, fmt::format("{} is {} {}; it must be from {} to {}", name,
                                                      value, unit, least, most));
  };
  MAQUETTE_TRY_VOID(range("ball_radius", o.ball_radius_mm, 0.05, 100.0, "mm"));
  MAQUETTE_TRY_VOID(range("depth", o.depth_mm, 0.0, o.ball_radius_mm, "mm"));
  MAQUETTE_TRY_VOID(range("chord", o.chord_mm, 2.0 * kShortest_mm, o.ball_radius_mm, "mm"));
  MAQUETTE_TRY_VOID(range("feed", o.feed_mm_min, 0.01, 1e6, "mm/min"));
  MAQUETTE_TRY_VOID(range("plunge_feed", o.plunge_feed_mm_min, 0.01, 1e6, "mm/min"));
  MAQUETTE_TRY_VOID(range("clearance", o.clearance_mm, 0.0, 1e4, "mm"));
  return {};
}

std::int64_t on_lattice(double mm) {
  return std::llround(mm / (kTick_mm * kResolution)) * kResolution;
}

class Engraver {
 public:
  Engraver(const ModelField& surface, const EngraveOptions& o)
      : surface_(surface), o_(o), cutter_(surface, Cutter::ball(o.ball_radius_mm)) {}

  /// Unbroken stretches of the border over the outline; closed if all of it is.
  [[nodiscard]] std::vector<std::vector<ToolPosition>> along(const std::vector<Point>& border) {
    std::vector<std::vector<ToolPosition>> pieces;
    std::vector<ToolPosition> piece;
    const auto end_piece = [&] {
      if (piece.size() > 1) pieces.push_back(piece);
      piece.clear();
    };
    for (std::size_t i = 0; i < border.size(); ++i) {
      const Point &a = border[i], &b = border[(i + 1) % border.size()];
      const double length = std::hypot(b[0] - a[0], b[1] - a[1]);
      const int n = std::max(1, static_cast<int>(std::ceil(length / o_.chord_mm)));
      for (int k = i == 0 ? 0 : 1; k <= n; ++k) {
        const double t = static_cast<double>(k) / n;
        const Point p{a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])};
        if (!over_surface(p)) {
          end_piece();
        } else if (piece.empty()) {
          piece.push_back(lowered(p));
        } else {
          to(lowered(p), piece);
        }
      }
    }
    end_piece();
    return pieces;
  }

 private:
  [[nodiscard]] bool over_surface(const Point& p) const {
    return p[0] >= surface_.x0.value() && p[0] <= surface_.x_mm(surface_.z_mm.cols() - 1) &&
           p[1] >= surface_.y0.value() && p[1] <= surface_.y_mm(surface_.z_mm.rows() - 1);
  }
  [[nodiscard]] ToolPosition lowered(const Point& p) {
    const std::int64_t x = on_lattice(p[0]), y = on_lattice(p[1]);
    const double tip = cutter_.drop(mm_of_ticks(x), mm_of_ticks(y)).tip_mm - o_.depth_mm;
    return {x, y,
            static_cast<std::int64_t>(std::ceil(tip / (kTick_mm * kResolution))) * kResolution};
  }
  void to(ToolPosition b, std::vector<ToolPosition>& piece) {
    const ToolPosition a = piece.back();
    const double plan = std::hypot(mm_of_ticks(b.x - a.x), mm_of_ticks(b.y - a.y));
    if (plan == 0.0) return;
    if (plan > 2.0 * kShortest_mm && std::hypot(plan, mm_of_ticks(b.z - a.z)) > o_.chord_mm) {
      to(lowered({0.5 * mm_of_ticks(a.x + b.x), 0.5 * mm_of_ticks(a.y + b.y)}), piece);
      to(b, piece);
      return;
    }
    piece.push_back(b);
  }

  const ModelField& surface_;
  const EngraveOptions& o_;
  DropCutter cutter_;
};

}  // namespace

std::vector<Seat> stone_seats(const ModelField& surface,
                              std::span<const meshing::PlacedStone> stones, double gap_mm,
                              double bed_mm) {
  MAQUETTE_CHECK(gap_mm >= 0.0 && bed_mm >= 0.0, "gap {} mm, bed {} mm", gap_mm, bed_mm);
  constexpr int kCorners = 24;  // of a polygon around the circle of the gap
  const double around = gap_mm / std::cos(std::numbers::pi / kCorners);
  std::vector<Seat> seats;
  for (const meshing::PlacedStone& stone : stones) {
    Seat seat;
    seat.stone = stone.number;
    seat.floor_mm = INFINITY;
    std::vector<Point> under;
    for (const Vec3& v : meshing::stone_mesh(stone).vertices_mm) {
      if (!(v.z < heightmap::height_at(surface, v.x, v.y))) continue;
      seat.floor_mm = std::min(seat.floor_mm, v.z - bed_mm);
      under.push_back({v.x, v.y});
    }
    std::vector<Point> wider;
    for (const Point& p : convex_hull(under))
      for (int k = 0; k < kCorners; ++k) {
        const double angle = 2.0 * std::numbers::pi * k / kCorners;
        wider.push_back({p[0] + around * std::cos(angle), p[1] + around * std::sin(angle)});
      }
    seat.border_mm = convex_hull(std::move(wider));
    if (seat.border_mm.size() > 2) seats.push_back(std::move(seat));
  }
  return seats;
}

ModelField with_seats(const ModelField& surface, std::span<const Seat> seats) {
  ModelField seated = surface;
  const double d = surface.spacing.value();
  for (const Seat& seat : seats) {
    Box3 box;
    for (const Point& p : seat.border_mm) box.add({p[0], p[1], 0.0});
    const auto node = [d](double from, std::ptrdiff_t n) {
      return std::clamp<std::ptrdiff_t>(static_cast<std::ptrdiff_t>(std::floor(from / d)), 0, n);
    };
    const std::ptrdiff_t rows = surface.z_mm.rows() - 1, cols = surface.z_mm.cols() - 1;
    for (std::ptrdiff_t r = node(box.min.y - surface.y0.value(), rows);
         r <= node(box.max.y - surface.y0.value() + d, rows); ++r)
      for (std::ptrdiff_t c = node(box.min.x - surface.x0.value(), cols);
           c <= node(box.max.x - surface.x0.value() + d, cols); ++c)
        if (inside(seat.border_mm, {surface.x_mm(c), surface.y_mm(r)}))
          seated.z_mm(r, c) = std::min(seated.z_mm(r, c), static_cast<float>(seat.floor_mm));
  }
  return seated;
}

RestMap seat_map(const ModelField& surface, const ModelField& seated) {
  MAQUETTE_CHECK(
      surface.z_mm.rows() == seated.z_mm.rows() && surface.z_mm.cols() == seated.z_mm.cols(),
      "{} x {} and {} x {} nodes", surface.z_mm.rows(), surface.z_mm.cols(), seated.z_mm.rows(),
      seated.z_mm.cols());
  RestMap map;
  map.threshold_mm = 0.001;
  map.remaining = surface;
  const double cell = surface.spacing.value() * surface.spacing.value();
  for (std::size_t i = 0; i < surface.z_mm.cells().size(); ++i) {
    const float taken = std::max(0.0F, surface.z_mm.cells()[i] - seated.z_mm.cells()[i]);
    map.remaining.z_mm.cells()[i] = taken;
    const auto mm = static_cast<double>(taken);
    map.highest_mm = std::max(map.highest_mm, mm);
    if (mm > map.threshold_mm) map.area_mm2 += cell, map.volume_mm3 += cell * mm;
  }
  return map;
}

Result<Toolpath> engrave_outlines(const ModelField& surface, std::span<const Seat> seats,
                                  const EngraveOptions& options) {
  MAQUETTE_TRY_VOID(check(options));
  const heightmap::HeightRange heights = heightmap::height_range(surface.z_mm);
  if (heights.voids > 0 || !std::isfinite(heights.max - heights.min))
    return fail(kHeightNotFinite,
                fmt::format("{} nodes of the surface have no height; fill voids before engraving",
                            heights.voids));
  Engraver engraver(surface, options);
  std::vector<std::vector<ToolPosition>> pieces;
  for (const Seat& seat : seats)
    for (auto& piece : engraver.along(seat.border_mm)) pieces.push_back(std::move(piece));
  Toolpath path;
  if (pieces.empty()) return path;
  const LinkSurface over =
      CutterClearance(surface, Cutter::ball(options.ball_radius_mm)).for_thread();
  const std::int64_t safe =
      on_lattice(static_cast<double>(heights.max) + options.clearance_mm) + kResolution;
  PieceOrder order(surface.x0.value(), surface.y0.value(), surface.x_mm(surface.z_mm.cols() - 1),
                   surface.y_mm(surface.z_mm.rows() - 1), 20.0);
  for (const auto& p : pieces)
    order.add(mm_of_ticks(p.front().x), mm_of_ticks(p.front().y), mm_of_ticks(p.back().x),
              mm_of_ticks(p.back().y));
  double x = surface.x0.value(), y = surface.y0.value();
  while (order.left() > 0) {
    const auto next = order.take_nearest(x, y);
    auto& piece = pieces[next.piece];
    if (next.last) std::reverse(piece.begin(), piece.end());
    if (path.moves.empty()) path.start = {piece.front().x, piece.front().y, safe};
    append_link(path, piece.front(), over, {options.clearance_mm, 1.0, options.plunge_feed_mm_min});
    for (std::size_t i = 1; i < piece.size(); ++i) {
      PathMove move;
      move.to = piece[i];
      move.feed_mm_min = options.feed_mm_min;
      path.moves.push_back(move);
    }
    x = mm_of_ticks(piece.back().x), y = mm_of_ticks(piece.back().y);
  }
  PathMove up;
  up.kind = PathMove::Kind::rapid;
  up.to = end_of(path);
  up.to.z = std::max(safe, up.to.z);
  path.moves.push_back(up);
  return path;
}

}  // namespace maquette::cnc
