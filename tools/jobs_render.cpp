// SPDX-License-Identifier: GPL-3.0-or-later
#include <chrono>
#include <cmath>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <nlohmann/json.hpp>

#include "camera/image_io.hpp"
#include "core/files.hpp"
#include "tools/jobs.hpp"
#include "tools/rendered_light.hpp"
#include "tools/scene_loading.hpp"
#include "tools/trajectory_file.hpp"
#include "tools/trajectory_motion.hpp"
#include "tools/version.hpp"

namespace maquette::tools {
using nlohmann::json;
namespace {

constexpr double kBuildShare = 0.2;  ///< of the progress shown
/// 8-bit sRGB of one or three bands.
Result<void> write_preview(const camera::Image& image, const fs::path& path,
                           const camera::Metadata& metadata) {
  const auto& bands = image.bands;
  const auto at = [&](std::size_t b, std::size_t i) {
    return camera::srgb8(static_cast<double>(bands[b].cells()[i]));
  };
  if (bands.size() == 1) {
    Grid<std::uint8_t> grey(bands[0].rows(), bands[0].cols());
    for (std::size_t i = 0; i < grey.cells().size(); ++i) grey.cells()[i] = at(0, i);
    return camera::write_png(grey, path, metadata);
  }
  Grid<camera::Rgb8> colour(bands[0].rows(), bands[0].cols());
  for (std::size_t i = 0; i < colour.cells().size(); ++i)
    colour.cells()[i] = {at(0, i), at(1, i), at(2, i)};
  return camera::write_png(colour, path, metadata);
}

Result<void> write_picture(const camera::Image& image, const fs::path& path,
                           const camera::Metadata& metadata) {
  Grid<float> lit(image.lit.rows(), image.lit.cols());
  std::copy(image.lit.cells().begin(), image.lit.cells().end(), lit.cells().begin());
  std::vector<std::pair<std::string, const Grid<float>*>> channels;
  if (image.bands.size() == 1) {
    channels.emplace_back("Y", &image.bands[0]);
  } else {
    for (std::size_t b = 0; b < 3; ++b)
      channels.emplace_back(std::string(1, "RGB"[b]), &image.bands[b]);
  }
  channels.emplace_back("Z", &image.depth_mm);
  channels.emplace_back("lit", &lit);
  if (!image.part.empty()) {
    for (std::size_t k = 0; k < 3; ++k) {
      channels.emplace_back(fmt::format("normal.{}", "XYZ"[k]), &image.normal[k]);
      channels.emplace_back(fmt::format("position.{}", "XYZ"[k]), &image.position_mm[k]);
    }
    channels.emplace_back("angle.phase", &image.phase_deg);
    channels.emplace_back("angle.incidence", &image.incidence_deg);
    channels.emplace_back("angle.emission", &image.emission_deg);
    channels.emplace_back("part", &image.part);
  }
  return camera::write_exr(channels, path, metadata);
}

struct Frame {
  fs::path path;
  RigidTransform model_from_camera;
  std::optional<double> time_s;
  std::uint64_t seed = 1;
  CameraMotion motion{};
  bool numbered = false;  ///< one of several: kept when it is there already
};

/// The quaternion that stays itself when it is normalized again: written into a picture and read
/// back, it must be the same pose to the bit.
Quaternion settled(Quaternion q) {
  constexpr int kMost = 8;
  for (int i = 0; i < kMost && normalized(q) != q; ++i) q = normalized(q);
  return q;
}

/// W m^-2 sr^-1 that value 1 stands for in each band: white that faces the first lamp at its target
/// has the lamp's colour times exposure_scale and white_balance.
std::optional<camera::Bands> radiance_of_one(const LoadedScene& loaded,
                                             const camera::RenderOptions& options) {
  camera::Bands one = loaded.white_radiance;
  for (std::size_t b = 0; b < one.size(); ++b) {
    one[b] /=
        loaded.lighting.lamps.front().colour[b] * options.exposure_scale * options.white_balance[b];
    if (!(one[b] > 0.0) || !std::isfinite(one[b])) return std::nullopt;
  }
  return one;
}

/// What a picture file says about how it was made.
camera::Metadata metadata_of(const std::string& scene_text, const Frame& frame,
                             const camera::LensOpening& lens,
                             const std::optional<camera::Bands>& one, const camera::Image& image) {
  const RigidTransform& t = frame.model_from_camera;
  camera::Metadata m{
      {"maquette:scene", scene_text},
      {"maquette:version", kVersion},
      {"maquette:camera_position_mm",
       fmt::format("[{}, {}, {}]", t.translation_mm.x, t.translation_mm.y, t.translation_mm.z)},
      {"maquette:camera_quaternion_wxyz",
       fmt::format("[{}, {}, {}, {}]", t.rotation.w, t.rotation.x, t.rotation.y, t.rotation.z)},
      {"maquette:seed", std::to_string(frame.seed)},
      {"maquette:mean_samples", fmt::format("{}", image.mean_samples)}};
  if (frame.time_s) {
    const Vec3 v = frame.motion.velocity_mm_s;
    const Vec3 w = 1.0 / degrees(1.0).value() * frame.motion.angular_rate_rad_s;
    m.emplace_back("maquette:time_s", fmt::format("{}", *frame.time_s));
    m.emplace_back("maquette:velocity_mm_s", fmt::format("[{}, {}, {}]", v.x, v.y, v.z));
    m.emplace_back("maquette:angular_rate_deg_s", fmt::format("[{}, {}, {}]", w.x, w.y, w.z));
  }
  if (lens.f_number > 0.0) m.emplace_back(kLensKey, fmt::format("{}", lens.f_number));
  if (one)
    m.emplace_back("maquette:white_radiance_w_m2_sr",
                   fmt::format("[{}, {}, {}]", (*one)[0], (*one)[1], (*one)[2]));
  return m;
}

fs::path preview_path(const fs::path& picture) {
  return picture.parent_path() / (picture.stem().string() + ".png");
}

/// One picture, or numbered ones from each pose or along the trajectory.
Result<std::vector<Frame>> frames_of(const Scene& s, const fs::path& out) {
  const auto seed = static_cast<std::uint64_t>(s.seed);
  std::vector<Frame> frames;
  const auto add = [&](RigidTransform pose, std::optional<double> time_s, CameraMotion motion) {
    pose.rotation = settled(pose.rotation);
    frames.push_back({out.parent_path() / fmt::format("{}_{:04}{}", out.stem().string(),
                                                      frames.size() + 1, out.extension().string()),
                      pose, time_s, seed + frames.size(), motion, true});
  };
  if (!s.trajectory.empty()) {
    MAQUETTE_TRY(auto poses, read_trajectory(s.trajectory));
    for (TimedPose& p : poses) p.model_from_camera.rotation = settled(p.model_from_camera.rotation);
    const auto motions = motions_of(poses);
    for (const TimedPose& p : poses) add(p.model_from_camera, p.time_s, motions[frames.size()]);
  } else if (!s.poses.empty()) {
    MAQUETTE_TRY(const auto poses, poses_of(s));
    for (const RigidTransform& pose : poses) add(pose, std::nullopt, {});
  } else {
    RigidTransform pose = pose_of(s);
    pose.rotation = settled(pose.rotation);
    frames.push_back({out, pose, std::nullopt, seed});
  }
  return frames;
}

/// Hash of all that decides what the frames show.
/// @param named  files that meshes name
Result<std::string> key_of(const Scene& s, const std::string& scene_text,
                           const std::vector<fs::path>& named) {
  std::string all = fmt::format("{}\n{}\n", kVersion, scene_text);
  if (!s.camera.empty())
    all += fmt::format("{} {} {} {} {} {} {} {} {} {}\n", fmt::join(s.resolution_px, " "),
                       s.pixel_pitch_um, s.focal_length_mm, fmt::join(s.principal_point_px, " "),
                       s.aspect, s.skew_px, s.f_number, s.focus_mm, s.blades, s.blade_rotation_deg);
  std::vector<fs::path> files{s.surface,        s.corrections,   s.stones, s.trajectory,
                              s.lamp_intensity, s.lamp_spectrum, s.filters};
  for (const SceneMesh& o : s.parts.objects) files.push_back(o.mesh);
  for (const SceneLamp& l : s.parts.lamps) files.insert(files.end(), {l.intensity, l.spectrum});
  for (const SceneMaterial& m : s.parts.materials)
    files.insert(files.end(), {m.table, m.albedo_map});
  files.insert(files.end(), named.begin(), named.end());
  for (const fs::path& file : files) {
    if (file.empty()) continue;
    MAQUETTE_TRY(const std::string digest, sha256_file(file));
    all += digest + "\n";
  }
  return sha256(all);
}

/// Frames of another scene under the same names are taken away, so that those that are there are
/// of this one.
Result<void> claim_frames(const std::vector<Frame>& frames, const fs::path& out,
                          const std::string& key) {
  const fs::path note = out.parent_path() / (out.stem().string() + "_frames.json");
  std::error_code ec;
  if (const auto text = read_file(note)) {
    const json old = json::parse(*text, nullptr, false);
    if (!old.is_discarded() && old.value("key", "") == key) return {};
  }
  for (const Frame& f : frames) {
    fs::remove(f.path, ec);
    fs::remove(preview_path(f.path), ec);
  }
  const json fresh{{"schema", "maquette.frames/1"}, {"key", key}, {"frames", frames.size()}};
  return write_file(note, fresh.dump(1));
}

}  // namespace

Result<JobResult> render_job(const fs::path& scene_path, const fs::path& image_path,
                             const RunContext& run) {
  MAQUETTE_TRY(const auto scene, read_scene(scene_path));
  const Scene& s = *scene;
  MAQUETTE_TRY(const std::string scene_text, read_file(scene_path));
  MAQUETTE_TRY(const auto frames, frames_of(s, image_path));
  const auto within = [&](Error error) {
    return tl::unexpected(std::move(error).within(scene_path.string()));
  };
  auto loaded = load_scene(s, run);
  if (!loaded) return within(std::move(loaded.error()));
  if (frames.front().numbered) {
    MAQUETTE_TRY(const std::string key, key_of(s, scene_text, (*loaded)->files));
    MAQUETTE_TRY_VOID(claim_frames(frames, image_path, key));
  }
  auto prepared = camera::PreparedScene::build((*loaded)->objects, run);
  if (!prepared) return within(std::move(prepared.error()));
  run.progress(kBuildShare);

  const camera::CameraModel camera = camera_of(s);
  auto wanted = render_options_of(s);
  if (!wanted) return within(std::move(wanted.error()));
  camera::RenderOptions& options = *wanted;
  JobResult result;
  double sum = 0.0, samples = 0.0;
  std::uint64_t seen = 0;
  std::size_t kept = 0;
  const auto begin = std::chrono::steady_clock::now();
  for (std::size_t i = 0; i < frames.size(); ++i) {
    const Frame& frame = frames[i];
    const bool exr = frame.path.extension() != ".png";
    const fs::path png = preview_path(frame.path);
    result.outputs.push_back(frame.path);
    if (exr) result.outputs.push_back(png);
    if (frame.numbered && fs::exists(frame.path) && fs::exists(png)) {
      ++kept;
      continue;
    }
    options.seed = frame.seed;
    RunContext part = run;
    part.progress = [&](double share) {
      run.progress(kBuildShare + (1.0 - kBuildShare) * (static_cast<double>(i) + share) /
                                     static_cast<double>(frames.size()));
    };
    auto image =
        prepared->render(camera, frame.model_from_camera, (*loaded)->lighting, options, part);
    if (!image)
      return within(frame.numbered
                        ? std::move(image.error()).within(fmt::format("picture {}", i + 1))
                        : std::move(image.error()));
    const auto metadata =
        metadata_of(scene_text, frame, camera.lens, radiance_of_one(**loaded, options), *image);
    if (exr) MAQUETTE_TRY_VOID(write_picture(*image, frame.path, metadata));
    MAQUETTE_TRY_VOID(write_preview(*image, exr ? png : frame.path, metadata));
    samples += image->mean_samples;
    const Grid<float>& middle = image->bands[image->bands.size() / 2];
    for (std::size_t k = 0; k < middle.cells().size(); ++k)
      if (std::isfinite(image->depth_mm.cells()[k]))
        sum += static_cast<double>(middle.cells()[k]), ++seen;
  }
  const std::size_t made = frames.size() - kept;
  const double seconds =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  json figures{{"triangles", (*loaded)->triangles},
               {"mean_radiance", seen > 0 ? sum / static_cast<double>(seen) : 0.0},
               {"pixels_on_part", seen},
               {"pictures", made},
               {"kept", kept},
               {"mean_samples", made > 0 ? samples / static_cast<double>(made) : 0.0}};
  result.note = fmt::format(
      "{}{} x {} pixels of {} triangles",
      frames.size() > 1 ? fmt::format("{} pictures ({} kept) of ", frames.size(), kept) : "",
      camera.width_px, camera.height_px, (*loaded)->triangles);
  // Of several: with their files, without reading the scene.
  if (frames.size() > 1 && made > 0 && seconds > 0.0) {
    const double rate = static_cast<double>(made) / seconds;
    figures["pictures_per_s"] = rate;
    result.note += fmt::format(", {:.3g} pictures/s", rate);
  }
  result.figures_json = figures.dump();
  return result;
}

}  // namespace maquette::tools
