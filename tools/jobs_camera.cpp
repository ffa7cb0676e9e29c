// SPDX-License-Identifier: GPL-3.0-or-later
#include <cmath>
#include <numbers>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "assets/devices.hpp"
#include "camera/image_io.hpp"
#include "core/files.hpp"
#include "heightmap/field_io.hpp"
#include "tools/jobs.hpp"

namespace maquette::tools {
using nlohmann::json;
namespace {

/// Unit vector to a place at `azimuth` (clockwise from north) and `elevation`.
Vec3 direction_to(double azimuth_deg, double elevation_deg) {
  const double a = degrees(azimuth_deg).value();
  const double e = degrees(elevation_deg).value();
  return {std::sin(a) * std::cos(e), std::cos(a) * std::cos(e), std::sin(e)};
}

std::string list(Vec3 v) {
  return fmt::format("[{}, {}, {}]", v.x, v.y, v.z);
}

Vec3 middle_of(const heightmap::ModelField& field) {
  const double x = 0.5 * (field.x_mm(0) + field.x_mm(field.z_mm.cols() - 1));
  const double y = 0.5 * (field.y_mm(0) + field.y_mm(field.z_mm.rows() - 1));
  return {x, y, heightmap::height_at(field, x, y)};
}

}  // namespace

Result<JobResult> scene_job(const Site& site, const fs::path& design_path, const fs::path& stones,
                            const fs::path& scene) {
  MAQUETTE_TRY(const auto design, heightmap::read_model_field(design_path));
  const auto camera = *assets::find_preset(assets::camera_presets(), site.camera);
  const Vec3 middle = middle_of(design);
  double distance = site.camera_distance_mm;
  if (distance == 0.0) {
    // The part's diagonal fills the shorter side of the frame.
    const double short_side_mm =
        std::min(camera.width_px, camera.height_px) * camera.pixel_pitch_um / 1000.0;
    distance = site.size_mm * std::numbers::sqrt2 * camera.focal_length_mm / short_side_mm;
  }
  const double lamp_distance =
      std::max(site.lamp_distance_mm, 1.5 * site.size_mm * std::numbers::sqrt2);
  const Vec3 position =
      middle + distance * direction_to(site.camera_azimuth_deg, site.camera_elevation_deg);
  const Vec3 lamp_position =
      middle + lamp_distance * direction_to(site.lamp_azimuth_deg, site.lamp_elevation_deg);
  std::string text = "schema = \"maquette.scene/1\"\n";
  const auto relative = [&](const fs::path& path) {
    return path.lexically_relative(scene.parent_path()).generic_string();
  };
  text +=
      fmt::format("surface = \"{}\"\nstones = \"{}\"\n", relative(design_path), relative(stones));
  text +=
      fmt::format("resolution_px = [{}, {}]\npixel_pitch_um = {}\nfocal_length_mm = {}\n",
                  camera.width_px, camera.height_px, camera.pixel_pitch_um, camera.focal_length_mm);
  text +=
      fmt::format("camera_position_mm = {}\ncamera_target_mm = {}\n", list(position), list(middle));
  text += fmt::format("lamp_position_mm = {}\nlamp_target_mm = {}\n", list(lamp_position),
                      list(middle));
  text += fmt::format("lamp_preset = \"{}\"\nlamp_samples = {}\n", site.lamp, site.lamp_samples);
  // White facing the lamp would be 1; the ground is darker and seen obliquely.
  text += fmt::format("exposure_scale = {}\nalbedo = {}\nreflectance = \"{}\"\n", 0.8 / site.albedo,
                      site.albedo, site.reflectance);
  text += fmt::format("samples_per_pixel = {}\nseed = {}\n", site.samples_per_pixel, site.seed);
  MAQUETTE_TRY_VOID(write_file(scene, text));
  JobResult result;
  result.outputs = {scene};
  return result;
}

}  // namespace maquette::tools
