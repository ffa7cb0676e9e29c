// SPDX-License-Identifier: GPL-3.0-or-later

// mill, verify, export, render, compare, scan, deviate

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "assets/devices.hpp"
#include "cnc/machine.hpp"
#include "cnc/posts.hpp"
#include "core/files.hpp"
#include "heightmap/field_io.hpp"
#include "tools/commands/commands.hpp"
#include "tools/jobs.hpp"

namespace maquette::tools {
namespace {

std::optional<fs::path> given(const fs::path& path) {
  return path.empty() ? std::nullopt : std::optional(path);
}

template <class Preset>
Result<Preset> preset(const std::vector<Preset>& presets, const std::string& kind,
                      const std::string& name) {
  if (auto found = assets::find_preset(presets, name)) return *found;
  std::vector<std::string> names;
  for (const Preset& p : presets) names.push_back(p.name);
  const std::string near = nearest_name(name, names);
  return fail(kUnknownName,
              fmt::format("no {} is called '{}'; known: {}{}", kind, name, fmt::join(names, ", "),
                          near.empty() ? "" : fmt::format("; did you mean '{}'?", near)));
}

}  // namespace

Command add_mill(CLI::App& root, const CommonOptions&) {
  struct Options {
    fs::path design, out = "part.ngc", stock;
    double ball_mm = 6.0, stepover_mm = 0.5, tolerance_mm = 0.01, feed = 3000.0, plunge = 600.0,
           spindle = 18000.0, clearance_mm = 5.0, direction_deg = 0.0, scallop_limit_mm = 0.011,
           lead_mm = 1.0, allowance_mm = 0.5;
    double rough_mm = 12.0, corner_mm = 1.0, rough_stepover_mm = 6.0, step_down_mm = 5.0,
           cell_mm = 1.0, ramp_deg = 3.0, stock_top_mm = NAN;
    std::string strategy = "raster", post = "linuxcnc", machine, name = "maquette";
    bool one_way = false, conventional = false, constant_scallop = false, no_arcs = false;
    int work_offset = 54, tool = 0;
    std::uint64_t max_lines = 0, max_bytes = 0;
  };
  auto o = std::make_shared<Options>();
  auto* app = root.add_subcommand(
      "mill",
      "G-code with a proof: a finishing pass that would cut deeper than its tolerance keeps the "
      "name <out>.rejected.\n"
      "Example: maquette mill design.tif --out part.ngc --stepover-mm 0.5\n"
      "Example: maquette mill design.tif --strategy rough --rough-diameter-mm 12 --out rough.ngc");
  app->add_option("design", o->design, "model field (.tif, mm)")->required();
  app->add_option("--out", o->out, "program; parts of a split one are numbered")
      ->capture_default_str();
  app->add_option("--strategy", o->strategy,
                  "raster: parallel finishing passes of a ball; rough: level by level")
      ->capture_default_str()
      ->check(CLI::IsMember(mill_strategies()));
  app->add_option("--ball-diameter-mm", o->ball_mm, "")->capture_default_str();
  app->add_option("--stepover-mm", o->stepover_mm, "in plan")->capture_default_str();
  app->add_option("--tolerance-mm", o->tolerance_mm, "of the written path, all causes together")
      ->capture_default_str();
  app->add_option("--direction-deg", o->direction_deg, "of the passes, counter-clockwise from +x")
      ->capture_default_str();
  app->add_flag("--one-way", o->one_way, "all passes in one direction instead of zig-zag");
  app->add_flag("--conventional", o->conventional, "one way: conventional instead of climb");
  app->add_flag("--constant-scallop", o->constant_scallop,
                "more passes where it is steep, so that ridges stay below --scallop-limit-mm");
  app->add_option("--scallop-limit-mm", o->scallop_limit_mm, "normal to the surface")
      ->capture_default_str();
  app->add_flag("--no-arcs", o->no_arcs, "lines only");
  app->add_option("--lead-radius-mm", o->lead_mm, "of quarter circles in and out; 0: none")
      ->capture_default_str();
  app->add_option("--stock", o->stock,
                  "model field (.tif): what an earlier operation left, such as <rough>.stock.tif");
  app->add_option("--allowance-mm", o->allowance_mm, "rough: what it leaves")
      ->capture_default_str();
  app->add_option("--rough-diameter-mm", o->rough_mm, "of the roughing cutter")
      ->capture_default_str();
  app->add_option("--rough-corner-mm", o->corner_mm, "its corner radius; 0: flat")
      ->capture_default_str();
  app->add_option("--rough-stepover-mm", o->rough_stepover_mm, "")->capture_default_str();
  app->add_option("--step-down-mm", o->step_down_mm, "rough: between levels")
      ->capture_default_str();
  app->add_option("--ramp-deg", o->ramp_deg, "rough: steepest way down in material")
      ->capture_default_str();
  app->add_option("--rough-cell-mm", o->cell_mm, "rough: grid it is planned on")
      ->capture_default_str();
  app->add_option("--stock-top-mm", o->stock_top_mm,
                  "rough: top of the block (default: 1 mm above the highest point)");
  app->add_option("--feed-mm-per-min", o->feed, "")->capture_default_str();
  app->add_option("--plunge-feed-mm-per-min", o->plunge, "")->capture_default_str();
  app->add_option("--spindle-rpm", o->spindle, "")->capture_default_str();
  app->add_option("--clearance-mm", o->clearance_mm, "of rapid moves above what they fly over")
      ->capture_default_str();
  app->add_option("--post", o->post, "dialect: " + cnc::post_names())->capture_default_str();
  app->add_option("--work-offset", o->work_offset, "54 to 59; 591 to 593 for G59.1 to G59.3")
      ->capture_default_str();
  app->add_option("--max-lines", o->max_lines, "of one file; longer programs are split; 0: any")
      ->capture_default_str();
  app->add_option("--max-bytes", o->max_bytes, "the same in bytes")->capture_default_str();
  app->add_option("--machine", o->machine,
                  "name or .toml file; its travel is checked; none: not checked");
  app->add_option("--name", o->name, "in the program's header")->capture_default_str();
  return {app, [o](Console& console) -> Result<int> {
            MillJob job;
            job.design = o->design;
            job.strategy = o->strategy;
            cnc::MillOptions& m = job.finish;
            m.ball_diameter = Millimetres{o->ball_mm};
            m.stepover = Millimetres{o->stepover_mm};
            m.tolerance = Millimetres{o->tolerance_mm};
            m.direction = degrees(o->direction_deg);
            m.zigzag = !o->one_way;
            m.climb = !o->conventional;
            m.constant_scallop = o->constant_scallop;
            m.scallop_limit = Millimetres{o->scallop_limit_mm};
            m.arcs = !o->no_arcs;
            m.lead_radius = Millimetres{o->lead_mm};
            m.feed = FeedRate{o->feed};
            m.plunge_feed = FeedRate{o->plunge};
            m.spindle_rpm = o->spindle;
            m.clearance = Millimetres{o->clearance_mm};
            m.post = o->post;
            m.program_name = o->name;
            m.work_offset = o->work_offset;
            m.max_lines = o->max_lines;
            m.max_bytes = o->max_bytes;
            job.rough.cutter = cnc::Cutter::bull(0.5 * o->rough_mm, o->corner_mm);
            job.rough.allowance_mm = o->allowance_mm;
            job.stock = given(o->stock);
            job.rough.stepover_mm = o->rough_stepover_mm;
            job.rough.step_down_mm = o->step_down_mm;
            job.rough.cell_mm = o->cell_mm;
            job.rough.ramp_angle_deg = o->ramp_deg;
            job.stock_top = Millimetres{o->stock_top_mm};
            if (!o->machine.empty()) {
              MAQUETTE_TRY(const auto machine, cnc::find_machine(o->machine));
              m.travel_x = Millimetres{machine.travel_mm.x};
              m.travel_y = Millimetres{machine.travel_mm.y};
              m.travel_z = Millimetres{machine.travel_mm.z};
            }
            return finish(console, "mill",
                          [&](const RunContext& run) { return mill_job(job, o->out, run); });
          }};
}

Command add_verify(CLI::App& root, const CommonOptions&) {
  struct Options {
    std::vector<fs::path> programs;
    fs::path design, out = "verify", stock;
    double ball_mm = 6.0, cell_mm = 0.1, max_gouge_mm = -1.0, stepover_mm = NAN;
  };
  auto o = std::make_shared<Options>();
  auto* app = root.add_subcommand(
      "verify",
      "Reads G-code back, cuts with it in simulation, compares with the design: "
      "certificate.json, as_milled.tif.\n"
      "Example: maquette verify part.ngc --design design.tif --out verify");
  app->add_option("programs", o->programs, "G-code, several bands in order")->required();
  app->add_option("--design", o->design, "model field (.tif, mm)")->required();
  app->add_option("--out", o->out, "folder")->capture_default_str();
  app->add_option("--ball-diameter-mm", o->ball_mm, "")->capture_default_str();
  app->add_option("--cell-mm", o->cell_mm, "grid of the simulated stock")->capture_default_str();
  app->add_option("--stock", o->stock, "model field (.tif): what an earlier operation left");
  app->add_option("--stepover-mm", o->stepover_mm, "to compare excess with the scallop it states");
  app->add_option("--max-gouge-mm", o->max_gouge_mm,
                  "ends with exit code 1 if exceeded, bound included");
  return {app, [o](Console& console) {
            VerifyJob job;
            job.programs = o->programs;
            job.design = o->design;
            job.stock = given(o->stock);
            job.options.ball_diameter = Millimetres{o->ball_mm};
            job.options.cell = Millimetres{o->cell_mm};
            job.options.stepover = Millimetres{o->stepover_mm};
            if (o->max_gouge_mm >= 0.0) job.max_gouge = Millimetres{o->max_gouge_mm};
            return finish(console, "verify",
                          [&](const RunContext& run) { return verify_job(job, o->out, run); });
          }};
}

Command add_export(CLI::App& root, const CommonOptions&) {
  struct Options {
    fs::path surface, out = "export", design;
    std::vector<std::string> formats;
    ExportOptions options;
    double interval_mm = 5.0;
  };
  auto o = std::make_shared<Options>();
  auto* app =
      root.add_subcommand("export",
                          "CAD files and render assets of a mesh or a designed surface.\n"
                          "Example: maquette export surface.ply --format stl,3mf,glb --out export");
  app->add_option("surface", o->surface, "mesh (PLY, STL, OBJ) or model field (.tif)")->required();
  app->add_option("--format", o->formats, fmt::format("{}", fmt::join(export_formats(), ", ")))
      ->delimiter(',')
      ->required();
  app->add_option("--out", o->out, "folder")->capture_default_str();
  app->add_option("--design", o->design, "model field for contours and the decimated level");
  app->add_option("--contour-interval-mm", o->interval_mm, "of dxf")->capture_default_str();
  app->add_option("--position-bits", o->options.position_bits, "of glb")
      ->capture_default_str()
      ->check(CLI::Range(8, 24));
  app->add_option("--lod-triangles", o->options.lod_triangles, "of the decimated level")
      ->capture_default_str();
  app->add_option("--scale", o->options.scale_denominator, "N of 1:N, recorded in glb")
      ->capture_default_str();
  return {app, [o](Console& console) -> Result<int> {
            o->options.contour_interval = Millimetres{o->interval_mm};
            for (const std::string& f : o->formats)
              if (std::find(export_formats().begin(), export_formats().end(), f) ==
                  export_formats().end())
                return fail(kUnknownFormat, fmt::format("--format {}: known formats are {}", f,
                                                        fmt::join(export_formats(), ", ")));
            for (const std::string& f : o->formats)
              MAQUETTE_TRY_VOID(finish(console, "export " + f, [&](const RunContext& run) {
                return export_job(f, o->surface, given(o->design), o->options, o->out, run);
              }));
            return 0;
          }};
}

Command add_render(CLI::App& root, const CommonOptions&) {
  struct Options {
    fs::path scene, out = "picture.exr";
  };
  auto o = std::make_shared<Options>();
  auto* app = root.add_subcommand(
      "render",
      "Picture of a scene file: EXR (linear radiance, depth in mm, lit mask) and PNG.\n"
      "Example: maquette render scene.toml --out picture.exr");
  app->add_option("scene", o->scene, "scene file")->required();
  app->add_option("--out", o->out, ".exr (with a PNG beside it) or .png")->capture_default_str();
  return {app, [o](Console& console) {
            return finish(console, "render",
                          [&](const RunContext& run) { return render_job(o->scene, o->out, run); });
          }};
}

Command add_compare(CLI::App& root, const CommonOptions&) {
  struct Options {
    fs::path real, rendered, out = "compare";
  };
  auto o = std::make_shared<Options>();
  auto* app = root.add_subcommand("compare",
                                  "Photograph against rendering: compare.json, difference.png.\n"
                                  "Example: maquette compare photo.png picture.exr --out compare");
  app->add_option("real", o->real, "photograph")->required();
  app->add_option("rendered", o->rendered, "rendering")->required();
  app->add_option("--out", o->out, "folder")->capture_default_str();
  return {app, [o](Console& console) {
            return finish(console, "compare", [&](const RunContext& run) {
              return compare_job(o->real, o->rendered, o->out, run);
            });
          }};
}

Command add_scan(CLI::App& root, const CommonOptions& common) {
  struct Options {
    fs::path surface, out = "scan.ply", stones;
    std::string scanner = "zf5006h";
    std::vector<double> station_mm;
    std::uint64_t max_points = 1'000'000;
  };
  auto o = std::make_shared<Options>();
  auto* app = root.add_subcommand(
      "scan",
      "A simulated laser scan of a surface.\n"
      "Example: maquette scan as_milled.tif --stones stones.json --out scan.ply");
  app->add_option("surface", o->surface, "model field (.tif) or mesh")->required();
  app->add_option("--out", o->out, "PLY point cloud")->capture_default_str();
  app->add_option("--stones", o->stones, "stones.json of `maquette stones`");
  app->add_option("--scanner", o->scanner, "preset")->capture_default_str();
  app->add_option("--station-mm", o->station_mm, "x y z of the scanner; default: south of the part")
      ->expected(3);
  app->add_option("--max-points", o->max_points, "angular steps are widened to stay below")
      ->capture_default_str();
  return {app, [o, &common](Console& console) -> Result<int> {
            scan::ScanOptions options;
            MAQUETTE_TRY(options.scanner, preset(assets::scanner_presets(), "scanner", o->scanner));
            options.max_points = o->max_points;
            options.seed = common.seed >= 0 ? static_cast<std::uint64_t>(common.seed) : 1;
            MAQUETTE_TRY(const Box3 box, surface_bounds(o->surface));
            if (o->station_mm.empty()) {
              // South of the part, half its depth above it: all of it is seen obliquely.
              const double depth = box.max.y - box.min.y;
              options.station_mm = {0.5 * (box.min.x + box.max.x), box.min.y - 0.75 * depth - 500.0,
                                    box.max.z + depth + 500.0};
            } else {
              options.station_mm = {o->station_mm[0], o->station_mm[1], o->station_mm[2]};
            }
            return finish(console, "scan", [&](const RunContext& run) {
              return scan_job(o->surface, given(o->stones), options, o->out, run);
            });
          }};
}

Command add_deviate(CLI::App& root, const CommonOptions&) {
  struct Options {
    fs::path case_file, out = "deviation";
  };
  auto o = std::make_shared<Options>();
  auto* app = root.add_subcommand(
      "deviate",
      "Measured scans against the design: summary.json, deviation.tif, deviation.ply, "
      "report.html.\nExample: maquette deviate case.toml --out deviation");
  app->add_option("case", o->case_file, "case file")->required();
  app->add_option("--out", o->out, "folder")->capture_default_str();
  return {app, [o](Console& console) {
            return finish(console, "deviate", [&](const RunContext& run) {
              return deviate_job(o->case_file, o->out, run);
            });
          }};
}

}  // namespace maquette::tools
