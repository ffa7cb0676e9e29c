// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file cut_off.hpp
/// Numbers of a file that has none below 0: of the noise about a dark value only what is above is
/// left, and zeros. Their mean is above what they stand for (J. Tobin, "Estimation of relationships
/// for limited dependent variables", Econometrica 26 (1958) 24, doi:10.2307/1907382).

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "core/normal_quantile.hpp"

namespace maquette::diagnosis::detail {

struct CutOff {
  double mean = 0.0;   ///< of max(0, y + noise)
  double slope = 1.0;  ///< its derivative with y
};
/// @param sigma  of the noise, normal; 0: nothing is cut off
[[nodiscard]] inline CutOff cut_off(double y, double sigma) {
  constexpr double kFar = 5.0;
  if (!(sigma > 0.0) || y > kFar * sigma) return {y, 1.0};
  const double t = y / sigma, above = 0.5 * std::erfc(-t / std::numbers::sqrt2);
  return {
      y * above + sigma * std::exp(-0.5 * t * t) * std::numbers::inv_sqrtpi / std::numbers::sqrt2,
      above};
}

/// Standard deviation of normal noise about one value, of which these are the numbers: from the
/// share of zeros and the median of the rest, so that a few brighter places do not matter.
/// @return 0: too few numbers, or so few or many zeros that nothing is cut off or known
[[nodiscard]] inline double sigma_of_cut(std::vector<float> numbers) {
  constexpr std::size_t kLeast = 200;
  constexpr double kFewZeros = 0.02, kMostZeros = 0.9;
  if (numbers.size() < kLeast) return 0.0;
  std::sort(numbers.begin(), numbers.end());
  const auto n = static_cast<double>(numbers.size());
  const auto first = std::upper_bound(numbers.begin(), numbers.end(), 0.0F);
  const double zeros = static_cast<double>(first - numbers.begin()) / n;
  if (numbers.front() < 0.0F || zeros < kFewZeros || zeros > kMostZeros) return 0.0;
  const double middle = 0.5 * (1.0 + zeros);
  const double value = static_cast<double>(numbers[static_cast<std::size_t>(middle * n)]);
  // Where the normal distribution reaches a share.
  const auto reaches = [](double share) {
    return share < 0.5 ? -two_sided_normal_quantile(2.0 * share)
                       : two_sided_normal_quantile(2.0 * (1.0 - share));
  };
  return value / (reaches(middle) - reaches(zeros));
}

}  // namespace maquette::diagnosis::detail
