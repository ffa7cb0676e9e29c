// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/jobs_match.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "camera/compare.hpp"
#include "camera/match_photographs.hpp"
#include "core/files.hpp"
#include "tools/document.hpp"
#include "tools/jobs.hpp"
#include "tools/match_file.hpp"
#include "tools/scene_loading.hpp"

namespace maquette::tools {
using nlohmann::ordered_json;
namespace {

constexpr double kMatchShare = 0.8;  ///< of the progress; the rest compares

/// A photograph of the file, and how its rendering differs before and after.
struct Seen {
  const MatchFilePhoto* file = nullptr;
  std::string name;
  camera::LoadedImage image;
  RigidTransform start, pose;
  double start_exposure = 1.0, exposure = 1.0;
  camera::Comparison before, after;
};

struct Matched {
  std::vector<Seen> photos;
  camera::PhotographMatch match;
  camera::Bands start_balance{};
};

camera::MatchSearch search_of(const std::vector<std::string>& names) {
  const auto wanted = [&](const char* what) {
    return std::find(names.begin(), names.end(), what) != names.end();
  };
  return {wanted("exposure"),      wanted("exposure_each"),   wanted("white_balance"),
          wanted("lamp_position"), wanted("lamp_brightness"), wanted("pose")};
}

Result<std::vector<Seen>> see(const MatchFile& file, const Scene& scene) {
  std::vector<Seen> photos;
  for (const MatchFilePhoto& p : file.photos) {
    Seen& s = photos.emplace_back();
    s.file = &p;
    s.name = p.image.filename().string();
    MAQUETTE_TRY(s.image, camera::read_image(p.image));
    s.start = pose_of(scene);
    if (!std::isnan(p.camera_position_mm.x))
      s.start = std::isnan(p.camera_target_mm.x)
                    ? RigidTransform{normalized(p.camera_quaternion_wxyz), p.camera_position_mm}
                    : camera::look_at(p.camera_position_mm, p.camera_target_mm);
    s.start_exposure = p.exposure_scale > 0.0 ? p.exposure_scale : scene.exposure_scale;
    s.pose = s.start, s.exposure = s.start_exposure;
  }
  return photos;
}

/// The photograph beside what `render` makes of the same numbers.
Result<camera::Comparison> beside(const camera::PreparedScene& prepared, const Scene& scene,
                                  const Seen& photo, const RigidTransform& pose, double exposure,
                                  const camera::Bands& balance, const camera::Lighting& lighting,
                                  const RunContext& run) {
  MAQUETTE_TRY(camera::RenderOptions options, render_options_of(scene));
  options.exposure_scale = exposure;
  options.white_balance = balance;
  options.geometry = false;
  RunContext quiet = run;
  quiet.progress = [](double) {};
  MAQUETTE_TRY(auto image, prepared.render(camera_of(scene), pose, lighting, options, quiet));
  auto result = camera::compare_images(photo.image, camera::with_masks(std::move(image)), {});
  if (!result) return tl::unexpected(std::move(result.error()).within(photo.name));
  return result;
}

Result<Matched> match(const MatchFile& file, const Scene& scene, const RunContext& run) {
  Matched out;
  MAQUETTE_TRY(const auto loaded, load_scene(scene, run));
  MAQUETTE_TRY(const auto prepared, camera::PreparedScene::build(loaded->objects, run));
  MAQUETTE_TRY(out.photos, see(file, scene));
  camera::MatchOptions options;
  options.search = search_of(file.search);
  options.finest_px = static_cast<int>(file.finest_px);
  MAQUETTE_TRY(options.render, render_options_of(scene));
  out.start_balance = options.render.white_balance;
  std::vector<camera::MatchPhoto> photos;
  std::vector<std::size_t> who;
  for (std::size_t i = 0; i < out.photos.size(); ++i) {
    const Seen& s = out.photos[i];
    if (s.file->held_out) continue;
    photos.push_back(
        {s.name, camera::linear_light(s.image), camera_of(scene), s.start, s.start_exposure});
    who.push_back(i);
  }
  RunContext part = run;
  part.progress = [&](double share) { run.progress(kMatchShare * share); };
  MAQUETTE_TRY(out.match, camera::match_photographs(prepared, photos, loaded->lighting,
                                                    out.start_balance, options, part));
  double shared = 1.0;
  for (const camera::MatchedNumber& n : out.match.numbers)
    if (n.name == "exposure") shared = n.value;
  for (Seen& s : out.photos)
    if (s.file->held_out) s.exposure *= shared;
  for (std::size_t k = 0; k < who.size(); ++k) {
    out.photos[who[k]].pose = out.match.state.model_from_camera[k];
    out.photos[who[k]].exposure = out.match.state.exposure_scale[k];
  }
  double done = 0.0;
  for (Seen& s : out.photos) {
    MAQUETTE_TRY(s.before, beside(prepared, scene, s, s.start, s.start_exposure, out.start_balance,
                                  loaded->lighting, run));
    MAQUETTE_TRY(s.after, beside(prepared, scene, s, s.pose, s.exposure,
                                 out.match.state.white_balance, out.match.state.lighting, run));
    run.progress(kMatchShare +
                 (1.0 - kMatchShare) * ++done / static_cast<double>(out.photos.size()));
  }
  return out;
}

std::vector<double> list(Vec3 v) {
  return {v.x, v.y, v.z};
}

/// Scene files: what all share, then each photograph.
Result<void> write_scenes(const MatchFile& file, const Scene& scene, const Matched& m,
                          const fs::path& folder, std::vector<fs::path>& outputs) {
  SceneChanges shared;
  const camera::MatchSearch search = search_of(file.search);
  const camera::MatchState& state = m.match.state;
  if (search.white_balance)
    shared.lists.emplace_back("white_balance", std::vector<double>(state.white_balance.begin(),
                                                                   state.white_balance.end()));
  if (search.lamp_position)
    shared.lists.emplace_back("lamp_position_mm", list(state.lighting.lamps.front().position_mm));
  for (const camera::MatchedNumber& n : m.match.numbers) {
    if (n.name == "exposure")
      shared.numbers.emplace_back("exposure_scale", n.value * scene.exposure_scale);
    if (n.name != "lamp.brightness") continue;
    std::vector<double> irradiance = scene.lamp_irradiance;
    for (double& v : irradiance) v *= n.value;
    shared.lists.emplace_back("lamp_irradiance", irradiance);
  }
  outputs.push_back(folder / "scene.toml");
  MAQUETTE_TRY_VOID(write_changed_scene(file.scene, shared, outputs.back()));
  for (const Seen& s : m.photos) {
    SceneChanges own = shared;
    std::erase_if(own.numbers, [](const auto& n) { return n.first == "exposure_scale"; });
    own.numbers.emplace_back("exposure_scale", s.exposure);
    own.lists.emplace_back("camera_position_mm", list(s.pose.translation_mm));
    const Quaternion& q = s.pose.rotation;
    own.lists.emplace_back("camera_quaternion_wxyz", std::vector<double>{q.w, q.x, q.y, q.z});
    own.without = {"camera_target_mm", "trajectory"};
    outputs.push_back(folder / fmt::format("scene_{}.toml", s.file->image.stem().string()));
    MAQUETTE_TRY_VOID(write_changed_scene(file.scene, own, outputs.back()));
  }
  return {};
}

ordered_json figures_of(const Matched& m) {
  const camera::PhotographMatch& r = m.match;
  ordered_json j{{"schema", "maquette.matched/1"}};
  j["numbers"] = ordered_json::array();
  for (const auto& n : r.numbers)
    j["numbers"].push_back(
        {{"name", n.name}, {"start", n.start}, {"value", n.value}, {"sigma", n.sigma}});
  j["covariance"] = r.covariance;
  j["values"] = r.pixels;
  j["independent_values"] = r.independent_pixels;
  j["scatter_255"] = r.rms_255;
  j["steps"] = r.steps;
  j["photographs"] = ordered_json::array();
  for (const Seen& s : m.photos) {
    ordered_json p{{"image", s.name},
                   {"held_out", s.file->held_out},
                   {"mean_abs_diff_before_255", s.before.mean_abs_diff_255},
                   {"mean_abs_diff_255", s.after.mean_abs_diff_255},
                   {"rmse_255", s.after.rmse_255},
                   {"bias_255", s.after.bias_255},
                   {"compared", s.after.state}};
    if (s.after.rest) p["outside_shadow_edges_255"] = s.after.rest->mean_abs_diff_255;
    if (s.after.shadow_edges) p["shadow_edges_255"] = s.after.shadow_edges->mean_abs_diff_255;
    j["photographs"].push_back(std::move(p));
  }
  return j;
}

/// Where the differences of a photograph and its rendering are drawn, before and after.
std::array<fs::path, 2> pictures_of(const Seen& s, const fs::path& folder) {
  const std::string stem = s.file->image.stem().string();
  return {folder / fmt::format("difference_{}_before.png", stem),
          folder / fmt::format("difference_{}_after.png", stem)};
}

Result<void> write_pictures(const Matched& m, const fs::path& folder,
                            std::vector<fs::path>& outputs) {
  for (const Seen& s : m.photos) {
    const auto files = pictures_of(s, folder);
    for (std::size_t k = 0; k < files.size(); ++k) {
      outputs.push_back(files[k]);
      MAQUETTE_TRY_VOID(camera::write_png((k == 0 ? s.before : s.after).difference, files[k]));
    }
  }
  return {};
}

std::string page_of(const MatchJob& job, const Matched& m, const fs::path& folder) {
  const auto number = [](double v, int digits) {
    return Table::Cell{fmt::format("{:.{}f}", v, digits), true};
  };
  Document d;
  d.push_back(Heading{1, "Renderings matched to photographs"});
  d.push_back(Paragraph{fmt::format(
      "{}: {} steps; {} values of pixels, worth {:.0f} independent ones; {:.2f}/255 of scatter "
      "left. Factors are relative to the start; poses say how far the camera was moved in its own "
      "frame. Uncertainties are standard ones, from the scatter of what is left; errors that all "
      "pixels share are not in them.",
      job.file.string(), m.match.steps, m.match.pixels, m.match.independent_pixels,
      m.match.rms_255)});
  Table numbers{{"", "start", "found", "uncertainty"}, {}};
  for (const auto& n : m.match.numbers)
    numbers.rows.push_back(
        {{n.name}, number(n.start, 4), number(n.value, 4), {fmt::format("{:.2g}", n.sigma), true}});
  d.push_back(numbers);
  Table photos{{"photograph", "", "before, /255", "after, /255", "bias", "outside shadow edges",
                "at shadow edges"},
               {}};
  for (const Seen& s : m.photos)
    photos.rows.push_back(
        {{s.name},
         {s.file->held_out ? "held out" : "searched in"},
         number(s.before.mean_abs_diff_255, 2),
         number(s.after.mean_abs_diff_255, 2),
         number(s.after.bias_255, 2),
         number(s.after.rest ? s.after.rest->mean_abs_diff_255 : NAN, 2),
         number(s.after.shadow_edges ? s.after.shadow_edges->mean_abs_diff_255 : NAN, 2)});
  d.push_back(photos);
  d.push_back(
      Paragraph{"Photograph less rendering, mean of the channels: grey is none, brighter where the "
                "photograph "
                "is brighter."});
  for (const Seen& s : m.photos) {
    const auto files = pictures_of(s, folder);
    d.push_back(Picture{files[0], s.name + ", before"});
    d.push_back(Picture{files[1], s.name + ", after"});
  }
  return "<!doctype html><meta charset=\"utf-8\"><title>match</title><style>body{font:15px "
         "sans-serif;max-width:70em;margin:1em auto;padding:0 1em}figure{display:inline-block;"
         "margin:0.5em}img{max-width:100%}td,th{padding:2px "
         "10px;text-align:left}</style>\n" +
         to_html(d);
}

}  // namespace

Result<JobResult> match_job(const MatchJob& job, const fs::path& folder,
                            std::vector<std::string>& said, const RunContext& run) {
  MAQUETTE_TRY(const MatchFile file, read_match(job.file));
  MAQUETTE_TRY(const auto scene, read_scene(file.scene));
  auto matched = match(file, *scene, run);
  if (!matched) return tl::unexpected(std::move(matched.error()).within(job.file.string()));
  std::error_code ec;
  fs::create_directories(folder, ec);
  if (ec) return tl::unexpected(write_error(folder, ec.value()));
  JobResult result;
  result.outputs = {folder / "match.json", folder / "match.html"};
  const ordered_json figures = figures_of(*matched);
  result.figures_json = figures.dump(2, ' ', false, ordered_json::error_handler_t::replace);
  MAQUETTE_TRY_VOID(write_file(result.outputs[0], result.figures_json + "\n"));
  MAQUETTE_TRY_VOID(write_pictures(*matched, folder, result.outputs));
  MAQUETTE_TRY_VOID(write_file(result.outputs[1], page_of(job, *matched, folder)));
  MAQUETTE_TRY_VOID(write_scenes(file, *scene, *matched, folder, result.outputs));
  for (const auto& n : matched->match.numbers)
    said.push_back(
        fmt::format("{:<36} {:>12.5g} -> {:>12.5g} +- {:.2g}", n.name, n.start, n.value, n.sigma));
  const bool held_out = std::any_of(matched->photos.begin(), matched->photos.end(),
                                    [](const Seen& s) { return s.file->held_out; });
  double worst = 0.0;
  for (const Seen& s : matched->photos) {
    said.push_back(fmt::format("{:<36} {:>8.2f}/255 -> {:.2f}/255{}", s.name,
                               s.before.mean_abs_diff_255, s.after.mean_abs_diff_255,
                               s.file->held_out ? ", held out" : ""));
    if (s.file->held_out == held_out) worst = std::max(worst, s.after.mean_abs_diff_255);
  }
  result.note = fmt::format("{:.2f}/255 at most{}", worst, held_out ? ", held out" : "");
  if (worst > job.max_mean_255)
    result.unmet =
        fmt::format("a mean difference of {:.3f}/255 is more than {}/255", worst, job.max_mean_255);
  return result;
}

}  // namespace maquette::tools
