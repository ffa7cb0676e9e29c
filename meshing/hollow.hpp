// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file hollow.hpp
/// The underside of a solid, opened into pockets between ribs: less weight, less material, walls
/// of even thickness for casting and sintering. Open below, so nothing has to be drained.
///
/// Room    meshing:  surface, roof -> [hollow] -> shaped_solid
/// Takes   ModelField; its roof: the same surface offset inwards along the normal by the wall
///         (cnc/ball_offset.hpp); height of the base
/// Gives   triangles from the walls' lower rim inwards: frame and ribs in the base's plane,
///         upright walls of pockets, their ceilings
///
/// Plan. Side walls all round, within them the fewest equal pockets that are not wider than asked,
/// ribs between them; widths of walls and ribs are met exactly, wherever nodes lie. Ribs and frame
/// reach down to the base.
/// Ceiling. A grid of its own, coarser than the surface's (`step`), heights at its nodes, two
/// triangles a cell. It starts on the roof; then every node is lowered by what the worst triangle
/// at it exceeds the roof anywhere, which suffices for all of them at once, since a triangle sinks
/// at least by what its three corners all sink.
///
/// Accuracy. Every point of a ceiling is at least the wall from every point of the surface, not
/// only at nodes. Over the nodes of all cells that a ceiling's triangle touches it lies below the
/// roof. Between nodes the roof may dip below its facets, where the surface is hollow: with J the
/// change of slope across an edge, by J s / 4 at most for each of the three directions of edges
/// (an upright line through a triangle of width s, and convexity), so the ceiling keeps so much
/// more than the wall, taken over all edges within the wall's reach. On slopes that is nothing and
/// the wall is met to float; on waves it is what `most_excess_mm` says. The roof's own rounding to
/// float is allowed for.
/// Cost    one look at each node and 24 bytes a node of the ceiling's grid

#include <array>
#include <cstdint>

#include "core/result.hpp"
#include "core/run_context.hpp"
#include "core/tri_mesh.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::meshing {

inline constexpr ErrorCode kHollowDoesNotFit{"MESHING_HOLLOW_DOES_NOT_FIT"};

struct HollowOptions {
  Millimetres wall{3.0};  ///< least thickness: above a ceiling along the normal, and at the sides
  Millimetres rib{3.0};   ///< thickness of ribs
  Millimetres pocket{40.0};  ///< widest pocket, in x and in y
  Millimetres step{0.0};     ///< of the ceilings' grid, at most; 0: four spacings
  /// How deep grooves and holes go into the south, east, north and west wall: they are so much
  /// thicker.
  std::array<Millimetres, 4> cut{Millimetres{0}, Millimetres{0}, Millimetres{0}, Millimetres{0}};
};

/// Pockets are at least that deep and that wide.
inline constexpr double kLeastPocketDepth_mm = 1.0;

struct Underside {
  /// First vertices: the walls' lower rim, counter-clockwise seen from above, from the
  /// south-western corner on, one for each node. Triangles face down and into the pockets.
  TriMesh mesh;
  std::uint64_t rim_vertices = 0;
  int pockets_x = 0, pockets_y = 0;
  double pocket_x_mm = 0.0, pocket_y_mm = 0.0;  ///< width of each
  double volume_mm3 = 0.0;                      ///< of all pockets
  double lowest_ceiling_mm = 0.0, highest_ceiling_mm = 0.0;
  double least_height_mm = 0.0;  ///< of the surface above a ceiling, upright
  /// Of a ceiling below the roof, upright, at the surface's nodes: how much thicker than the wall.
  double mean_excess_mm = 0.0, most_excess_mm = 0.0;
};

/// The base of a solid that is not hollow: one level face.
[[nodiscard]] Underside plain_underside(const heightmap::ModelField& surface, Millimetres base_z);

/// MESHING_HOLLOW_DOES_NOT_FIT: lengths that are none; side walls that meet; a base that is too
/// thin for the wall and a pocket of 1 mm below it (says which would do). CORE_CANCELLED.
/// @pre the roof is that of the surface, for this wall; base below the surface
[[nodiscard]] Result<Underside> hollow_underside(const heightmap::ModelField& surface,
                                                 const heightmap::ModelField& roof,
                                                 Millimetres base_z, const HollowOptions& options,
                                                 const RunContext& run = {});

}  // namespace maquette::meshing
