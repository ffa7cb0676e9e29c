// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/camera_file.hpp"

#include <algorithm>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <nlohmann/json.hpp>

#include "camera/image_io.hpp"
#include "core/nearest_name.hpp"
#include "tools/built_in_cameras.hpp"
#include "tools/jobs.hpp"
#include "tools/schema_text.hpp"

namespace maquette::tools {
namespace {

constexpr double kInf = INFINITY;

struct DarkFrame {
  fs::path image;
  double temperature_c = 20.0, exposure_s = 1.0;
};

/// One of each effect, and what the file holds in its own units.
struct CameraText {
  std::string schema_name = "maquette.camera/1", name, description;
  camera::Shot shot;
  std::int64_t width = 1024, height = 768, bits = 14, serial = 1;
  std::vector<double> principal_point_px{};
  double skew_px = 0.0, aspect = 1.0;
  Vec3 angular_rate_deg_s;
  std::vector<std::string> effects{"exposure", "quantum_efficiency", "adc", "white_balance",
                                   "tone"};
  std::tuple<camera::RollingShutter, camera::DepthOfField, camera::Distortion, camera::Vignetting,
             camera::Diffraction, camera::VeilingGlare, camera::Exposure, camera::Bayer,
             camera::Prnu, camera::Smear, camera::DarkCurrent, camera::HotPixels,
             camera::DarkLibrary, camera::FullWell, camera::Dsnu, camera::ReadNoise,
             camera::RowColumnNoise, camera::Demosaic, camera::WhiteBalance, camera::PictureNoise,
             camera::Tone, camera::Jpeg>
      params;
  std::int64_t dof_blades = 0, diffraction_blades = 0, jpeg_quality = 92;
  std::vector<DarkFrame> dark_frames;

  template <class E>
  E& of() {
    return std::get<E>(params);
  }
};

void add_body(Schema& s, CameraText& t) {
  s.add({"schema", &t.schema_name, "", -kInf, kInf, {"maquette.camera/1"}});
  s.add({"name", &t.name, ""});
  s.add({"description", &t.description, ""});
  std::vector<std::string> known;
  for (const auto n : camera::effect_names()) known.emplace_back(n);
  s.add({"effects", &t.effects, "in the order of physics; `maquette stack` lists all", -kInf, kInf,
         known});
  s.section("lens", "");
  s.add({"lens.focal_length_mm", &t.shot.focal_length_mm, "", 0.1, 1e5});
  s.add({"lens.f_number", &t.shot.f_number, "", 0.5, 1000});
  s.section("sensor", "");
  s.add({"sensor.width_px", &t.width, "", 1, 100000});
  s.add({"sensor.height_px", &t.height, "", 1, 100000});
  s.add({"sensor.pixel_pitch_um", &t.shot.pixel_pitch_um, "", 0.01, 1000});
  s.add({"sensor.aspect", &t.aspect, "fy / fx", 0.01, 100});
  s.add({"sensor.principal_point_px", &t.principal_point_px,
         "from the upper left corner, pixel centres at halves; absent: the middle", -1e6, 1e6});
  s.add({"sensor.skew_px", &t.skew_px, "entry (0, 1) of K", -1e6, 1e6});
  s.add({"sensor.wavelength_nm", &t.shot.wavelength_nm, "middle of each band", 10, 1e5});
  s.add({"sensor.quantum_efficiency", &t.shot.quantum_efficiency,
         "electrons for a photon, by band; one value: a grey sensor", 1e-6, 1});
  s.add({"sensor.full_well_e", &t.shot.full_well_e, "", 1, 1e9});
  s.add(
      {"sensor.gain_e_per_dn", &t.shot.gain_e_per_dn, "0: the full well fills the range", 0, 1e9});
  s.add({"sensor.bits", &t.bits, "of the converter", 1, 24});
  s.add({"sensor.black_level_dn", &t.shot.black_level_dn, "", 0, 1e7});
  s.add({"sensor.temperature_c", &t.shot.temperature_c, "", -200, 150});
  s.add({"sensor.serial", &t.serial, "whose fixed pattern it is", 0, 1e15});
  s.section("motion", "of the camera in its own frame: x right, y up, z backwards");
  s.add({"motion.velocity_mm_s", &t.shot.velocity_mm_s, ""});
  s.add({"motion.angular_rate_deg_s", &t.angular_rate_deg_s, ""});
}

void add_optics(Schema& s, CameraText& t) {
  s.section("rolling_shutter", "");
  s.add({"rolling_shutter.row_s", &t.of<camera::RollingShutter>().row_s, "from row to row", -1, 1});
  auto& dof = t.of<camera::DepthOfField>();
  s.section("depth_of_field", "");
  s.add(
      {"depth_of_field.focus_mm", &dof.focus_mm, "0: the depth in the picture's middle", 0, 1e15});
  s.add({"depth_of_field.blades", &t.dof_blades, "0: round", 0, 30});
  s.add({"depth_of_field.rotation_deg", &dof.rotation_deg, "", -360, 360});
  auto& distortion = t.of<camera::Distortion>();
  s.section("distortion", "");
  s.add({"distortion.model",
         &distortion.model,
         "",
         -kInf,
         kInf,
         {"quotient", "division", "brown_conrady"}});
  s.add({"distortion.coefficients", &distortion.coefficients,
         "units of the focal length; brown_conrady: k1, k2, p1, p2, k3, k4, k5, k6", -1e6, 1e6});
  s.add({"distortion.band_scale", &distortion.band_scale, "magnification less 1 of each band", -0.5,
         0.5});
  s.add({"distortion.red", &distortion.red, "in place of coefficients", -1e6, 1e6});
  s.add({"distortion.blue", &distortion.blue, "in place of coefficients", -1e6, 1e6});
  auto& vignetting = t.of<camera::Vignetting>();
  s.section("vignetting", "");
  s.add({"vignetting.cosine_power", &vignetting.cosine_power, "", 0, 20});
  s.add({"vignetting.barrel_ratio", &vignetting.barrel_ratio, "0: no barrel", 0, 100});
  s.add({"vignetting.barrel_shift", &vignetting.barrel_shift, "pupil radii per tangent", 0, 1000});
  s.add({"vignetting.polynomial", &vignetting.polynomial, "a2, a4, a6 over half the diagonal", -100,
         100});
  auto& diffraction = t.of<camera::Diffraction>();
  s.section("diffraction", "");
  s.add({"diffraction.blades", &t.diffraction_blades, "0: round", 0, 30});
  s.add({"diffraction.rotation_deg", &diffraction.rotation_deg, "", -360, 360});
  s.add({"diffraction.reach_px", &diffraction.reach_px, "of the rays", 3, 250});
  s.section("veiling_glare", "");
  s.add({"veiling_glare.share", &t.of<camera::VeilingGlare>().share, "of all light", 0, 1});
}

void add_charge(Schema& s, CameraText& t) {
  auto& exposure = t.of<camera::Exposure>();
  s.section("exposure", "");
  s.add({"exposure.time_s", &t.shot.exposure_s, "", 1e-9, 1e6});
  s.add({"exposure.radiance_of_one", &exposure.radiance_of_one,
         "W m^-2 sr^-1 of value 1 in each band; 0: not known", 0, 1e12});
  s.add({"exposure.transmission", &exposure.transmission, "of the lens", 1e-6, 1});
  s.add({"exposure.magnification", &exposure.magnification, "of the image", 0, 100});
  s.add({"exposure.electrons_at_one", &exposure.electrons_at_one,
         "if radiance_of_one is not known; 0: the full well", 0, 1e12});
  s.section("bayer", "");
  s.add({"bayer.pattern",
         &t.of<camera::Bayer>().pattern,
         "",
         -kInf,
         kInf,
         {"rggb", "bggr", "grbg", "gbrg"}});
  s.section("prnu", "");
  s.add({"prnu.sigma", &t.of<camera::Prnu>().sigma, "of each pixel's gain", 0, 0.2});
  s.section("smear", "");
  s.add({"smear.row_shift_s", &t.of<camera::Smear>().row_shift_s, "frame transfer", 0, 1});
  auto& dark = t.of<camera::DarkCurrent>();
  s.section("dark_current", "");
  s.add({"dark_current.rate_e_s", &dark.rate_e_s, "", 0, 1e9});
  s.add({"dark_current.reference_c", &dark.reference_c, "", -200, 150});
  auto& hot = t.of<camera::HotPixels>();
  s.section("hot_pixels", "");
  s.add({"hot_pixels.share", &hot.share, "of all pixels", 0, 0.5});
  s.add({"hot_pixels.mean_rate_e_s", &hot.mean_rate_e_s, "", 0, 1e9});
  s.add({"hot_pixels.reference_c", &hot.reference_c, "", -200, 150});
  s.section("full_well", "");
  s.add({"full_well.blooming_share", &t.of<camera::FullWell>().blooming_share, "0: drained", 0, 1});
  s.section("dsnu", "");
  s.add({"dsnu.sigma_e", &t.of<camera::Dsnu>().sigma_e, "", 0, 1e6});
  s.section("read_noise", "");
  s.add({"read_noise.sigma_e", &t.of<camera::ReadNoise>().sigma_e, "", 0, 1e6});
  auto& lines = t.of<camera::RowColumnNoise>();
  s.section("row_column_noise", "");
  s.add({"row_column_noise.row_sigma_e", &lines.row_sigma_e, "", 0, 1e6});
  s.add({"row_column_noise.column_sigma_e", &lines.column_sigma_e, "", 0, 1e6});
}

void add_picture(Schema& s, CameraText& t) {
  s.section("demosaic", "");
  s.add({"demosaic.method",
         &t.of<camera::Demosaic>().method,
         "",
         -kInf,
         kInf,
         {"malvar", "bilinear"}});
  s.section("white_balance", "");
  s.add({"white_balance.gains", &t.of<camera::WhiteBalance>().gains,
         "of each band; 0: from quantum efficiency", 0, 1000});
  auto& noise = t.of<camera::PictureNoise>();
  s.section("picture_noise", "");
  s.add({"picture_noise.hot_pixel_share", &noise.hot_pixel_share, "", 0, 1});
  s.add({"picture_noise.colour_sigma", &noise.colour_sigma, "parts of white", 0, 10});
  s.add({"picture_noise.monochrome_sigma", &noise.monochrome_sigma, "parts of white", 0, 10});
  auto& tone = t.of<camera::Tone>();
  s.section("tone", "");
  s.add({"tone.curve", &tone.curve, "", -kInf, kInf, {"srgb", "gamma", "linear"}});
  s.add({"tone.gamma", &tone.gamma, "", 0.1, 10});
  s.section("jpeg", "");
  s.add({"jpeg.quality", &t.jpeg_quality, "", 1, 100});
  s.array("dark_frame", "measured dark frames, for dark_library", [&t] {
    DarkFrame& d = t.dark_frames.emplace_back();
    Schema e;
    e.add({"image", &d.image, "electrons: the numbers of the file", -kInf, kInf, {}, true});
    e.add({"temperature_c", &d.temperature_c, "", -200, 150, {}, true});
    e.add({"exposure_s", &d.exposure_s, "", 1e-9, 1e6, {}, true});
    return e;
  });
}

Schema schema_of(CameraText& t) {
  t.dark_frames.reserve(1000);  // the schema points into it
  Schema s;
  add_body(s, t);
  add_optics(s, t);
  add_charge(s, t);
  add_picture(s, t);
  return s;
}

/// The effect of that name with the file's parameters.
template <std::size_t I = 0>
void push_effect(CameraText& t, const std::string& name, camera::Stack& stack) {
  if constexpr (I < std::variant_size_v<camera::Effect>) {
    using E = std::variant_alternative_t<I, camera::Effect>;
    if (name != E::kInfo.name) return push_effect<I + 1>(t, name, stack);
    if constexpr (std::is_empty_v<E>)
      stack.emplace_back(E{});
    else
      stack.emplace_back(t.of<E>());
  }
}

Result<void> load_dark_frames(CameraText& t) {
  for (const DarkFrame& d : t.dark_frames) {
    MAQUETTE_TRY(auto image, camera::read_image(d.image));
    const auto grey = std::find(image.names.begin(), image.names.end(), "Y");
    const auto k = grey == image.names.end() ? 0 : grey - image.names.begin();
    camera::DarkLibrary::Entry entry{d.temperature_c,
                                     std::move(image.channels[static_cast<std::size_t>(k)])};
    // Whole numbers come as parts of the highest.
    const double electrons = image.highest > 0.0 ? image.highest : 1.0;
    for (float& v : entry.rate_e_s.cells())
      v = static_cast<float>(electrons * static_cast<double>(v) / d.exposure_s);
    t.of<camera::DarkLibrary>().frames.push_back(std::move(entry));
  }
  return {};
}

Result<CameraFile> camera_of(CameraText& t) {
  CameraFile file;
  file.name = t.name;
  t.of<camera::DepthOfField>().blades = static_cast<int>(t.dof_blades);
  t.of<camera::Diffraction>().blades = static_cast<int>(t.diffraction_blades);
  t.of<camera::Jpeg>().quality = static_cast<int>(t.jpeg_quality);
  MAQUETTE_TRY_VOID(load_dark_frames(t));
  camera::Shot& shot = file.shot = t.shot;
  shot.bits = static_cast<int>(t.bits);
  shot.serial = static_cast<std::uint64_t>(t.serial);
  shot.angular_rate_rad_s = degrees(1.0).value() * t.angular_rate_deg_s;
  shot.intrinsics = camera::intrinsics_of(static_cast<int>(t.width), static_cast<int>(t.height),
                                          shot.pixel_pitch_um, shot.focal_length_mm);
  shot.intrinsics.fy_px *= t.aspect;
  shot.intrinsics.skew_px = t.skew_px;
  if (!t.principal_point_px.empty()) {
    if (t.principal_point_px.size() != 2)
      return fail(kConfigInvalid, "sensor.principal_point_px must be two numbers");
    shot.intrinsics.cx_px = t.principal_point_px[0];
    shot.intrinsics.cy_px = t.principal_point_px[1];
  }
  for (const std::string& effect : t.effects) push_effect(t, effect, file.stack);
  MAQUETTE_TRY_VOID(camera::check(file.stack, file.shot));
  return file;
}

Result<void> read_text(CameraText& t, const std::string& name_or_path,
                       const std::vector<std::string>& overrides) {
  Schema schema = schema_of(t);
  for (const BuiltInCamera& built_in : kBuiltInCameras)
    if (built_in.name == name_or_path)
      return read_schema_text(schema, std::string(built_in.text), name_or_path, fs::current_path(),
                              overrides);
  if (fs::path(name_or_path).extension() != ".toml") {
    const std::string near = nearest_name(name_or_path, camera_names());
    return fail(kUnknownName,
                fmt::format("no camera is called '{}'; known: {}, or a .toml file{}", name_or_path,
                            fmt::join(camera_names(), ", "),
                            near.empty() ? "" : fmt::format("; did you mean '{}'?", near)));
  }
  return schema.read(name_or_path, overrides);
}

}  // namespace

std::vector<std::string> camera_names() {
  std::vector<std::string> names;
  for (const BuiltInCamera& c : kBuiltInCameras) names.emplace_back(c.name);
  return names;
}

Result<CameraFile> read_camera(const std::string& name_or_path,
                               const std::vector<std::string>& overrides) {
  CameraText t;
  MAQUETTE_TRY_VOID(read_text(t, name_or_path, overrides));
  auto camera = camera_of(t);
  if (!camera) return tl::unexpected(std::move(camera.error()).within(name_or_path));
  return camera;
}

Result<CameraFile> read_camera_text(const std::string& text, const std::string& place) {
  CameraText t;
  Schema schema = schema_of(t);
  MAQUETTE_TRY_VOID(read_schema_text(schema, text, place, fs::current_path()));
  auto camera = camera_of(t);
  if (!camera) return tl::unexpected(std::move(camera.error()).within(place));
  return camera;
}

Result<std::string> camera_file_text(const std::string& name_or_path,
                                     const std::vector<std::string>& overrides) {
  CameraText t;
  MAQUETTE_TRY_VOID(read_text(t, name_or_path, overrides));
  // The template shows arrays as comments only.
  std::string frames;
  for (const DarkFrame& d : t.dark_frames)
    frames += fmt::format("[[dark_frame]]\nimage = {}\ntemperature_c = {}\nexposure_s = {}\n",
                          nlohmann::json(d.image.string()).dump(), d.temperature_c, d.exposure_s);
  return schema_of(t).template_text() + frames;
}

}  // namespace maquette::tools
