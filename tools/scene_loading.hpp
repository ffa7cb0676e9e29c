// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file scene_loading.hpp
/// What a scene file names, read and ready to be rendered.

#include <deque>
#include <filesystem>
#include <memory>
#include <vector>

#include "camera/render.hpp"
#include "core/result.hpp"
#include "core/run_context.hpp"
#include "core/tri_mesh.hpp"
#include "heightmap/height_field.hpp"
#include "tools/scene_file.hpp"

namespace maquette::tools {

/// Everything that a scene points at, kept alive, and the scene made of it.
struct LoadedScene {
  heightmap::ModelField field;
  std::deque<TriMesh> meshes;
  std::vector<camera::SceneObject> objects;
  camera::Lighting lighting;
  camera::Bands white_radiance{};  ///< W m^-2 sr^-1 of 1.0; 0: not known
  std::size_t triangles = 0;
  std::vector<std::filesystem::path> files;  ///< that meshes name: materials and pictures
};
/// TOOLS_CONFIG_INVALID (a material that is not described, a quaternion, a list of bands), what
/// readers of its files return.
[[nodiscard]] Result<std::unique_ptr<LoadedScene>> load_scene(const Scene& scene,
                                                              const RunContext& run);

[[nodiscard]] camera::CameraModel camera_of(const Scene& scene);
/// Of each [[pose]]. TOOLS_CONFIG_INVALID: a quaternion that is none
[[nodiscard]] Result<std::vector<RigidTransform>> poses_of(const Scene& scene);
/// Of the one picture, without a trajectory.
[[nodiscard]] RigidTransform pose_of(const Scene& scene);
/// TOOLS_CONFIG_INVALID: white balance
[[nodiscard]] Result<camera::RenderOptions> render_options_of(const Scene& scene);

}  // namespace maquette::tools
