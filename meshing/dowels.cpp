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
  const double most = std::floor(free / (2.0 * half_mm + o.between_mm));
  const double gaps = std::clamp(std::ceil(free / o.spacing_mm), 1.0, std::fmax(1.0, most));
  std::vector<double> places;
  for (double i = 0.0; i <= gaps; i += 1.0) places.push_back(from + end_mm + free * i / gaps);
  return places;
}

Result<void> check_options(const DowelOptions& o, Millimetres base_thickness) {
  for (const auto& [name, value, least] : {std::tuple{"diameter", o.diameter_mm, 0.1},
                                           {"play", o.play_mm, 0.0},
                                           {"depth", o.depth_mm, 0.1},
                                           {"wall", o.wall_mm, 0.1},
                                           {"room between holes", o.between_mm, 0.0},
                                           {"spacing", o.spacing_mm, 1.0}})
    if (!(value >= least && value <= 1e4))
      return fail(kDowelDoesNotFit,
                  fmt::format("a hole's {} of {} mm; {} to 10000 mm expected", name, value, least));
  const double needed = 2.0 * (hole_radius_mm(o) + o.wall_mm);
  if (base_thickness.value() < needed)
    return fail(
        kDowelDoesNotFit,
        fmt::format("holes for {:g} mm with walls of {:g} mm take a base of {:.2f} mm; it "
                    "has {:g} mm: a thicker base, thinner dowels or smaller magnets would do",
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

/// Which of the outline's edges, from the south-western corner counter-clockwise, nodes first ..
/// last of a wall bound, counted in the whole's rows or columns.
std::uint64_t first_edge(const NodeWindow& w, WallSide side, ptrdiff_t first, ptrdiff_t last) {
  const ptrdiff_t c = w.cols() - 1, r = w.rows() - 1;
  switch (side) {
    case WallSide::south:
      return static_cast<std::uint64_t>(first - w.col0);
    case WallSide::east:
      return static_cast<std::uint64_t>(c + first - w.row0);
    case WallSide::north:
      return static_cast<std::uint64_t>(c + r + w.col1 - last);
    case WallSide::west:
      return static_cast<std::uint64_t>(2 * c + r + w.row1 - last);
  }
  return 0;
}

EngravedWall bore(const ModelField& surface, const Tile& tile, double base_mm, const Dowel& dowel,
                  bool tile_is_after, const DowelOptions& options) {
  const bool across_x = dowel.along_x;
  // South and north walls run along x, west and east ones along y.
  const double middle = across_x ? dowel.centre_mm.y : dowel.centre_mm.x;
  const double origin = across_x ? surface.y0.value() : surface.x0.value();
  const double d = surface.spacing.value();
  const double reach = hole_radius_mm(options) + options.wall_mm;
  const auto first = static_cast<ptrdiff_t>(std::floor((middle - reach - origin) / d));
  const auto last = static_cast<ptrdiff_t>(std::ceil((middle + reach - origin) / d));
  const WallSide side = across_x ? (tile_is_after ? WallSide::west : WallSide::east)
                                 : (tile_is_after ? WallSide::south : WallSide::north);
  const ptrdiff_t line = across_x ? (tile_is_after ? tile.nodes.col0 : tile.nodes.col1)
                                  : (tile_is_after ? tile.nodes.row0 : tile.nodes.row1);
  // Outline of the wall between two nodes: base from first to last, then the top back. The tile's
  // outline runs the other way in the north and the west.
  const bool rising = side == WallSide::south || side == WallSide::east;
  const auto nodes = static_cast<std::uint32_t>(last - first + 1);
  std::vector<std::uint32_t> corners;
  std::vector<Flat> outline, hole;
  const auto add_node = [&](ptrdiff_t i, bool top) {
    const auto along = static_cast<std::uint32_t>(rising ? i - first : last - i);
    corners.push_back(top ? nodes + along : along);
    const auto z = static_cast<double>(across_x ? surface.z_mm(i, line) : surface.z_mm(line, i));
    outline.push_back({across_x ? surface.y_mm(i) : surface.x_mm(i), top ? z : base_mm});
  };
  for (ptrdiff_t i = first; i <= last; ++i) add_node(i, false);
  for (ptrdiff_t i = last; i >= first; --i) add_node(i, true);
  const double r = hole_radius_mm(options);
  for (int k = 0; k < kDowelSides; ++k) {
    const double turn = 2.0 * std::numbers::pi * k / kDowelSides;
    hole.push_back({middle + r * std::cos(turn), dowel.centre_mm.z + r * std::sin(turn)});
  }
  EngravedWall out;
  out.first_edge = first_edge(tile.nodes, side, first, last);
  out.edges = static_cast<std::uint64_t>(last - first);
  // Seen against y the coordinates x, z turn as they should for a southern wall, and against x
  // the coordinates y, z for an eastern one; the other two look the other way.
  const auto add = [&](std::array<std::uint32_t, 3> t) {
    if (!rising) std::swap(t[1], t[2]);
    out.triangles.push_back(t);
  };
  const std::uint32_t rim = 2 * nodes;
  const double inward = (tile_is_after ? 1.0 : -1.0) * options.depth_mm;
  for (const double depth : {0.0, inward})
    for (const Flat& p : hole)
      out.vertices_mm.push_back(across_x ? Vec3{dowel.centre_mm.x + depth, p.s, p.z}
                                         : Vec3{p.s, dowel.centre_mm.y + depth, p.z});
  for (const auto& t : detail::triangulate_ring(outline, hole)) {
    const auto vertex = [&](std::uint32_t i) { return i < rim ? corners[i] : i; };
    add({vertex(t[0]), vertex(t[1]), vertex(t[2])});
  }
  // From the rim's ring to the one behind it, and the bottom.
  constexpr auto n = static_cast<std::uint32_t>(kDowelSides);
  for (std::uint32_t k = 0; k < n; ++k) {
    const std::uint32_t a = rim + k, b = rim + (k + 1) % n;
    add({a, b, b + n});
    add({a, b + n, a + n});
    if (k > 0 && k + 1 < n) add({rim + n, a + n, b + n});
  }
  out.volume_mm3 = hole_volume_mm3(options);
  out.floor_area_mm2 = out.volume_mm3 / options.depth_mm;
  return out;
}

}  // namespace

double hole_radius_mm(const DowelOptions& o) {
  return 0.5 * (o.diameter_mm + o.play_mm) / std::cos(std::numbers::pi / kDowelSides);
}

double hole_volume_mm3(const DowelOptions& o) {
  const double r = hole_radius_mm(o);
  return 0.5 * kDowelSides * r * r * std::sin(2.0 * std::numbers::pi / kDowelSides) * o.depth_mm;
}

double pin_length_mm(const DowelOptions& o) {
  constexpr double kAir_mm = 0.5, kShortShare = 0.05;
  return 2.0 * (o.depth_mm - std::fmin(kAir_mm, kShortShare * o.depth_mm));
}

TriMesh dowel_pin(const DowelOptions& o) {
  constexpr std::uint32_t kSides = 64;
  const double r = 0.5 * o.diameter_mm, length = pin_length_mm(o);
  const double chamfer = std::fmin(0.1 * o.diameter_mm, 0.25 * length);
  struct Ring {
    double radius_mm, z_mm;
  };
  const std::array<Ring, 4> rings{
      {{r - chamfer, 0.0}, {r, chamfer}, {r, length - chamfer}, {r - chamfer, length}}};
  TriMesh pin;
  for (const Ring& ring : rings)
    for (std::uint32_t k = 0; k < kSides; ++k) {
      const double a = 2.0 * std::numbers::pi * k / kSides;
      pin.vertices_mm.push_back(
          {ring.radius_mm * std::cos(a), ring.radius_mm * std::sin(a), ring.z_mm});
    }
  const auto bottom = static_cast<std::uint32_t>(pin.vertices_mm.size()), top = bottom + 1;
  pin.vertices_mm.push_back({0.0, 0.0, 0.0});
  pin.vertices_mm.push_back({0.0, 0.0, length});
  constexpr auto kLast = static_cast<std::uint32_t>(rings.size() - 1) * kSides;
  for (std::uint32_t k = 0; k < kSides; ++k) {
    const std::uint32_t next = (k + 1) % kSides;
    pin.triangles.push_back({bottom, next, k});
    for (std::uint32_t low = 0; low < kLast; low += kSides) {
      pin.triangles.push_back({low + k, low + next, low + kSides + next});
      pin.triangles.push_back({low + k, low + kSides + next, low + kSides + k});
    }
    pin.triangles.push_back({top, kLast + k, kLast + next});
  }
  return pin;
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

double room_along_mm(const ModelField& surface, const DowelOptions& options) {
  return 2.0 * half_room_mm(surface, options);
}

std::vector<Dowel> place_between(const ModelField& surface, std::span<const Dowel> dowels,
                                 const DowelOptions& of_dowels, const DowelOptions& options) {
  const double needed = room_along_mm(surface, of_dowels) + room_along_mm(surface, options);
  std::vector<Dowel> between;
  for (std::size_t i = 0; i + 1 < dowels.size(); ++i) {
    const Dowel &a = dowels[i], &b = dowels[i + 1];
    if (a.tiles != b.tiles || norm(b.centre_mm - a.centre_mm) < needed) continue;
    between.push_back({.number = static_cast<int>(between.size() + 1),
                       .tiles = a.tiles,
                       .along_x = a.along_x,
                       .centre_mm = 0.5 * (a.centre_mm + b.centre_mm)});
    // The joint's own coordinate, to the bit.
    Vec3& c = between.back().centre_mm;
    (a.along_x ? c.x : c.y) = a.along_x ? a.centre_mm.x : a.centre_mm.y;
  }
  return between;
}

std::vector<EngravedWall> bored_walls(const ModelField& surface, const Tile& tile,
                                      Millimetres base_z, std::span<const Dowel> dowels,
                                      const DowelOptions& options) {
  std::vector<EngravedWall> walls;
  for (const Dowel& dowel : dowels)
    for (const std::size_t side : {0U, 1U})
      if (dowel.tiles[side] == tile.number)
        walls.push_back(bore(surface, tile, base_z.value(), dowel, side == 1, options));
  return walls;
}

Millimetres bored_depth(const Tile& tile, std::span<const Dowel> dowels, WallSide side,
                        const DowelOptions& options) {
  for (const Dowel& d : dowels) {
    const bool first = d.tiles[0] == tile.number, second = d.tiles[1] == tile.number;
    const WallSide at = d.along_x ? (second ? WallSide::west : WallSide::east)
                                  : (second ? WallSide::south : WallSide::north);
    if ((first || second) && at == side) return Millimetres{options.depth_mm};
  }
  return Millimetres{0.0};
}

}  // namespace maquette::meshing
