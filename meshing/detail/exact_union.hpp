// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file exact_union.hpp
/// Terrain and stones united facet by facet: what is left of the field's triangles and of the
/// stones', with the line in which they meet.

#include <string>
#include <string_view>

#include "core/result.hpp"
#include "meshing/detail/shell.hpp"
#include "meshing/detail/stone_cap.hpp"

namespace maquette::meshing::detail {

/// Edges shorter than that are collapsed, triangles lower than that are turned away: what is
/// smaller would not survive the 32 bits of most files at a metre (0.00006 mm).
inline constexpr double kShortestEdge_mm = 1e-3;
inline constexpr double kLowestTriangle_mm = 2e-4;

struct ExactUnion {
  Patch patch;          ///< with an empty block if the stones are buried
  std::string why_not;  ///< not empty: there is no patch, and why
};

/// Boolean union with exact predicates. Vertices of terrain and stones that are left stay to the
/// bit, those of the line where they meet lie on both to rounding; but for edges of
/// kShortestEdge_mm, of which one end is moved. Pockets of air are filled. The patch is proven:
/// closed towards the block's border, manifold, no degenerate triangle, none that cuts another one.
/// Same stones, same bits for any number of threads.
/// @param shift  of the first stone, twice as much of the second and so on: against places where
///               bodies only touch
/// MESHING_NOT_A_SOLID: a stone hangs in the air.
/// @pre stones closed, outward, inside the field's outline
[[nodiscard]] Result<ExactUnion> unite_exactly(const heightmap::ModelField& surface,
                                               const StoneCluster& cluster, Vec3 shift);

}  // namespace maquette::meshing::detail
