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

/// Stones farther from the origin are not rounded: 32 bits would move them by more than 1e-3 mm.
inline constexpr double kFarthestRounded_mm = 16384.0;

struct ExactUnion {
  Patch patch;            ///< with an empty block if the stones are buried
  std::string why_not{};  ///< not empty: there is no patch, and why
  /// Sound as it is, but not with the coordinates of every format.
  bool spoilt_in_files = false;
};

/// Boolean union with exact predicates. The field's nodes that are left stay to the bit, all other
/// vertices lie where 32 bits hold them, those of the line where terrain and stones meet on both to
/// that rounding; but for edges of kShortestEdge_mm, of which one end is moved, and those of
/// triangles that cut others because of rounding (up to kLongestMended_mm, tidy_union.cpp). Pockets
/// of air are filled. The patch is proven, with its own coordinates and those that STL, OBJ and 3MF
/// make of them (CoordinateRounding): closed towards the block's border, manifold, no degenerate
/// triangle, none that cuts another one. Where that cannot be had (bodies that only touch, apart by
/// `shift`), its own alone: spoilt_in_files tells. Nothing is rounded beyond kFarthestRounded_mm.
/// Same stones, same bits for any number of threads.
/// @param shift  of the first stone, twice as much of the second and so on: against places where
///               bodies only touch
/// MESHING_NOT_A_SOLID: a stone hangs in the air.
/// @pre stones closed, outward, inside the field's outline
[[nodiscard]] Result<ExactUnion> unite_exactly(const heightmap::ModelField& surface,
                                               const StoneCluster& cluster, Vec3 shift);

}  // namespace maquette::meshing::detail
