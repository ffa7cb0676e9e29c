// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/phase_range.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/check.hpp"

namespace maquette::scan {

PhaseRange phase_range(std::span<const BeamReturn> returns,
                       std::span<const double> unambiguous_mm) {
  MAQUETTE_CHECK(!returns.empty() && !unambiguous_mm.empty(), "{} returns, {} wavelengths",
                 returns.size(), unambiguous_mm.size());
  double nearest = INFINITY, farthest = 0.0, sum = 0.0, moment = 0.0;
  for (const BeamReturn& r : returns) {
    nearest = std::min(nearest, r.range_mm);
    farthest = std::max(farthest, r.range_mm);
    sum += r.amplitude;
    moment += r.amplitude * (r.range_mm - returns.front().range_mm);
  }
  if (!(sum > 0.0)) return {nearest, 0.0};
  const double coarsest = unambiguous_mm.front(), finest = unambiguous_mm.back();
  if (farthest - nearest < finest / 200.0) {
    const double range = returns.front().range_mm + moment / sum;
    return {range < coarsest ? range : range - coarsest * std::floor(range / coarsest), sum};
  }
  double range = 0.0, amplitude = 0.0;
  for (std::size_t k = 0; k < unambiguous_mm.size(); ++k) {
    const double interval = unambiguous_mm[k];
    double re = 0.0, im = 0.0;
    for (const BeamReturn& r : returns) {
      const double turns = r.range_mm / interval;
      const double phase = 2.0 * std::numbers::pi * (turns - std::floor(turns));
      re += r.amplitude * std::cos(phase);
      im += r.amplitude * std::sin(phase);
    }
    amplitude = std::hypot(re, im);
    const double turns = std::atan2(im, re) / (2.0 * std::numbers::pi);
    const double within = interval * (turns < 0.0 ? turns + 1.0 : turns);
    range = k == 0 ? within : within + interval * std::round((range - within) / interval);
  }
  return {range, amplitude};
}

}  // namespace maquette::scan
