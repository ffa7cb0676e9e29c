// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "camera/image_io.hpp"
#include "core/files.hpp"
#include "heightmap/field_io.hpp"
#include "meshing/mesh_io.hpp"
#include "meshing/stones.hpp"
#include "scan/datums.hpp"
#include "scan/deviate.hpp"
#include "scan/find_stones.hpp"
#include "scan/regions.hpp"
#include "scan/significance.hpp"
#include "tools/deviation_page.hpp"
#include "tools/jobs.hpp"
#include "tools/pictures.hpp"

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
  std::vector<std::string> names;
  for (const fs::path& program : programs)
    names.push_back(fmt::format("\"{}\"", relative(program)));
  text += fmt::format("gcode = [{}]\n", fmt::join(names, ", "));
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

namespace {

std::vector<scan::Datum> datums_of(const Case& input) {
  std::vector<scan::Datum> datums;
  for (const CaseDatum& d : input.datums) {
    const auto kind = d.kind == "pad"      ? scan::Datum::Kind::pad
                      : d.kind == "sphere" ? scan::Datum::Kind::sphere
                                           : scan::Datum::Kind::dowel;
    datums.push_back({kind,
                      d.name.empty() ? fmt::format("{} {}", d.kind, datums.size() + 1) : d.name,
                      d.at_mm, d.radius_mm, d.half_x_mm, d.half_y_mm, d.axis, d.length_mm});
  }
  return datums;
}

json registration_row(const scan::Registration& r, const std::string& name) {
  return {{"points", name},
          {"iterations", r.iterations},
          {"rms_before_mm", r.rms_before_mm},
          {"rms_after_mm", r.rms_after_mm},
          {"noise_mm", r.noise_mm},
          {"overlap", r.overlap},
          {"likeness", r.likeness},
          {"found_anywhere", r.found_anywhere},
          {"effective_points", r.effective_points},
          {"sigma_translation_mm", r.sigma_translation_mm},
          {"sigma_rotation_rad", r.sigma_rotation_rad},
          {"free_directions", r.free_directions}};
}

json datum_row(const scan::DatumRegistration& on, const scan::Absorbed& a,
               const std::string& name) {
  json fits = json::array();
  for (const scan::DatumFit& f : on.datums)
    fits.push_back(
        {{"name", f.name}, {"points", f.points}, {"mean_mm", f.mean_mm}, {"noise_mm", f.noise_mm}});
  return {{"points", name},
          {"absorbed_mean_mm", a.mean_mm},
          {"absorbed_sigma_mm", a.sigma_mm},
          {"absorbed_rms_mm", a.rms_mm},
          {"absorbed_min_mm", a.min_mm},
          {"absorbed_max_mm", a.max_mm},
          {"sigma_translation_mm", on.registration.sigma_translation_mm},
          {"sigma_rotation_rad", on.registration.sigma_rotation_rad},
          {"free_directions", on.registration.free_directions},
          {"fits", fits}};
}

/// All scans in the model frame, and what is known of each point beside its place.
struct Measured {
  scan::Cloud cloud;
  std::vector<float> range_mm, incidence_deg, slope_deg;
  std::vector<scan::Registration> used;
  json registrations = json::array(), datums = json::array();
};

Result<void> add_scan(Measured& all, const CaseScan& entry, const Case& input,
                      const heightmap::ModelField& design, const RunContext& run) {
  const std::string name = entry.points.filename().string();
  const auto within = [&](Error error) {
    return tl::unexpected(std::move(error).within(entry.points.string()));
  };
  MAQUETTE_TRY(auto cloud, scan::read_cloud(entry.points));
  if (!std::isnan(entry.scanner_position_mm.x)) cloud.station_mm = entry.scanner_position_mm;
  auto best = scan::register_scan(cloud, design, {}, run);
  if (!best) return within(std::move(best.error()));
  all.registrations.push_back(registration_row(*best, name));
  scan::Registration used = *best;
  if (!input.datums.empty()) {
    auto on =
        scan::register_datums(cloud, design, datums_of(input), best->model_from_scan, 2.0, run);
    if (!on) return within(std::move(on.error()));
    all.datums.push_back(datum_row(*on, scan::absorbed_by(*best, on->registration, design), name));
    used = on->registration;
  }
  std::optional<Vec3> station;
  if (cloud.station_mm) station = used.model_from_scan.point(*cloud.station_mm);
  for (std::size_t i = 0; i < cloud.points_mm.size(); ++i) {
    const Vec3 p = used.model_from_scan.point(cloud.points_mm[i]);
    all.cloud.points_mm.push_back(p);
    const double s = design.spacing.value();
    const double h = heightmap::height_at(design, p.x, p.y);
    const double rise_x = heightmap::height_at(design, p.x + s, p.y) - h;
    const double rise_y = heightmap::height_at(design, p.x, p.y + s) - h;
    const Vec3 normal = normalized(Vec3{-rise_x / s, -rise_y / s, 1.0});
    constexpr double kDegrees = 180.0 / std::numbers::pi;
    all.slope_deg.push_back(static_cast<float>(kDegrees * std::acos(normal.z)));
    if (!station) {
      all.range_mm.push_back(NAN);
      all.incidence_deg.push_back(NAN);
      continue;
    }
    const Vec3 look = *station - p;
    const double range = norm(look);
    all.range_mm.push_back(static_cast<float>(range));
    all.incidence_deg.push_back(
        static_cast<float>(kDegrees * std::acos(std::clamp(dot(look, normal) / range, -1.0, 1.0))));
  }
  const std::size_t before = all.cloud.intensity.size();
  all.cloud.intensity.resize(all.cloud.points_mm.size(), NAN);
  if (cloud.intensity.size() == cloud.points_mm.size())
    std::copy(cloud.intensity.begin(), cloud.intensity.end(),
              all.cloud.intensity.begin() + static_cast<std::ptrdiff_t>(before));
  all.used.push_back(used);
  return {};
}

json findings_json(const scan::Significance& s) {
  json rows = json::array();
  for (const scan::Finding& f : s.findings) {
    if (rows.size() == 500) break;
    rows.push_back({{"x_mm", f.centre_mm.x},
                    {"y_mm", f.centre_mm.y},
                    {"height_mm", f.height_mm},
                    {"sigma_height_mm", f.sigma_height_mm},
                    {"diameter_mm", f.diameter_mm},
                    {"sigma_diameter_mm", f.sigma_diameter_mm},
                    {"length_mm", f.length_mm},
                    {"width_mm", f.width_mm},
                    {"area_mm2", f.area_mm2},
                    {"volume_mm3", f.volume_mm3},
                    {"sigma_volume_mm3", f.sigma_volume_mm3},
                    {"certainty", f.certainty},
                    {"cell_mm", f.cell_mm}});
  }
  return rows;
}

json stones_json(const std::vector<scan::StoneFinding>& stones) {
  json rows = json::array();
  constexpr double kDegrees = 180.0 / std::numbers::pi;
  for (const scan::StoneFinding& f : stones) {
    json row = {{"number", f.number},
                {"state", scan::name_of(f.state)},
                {"points", f.points},
                {"height_share", f.height_share}};
    if (f.state == scan::StoneState::swapped) row["carries"] = f.carries;
    if (f.state == scan::StoneState::as_planned || f.state == scan::StoneState::moved) {
      row["shift_mm"] = {f.shift_mm.x, f.shift_mm.y, f.shift_mm.z};
      row["sigma_shift_mm"] = {f.sigma_shift_mm.x, f.sigma_shift_mm.y, f.sigma_shift_mm.z};
      row["turn_deg"] = kDegrees * f.turn_rad;
      row["sigma_turn_deg"] = kDegrees * f.sigma_turn_rad;
      row["tilt_deg"] = kDegrees * f.tilt_rad;
    }
    rows.push_back(row);
  }
  return rows;
}

json regions_json(const std::vector<scan::RegionResult>& regions) {
  json rows = json::array();
  for (const scan::RegionResult& r : regions)
    rows.push_back({{"name", r.name},
                    {"points", r.statistics.points},
                    {"mean_mm", r.statistics.mean_mm},
                    {"sigma_mean_mm", r.sigma_mean_mm},
                    {"rms_mm", r.statistics.rms_mm},
                    {"median_mm", r.statistics.median_mm},
                    {"nmad_mm", r.statistics.nmad_mm},
                    {"p05_mm", r.statistics.p05_mm},
                    {"p95_mm", r.statistics.p95_mm},
                    {"within", r.within},
                    {"verdict", scan::name_of(r.verdict)},
                    {"worst_mm", r.worst_mm},
                    {"worst_at_mm", {r.worst_at_mm.x, r.worst_at_mm.y}}});
  return rows;
}

json dependence_json(const scan::Dependence& d) {
  json bins = json::array();
  for (std::size_t k = 0; k < d.points.size(); ++k)
    bins.push_back({{"from", d.from[k]},
                    {"to", d.to[k]},
                    {"mean_mm", d.mean_mm[k]},
                    {"nmad_mm", d.nmad_mm[k]},
                    {"points", d.points[k]}});
  return {{"on", d.on}, {"bins", bins}};
}

/// The deviation where its cell is significant, zero where it is not, on the design's nodes.
Grid<float> significant_map(const scan::Significance& s, const heightmap::ModelField& design) {
  Grid<float> map(design.z_mm.rows(), design.z_mm.cols(), NAN);
  if (s.maps.empty()) return map;
  for (std::ptrdiff_t r = 0; r < map.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < map.cols(); ++c)
      for (const scan::CellMap& m : s.maps) {
        const auto i = static_cast<std::ptrdiff_t>((design.y_mm(r) - m.y0_mm) / m.cell_mm);
        const auto j = static_cast<std::ptrdiff_t>((design.x_mm(c) - m.x0_mm) / m.cell_mm);
        if (!m.mean_mm.contains(i, j) || std::isnan(m.mean_mm(i, j))) continue;
        if (std::isnan(map(r, c))) map(r, c) = 0.0F;
        if (m.significant(i, j) == 0) continue;
        map(r, c) = m.mean_mm(i, j);
        break;
      }
  return map;
}

}  // namespace

Result<JobResult> deviate_job(const fs::path& case_path, const fs::path& folder,
                              const RunContext& run) {
  MAQUETTE_TRY(const auto input, read_case(case_path));
  if (input->scans.empty())
    return fail(
        kConfigInvalid,
        fmt::format("{}: deviate compares scans; add a [[scan]] table with points = \"FILE\"",
                    case_path.string()));
  MAQUETTE_TRY(const auto design, heightmap::read_model_field(input->design));
  std::vector<scan::Region> regions;
  if (!input->regions.empty()) {
    MAQUETTE_TRY(regions, scan::read_regions(input->regions));
  }
  if (input->band_width_mm > 0.0)
    for (scan::Region& band : scan::band_regions(design, input->band_width_mm))
      regions.push_back(std::move(band));
  Measured all;
  for (const CaseScan& entry : input->scans)
    MAQUETTE_TRY_VOID(add_scan(all, entry, *input, design, run));
  const scan::Registration& first = all.used.front();
  const RigidTransform in_model;  // every cloud has been brought there above
  MAQUETTE_TRY(const auto deviation,
               scan::deviate(all.cloud, in_model, design, Millimetres{input->reach_mm}, run));
  const auto& points = all.cloud.points_mm;
  const auto& d = deviation.per_point_mm;
  const scan::Significance significance = scan::significance(points, d, &first);
  std::vector<scan::StoneFinding> stones;
  if (!input->stones.empty() && !input->ground.empty()) {
    MAQUETTE_TRY(const auto plan, meshing::read_stone_plan(input->stones));
    MAQUETTE_TRY(const auto ground, heightmap::read_model_field(input->ground));
    stones = scan::find_stones(points, ground, plan, deviation.statistics.nmad_mm, &first);
  }

  std::error_code ec;
  fs::create_directories(folder, ec);
  if (ec) return tl::unexpected(write_error(folder, ec.value()));
  JobResult result;
  const fs::path significant_png = folder / "significant.png";
  result.outputs = {folder / "summary.json",  folder / "deviation.tif", folder / "deviation.ply",
                    folder / "deviation.png", folder / "report.html",   significant_png};
  json summary = json::parse(scan::to_json(deviation.statistics, &first));
  summary["registrations"] = all.registrations;
  summary["datums"] = all.datums;
  summary["findings"] = findings_json(significance);
  summary["stones"] = stones_json(stones);
  summary["regions"] = regions_json(scan::judge_regions(points, d, regions, significance, &first));
  summary["budget"] = {
      {"contributions", json::array()}, {"combined_mm", 0.0}, {"expanded_mm", 0.0}};
  if (!significance.maps.empty()) {
    const scan::CellMap& cells = significance.maps.front();
    const scan::Budget budget = scan::budget_of(cells, &first, design);
    for (const scan::Contribution& c : budget.contributions)
      summary["budget"]["contributions"].push_back(
          {{"source", c.source}, {"u_mm", c.u_mm}, {"evaluation", c.evaluation}});
    summary["budget"]["combined_mm"] = budget.combined_mm;
    summary["budget"]["expanded_mm"] = budget.expanded_mm;
    summary["cell_mm"] = cells.cell_mm;
    summary["correlation_inflation"] = cells.inflation;
    summary["significant_share"] = cells.significant_share;
  }
  const scan::Texture texture = scan::texture_of(deviation.map_mm, design.spacing.value());
  summary["texture"] = {{"sa_mm", texture.sa_mm},    {"sq_mm", texture.sq_mm},
                        {"sz_mm", texture.sz_mm},    {"ssk", texture.ssk},
                        {"sku", texture.sku},        {"sdr", texture.sdr},
                        {"form_mm", texture.form_mm}};
  summary["dependences"] = json::array();
  for (const auto& [name, values] : {std::pair{"slope of the design, degrees", &all.slope_deg},
                                     {"angle of incidence, degrees", &all.incidence_deg},
                                     {"range, mm", &all.range_mm},
                                     {"intensity", &all.cloud.intensity}})
    if (const scan::Dependence on = scan::depend_on(name, *values, d); !on.points.empty())
      summary["dependences"].push_back(dependence_json(on));
  MAQUETTE_TRY_VOID(write_file(result.outputs[0], summary.dump(1)));
  MAQUETTE_TRY_VOID(heightmap::write_model_grid(deviation.map_mm, design, "mm", result.outputs[1]));
  all.cloud.intensity.clear();
  MAQUETTE_TRY_VOID(scan::write_deviation_ply(all.cloud, in_model, deviation, result.outputs[2]));
  const double limit = colour_limit(deviation.map_mm, 0.05);
  MAQUETTE_TRY_VOID(camera::write_png(signed_picture(deviation.map_mm, limit), result.outputs[3]));
  MAQUETTE_TRY_VOID(camera::write_png(signed_picture(significant_map(significance, design), limit),
                                      significant_png));
  MAQUETTE_TRY_VOID(write_deviation_page(deviation, design, summary.dump(), limit,
                                         result.outputs[3], significant_png, result.outputs[4]));
  // The histogram belongs to the figures: the run's own report draws it again.
  summary["histogram"] = deviation.histogram;
  summary["histogram_limit_mm"] = deviation.histogram_limit_mm;
  summary["colour_limit_mm"] = limit;
  result.figures_json = summary.dump();
  const auto& s = deviation.statistics;
  const auto off = std::count_if(stones.begin(), stones.end(), [](const scan::StoneFinding& f) {
    return f.state != scan::StoneState::as_planned && f.state != scan::StoneState::present &&
           f.state != scan::StoneState::unseen;
  });
  result.note =
      fmt::format("mean {:+.3f} mm, rms {:.3f} mm over {} points; {} significant patches{}",
                  s.mean_mm, s.rms_mm, s.points, significance.findings.size(),
                  stones.empty() ? "" : fmt::format(", {} stones not as planned", off));
  return result;
}

}  // namespace maquette::tools
