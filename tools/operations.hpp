// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file operations.hpp
/// What is milled one after the other: [[operation]] tables of a file of their own or of a site.
/// Each starts from what the one before has left. Keys are in docs/operations.md.

#include <cmath>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "cnc/tool.hpp"
#include "core/result.hpp"
#include "tools/schema.hpp"

namespace maquette::tools {

struct MillJob;  // milling.hpp

/// Zero, NaN and empty: as its strategy or the job it belongs to has it.
struct Operation {
  std::string strategy, name;
  std::int64_t tool = 0;
  double diameter_mm = NAN, corner_radius_mm = NAN;
  double stepover_mm = NAN, step_down_mm = NAN, allowance_mm = NAN;
  double direction_deg = NAN, scallop_limit_mm = NAN, tolerance_mm = NAN;
  double excess_limit_mm = NAN, stated_stepover_mm = NAN;
  double least_slope_deg = NAN, ball_before_mm = NAN, ramp_deg = NAN, cell_mm = NAN;
  double gap_mm = NAN, bed_mm = NAN, mark_depth_mm = NAN;
  double feed_mm_per_min = NAN, plunge_feed_mm_per_min = NAN, spindle_rpm = NAN;
};

/// Of one [[operation]]. @param strategies  that may be asked for
[[nodiscard]] Schema operation_schema(Operation& operation, std::vector<std::string> strategies);

/// Those that cut, in the order of the table of strategies.
[[nodiscard]] std::vector<std::string> cutting_strategies();

/// At least one operation. @return TOOLS_CONFIG_SYNTAX, TOOLS_CONFIG_INVALID, CORE_FILE_*
[[nodiscard]] Result<std::vector<Operation>> read_operations(const std::filesystem::path& file);

/// @param base   what all have in common; `defaults` makes it that of a strategy
/// @param table  tools by number; empty: cutters are as operations say
/// @return one job an operation, its `name` filled in. TOOLS_CONFIG_INVALID, beginning with `file`:
///         a name twice, one number for two cutters, a tool that is no ball where one is needed, a
///         cutter without size; CNC_TOOL_NOT_IN_TABLE
[[nodiscard]] Result<std::vector<MillJob>> jobs_of(
    std::span<const Operation> operations, const std::function<MillJob(std::string_view)>& defaults,
    std::span<const cnc::Tool> table, const std::string& file);

/// Of the operations the one whose ridges stay: the last with passes over the whole surface;
/// nullptr if none has.
[[nodiscard]] const MillJob* finishing(std::span<const MillJob> jobs);

/// Each tool once, in the order of the jobs.
[[nodiscard]] std::vector<cnc::Tool> tools_of(std::span<const MillJob> jobs);

}  // namespace maquette::tools
