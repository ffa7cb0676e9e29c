// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/machine.hpp"

#include <fmt/format.h>

#include "cnc/toolpath.hpp"
#include "core/files.hpp"
#include "core/nearest_name.hpp"

namespace maquette::cnc {

Result<Machine> parse_machine(std::string_view text, std::string_view place) {
  Machine m{};
  // The smallest and largest that is a machine at all; a slip of the unit falls outside.
  const DataKey keys[] = {
      {"name", &m.name},
      {"description", &m.description, -INFINITY, INFINITY, false},
      {"travel_mm", &m.travel_mm, 1.0, 1e6},
      {"max_feed_mm_min", &m.max_feed_mm_min, 1.0, 1e6},
      {"max_plunge_mm_min", &m.max_plunge_mm_min, 1.0, 1e6},
      {"rapid_mm_min", &m.rapid_mm_min, 1.0, 1e6},
      {"acceleration_mm_s2", &m.acceleration_mm_s2, 1.0, 1e6},
      {"jerk_mm_s3", &m.jerk_mm_s3, 0.0, 1e12, false},
      {"cycle_s", &m.cycle_s, 1e-6, 0.1},
      {"blocks_per_s", &m.blocks_per_s, 1.0, 1e6},
      {"look_ahead_blocks", &m.look_ahead_blocks, 1.0, 1e6},
      {"corner", &m.corner},
      {"corner_tolerance_mm", &m.corner_tolerance_mm, 0.0, 1.0},
      {"min_spindle_rpm", &m.min_spindle_rpm, 1.0, 1e6},
      {"max_spindle_rpm", &m.max_spindle_rpm, 1.0, 1e6},
      {"tool_clearance_mm", &m.tool_clearance_mm, 1.0, 1e6},
      {"arc_radius_tolerance_mm", &m.arc_radius_tolerance_mm, 0.0001, 1.0},
  };
  MAQUETTE_TRY_VOID(read_data(text, place, keys));
  if (m.corner != "arc" && m.corner != "point")
    return fail(kDataFile,
                fmt::format("{}: key 'corner' is \"{}\"; allowed is \"arc\" or \"point\"", place,
                            m.corner));
  if (m.min_spindle_rpm > m.max_spindle_rpm)
    return fail(kDataFile, fmt::format("{}: min_spindle_rpm {} is above max_spindle_rpm {}", place,
                                       m.min_spindle_rpm, m.max_spindle_rpm));
  return m;
}

Result<Machine> read_machine(const std::filesystem::path& file) {
  constexpr std::size_t kLargestDataFile = 1 << 20;
  MAQUETTE_TRY(const std::string text, read_file(file, kLargestDataFile));
  return parse_machine(text, file.string());
}

std::vector<std::string> machine_names() {
  return built_in_names("machines");
}

Result<Machine> find_machine(const std::string& name_or_path) {
  if (name_or_path.ends_with(".toml")) return read_machine(name_or_path);
  if (const std::string_view text = built_in_data("machines", name_or_path); !text.empty())
    return parse_machine(text, name_or_path + ".toml");
  const std::string near = nearest_name(name_or_path, machine_names());
  return fail(kUnknownMachine,
              fmt::format("no machine is called '{}'; known: {}, or the path of a .toml file{}",
                          name_or_path, fmt::join(machine_names(), ", "),
                          near.empty() ? "" : fmt::format("; did you mean '{}'?", near)));
}

Result<void> check_tool_length(const Machine& machine, const Tool& tool, double gauge_length_mm,
                               double stock_top_mm) {
  const double room = machine.tool_clearance_mm - stock_top_mm;
  if (gauge_length_mm <= room) return {};
  return fail(kToolTooLong,
              fmt::format("tool {} ({}) is {:.4f} mm long, but {} leaves {:.4f} mm between spindle "
                          "nose and work with z at its top; take a shorter tool or a lower stock",
                          tool.number, tool.name, gauge_length_mm, machine.name, room));
}

Result<void> check_travel(const Machine& machine, const Box3& tip_mm) {
  if (tip_mm.empty()) return {};
  const Vec3 span = tip_mm.max - tip_mm.min;
  const auto check = [&](char axis, double length_mm, double travel_mm) -> Result<void> {
    // Rounding of coordinates is not travel.
    if (length_mm <= travel_mm + kTick_mm) return {};
    return fail(
        kBeyondTravel,
        fmt::format("the program needs {:.4f} mm of travel in {}, {} has {:.4f} mm; cut the "
                    "part in bands, or take another machine",
                    length_mm, axis, machine.name, travel_mm));
  };
  MAQUETTE_TRY_VOID(check('x', span.x, machine.travel_mm.x));
  MAQUETTE_TRY_VOID(check('y', span.y, machine.travel_mm.y));
  return check('z', span.z, machine.travel_mm.z);
}

}  // namespace maquette::cnc
