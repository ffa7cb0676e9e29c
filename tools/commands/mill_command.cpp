// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "cnc/mill.hpp"
#include "cnc/posts.hpp"
#include "cnc/verify.hpp"
#include "tools/commands/commands.hpp"
#include "tools/milling.hpp"
#include "tools/operations.hpp"
#include "tools/tool_table.hpp"

namespace maquette::tools {
namespace fs = std::filesystem;
namespace {

struct Options {
  AdjustmentFiles adjust;
  fs::path design, out = "part.ngc", stock, stones, spheres, tools, operations, standing_stones;
  std::string strategy = "raster", machine = "unlimited", material;
  // NaN: as the strategy has it
  double diameter_mm = NAN, corner_mm = NAN, stepover_mm = NAN, step_down_mm = NAN,
         allowance_mm = NAN;
  double direction_deg = 0.0;
  bool one_way = false, conventional = false, no_arcs = false;
  int tool = 0;
  MillJob job = default_job("raster");  // defaults of all strategies
  double tolerance_mm = job.tolerance.value(), feed = job.feed.value(),
         plunge = job.plunge_feed.value(), clearance_mm = job.clearance.value(),
         scallop_limit_mm = job.scallop_limit.value(), excess_limit_mm = NAN,
         stated_stepover_mm = NAN, overrun_mm = NAN, lead_mm = job.lead_radius.value(),
         stock_top_mm = NAN, base_mm = job.base_thickness.value();
};

std::vector<std::string> names() {
  std::vector<std::string> all;
  for (const Strategy& s : strategies()) all.emplace_back(s.name);
  return all;
}

std::string table() {
  std::string text = "what to mill:";
  for (const Strategy& s : strategies()) text += fmt::format("\n  {:<12} {}", s.name, s.does);
  return text;
}

/// "raster 0.5, rough 6": what the strategies take where nothing is given.
std::string defaults(double Strategy::*of) {
  std::string text;
  for (const Strategy& s : strategies())
    if (!std::isnan(s.*of))
      text += fmt::format("{}{} {:g}", text.empty() ? "" : ", ", s.name, s.*of);
  return " (default: " + text + ")";
}
std::string default_diameters() {
  std::string text;
  for (const Strategy& s : strategies())
    text += fmt::format("{}{} {:g}", text.empty() ? "" : ", ", s.name, 2.0 * s.cutter.radius_mm);
  return " (default: " + text + ")";
}

Result<cnc::Tool> tool_of_table(const fs::path& file, int number) {
  MAQUETTE_TRY(const auto tools, read_tool_table(file));
  std::vector<int> numbers;
  for (const cnc::Tool& tool : tools) {
    if (tool.number == number) return tool;
    numbers.push_back(tool.number);
  }
  return fail(cnc::kToolNotInTable,
              fmt::format("{}: has no tool {}; it has {}; choose one with --tool", file.string(),
                          number, fmt::join(numbers, ", ")));
}

/// What all operations have in common, with a strategy's own defaults.
Result<MillJob> common_job(const Options& o, std::string_view strategy) {
  MillJob job = o.job;
  const MillJob preset = default_job(strategy);
  job.strategy = job.name = preset.strategy;
  job.tool = preset.tool;
  job.stepover_mm = preset.stepover_mm;
  job.step_down_mm = preset.step_down_mm;
  job.allowance_mm = preset.allowance_mm;
  job.design = o.design;
  if (!o.stock.empty()) job.stock = o.stock;
  if (!o.stones.empty()) job.stones = o.stones;
  if (!o.spheres.empty()) job.spheres = o.spheres;
  if (!o.standing_stones.empty()) job.standing_stones = o.standing_stones;
  job.tolerance = Millimetres{o.tolerance_mm};
  job.direction = degrees(o.direction_deg);
  job.zigzag = !o.one_way;
  job.climb = !o.conventional;
  job.arcs = !o.no_arcs;
  job.scallop_limit = Millimetres{o.scallop_limit_mm};
  job.excess_limit = Millimetres{o.excess_limit_mm};
  job.stated_stepover = Millimetres{o.stated_stepover_mm};
  job.overrun = Millimetres{o.overrun_mm};
  job.lead_radius = Millimetres{o.lead_mm};
  job.feed = FeedRate{o.feed};
  job.plunge_feed = FeedRate{o.plunge};
  job.clearance = Millimetres{o.clearance_mm};
  job.stock_top = Millimetres{o.stock_top_mm};
  job.base_thickness = Millimetres{o.base_mm};
  MAQUETTE_TRY(job.adjust, read_adjustment(o.adjust));
  MAQUETTE_TRY(job.machine, cnc::find_machine(o.machine));
  if (!o.material.empty()) {
    if (o.machine == "unlimited")
      return fail(kUsage, "--material needs --machine: its spindle and axes decide the feed too");
    MAQUETTE_TRY(job.material, cnc::find_material(o.material));
  }
  return job;
}

Result<MillJob> job_of(const Options& o) {
  MAQUETTE_TRY(MillJob job, common_job(o, o.strategy));
  const bool ball = job.tool.cutter.is_ball();
  if (o.tool > 0) job.tool.number = o.tool;
  if (!o.tools.empty()) {
    if (!std::isnan(o.diameter_mm) || !std::isnan(o.corner_mm))
      return fail(kUsage,
                  "--tools says what the cutter is; --diameter-mm and --corner-mm do not go "
                  "with it");
    MAQUETTE_TRY(job.tool, tool_of_table(o.tools, job.tool.number));
    if (ball && !job.tool.cutter.is_ball())
      return fail(kUsage, fmt::format("tool {} ({}) is no ball; {} is milled with one",
                                      job.tool.number, job.tool.name, o.strategy));
  }
  cnc::Cutter& cutter = job.tool.cutter;
  if (!std::isnan(o.diameter_mm)) cutter.radius_mm = 0.5 * o.diameter_mm;
  if (ball) cutter.corner_radius_mm = cutter.radius_mm;
  if (!std::isnan(o.corner_mm)) {
    if (ball)
      return fail(kUsage, fmt::format("--corner-mm: {} is milled with a ball; only roughing takes "
                                      "another cutter",
                                      o.strategy));
    cutter.corner_radius_mm = o.corner_mm;
  }
  if (!(cutter.radius_mm > 0.0))
    return fail(cnc::kToolNotPositive,
                fmt::format("the cutter's diameter is {} mm; it must be greater than 0",
                            2.0 * cutter.radius_mm));
  const auto pick = [](double& value, double given) {
    if (!std::isnan(given)) value = given;
  };
  pick(job.stepover_mm, o.stepover_mm);
  pick(job.step_down_mm, o.step_down_mm);
  pick(job.allowance_mm, o.allowance_mm);
  return job;
}

/// One job an operation of the file; what differs between them is said there alone.
Result<std::vector<MillJob>> operations_of(const Options& o, const CLI::App& app) {
  for (const char* option : {"--strategy", "--diameter-mm", "--corner-mm", "--tool",
                             "--stepover-mm", "--step-down-mm", "--allowance-mm"})
    if (app.count(option) > 0)
      return fail(kUsage, fmt::format("{} does not go with --operations: say it in {}", option,
                                      o.operations.string()));
  MAQUETTE_TRY(const auto operations, read_operations(o.operations));
  std::vector<cnc::Tool> table;
  if (!o.tools.empty()) {
    MAQUETTE_TRY(table, read_tool_table(o.tools));
  }
  MAQUETTE_TRY(const MillJob checked, common_job(o, operations.front().strategy));
  return jobs_of(
      operations, [&](std::string_view strategy) { return *common_job(o, strategy); }, table,
      o.operations.string());
}

}  // namespace

void add_adjustment(CLI::App& app, AdjustmentFiles& files, const std::string& what) {
  app.add_option("--compensate", files.compensation,
                 fmt::format("compensation.toml of diagnose: {} a machine with these errors "
                             "(docs/compensation.md)",
                             what));
  app.add_option(
      "--corrections", files.corrections,
      fmt::format("corrections.toml of deviate: {} a part, and axes x, y, z, that really "
                  "are there",
                  what));
  app.add_option("--corrections-for", files.corrections_for,
                 "this: the part lies there still; next: the machine will displace the next one as "
                 "this")
      ->capture_default_str()
      ->check(CLI::IsMember({"this", "next"}));
}

Command add_mill(CLI::App& root, const CommonOptions&) {
  auto o = std::make_shared<Options>();
  MillJob& job = o->job;
  auto* app = root.add_subcommand(
      "mill",
      "G-code with a proof: a program that would cut deeper than its tolerance keeps the name "
      "<out>.rejected.\n"
      "Example: maquette mill design.tif --out part.ngc --stepover-mm 0.5\n"
      "Example: maquette mill design.tif --out part.ngc --stepover-mm 0.4 --stated-stepover-mm 0.5 "
      "--excess-limit-mm 0.01\n"
      "Example: maquette mill design.tif --strategy rough --diameter-mm 12 --out rough.ngc\n"
      "Example: maquette mill design.tif --strategy seats --stones stones.json --out seats.ngc\n"
      "Example: maquette mill design.tif --operations operations.toml --out part.ngc");
  app->add_option("design", o->design, "model field (.tif, mm)")->required();
  app->add_option("--out", o->out, "program; parts of a split one are numbered")
      ->capture_default_str();
  app->add_option("--strategy", o->strategy, table())
      ->capture_default_str()
      ->check(CLI::IsMember(names()));
  app->add_option("--operations", o->operations,
                  "instead: several in one program with tool changes (.toml, docs/operations.md)");
  app->add_option("--diameter-mm", o->diameter_mm, "of the cutter" + default_diameters());
  app->add_option("--corner-mm", o->corner_mm, "rough: the cutter's corner radius; 0: flat");
  app->add_option("--tool", o->tool, "T word (default: one for each kind of cutter)");
  app->add_option("--tools", o->tools, "tool table (.toml) with the cutter of that number");
  app->add_option("--base-thickness-mm", o->base_mm, "from the table to the lowest point")
      ->capture_default_str();
  app->add_option("--stepover-mm", o->stepover_mm,
                  "between passes, in plan" + defaults(&Strategy::stepover_mm));
  app->add_option("--step-down-mm", o->step_down_mm,
                  "between levels; rest and seats: in one go" + defaults(&Strategy::step_down_mm));
  app->add_option("--allowance-mm", o->allowance_mm,
                  "what rough and semi-finish leave; else what stands above the design at most" +
                      defaults(&Strategy::allowance_mm));
  app->add_option("--tolerance-mm", o->tolerance_mm, "of the written path, all causes together")
      ->capture_default_str();
  app->add_option("--stock", o->stock,
                  "model field (.tif): what an earlier operation left, such as <rough>.stock.tif");
  app->add_option("--stones", o->stones, "seats, outlines: stones.json of `maquette stones`");
  app->add_option("--standing-stones", o->standing_stones,
                  "stones.json: they stand already; a program whose cutter, shank or holder meets "
                  "them is rejected");
  app->add_option("--spheres", o->spheres,
                  "sphere-seats, probe-spheres: reference spheres (.toml, docs/spheres.md)");
  app->add_option("--direction-deg", o->direction_deg, "of the passes, counter-clockwise from +x")
      ->capture_default_str();
  app->add_flag("--one-way", o->one_way, "all passes in one direction instead of zig-zag");
  app->add_flag("--conventional", o->conventional, "one way: conventional instead of climb");
  app->add_flag("--constant-scallop", job.constant_scallop,
                "passes where ridges would exceed --scallop-limit-mm, wherever it is steep");
  app->add_option("--excess-limit-mm", o->excess_limit_mm,
                  "above the scallop stated for the slope and what the ball cannot take away: cuts "
                  "across to pits and creases between passes, each a stop");
  app->add_option(
      "--stated-stepover-mm", o->stated_stepover_mm,
      "the passes whose scallop that limit counts from; closer ones (--stepover-mm 0.4) "
      "need fewer cuts across (default: as --stepover-mm)");
  app->add_option(
      "--overrun-mm", o->overrun_mm,
      "raster: how far passes go beyond the outline, where ground that falls outwards is "
      "touched from; at most 0.6 of the ball's radius (default: as that ground wants it)");
  app->add_option("--scallop-limit-mm", o->scallop_limit_mm, "normal to the surface")
      ->capture_default_str();
  app->add_flag("--no-arcs", o->no_arcs, "lines only");
  app->add_option("--lead-radius-mm", o->lead_mm, "of quarter circles in and out; 0: none")
      ->capture_default_str();
  app->add_option("--least-slope-deg", job.least_slope_deg, "waterline: where it is steeper")
      ->capture_default_str();
  app->add_option("--ball-before-mm", job.ball_before_diameter_mm,
                  "rest: diameter of the ball whose rest is taken")
      ->capture_default_str();
  app->add_option("--gap-mm", job.gap_mm, "seats: room around a stone")->capture_default_str();
  app->add_option("--bed-mm", job.bed_mm, "seats: room under a stone")->capture_default_str();
  app->add_option("--mark-depth-mm", job.mark_depth_mm, "outlines")->capture_default_str();
  app->add_option("--ramp-deg", job.ramp_deg, "rough: steepest way down in material")
      ->capture_default_str();
  app->add_option("--cell-mm", job.cell_mm, "rough: grid it is planned on")->capture_default_str();
  app->add_option("--stock-top-mm", o->stock_top_mm,
                  "rough, probe: top of the block (default: 1 mm above the highest point)");
  app->add_option("--material", o->material,
                  fmt::format("feeds and spindle from the chip it stands: {}, or a .toml file",
                              fmt::join(cnc::material_names(), ", ")));
  app->add_option("--feed-mm-per-min", o->feed,
                  "instead of the material's; without both 3000. Refused above the machine's");
  app->add_option("--plunge-feed-mm-per-min", o->plunge, "the same; without both 600");
  app->add_option("--spindle-rpm", job.spindle_rpm, "the same; without both 18000");
  app->add_option("--clearance-mm", o->clearance_mm, "of rapid moves above what they fly over")
      ->capture_default_str();
  app->add_option("--machine", o->machine,
                  fmt::format("its limits and its time: {}, or a .toml file",
                              fmt::join(cnc::machine_names(), ", ")))
      ->capture_default_str();
  app->add_option("--post", job.program.post, "dialect: " + cnc::post_names())
      ->capture_default_str();
  app->add_option("--work-offset", job.program.work_offset,
                  "54 to 59; 591 to 593 for G59.1 to G59.3")
      ->capture_default_str();
  app->add_option("--max-lines", job.program.max_lines,
                  "of one file; longer programs are split; 0: any")
      ->capture_default_str();
  app->add_option("--max-bytes", job.program.max_bytes, "the same in bytes")->capture_default_str();
  app->add_flag(
      "--relative", job.program.relative,
      "cuts by how far they go (G91): up to a quarter fewer bytes; LinuxCNC, Fanuc, Haas");
  add_adjustment(*app, o->adjust, "programs are written for");
  app->add_option("--name", job.program.name, "in the program's header")->capture_default_str();
  return {app, [o, app](Console& console) -> Result<int> {
            if (!o->operations.empty()) {
              MAQUETTE_TRY(auto jobs, operations_of(*o, *app));
              // Length and radius that were found are those of the cutter that finished.
              if (const MillJob* last = finishing(jobs); last != nullptr)
                for (MillJob& one : jobs)
                  if (one.adjust) one.adjust->errors.tool = last->tool.number;
              return finish(console, "mill", [&](const RunContext& run) {
                return mill_operations_job(jobs, o->out, run);
              });
            }
            MAQUETTE_TRY(const MillJob whole, job_of(*o));
            return finish(console, "mill",
                          [&](const RunContext& run) { return mill_job(whole, o->out, run); });
          }};
}

Command add_spheres(CLI::App& root, const CommonOptions&) {
  struct Given {
    fs::path contacts, spheres, out = "datums.toml";
    double probe_mm = 2.0;
  };
  auto o = std::make_shared<Given>();
  auto* app = root.add_subcommand(
      "spheres",
      "Where reference spheres are, from the touches that a program of mill --strategy "
      "probe-spheres has had written: datums for a case file.\n"
      "Example: maquette spheres probe.contacts.txt --spheres spheres.toml --out datums.toml");
  app->add_option("contacts", o->contacts, "one line a touch: x y z of the probe's tip, mm")
      ->required();
  app->add_option("--spheres", o->spheres, "that were probed (.toml, docs/spheres.md)")->required();
  app->add_option("--probe-diameter-mm", o->probe_mm, "of the probe's ball")
      ->capture_default_str()
      ->check(CLI::Range(0.2, 40.0));
  app->add_option("--out", o->out, "[[datum]] tables (.toml)")->capture_default_str();
  return {app, [o](Console& console) -> Result<int> {
            return finish(console, "spheres", [&](const RunContext&) {
              return probed_spheres_job(o->contacts, o->spheres, 0.5 * o->probe_mm, o->out);
            });
          }};
}

}  // namespace maquette::tools
