// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <set>
#include <span>
#include <utility>

#include <fmt/format.h>
#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "assets/devices.hpp"
#include "cnc/posts.hpp"
#include "core/files.hpp"
#include "heightmap/field_io.hpp"
#include "heightmap/source_files.hpp"
#include "tools/commands/commands.hpp"
#include "tools/jobs.hpp"
#include "tools/jobs_bands.hpp"
#include "tools/jobs_stone_parts.hpp"
#include "tools/jobs_stone_views.hpp"
#include "tools/machining_time.hpp"
#include "tools/milling.hpp"
#include "tools/operations.hpp"
#include "tools/report.hpp"
#include "tools/shape_of_site.hpp"
#include "tools/view/view_export.hpp"
#include "tools/view/view_page.hpp"

namespace maquette::tools {
namespace {

struct RunOptions {
  AdjustmentFiles adjust;
  fs::path site, out = "out";
  std::vector<std::string> set, stages;
  std::string shard;
  bool merge = false;
};

AdjustmentFiles adjustment_files(const Site& site) {
  return {site.compensate, site.corrections, site.corrections_for};
}

/// One operation of the site, with the defaults of its strategy where no key says otherwise.
MillJob mill_of(const Site& site, std::string_view strategy) {
  MillJob job = default_job(strategy);
  job.machine = *cnc::find_machine(site.machine);
  job.tolerance = Millimetres{site.tolerance_mm};
  job.direction = degrees(site.direction_deg);
  job.zigzag = site.zigzag;
  job.climb = site.climb;
  job.arcs = site.arcs;
  job.constant_scallop = site.constant_scallop;
  job.scallop_limit = Millimetres{site.scallop_limit_mm};
  if (site.excess_limit_mm > 0.0) job.excess_limit = Millimetres{site.excess_limit_mm};
  if (site.stated_stepover_mm > 0.0) job.stated_stepover = Millimetres{site.stated_stepover_mm};
  job.feed = FeedRate{site.feed_mm_per_min};
  job.plunge_feed = FeedRate{site.plunge_feed_mm_per_min};
  job.spindle_rpm = site.spindle_rpm;
  job.material = *cnc::find_material(site.material);
  job.clearance = Millimetres{site.clearance_mm};
  job.program.post = site.post;
  job.program.relative = site.relative;
  job.program.max_lines = static_cast<std::uint64_t>(site.max_lines);
  job.program.max_bytes = static_cast<std::uint64_t>(site.max_bytes);
  job.stock_margin = Millimetres{site.stock_margin_mm};
  job.base_thickness = Millimetres{site.base_thickness_mm};
  if (!site.spheres.empty()) job.spheres = site.spheres;
  if (strategy == "rough") {
    job.tool.cutter = cnc::Cutter::bull(0.5 * site.rough_diameter_mm, site.rough_corner_radius_mm);
    job.stepover_mm = site.rough_stepover_mm;
    job.step_down_mm = site.rough_step_down_mm;
    job.allowance_mm = site.rough_allowance_mm;
    job.ramp_deg = site.rough_ramp_deg;
    job.cell_mm = site.rough_cell_mm;
  } else if (strategy == "raster" || strategy == "semi-finish" || strategy == "waterline" ||
             strategy == "geodesic") {
    job.tool.cutter = cnc::Cutter::ball(0.5 * site.ball_diameter_mm);
    if (strategy == "raster" || strategy == "geodesic") job.stepover_mm = site.stepover_mm;
  }
  return job;
}

/// The passes whose scallop verify compares with; NaN: nothing leaves ridges.
Millimetres stated_stepover(const MillJob* finish) {
  if (finish == nullptr) return Millimetres{NAN};
  const bool as_cut = std::isnan(finish->stated_stepover.value()) || finish->strategy != "raster";
  return as_cut ? Millimetres{finish->stepover_mm} : finish->stated_stepover;
}

Result<std::vector<MillJob>> mill_jobs(const Site& site, const std::string& file) {
  return jobs_of(
      operations_of(site), [&](std::string_view strategy) { return mill_of(site, strategy); }, {},
      file);
}

/// The first part of a split program stands for all of them.
std::vector<fs::path> all_parts(std::span<const fs::path> programs, bool split) {
  std::vector<fs::path> all;
  for (const fs::path& program : programs)
    for (fs::path& part : split ? parts_of(program) : std::vector{program})
      all.push_back(std::move(part));
  return all;
}

/// As many bands as split_into_bands makes of a square surface of this size.
std::size_t even_band_count(const Site& site) {
  const double cells = std::round(site.size_mm / site.spacing_mm);
  const double cells_a_band = std::floor(site.band_max_width_mm / site.spacing_mm + 1e-9);
  return static_cast<std::size_t>(std::ceil(cells / std::max(1.0, cells_a_band)));
}

/// What all stages of one scale need of the site, and where its files are: they are named here and
/// only here.
struct ScaleStages {
  ScaleStages(const SiteFile& site_file, double denominator, const fs::path& run_folder)
      : file(site_file),
        site(*site_file.site),
        scale(denominator),
        name(scale_folder(denominator)),
        folder(run_folder),
        here(run_folder / name) {}

  [[nodiscard]] std::string values(std::vector<std::string> prefixes) const {
    for (const char* common : {"size_mm", "spacing_mm", "exaggeration", "seed"})
      prefixes.emplace_back(common);
    auto j = nlohmann::json::parse(file.schema.values_json(prefixes));
    j["scale"] = scale;
    return j.dump();
  }
  template <typename Work>
  [[nodiscard]] Stage single(const std::string& stage, std::vector<fs::path> inputs,
                             std::vector<std::string> prefixes, Work work) const {
    const std::string full = name + "." + stage;
    return Stage{full, {{full, std::move(inputs), values(std::move(prefixes)), std::move(work)}}};
  }

  const SiteFile& file;
  const Site& site;
  double scale;
  std::string name;
  fs::path folder, here;
  fs::path design = here / "design.tif", stones = here / "stones.json",
           surface = here / "surface.tif", mesh = here / "surface.ply",
           joints = here / "bands" / "bands.json", as_milled = here / "as_milled.tif",
           as_built = here / "as_built.tif", scene = here / "scene.toml";
};

/// Work offsets from the site's first one on, if each band has its own; else 0.
std::size_t most_bands(const Site& site) {
  return site.work_offset_per_band ? work_offsets_left(site) : 0;
}

Stage fuse_stage(const ScaleStages& s, const std::optional<WiderSurface>& wider,
                 const std::vector<SiteSource>& sources,
                 const std::vector<fs::path>& source_files) {
  std::vector<fs::path> fuse_inputs = source_files;
  if (wider)
    for (fs::path& f : wider->files()) fuse_inputs.push_back(std::move(f));
  return s.single("fuse", fuse_inputs,
                  {"body", "centre_", "fusion.", "source", "image", "stock.lowest_mm", "scales"},
                  [=, &site = s.site, scale = s.scale, here = s.here](const RunContext& run) {
                    return fuse_job(site, sources, scale, wider, here, run);
                  });
}

/// Stones, and the joints that keep off them: what says which other stages there are.
std::vector<Stage> stone_stages(const ScaleStages& s) {
  StoneSurfaces surfaces;
  for (const double scale : s.site.scales)
    surfaces.designs.push_back(s.folder / scale_folder(scale) / "design.tif");
  std::vector<fs::path> stone_inputs = surfaces.files(s.site, s.scale);
  for (const SiteStones& own : s.site.own_stones) stone_inputs.push_back(own.file);
  std::vector<Stage> stages;
  stages.push_back(
      s.single("stones", stone_inputs, {"stones.", "stone", "crater", "scales", "stock.lowest_mm"},
               [=, &site = s.site, scale = s.scale, here = s.here](const RunContext& run) {
                 return stones_job(site, scale, surfaces, here, run);
               }));
  BandLayoutJob layout;
  layout.design = s.design;
  layout.stones = s.stones;
  layout.avoid_stones = s.site.avoid_stones;
  layout.split.max_width = Millimetres{s.site.band_max_width_mm};
  layout.clearance = Millimetres{s.site.joint_clearance_mm};
  layout.base_thickness = Millimetres{s.site.base_thickness_mm};
  layout.in_joints = in_joints_of(s.site);
  layout.most_bands = most_bands(s.site);
  stages.push_back(s.single("stones.joints", {s.design, s.stones},
                            {"bands.", "stock.base", "mill.work_offset"},
                            [=, to = s.joints.parent_path()](const RunContext& run) {
                              return band_layout_job(layout, to, run);
                            }));
  return stages;
}

/// What follows once it is known where the joints are.
std::vector<Stage> stages_after_stones(const ScaleStages& s, const std::vector<MillJob>& operations,
                                       const std::optional<Adjustment>& adjust) {
  const Site& site = s.site;
  const double scale = s.scale;
  const std::string& name = s.name;
  const fs::path &here = s.here, &design = s.design, &stones = s.stones, &surface = s.surface,
                 &mesh = s.mesh, &joints = s.joints, &as_milled = s.as_milled,
                 &as_built = s.as_built, &scene = s.scene;
  const auto values = [&](std::vector<std::string> prefixes) {
    return s.values(std::move(prefixes));
  };
  const auto single = [&](const std::string& stage, std::vector<fs::path> inputs,
                          std::vector<std::string> prefixes, auto work) {
    return s.single(stage, std::move(inputs), std::move(prefixes), work);
  };
  std::vector<Stage> stages;
  stages.push_back(
      single("reach", {design}, {"reach.", "cutter.", "stock.base", "stock.margin"},
             [=, &site](const RunContext& run) { return reach_job(site, design, here, run); }));
  const ShapedJob whole_part{.design = design,
                             .stones = stones,
                             .base_thickness = Millimetres{site.base_thickness_mm},
                             .shape = shape_of(site, scale)};
  stages.push_back(
      single("mesh", {design, stones}, {"stock.", "solid."}, [=](const RunContext& run) {
        return whole_part.plain() ? mesh_job(design, stones, whole_part.base_thickness, mesh, run)
                                  : shaped_job(whole_part, mesh, run);
      }));

  // Not known yet: a stage that needs it is refused, for its input is not there.
  meshing::BandSplit split_bands{.max_width = Millimetres{site.band_max_width_mm}};
  if (auto known = read_band_layout(joints)) split_bands = *std::move(known);
  const std::size_t bands =
      split_bands.joints ? split_bands.joints->size() + 1 : even_band_count(site);
  const std::string extension(cnc::post_by_name(site.post)->extension);
  Stage band_stage{name + ".bands", {}};
  for (std::size_t b = 0; b < bands; ++b) {
    const fs::path solid = here / "bands" / fmt::format("band_{:02}.ply", b + 1);
    band_stage.units.push_back({fmt::format("{}.bands.band_{:02}", name, b + 1),
                                {design, joints},
                                values({"bands.dowel", "bands.magnet", "stock.", "solid."}),
                                [=, &site](const RunContext& run) {
                                  std::error_code ec;
                                  fs::create_directories(solid.parent_path(), ec);
                                  ShapedJob part = whole_part;
                                  part.stones.reset();
                                  part.band = BandOf{split_bands, b};
                                  part.in_joints = in_joints_of(site);
                                  if (!part.shape.label.empty())
                                    part.shape.label += fmt::format(" {}", b + 1);
                                  if (!part.plain()) return shaped_job(part, solid, run);
                                  return band_job(design, split_bands, b,
                                                  Millimetres{site.base_thickness_mm}, solid, run);
                                }});
  }
  stages.push_back(std::move(band_stage));

  // Operation by operation: bands side by side where a strategy can, else the whole surface, for
  // which a band's neighbour would stand in the way. Each starts from what the one before leaves.
  const auto parameters =
      values({"name", "cutter.", "rough.", "mill.", "machine.", "stock.", "operation"});
  const bool split = site.max_lines > 0 || site.max_bytes > 0;
  const std::vector<cnc::Tool> tools = tools_of(operations);
  std::vector<MillJob> into_design;
  for (const MillJob& operation : operations)
    if (cuts_into_design(operation)) {
      into_design.push_back(operation);
      into_design.back().stones = stones;
    }
  const fs::path machined = here / "machined.tif";
  const std::vector<fs::path> adjust_files = adjustment_files(site).files();
  const auto needs = [&](const MillJob& operation) {
    std::vector<fs::path> files{design};
    files.insert(files.end(), adjust_files.begin(), adjust_files.end());
    if (cuts_into_design(operation))
      files.push_back(operation.strategy == "sphere-seats" ? site.spheres : stones);
    return files;
  };
  if (!into_design.empty()) {
    std::vector<fs::path> inputs;
    for (const MillJob& operation : into_design)
      for (fs::path& input : needs(operation)) inputs.push_back(std::move(input));
    stages.push_back(single("machined", inputs, {"operation", "spheres."},
                            [=](const RunContext& run) -> Result<JobResult> {
                              run.progress(0.0);
                              return machined_job(into_design, design, machined);
                            }));
  }
  const MillJob* finish = finishing(operations);
  VerifyJob cut;
  std::vector<fs::path> finish_programs;
  std::optional<fs::path> stock;
  for (const MillJob& operation : operations) {
    const bool last = &operation == &operations.back();
    Stage stage{fmt::format("{}.mill.{}", name, operation.name), {}};
    std::vector<fs::path> inputs = needs(operation), programs;
    if (stock) inputs.push_back(*stock);
    const bool whole = !strategy_of(operation.strategy).in_bands;
    if (!whole) inputs.push_back(joints);
    for (std::size_t b = 0; b < (whole ? 1 : bands); ++b) {
      const std::string band = whole ? "" : fmt::format("band_{:02}", b + 1);
      programs.push_back(whole ? here / fmt::format("{}.{}", operation.name, extension)
                               : here / "bands" /
                                     fmt::format("{}.{}.{}", band, operation.name, extension));
      cut.bands.push_back(band);
      stage.units.push_back(
          {whole ? stage.name : fmt::format("{}.{}", stage.name, band), inputs, parameters,
           [=, &site, program = programs.back()](const RunContext& run) {
             std::error_code ec;
             fs::create_directories(program.parent_path(), ec);
             MillJob mill = operation;
             mill.design = design;
             mill.stones = stones;
             mill.stock = stock;
             mill.leave_stock = whole && !last;
             mill.adjust = adjust;
             if (!whole) {
               mill.bands = split_bands;
               mill.band = b;
             }
             mill.program.work_offset = work_offset_of(site, b);
             mill.program.name = fmt::format("{} 1:{:g} {}{}{}", site.name, scale, band,
                                             whole ? "" : " ", operation.name);
             return mill_job(mill, program, run);
           }});
    }
    stages.push_back(std::move(stage));
    cut.programs.insert(cut.programs.end(), programs.begin(), programs.end());
    // What a part is compared and diagnosed with, and what operations leave, is what was meant.
    if (adjust) std::transform(programs.begin(), programs.end(), programs.begin(), meant_of);
    if (&operation == finish) finish_programs = programs;
    if (last) break;
    const fs::path left = here / (operation.name + ".stock.tif");
    if (!whole) {
      std::vector<fs::path> before = programs;
      before.insert(before.end(), inputs.begin(), inputs.end());
      stages.push_back({fmt::format("{}.mill.{}.stock", name, operation.name),
                        {{fmt::format("{}.mill.{}.stock", name, operation.name), before, parameters,
                          [=, &site](const RunContext& run) {
                            return stock_job(all_parts(programs, split), tools, design, stock,
                                             Millimetres{site.stock_margin_mm}, left, run);
                          }}}});
    }
    stock = left;
  }

  if (!site.spheres.empty() && site.post == "linuxcnc")  // no other control writes contacts
    stages.push_back(single(
        "touch", {design, site.spheres}, {"name", "mill.", "machine.", "stock.", "spheres."},
        [=, &site, touch = here / fmt::format("touch.{}", extension)](const RunContext& run) {
          MillJob probe = mill_of(site, "probe-spheres");
          probe.design = design;
          probe.spheres = site.spheres;
          probe.leave_stock = false;
          probe.program.work_offset = work_offset_of(site, 0);
          probe.program.name = fmt::format("{} 1:{:g} touch", site.name, scale);
          return mill_job(probe, touch, run);
        }));

  // All of them in their order, each with its tool.
  cut.design = design;
  if (!into_design.empty()) cut.machined = machined;
  cut.options.machine = *cnc::find_machine(site.machine);
  cut.options.tools = tools;
  cut.options.finish_tool = finish == nullptr ? 0 : finish->tool.number;
  cut.stock_margin = Millimetres{site.stock_margin_mm};
  cut.base_thickness = Millimetres{site.base_thickness_mm};
  cut.stones = stones;
  cut.mesh = mesh;
  cut.options.cell = Millimetres{site.verify_cell_mm};
  cut.options.stepover = stated_stepover(finish);
  cut.max_gouge = Millimetres{site.max_gouge_mm};
  cut.adjust = adjust;
  std::vector<fs::path> verify_inputs{design, stones, mesh};
  verify_inputs.insert(verify_inputs.end(), adjust_files.begin(), adjust_files.end());
  if (cut.machined) verify_inputs.push_back(machined);
  verify_inputs.insert(verify_inputs.end(), cut.programs.begin(), cut.programs.end());
  const bool extended = !site.extended.empty();
  if (extended) verify_inputs.push_back(site.extended);
  const auto causes = [=, &site] {
    return Extended{site.extended, design, all_parts(finish_programs, split)};
  };
  stages.push_back(single("verify", verify_inputs,
                          {"cutter.", "rough.", "verify.", "mill.stepover", "mill.stated",
                           "mill.corrections", "machine.", "stock.", "operation"},
                          [=](const RunContext& run) {
                            VerifyJob job = cut;
                            job.programs.clear();
                            job.bands.clear();
                            for (std::size_t i = 0; i < cut.programs.size(); ++i)
                              for (fs::path& part : all_parts({&cut.programs[i], 1}, split)) {
                                job.programs.push_back(std::move(part));
                                job.bands.push_back(cut.bands[i]);
                              }
                            if (extended) job.extended = causes();
                            return verify_job(job, here, run);
                          }));

  Stage export_stage{name + ".export", {}};
  for (const std::string& format : site.export_formats)
    export_stage.units.push_back(
        {fmt::format("{}.export.{}", name, format),
         format == "step" ? std::vector<fs::path>{mesh, design, joints}
                          : std::vector<fs::path>{mesh, design},
         values({"export."}), [=, &site](const RunContext& run) {
           const ExportOptions options{scale,
                                       Millimetres{site.contour_interval_mm},
                                       site.lod_triangles,
                                       static_cast<int>(site.position_bits),
                                       Millimetres{site.step_tolerance_mm},
                                       site.step_schema,
                                       site.band_max_width_mm,
                                       split_bands};
           return export_job(format, mesh, design, options, here / "export", run);
         }});
  stages.push_back(std::move(export_stage));

  stages.push_back(single("render", {design, stones}, {"camera.", "lamp.", "surface."},
                          [=, &site](const RunContext& run) -> Result<JobResult> {
                            MAQUETTE_TRY_VOID(scene_job(site, design, stones, scene));
                            MAQUETTE_TRY(auto result, render_job(scene, here / "picture.exr", run));
                            result.outputs.push_back(scene);
                            return result;
                          }));

  stages.push_back(single("render.stones", {design, stones},
                          {"camera.samples", "lamp.", "surface."},
                          [=, &site](const RunContext& run) {
                            return stone_views_job(site, design, stones, here, run);
                          }));
  if (site.stone_parts && has_stones(site)) {
    const StonePartsJob parts{
        .stones = stones,
        .design = design,
        .clearance = Millimetres{site.part_clearance_mm},
        .wall = Millimetres{site.part_wall_mm},
        .volume = {{site.build_mm[0], site.build_mm[1], site.build_mm[2]}, site.part_spacing_mm},
        .paper = site.placing_paper,
        .bands = split_bands,
        .thin_is_unmet = false,
        .name = fmt::format("{} 1:{:g}", site.name, scale)};
    stages.push_back(single(
        "stone-parts", {design, stones, joints}, {"name", "stone_parts."},
        [=](const RunContext& run) { return stone_parts_job(parts, here / "stone_parts", run); }));
  }

  Stage scan_stage{name + ".scan", {}};
  std::vector<fs::path> scans;
  for (std::int64_t i = 0; i < site.stations; ++i) {
    const std::string station = fmt::format("scan_{:02}", i + 1);
    scans.push_back(here / (station + ".ply"));
    scan_stage.units.push_back(
        {fmt::format("{}.scan.{}", name, station),
         extended ? std::vector<fs::path>{as_built, stones, surface, site.extended}
                  : std::vector<fs::path>{as_milled, stones, surface},
         values({"scanner."}),
         [=, &site, out = scans.back()](const RunContext& run) -> Result<JobResult> {
           MAQUETTE_TRY(const auto field, heightmap::read_model_field(surface));
           ScanJob job;
           job.surface = as_milled;
           if (extended) {
             job.surface = as_built;
             job.as_built = true;
             job.extended = causes();
             job.first_scan = static_cast<std::size_t>(i);
           }
           job.stones = stones;
           MAQUETTE_TRY(job.scanner, find_scanner(site.scanner));
           if (auto* phase_shift = std::get_if<PhaseShiftScanner>(&job.scanner))
             phase_shift->footprint_rays = static_cast<int>(site.footprint_rays);
           job.stations_mm = {station_position(site, field, i)};
           job.max_points = static_cast<std::uint64_t>(site.max_points);
           job.seed = static_cast<std::uint64_t>(site.seed) + static_cast<std::uint64_t>(i);
           return scan_job(job, out, run);
         }});
  }
  stages.push_back(std::move(scan_stage));

  const double finish_ball_mm = finish == nullptr ? 0.0 : 2.0 * finish->tool.cutter.radius_mm;
  std::vector<fs::path> deviate_inputs{surface, as_milled};
  deviate_inputs.insert(deviate_inputs.end(), scans.begin(), scans.end());
  stages.push_back(single(
      "deviate", deviate_inputs, {"deviation.", "scanner.", "cutter.", "operation"},
      [=, &site](const RunContext& run) -> Result<JobResult> {
        Site of_case = site;
        if (finish_ball_mm > 0.0) of_case.ball_diameter_mm = finish_ball_mm;
        MAQUETTE_TRY(auto files, case_job(of_case, here, finish_programs, scans));
        MAQUETTE_TRY(auto result, deviate_job(here / "case.toml", here, run));
        result.outputs.insert(result.outputs.end(), files.outputs.begin(), files.outputs.end());
        return result;
      }));
  return stages;
}

std::string summary_table(std::span<const UnitRecord> records) {
  std::size_t width = 24;
  for (const UnitRecord& r : records) width = std::max(width, r.name.size());
  std::string text =
      fmt::format("{:<{}} {:>9} {:>9} {:>10}\n", "unit", width, "wall", "CPU", "memory");
  for (const UnitRecord& r : records)
    text += fmt::format("{:<{}} {:>9} {:>9} {:>10}  {}{}\n", r.name, width, human_seconds(r.wall_s),
                        human_seconds(r.cpu_s), human_bytes(r.peak_mib * 1048576.0), r.note,
                        r.reused ? " (was up to date)" : "");
  return text;
}

/// "mill" or "s200.mill" or "rough"
bool selected(const std::string& stage, const std::vector<std::string>& wanted) {
  return wanted.empty() || std::any_of(wanted.begin(), wanted.end(), [&](const std::string& w) {
           const std::string within = "." + stage + ".";
           return within.find("." + w + ".") != std::string::npos;
         });
}

constexpr const char* kPage = "view.html";

/// The page of `maquette view` with the run's surfaces and toolpaths inside, for the report to
/// link.
/// @return false: the program has no page, or what is there does not fit into one
Result<bool> export_page(Console& console, std::span<const UnitRecord> records,
                         const fs::path& folder) {
  constexpr double kMost_mb = 10.0;
  if (view_page().empty()) return false;
  const fs::path out = folder / kPage;
  const bool nothing_new =
      std::all_of(records.begin(), records.end(), [](const UnitRecord& r) { return r.reused; });
  if (nothing_new && fs::exists(out)) return true;
  const RunContext run = console.begin("view");
  const auto result = view_export_job(folder, out, view_page(), kMost_mb, run);
  console.end(result ? result->note : "failed");
  if (!result && result.error().code == kViewExportSmall) {
    console.warning(result.error().message);
    return false;
  }
  if (!result) return tl::unexpected(result.error());
  return true;
}

Result<int> run_site(const RunOptions& options, const CommonOptions& common, Console& console) {
  const bool sharded = !options.shard.empty();
  Shard shard;
  if (sharded) {
    MAQUETTE_TRY(shard, parse_shard(options.shard));
  }
  if (sharded && options.merge)
    return fail(kUsage, "--shard and --merge exclude each other: first every shard, then --merge");
  std::vector<std::string> set = options.set;
  const auto set_file = [&](const char* key, const fs::path& file) {
    if (!file.empty()) set.push_back(fmt::format("{}={}", key, fs::absolute(file).string()));
  };
  set_file("mill.compensate", options.adjust.compensation);
  set_file("mill.corrections", options.adjust.corrections);
  if (options.adjust.corrections_for != "this")
    set.push_back("mill.corrections_for=" + options.adjust.corrections_for);
  if (common.seed >= 0) set.push_back(fmt::format("seed={}", common.seed));
  MAQUETTE_TRY(const SiteFile file, read_site(options.site, set));
  const Site& site = *file.site;
  const fs::path folder = fs::absolute(options.out).lexically_normal();
  MAQUETTE_TRY(auto pipeline, Pipeline::open(folder, sharded, console));

  std::vector<SiteSource> sources(site.sources.begin(), site.sources.end());
  std::vector<fs::path> source_files;
  std::vector<Stage> stages;
  if (sources.empty()) {
    const fs::path products = folder / "products";
    stages.push_back({"products",
                      {{"products",
                        {},
                        file.schema.values_json(
                            {"body", "centre_", "size_mm", "scales", "fusion.synthetic_seed"}),
                        [&site, products](const RunContext& run) {
                          return products_job(site, products, run);
                        }}}});
    sources = embedded_sources(site, products);
    for (const char* end : {"_dtm.img", "_ldem.lbl", "_ldem.img"})
      source_files.push_back(products / ("synthetic_" + site.body + end));
  } else {
    for (const SiteSource& s : sources) {
      MAQUETTE_TRY(const auto files, heightmap::source_files(s.path));
      source_files.insert(source_files.end(), files.begin(), files.end());
    }
  }
  for (const SiteImage& i : site.images) {
    MAQUETTE_TRY(const auto files, heightmap::source_files(i.path));
    source_files.insert(source_files.end(), files.begin(), files.end());
  }
  MAQUETTE_TRY(const auto operations, mill_jobs(site, options.site.string()));
  MAQUETTE_TRY(auto adjust, read_adjustment(adjustment_files(site)));
  if (const MillJob* finish = finishing(operations); adjust && finish != nullptr)
    adjust->errors.tool = finish->tool.number;
  // All surfaces first: stones of the widest one lie as their section says. Then the stones, for
  // which bands there are follows from where joints keep off them.
  std::optional<WiderSurface> wider;
  std::vector<ScaleStages> scales;
  for (const double scale : site.scales) {
    scales.emplace_back(file, scale, folder);
    stages.push_back(fuse_stage(scales.back(), wider, sources, source_files));
    wider = WiderSurface{folder / scale_folder(scale), scale};
  }
  for (const ScaleStages& s : scales)
    for (Stage& stage : stone_stages(s)) stages.push_back(std::move(stage));
  const auto after_stones = [&] {
    std::vector<Stage> after;
    for (const ScaleStages& s : scales)
      for (Stage& stage : stages_after_stones(s, operations, adjust))
        after.push_back(std::move(stage));
    return after;
  };
  const auto is_selected = [&](const Stage& s) { return selected(s.name, options.stages); };
  if (const auto after = after_stones(); !options.stages.empty() &&
                                         std::none_of(stages.begin(), stages.end(), is_selected) &&
                                         std::none_of(after.begin(), after.end(), is_selected)) {
    std::set<std::string> names;
    for (const auto* part : {&std::as_const(stages), &after})
      for (const Stage& s : *part) names.insert(s.name.substr(s.name.find('.') + 1));
    return fail(kUsage, fmt::format("--stage {}: stages are {}", fmt::join(options.stages, ", "),
                                    fmt::join(names, ", ")));
  }
  for (const Stage& stage : stages)
    if (is_selected(stage)) MAQUETTE_TRY_VOID(pipeline.run(stage, shard));
  for (const Stage& stage : after_stones())
    if (is_selected(stage)) MAQUETTE_TRY_VOID(pipeline.run(stage, shard));

  const auto& records = pipeline.records();
  const bool whole = options.stages.empty() && !sharded;
  if (whole) {
    MAQUETTE_TRY_VOID(write_manifest(file, records, options.site, folder / "manifest.json"));
    MAQUETTE_TRY(const bool seen, export_page(console, records, folder));
    MAQUETTE_TRY_VOID(write_run_page(site, records, folder, folder / "report.html",
                                     seen ? std::string(kPage) : std::string()));
  }
  console.result(summary_table(records));
  nlohmann::json times{{"machining_time", nlohmann::json::array()}};
  for (const UnitRecord& r : records) {
    if (r.name.find(".verify") == std::string::npos) continue;
    const auto figures = nlohmann::json::parse(r.figures_json);
    for (nlohmann::json row : figures.value("machining_time", nlohmann::json::array())) {
      row["program"] = r.name.substr(0, r.name.find('.')) + "/" + row.value("program", "");
      times["machining_time"].push_back(std::move(row));
    }
  }
  if (const std::string table = machining_time_table(times); !table.empty())
    console.result("\n" + table + "\n");
  int code = 0;
  nlohmann::json report{{"out", folder.string()}};
  for (const UnitRecord& r : records) {
    report["units"].push_back({{"name", r.name},
                               {"reused", r.reused},
                               {"wall_s", r.wall_s},
                               {"figures", nlohmann::json::parse(r.figures_json)}});
    if (r.unmet.empty()) continue;
    console.error(fmt::format("{}: {}", r.name, r.unmet));
    report["unmet"].push_back(r.name + ": " + r.unmet);
    code = 1;
  }
  console.json_result(report.dump(1));
  if (whole)
    console.result(
        fmt::format("Results are in {0}\n  report    {0}/report.html\n  manifest  "
                    "{0}/manifest.json",
                    folder.string()));
  return code;
}

}  // namespace

Command add_run(CLI::App& root, const CommonOptions& common) {
  auto o = std::make_shared<RunOptions>();
  auto* app = root.add_subcommand(
      "run",
      "The whole chain of a site file: surface, mesh, toolpath, simulated cut, files, "
      "pictures, the stones' parts, deviation.\nExample: maquette run site.toml --out out --set "
      "size_mm=400");
  app->add_option("site", o->site, "site file (maquette init writes one)")->required();
  app->add_option("--out", o->out, "folder for the results")->capture_default_str();
  app->add_option("--set", o->set, "key=value, overrides the site file (repeatable)")
      ->allow_extra_args(false);
  add_adjustment(*app, o->adjust, "programs are written for");
  app->add_option(
         "--stage", o->stages,
         "only this stage (repeatable); what it needs must be there: fuse, mill, s200.mill")
      ->allow_extra_args(false);
  app->add_option("--shard", o->shard,
                  "i/n: only every n-th unit (band, station, file) of each stage, starting at the "
                  "i-th; several shards may share the folder");
  app->add_flag("--merge", o->merge,
                "after all shards: takes their results, does what is missing, writes the report");
  return {app, [o, &common](Console& console) { return run_site(*o, common, console); }};
}

}  // namespace maquette::tools
