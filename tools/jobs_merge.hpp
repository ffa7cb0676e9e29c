// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file jobs_merge.hpp
/// What the verb `merge` does: several scans become one cloud and a mesh.

#include <filesystem>
#include <optional>
#include <vector>

#include "core/result.hpp"
#include "core/run_context.hpp"
#include "scan/merge.hpp"
#include "tools/pipeline.hpp"

namespace maquette::tools {

struct MergeJob {
  std::vector<std::filesystem::path> clouds;  ///< every station of every file is a scan
  scan::MergeOptions options;
  double thin_mm = 0.0;  ///< 0: every point, stations kept
  std::optional<std::filesystem::path> mesh;
  double mesh_voxel_mm = 0.0;  ///< 0: four points a voxel
  bool closed = false;
};
/// The cloud, beside it <out>.merge.json (poses with covariance, pairs, gains, holes), and the
/// mesh.
[[nodiscard]] Result<JobResult> merge_job(const MergeJob& job, const std::filesystem::path& out,
                                          const RunContext& run);

}  // namespace maquette::tools
