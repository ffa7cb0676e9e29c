// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file machine.hpp
/// What a milling machine and its controller can do: the limits that no program may exceed
/// and that decide how long it takes. Machines are TOML files (assets/machines/*.toml carry
/// one source per value); the program carries the ones of this project, and takes any other
/// by its path.

#include <filesystem>
#include <string>
#include <vector>

#include "cnc/data_file.hpp"
#include "cnc/tool.hpp"
#include "core/result.hpp"
#include "core/vec.hpp"

namespace maquette::cnc {

inline constexpr ErrorCode kUnknownMachine{"CNC_UNKNOWN_MACHINE"};
inline constexpr ErrorCode kToolTooLong{"CNC_TOOL_TOO_LONG"};
inline constexpr ErrorCode kBeyondTravel{"CNC_BEYOND_TRAVEL"};

/// Axes x, y, z. All > 0 unless said.
struct Machine {
  std::string name, description;
  Vec3 travel_mm;
  Vec3 max_feed_mm_min;      ///< of each axis while cutting
  double max_plunge_mm_min;  ///< downwards into material
  Vec3 rapid_mm_min;         ///< of each axis in rapids
  Vec3 acceleration_mm_s2;
  Vec3 jerk_mm_s3;             ///< 0: not limited
  double cycle_s;              ///< of the interpolator; no move is shorter
  double blocks_per_s;         ///< that the controller can read
  int look_ahead_blocks;       ///< moves, rounded corners included, behind which it can stop
  std::string corner;          ///< "arc": rounded within G64 P; "point": passed at a speed
  double corner_tolerance_mm;  ///< point: what an arc would leave the corner by, that speed's
  double min_spindle_rpm, max_spindle_rpm;
  double tool_clearance_mm;        ///< spindle nose to table with z at its top
  double arc_radius_tolerance_mm;  ///< start and end radius of an arc may differ by this
};

/// @return CNC_DATA_FILE (file, line, key, what is allowed), CORE_FILE_*
[[nodiscard]] Result<Machine> read_machine(const std::filesystem::path& file);
[[nodiscard]] Result<Machine> parse_machine(std::string_view text, std::string_view place);

[[nodiscard]] std::vector<std::string> machine_names();

/// @param name_or_path  one of machine_names(), or a path that ends in ".toml"
/// @return CNC_UNKNOWN_MACHINE with the known names, or what read_machine() returns
[[nodiscard]] Result<Machine> find_machine(const std::string& name_or_path);

/// Whether a tool stands free of the stock with z at its top.
/// @param gauge_length_mm  from the spindle nose to the tool's tip
/// @param stock_top_mm     above the table, clamps and clearance of rapids included
/// @return CNC_TOOL_TOO_LONG with both lengths
[[nodiscard]] Result<void> check_tool_length(const Machine& machine, const Tool& tool,
                                             double gauge_length_mm, double stock_top_mm);

/// Whether the machine can go as far as the tip goes, along each axis.
/// @return CNC_BEYOND_TRAVEL with the axis and both lengths
[[nodiscard]] Result<void> check_travel(const Machine& machine, const Box3& tip_mm);

}  // namespace maquette::cnc
