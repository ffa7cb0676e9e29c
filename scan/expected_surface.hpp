// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file expected_surface.hpp
/// What a scanner should meet when nothing has gone wrong: the design, what the program leaves on
/// it (scallops, creases that the ball does not reach) and the coat that was declared.
///
/// Room     scan:  design, as-milled field, coat -> [expected_surface] -> register_scan, deviate
///
/// A deviation from the design has two parts: what was known before the part was made, and what
/// was not. Only the second is a finding; and only a pose on the expected surface leaves both
/// where they are (a best fit to the design hides the mean of the scallops and a coat).
///
/// Excess   At a node where no stone stands: the mean of as-milled minus ground over the as-milled
///          nodes within half a spacing, so ridges finer than the grid count with their mean.
/// Coat     Along the normal of that surface: thickness / n_z is added to the height. That is the
///          true parallel surface of a plane; at a curvature k it is wrong by the order of
///          k thickness^2 / 2 (0.25 mm in a crease of 3 mm radius: 0.01 mm).

#include "core/units.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::scan {

/// @param design     with the stones that stand on it
/// @param ground     the design without stones, on the same nodes; the design itself if there are
///                   none
/// @param as_milled  the simulated cut of the ground, any spacing; null: the ground as it is
/// @return on the design's nodes; a node that the cut does not cover is the design's
/// @pre design and ground have the same nodes
[[nodiscard]] heightmap::ModelField expected_surface(const heightmap::ModelField& design,
                                                     const heightmap::ModelField& ground,
                                                     const heightmap::ModelField* as_milled,
                                                     Millimetres coat);

}  // namespace maquette::scan
