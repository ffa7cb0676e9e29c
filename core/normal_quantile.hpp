// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cmath>
#include <numbers>

namespace maquette {

/// |z| of which a share `p` of a normal distribution lies beyond. @pre 0 < p <= 1
inline double two_sided_normal_quantile(double p) {
  double low = 0.0, high = 40.0;
  for (int i = 0; i < 100; ++i) {
    const double middle = 0.5 * (low + high);
    (std::erfc(middle / std::numbers::sqrt2) > p ? low : high) = middle;
  }
  return high;
}

}  // namespace maquette
