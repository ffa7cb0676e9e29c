// SPDX-License-Identifier: GPL-3.0-or-later
#include "meshing/dowels.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <fmt/format.h>

#include "core/check.hpp"

namespace maquette::meshing {
namespace {

using detail::Flat;
using heightmap::ModelField;
using std::ptrdiff_t;

/// A line of nodes that two tiles share: nodes first .. last along it.
struct Joint {
  const Tile* before = nullptr;  ///< south or west of it
  const Tile* after = nullptr;
  bool across_x = false;  ///< a column of nodes
  ptrdiff_t line = 0, first = 0, last = 0;
};

std::vector<Joint> joints_of(std::span<const Tile> tiles) {
  std::vector<Joint> joints;
  for (const Tile& a : tiles)
    for (const Tile& b : tiles) {
      const NodeWindow &p = a.nodes, &q = b.nodes;
      if (p.col1 == q.col0) {
        const ptrdiff_t first = std::max(p.row0, q.row0), last = std::min(p.row1, q.row1);
        if (first < last) joints.push_back({&a, &b, true, p.col1, first, last});
      }
      if (p.row1 == q.row0) {
        const ptrdiff_t first = std::max(p.col0, q.col0), last = std::min(p.col1, q.col1);
        if (first < last) joints.push_back({&a, &b, false, p.row1, first, last});
      }
    }
  return joints;
}

/// Room that a hole takes along its joint, on either side of its middle: the wall that is
/// triangulated anew ends at nodes.
double half_room_mm(const ModelField& surface, const DowelOptions& o) {
  return hole_radius_mm(o) + o.wall_mm + surface.spacing.value();
}

std::vector<double> places_along(double from, double to, double end_mm, double half_mm,
                                 const DowelOptions& o) {
  const double free = to - from - 2.0 * end_mm;
  if (free < 0.0) return {};
  if (free < 2.0 * half_mm) return {0.5 * (from + to)};
  const double gaps =
      std::clamp(std::ceil(free / o.spacing_mm), 1.0, std::floor(free / (2.0 * half_mm)));
  std::vector<double> places;
  for (double i = 0.0; i <= gaps; i += 1.0) places.push_back(from + end_mm + free * i / gaps);
  return places;
}

Result<void> check_options(const DowelOptions& o, Millimetres base_thickness) {
  for (const auto& [name, value, least] : {std::tuple{"diameter", o.diameter_mm, 0.1},
                                           {"play", o.play_mm, 0.0},
                                           {"depth", o.depth_mm, 0.1},
                                           {"wall", o.wall_mm, 0.1},
                                           {"spacing", o.spacing_mm, 1.0}})
    if (!(value >= least && value <= 1e4))
      return fail(kDowelDoesNotFit, fmt::format("a dowel's {} of {} mm; {} to 10000 mm expected",
                                                name, value, least));
  const double needed = 2.0 * (hole_radius_mm(o) + o.wall_mm);
  if (base_thickness.value() < needed)
    return fail(kDowelDoesNotFit,
                fmt::format("holes for dowels of {:g} mm with walls of {:g} mm take a base of "
                            "{:.2f} mm; it has {:g} mm: a thicker base or thinner dowels would do",
                            o.diameter_mm, o.wall_mm, needed, base_thickness.value()));
  return {};
}

/// Holes from both sides, with a wall between them, and past those of the other joints.
Result<void> check_tile(const ModelField& surface, const Tile& t, const DowelOptions& o) {
  const double d = surface.spacing.value(), needed = 2.0 * o.depth_mm + o.wall_mm;
  const double width = d * static_cast<double>(t.nodes.cols() - 1);
  const double length = d * static_cast<double>(t.nodes.rows() - 1);
  if (std::min(width, length) >= needed) return {};
  return fail(kDowelDoesNotFit,
              fmt::format("tile {} of {:g} x {:g} mm; holes of {:g} mm from both sides take {:g} "
                          "mm: shallower holes or larger tiles would do",
                          t.number, width, length, o.depth_mm, needed));
}

// ---- boring --------------------------------------------------------------------

/// A mesh whose walls are opened hole by hole.
class Borer {
 public:
  Borer(const ModelField& surface, const Tile& tile, const DowelOptions& o)
      : surface_(surface), window_(tile.nodes), options_(o) {}

  void load(const GridSolidStream& solid) {
    mesh_.vertices_mm.resize(solid.vertex_count());
    mesh_.triangles.resize(solid.triangle_count());
    solid.vertices(0, mesh_.vertices_mm);
    solid.triangles(0, mesh_.triangles);
    gone_.assign(mesh_.triangles.size(), false);
  }

  void bore(const Dowel& dowel, bool tile_is_after) {
    const bool across_x = dowel.along_x;
    // South and north walls run along x, west and east ones along y.
    const double middle = across_x ? dowel.centre_mm.y : dowel.centre_mm.x;
    const double origin = across_x ? surface_.y0.value() : surface_.x0.value();
    const double d = surface_.spacing.value();
    const double reach = hole_radius_mm(options_) + options_.wall_mm;
    const auto first = static_cast<ptrdiff_t>(std::floor((middle - reach - origin) / d));
    const auto last = static_cast<ptrdiff_t>(std::ceil((middle + reach - origin) / d));
    const Side side = across_x ? (tile_is_after ? Side::west : Side::east)
                               : (tile_is_after ? Side::south : Side::north);
    // Outline of the wall between two nodes: base from first to last, then the top back.
    std::vector<std::uint32_t> corners;
    std::vector<Flat> outline, hole;
    for (ptrdiff_t i = first; i <= last; ++i) corners.push_back(low(side, i));
    for (ptrdiff_t i = last; i >= first; --i) corners.push_back(high(side, i));
    for (const std::uint32_t v : corners) {
      const Vec3 p = mesh_.vertices_mm[v];
      outline.push_back({across_x ? p.y : p.x, p.z});
    }
    const double r = hole_radius_mm(options_);
    for (int k = 0; k < kDowelSides; ++k) {
      const double turn = 2.0 * std::numbers::pi * k / kDowelSides;
      hole.push_back({middle + r * std::cos(turn), dowel.centre_mm.z + r * std::sin(turn)});
    }
    for (ptrdiff_t i = first; i < last; ++i) remove_wall(side, i);
    // Seen against y the coordinates x, z turn as they should for a southern wall, and against x
    // the coordinates y, z for an eastern one; the other two look the other way.
    const bool as_is = side == Side::south || side == Side::east;
    const auto rim = static_cast<std::uint32_t>(mesh_.vertices_mm.size());
    const double inward = (tile_is_after ? 1.0 : -1.0) * options_.depth_mm;
    for (const double depth : {0.0, inward})
      for (const Flat& p : hole)
        mesh_.vertices_mm.push_back(across_x ? Vec3{dowel.centre_mm.x + depth, p.s, p.z}
                                             : Vec3{p.s, dowel.centre_mm.y + depth, p.z});
    const auto count = static_cast<std::uint32_t>(corners.size());
    for (const auto& t : detail::triangulate_ring(outline, hole)) {
      const auto vertex = [&](std::uint32_t i) { return i < count ? corners[i] : rim + i - count; };
      add({vertex(t[0]), vertex(t[1]), vertex(t[2])}, as_is);
    }
    line_hole(rim, as_is);
  }

  TriMesh take() {
    std::size_t kept = 0;
    for (std::size_t i = 0; i < mesh_.triangles.size(); ++i)
      if (i >= gone_.size() || !gone_[i]) mesh_.triangles[kept++] = mesh_.triangles[i];
    mesh_.triangles.resize(kept);
    return std::move(mesh_);
  }

 private:
  enum class Side { south, east, north, west };

  /// Place on the rim (grid_stream.hpp), counter-clockwise from the south-western corner.
  [[nodiscard]] ptrdiff_t rim_of(Side side, ptrdiff_t node) const {
    const ptrdiff_t c = window_.cols() - 1, r = window_.rows() - 1;
    switch (side) {
      case Side::south:
        return node - window_.col0;
      case Side::east:
        return c + node - window_.row0;
      case Side::north:
        return c + r + window_.col1 - node;
      case Side::west:
        return 2 * c + r + window_.row1 - node;
    }
    return 0;
  }
  [[nodiscard]] ptrdiff_t rim_count() const { return 2 * (window_.cols() + window_.rows() - 2); }
  [[nodiscard]] std::uint32_t low(Side side, ptrdiff_t node) const {
    return static_cast<std::uint32_t>(window_.rows() * window_.cols() +
                                      rim_of(side, node) % rim_count());
  }
  [[nodiscard]] std::uint32_t high(Side side, ptrdiff_t node) const {
    ptrdiff_t row = node - window_.row0, col = node - window_.col0;
    if (side == Side::south) row = 0;
    if (side == Side::north) row = window_.rows() - 1;
    if (side == Side::west) col = 0;
    if (side == Side::east) col = window_.cols() - 1;
    return static_cast<std::uint32_t>(row * window_.cols() + col);
  }
  /// Between a node and the next one along the joint.
  void remove_wall(Side side, ptrdiff_t node) {
    const ptrdiff_t segment = std::min(rim_of(side, node), rim_of(side, node + 1));
    const ptrdiff_t top = 2 * (window_.rows() - 1) * (window_.cols() - 1);
    for (const ptrdiff_t i : {0, 1}) {
      const auto at = static_cast<std::size_t>(top + 3 * segment + i);
      MAQUETTE_CHECK(!gone_[at], "holes meet at node {}", node);
      gone_[at] = true;
    }
  }
  void add(std::array<std::uint32_t, 3> t, bool as_is) {
    if (!as_is) std::swap(t[1], t[2]);
    mesh_.triangles.push_back(t);
  }
  /// From the rim's ring to the one behind it, and the bottom.
  void line_hole(std::uint32_t rim, bool as_is) {
    constexpr auto n = static_cast<std::uint32_t>(kDowelSides);
    for (std::uint32_t k = 0; k < n; ++k) {
      const std::uint32_t a = rim + k, b = rim + (k + 1) % n;
      add({a, b, b + n}, as_is);
      add({a, b + n, a + n}, as_is);
      if (k > 0 && k + 1 < n) add({rim + n, a + n, b + n}, as_is);
    }
  }

  const ModelField& surface_;
  NodeWindow window_;
  DowelOptions options_;
  TriMesh mesh_;
  std::vector<bool> gone_;
};

}  // namespace

double hole_radius_mm(const DowelOptions& o) {
  return 0.5 * (o.diameter_mm + o.play_mm) / std::cos(std::numbers::pi / kDowelSides);
}

double hole_volume_mm3(const DowelOptions& o) {
  const double r = hole_radius_mm(o);
  return 0.5 * kDowelSides * r * r * std::sin(2.0 * std::numbers::pi / kDowelSides) * o.depth_mm;
}

Result<std::vector<Dowel>> place_dowels(const ModelField& surface, std::span<const Tile> tiles,
                                        Millimetres base_z, Millimetres base_thickness,
                                        const DowelOptions& options) {
  MAQUETTE_TRY_VOID(check_options(options, base_thickness));
  for (const Tile& t : tiles)
    if (tiles.size() > 1) MAQUETTE_TRY_VOID(check_tile(surface, t, options));
  const double half = half_room_mm(surface, options);
  // Past the holes that come in from the joints at either end.
  const double end = half + options.depth_mm + options.wall_mm;
  std::vector<Dowel> dowels;
  for (const Joint& j : joints_of(tiles)) {
    const auto along = [&](ptrdiff_t i) { return j.across_x ? surface.y_mm(i) : surface.x_mm(i); };
    for (const double place : places_along(along(j.first), along(j.last), end, half, options)) {
      const double z = base_z.value() + 0.5 * base_thickness.value();
      dowels.push_back({.number = static_cast<int>(dowels.size() + 1),
                        .tiles = {j.before->number, j.after->number},
                        .along_x = j.across_x,
                        .centre_mm = j.across_x ? Vec3{surface.x_mm(j.line), place, z}
                                                : Vec3{place, surface.y_mm(j.line), z}});
    }
  }
  return dowels;
}

Result<TriMesh> bored_solid(const ModelField& surface, const Tile& tile, Millimetres base_z,
                            std::span<const Dowel> dowels, const DowelOptions& options) {
  MAQUETTE_TRY(const auto solid,
               GridSolidStream::create(surface, tile.nodes, SolidOptions{.base_z = base_z}));
  Borer borer(surface, tile, options);
  borer.load(solid);
  for (const Dowel& dowel : dowels)
    for (const std::size_t side : {0U, 1U})
      if (dowel.tiles[side] == tile.number) borer.bore(dowel, side == 1);
  return borer.take();
}

}  // namespace maquette::meshing
