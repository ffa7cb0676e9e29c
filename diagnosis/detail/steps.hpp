// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

// Moments of the program at which the surface steps: candidates for lost steps and bands that do
// not meet. Proposals only; whether there is a step is for choosing and confirming to say.

#include <vector>

#include "diagnosis/detail/sums.hpp"

namespace maquette::diagnosis::detail {

/// @return shares of the program's time, at most 4, the sharpest step along `axis` first. At each
///   moment the displacement fitted before and after it is compared over windows of 0.8, 2.5 and
///   8 % of the program; peaks count that stand 4 robust deviations above the rest, for smooth
///   noise makes differences everywhere. Choosing blocks only.
[[nodiscard]] std::vector<double> sharpest_steps(const std::vector<Observation>& all,
                                                 const std::vector<double>& residual,
                                                 const Layout& layout, int axis);

}  // namespace maquette::diagnosis::detail
