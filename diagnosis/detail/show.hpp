// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

// What the report shows of residuals before and after.

#include <vector>

#include "diagnosis/diagnose.hpp"

namespace maquette::diagnosis::detail {

/// Means by squares of a hundred-and-twentieth of the longer side.
[[nodiscard]] Map draw(const std::vector<Observation>& all, const std::vector<double>& before,
                       const std::vector<double>& after, const Box3& box);
/// Means by classes of slope, time, place, incidence, range and rise of the feed.
[[nodiscard]] std::vector<Dependence> dependences(const std::vector<Observation>& all,
                                                  const std::vector<double>& before,
                                                  const std::vector<double>& after);

}  // namespace maquette::diagnosis::detail
