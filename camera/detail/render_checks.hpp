// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file render_checks.hpp
/// What render refuses before it starts.

#include "camera/detail/thin_lens.hpp"
#include "camera/lamp.hpp"
#include "camera/ray_scene.hpp"
#include "camera/render.hpp"

namespace maquette::camera::detail {

[[nodiscard]] Result<void> check_camera(const CameraModel& camera, const RigidTransform& pose);
[[nodiscard]] Result<void> check_options(const RenderOptions& options);
[[nodiscard]] Result<void> check_lighting(const Lighting& lighting);
/// The camera is where a camera can be: outside every solid and not under one that
/// has no ground below it (a lander's deck overhead is fine).
[[nodiscard]] Result<void> check_above_ground(const RayScene& scene, Vec3 eye);
[[nodiscard]] Result<void> check_lens_above_ground(const RayScene& scene, const ThinLens& lens);
[[nodiscard]] Result<void> check_lamp_in_the_open(const RayScene& scene, const Light& light);

}  // namespace maquette::camera::detail
