// SPDX-License-Identifier: GPL-3.0-or-later
#include <cmath>
#include <numbers>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "camera/image_io.hpp"
#include "core/files.hpp"
#include "heightmap/field_io.hpp"
#include "meshing/mesh_io.hpp"
#include "meshing/stones.hpp"
#include "scan/deviate.hpp"
#include "tools/jobs.hpp"
#include "tools/pictures.hpp"
#include "tools/report.hpp"

namespace maquette::tools {
using nlohmann::json;

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

Result<JobResult> scan_job(const fs::path& surface_path, const std::optional<fs::path>& stones_path,
                           const scan::ScanOptions& options, const fs::path& out,
                           const RunContext& run) {
  std::vector<TriMesh> stones;
  if (stones_path) {
    MAQUETTE_TRY(const auto plan, meshing::read_stone_plan(*stones_path));
    for (const auto& s : plan) stones.push_back(meshing::stone_mesh(s));
  }
  // A mesh is scanned like a stone, over ground that is all void.
  heightmap::ModelField surface{Grid<float>(2, 2, NAN), {}, {}, {}};
  if (is_field(surface_path)) {
    MAQUETTE_TRY(surface, heightmap::read_model_field(surface_path));
  } else {
    MAQUETTE_TRY(TriMesh mesh, meshing::read_mesh(surface_path, run));
    stones.push_back(std::move(mesh));
  }
  MAQUETTE_TRY(const auto cloud, scan::simulate_scan(surface, stones, options, run));
  MAQUETTE_TRY_VOID(scan::write_cloud(cloud, out));
  JobResult result;
  result.outputs = {out};
  result.figures_json =
      json{{"points", cloud.points_mm.size()},
           {"station_mm", {options.station_mm.x, options.station_mm.y, options.station_mm.z}},
           {"scanner", options.scanner.name}}
          .dump();
  result.note = fmt::format("{} points", cloud.points_mm.size());
  return result;
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
  if (programs.size() == 1) text += fmt::format("gcode = \"{}\"\n", relative(programs[0]));
  text += fmt::format("\n[tool]\nball_diameter_mm = {}\n\n[deviation]\nreach_mm = {}\n",
                      site.ball_diameter_mm, site.reach_mm);
  MAQUETTE_TRY(const auto surface, heightmap::read_model_field(folder / "surface.tif"));
  for (std::size_t i = 0; i < scans.size(); ++i) {
    const Vec3 p = station_position(site, surface, static_cast<std::int64_t>(i));
    text += fmt::format("\n[[scan]]\npoints = \"{}\"\nscanner_position_mm = [{}, {}, {}]\n",
                        relative(scans[i]), p.x, p.y, p.z);
  }
  JobResult result;
  result.outputs = {folder / "case.toml"};
  MAQUETTE_TRY_VOID(write_file(result.outputs[0], text));
  return result;
}

Result<JobResult> deviate_job(const fs::path& case_path, const fs::path& folder,
                              const RunContext& run) {
  MAQUETTE_TRY(const auto input, read_case(case_path));
  if (input->scans.empty())
    return fail(
        kConfigInvalid,
        fmt::format("{}: deviate compares scans; add a [[scan]] table with points = \"FILE\"",
                    case_path.string()));
  MAQUETTE_TRY(const auto design, heightmap::read_model_field(input->design));
  scan::Cloud all;
  json registrations = json::array();
  std::optional<scan::Registration> first;
  for (const CaseScan& entry : input->scans) {
    MAQUETTE_TRY(auto cloud, scan::read_cloud(entry.points));
    auto alignment = scan::register_scan(cloud, design, {}, run);
    if (!alignment)
      return tl::unexpected(std::move(alignment.error()).within(entry.points.string()));
    registrations.push_back({{"points", entry.points.filename().string()},
                             {"iterations", alignment->iterations},
                             {"rms_before_mm", alignment->rms_before_mm},
                             {"rms_after_mm", alignment->rms_after_mm},
                             {"sigma_translation_mm", alignment->sigma_translation_mm},
                             {"sigma_rotation_rad", alignment->sigma_rotation_rad},
                             {"free_directions", alignment->free_directions}});
    for (const Vec3& p : cloud.points_mm)
      all.points_mm.push_back(alignment->model_from_scan.point(p));
    if (!first) first = *alignment;
  }
  const RigidTransform in_model;  // every cloud has been brought there above
  MAQUETTE_TRY(const auto deviation,
               scan::deviate(all, in_model, design, Millimetres{input->reach_mm}, run));

  std::error_code ec;
  fs::create_directories(folder, ec);
  if (ec) return tl::unexpected(write_error(folder, ec.value()));
  JobResult result;
  result.outputs = {folder / "summary.json", folder / "deviation.tif", folder / "deviation.ply",
                    folder / "deviation.png", folder / "report.html"};
  json summary = json::parse(scan::to_json(deviation.statistics, &*first));
  summary["registrations"] = registrations;
  MAQUETTE_TRY_VOID(write_file(result.outputs[0], summary.dump(1)));
  MAQUETTE_TRY_VOID(heightmap::write_model_grid(deviation.map_mm, design, "mm", result.outputs[1]));
  MAQUETTE_TRY_VOID(scan::write_deviation_ply(all, in_model, deviation, result.outputs[2]));
  const double limit = colour_limit(deviation.map_mm, 0.05);
  MAQUETTE_TRY_VOID(camera::write_png(signed_picture(deviation.map_mm, limit), result.outputs[3]));
  MAQUETTE_TRY_VOID(
      write_deviation_page(deviation, summary.dump(), limit, result.outputs[3], result.outputs[4]));
  // The histogram belongs to the figures: the run's own report draws it again.
  summary["histogram"] = deviation.histogram;
  summary["histogram_limit_mm"] = deviation.histogram_limit_mm;
  summary["colour_limit_mm"] = limit;
  result.figures_json = summary.dump();
  const auto& s = deviation.statistics;
  result.note =
      fmt::format("mean {:+.3f} mm, rms {:.3f} mm over {} points", s.mean_mm, s.rms_mm, s.points);
  return result;
}

}  // namespace maquette::tools
