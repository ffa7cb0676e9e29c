// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file trajectory_motion.hpp
/// How a camera moves at each pose of its trajectory, from the poses beside it: the derivative of
/// the parabola through three of them, of two the difference, of one none. Rotations by the vector
/// that turns one pose into the next. Exact where velocity changes linearly with time and the
/// camera turns about one axis with a rate that does; else as coarse as the steps squared. Turns of
/// half a round and more between two poses cannot be told from the shorter way round.

#include <vector>

#include "core/vec.hpp"
#include "tools/trajectory_file.hpp"

namespace maquette::tools {

/// In the camera's own frame (x right, y up, z backwards), as camera/effects/motion.hpp takes it.
struct CameraMotion {
  Vec3 velocity_mm_s, angular_rate_rad_s;
};
/// One for each pose. @pre times ascend, quaternions are of length 1
[[nodiscard]] std::vector<CameraMotion> motions_of(const std::vector<TimedPose>& poses);

}  // namespace maquette::tools
