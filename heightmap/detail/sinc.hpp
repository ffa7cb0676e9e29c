// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cmath>
#include <numbers>

namespace maquette::heightmap::detail {

/// sin(pi x) / (pi x): what the mean over one pixel leaves of a wave of x cycles a pixel.
[[nodiscard]] inline double sinc(double x) {
  return std::abs(x) < 1e-6 ? 1.0 : std::sin(std::numbers::pi * x) / (std::numbers::pi * x);
}

}  // namespace maquette::heightmap::detail
