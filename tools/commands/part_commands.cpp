// SPDX-License-Identifier: GPL-3.0-or-later

// verify, backplot, export, render, deviate

#include <algorithm>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "cnc/machine.hpp"
#include "core/files.hpp"
#include "heightmap/field_io.hpp"
#include "tools/commands/commands.hpp"
#include "tools/jobs.hpp"
#include "tools/jobs_bands.hpp"
#include "tools/program_pictures.hpp"
#include "tools/tool_table.hpp"

namespace maquette::tools {
namespace {

std::optional<fs::path> given(const fs::path& path) {
  return path.empty() ? std::nullopt : std::optional(path);
}

}  // namespace

Command add_verify(CLI::App& root, const CommonOptions&) {
  struct Options {
    std::vector<fs::path> programs;
    fs::path design, out = "verify", stock, tools, stones, extended;
    std::string machine = "unlimited";
    AdjustmentFiles adjust;
    double base_mm = 10.0;
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
  app->add_option("--ball-diameter-mm", o->ball_mm, "of the one cutter, where there is no --tools")
      ->capture_default_str();
  app->add_option(
      "--tools", o->tools,
      "tool table (.toml, see docs/tool_table.md): T words are honoured, shank and holder "
      "looked at");
  app->add_option("--machine", o->machine,
                  fmt::format("its travel and its time: {}, or a .toml file",
                              fmt::join(cnc::machine_names(), ", ")))
      ->capture_default_str();
  app->add_option("--stones", o->stones,
                  "stones.json: stones that stand already, which no cutter may meet");
  app->add_option("--base-thickness-mm", o->base_mm, "from the table to the lowest point")
      ->capture_default_str();
  app->add_option("--cell-mm", o->cell_mm, "grid of the simulated stock")->capture_default_str();
  app->add_option("--stock", o->stock, "model field (.tif): what an earlier operation left");
  app->add_option("--stepover-mm", o->stepover_mm, "to compare excess with the scallop it states");
  app->add_option("--max-gouge-mm", o->max_gouge_mm,
                  "ends with exit code 1 if exceeded, bound included");
  app->add_option("--extended", o->extended,
                  "extended.toml of diagnose: as_built.tif is what its causes make of the cut");
  add_adjustment(*app, o->adjust, "programs are cut as by");
  return {app, [o](Console& console) -> Result<int> {
            VerifyJob job;
            job.programs = o->programs;
            job.design = o->design;
            job.stock = given(o->stock);
            job.stones = given(o->stones);
            job.stones_stand = job.stones.has_value();
            job.base_thickness = Millimetres{o->base_mm};
            if (!o->tools.empty()) {
              MAQUETTE_TRY(job.options.tools, read_tool_table(o->tools));
            }
            MAQUETTE_TRY(job.options.machine, cnc::find_machine(o->machine));
            job.options.ball_diameter = Millimetres{o->ball_mm};
            job.options.cell = Millimetres{o->cell_mm};
            job.options.stepover = Millimetres{o->stepover_mm};
            if (o->max_gouge_mm >= 0.0) job.max_gouge = Millimetres{o->max_gouge_mm};
            MAQUETTE_TRY(job.adjust, read_adjustment(o->adjust));
            if (job.adjust && !o->extended.empty())
              return fail(kUsage,
                          "--extended counts errors of the machine that --compensate and "
                          "--corrections count already; give one of them");
            if (!o->extended.empty()) job.extended = {o->extended, o->design, o->programs};
            return finish(console, "verify",
                          [&](const RunContext& run) { return verify_job(job, o->out, run); });
          }};
}

Command add_backplot(CLI::App& root, const CommonOptions&) {
  struct Options {
    std::vector<fs::path> programs;
    fs::path out = "backplot.svg", design, stock, tools;
    std::string colour = "feed";
    double ball_mm = 6.0;
  };
  auto o = std::make_shared<Options>();
  auto* app = root.add_subcommand(
      "backplot",
      "What any G-code does, seen from above (.svg, .png) or in three dimensions (.html).\n"
      "Example: maquette backplot part.ngc --out part.svg --colour height\n"
      "Example: maquette backplot band_*.ngc --design design.tif --out part.html");
  app->add_option("programs", o->programs, "G-code, all in one picture")->required();
  app->add_option("--out", o->out, ".svg, .png or .html")->capture_default_str();
  app->add_option("--colour", o->colour, "feed, height, or engagement (needs --design)")
      ->capture_default_str()
      ->check(CLI::IsMember(std::vector<std::string>{"feed", "height", "engagement"}));
  app->add_option("--design", o->design,
                  "model field (.tif): cut in simulation, for engagement and the ground of .html");
  app->add_option("--stock", o->stock, "model field (.tif): what an earlier operation left");
  app->add_option("--ball-diameter-mm", o->ball_mm, "of the one cutter, where there is no --tools")
      ->capture_default_str();
  app->add_option("--tools", o->tools,
                  "tool table (.toml, see docs/tool_table.md): each move is cut with its own tool");
  return {app, [o](Console& console) -> Result<int> {
            BackplotJob job;
            if (!o->tools.empty()) {
              MAQUETTE_TRY(job.tools, read_tool_table(o->tools));
            }
            job.programs = o->programs;
            job.design = given(o->design);
            job.stock = given(o->stock);
            job.ball_diameter = Millimetres{o->ball_mm};
            for (const auto colour : {cnc::BackplotColour::height, cnc::BackplotColour::engagement})
              if (o->colour == name(colour)) job.colour = colour;
            return finish(console, "backplot",
                          [&](const RunContext& run) { return backplot_job(job, o->out, run); });
          }};
}

Command add_export(CLI::App& root, const CommonOptions&) {
  struct Options {
    fs::path surface, out = "export", design, bands;
    std::vector<std::string> formats;
    ExportOptions options;
    double interval_mm = 5.0, step_tolerance_mm = 0.02;
  };
  auto o = std::make_shared<Options>();
  auto* app =
      root.add_subcommand("export",
                          "CAD files and render assets of a mesh or a designed surface.\n"
                          "Example: maquette export surface.ply --format stl,3mf,glb --out export\n"
                          "         maquette export design.tif --format step --step-tolerance-mm "
                          "0.05 --out cad");
  app->add_option("surface", o->surface, "mesh (PLY, STL, OBJ) or model field (.tif)")->required();
  app->add_option("--format", o->formats, fmt::format("{}", fmt::join(export_formats(), ", ")))
      ->delimiter(',')
      ->allow_extra_args(false)  // or a surface behind it would be taken for a format
      ->required();
  app->add_option("--out", o->out, "folder")->capture_default_str();
  app->add_option("--design", o->design, "model field for contours, STEP and the decimated level");
  app->add_option("--contour-interval-mm", o->interval_mm, "of dxf")->capture_default_str();
  app->add_option("--step-tolerance-mm", o->step_tolerance_mm, "of step, at the surface's nodes")
      ->capture_default_str();
  auto* even = app->add_option("--step-band-mm", o->options.step_band_mm,
                               "of step: a file for each of even bands not wider than that (0: one "
                               "file)")
                   ->capture_default_str()
                   ->check(CLI::Range(0.0, 1e6));
  app->add_option("--bands", o->bands,
                  "of step: bands.json of `maquette bands`, whose joints keep off stones: a file "
                  "for each of these")
      ->excludes(even);
  app->add_option("--step-schema", o->options.step_schema, "of step: ap242 or ap214")
      ->capture_default_str()
      ->check(CLI::IsMember({"ap214", "ap242"}));
  app->add_option("--position-bits", o->options.position_bits, "of glb")
      ->capture_default_str()
      ->check(CLI::Range(8, 24));
  app->add_option("--lod-triangles", o->options.lod_triangles, "of the decimated level")
      ->capture_default_str();
  app->add_option("--scale", o->options.scale_denominator, "N of 1:N, recorded in glb")
      ->capture_default_str();
  return {app, [o](Console& console) -> Result<int> {
            o->options.contour_interval = Millimetres{o->interval_mm};
            o->options.step_tolerance = Millimetres{o->step_tolerance_mm};
            for (const std::string& f : o->formats)
              if (std::find(export_formats().begin(), export_formats().end(), f) ==
                  export_formats().end())
                return fail(kUnknownFormat, fmt::format("--format {}: known formats are {}", f,
                                                        fmt::join(export_formats(), ", ")));
            if (!o->bands.empty()) {
              MAQUETTE_TRY(o->options.step_bands, read_band_layout(o->bands));
            }
            int code = 0;
            for (const std::string& f : o->formats) {
              MAQUETTE_TRY(
                  const int kept, finish(console, "export " + f, [&](const RunContext& run) {
                    return export_job(f, o->surface, given(o->design), o->options, o->out, run);
                  }));
              code = std::max(code, kept);
            }
            return code;
          }};
}

Command add_render(CLI::App& root, const CommonOptions&) {
  struct Options {
    fs::path scene, out = "picture.exr";
  };
  auto o = std::make_shared<Options>();
  auto* app = root.add_subcommand("render",
                                  "Pictures of a scene file: EXR (linear radiance, depth, normals, "
                                  "positions, angles, parts) and\n"
                                  "PNG; along a trajectory NAME_0001.exr and so on, going on where "
                                  "it was stopped. The keys of a\n"
                                  "scene are in docs/scene.md.\n"
                                  "Example: maquette render scene.toml --out picture.exr");
  app->add_option("scene", o->scene, "scene file")->required();
  app->add_option("--out", o->out, ".exr (with a PNG beside it) or .png")->capture_default_str();
  return {app, [o](Console& console) {
            return finish(console, "render",
                          [&](const RunContext& run) { return render_job(o->scene, o->out, run); });
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
