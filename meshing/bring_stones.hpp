// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file bring_stones.hpp
/// The same stones at another scale.
///
/// Room   meshing:  placed stones of one surface -> [bring_stones] -> of another scale's
/// Takes  poses in the model frame of one scale, millimetres
/// Gives  the same poses on the planet in the model frame of another: exact to rounding

#include <span>
#include <vector>

#include "meshing/stones.hpp"

namespace maquette::meshing {

/// Places and sizes go by the ratio of the scales, orientations stay; the depth is the other
/// ground's. A stone whose vertices are not all over the other ground is left out. Between the
/// surfaces lies what only the finer one shows: by so much the stone lies higher or deeper there.
/// @pre both grounds have the same vertical exaggeration
[[nodiscard]] std::vector<PlacedStone> bring_stones(std::span<const PlacedStone> stones,
                                                    const StoneGround& from, const StoneGround& to);

/// The circumscribed spheres, seen from above.
[[nodiscard]] std::vector<StoneDisc> discs_of(std::span<const PlacedStone> stones,
                                              const StoneGround& ground);

}  // namespace maquette::meshing
