// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file check_stations.hpp
/// Are scanners where a file says they are?
///
/// Takes   a cloud and its pose on the design
/// Gives   SCAN_STATION_POSE where a scanner would see its points from behind, where the columns of
///         its grid meet elsewhere, or where points without a grid lie as dense as from elsewhere
///         round the part; how far stations of one file lie from where they would lie alone
/// Not     without a grid: a wrong height or distance in the right direction; or any on the right
///         side of the part where points were thinned evenly or the part has no relief: a surface
///         looks alike from there

#include <cstddef>
#include <string>
#include <vector>

#include "core/result.hpp"
#include "core/run_context.hpp"
#include "heightmap/height_field.hpp"
#include "scan/cloud.hpp"
#include "scan/mesh_distance.hpp"
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
/// The same on a part of any shape.
[[nodiscard]] Result<void> check_viewpoints(const Cloud& cloud,
                                            const RigidTransform& model_from_scan,
                                            const MeshDistance& mesh);

/// A scanner turns or looks so that its column of points, phase-shift or camera, lies in one plane
/// through its centre. Seen from elsewhere it does not, as far as there is relief along it.
/// @return SCAN_STATION_POSE with the place that the columns of the cloud's grid meet in, its
///   and the stated one, both in the cloud's frame: where columns fit the first twice as well, lie
///   off planes through the second by more than 20 arc seconds, and the two are five standard
///   deviations and a hundredth of the range apart.
///   Clouds without grid, without places, or with fewer than ten columns of twenty points pass.
[[nodiscard]] Result<void> check_sight_planes(const Cloud& cloud);

/// Where ground turns away from a scanner, its points lie farther apart: counts over cells of some
/// 50 points, without what goes slowly over the part, against those that the places round the part
/// would have left, at the stated height and distance.
/// @param model_from_scan  of the registered cloud
/// @return SCAN_STATION_POSE where a place 25 degrees or more round the part, and a fifth of the
///   range off, explains an eighth of the variation of the density, and 9 % more than the stated
///   one and than a place straight above. A wrong height or distance is not told: points that were
///   thinned have the direction of the scanner in what is left of their density, or nothing, but no
///   longer its size. Pass: clouds with a grid (their columns say more) or thinned by maquette,
///   places that are not known, fewer than 300 cells.
[[nodiscard]] Result<void> check_density(const Cloud& cloud, const RigidTransform& model_from_scan,
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
