// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file camera_file.hpp
/// A camera by name (assets/cameras) or as a TOML file with documented keys: lens, sensor, and the
/// effects in the order in which they stand (docs/camera.md).

#include <filesystem>
#include <string>
#include <vector>

#include "camera/stack.hpp"
#include "core/result.hpp"

namespace maquette::tools {

struct CameraFile {
  std::string name;
  camera::Shot shot;
  camera::Stack stack;
};

[[nodiscard]] std::vector<std::string> camera_names();

/// @param overrides  "key=value" as `--set` gives them
/// @return TOOLS_UNKNOWN_NAME, TOOLS_CONFIG_SYNTAX, TOOLS_CONFIG_INVALID, CAMERA_STACK_ORDER,
///         CAMERA_INTRINSICS, CAMERA_EFFECT_OUT_OF_RANGE, CORE_FILE_*, CAMERA_IMAGE_* (dark frames)
[[nodiscard]] Result<CameraFile> read_camera(const std::string& name_or_path,
                                             const std::vector<std::string>& overrides = {});

/// A camera whose file is not written yet. @param place  what messages call it
/// @return as read_camera()
[[nodiscard]] Result<CameraFile> read_camera_text(const std::string& text,
                                                  const std::string& place);

/// The commented file of a camera, every key with its value; dark frames by their absolute paths.
[[nodiscard]] Result<std::string> camera_file_text(const std::string& name_or_path,
                                                   const std::vector<std::string>& overrides = {});

}  // namespace maquette::tools
