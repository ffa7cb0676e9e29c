// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file compensate.hpp
/// Programs rewritten for a machine with known errors. docs/compensation.md describes the file.

#include <filesystem>
#include <optional>
#include <vector>

#include "cnc/compensate.hpp"
#include "core/result.hpp"
#include "core/run_context.hpp"
#include "tools/pipeline.hpp"

namespace maquette::tools {

/// @return errors of schema.hpp: file, line, key, what is allowed
[[nodiscard]] Result<cnc::MachineErrors> read_compensation(const std::filesystem::path& file);

struct CompensateJob {
  std::vector<std::filesystem::path> programs;
  std::filesystem::path by;
  std::optional<std::filesystem::path> design;  ///< needed for a ball of another radius
  double ball_diameter_mm = 6.0;                ///< as programmed
  /// A case with [[cause]] tables: says what the rewritten programs gain, cut in simulation with
  /// these causes; its design and ball count.
  std::optional<std::filesystem::path> extended;
};
/// The programs under their names in `folder`; figures: moves, lines, and with `extended`
/// rms_before_mm and rms_after_mm. @return errors of cnc::compensate and of case files
[[nodiscard]] Result<JobResult> compensate_job(const CompensateJob& job,
                                               const std::filesystem::path& folder,
                                               const RunContext& run);

}  // namespace maquette::tools
