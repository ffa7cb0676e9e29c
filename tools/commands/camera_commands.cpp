// SPDX-License-Identifier: GPL-3.0-or-later

// expose, stack, calibrate, compare, match

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <CLI/CLI.hpp>

#include "tools/camera_file.hpp"
#include "tools/commands/camera_commands.hpp"
#include "tools/jobs_calibrate.hpp"
#include "tools/jobs_compare.hpp"
#include "tools/jobs_expose.hpp"
#include "tools/jobs_match.hpp"

namespace maquette::tools {
namespace fs = std::filesystem;
namespace {

struct Options {
  ExposeJob job;
  std::vector<fs::path> images;
  fs::path out;
};

void add_shot(CLI::App& app, Options& o) {
  app.add_option(
         "--camera", o.job.camera,
         fmt::format("{}, or a .toml file (docs/camera.md)", fmt::join(camera_names(), ", ")))
      ->capture_default_str();
  app.add_option("--set", o.job.set, "key=value of the camera file");
  app.add_option("--without", o.job.without, "effects to be left out")->delimiter(',');
  app.add_option("--time-s", o.job.time_s,
                 "simulation time: the same time, the same noise; the rendering's unless given");
  app.add_flag("--fit-sensor", o.job.fit_sensor,
               "the sensor gets the picture's number of pixels at the same field of view");
}

std::uint64_t seed_of(const CommonOptions& common) {
  return common.seed < 0 ? 1 : static_cast<std::uint64_t>(common.seed);
}

}  // namespace

Command add_expose(CLI::App& root, const CommonOptions& common) {
  auto o = std::make_shared<Options>();
  o->out = "photo.png";
  auto* app = root.add_subcommand(
      "expose",
      "What a camera makes of linear light: lens, sensor, file, effect by effect.\n"
      "Example: maquette expose picture.exr --camera nikon_d700_55deg --out photo.png\n"
      "Frames of a trajectory: maquette expose frames/ --out film/photo.png");
  app->add_option("images", o->images,
                  "linear light: EXR with Y or R, G, B, depth Z in mm; of several, or a folder of "
                  ".exr files, the outputs are numbered")
      ->required();
  add_shot(*app, *o);
  app->add_flag(
      "--masks", o->job.masks,
      "NAME.masks.exr beside: depth and lit as the lens bends them, for `compare --masks`");
  app->add_option("--out", o->out, ".png, .tif, .jpg or .exr")->capture_default_str();
  return {app, [o, &common](Console& console) -> Result<int> {
            o->job.seed = seed_of(common);
            MAQUETTE_TRY(const auto pictures, pictures_in(o->images));
            std::error_code ignored;
            const bool one = o->images.size() == 1 && !fs::is_directory(o->images[0], ignored);
            return finish(console, "expose", [&](const RunContext& run) {
              if (!one) return expose_sequence_job(o->job, pictures, o->out, run);
              o->job.image = pictures[0];
              return expose_job(o->job, o->out, run);
            });
          }};
}

Command add_stack(CLI::App& root, const CommonOptions& common) {
  auto o = std::make_shared<Options>();
  o->out = "stack";
  auto* app = root.add_subcommand(
      "stack",
      "Effects of a camera in their order, each alone and all together (stack.html), and what each "
      "swap of two would change (stack.json).\n"
      "Example: maquette stack picture.exr --camera mono_space --fit-sensor --out stack");
  app->add_option("image", o->job.image, "linear light: EXR with Y or R, G, B, depth Z in mm")
      ->required();
  add_shot(*app, *o);
  app->add_option("--out", o->out, "folder")->capture_default_str();
  return {app, [o, &common](Console& console) {
            o->job.seed = seed_of(common);
            return finish(console, "stack",
                          [&](const RunContext& run) { return stack_job(o->job, o->out, run); });
          }};
}

Command add_calibrate(CLI::App& root, const CommonOptions&) {
  struct Choice {
    fs::path file, out = "calibrated";
  };
  auto o = std::make_shared<Choice>();
  auto* app = root.add_subcommand(
      "calibrate",
      "A camera file from measurements: sensor from bright and dark frames (EMVA 1288), lens from "
      "target points, fall of light from flats, each with its uncertainty (docs/camera.md).\n"
      "Example: maquette calibrate calibration.toml --out calibrated");
  app->add_option("file", o->file, "calibration.toml: which frames and points")->required();
  app->add_option("--out", o->out, "folder: camera.toml, calibration.json, calibration.html")
      ->capture_default_str();
  return {app, [o](Console& console) {
            return finish(console, "calibrate", [&](const RunContext& run) {
              return calibrate_job(o->file, o->out, run);
            });
          }};
}

Command add_compare(CLI::App& root, const CommonOptions&) {
  struct Choice {
    CompareJob job;
    fs::path out = "compare";
    std::string match = "none";
    bool fast = false;
  };
  auto o = std::make_shared<Choice>();
  auto* app = root.add_subcommand(
      "compare",
      "Photograph against rendering: compare.json, compare.html, difference.png, absolute.png.\n"
      "Example: maquette compare photo.png picture.exr --match white-balance --out compare");
  app->add_option("real", o->job.real, "photograph")->required();
  app->add_option("rendered", o->job.rendered, "rendering")->required();
  app->add_option("--match", o->match, "what of the rendering's light is fitted first")
      ->capture_default_str()
      ->check(CLI::IsMember({"none", "exposure", "white-balance"}));
  app->add_option("--masks", o->job.masks,
                  "EXR with Z and lit of the rendering, which a .png has not (`expose --masks`)");
  app->add_flag("--background", o->job.options.background, "compare pixels beside the part, too");
  app->add_flag("--fast", o->fast, "figures of differences only: without SSIM, FLIP and pictures");
  app->add_option("--edge-px", o->job.options.edge_px, "width of shadow edges to each side")
      ->capture_default_str()
      ->check(CLI::Range(0, 1000));
  app->add_option("--max-mean-255", o->job.max_mean_255, "exit code 1 if the mean is more");
  app->add_option("--out", o->out, "folder")->capture_default_str();
  return {app, [o](Console& console) {
            o->job.options.perceptual = o->job.options.pictures = !o->fast;
            o->job.options.match = o->match == "exposure"        ? camera::Match::exposure
                                   : o->match == "white-balance" ? camera::Match::white_balance
                                                                 : camera::Match::none;
            return finish(console, "compare",
                          [&](const RunContext& run) { return compare_job(o->job, o->out, run); });
          }};
}

Command add_match(CLI::App& root, const CommonOptions&) {
  struct Choice {
    MatchJob job;
    fs::path out = "matched";
  };
  auto o = std::make_shared<Choice>();
  auto* app = root.add_subcommand(
      "match",
      "Exposure, white balance, lamp and camera poses that make renderings look like photographs, "
      "each with its uncertainty, and scene files with them (docs/camera.md).\n"
      "Example: maquette match match.toml --out matched");
  app->add_option("file", o->job.file, "match.toml: scene, photographs, what is searched")
      ->required();
  app->add_option("--max-mean-255", o->job.max_mean_255,
                  "exit code 1 if a photograph held out (any, if none is) differs by more");
  app->add_option("--out", o->out, "folder: match.json, match.html, scene.toml, scene_PHOTO.toml")
      ->capture_default_str();
  return {app, [o](Console& console) {
            std::vector<std::string> said;
            auto code = finish(console, "match", [&](const RunContext& run) {
              return match_job(o->job, o->out, said, run);
            });
            for (const std::string& line : said) console.result(line);
            return code;
          }};
}

}  // namespace maquette::tools
