// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/path_filter.hpp"

#include <algorithm>
#include <cmath>

#include "core/check.hpp"

namespace maquette::cnc {
namespace {

/// A cutter location in double is this exact (cutter_location.hpp).
constexpr double kExactness_mm = 1e-9;

std::int64_t nearest_tick(double mm) {
  return std::llround(mm * 10000.0);
}

}  // namespace

double filter_path(const std::vector<PathSample>& samples, double tolerance_mm,
                   std::vector<PathVertex>& vertices) {
  MAQUETTE_CHECK(samples.size() >= 2, "{} samples", samples.size());
  vertices.clear();
  vertices.push_back({samples.front().tick, nearest_tick(samples.front().tip_mm)});
  const std::size_t last = samples.size() - 1;
  // Half a tick of rounding at both ends of a move is at most half a tick in between.
  const double budget = tolerance_mm - 0.5 * kTick_mm - kExactness_mm;
  const double least = 0.05 * tolerance_mm;
  double deepest = 0.0;
  std::size_t from = 0;
  while (from < last) {
    const double t0 = mm_of_ticks(vertices.back().along), z0 = mm_of_ticks(vertices.back().z);
    double low = -INFINITY, high = INFINITY;
    std::size_t end = from + 1;
    double low_end = 0.0, high_end = 0.0;
    for (std::size_t k = from + 1; k <= last; ++k) {
      const PathSample& s = samples[k];
      const PathSample& before = samples[k - 1];
      const double run = mm_of_ticks(s.tick) - t0;
      // An end of the line is not free: the next line starts there.
      const bool fixed = k == last;
      const double below = fixed ? 0.0 : budget - std::max(before.gouge_mm, s.gouge_mm);
      const double above =
          fixed ? 0.0 : std::max(least, budget - std::max(before.dip_mm, s.dip_mm));
      low = std::max(low, (s.tip_mm - below - z0) / run);
      high = std::min(high, (s.tip_mm + above - z0) / run);
      if (low > high) break;
      end = k;
      low_end = low;
      high_end = high;
    }
    const PathSample& s = samples[end];
    const double run = mm_of_ticks(s.tick) - t0;
    const std::int64_t z =
        end == last ? nearest_tick(s.tip_mm)
                    : nearest_tick(std::clamp(s.tip_mm, z0 + low_end * run, z0 + high_end * run));
    vertices.push_back({s.tick, z});

    const double slope = (mm_of_ticks(z) - z0) / run;
    double below_before = std::max(0.0, samples[from].tip_mm - z0);
    for (std::size_t k = from + 1; k <= end; ++k) {
      const double path = z0 + slope * (mm_of_ticks(samples[k].tick) - t0);
      const double below = samples[k].tip_mm - path;
      deepest = std::max(deepest, std::max(below_before, below) + samples[k - 1].gouge_mm);
      below_before = below;
    }
    from = end;
  }
  return deepest + kExactness_mm;
}

}  // namespace maquette::cnc
