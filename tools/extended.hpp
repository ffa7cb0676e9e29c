// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file extended.hpp
/// Case files for diagnosis, and what `extended.toml` does to simulated surfaces and scans.

#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "diagnosis/case_input.hpp"
#include "diagnosis/extended_model.hpp"
#include "scan/cloud_stream.hpp"
#include "tools/scene_file.hpp"

namespace maquette::tools {

/// What diagnosis takes of a case.
[[nodiscard]] diagnosis::CaseInput diagnosis_input(const Case& c, std::uint64_t seed);

/// A case with [[cause]] tables, as diagnose writes it.
struct Extended {
  std::filesystem::path file;
  /// Instead of the file's own: the part that is simulated now.
  std::optional<std::filesystem::path> design;
  std::vector<std::filesystem::path> programs;  ///< empty: the file's own
};
/// @return errors of case files and of diagnosis::ExtendedModel
[[nodiscard]] Result<diagnosis::ExtendedModel> extended_model(const Extended& extended,
                                                              const RunContext& run);

/// Passes points on to `writer`, each where the model's scanner would see it: stations are scans
/// 1, 2 .. of the case, in order, the first `first`.
[[nodiscard]] std::unique_ptr<scan::CloudWriter> as_seen(const diagnosis::ExtendedModel& model,
                                                         scan::CloudWriter& writer,
                                                         std::span<const Vec3> stations_mm,
                                                         std::size_t first = 0);

}  // namespace maquette::tools
