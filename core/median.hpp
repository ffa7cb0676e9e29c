// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

namespace maquette {

/// Spread of a normal distribution over its median absolute deviation, 1 / Phi^-1(3/4).
inline constexpr double kMadToSigma = 1.4826;

/// Middle value, the upper of two; puts the values into another order. O(n).
/// @pre not empty
template <class Value>
Value median_of(std::vector<Value>& values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// The same of a copy; `if_none` where there are no values.
inline double median(std::vector<double> values, double if_none = NAN) {
  return values.empty() ? if_none : median_of(values);
}

/// Normalised median absolute deviation about the median: the standard deviation of normal noise,
/// with up to half of the values spoilt (Hoehle & Hoehle 2009,
/// doi:10.1016/j.isprsjprs.2009.02.003). NaN where there are no values.
inline double nmad(std::vector<double> values) {
  const double middle = median(values);
  for (double& v : values) v = std::abs(v - middle);
  return kMadToSigma * median(std::move(values));
}

}  // namespace maquette
