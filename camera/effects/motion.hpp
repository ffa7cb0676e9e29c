// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file motion.hpp
/// The camera moves while the picture is taken (Shot::velocity_mm_s, angular_rate_rad_s, in its own
/// frame: x right, y up, z backwards). Each place of the picture then moves, for camera coordinates
/// with y down and z forward, by
///
///     x' = -vx/Z + x vz/Z + x y wx - (1 + x^2) wy + y wz
///     y' = -vy/Z + y vz/Z + (1 + y^2) wx - x y wy - x wz
///
/// (Longuet-Higgins and Prazdny 1980, doi:10.1098/rspb.1980.0057), x and y tangents of the field
/// angle, Z depth along the axis. What a pixel sees at time t is taken from where the picture at
/// the middle of the exposure has it; behind edges of depth that is an approximation.

#include "camera/effects/frame.hpp"

namespace maquette::camera {

/// Mean over the exposure.
struct MotionBlur {
  static constexpr EffectInfo kInfo{
      "motion_blur", Signal::radiance, Signal::radiance,
      "the scene moves before the lens, while the shutter is open: whatever the lens does, it does "
      "to each moment's picture"};
};

/// Rows are read one after the other, the middle row at the middle of the exposure. Depth and lit
/// (nearest pixel) go with their rows.
struct RollingShutter {
  double row_s = 0.0;  ///< from one row to the next, downwards

  static constexpr EffectInfo kInfo{
      "rolling_shutter", Signal::radiance, Signal::radiance,
      "each row sees the scene at a time of its own, before the lens distorts what it sees"};
};

/// Pixels a second that the scene's picture moves at `px`. @param depth_mm  along the ray
[[nodiscard]] Vec2 image_motion(const Shot& shot, Vec2 px, double depth_mm);

[[nodiscard]] inline Result<void> check(const MotionBlur&, const Shot&) {
  return {};
}
[[nodiscard]] Result<void> check(const RollingShutter& e, const Shot& shot);
/// @return CAMERA_FRAME: the camera has a velocity and the frame no depth
[[nodiscard]] Result<void> apply(const MotionBlur& e, const Shot& shot, Frame& frame);
[[nodiscard]] Result<void> apply(const RollingShutter& e, const Shot& shot, Frame& frame);

}  // namespace maquette::camera
