// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/lamp.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include <fmt/format.h>

#include "camera/render.hpp"
#include "core/check.hpp"
#include "core/units.hpp"

namespace maquette::camera {
namespace {

constexpr double kDegree = std::numbers::pi / 180.0;

bool finite(Vec3 v) {
  return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z);
}

}  // namespace

Light::Light(const Lamp& lamp)
    : centre_(lamp.position_mm),
      radius_(0.5 * lamp.lens_diameter_mm),
      table_(lamp.intensity),
      colour_(lamp.colour),
      sun_(lamp.sun_diameter_deg.has_value()) {
  const Vec3 to_target = lamp.target_mm - lamp.position_mm;
  target_distance_squared_ = dot(to_target, to_target);
  axis_ = normalized(to_target);
  // Azimuth 0 of a table is where the model's up is; a lamp that shines straight down takes north.
  Vec3 side = cross(axis_, Vec3{0.0, 0.0, 1.0});
  if (norm(side) < 1e-9) side = cross(axis_, Vec3{0.0, 1.0, 0.0});
  across_y_ = normalized(side);
  across_x_ = cross(across_y_, axis_);
  cos_half_beam_ = std::cos(0.5 * kDegree * lamp.beam_deg);
  if (table_) axis_intensity_ = table_->at(0.0, 0.0);
  if (sun_) radius_ = std::tan(0.5 * kDegree * *lamp.sun_diameter_deg);
}

Light::Arrival Light::arrive(Vec3 at_mm, DiscPoint p) const {
  if (sun_) {
    // A disc that is even in angle is even in its tangent to 1e-5 at half a degree.
    return {normalized(radius_ * (p.x * across_x_ + p.y * across_y_) - axis_),
            std::numeric_limits<double>::infinity(), 1.0};
  }
  const Vec3 way = point(p) - at_mm;
  const double squared = dot(way, way), distance = std::sqrt(squared);
  const Vec3 direction = (1.0 / distance) * way;
  const double cosine = -dot(direction, axis_);
  double strength = cosine >= cos_half_beam_ ? target_distance_squared_ / squared : 0.0;
  if (table_ && strength > 0.0) {
    const double angle = std::acos(std::clamp(cosine, -1.0, 1.0)) / kDegree;
    const double azimuth =
        table_->azimuth_deg.size() < 2
            ? 0.0  // the same all around
            : std::atan2(-dot(direction, across_y_), -dot(direction, across_x_)) / kDegree;
    strength *= table_->at(angle, azimuth) / axis_intensity_;
  }
  return {direction, distance, strength};
}

void Light::arrive(std::span<const Vec3> at_mm, std::span<const DiscPoint> p,
                   std::span<Arrival> to) const {
  MAQUETTE_CHECK(p.size() == at_mm.size() && to.size() == at_mm.size(),
                 "{} places, {} points of the lens, {} answers", at_mm.size(), p.size(), to.size());
  if (sun_ || table_) {
    for (std::size_t i = 0; i < to.size(); ++i) to[i] = arrive(at_mm[i], p[i]);
    return;
  }
  constexpr std::size_t kLanes = 16;
  std::array<double, kLanes> x, y, z, distance, strength;
  x.fill(1.0), y.fill(1.0), z.fill(1.0);
  for (std::size_t first = 0; first < to.size(); first += kLanes) {
    const std::size_t n = std::min(kLanes, to.size() - first);
    for (std::size_t i = 0; i < n; ++i) {
      const Vec3 way = point(p[first + i]) - at_mm[first + i];
      x[i] = way.x, y[i] = way.y, z[i] = way.z;
    }
    for (std::size_t i = 0; i < kLanes; ++i) {
      const double squared = x[i] * x[i] + y[i] * y[i] + z[i] * z[i];
      distance[i] = std::sqrt(squared);
      const double k = 1.0 / distance[i];
      x[i] = k * x[i], y[i] = k * y[i], z[i] = k * z[i];
      const double cosine = -(x[i] * axis_.x + y[i] * axis_.y + z[i] * axis_.z);
      const double even = target_distance_squared_ / squared;
      strength[i] = cosine >= cos_half_beam_ ? even : 0.0;
    }
    for (std::size_t i = 0; i < n; ++i)
      to[first + i] = {{x[i], y[i], z[i]}, distance[i], strength[i]};
  }
}

Result<void> check_lamp(const Lamp& lamp) {
  if (!finite(lamp.position_mm) || !finite(lamp.target_mm) || lamp.position_mm == lamp.target_mm)
    return fail(kCameraOutOfRange,
                "the lamp's position and target must be finite and differ from each other");
  if (!(lamp.lens_diameter_mm >= 0.0) || !std::isfinite(lamp.lens_diameter_mm))
    return fail(kCameraOutOfRange,
                fmt::format("lens diameter {} mm: 0 or more expected", lamp.lens_diameter_mm));
  if (!(lamp.beam_deg > 0.0 && lamp.beam_deg <= 360.0))
    return fail(
        kCameraOutOfRange,
        fmt::format("beam of {} degrees: a full angle in (0, 360] expected", lamp.beam_deg));
  if (lamp.sun_diameter_deg && !(*lamp.sun_diameter_deg >= 0.0 && *lamp.sun_diameter_deg <= 60.0))
    return fail(
        kCameraOutOfRange,
        fmt::format("a sun of {} degrees: a diameter of 0 to 60 expected", *lamp.sun_diameter_deg));
  for (const double c : lamp.colour)
    if (!(c >= 0.0) || !std::isfinite(c))
      return fail(kCameraOutOfRange,
                  fmt::format("the lamp's irradiance in a band is {}; 0 or more expected", c));
  if (lamp.intensity && !(lamp.intensity->at(0.0, 0.0) > 0.0))
    return fail(kCameraOutOfRange, "the lamp's intensity on its axis is 0: nothing to scale by");
  return {};
}

}  // namespace maquette::camera
