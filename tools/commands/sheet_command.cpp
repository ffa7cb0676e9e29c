// SPDX-License-Identifier: GPL-3.0-or-later

// sheet

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "tools/commands/camera_commands.hpp"
#include "tools/jobs_sheet.hpp"

namespace maquette::tools {

Command add_sheet(CLI::App& root, const CommonOptions&) {
  struct Choice {
    SheetJob job;
    std::filesystem::path out = "sheet.png";
  };
  auto o = std::make_shared<Choice>();
  auto* app = root.add_subcommand(
      "sheet",
      "Many pictures small on one, each with a caption: frames of a descent, one effect beside "
      "another.\n"
      "Example: maquette sheet descent_*.png --columns 6 --out sheet.png");
  app->add_option("pictures", o->job.pictures, "PNG, TIFF, JPEG (sRGB) or EXR (linear light)")
      ->required();
  app->add_option("--caption", o->job.captions,
                  "of each picture, in their order; names of the files unless given");
  app->add_option("--columns", o->job.columns, "0: about as many as rows")
      ->capture_default_str()
      ->check(CLI::Range(0, 10000));
  app->add_option("--width-px", o->job.width_px, "of each picture on the sheet")
      ->capture_default_str()
      ->check(CLI::Range(16, 8192));
  app->add_option("--exposure", o->job.exposure, "factor on the light of EXR files")
      ->capture_default_str()
      ->check(CLI::Range(1e-9, 1e9));
  app->add_option("--out", o->out, ".png")->capture_default_str();
  return {app, [o](Console& console) -> Result<int> {
            const std::size_t count = o->job.pictures.size(), said = o->job.captions.size();
            if (said != 0 && said != count)
              return fail(kUsage, fmt::format("{} captions for {} pictures; one for each, or none, "
                                              "expected",
                                              said, count));
            return finish(console, "sheet",
                          [&](const RunContext& run) { return sheet_job(o->job, o->out, run); });
          }};
}

}  // namespace maquette::tools
