// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file corrections_file.hpp
/// Where the part and the axes of a set-up really are: written by deviate, taken by render (key
/// `corrections` of a scene).
///
///     schema = "maquette.corrections/1"
///     [surface]                        # a point of the design, where it really is
///     rotation_wxyz = [1.0, 0.0, 0.0, 0.0]
///     translation_mm = [0.21, -0.08, 0.02]
///     sigma_translation_mm = 0.004     # of the part's middle
///     sigma_rotation_deg = 0.0003
///
///     [[axis]]
///     name = "camera rail"
///     origin_mm = [0.0, -400.0, 600.0]  # of the mark at position 0
///     direction = [1.0, 0.0, 0.0]
///     scale = 1.0002                    # mm of travel per mm shown
///     sigma_origin_mm = 0.02
///     sigma_direction_deg = 0.002
///     sigma_scale = 0.00003
///     straightness_mm = 0.05

#include <filesystem>
#include <string>
#include <vector>

#include "core/result.hpp"
#include "core/vec.hpp"
#include "scan/fit_axis.hpp"

namespace maquette::tools {

struct AxisCorrection {
  std::string name;
  scan::AxisFit fit;
};

struct Corrections {
  RigidTransform actual_from_planned;  ///< of the surface
  double sigma_translation_mm = 0.0, sigma_rotation_rad = 0.0;
  std::vector<AxisCorrection> axes;
};

[[nodiscard]] std::string corrections_text(const Corrections& corrections);
/// @return TOOLS_CONFIG_SYNTAX, TOOLS_CONFIG_INVALID, CORE_FILE_*
[[nodiscard]] Result<Corrections> read_corrections(const std::filesystem::path& file);

/// Columns position_mm, x_mm, y_mm, z_mm under a header line.
/// @return TOOLS_CONFIG_INVALID with the line; SCAN_AXIS; CORE_FILE_*
[[nodiscard]] Result<scan::AxisFit> read_axis_stops(const std::filesystem::path& csv);

}  // namespace maquette::tools
