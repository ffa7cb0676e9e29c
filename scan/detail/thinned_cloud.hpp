// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file thinned_cloud.hpp
/// Voxels as the points of a cloud.

#include <cstdint>
#include <vector>

#include "scan/detail/scan_scene.hpp"
#include "scan/detail/voxel_statistics.hpp"

namespace maquette::scan::detail {

/// Which slices of the grid across x are written. Those beside them must be there too, for normals.
struct ThinnedSlices {
  std::int64_t begin = 0, end = VoxelGrid::kSide;
  bool begin_station = true;  ///< false: more of the station that was begun
};

/// One station that keeps what is common to `from`; mean, normal, count and spread of each voxel.
/// @param intensity, colour  do all points have them?
/// @return how many, or errors of `out`
[[nodiscard]] Result<std::uint64_t> write_thinned(const VoxelStatistics& voxels,
                                                  const ThinnedSlices& slices,
                                                  const std::vector<ScanStation>& from,
                                                  bool intensity, bool colour,
                                                  const StationSink& out);

}  // namespace maquette::scan::detail
