// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/fit_axis.hpp"

#include <cmath>

#include <fmt/format.h>

namespace maquette::scan {

Result<AxisFit> fit_axis(std::span<const AxisStop> stops) {
  const auto n = static_cast<double>(stops.size());
  if (stops.size() < 3)
    return fail(kAxis, fmt::format("{} stops of an axis, at least three are needed", stops.size()));
  double mean = 0.0;
  Vec3 middle;
  for (const AxisStop& s : stops) {
    if (!std::isfinite(s.position_mm + s.at_mm.x + s.at_mm.y + s.at_mm.z))
      return fail(kAxis, "a stop of an axis has a value that is not a number");
    mean += s.position_mm / n;
    middle += (1.0 / n) * s.at_mm;
  }
  double square = 0.0;
  Vec3 moment;
  for (const AxisStop& s : stops) {
    square += (s.position_mm - mean) * (s.position_mm - mean);
    moment += (s.position_mm - mean) * (s.at_mm - middle);
  }
  if (!(square > 0.0 && norm(moment) > 0.0))
    return fail(kAxis, "all stops of an axis are at one position");
  const Vec3 slope = (1.0 / square) * moment;
  AxisFit f;
  f.scale = norm(slope);
  f.direction = (1.0 / f.scale) * slope;
  f.origin_mm = middle - mean * slope;
  double residuals = 0.0;
  for (const AxisStop& s : stops) {
    const Vec3 off = s.at_mm - (f.origin_mm + s.position_mm * slope);
    residuals += dot(off, off);
    f.straightness_mm =
        std::fmax(f.straightness_mm, norm(off - dot(off, f.direction) * f.direction));
  }
  const double variance = residuals / (3.0 * n - 6.0);
  f.rms_mm = std::sqrt(variance);
  const double of_origin = std::sqrt(variance * (1.0 / n + mean * mean / square));
  f.sigma_origin_mm = {of_origin, of_origin, of_origin};
  f.sigma_scale = std::sqrt(variance / square);
  f.sigma_direction_rad = f.sigma_scale / f.scale;
  return f;
}

}  // namespace maquette::scan
