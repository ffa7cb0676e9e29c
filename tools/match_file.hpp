// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file match_file.hpp
/// What `match` takes: a scene, photographs of it, what is searched (docs/camera.md); and scene
/// files with what was found in its place.

#include <deque>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "core/result.hpp"
#include "core/vec.hpp"

namespace maquette::tools {

struct MatchFilePhoto {
  std::filesystem::path image;
  Vec3 camera_position_mm{NAN, NAN, NAN};  ///< NaN: the scene's
  Quaternion camera_quaternion_wxyz{1, 0, 0, 0};
  Vec3 camera_target_mm{NAN, NAN, NAN};  ///< instead of the quaternion
  double exposure_scale = 0.0;           ///< 0: the scene's
  bool held_out = false;
};
struct MatchFile {
  std::string schema_name;
  std::filesystem::path scene;
  std::vector<std::string> search;
  std::int64_t finest_px = 1024;
  std::deque<MatchFilePhoto> photos;
};
/// TOOLS_CONFIG_*, CORE_FILE_*; TOOLS_CONFIG_INVALID, too: no photograph, or all held out; two of
/// one name; exposure beside exposure_each.
[[nodiscard]] Result<MatchFile> read_match(const std::filesystem::path& path);

/// The scene file with other values, its paths as they are from `to`'s folder. Of keys that mean
/// the same the old ones go.
struct SceneChanges {
  std::vector<std::pair<std::string, std::vector<double>>> lists;
  std::vector<std::pair<std::string, double>> numbers;
  std::vector<std::string> without;
};
[[nodiscard]] Result<void> write_changed_scene(const std::filesystem::path& scene,
                                               const SceneChanges& changes,
                                               const std::filesystem::path& to);

}  // namespace maquette::tools
