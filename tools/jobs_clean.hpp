// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <filesystem>
#include <optional>

#include "core/result.hpp"
#include "core/run_context.hpp"
#include "scan/clean.hpp"
#include "tools/pipeline.hpp"
#include "tools/scanner_file.hpp"

namespace maquette::tools {

struct CleanJob {
  std::filesystem::path cloud;
  Scanner scanner;  ///< whose beam the mixed points come from
  scan::CleanOptions options;
  /// Points outside its box, grown by `margin_mm`, are off the part: model field or mesh.
  std::optional<std::filesystem::path> part;
  double margin_mm = 20.0;
};
/// The cloud without what is no surface; figures say how much was taken out and why.
[[nodiscard]] Result<JobResult> clean_job(const CleanJob& job, const std::filesystem::path& out,
                                          const RunContext& run);

}  // namespace maquette::tools
