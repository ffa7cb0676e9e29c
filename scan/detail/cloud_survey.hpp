// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file cloud_survey.hpp
/// What has to be known of a cloud that is never held as a whole before its points are put into
/// voxels, and its pieces then.

#include <vector>

#include "scan/cloud_stream.hpp"
#include "scan/detail/surfels.hpp"

namespace maquette::scan::detail {

struct CloudSurvey {
  Box3 bounds_mm;  ///< model frame
  PointSample sample;
  bool coloured = true;  ///< every station with points has colours
};

/// One way through the cloud. @return errors of reading, CORE_CANCELLED
[[nodiscard]] Result<CloudSurvey> survey_cloud(const OpenCloud& open, const RunContext& run);

/// As make_surfels, point by point: memory goes with the voxels that hold points (some 190 bytes
/// each), not with the points. Means to 1e-7 of a voxel.
/// @return errors of reading, CORE_CANCELLED
[[nodiscard]] Result<std::vector<Surfel>> gather_surfels(const OpenCloud& open,
                                                         const CloudSurvey& survey,
                                                         const VoxelGrid& grid,
                                                         const RunContext& run);

}  // namespace maquette::scan::detail
