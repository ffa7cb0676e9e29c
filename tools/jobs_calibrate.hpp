// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file jobs_calibrate.hpp
/// What `calibrate` does: a camera file from frames and target points.

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "camera/photon_transfer.hpp"
#include "camera/target_calibration.hpp"
#include "camera/vignetting_fit.hpp"
#include "core/result.hpp"
#include "core/run_context.hpp"
#include "tools/calibration_file.hpp"
#include "tools/drawing.hpp"
#include "tools/pipeline.hpp"

namespace maquette::tools {

/// What has been found; what no data were given for is absent.
struct CalibrationFindings {
  std::optional<camera::SensorCalibration> sensor;
  camera::DarkPattern dark;  ///< with `sensor`
  camera::Measured prnu, dsnu_e, dsnu_pixel_e, column_noise_e;
  camera::Measured hot_rate_e_s;
  std::optional<camera::TargetCalibration> targets;
  std::optional<TargetTable> table;  ///< with `targets`
  std::optional<camera::VignettingFit> vignetting;
  std::vector<camera::FlatBlock> blocks;
  std::vector<std::string> notes;
};

/// Variance against signal with the fitted line, logarithmic.
[[nodiscard]] Drawing transfer_drawing(const camera::SensorCalibration& sensor);
/// Residuals of target points as arrows, enlarged; those left out in red.
[[nodiscard]] Drawing residual_drawing(const camera::TargetCalibration& targets,
                                       const std::vector<camera::TargetPoint>& points);

/// camera.toml, calibration.json, calibration.html, photon_transfer.png, residuals.png (what there
/// are data for). @return CAMERA_CALIBRATION_*, TOOLS_TARGET_FILE, TOOLS_CONFIG_*, CAMERA_IMAGE_*,
/// CAMERA_EFFECT_OUT_OF_RANGE, CORE_*
[[nodiscard]] Result<JobResult> calibrate_job(const std::filesystem::path& file,
                                              const std::filesystem::path& folder,
                                              const RunContext& run);

}  // namespace maquette::tools
