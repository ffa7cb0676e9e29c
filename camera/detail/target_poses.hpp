// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file target_poses.hpp
/// Where a camera stood, to start with: from points of one picture, without distortion.

#include <optional>
#include <string>
#include <vector>

#include "camera/effects/frame.hpp"
#include "core/result.hpp"
#include "core/vec.hpp"

namespace maquette::camera::detail {

/// How the points of one picture lie.
enum class Spread { line, plane, space };
[[nodiscard]] Spread spread_of(const std::vector<Vec3>& points_mm);

/// camera_from_target (z forward). @param tangents  of the points' places in the picture
/// @pre at least four points in a plane, or six in space
[[nodiscard]] std::optional<RigidTransform> pose_of(const std::vector<Vec3>& points_mm,
                                                    const std::vector<Vec2>& tangents,
                                                    Spread spread);

}  // namespace maquette::camera::detail
