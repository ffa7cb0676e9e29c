// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/statistics.hpp"

#include <algorithm>
#include <bit>
#include <cmath>

#include <oneapi/tbb/parallel_for.h>

namespace maquette::scan {
namespace {

constexpr std::size_t kChunk = std::size_t{1} << 16;

struct Moments {
  double n = 0.0, mean = 0.0, m2 = 0.0;  // m2: sum of squared distances from the mean
  double min = INFINITY, max = -INFINITY;
};

Moments of_chunk(std::span<const float> values) {
  Moments m;
  double sum = 0.0;
  for (const float v : values) {
    if (std::isnan(v)) continue;
    const auto d = static_cast<double>(v);
    m.n += 1.0;
    sum += d;
    m.min = std::fmin(m.min, d);
    m.max = std::fmax(m.max, d);
  }
  if (m.n == 0.0) return m;
  m.mean = sum / m.n;
  for (const float v : values)
    if (!std::isnan(v))
      m.m2 += (static_cast<double>(v) - m.mean) * (static_cast<double>(v) - m.mean);
  return m;
}

Moments join(const Moments& a, const Moments& b) {
  if (a.n == 0.0) return b;
  if (b.n == 0.0) return a;
  Moments m;
  m.n = a.n + b.n;
  const double step = b.mean - a.mean;
  m.mean = a.mean + step * (b.n / m.n);
  m.m2 = a.m2 + b.m2 + step * step * (a.n * b.n / m.n);
  m.min = std::fmin(a.min, b.min);
  m.max = std::fmax(a.max, b.max);
  return m;
}

/// Ascending, by three passes of 11 bits over the order-preserving pattern of floats (Herf 2001): a
/// fifth of the time of comparing. Not NaN.
void sort_floats(std::vector<float>& values) {
  constexpr std::uint32_t kDigits = 1U << 11;
  std::vector<std::uint32_t> keys(values.size()), next(values.size());
  for (std::size_t i = 0; i < values.size(); ++i) {
    const auto bits = std::bit_cast<std::uint32_t>(values[i]);
    keys[i] = (bits >> 31) != 0 ? ~bits : bits | 0x80000000U;
  }
  for (const unsigned shift : {0U, 11U, 22U}) {
    std::vector<std::size_t> start(kDigits + 1, 0);
    for (const std::uint32_t k : keys) ++start[((k >> shift) & (kDigits - 1)) + 1];
    for (std::uint32_t d = 0; d < kDigits; ++d) start[d + 1] += start[d];
    for (const std::uint32_t k : keys) next[start[(k >> shift) & (kDigits - 1)]++] = k;
    keys.swap(next);
  }
  for (std::size_t i = 0; i < values.size(); ++i) {
    const std::uint32_t k = keys[i];
    values[i] = std::bit_cast<float>((k >> 31) != 0 ? k & 0x7fffffffU : ~k);
  }
}

double quantile(std::span<const float> ascending, double q) {
  const double at = q * static_cast<double>(ascending.size() - 1);
  const auto i = static_cast<std::size_t>(at);
  const auto low = static_cast<double>(ascending[i]);
  if (i + 1 >= ascending.size()) return low;
  return low + (at - static_cast<double>(i)) * (static_cast<double>(ascending[i + 1]) - low);
}

}  // namespace

double absolute_quantile(std::span<const float> ascending, double centre, double q) {
  const double at = q * static_cast<double>(ascending.size() - 1);
  const auto wanted = static_cast<std::size_t>(at);
  const auto middle = static_cast<std::size_t>(
      std::lower_bound(ascending.begin(), ascending.end(), centre,
                       [](float v, double c) { return static_cast<double>(v) < c; }) -
      ascending.begin());
  // Distances grow from the middle to the left and to the right: two ascending lists, whose joint
  // order is found by halving how many of the first n come from the left.
  const std::size_t lefts = middle, rights = ascending.size() - middle;
  const auto left = [&](std::size_t i) {
    return centre - static_cast<double>(ascending[middle - 1 - i]);
  };
  const auto right = [&](std::size_t i) {
    return static_cast<double>(ascending[middle + i]) - centre;
  };
  const auto ranked = [&](std::size_t rank) {  // 0 is the least distance
    std::size_t least = rank + 1 > rights ? rank + 1 - rights : 0;
    std::size_t most = std::min(rank + 1, lefts);
    while (least < most) {
      const std::size_t i = (least + most) / 2;
      if (left(i) < right(rank - i))
        least = i + 1;
      else
        most = i;
    }
    const double last_left = least > 0 ? left(least - 1) : -INFINITY;
    const double last_right = least <= rank ? right(rank - least) : -INFINITY;
    return std::fmax(last_left, last_right);
  };
  const double value = ranked(wanted);
  if (wanted + 1 >= ascending.size()) return value;
  return value + (at - static_cast<double>(wanted)) * (ranked(wanted + 1) - value);
}

DeviationStatistics summarize(std::span<const float> deviations, std::vector<float>* sorted) {
  const std::size_t chunks = (deviations.size() + kChunk - 1) / kChunk;
  std::vector<Moments> parts(chunks);
  oneapi::tbb::parallel_for(std::size_t{0}, chunks, [&](std::size_t i) {
    parts[i] =
        of_chunk(deviations.subspan(i * kChunk, std::min(kChunk, deviations.size() - i * kChunk)));
  });
  Moments m;
  for (const Moments& part : parts) m = join(m, part);

  DeviationStatistics s;
  s.points = static_cast<std::uint64_t>(m.n);
  s.off_part = deviations.size() - s.points;
  std::vector<float> own;
  std::vector<float>& ascending = sorted != nullptr ? *sorted : own;
  ascending.clear();
  if (s.points == 0) {
    s.mean_mm = s.rms_mm = s.sigma_mm = s.median_mm = s.nmad_mm = NAN;
    s.p05_mm = s.p95_mm = s.abs_p95_mm = s.min_mm = s.max_mm = NAN;
    return s;
  }
  s.mean_mm = m.mean;
  s.rms_mm = std::sqrt(m.mean * m.mean + m.m2 / m.n);
  s.sigma_mm = m.n > 1.0 ? std::sqrt(m.m2 / (m.n - 1.0)) : 0.0;
  s.min_mm = m.min;
  s.max_mm = m.max;

  ascending.reserve(s.points);
  for (const float v : deviations)
    if (!std::isnan(v)) ascending.push_back(v);
  sort_floats(ascending);
  s.median_mm = quantile(ascending, 0.5);
  s.p05_mm = quantile(ascending, 0.05);
  s.p95_mm = quantile(ascending, 0.95);
  s.nmad_mm = 1.4826 * absolute_quantile(ascending, s.median_mm, 0.5);
  s.abs_p95_mm = absolute_quantile(ascending, 0.0, 0.95);
  return s;
}

double round_up_125(double value) {
  double power = std::pow(10.0, std::floor(std::log10(value)));
  for (const double step : {1.0, 2.0, 5.0})
    if (step * power >= value) return step * power;
  return 10.0 * power;
}

std::vector<std::uint64_t> histogram_101(std::span<const float> values, double limit_mm) {
  std::vector<std::uint64_t> bins(101, 0);
  for (const float v : values) {
    if (std::isnan(v)) continue;
    const double at = (static_cast<double>(v) / limit_mm + 1.0) * 0.5 * 101.0;
    ++bins[static_cast<std::size_t>(std::clamp(at, 0.0, 100.0))];
  }
  return bins;
}

}  // namespace maquette::scan
