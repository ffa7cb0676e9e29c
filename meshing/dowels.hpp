// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file dowels.hpp
/// Holes for dowels and magnets in the joints between tiles, so that they meet where they were cut
/// and stay together.
///
/// Room    meshing:  tiles -> [dowels] -> shaped_solid -> bands on disk
/// Takes   a field, its tiles (tiles.hpp), diameter and length of what goes into the holes
/// Gives   where holes sit; for each tile and hole the piece of wall that replaces the plain one
///         (engraving.hpp)
///
/// A hole is a prism of 32 sides round the dowel or magnet (which with its play fits in it), level,
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
#include "meshing/engraving.hpp"
#include "meshing/tiles.hpp"

namespace maquette::meshing {

inline constexpr ErrorCode kDowelDoesNotFit{"MESHING_DOWEL_DOES_NOT_FIT"};

/// Of holes of one kind; a magnet's depth is what of it goes into each tile.
struct DowelOptions {
  double diameter_mm = 4.0;
  double play_mm = 0.2;       ///< a hole is wider than its dowel by that
  double depth_mm = 10.0;     ///< of a hole, in each of the two tiles
  double wall_mm = 2.0;       ///< least material around a hole
  double spacing_mm = 200.0;  ///< from one to the next along a joint, at most; never fewer than two
  double between_mm = 0.0;    ///< room that is left free between two of them, for holes of others
};

/// A level cylinder with its middle on a joint: a dowel, or a pair of magnets.
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

/// The dowel itself, to be printed or turned: a closed cylinder of 64 sides standing on z = 0 round
/// the z axis, corners on the dowel's radius, both ends chamfered by a tenth of the diameter, half
/// a millimetre (of short ones a twentieth of the depth) of air before the floor of either hole.
/// @pre diameter and depth positive
[[nodiscard]] TriMesh dowel_pin(const DowelOptions& options);
[[nodiscard]] double pin_length_mm(const DowelOptions& options);

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

/// Along a joint, with its walls and to the next nodes: what a hole of this kind takes.
[[nodiscard]] double room_along_mm(const heightmap::ModelField& surface,
                                   const DowelOptions& options);

/// One in the middle between two neighbours of a joint, where there is room for it: magnets among
/// dowels. @pre the dowels are those of place_dowels for this surface
[[nodiscard]] std::vector<Dowel> place_between(const heightmap::ModelField& surface,
                                               std::span<const Dowel> dowels,
                                               const DowelOptions& of_dowels,
                                               const DowelOptions& options);

/// The tile's walls with its halves of the holes, one piece each.
/// @pre the dowels are those of place_dowels or place_between for this surface, base and these
///      tiles
[[nodiscard]] std::vector<EngravedWall> bored_walls(const heightmap::ModelField& surface,
                                                    const Tile& tile, Millimetres base_z,
                                                    std::span<const Dowel> dowels,
                                                    const DowelOptions& options);

/// How deep holes go into a wall of the tile; 0 where there are none. A hollow tile is so much
/// thicker there (HollowOptions::cut).
[[nodiscard]] Millimetres bored_depth(const Tile& tile, std::span<const Dowel> dowels,
                                      WallSide side, const DowelOptions& options);

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
