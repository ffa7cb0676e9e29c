// SPDX-License-Identifier: GPL-3.0-or-later

// diagnose compensate detectability

#include <CLI/CLI.hpp>

#include "tools/commands/commands.hpp"
#include "tools/compensate.hpp"
#include "tools/jobs.hpp"

namespace maquette::tools {

Command add_diagnose(CLI::App& root, const CommonOptions& common) {
  struct Options {
    fs::path case_file, out = "diagnosis";
    bool require_cause = false, no_controls = false;
  };
  auto o = std::make_shared<Options>();
  auto* app = root.add_subcommand(
      "diagnose",
      "What the simulation gets wrong, and why: diagnosis.json, extended.toml, report.html.\n"
      "Example: maquette diagnose case.toml --out diagnosis");
  app->add_option("case", o->case_file, "case file")->required();
  app->add_option("--out", o->out, "folder")->capture_default_str();
  app->add_flag("--require-cause", o->require_cause, "exit code 1 if no cause is named");
  app->add_flag("--no-controls", o->no_controls,
                "leaves out the same analysis of simulated data (null, injection and recovery): a "
                "third of the time");
  return {app, [o, &common](Console& console) {
            const auto seed = static_cast<std::uint64_t>(common.seed < 0 ? 1 : common.seed);
            return finish(console, "diagnose", [&](const RunContext& run) {
              return diagnose_job(o->case_file, o->out, seed, o->require_cause, !o->no_controls,
                                  run);
            });
          }};
}

Command add_compensate(CLI::App& root, const CommonOptions&) {
  struct Options {
    CompensateJob job;
    fs::path out = "compensated", design, extended;
  };
  auto o = std::make_shared<Options>();
  auto* app = root.add_subcommand(
      "compensate",
      "Programs rewritten so that a machine with known errors cuts what they mean.\n"
      "Example: maquette compensate part.ngc --by diagnosis/compensation.toml \\\n"
      "           --extended diagnosis/extended.toml --out compensated");
  app->add_option("programs", o->job.programs, "G-code of absolute moves in mm")->required();
  app->add_option("--by", o->job.by, "errors of machine and tool (docs/compensation.md)")
      ->required();
  app->add_option("--out", o->out, "folder; programs keep their names")->capture_default_str();
  app->add_option("--extended", o->extended,
                  "extended.toml of diagnose: cuts both in simulation and says what is gained");
  app->add_option("--design", o->design, "model field (.tif), for a ball of another radius");
  app->add_option("--ball-diameter-mm", o->job.ball_diameter_mm, "as programmed")
      ->capture_default_str();
  return {app, [o](Console& console) {
            if (!o->design.empty()) o->job.design = o->design;
            if (!o->extended.empty()) o->job.extended = o->extended;
            return finish(console, "compensate", [&](const RunContext& run) {
              return compensate_job(o->job, o->out, run);
            });
          }};
}

Command add_detectability(CLI::App& root, const CommonOptions& common) {
  struct Options {
    fs::path case_file, out = "detectability";
  };
  auto o = std::make_shared<Options>();
  auto* app =
      root.add_subcommand("detectability",
                          "How small each cause could be and still be found: detectability.json.\n"
                          "Example: maquette detectability case.toml --out detectability");
  app->add_option("case", o->case_file, "case file")->required();
  app->add_option("--out", o->out, "folder")->capture_default_str();
  return {app, [o, &common](Console& console) {
            const auto seed = static_cast<std::uint64_t>(common.seed < 0 ? 1 : common.seed);
            return finish(console, "detectability", [&](const RunContext& run) {
              return detectability_job(o->case_file, o->out, seed, run);
            });
          }};
}

}  // namespace maquette::tools
