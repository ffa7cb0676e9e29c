// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file thinned_cloud.hpp
/// Voxels as the points of a cloud.

#include <vector>

#include "scan/detail/scan_scene.hpp"
#include "scan/detail/voxel_statistics.hpp"

namespace maquette::scan::detail {

/// One station that keeps what is common to `from`; mean, normal, count and spread of each voxel.
/// @param intensity, colour  do all points have them?
/// @return errors of `out`
[[nodiscard]] Result<void> write_thinned(const VoxelStatistics& voxels,
                                         const std::vector<ScanStation>& from, bool intensity,
                                         bool colour, const StationSink& out);

}  // namespace maquette::scan::detail
