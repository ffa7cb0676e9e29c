// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file scene_file.hpp
/// Scene files (what `render` takes) and case files (what `deviate` takes), with
/// the keys of a [[photo]] and a [[scan]] spelled the same way in both.

#include <deque>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "camera/render.hpp"
#include "core/result.hpp"
#include "tools/scene_parts.hpp"
#include "tools/schema.hpp"

namespace maquette::tools {

/// A [[pose]] table: the camera looks at a target, or lies as a quaternion says.
struct ScenePose {
  Vec3 position_mm;
  Vec3 target_mm{NAN, NAN, NAN};
  Quaternion quaternion_wxyz{1, 0, 0, 0};
};

struct Scene {
  std::string schema_name = "maquette.scene/1";
  std::filesystem::path surface;                 ///< mesh or model field
  std::filesystem::path corrections;             ///< where it really lies: corrections_file.hpp
  std::filesystem::path stones;                  ///< plan: laid on the surface
  std::string surface_material, stone_material;  ///< names; empty: albedo and reflectance below
  SceneParts parts;
  std::string camera;  ///< name or .toml; empty: resolution, pitch and focal length below
  std::vector<double> resolution_px{1024, 768};
  double pixel_pitch_um = 8.45, focal_length_mm = 35.0;
  std::vector<double> principal_point_px;  ///< empty: the middle
  double aspect = 1.0, skew_px = 0.0;      ///< of `camera`
  bool through_lens = false;               ///< rays through the lens' opening, not a pinhole
  double f_number = NAN, focus_mm = NAN, blade_rotation_deg = NAN;  ///< NaN: the camera's
  std::int64_t blades = -1;                                         ///< -1: the camera's
  Vec3 camera_position_mm{100.0, -400.0, 700.0};
  Quaternion camera_quaternion_wxyz{1, 0, 0, 0};
  Vec3 camera_target_mm{NAN, NAN, NAN};  ///< instead of the quaternion
  Vec3 lamp_position_mm{-3000.0, 500.0, 2500.0};
  Vec3 lamp_target_mm{100.0, 100.0, 0.0};
  std::string lamp_preset;
  double lamp_diameter_mm = NAN, lamp_beam_deg = NAN;  ///< NaN: SceneLamp says what then
  double exposure_scale = 1.0;
  std::vector<double> white_balance{1.0}, lamp_irradiance{1.0};
  double albedo = 0.3;
  std::string reflectance = "lambert";
  double lunar_lambert_l = 0.5;
  std::int64_t samples_per_pixel = 4, lamp_samples = 1, seed = 1;
  double sun_diameter_deg = -1.0, lamp_kelvin = NAN;
  std::filesystem::path lamp_intensity, lamp_spectrum;
  std::filesystem::path filters;  ///< empty: boxes
  double lamp_illuminance_lux = NAN;
  std::vector<double> ambient{0.0};
  std::int64_t gather_samples = 4, max_samples = 256;
  bool bounce = false, geometry = true;
  double noise_target = 0.0;
  std::filesystem::path trajectory;
  std::deque<ScenePose> poses;  ///< instead: numbered pictures without times
};
[[nodiscard]] Result<std::unique_ptr<Scene>> read_scene(const std::filesystem::path& path);

struct CaseScan {
  std::filesystem::path points;
  Vec3 scanner_position_mm{NAN, NAN, NAN};
  double range_sigma_mm = 0.05;
  double beam_diameter_mm = 0.0;  ///< at the part; 0: a ray
};
/// A feature that no coat has changed: tools/scene_file.cpp says what each kind needs.
struct CaseDatum {
  std::string kind = "pad", name;
  Vec3 at_mm, axis{0.0, 0.0, 1.0};
  double radius_mm = 0.0, length_mm = 0.0, half_x_mm = 0.0, half_y_mm = 0.0;
};
/// A linear axis of the set-up, measured at several stops.
struct CaseAxis {
  std::string name;
  std::filesystem::path stops;
};
/// A line over the part along which deviations are shown, in the plan.
struct CaseProfile {
  std::string name;
  std::vector<double> from_mm, to_mm;
  double width_mm = 2.0, step_mm = 0.0;
};
struct CaseProbe {
  std::filesystem::path points;
};
/// What a diagnosis has added to the model (extended.toml).
struct CaseCause {
  std::string effect, law;
  std::string contact;  ///< "tip": it was found so, and all causes with it
  std::vector<std::string> names, fixed_names;
  std::vector<double> values, fixed_values;
};
struct CasePhoto {
  std::filesystem::path image;
  std::string camera;  ///< name or .toml; empty: resolution and what follows
  std::string encoding = "linear", reflectance = "lambert", surface = "as_milled";
  std::string material;  ///< name; empty: albedo and reflectance
  std::vector<double> resolution_px{1024, 768}, principal_point_px;
  double pixel_pitch_um = 8.45, focal_length_mm = 35.0;
  Vec3 camera_position_mm, lamp_position_mm, lamp_target_mm;
  Quaternion camera_quaternion_wxyz;
  double lamp_diameter_mm = 0.0, lamp_beam_deg = 56.0, exposure_scale = 1.0, albedo = 0.3,
         full_well_e = 50000.0, read_noise_e = 20.0;
  bool held_out = false;
};
/// One case file serves every verb: what a verb has no use for (deviate none for
/// probes and photographs) is still checked, so that a typing error never waits.
struct Case {
  std::string schema_name = "maquette.case/1";
  std::filesystem::path design;
  std::vector<std::filesystem::path> gcode;  ///< programs of bands in the order of milling
  std::filesystem::path datum_file;          ///< more [[datum]], as `maquette spheres` writes them
  std::filesystem::path ground, stones;      ///< design without its stones, and their plan
  std::filesystem::path as_milled;           ///< simulated cut of the ground
  std::filesystem::path regions;             ///< GeoJSON
  std::filesystem::path bands;               ///< bands.json; empty: even ones, if any
  double band_width_mm = 0.0;                ///< 0 without `bands`: no table of bands
  double ball_diameter_mm = 6.0;
  std::string contact;  ///< "ball", "tip"; empty: as the causes say, or the data
  double coating_thickness_mm = 0.0, coating_roughness_sigma_mm = 0.04,
         coating_roughness_correlation_mm = 0.25;
  double reach_mm = 5.0;
  bool scale = false;  ///< is the scans' scale unknown?
  std::deque<CaseScan> scans;
  std::deque<CaseDatum> datums;
  std::deque<CaseAxis> axes;
  std::deque<CaseProfile> profiles;
  std::deque<CaseProbe> probes;
  std::deque<CaseCause> causes;
  std::deque<CasePhoto> photos;
  std::deque<SceneMesh> objects;  ///< in the photographs
  std::deque<SceneMaterial> materials;
};
[[nodiscard]] Result<std::unique_ptr<Case>> read_case(const std::filesystem::path& path);

}  // namespace maquette::tools
