// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file composite_bands.hpp
/// Long waves of one surface, short waves of another, on the same nodes.
///
/// Method. Around the crossover wavelength, an octave wide, the one surface fades out as the cosine
/// and the other fades in as the sine of one angle: both are independent, so their powers add up to
/// what there was. Before that the detail is multiplied by one gain, with which its slopes there
/// have the root mean square of the relief's (slopes weighed by sin(pi octave) over that octave).
/// Waves longer than sqrt(2) crossovers stay as the relief has them, those shorter than a crossover
/// / sqrt(2) are the detail's.
///
/// Beyond the edge both go on as their mirror image turned over, so that slopes go on, and fade
/// into what lies beyond the opposite edge.
///
/// Accuracy (tests: reliefs of another generator, ten seeds): slopes at the crossover as steep as
/// the relief's to `gain_sigma`; waves of twice the crossover unchanged to 0.1 % of their height,
/// away from the edge by a crossover.

#include "core/grid.hpp"
#include "heightmap/composite.hpp"

namespace maquette::heightmap::detail {

/// @param relief_m, detail_m  same nodes, no voids
/// @param crossover_m         at least 2 sqrt(2) nodes, at most an eighth of the shorter side
/// @return gain 0 where one of them has next to no slopes there
[[nodiscard]] CompositeMatch match_slopes(const Grid<float>& relief_m, const Grid<float>& detail_m,
                                          double spacing_m, double crossover_m);

/// What is to be added to the relief, m: the detail's short waves less the relief's own.
[[nodiscard]] Grid<float> exchanged_waves(const Grid<float>& relief_m, const Grid<float>& detail_m,
                                          double spacing_m, const CompositeMatch& match);

}  // namespace maquette::heightmap::detail
