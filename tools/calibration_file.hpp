// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file calibration_file.hpp
/// What `calibrate` takes (docs/camera.md): a TOML file that names frames and target points, and
/// the CSV of these points.

#include <deque>
#include <filesystem>
#include <string>
#include <vector>

#include "camera/target_calibration.hpp"
#include "core/result.hpp"

namespace maquette::tools {

inline constexpr ErrorCode kTargetFile{"TOOLS_TARGET_FILE"};

/// Raw frames of one light and one exposure time.
struct FrameFiles {
  std::vector<std::filesystem::path> images;
  double exposure_s = 0.01;
};

struct CalibrationFile {
  std::string schema_name = "maquette.calibration/1", name, camera = "nikon_d700_55deg";
  std::vector<std::string> set;
  double white_dn = 0.0, temperature_c = NAN;
  std::deque<FrameFiles> dark, bright, flat;
  std::filesystem::path points;
  std::string distortion = "brown_conrady";
  std::int64_t coefficients = 5;
  bool principal_point = true, aspect = false, skew = false;
  std::string vignetting_law = "polynomial";
  double cosine_power = 4.0;
};
/// @return TOOLS_CONFIG_*, CORE_FILE_*
[[nodiscard]] Result<CalibrationFile> read_calibration(const std::filesystem::path& path);

struct TargetTable {
  std::vector<camera::TargetPoint> points;
  std::vector<int> lines;           ///< of the file, of each point
  std::vector<std::string> images;  ///< names of the views
};
/// CSV with the head X_mm,Y_mm,Z_mm,u_px,v_px,image.
/// @return CORE_FILE_*; TOOLS_TARGET_FILE with the line: head, numbers, no name, no row
[[nodiscard]] Result<TargetTable> read_targets(const std::filesystem::path& path);

}  // namespace maquette::tools
