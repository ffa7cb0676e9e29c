// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/detail/beam.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace maquette::scan::detail {
namespace {

constexpr double kTurn = 2.0 * std::numbers::pi;

/// Equal shares at the medians of equal rings, a golden angle apart; brought to the mean and
/// the second moments of the beam (x and y are scaled apart: few points are not round).
std::vector<BeamSample> spiral(int count) {
  const double golden = std::numbers::pi * (3.0 - std::sqrt(5.0));
  std::vector<BeamSample> samples;
  double mx = 0.0, my = 0.0;
  for (int i = 0; i < count; ++i) {
    const double inside = (i + 0.5) / count;
    const double radius = std::sqrt(-0.5 * std::log1p(-inside));
    samples.push_back({radius * std::cos(golden * i), radius * std::sin(golden * i), 1.0 / count});
    mx += samples.back().x / count;
    my += samples.back().y / count;
  }
  double xx = 0.0, yy = 0.0;
  for (BeamSample& s : samples) {
    s.x -= mx;
    s.y -= my;
    xx += s.x * s.x / count;
    yy += s.y * s.y / count;
  }
  for (BeamSample& s : samples) {
    if (xx > 0.0) s.x *= 0.5 / std::sqrt(xx);
    if (yy > 0.0) s.y *= 0.5 / std::sqrt(yy);
  }
  return samples;
}

}  // namespace

std::vector<BeamSample> beam_samples(int count) {
  if (count == 1) return {BeamSample{}};
  if (count != 7) return spiral(count);
  // Stroud, Approximate Calculation of Multiple Integrals, 1971, E2r2 5-1: half in the middle, a
  // twelfth each at six places whose distance, sqrt 2 for exp(-r^2), is 1 for exp(-2 r^2).
  std::vector<BeamSample> samples{{0.0, 0.0, 0.5}};
  for (int k = 0; k < 6; ++k)
    samples.push_back({std::cos(kTurn * k / 6), std::sin(kTurn * k / 6), 1.0 / 12.0});
  return samples;
}

Ray skew_ray(Vec3 origin, Vec3 axis, double waist, double divergence, const BeamSample& sample,
             double cos_turn, double sin_turn) {
  const Vec3 aside = std::abs(axis.z) < 0.9 ? Vec3{0.0, 0.0, 1.0} : Vec3{1.0, 0.0, 0.0};
  const Vec3 u = normalized(cross(aside, axis)), v = cross(axis, u);
  const double x = cos_turn * sample.x - sin_turn * sample.y;
  const double y = sin_turn * sample.x + cos_turn * sample.y;
  // What a ray is displaced by at the waist and what it gains with range are perpendicular,
  // so that their squares add.
  return {origin + waist * (x * u + y * v), normalized(axis + 0.5 * divergence * (x * v - y * u))};
}

AngularWindow window_of(const Box3& box, Vec3 station) {
  const double x0 = box.min.x - station.x, x1 = box.max.x - station.x;
  const double y0 = box.min.y - station.y, y1 = box.max.y - station.y;
  const double z0 = box.min.z - station.z, z1 = box.max.z - station.z;
  AngularWindow w;
  const double near_x = std::fmax(0.0, std::fmax(x0, -x1));
  const double near_y = std::fmax(0.0, std::fmax(y0, -y1));
  const double nearest = std::hypot(near_x, near_y);
  const double farthest = std::hypot(std::fmax(-x0, x1), std::fmax(-y0, y1));
  if (nearest == 0.0) {  // above or below the box: all around
    w.azimuth_min = 0.0;
    w.azimuth_max = kTurn;
  } else {
    // Seen from outside a rectangle spans less than half a turn; measured from its middle
    // there is no jump in the angle.
    const double middle = std::atan2(y0 + y1, x0 + x1);
    w.azimuth_min = w.azimuth_max = middle;
    for (const double x : {x0, x1})
      for (const double y : {y0, y1}) {
        const double a = std::remainder(std::atan2(y, x) - middle, kTurn);
        w.azimuth_min = std::fmin(w.azimuth_min, middle + a);
        w.azimuth_max = std::fmax(w.azimuth_max, middle + a);
      }
  }
  // The zenith angle atan2(distance, height) is monotonic in each, so corners decide.
  w.zenith_min = std::fmin(std::atan2(nearest, z1), std::atan2(farthest, z1));
  w.zenith_max = std::fmax(std::atan2(nearest, z0), std::atan2(farthest, z0));
  return w;
}

DirectionGrid grid_over(const AngularWindow& w, double step, double largest_zenith) {
  DirectionGrid g;
  g.step_rad = step;
  const auto below = [&](double a) { return static_cast<std::int64_t>(std::floor(a / step)); };
  const auto above = [&](double a) { return static_cast<std::int64_t>(std::ceil(a / step)); };
  g.first_column = below(w.azimuth_min);
  g.columns = above(w.azimuth_max) - g.first_column + 1;
  // A full turn ends before it begins again.
  if (w.azimuth_max - w.azimuth_min >= kTurn)
    g.columns =
        std::max<std::int64_t>(1, static_cast<std::int64_t>(std::ceil(kTurn / step - 1e-9)));
  // Beyond the nadir the directions of the opposite azimuth would come again.
  g.first_row = below(w.zenith_min);
  g.rows = std::min(above(w.zenith_max), below(largest_zenith + 1e-9 * step)) - g.first_row + 1;
  return g;
}

Angles true_angles(const AngularErrors& e, bool second_face, double azimuth, double zenith) {
  const double h = second_face ? azimuth + std::numbers::pi : azimuth;
  const double v = second_face ? -zenith : zenith;
  // At the zenith and the nadir a turn about the vertical means nothing.
  double s = std::sin(v);
  if (std::abs(s) < 1e-6) s = std::copysign(1e-6, s);
  const double dh = (e.collimation_rad + e.trunnion_rad * std::cos(v)) / s +
                    e.eccentricity_h_rad * std::cos(h - e.eccentricity_h_phase_rad);
  const double dv =
      e.vertical_index_rad + e.eccentricity_v_rad * std::cos(v - e.eccentricity_v_phase_rad);
  return {azimuth + dh, second_face ? zenith - dv : zenith + dv};
}

}  // namespace maquette::scan::detail
