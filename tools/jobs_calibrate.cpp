// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/jobs_calibrate.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <nlohmann/json.hpp>

#include "camera/image_io.hpp"
#include "core/files.hpp"
#include "core/markup.hpp"
#include "tools/camera_file.hpp"
#include "tools/document.hpp"
#include "tools/jobs.hpp"

namespace maquette::tools {
namespace {

using camera::FrameSeries;
using camera::LevelStatistics;
using camera::Measured;

constexpr std::ptrdiff_t kSmallest = 16;  ///< pixels a side of a frame: uncertainties are of rows
constexpr std::size_t kHotToSay = 20;     ///< hot pixels from which their distribution is known

/// Side of the blocks of a flat that are averaged, even for a mosaic: 32 pixels, less of small
/// pictures.
std::ptrdiff_t block_side(const camera::Intrinsics& k) {
  return std::clamp<std::ptrdiff_t>(2 * (std::min(k.width_px, k.height_px) / 32), 8, 32);
}

struct Calibration {
  CalibrationFile file;
  CameraFile start;
  double largest_dn = 0.0;
  bool mosaic = false;
};

/// One frame in numbers of the converter.
Result<Grid<float>> frame_of(const Calibration& c, const fs::path& path) {
  MAQUETTE_TRY(camera::LoadedImage image, camera::read_image(path));
  const auto wrong = [&](const std::string& what) {
    return fail(camera::kCalibrationFrames, fmt::format("{}: {}", path.string(), what));
  };
  if (image.channels.size() != 1)
    return wrong(
        fmt::format("{} channels; a raw frame of one channel, in numbers of the converter "
                    "and before demosaicing, is expected",
                    image.channels.size()));
  Grid<float>& g = image.channels.front();
  const auto& k = c.start.shot.intrinsics;
  if (g.cols() != k.width_px || g.rows() != k.height_px)
    return wrong(
        fmt::format("{} x {} pixels, camera '{}' has {} x {}; set = "
                    "[\"sensor.width_px={}\", \"sensor.height_px={}\"] in the calibration "
                    "file says otherwise",
                    g.cols(), g.rows(), c.start.name, k.width_px, k.height_px, g.cols(), g.rows()));
  if (g.cols() < kSmallest || g.rows() < kSmallest)
    return wrong(fmt::format("{} x {} pixels; at least {} x {} are needed", g.cols(), g.rows(),
                             kSmallest, kSmallest));
  if (image.highest > 0.0) {
    const double scale = c.file.white_dn > 0.0 ? c.file.white_dn : image.highest;
    for (float& v : g.cells()) v = static_cast<float>(std::round(scale * static_cast<double>(v)));
  }
  for (const float v : g.cells()) {
    if (!std::isfinite(v)) return wrong("a value is not a finite number");
    if (static_cast<double>(v) > c.largest_dn + 0.5)
      return wrong(
          fmt::format("a value of {} DN; a converter of {} bits gives at most {:.0f}: check "
                      "sensor.bits of the camera and white_dn",
                      v, c.start.shot.bits, c.largest_dn));
  }
  return std::move(g);
}

Result<FrameSeries> series_of(const Calibration& c, const FrameFiles& files, bool mosaic,
                              const RunContext& run) {
  FrameSeries series;
  series.exposure_s = files.exposure_s;
  series.planes = mosaic ? 4 : 1;
  for (const fs::path& path : files.images) {
    if (run.stopped()) return fail(kCancelled, "stopped");
    MAQUETTE_TRY(const Grid<float> frame, frame_of(c, path));
    camera::add_frame(series, frame, c.largest_dn);
  }
  return series;
}

template <class Better>
std::size_t best_of(const std::vector<LevelStatistics>& all, const Better& better) {
  std::size_t best = 0;
  for (std::size_t i = 1; i < all.size(); ++i)
    if (better(all[i], all[best])) best = i;
  return best;
}

/// The bright series that shows how pixels respond: unsaturated, most frames, nearest to half.
std::optional<std::size_t> response_series(const camera::SensorCalibration& s,
                                           const std::vector<LevelStatistics>& bright,
                                           std::size_t planes, double largest_dn) {
  std::optional<std::size_t> best;
  double best_off = INFINITY;
  const double full = s.saturation_dn.known() ? s.saturation_dn.value : largest_dn;
  for (std::size_t i = 0; i < bright.size(); i += planes) {
    double high = 0.0;
    bool fits = true;
    for (std::size_t p = i; p < i + planes; ++p) {
      fits &= !s.points[p].saturated;
      high = std::max(high, bright[p].mean_dn.value);
    }
    const double share = high / full;
    if (!fits || share < 0.05 || share > 0.85) continue;
    const double off = std::abs(share - 0.5);
    if (best && (bright[i].frames < bright[*best * planes].frames ||
                 (bright[i].frames == bright[*best * planes].frames && off >= best_off)))
      continue;
    best = i / planes, best_off = off;
  }
  return best;
}

Measured times(const Measured& a, const Measured& b) {
  return {a.value * b.value, std::hypot(a.value * b.u, b.value * a.u)};
}

Result<void> calibrate_sensor(const Calibration& c, CalibrationFindings& f, const RunContext& run) {
  std::vector<LevelStatistics> dark, bright;
  for (const FrameFiles& files : c.file.dark) {
    MAQUETTE_TRY(const FrameSeries s, series_of(c, files, false, run));
    dark.push_back(camera::statistics_of(s, -1));
  }
  const int planes = c.mosaic ? 4 : 1;
  for (const FrameFiles& files : c.file.bright) {
    MAQUETTE_TRY(const FrameSeries s, series_of(c, files, c.mosaic, run));
    for (int p = 0; p < planes; ++p) bright.push_back(camera::statistics_of(s, p));
  }
  MAQUETTE_TRY(f.sensor, camera::photon_transfer(bright, dark, c.largest_dn));
  const Measured gain = f.sensor->gain_e_per_dn;

  // Many frames show the pattern best, and a short exposure shows it without dark charge.
  const std::size_t still = best_of(dark, [](const auto& a, const auto& b) {
    return a.frames != b.frames ? a.frames > b.frames : a.exposure_s < b.exposure_s;
  });
  const std::size_t longest =
      best_of(dark, [](const auto& a, const auto& b) { return a.exposure_s > b.exposure_s; });
  {
    MAQUETTE_TRY(const FrameSeries s, series_of(c, c.file.dark[still], false, run));
    f.dark = camera::dark_pattern(s);
  }
  f.dsnu_e = times(f.dark.dsnu_dn, gain);
  f.dsnu_pixel_e = times(f.dark.pixel_dn, gain);
  f.column_noise_e = times(f.dark.column_dn, gain);
  camera::DarkPattern warm = f.dark;
  if (longest != still) {
    MAQUETTE_TRY(const FrameSeries s, series_of(c, c.file.dark[longest], false, run));
    warm = camera::dark_pattern(s);
  }
  f.dark.hot_share = warm.hot_share, f.dark.hot_mean_dn = warm.hot_mean_dn;
  f.dark.hot_found = warm.hot_found;
  if (warm.hot_found >= kHotToSay) {
    const double rate = warm.hot_mean_dn * gain.value / dark[longest].exposure_s;
    f.hot_rate_e_s = {rate, rate / std::sqrt(static_cast<double>(warm.hot_found))};
  }
  const auto flat =
      response_series(*f.sensor, bright, static_cast<std::size_t>(planes), c.largest_dn);
  if (!flat) {
    f.notes.emplace_back(
        "no bright level between 5 and 85 % of saturation: how pixels differ in their response is "
        "unknown");
    return {};
  }
  const FrameFiles& files = c.file.bright[*flat];
  const auto same = std::find_if(c.file.dark.begin(), c.file.dark.end(), [&](const auto& d) {
    return std::abs(d.exposure_s - files.exposure_s) <= 1e-3 * files.exposure_s;
  });
  MAQUETTE_TRY(const FrameSeries light, series_of(c, files, c.mosaic, run));
  MAQUETTE_TRY(const FrameSeries black, series_of(c, *same, false, run));
  f.prnu = camera::response_pattern(light, black);
  return {};
}

Result<void> calibrate_targets(const Calibration& c, CalibrationFindings& f) {
  MAQUETTE_TRY(f.table, read_targets(c.file.points));
  auto found = camera::calibrate_targets(f.table->points, c.start.shot.intrinsics,
                                         {c.file.distortion, static_cast<int>(c.file.coefficients),
                                          c.file.principal_point, c.file.aspect, c.file.skew});
  if (!found) return tl::unexpected(std::move(found.error()).within(c.file.points.string()));
  f.targets = std::move(*found);
  std::vector<int> lines;
  for (const auto& r : f.targets->residuals)
    if (r.left_out) lines.push_back(f.table->lines[r.point]);
  if (!lines.empty())
    f.notes.push_back(
        fmt::format("{} target points lie where no camera would see them and are left "
                    "out: line{} {} of {}",
                    lines.size(), lines.size() == 1 ? "" : "s", fmt::join(lines, ", "),
                    c.file.points.filename().string()));
  return {};
}

Result<void> calibrate_vignetting(const Calibration& c, CalibrationFindings& f,
                                  const RunContext& run) {
  camera::Shot shot = c.start.shot;
  if (f.targets) shot.intrinsics = f.targets->intrinsics;
  const double black = f.sensor ? f.sensor->black_level_dn.value : shot.black_level_dn;
  for (std::size_t i = 0; i < c.file.flat.size(); ++i) {
    MAQUETTE_TRY(const FrameSeries s, series_of(c, c.file.flat[i], c.mosaic, run));
    const auto own = std::find_if(c.file.dark.begin(), c.file.dark.end(), [&](const auto& d) {
      return std::abs(d.exposure_s - s.exposure_s) <= 1e-3 * s.exposure_s;
    });
    std::optional<FrameSeries> dark;
    if (own != c.file.dark.end()) {
      MAQUETTE_TRY(dark, series_of(c, *own, false, run));
    } else {
      f.notes.push_back(
          fmt::format("flat {}: no dark frames of {} s; {:.1f} DN are taken off as black", i + 1,
                      s.exposure_s, black));
    }
    MAQUETTE_TRY(const auto blocks,
                 camera::flat_blocks(s, dark ? &*dark : nullptr, black, static_cast<int>(i),
                                     block_side(shot.intrinsics)));
    f.blocks.insert(f.blocks.end(), blocks.begin(), blocks.end());
  }
  MAQUETTE_TRY(f.vignetting,
               camera::fit_vignetting(f.blocks, shot, c.file.vignetting_law, c.file.cosine_power));
  return {};
}

/// Is it there at all?
bool shows(const Measured& m) {
  return m.known() && m.value > 2.0 * m.u;
}

/// Keys of the camera file that are not the start's any more, and the effects that stand for them.
struct Changes {
  std::vector<std::string> set;
  std::vector<std::string> keys;     ///< for the file's head
  std::vector<std::string> effects;  ///< that have to be in the stack
  void key(const std::string& name, const std::string& value) {
    set.push_back(name + "=" + value), keys.push_back(name);
  }
  void key(const std::string& name, double value) { key(name, fmt::format("{}", value)); }
};

Changes changes_of(const Calibration& c, const CalibrationFindings& f) {
  Changes to;
  const double celsius =
      std::isnan(c.file.temperature_c) ? c.start.shot.temperature_c : c.file.temperature_c;
  if (f.sensor) {
    const auto& s = *f.sensor;
    to.key("sensor.gain_e_per_dn", s.gain_e_per_dn.value);
    to.key("sensor.black_level_dn", std::max(0.0, s.black_level_dn.value));
    if (!std::isnan(c.file.temperature_c)) to.key("sensor.temperature_c", celsius);
    to.key("read_noise.sigma_e", s.read_noise_e.value);
    to.effects = {"shot_noise", "read_noise"};
    if (s.full_well_e.known()) {
      to.key("sensor.full_well_e", s.full_well_e.value);
      to.effects.emplace_back("full_well");
    }
    if (s.dark_current_e_s.known()) {
      to.key("dark_current.rate_e_s", std::max(0.0, s.dark_current_e_s.value));
      to.key("dark_current.reference_c", celsius);
      to.effects.emplace_back("dark_current");
    }
    to.key("dsnu.sigma_e", f.dsnu_pixel_e.value);
    to.effects.emplace_back("dsnu");
    to.key("row_column_noise.row_sigma_e", s.row_noise_e.value);
    to.key("row_column_noise.column_sigma_e", f.column_noise_e.value);
    if (shows(s.row_noise_e) || shows(f.column_noise_e))
      to.effects.emplace_back("row_column_noise");
    if (f.prnu.known()) {
      to.key("prnu.sigma", f.prnu.value);
      to.effects.emplace_back("prnu");
    }
    if (f.hot_rate_e_s.known()) {
      to.key("hot_pixels.share", std::min(0.5, f.dark.hot_share));
      to.key("hot_pixels.mean_rate_e_s", f.hot_rate_e_s.value);
      to.key("hot_pixels.reference_c", celsius);
      to.effects.emplace_back("hot_pixels");
    }
  }
  if (f.targets) {
    const auto& t = *f.targets;
    to.key("lens.focal_length_mm", t.focal_px.value * c.start.shot.pixel_pitch_um * 1e-3);
    if (c.file.principal_point)
      to.key("sensor.principal_point_px", fmt::format("[{}, {}]", t.cx_px.value, t.cy_px.value));
    if (c.file.aspect) to.key("sensor.aspect", t.aspect.value);
    if (c.file.skew) to.key("sensor.skew_px", t.skew_px.value);
    to.key("distortion.model", '"' + t.distortion.model + '"');
    to.key("distortion.coefficients",
           fmt::format("[{}]", fmt::join(t.distortion.coefficients, ", ")));
    to.effects.emplace_back("distortion");
  }
  if (f.vignetting) {
    const auto& v = f.vignetting->vignetting;
    to.key("vignetting.cosine_power", v.cosine_power);
    to.key("vignetting.barrel_ratio", v.barrel_ratio);
    to.key("vignetting.barrel_shift", v.barrel_shift);
    to.key("vignetting.polynomial", fmt::format("[{}]", fmt::join(v.polynomial, ", ")));
    to.effects.emplace_back("vignetting");
  }
  return to;
}

/// The start's file with what has been measured in it.
Result<std::string> camera_text(const Calibration& c, CalibrationFindings& f) {
  Changes changes = changes_of(c, f);
  std::vector<std::string> effects;
  for (const auto name : camera::effect_names()) {
    const bool before =
        std::any_of(c.start.stack.begin(), c.start.stack.end(),
                    [&](const camera::Effect& e) { return camera::info(e).name == name; });
    const bool measured =
        std::find(changes.effects.begin(), changes.effects.end(), name) != changes.effects.end();
    if (name == "dark_library" && before) {
      f.notes.emplace_back(
          "the camera's dark frames are left out: hot pixels and dark current stand "
          "for them");
      continue;
    }
    if (before || measured) effects.push_back(fmt::format("\"{}\"", name));
  }
  std::vector<std::string> set = c.file.set;
  set.push_back(fmt::format("effects=[{}]", fmt::join(effects, ", ")));
  const std::string name = c.file.name.empty() ? c.start.name + "_calibrated" : c.file.name;
  set.push_back(fmt::format("name=\"{}\"", name));
  set.push_back(fmt::format("description=\"{}, calibrated\"", c.start.name));
  set.insert(set.end(), changes.set.begin(), changes.set.end());
  MAQUETTE_TRY(const std::string text, camera_file_text(c.file.camera, set));
  return fmt::format(
      "# Written by `maquette calibrate` from {}. Measured: {}.\n# The rest is as in "
      "'{}'. Uncertainties are in calibration.json.\n{}",
      c.file.camera, fmt::join(changes.keys, ", "), c.file.camera, text);
}

nlohmann::ordered_json json_of(const Measured& m) {
  if (!m.known()) return nullptr;
  return {{"value", m.value}, {"u", m.u}};
}

nlohmann::ordered_json json_of(const CalibrationFindings& f) {
  nlohmann::ordered_json j{{"schema", "maquette.calibration_result/1"}};
  if (f.sensor) {
    const auto& s = *f.sensor;
    auto& to = j["sensor"];
    to = {{"gain_e_per_dn", json_of(s.gain_e_per_dn)},
          {"black_level_dn", json_of(s.black_level_dn)},
          {"temporal_dark_noise_e", json_of(s.temporal_dark_noise_e)},
          {"read_noise_e", json_of(s.read_noise_e)},
          {"row_noise_e", json_of(s.row_noise_e)},
          {"column_noise_e", json_of(f.column_noise_e)},
          {"dark_current_e_s", json_of(s.dark_current_e_s)},
          {"dsnu_e", json_of(f.dsnu_e)},
          {"dsnu_of_pixels_e", json_of(f.dsnu_pixel_e)},
          {"prnu", json_of(f.prnu)},
          {"hot_pixels_found", f.dark.hot_found},
          {"hot_pixel_rate_e_s", json_of(f.hot_rate_e_s)},
          {"saturation_dn", json_of(s.saturation_dn)},
          {"saturation_e", json_of(s.saturation_e)},
          {"full_well_e", json_of(s.full_well_e)},
          {"chi2_per_dof", s.chi2_per_dof}};
    for (const auto& p : s.points)
      to["levels"].push_back({{"exposure_s", p.exposure_s},
                              {"plane", p.plane},
                              {"signal_dn", p.signal_dn},
                              {"variance_dn2", json_of(p.variance_dn2)},
                              {"used", p.used},
                              {"saturated", p.saturated}});
  }
  if (f.targets) {
    const auto& t = *f.targets;
    auto& to = j["targets"];
    to = {{"focal_px", json_of(t.focal_px)}, {"aspect", json_of(t.aspect)},
          {"cx_px", json_of(t.cx_px)},       {"cy_px", json_of(t.cy_px)},
          {"skew_px", json_of(t.skew_px)},   {"distortion", t.distortion.model},
          {"noise_px", t.noise_px},          {"names", t.names},
          {"covariance", t.covariance}};
    to["coefficients"] = nlohmann::ordered_json::array();
    for (const auto& m : t.coefficients) to["coefficients"].push_back(json_of(m));
    for (std::size_t v = 0; v < t.views.size(); ++v) {
      // The project's cameras look along -z with y up.
      const RigidTransform pose =
          t.views[v].camera_from_target.inverse() * RigidTransform{{0.0, 1.0, 0.0, 0.0}, {}};
      const auto& q = pose.rotation;
      const auto& p = pose.translation_mm;
      to["pictures"].push_back({{"image", f.table->images[v]},
                                {"points", t.views[v].points},
                                {"rms_px", t.views[v].rms_px},
                                {"camera_position_mm", {p.x, p.y, p.z}},
                                {"camera_quaternion_wxyz", {q.w, q.x, q.y, q.z}}});
    }
    to["left_out_lines"] = nlohmann::ordered_json::array();
    for (const auto& r : t.residuals)
      if (r.left_out) to["left_out_lines"].push_back(f.table->lines[r.point]);
  }
  if (f.vignetting) {
    auto& to = j["vignetting"];
    to["cosine_power"] = f.vignetting->vignetting.cosine_power;
    const bool barrel = f.vignetting->vignetting.barrel_ratio > 0.0;
    for (std::size_t i = 0; i < f.vignetting->parameters.size(); ++i)
      to[barrel ? (i == 0 ? "barrel_ratio" : "barrel_shift") : fmt::format("a{}", 2 * i + 2)] =
          json_of(f.vignetting->parameters[i]);
    to["rms"] = f.vignetting->rms;
    for (const auto& s : f.vignetting->slopes) to["slopes"].push_back({s.x, s.y});
  }
  j["notes"] = nlohmann::ordered_json::array();
  if (f.sensor)
    for (const auto& n : f.sensor->notes) j["notes"].push_back(n);
  for (const auto& n : f.notes) j["notes"].push_back(n);
  return j;
}

std::string page_of(const CalibrationFindings& f, const nlohmann::ordered_json& j,
                    const fs::path& folder, const std::string& name) {
  Document d;
  d.push_back(Heading{1, "Calibration of " + name});
  const auto table = [&](const nlohmann::ordered_json& from) {
    Table t{{"quantity", "value", "standard uncertainty"}, {}};
    for (const auto& [key, value] : from.items())
      if (value.is_object() && value.contains("value"))
        t.rows.push_back({{key},
                          {fmt::format("{:.6g}", value["value"].get<double>()), true},
                          {fmt::format("{:.2g}", value["u"].get<double>()), true}});
      else if (value.is_null())
        t.rows.push_back({{key}, {"unknown", true}, {""}});
    d.push_back(t);
  };
  if (f.sensor) {
    d.push_back(Heading{2, "Sensor"});
    table(j["sensor"]);
    d.push_back(Picture{folder / "photon_transfer.png",
                        "variance against signal: blue levels carry the line, grey ones lie beyond "
                        "70 % of saturation, red ones saturate"});
  }
  if (f.targets) {
    d.push_back(Heading{2, "Lens"});
    nlohmann::ordered_json lens = j["targets"];
    for (std::size_t i = 0; i < f.targets->coefficients.size(); ++i)
      lens[f.targets->names[f.targets->names.size() - f.targets->coefficients.size() + i]] =
          json_of(f.targets->coefficients[i]);
    table(lens);
    d.push_back(
        Paragraph{fmt::format("Points are seen with {:.3g} pixel a coordinate, in {} "
                              "pictures.",
                              f.targets->noise_px, f.targets->views.size())});
    d.push_back(
        Picture{folder / "residuals.png", "where points are seen less where they should be"});
  }
  if (f.vignetting) {
    d.push_back(Heading{2, "Fall of light"});
    table(j["vignetting"]);
    d.push_back(Paragraph{fmt::format("Blocks of the flats lie about the law with {:.3g} %.",
                                      100.0 * f.vignetting->rms)});
  }
  for (const auto& note : j["notes"]) d.push_back(Paragraph{note.get<std::string>()});
  return "<!doctype html><meta charset=\"utf-8\"><title>calibration</title><style>body{font:15px "
         "sans-serif;max-width:70em;margin:1em auto;padding:0 1em}figure{width:auto!important}"
         "img{width:auto;max-width:100%}td,th{padding:2px 10px;text-align:left}td.n{text-align:"
         "right}</style>\n" +
         to_html(d);
}

}  // namespace

Result<JobResult> calibrate_job(const fs::path& path, const fs::path& folder,
                                const RunContext& run) {
  Calibration c;
  MAQUETTE_TRY(c.file, read_calibration(path));
  std::string camera_name = c.file.camera;
  if (fs::path(camera_name).extension() == ".toml" && fs::path(camera_name).is_relative())
    camera_name = (path.parent_path() / camera_name).string();
  c.file.camera = camera_name;
  MAQUETTE_TRY(c.start, read_camera(c.file.camera, c.file.set));
  c.largest_dn = camera::largest_dn(c.start.shot);
  c.mosaic = std::any_of(c.start.stack.begin(), c.start.stack.end(), [](const camera::Effect& e) {
    return std::holds_alternative<camera::Bayer>(e);
  });
  CalibrationFindings f;
  if (!c.file.points.empty()) MAQUETTE_TRY_VOID(calibrate_targets(c, f));
  run.progress(0.2);
  if (!c.file.bright.empty()) MAQUETTE_TRY_VOID(calibrate_sensor(c, f, run));
  run.progress(0.8);
  if (!c.file.flat.empty()) MAQUETTE_TRY_VOID(calibrate_vignetting(c, f, run));
  if (!f.sensor && !f.targets && !f.vignetting)
    return fail(camera::kCalibrationFrames,
                fmt::format("{}: dark frames alone do not say what a number is in electrons; add "
                            "[[bright]] of at least three levels",
                            path.string()));
  MAQUETTE_TRY(const std::string text, camera_text(c, f));
  const nlohmann::ordered_json j = json_of(f);
  std::error_code ec;
  fs::create_directories(folder, ec);
  if (ec) return tl::unexpected(write_error(folder, ec.value()));
  // What has been found must be a camera: distortion that folds within the picture is not one.
  const auto again = read_camera_text(text, "what has been measured");
  JobResult result;
  const std::string name = again ? again->name : c.start.name;
  result.figures_json = j.dump(1);
  result.outputs = {folder / "camera.toml", folder / "calibration.json"};
  if (f.sensor) {
    result.outputs.push_back(folder / "photon_transfer.png");
    MAQUETTE_TRY_VOID(
        camera::write_png(to_pixels(transfer_drawing(*f.sensor)), result.outputs.back()));
  }
  if (f.targets) {
    result.outputs.push_back(folder / "residuals.png");
    MAQUETTE_TRY_VOID(camera::write_png(to_pixels(residual_drawing(*f.targets, f.table->points)),
                                        result.outputs.back()));
  }
  result.outputs.push_back(folder / "calibration.html");
  MAQUETTE_TRY_VOID(write_file(folder / "calibration.json", result.figures_json + "\n"));
  MAQUETTE_TRY_VOID(write_file(folder / "calibration.html", page_of(f, j, folder, name)));
  if (!again) return tl::unexpected(again.error());
  MAQUETTE_TRY_VOID(write_file(folder / "camera.toml", text));
  std::vector<std::string> note;
  if (f.sensor)
    note.push_back(fmt::format("{:.4g} e per DN, read noise {:.3g} e",
                               f.sensor->gain_e_per_dn.value, f.sensor->read_noise_e.value));
  if (f.targets)
    note.push_back(fmt::format("focal length {:.2f} +- {:.2g} px", f.targets->focal_px.value,
                               f.targets->focal_px.u));
  if (f.vignetting)
    note.push_back(fmt::format("fall of light to {:.2g} %", 100.0 * f.vignetting->rms));
  result.note = fmt::format("{}", fmt::join(note, ", "));
  return result;
}

}  // namespace maquette::tools
