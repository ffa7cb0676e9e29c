// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file roll_stone.hpp
/// One stone, let go over the ground (method: settle_stones.hpp).

#include <cstdint>

#include "core/tri_mesh.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::meshing::detail {

enum class RollEnd {
  rests,
  leaves,    ///< the surface, or comes over a void
  wedged,    ///< cannot turn, but its contacts do not hold its centre of mass
  rolls_on,  ///< farther than it may
};

/// @param stone  closed, outward oriented, millimetres, in its own frame
/// @param farthest_mm  that its centre of mass may go sideways
/// @param toss  random bits: where it falls if it stands on its tip
/// @param model_from_stone  from where it is dropped; then where it is
[[nodiscard]] RollEnd roll_stone(const TriMesh& stone, const heightmap::ModelField& surface,
                                 double farthest_mm, std::uint64_t toss,
                                 RigidTransform& model_from_stone);

}  // namespace maquette::meshing::detail
