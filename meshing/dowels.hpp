// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file dowels.hpp
/// Holes for dowels in the joints between tiles, so that they meet where they were cut.
///
/// Room    meshing:  tiles -> [dowels] -> bands on disk
/// Takes   a field, its tiles (tiles.hpp), a dowel's diameter and length
/// Gives   where dowels sit; each tile's solid with its halves of the holes
///
/// A hole is a prism of 32 sides round the dowel (the dowel with its play fits in it), level,
/// square to the joint, at the same height in all of the part: in the middle of the base, which
/// lies under every node. Around it the wall is triangulated anew (CGAL's constrained Delaunay
/// triangulation) in coordinates that do not know on which side the tile lies: both tiles have the
/// same triangles there, to the bit, as they have elsewhere. Top, base and rims stay as they were.

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "core/result.hpp"
#include "core/tri_mesh.hpp"
#include "meshing/tiles.hpp"

namespace maquette::meshing {

inline constexpr ErrorCode kDowelDoesNotFit{"MESHING_DOWEL_DOES_NOT_FIT"};

struct DowelOptions {
  double diameter_mm = 4.0;
  double play_mm = 0.2;       ///< a hole is wider than its dowel by that
  double depth_mm = 10.0;     ///< of a hole, in each of the two tiles
  double wall_mm = 2.0;       ///< least material around a hole
  double spacing_mm = 200.0;  ///< from one to the next along a joint, at most; never fewer than two
};

/// A level cylinder with its middle on a joint.
struct Dowel {
  int number = 0;              ///< 1, 2, ...
  std::array<int, 2> tiles{};  ///< south or west of the joint, north or east of it
  bool along_x = false;        ///< its axis: the joint lies across x
  Vec3 centre_mm;              ///< on the joint
};

/// Corners of a hole and how much material one half of it takes.
inline constexpr int kDowelSides = 32;
[[nodiscard]] double hole_radius_mm(const DowelOptions& options);  ///< of the corners
[[nodiscard]] double hole_volume_mm3(const DowelOptions& options);

/// Two or more in each joint, evenly; one in the middle where two do not fit, none where the joint
/// is shorter than that.
/// MESHING_DOWEL_DOES_NOT_FIT: the base is not thick enough, a tile not wide enough for holes from
/// both sides (names it and what would do), or numbers that are no lengths.
/// @param base_thickness  from the solid's underside to the lowest node
[[nodiscard]] Result<std::vector<Dowel>> place_dowels(const heightmap::ModelField& surface,
                                                      std::span<const Tile> tiles,
                                                      Millimetres base_z,
                                                      Millimetres base_thickness,
                                                      const DowelOptions& options);

/// The tile's solid with its holes, in memory. MESHING_SURFACE_HAS_VOIDS, MESHING_BASE_TOO_THIN.
/// @pre the dowels are those of place_dowels for this surface, base and these tiles
[[nodiscard]] Result<TriMesh> bored_solid(const heightmap::ModelField& surface, const Tile& tile,
                                          Millimetres base_z, std::span<const Dowel> dowels,
                                          const DowelOptions& options);

namespace detail {

/// Flat, in the wall's own coordinates.
struct Flat {
  double s = 0.0, z = 0.0;
};
/// The triangles, counter-clockwise, of what lies within the first ring and outside the second
/// (both counter-clockwise); corners are numbered through both. Same input, same triangles.
[[nodiscard]] std::vector<std::array<std::uint32_t, 3>> triangulate_ring(
    std::span<const Flat> outer, std::span<const Flat> hole);

}  // namespace detail
}  // namespace maquette::meshing
