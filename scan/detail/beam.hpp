// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file beam.hpp
/// The rays of a Gaussian beam, and the angles at which a scanner's beam looks.

#include <cstdint>
#include <vector>

#include "core/vec.hpp"
#include "heightmap/field_tracer.hpp"
#include "scan/scanner_sim.hpp"

namespace maquette::scan::detail {

/// Places in the plane across the beam, in units of its 1/e^2 radius, and shares of its energy.
struct BeamSample {
  double x = 0.0, y = 0.0, weight = 1.0;
};

/// Shares sum to 1, means are 0, second moments 1/4 each (those of exp(-2 r^2)).
[[nodiscard]] std::vector<BeamSample> beam_samples(int count);

using Ray = heightmap::FieldTracer::Ray;

/// One ray of a beam with its waist at `origin` and full angle `divergence_rad`, turned about
/// `axis` (unit) by an angle given as cosine and sine.
[[nodiscard]] Ray skew_ray(Vec3 origin_mm, Vec3 axis, double waist_radius_mm, double divergence_rad,
                           const BeamSample& sample, double cos_turn, double sin_turn);

[[nodiscard]] inline double beam_radius_mm(double waist_radius_mm, double divergence_rad,
                                           double range_mm) {
  return std::hypot(waist_radius_mm, 0.5 * divergence_rad * range_mm);
}

/// Azimuth and zenith angles that can reach a box, radians.
struct AngularWindow {
  double azimuth_min = 0.0, azimuth_max = 0.0;
  double zenith_min = 0.0, zenith_max = 0.0;
};
[[nodiscard]] AngularWindow window_of(const Box3& box, Vec3 station);

/// The grid of directions; whole steps from azimuth 0 and the zenith.
struct DirectionGrid {
  double step_rad = 0.0;
  std::int64_t first_column = 0, columns = 0;
  std::int64_t first_row = 0, rows = 0;
  [[nodiscard]] double azimuth(std::int64_t column) const {
    return step_rad * static_cast<double>(first_column + column);
  }
  [[nodiscard]] double zenith(std::int64_t row) const {
    return step_rad * static_cast<double>(first_row + row);
  }
};
[[nodiscard]] DirectionGrid grid_over(const AngularWindow& window, double step_rad,
                                      double largest_zenith_rad);

[[nodiscard]] inline Vec3 direction_of(double azimuth, double zenith) {
  const double s = std::sin(zenith);
  return {s * std::cos(azimuth), s * std::sin(azimuth), std::cos(zenith)};
}

/// Where the beam looks when the circles show azimuth and zenith angle, without noise.
struct Angles {
  double azimuth = 0.0, zenith = 0.0;
};
[[nodiscard]] Angles true_angles(const AngularErrors& errors, bool second_face, double azimuth,
                                 double zenith);

}  // namespace maquette::scan::detail
