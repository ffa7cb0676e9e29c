// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include "core/grid.hpp"

namespace maquette::diagnosis::detail {

/// Separable Gaussian of that standard deviation, cut off at 3.5 of it; nodes that are NaN count
/// for nothing.
[[nodiscard]] Grid<float> smoothed(const Grid<float>& z, double sigma_nodes);

}  // namespace maquette::diagnosis::detail
