// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file sky_view.hpp
/// Ambient occlusion of a height field: what share of an even surrounding light its ground sees.
///
///   V = 1/pi * integral over azimuth of 1/2 [ n_z sin^2 t + n_a (t - sin t cos t) ]
///
/// t is the angle from the zenith to the horizon, n_a the normal's part along the azimuth: the
/// cosine-weighted hemisphere about the normal (Dozier and Frew 1990, doi:10.1109/36.58986, eq.
/// 7b). No horizon is below the plane of the ground itself; where no ground rises, all of that
/// hemisphere counts, below the horizontal, too, as renderers have it. A plane has V = 1, however
/// it is tilted.
///
/// Horizons are those of the nodes along 16 azimuths in which nodes lie in rows (steps of (1, 0),
/// (2, 1), (1, 1), ...), by a convex hull that is carried along each row: time linear in the nodes,
/// any distance. Behind the field's outline nothing rises.

#include <array>
#include <cstddef>
#include <functional>

#include "core/grid.hpp"

namespace maquette::exporting {

/// dz/dx, dz/dy of a node.
using SlopeAt = std::function<std::array<float, 2>(std::ptrdiff_t row, std::ptrdiff_t col)>;

/// @param z_mm  heights, finite; rows to the north
/// @return of each node, 0 to 1; same bits for any number of threads
[[nodiscard]] Grid<float> sky_view(const Grid<float>& z_mm, double spacing_mm,
                                   const SlopeAt& slope);

}  // namespace maquette::exporting
