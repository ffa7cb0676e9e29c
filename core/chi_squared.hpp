// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <algorithm>
#include <cmath>

namespace maquette {

/// Probability that chi-squared with so many degrees of freedom is larger than x: the regularised
/// upper incomplete gamma function of half-integer order, by recurrence.
/// @pre degrees >= 1
inline double chi_squared_tail(double x, int degrees) {
  if (!(x > 0.0)) return 1.0;
  const double h = 0.5 * x;
  double q = degrees % 2 == 0 ? std::exp(-h) : std::erfc(std::sqrt(h));
  double a = degrees % 2 == 0 ? 1.0 : 0.5;
  for (; a + 0.75 < 0.5 * degrees; a += 1.0)
    q += std::exp(a * std::log(h) - h - std::lgamma(a + 1.0));
  return std::clamp(q, 0.0, 1.0);
}

}  // namespace maquette
