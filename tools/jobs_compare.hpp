// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file jobs_compare.hpp
/// What `compare` does: a photograph against a rendering.

#include <filesystem>

#include "camera/compare.hpp"
#include "core/result.hpp"
#include "core/run_context.hpp"
#include "tools/pipeline.hpp"

namespace maquette::tools {

struct CompareJob {
  std::filesystem::path real, rendered;
  camera::CompareOptions options;
  double max_mean_255 = INFINITY;  ///< unmet if exceeded
};

/// compare.json, compare.html; difference.png (128 + signed), absolute.png unless
/// CompareOptions::pictures is off.
[[nodiscard]] Result<JobResult> compare_job(const CompareJob& job,
                                            const std::filesystem::path& folder,
                                            const RunContext& run);

}  // namespace maquette::tools
