// SPDX-License-Identifier: GPL-3.0-or-later

// Scans against the design: poses, deviations, what of them is more than noise, and the report.

#include <algorithm>
#include <cmath>
#include <optional>
#include <span>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "camera/image_io.hpp"
#include "core/files.hpp"
#include "core/run_part.hpp"
#include "heightmap/field_io.hpp"
#include "scan/deviate.hpp"
#include "scan/find_objects.hpp"
#include "scan/find_stones.hpp"
#include "scan/joint_pose.hpp"
#include "scan/profiles.hpp"
#include "scan/regions.hpp"
#include "scan/significance.hpp"
#include "scan/statistics.hpp"
#include "scan/worst_places.hpp"
#include "tools/corrections_file.hpp"
#include "tools/deviation_page.hpp"
#include "tools/deviation_rows.hpp"
#include "tools/jobs.hpp"
#include "tools/jobs_bands.hpp"
#include "tools/measured_part.hpp"
#include "tools/nominal_part.hpp"
#include "tools/path_under.hpp"
#include "tools/pictures.hpp"
#include "tools/scene_file.hpp"

namespace maquette::tools {
using heightmap::ModelField;
using nlohmann::json;
namespace {

/// Of the time, what reading and registration take; most of the rest is following beams.
constexpr double kReading = 0.2;

/// The deviation where its cell is significant, zero where it is not, on the design's nodes.
Grid<float> significant_map(const scan::Significance& s, const ModelField& design) {
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

/// Figures of the deviation from what the part must come out as, and of what that is.
json expected_json(const scan::DeviationStatistics& s, const NominalPart& nominal,
                   const Case& input) {
  Grid<float> known(nominal.design.z_mm.rows(), nominal.design.z_mm.cols());
  for (std::ptrdiff_t r = 0; r < known.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < known.cols(); ++c)
      known(r, c) = nominal.expected->z_mm(r, c) - nominal.design.z_mm(r, c);
  const scan::DeviationStatistics k = scan::summarize(known.cells());
  return {{"as_milled", input.as_milled.filename().string()},
          {"coating_mm", input.coating_thickness_mm},
          {"known_mean_mm", k.mean_mm},
          {"known_max_mm", k.max_mm},
          {"mean_mm", s.mean_mm},
          {"rms_mm", s.rms_mm},
          {"sigma_mm", s.sigma_mm},
          {"nmad_mm", s.nmad_mm},
          {"p05_mm", s.p05_mm},
          {"p95_mm", s.p95_mm}};
}

Result<std::vector<scan::Region>> regions_of(const Case& input, const ModelField& design,
                                             std::span<const meshing::PlacedStone> stones) {
  std::vector<scan::Region> regions;
  if (!input.regions.empty()) {
    MAQUETTE_TRY(regions, scan::read_regions(input.regions));
  }
  // Stones have their own table of poses; here is how far each is off as a whole.
  for (scan::Region& stone : scan::stone_regions(stones)) regions.push_back(std::move(stone));
  std::optional<meshing::BandSplit> split;
  if (input.band_width_mm > 0.0) split = {.max_width = Millimetres{input.band_width_mm}};
  if (!input.bands.empty()) {
    MAQUETTE_TRY(split, read_band_layout(input.bands));
  }
  if (split) {
    MAQUETTE_TRY(const auto bands, scan::band_regions(design, *split));
    regions.insert(regions.end(), bands.begin(), bands.end());
  }
  return regions;
}

/// All that is found out about the part, before anything is written.
struct Comparison {
  std::vector<scan::StoneFinding> stones;
  std::vector<scan::ExtraObject> objects;
  std::optional<BeamFigures> beam;  // none: all were rays
  json expected;                    // null: nothing was expected beside the design
  scan::MeshDeviation deviation;
  /// Regions are judged by the design, as a customer draws them; findings are what nobody
  /// expected.
  scan::Significance by_design;
  std::optional<scan::Significance> by_expected;
  bool fitted_again = false;  ///< without what was found
  [[nodiscard]] const scan::Significance& findings() const {
    return by_expected ? *by_expected : by_design;
  }
};

std::vector<scan::ExtraObject> objects_on(const MeasuredPart& all, const NominalPart& nominal,
                                          const Comparison& c) {
  // Beside planned stones, or where one of them is missing.
  std::vector<int> missing;
  for (const scan::StoneFinding& f : c.stones)
    if (f.state == scan::StoneState::missing) missing.push_back(f.number);
  const bool bare = nominal.ground && !nominal.stone_plan.empty();
  return scan::find_objects(all.cloud.points_mm, bare ? *nominal.ground : nominal.to_meet(),
                            nominal.stone_plan, missing, c.deviation.statistics.nmad_mm);
}

scan::Significance significance_of(const MeasuredPart& all, const scan::Deviation& deviation,
                                   const heightmap::ModelField& surface) {
  const std::vector<Vec3> moved = all.seen_at.empty() ? std::vector<Vec3>{} : places_of(all);
  const auto& places = all.seen_at.empty() ? all.cloud.points_mm : moved;
  const std::span<const float> slopes =
      all.slope_deg.size() == places.size() ? all.slope_deg : std::span<const float>{};
  double beam = 0.0, points = 0.0;
  for (const scan::Viewpoint& v : all.views) {
    beam += static_cast<double>(v.points) * v.beam_diameter_mm;
    points += static_cast<double>(v.points);
  }
  return scan::significance(places, deviation.per_point_mm, all.scans, 0.0, slopes, &surface,
                            points > 0.0 ? beam / points : 0.0);
}

/// Where the points lie, how far off, and what of it is significant.
Result<void> judge(Comparison& c, const MeasuredPart& all, const NominalPart& nominal,
                   const Case& input, const RunContext& run) {
  const RigidTransform in_model;  // every cloud has been brought there
  const Millimetres reach{input.reach_mm};
  if (nominal.mesh) {
    MAQUETTE_TRY(c.deviation,
                 scan::deviate(all.cloud, in_model, *nominal.to_mesh, nominal.design, reach, run));
  } else {
    MAQUETTE_TRY(static_cast<scan::Deviation&>(c.deviation),
                 scan::deviate(all.cloud, in_model, nominal.design, reach, run));
  }
  c.by_design = significance_of(all, c.deviation, nominal.design);
  if (nominal.expected) {
    MAQUETTE_TRY(const auto from_expected,
                 scan::deviate(all.cloud, in_model, *nominal.expected, reach, run));
    c.by_expected = significance_of(all, from_expected, *nominal.expected);
    c.expected = expected_json(from_expected.statistics, nominal, input);
  }
  return {};
}

/// Points before their beams are taken into account, mixed ones included: stones are compared with
/// what a beam makes of them. Without what their edges have mixed, noise would decide which points
/// count, and stones come out too large.
struct AsMeasured {
  std::vector<Vec3> points_mm;
  std::vector<scan::Viewpoint> views;
  std::vector<std::size_t> of_view;  ///< its scan; none where no stones are asked for
  void follow(std::span<const RigidTransform> steps) {
    std::size_t i = 0;
    for (std::size_t v = 0; v < views.size(); ++v) {
      const RigidTransform& step = steps[of_view[v]];
      if (views[v].station_mm) views[v].station_mm = step.point(*views[v].station_mm);
      for (const std::size_t end = i + views[v].points; i < end; ++i)
        points_mm[i] = step.point(points_mm[i]);
    }
  }
};

/// Best fits are made again without what stands out, if anything does.
Result<void> fit_again(Comparison& c, MeasuredPart& all, AsMeasured& before,
                       const NominalPart& nominal, const Case& input, const RunContext& run) {
  const auto& findings = c.findings().findings;
  // Of a pose on datums as above, and a part that lies off as a whole has no rest.
  if (!all.part.empty() || nominal.mesh || findings.empty() || findings.front().whole_part)
    return {};
  const auto search = [&]() -> Result<scan::Significance> {
    const heightmap::ModelField& surface = nominal.expected ? *nominal.expected : nominal.design;
    MAQUETTE_TRY(const auto deviation,
                 scan::deviate(all.cloud, {}, surface, Millimetres{input.reach_mm}, run));
    return significance_of(all, deviation, surface);
  };
  MAQUETTE_TRY(const auto steps,
               fit_without_findings(all, nominal.to_meet(), c.findings(), search, run));
  before.follow(steps);
  c.fitted_again = true;
  return judge(c, all, nominal, input, run);
}

AsMeasured as_measured(const MeasuredPart& all) {
  AsMeasured m{all.cloud.points_mm, all.views, scans_of_views(all)};
  const auto add = [](auto& to, const auto& more) {
    to.insert(to.end(), more.begin(), more.end());
  };
  add(m.points_mm, all.mixed.points_mm);
  add(m.views, all.mixed.views);
  add(m.of_view, all.mixed.scan_of_view);
  return m;
}

Result<void> compare(Comparison& c, MeasuredPart& all, const NominalPart& nominal,
                     const Case& input, const RunContext& run) {
  const double noise = scan::joint_pose(all.scans).noise_mm;
  // Of stones before what the beam does to the surface as it is expected is taken out: one that has
  // moved is not where it is expected.
  AsMeasured before;
  if (nominal.ground) before = as_measured(all);
  if (!nominal.mesh) {  // of any shape: its upper side does not say what a beam meets
    MAQUETTE_TRY(c.beam, take_out_beams(all, nominal, noise, part(run, 0.0, 0.6)));
  }
  // Only now do points lie where their beams' middles meet the part, under overhangs or not.
  MAQUETTE_TRY_VOID(leave_out_overhung(all, nominal, input, noise));
  // Nor were best fits made to such points. A pose on datums is nobody's to change.
  if (c.beam && all.part.empty() && !input.scale) {
    MAQUETTE_TRY(const auto steps, fit_without_beams(all, nominal.to_meet(), part(run, 0.6, 0.7)));
    before.follow(steps);
  }
  MAQUETTE_TRY_VOID(judge(c, all, nominal, input, part(run, 0.7, 0.8)));
  MAQUETTE_TRY_VOID(fit_again(c, all, before, nominal, input, part(run, 0.8, 0.9)));
  if (nominal.ground) {
    const scan::Registration joint = scan::joint_pose(all.scans);
    MAQUETTE_TRY(c.stones, scan::find_stones(before.points_mm, before.views, *nominal.ground,
                                             nominal.stone_plan, joint.noise_mm, &joint));
  }
  c.objects = objects_on(all, nominal, c);
  return {};
}

/// What deviations go with: surface, instrument, and the program's path where there is one.
Result<json> dependences_of(const MeasuredPart& all, const NominalPart& nominal, const Case& input,
                            const std::vector<float>& d, const RunContext& run) {
  PathUnder path;
  if (!input.gcode.empty() && !nominal.mesh) {
    MAQUETTE_TRY(path, path_under(input.gcode, nominal.ground ? *nominal.ground : nominal.design,
                                  0.5 * input.ball_diameter_mm, all.cloud.points_mm, run));
  }
  json rows = json::array();
  for (const auto& [name, values] : {std::pair{"slope of the design, degrees", &all.slope_deg},
                                     {"angle of incidence, degrees", &all.incidence_deg},
                                     {"range, mm", &all.range_mm},
                                     {"intensity", &all.cloud.intensity},
                                     {"order of the path, m", &path.order_m},
                                     {"direction of feed, degrees", &path.direction_deg},
                                     {"feed, mm/min", &path.feed_mm_min}}) {
    if (values->size() != d.size()) continue;
    const scan::Dependence on = scan::depend_on(name, *values, d);
    if (on.points.size() > 1) rows.push_back(dependence_json(on));
  }
  return rows;
}

/// Deviations along the lines of the case.
json profiles_of(const MeasuredPart& all, const Comparison& c, const Case& input,
                 const ModelField& design, const scan::Registration& joint) {
  const auto& maps = c.by_design.maps;
  const double inflation = maps.empty() ? 1.0 : maps.back().inflation;
  json rows = json::array();
  for (const CaseProfile& line : input.profiles)
    rows.push_back(profile_json(scan::profile_along(all.cloud.points_mm, c.deviation.per_point_mm,
                                                    {line.name,
                                                     {line.from_mm[0], line.from_mm[1], 0.0},
                                                     {line.to_mm[0], line.to_mm[1], 0.0},
                                                     line.width_mm,
                                                     line.step_mm},
                                                    design, inflation, &joint)));
  return rows;
}

/// The farthest from the design. Cells of the finest map hold a few points each: those of the next
/// say more than their noise.
json worst_of(const scan::Significance& s, std::span<const scan::Finding> findings) {
  constexpr std::size_t kMost = 12;
  if (s.maps.empty()) return json::array();
  const scan::CellMap& map = s.maps[std::min<std::size_t>(1, s.maps.size() - 1)];
  json worst = worst_places_json(scan::worst_places(map, kMost, 4.0 * map.cell_mm, findings));
  return {{"cell_mm", map.cell_mm}, {"places", worst}};
}

/// What can be said of part and axes as a whole: none without datums and axes.
Result<std::optional<Corrections>> find_corrections(const MeasuredPart& all, const Case& input,
                                                    const ModelField& design) {
  if (all.part.empty() && input.axes.empty()) return std::nullopt;
  Corrections corrections;
  if (!all.part.empty()) corrections = corrections_of(all, design);
  for (const CaseAxis& axis : input.axes) {
    MAQUETTE_TRY(const auto fit, read_axis_stops(axis.stops));
    corrections.axes.push_back({axis.name, fit});
  }
  return corrections;
}

/// Where each scan was taken from, in the model frame, and how it saw the part.
json stations_json(const MeasuredPart& all) {
  json rows = json::array();
  const std::vector<std::size_t> of_view = scans_of_views(all);
  std::size_t i = 0;
  for (std::size_t k = 0; k < all.views.size(); ++k) {
    const scan::Viewpoint& v = all.views[k];
    const ScanFigures& f = all.figures[of_view[k]];
    json row = {{"points", f.name}, {"points_compared", v.points}, {"mixed", f.mixed}};
    if (v.beam_diameter_mm > 0.0) row["beam_diameter_mm"] = v.beam_diameter_mm;
    if (v.station_mm && v.points > 0) {
      row["at_mm"] = {v.station_mm->x, v.station_mm->y, v.station_mm->z};
      const auto of = [&](const std::vector<float>& values) {
        float least = INFINITY, most = -INFINITY;
        for (const float value : std::span(values).subspan(i, v.points))
          least = std::fmin(least, value), most = std::fmax(most, value);  // NaN: beside the part
        return json{least, most};
      };
      row["range_mm"] = of(all.range_mm);
      row["incidence_deg"] = of(all.incidence_deg);
    }
    rows.push_back(std::move(row));
    i += v.points;
  }
  return rows;
}

/// summary.json, but for what needs the case's other files.
json summary_of(const MeasuredPart& all, const Comparison& c, const NominalPart& nominal,
                const std::vector<scan::Region>& regions, const scan::Registration& joint) {
  const ModelField& design = nominal.design;
  json summary =
      json::parse(scan::to_json(c.deviation.statistics, &all.scans.front().registration));
  if (!c.expected.is_null()) summary["expected"] = c.expected;
  summary["at_rim"] = all.at_rim;
  if (!nominal.stone_plan.empty()) summary["under_overhangs"] = all.overhung;
  if (all.passed_over > 0) summary["passed_over"] = all.passed_over;
  if (c.beam)
    summary["beam"] = {{"rms_mm", c.beam->rms_mm},
                       {"largest_mm", c.beam->largest_mm},
                       {"at_edges", c.beam->at_edges}};
  summary["registrations"] = summary["datums"] = summary["spheres"] = json::array();
  for (const ScanFigures& f : all.figures) {
    json row = registration_row(f.best, f.name);
    row["mixed_points_taken_out"] = f.mixed;
    row["points_passed_over"] = f.passed_over;
    row["points_used"] = f.used;
    summary["registrations"].push_back(std::move(row));
    if (f.on_datums) summary["datums"].push_back(datum_row(*f.on_datums, f.absorbed, f.name));
    if (f.spheres) summary["spheres"].push_back(sphere_row(*f.spheres, f.spheres_found, f.name));
  }
  summary["findings"] = findings_json(c.findings());
  summary["detection_limits"] = limits_json(c.findings());
  double beam = 0.0;
  for (const scan::Viewpoint& v : all.views) beam = std::fmax(beam, v.beam_diameter_mm);
  summary["stones"] = stones_json(c.stones, beam);
  summary["objects"] = objects_json(c.objects);
  summary["regions"] = regions_json(scan::judge_regions(
      all.cloud.points_mm, c.deviation.per_point_mm, regions, c.by_design, &joint));
  summary["fitted_without_findings"] = c.fitted_again;
  summary["stations"] = stations_json(all);
  summary["worst"] = worst_of(c.by_design, c.findings().findings);
  summary["budget"] = budget_json({});
  if (!c.findings().maps.empty()) {
    const scan::CellMap& cells = c.findings().maps.front();
    summary["budget"] = budget_json(scan::budget_of(cells, &joint, design));
    summary["cell_mm"] = cells.cell_mm;
    summary["correlation_inflation"] = cells.inflation;
    summary["significant_share"] = cells.significant_share;
  }
  summary["texture"] = texture_json(scan::texture_of(c.deviation.map_mm, design.spacing.value()));
  return summary;
}

std::string note_of(const Comparison& c) {
  const auto& s = c.deviation.statistics;
  const auto off = std::count_if(c.stones.begin(), c.stones.end(), [](const scan::StoneFinding& f) {
    return f.state != scan::StoneState::as_planned && f.state != scan::StoneState::present &&
           f.state != scan::StoneState::unseen && f.state != scan::StoneState::unclear;
  });
  const auto unclear = std::count_if(
      c.stones.begin(), c.stones.end(),
      [](const scan::StoneFinding& f) { return f.state == scan::StoneState::unclear; });
  std::string stones;
  if (!c.stones.empty()) stones = fmt::format(", {} stones not as planned", off);
  if (unclear > 0) stones += fmt::format(", {} unclear", unclear);
  return fmt::format("mean {:+.3f} mm, rms {:.3f} mm over {} points; {} significant patches{}",
                     s.mean_mm, s.rms_mm, s.points, c.findings().findings.size(), stones);
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
  NominalPart nominal;  // its search tree points at its mesh: it stays where it is
  MAQUETTE_TRY_VOID(read_nominal(nominal, *input, run));
  const ModelField& design = nominal.design;
  MAQUETTE_TRY(const auto regions, regions_of(*input, design, nominal.stone_plan));
  MeasuredPart all;
  const double scans = static_cast<double>(input->scans.size());
  for (const CaseScan& entry : input->scans) {
    const double done = kReading * static_cast<double>(all.scans.size()) / scans;
    MAQUETTE_TRY_VOID(
        add_scan(all, entry, *input, nominal, part(run, done, done + kReading / scans)));
  }
  if (all.cloud.points_mm.empty())
    return fail(scan::kTooFewPoints,
                "every point lies within half a beam of the part's rim: is "
                "beam_diameter_mm in mm?");
  if (all.passed_over > 0)
    run.warn(fmt::format("an even share of the points is compared; {} are passed over",
                         all.passed_over));
  Comparison c;
  MAQUETTE_TRY_VOID(compare(c, all, nominal, *input, part(run, kReading, 0.98)));
  const scan::Registration joint = scan::joint_pose(all.scans);
  json summary = summary_of(all, c, nominal, regions, joint);
  summary["profiles"] = profiles_of(all, c, *input, design, joint);
  MAQUETTE_TRY(
      summary["dependences"],
      dependences_of(all, nominal, *input, c.deviation.per_point_mm, part(run, 0.98, 1.0)));

  std::error_code ec;
  fs::create_directories(folder, ec);
  if (ec) return tl::unexpected(write_error(folder, ec.value()));
  JobResult result;
  const fs::path significant_png = folder / "significant.png";
  result.outputs = {folder / "summary.json",  folder / "deviation.tif", folder / "deviation.ply",
                    folder / "deviation.png", folder / "report.html",   significant_png};
  MAQUETTE_TRY(const auto corrections, find_corrections(all, *input, design));
  if (corrections) {
    summary["corrections"] = corrections_json(*corrections);
    result.outputs.push_back(folder / "corrections.toml");
    MAQUETTE_TRY_VOID(write_file(result.outputs.back(), corrections_text(*corrections)));
  }
  MAQUETTE_TRY_VOID(write_file(result.outputs[0], summary.dump(1)));
  MAQUETTE_TRY_VOID(
      heightmap::write_model_grid(c.deviation.map_mm, design, "mm", result.outputs[1]));
  all.cloud.intensity.clear();
  MAQUETTE_TRY_VOID(scan::write_deviation_ply(all.cloud, {}, c.deviation, result.outputs[2]));
  if (nominal.mesh) {
    result.outputs.push_back(folder / "deviation_mesh.ply");
    MAQUETTE_TRY_VOID(
        scan::write_deviation_mesh(*nominal.mesh, c.deviation, result.outputs.back()));
  }
  const double limit = colour_limit(c.deviation.map_mm, 0.05);
  MAQUETTE_TRY_VOID(
      camera::write_png(signed_picture(c.deviation.map_mm, limit, &design), result.outputs[3]));
  MAQUETTE_TRY_VOID(camera::write_png(
      signed_picture(significant_map(c.findings(), design), limit, &design), significant_png));
  result.outputs.push_back(folder / "report.pdf");
  MAQUETTE_TRY_VOID(write_deviation_report(c.deviation, design, summary.dump(), limit,
                                           result.outputs[3], significant_png, result.outputs[4],
                                           result.outputs.back()));
  // The histogram belongs to the figures: the run's own report draws it again.
  summary["histogram"] = c.deviation.histogram;
  summary["histogram_limit_mm"] = c.deviation.histogram_limit_mm;
  summary["colour_limit_mm"] = limit;
  result.figures_json = summary.dump();
  result.note = note_of(c);
  return result;
}

}  // namespace maquette::tools
