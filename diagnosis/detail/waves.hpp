// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

// Waves in the residual along axes and path: the strongest lines of periodograms.

#include <vector>

#include "diagnosis/detail/sums.hpp"
#include "diagnosis/observation.hpp"

namespace maquette::diagnosis::detail {

/// Waves of all kinds into the scene, of residuals as they are and of what is left of them by a
/// quadric in each block: what is smooth over many passes (a bow) has the periodogram's strongest
/// lines at the passes' own rhythm. Slow ones, of guides, of what a bow of the whole part leaves.
void find_waves(const std::vector<Observation>& all, const std::vector<double>& residual,
                const Layout& layout, Scene& scene);

}  // namespace maquette::diagnosis::detail
