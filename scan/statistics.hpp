// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file statistics.hpp
/// Statistics of signed deviations.

#include <cstdint>
#include <span>
#include <vector>

#include "scan/deviate.hpp"

namespace maquette::scan {

/// All of DeviationStatistics but coverage; NaN counts as off the part. Moments are
/// summed in double in chunks of fixed size that are joined in order (Chan, Golub,
/// LeVeque 1983, doi:10.1080/00031305.1983.10483115), so the bits do not depend on
/// threads. sigma is the sample standard deviation (n - 1). A quantile q is linear
/// between order statistics (q (n - 1), "type 7"); nmad is 1.4826 times the median of
/// |d - median|. Without a single finite value everything but the counts is NaN.
/// @param sorted  where given, receives the finite values in ascending order
[[nodiscard]] DeviationStatistics summarize(std::span<const float> deviations_mm,
                                            std::vector<float>* sorted = nullptr);

/// Quantile of |d - centre| from values in ascending order, O(log n), nothing copied.
/// @pre ascending is not empty, 0 <= q <= 1
[[nodiscard]] double absolute_quantile(std::span<const float> ascending, double centre, double q);

/// 1, 2 or 5 times a power of ten, the least that is not below `value` (> 0).
[[nodiscard]] double round_up_125(double value);

/// 101 bins over +- limit, the middle one about zero; beyond counts in the outermost.
[[nodiscard]] std::vector<std::uint64_t> histogram_101(std::span<const float> values,
                                                       double limit_mm);

}  // namespace maquette::scan
