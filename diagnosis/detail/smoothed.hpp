// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <span>
#include <vector>

#include "core/grid.hpp"

namespace maquette::diagnosis::detail {

/// Separable Gaussians of these standard deviations, cut off at 3.5 of them; nodes that are NaN
/// count for nothing.
[[nodiscard]] std::vector<Grid<float>> smoothed(const Grid<float>& z,
                                                std::span<const double> sigmas_nodes);

}  // namespace maquette::diagnosis::detail
