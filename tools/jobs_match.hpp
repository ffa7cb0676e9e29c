// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file jobs_match.hpp
/// What `match` does: lamp, exposure, white balance and poses that make renderings look like
/// photographs.

#include <filesystem>
#include <string>
#include <vector>

#include "core/result.hpp"
#include "core/run_context.hpp"
#include "tools/pipeline.hpp"

namespace maquette::tools {

struct MatchJob {
  std::filesystem::path file;      ///< match.toml (match_file.hpp)
  double max_mean_255 = INFINITY;  ///< unmet if a photograph (one held out, if any is) differs more
};

/// match.json, match.html; scene.toml with what all photographs share, scene_<photograph>.toml of
/// each: what `render` takes.
/// @param said  for people: a line for each number with its standard uncertainty, and for each
///              photograph
/// @return what read_match(), read_scene(), load_scene(), match_photographs() and compare_images()
///         return; CORE_FILE_NOT_WRITABLE, CORE_DISK_FULL
[[nodiscard]] Result<JobResult> match_job(const MatchJob& job, const std::filesystem::path& folder,
                                          std::vector<std::string>& said, const RunContext& run);

}  // namespace maquette::tools
