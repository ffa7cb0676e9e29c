// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/detail/thin_lens.hpp"

#include <cmath>
#include <numbers>

namespace maquette::camera::detail {

ThinLens::ThinLens(const CameraModel& camera, const RigidTransform& pose, double focus_mm)
    : middle_mm_(pose.translation_mm),
      right_(pose.direction({1.0, 0.0, 0.0})),
      down_(pose.direction({0.0, -1.0, 0.0})),
      ahead_(pose.direction({0.0, 0.0, -1.0})),
      focus_mm_(focus_mm),
      blades_(camera.lens.blades),
      turn_rad_(camera.lens.rotation_deg * std::numbers::pi / 180.0) {
  const double f = camera.focal_length_mm;
  const double widened = std::isinf(focus_mm) ? 1.0 : focus_mm / (focus_mm - f);
  radius_mm_ = 0.5 * f / camera.lens.f_number * widened;
}

Vec3 ThinLens::place(DiscPoint p) const {
  double x = p.x, y = p.y;
  if (blades_ >= 3) {
    // The disc's wedges become the polygon's triangles: at a share of the way between two corners,
    // the root of an even number from the middle.
    const double wedge = 2.0 * std::numbers::pi / blades_;
    const double corner = std::sqrt(wedge / std::sin(wedge));  // the polygon has the disc's area
    const double from = std::atan2(y, x) + std::numbers::pi, radius = std::hypot(x, y) * corner;
    const double side = std::fmin(std::floor(from / wedge), blades_ - 1.0);
    const double share = from / wedge - side;
    // Sides' middles lie at the rotation and every wedge from there, corners between them: so lies
    // the picture of what is behind the focus; that of what is before it stands on its head.
    const double first = turn_rad_ + (side - 0.5) * wedge;
    x = radius * ((1.0 - share) * std::cos(first) + share * std::cos(first + wedge));
    y = radius * ((1.0 - share) * std::sin(first) + share * std::sin(first + wedge));
  }
  return middle_mm_ + radius_mm_ * x * right_ + radius_mm_ * y * down_;
}

RayScene::Ray ThinLens::through(DiscPoint p, Vec3 direction) const {
  const Vec3 from = place(p);
  if (std::isinf(focus_mm_)) return {from, direction};
  const Vec3 in_focus = middle_mm_ + focus_mm_ / dot(direction, ahead_) * direction;
  return {from, normalized(in_focus - from)};
}

}  // namespace maquette::camera::detail
