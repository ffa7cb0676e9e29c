// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

// Waves in the residual along an axis: the strongest lines of its periodogram.

#include <vector>

#include "diagnosis/detail/sums.hpp"
#include "diagnosis/observation.hpp"

namespace maquette::diagnosis::detail {

/// Waves of all kinds into the scene, of residuals as they are and of what is left of them by a
/// quadric in each block: what is smooth over many passes (a bow) has the periodogram's strongest
/// lines at the passes' own rhythm.
void find_waves(const std::vector<Observation>& all, const std::vector<double>& residual,
                const Layout& layout, Scene& scene);

/// @return numbers of waves over `span_mm`, at most 4, none that is no stronger than noise makes
///   once in a thousand cases; from 6 waves a span up to wavelengths of 0.8 mm. Choosing blocks
///   only.
[[nodiscard]] std::vector<double> strongest_waves(const std::vector<Observation>& all,
                                                  const std::vector<double>& residual,
                                                  const Layout& layout, int axis, double span_mm);

/// The same along the cutting length, for waves that are steady in time: waves over the whole
/// length, which is many, so that their number is known to a half. Wavelengths of 0.8 mm to 40 mm.
[[nodiscard]] std::vector<double> strongest_path_waves(const std::vector<Observation>& all,
                                                       const std::vector<double>& residual,
                                                       const Layout& layout, double cut_mm);

}  // namespace maquette::diagnosis::detail
