// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file scene_cover.hpp
/// A spacecraft as its own file paints it.

#include <deque>
#include <filesystem>
#include <memory>
#include <vector>

#include "camera/mesh_cover.hpp"
#include "core/result.hpp"
#include "core/run_context.hpp"
#include "core/tri_mesh.hpp"
#include "tools/scene_parts.hpp"

namespace maquette::tools {

struct CoveredMesh {
  TriMesh mesh;
  std::shared_ptr<const camera::MeshCover> cover;
  std::vector<std::filesystem::path> files;  ///< that it names beside its own
};

/// Materials of the file become laws: metal GGX with the base colour for its reflectance at normal
/// incidence, all else Lambert. One of the scene's that has the same name takes the place of the
/// file's, under its picture. Pictures of 8 bits are sRGB, others linear.
/// @return meshing::read_painted_mesh's codes; CAMERA_IMAGE_*, CAMERA_MATERIAL_OUT_OF_RANGE
[[nodiscard]] Result<CoveredMesh> load_covered_mesh(const std::filesystem::path& path,
                                                    const std::deque<SceneMaterial>& materials,
                                                    const RunContext& run);

}  // namespace maquette::tools
