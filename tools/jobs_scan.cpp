// SPDX-License-Identifier: GPL-3.0-or-later
#include <cmath>
#include <numbers>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "core/files.hpp"
#include "heightmap/field_io.hpp"
#include "tools/jobs.hpp"
#include "tools/scanner_file.hpp"

namespace maquette::tools {

Vec3 station_position(const Site& site, const heightmap::ModelField& surface, std::int64_t index) {
  const double half = 0.5 * site.size_mm;
  const double azimuth =
      2.0 * std::numbers::pi * static_cast<double>(index) / static_cast<double>(site.stations) +
      std::numbers::pi;  // the first stands south of the part
  const double elevation = degrees(site.scanner_elevation_deg).value();
  const double out = half + site.scanner_distance_mm * std::cos(elevation);
  const auto top = static_cast<double>(heightmap::height_range(surface.z_mm).max);
  return {surface.x0.value() + half + out * std::sin(azimuth),
          surface.y0.value() + half + out * std::cos(azimuth),
          top + site.scanner_distance_mm * std::sin(elevation)};
}

Result<JobResult> case_job(const Site& site, const fs::path& folder,
                           std::span<const fs::path> programs, std::span<const fs::path> scans) {
  const auto relative = [&](const fs::path& p) {
    return p.lexically_relative(folder).generic_string();
  };
  std::string text =
      "# What was designed and what was measured; maquette deviate takes it.\n"
      "schema = \"maquette.case/1\"\ndesign = \"surface.tif\"  # design with the stones' "
      "envelope\n";
  if (fs::exists(folder / "design.tif") && fs::exists(folder / "stones.json"))
    text += "ground = \"design.tif\"\nstones = \"stones.json\"\n";
  if (fs::exists(folder / "as_milled.tif"))
    text += "as_milled = \"as_milled.tif\"  # what the programs leave\n";
  std::vector<std::string> names;
  for (const fs::path& program : programs)
    names.push_back(fmt::format("\"{}\"", relative(program)));
  text += fmt::format("gcode = [{}]\n", fmt::join(names, ", "));
  text += fmt::format("\n[tool]\nball_diameter_mm = {}\n\n[deviation]\nreach_mm = {}\n",
                      site.ball_diameter_mm, site.reach_mm);
  MAQUETTE_TRY(const auto surface, heightmap::read_model_field(folder / "surface.tif"));
  MAQUETTE_TRY(const auto scanner, find_scanner(site.scanner));
  for (std::size_t i = 0; i < scans.size(); ++i) {
    const Vec3 p = station_position(site, surface, static_cast<std::int64_t>(i));
    text += fmt::format("\n[[scan]]\npoints = \"{}\"\nscanner_position_mm = [{}, {}, {}]\n",
                        relative(scans[i]), p.x, p.y, p.z);
    if (const auto* beam = std::get_if<PhaseShiftScanner>(&scanner);
        beam != nullptr && site.footprint_rays > 1)
      text += fmt::format(
          "beam_diameter_mm = {:.2f}\n",
          std::hypot(beam->preset.beam_diameter_mm,
                     1e-3 * beam->preset.beam_divergence_mrad * site.scanner_distance_mm));
  }
  JobResult result;
  result.outputs = {folder / "case.toml"};
  MAQUETTE_TRY_VOID(write_file(result.outputs[0], text));
  return result;
}

}  // namespace maquette::tools
