// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file coregister.hpp
/// By how much one surface must move to lie on another.
///
/// Method: Nuth and Kaab 2011, doi:10.5194/tc-5-271-2011: the height difference of two
/// shifted surfaces is the shift times the slope. Solved here in its linear form
/// (difference = shift . gradient + constant, least squares, residuals beyond three
/// NMAD left out), iterated, so that flat ground needs no division by its slope. Both
/// surfaces are first brought to the resolution of the coarser one.

#include <optional>

#include "core/grid.hpp"

namespace maquette::heightmap::detail {

/// Add it to the position of the upper surface to lay it on the lower.
struct Coregistration {
  double east_m = 0.0, north_m = 0.0, up_m = 0.0;
  /// Normalised median absolute deviation of the height difference.
  double nmad_before_m = 0.0, nmad_after_m = 0.0;
  bool horizontal = false;  ///< relief was enough to say where; else east = north = 0
};

/// Both grids on the same nodes, voids NaN.
/// @param coarse_pixel_m  pixel of the coarser of the two
/// @return nothing if no node has both heights
[[nodiscard]] std::optional<Coregistration> coregister(const Grid<float>& lower,
                                                       const Grid<float>& upper, double spacing_m,
                                                       double coarse_pixel_m);

}  // namespace maquette::heightmap::detail
