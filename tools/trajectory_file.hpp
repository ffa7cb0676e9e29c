// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file trajectory_file.hpp
/// Poses of a camera over time: CSV with the head time_s,x_mm,y_mm,z_mm,qw,qx,qy,qz, one row a
/// picture; the quaternion is model_from_camera (looks along -z, y up), of length 1 to 1e-3.

#include <filesystem>
#include <string>
#include <vector>

#include "core/result.hpp"
#include "core/vec.hpp"

namespace maquette::tools {

inline constexpr ErrorCode kTrajectoryFile{"TOOLS_TRAJECTORY_FILE"};

struct TimedPose {
  double time_s = 0.0;
  RigidTransform model_from_camera;
};
/// CORE_FILE_*; TOOLS_TRAJECTORY_FILE with the line: head, numbers, a time that does not come after
/// the one before, a quaternion that is none, no row.
[[nodiscard]] Result<std::vector<TimedPose>> read_trajectory(const std::filesystem::path& path);

}  // namespace maquette::tools
