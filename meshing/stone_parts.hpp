// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file stone_parts.hpp
/// What the workshop makes: each distinct stone of a plan once, a little smaller than designed so
/// that it goes into its place.
///
/// Room   meshing:  stones -> [stone_parts] -> export (3MF, STL, packed build volumes)
/// Takes  placed stones, millimetres
/// Gives  per distinct stone a closed mesh in the stone's own frame, what clearance it has, what a
///        sintering machine cannot keep of it

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "core/result.hpp"
#include "core/tri_mesh.hpp"
#include "core/units.hpp"
#include "meshing/stones.hpp"

namespace maquette::meshing {

inline constexpr ErrorCode kStoneVanishes{"MESHING_STONE_VANISHES"};
inline constexpr ErrorCode kStoneFolds{"MESHING_STONE_FOLDS"};

/// Stones of the same shape and size.
struct CatalogueStone {
  std::string part_number;  ///< "S001", by falling size
  int shape_number = 0;     ///< 1, 2, ... stones of one shape in several sizes share it
  assets::RockShape shape;
  StoneBodyPtr body;                ///< as of PlacedStone
  double scale_mm = 0.0;            ///< equivalent diameter
  std::vector<std::size_t> places;  ///< in the plan, of the stones that are made so; by number
};

/// By falling size; same plan, same numbers. Shapes and sizes are the same where their numbers
/// are, to the bit.
[[nodiscard]] std::vector<CatalogueStone> stone_catalogue(std::span<const PlacedStone> stones);

/// The body offset inwards: what is left where no point may be nearer to the stone's surface than
/// `clearance`.
///
/// Method. Each vertex goes straight towards the origin until its distance to the surface is the
/// clearance, in steps of what is still missing: a distance never grows faster than the way, so no
/// step goes too far (J. C. Hart, "Sphere tracing", Vis. Comput. 12, 1996,
/// doi:10.1007/s003710050084). A body that is star-shaped round a ball of radius `clearance` stays
/// so round the origin, and each direction keeps its vertex.
/// Accuracy. Vertices to 1e-6 mm. Facets between them: on convex ground farther inside, in hollows
/// nearer to the surface by the sagitta of a facet. Clearance 0 gives the same vertices.
/// MESHING_STONE_VANISHES: nothing is left in some direction. MESHING_STONE_FOLDS: not star-shaped
/// round the origin (a triangle faces it), as bodies from files may be.
/// @pre closed; clearance >= 0
[[nodiscard]] Result<TriMesh> shrink_stone(const TriMesh& stone, Millimetres clearance);

/// Least and largest distance of a shrunk stone's surface (vertices, middles of edges and facets)
/// from the designed one.
struct ClearanceRange {
  double least_mm = 0.0, most_mm = 0.0;
};
[[nodiscard]] ClearanceRange clearance_of(const TriMesh& shrunk, const TriMesh& designed);

/// How far the stone's surface stands out of the union of all balls of diameter `wall` that fit in
/// it (the opening of mathematical morphology): what a process with that least wall rounds off or
/// loses. (1 / sin(a / 2) - 1) wall / 2 at an edge of angle a; INFINITY where not even the origin
/// has such a ball round it, NaN where the stone folds (see shrink_stone).
/// Accuracy: too large by at most the sagitta of a facet of the body shrunk by wall / 2.
/// @pre as shrink_stone; wall > 0
[[nodiscard]] double thinner_than_wall_mm(const TriMesh& stone, Millimetres wall);

}  // namespace maquette::meshing
