// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file check_stations.hpp
/// Are scanners where a file says they are?
///
/// Takes   a cloud and its pose on the design
/// Gives   SCAN_STATION_POSE where a scanner would see its points from behind; how far stations
///         of one file lie from where they would lie alone
/// Not     a wrong place on the right side of the part: a surface looks alike from there, and rows
///         and columns of a structured scan are not compared with the angles from its station

#include <cstddef>
#include <string>
#include <vector>

#include "core/result.hpp"
#include "core/run_context.hpp"
#include "heightmap/height_field.hpp"
#include "scan/cloud.hpp"
#include "scan/register.hpp"

namespace maquette::scan {

inline constexpr ErrorCode kStationPose{"SCAN_STATION_POSE"};

/// A quarter of a scan's points seen from behind is no noise and no stone.
inline constexpr double kMostFromBehind = 0.25;

/// @param model_from_scan  of the registered cloud
/// @return SCAN_STATION_POSE with the place, in the model frame, and the share of its points that
/// it
///   would see from behind. Stations whose place is not known pass.
[[nodiscard]] Result<void> check_viewpoints(const Cloud& cloud,
                                            const RigidTransform& model_from_scan,
                                            const heightmap::ModelField& design);

struct StrayStation {
  std::string name;       ///< of the file, or its number
  double off_mm = NAN;    ///< from where it would lie alone, rms over its points; NaN: nowhere near
  double sigma_mm = NAN;  ///< of that
};

/// Stations of a file with several that lie elsewhere than alone: by more than five standard
/// deviations and a quarter of the noise. Some 200 000 points of each are registered.
[[nodiscard]] std::vector<StrayStation> stray_stations(const Cloud& cloud,
                                                       const Registration& together,
                                                       const heightmap::ModelField& design,
                                                       const RunContext& run = {});

}  // namespace maquette::scan
