// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file tool_table.hpp
/// The tools of a machine as a TOML file, one [[tool]] for each T: what mill takes its cutter from
/// and verify its T words. Lengths in mm.
///
///     [[tool]]
///     number = 1
///     name = "ball nose 6 mm"
///     shape = "ball"              # ball, bull or flat
///     diameter_mm = 6.0
///     corner_radius_mm = 1.0      # of a bull nose
///     teeth = 2
///     flute_length_mm = 22.0      # cuts up to this height above the tip
///     shank_diameter_mm = 6.0     # from the flutes' end to the holder
///     stick_out_mm = 45.0         # tip to the holder's lower face
///     [[tool.holder]]             # frusta of the holder, upwards to the spindle nose
///     height_mm = 40.0
///     lower_diameter_mm = 27.0
///     upper_diameter_mm = 32.0
///
/// Number, shape and diameter must be there. Without a stick-out nothing is known of shank and
/// holder: they are not looked at, and the tool's length is not checked.

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "cnc/tool.hpp"
#include "core/result.hpp"

namespace maquette::tools {

/// @return in the order of the file; TOOLS_CONFIG_SYNTAX, TOOLS_CONFIG_INVALID with all that is
///         wrong, each with file and line or the tool's number; CORE_FILE_*
[[nodiscard]] Result<std::vector<cnc::Tool>> read_tool_table(const std::filesystem::path& file);

/// Such a file with these tools.
[[nodiscard]] std::string tool_table_text(std::span<const cnc::Tool> tools);

/// From the tip to the spindle nose; 0: not known.
[[nodiscard]] double gauge_length_mm(const cnc::Tool& tool);

/// "ball nose 6 mm"
[[nodiscard]] std::string shape_name(const cnc::Cutter& cutter);

}  // namespace maquette::tools
