// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/trajectory_motion.hpp"

#include <algorithm>
#include <cmath>

namespace maquette::tools {
namespace {

/// The rotation vector of `q`, radians, of at most half a round.
Vec3 rotation_vector(Quaternion q) {
  if (q.w < 0.0) q = {-q.w, -q.x, -q.y, -q.z};
  const Vec3 axis{q.x, q.y, q.z};
  const double sine = norm(axis);
  constexpr double kTiny = 1e-12;  // below it the sine is the angle
  const double factor = sine < kTiny ? 2.0 : 2.0 * std::atan2(sine, q.w) / sine;
  return factor * axis;
}

/// Mean rates from one pose to the next: in the model's frame, and about the camera's axes.
struct Step {
  double time_s = 0.0;
  Vec3 velocity_mm_s, angular_rate_rad_s;
};
Step step_between(const TimedPose& a, const TimedPose& b) {
  const double time = b.time_s - a.time_s;
  const RigidTransform &from = a.model_from_camera, &to = b.model_from_camera;
  return {time, (1.0 / time) * (to.translation_mm - from.translation_mm),
          (1.0 / time) * rotation_vector(from.rotation.conjugate() * to.rotation)};
}

}  // namespace

std::vector<CameraMotion> motions_of(const std::vector<TimedPose>& poses) {
  std::vector<CameraMotion> motions(poses.size());
  if (poses.size() < 2) return motions;
  std::vector<Step> steps;
  for (std::size_t i = 0; i + 1 < poses.size(); ++i)
    steps.push_back(step_between(poses[i], poses[i + 1]));
  for (std::size_t i = 0; i < poses.size(); ++i) {
    // Rates belong to the middles of the steps; linear between and beyond the nearest two.
    const std::size_t first =
        std::min(i == 0 ? 0 : i - 1, steps.size() >= 2 ? steps.size() - 2 : 0);
    const Step &a = steps[first], &b = steps[std::min(first + 1, steps.size() - 1)];
    const double middle_a = poses[first].time_s + 0.5 * a.time_s;
    const double apart = 0.5 * (a.time_s + b.time_s);
    const double share = steps.size() < 2 ? 0.0 : (poses[i].time_s - middle_a) / apart;
    const auto mix = [&](Vec3 u, Vec3 v) { return (1.0 - share) * u + share * v; };
    motions[i] = {rotate(poses[i].model_from_camera.rotation.conjugate(),
                         mix(a.velocity_mm_s, b.velocity_mm_s)),
                  mix(a.angular_rate_rad_s, b.angular_rate_rad_s)};
  }
  return motions;
}

}  // namespace maquette::tools
