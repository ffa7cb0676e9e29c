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
  std::filesystem::path masks{};  ///< EXR with Z and lit of the rendering; empty: its own channels
  camera::CompareOptions options;
  double max_mean_255 = INFINITY;  ///< unmet if exceeded
};

/// compare.json, compare.html; difference.png (128 + signed), absolute.png and, where the rendering
/// has `lit`, edges.png (white: edges of shadows, black: left out) unless CompareOptions::pictures
/// is off. CAMERA_IMAGES_DIFFER_IN_SIZE: masks of another size; CAMERA_IMAGE_FORMAT: there are none
/// in that file.
[[nodiscard]] Result<JobResult> compare_job(const CompareJob& job,
                                            const std::filesystem::path& folder,
                                            const RunContext& run);

}  // namespace maquette::tools
