// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file commands.hpp
/// One function a verb: declares its options, and what to do when it is chosen.

#include <functional>
#include <memory>
#include <string>

#include "core/result.hpp"
#include "tools/adjustment.hpp"
#include "tools/console.hpp"
#include "tools/pipeline.hpp"

namespace CLI {
class App;
}

namespace maquette::tools {

inline constexpr ErrorCode kUsage{"TOOLS_USAGE"};
inline constexpr ErrorCode kExists{"TOOLS_FILE_EXISTS"};

/// Options before or after every verb.
struct CommonOptions {
  bool json = false, quiet = false;
  int threads = 0;         ///< 0: one per core
  std::int64_t seed = -1;  ///< -1: as the site file says, else 1
};

/// A verb that has run: 0 or 1 (a bound is not met).
using Action = std::function<Result<int>(Console&)>;

/// What main() calls after parsing.
struct Command {
  CLI::App* app = nullptr;
  Action action;
};

Command add_init(CLI::App& root, const CommonOptions& common);
Command add_run(CLI::App& root, const CommonOptions& common);
Command add_fuse(CLI::App& root, const CommonOptions& common);
Command add_stones(CLI::App& root, const CommonOptions& common);
Command add_stone_parts(CLI::App& root, const CommonOptions& common);
Command add_mesh(CLI::App& root, const CommonOptions& common);
Command add_simplify(CLI::App& root, const CommonOptions& common);
Command add_bands(CLI::App& root, const CommonOptions& common);
Command add_mill(CLI::App& root, const CommonOptions& common);
Command add_spheres(CLI::App& root, const CommonOptions& common);
Command add_verify(CLI::App& root, const CommonOptions& common);
Command add_backplot(CLI::App& root, const CommonOptions& common);
Command add_export(CLI::App& root, const CommonOptions& common);
Command add_lod(CLI::App& root, const CommonOptions& common);
Command add_render(CLI::App& root, const CommonOptions& common);
Command add_compare(CLI::App& root, const CommonOptions& common);
Command add_scan(CLI::App& root, const CommonOptions& common);
Command add_clean(CLI::App& root, const CommonOptions& common);
Command add_merge(CLI::App& root, const CommonOptions& common);
Command add_deviate(CLI::App& root, const CommonOptions& common);
Command add_compensate(CLI::App& root, const CommonOptions& common);
Command add_detectability(CLI::App& root, const CommonOptions& common);
Command add_diagnose(CLI::App& root, const CommonOptions& common);
Command add_info(CLI::App& root, const CommonOptions& common);
Command add_doctor(CLI::App& root, const CommonOptions& common);

/// --compensate, --corrections, --corrections-for. @param what  programs do with them
void add_adjustment(CLI::App& app, AdjustmentFiles& files, const std::string& what);

/// Runs a job under a progress bar, prints its note or its figures; 1 if unmet.
[[nodiscard]] Result<int> finish(Console& console, const std::string& what,
                                 const std::function<Result<JobResult>(const RunContext&)>& job);

}  // namespace maquette::tools
