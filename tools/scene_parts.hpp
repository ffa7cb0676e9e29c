// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file scene_parts.hpp
/// What a scene file may add to its surface and first lamp: materials, objects, lamps, panels.

#include <cmath>
#include <deque>
#include <filesystem>
#include <string>
#include <vector>

#include "camera/render.hpp"
#include "core/result.hpp"
#include "tools/schema.hpp"

namespace maquette::tools {

/// A [[material]] table. Lists of one value stand for all three bands.
struct SceneMaterial {
  std::string name, law = "lambert";
  std::vector<double> albedo{0.3}, w{0.3}, n{1.35, 0.97, 0.62}, k{7.47, 6.40, 5.30}, tint{1.0};
  double lunar_lambert_l = 0.5, sigma_deg = 20.0, alpha = 0.2, scale = 1.0;
  std::string form = "2012";
  double b = 0.0, c = 0.0, surge = 0.0, surge_width = 0.1, coherent = 0.0, coherent_width = 0.1,
         roughness_deg = 0.0, filling = 0.0;
  std::filesystem::path table, albedo_map;
  std::vector<double> map_rectangle_mm;
};
/// An [[object]] table: a mesh in a pose.
struct SceneMesh {
  std::filesystem::path mesh;
  std::string material;  ///< empty: as the mesh's file has it
  Vec3 position_mm;
  Quaternion quaternion_wxyz;
  double scale = 1.0;
};
/// A [[lamp]] table, or the lamp_ keys of the file. What is NaN or empty is the preset's, or,
/// without one, as said beside it.
struct SceneLamp {
  std::string preset;  ///< of assets/devices.hpp
  Vec3 position_mm, target_mm;
  double diameter_mm = NAN;  ///< 0
  double beam_deg = NAN;     ///< 180; of the first lamp 56
  double sun_diameter_deg = -1.0;
  double kelvin = NAN;           ///< 0: white
  double illuminance_lux = NAN;  ///< 0: not known
  std::vector<double> irradiance{1.0};
  std::filesystem::path intensity, spectrum;
};
struct ScenePanel {
  Vec3 corner_mm, side_a_mm, side_b_mm;
  std::vector<double> radiance{1.0};
};

struct SceneParts {
  std::deque<SceneMaterial> materials;
  std::deque<SceneMesh> objects;
  std::deque<SceneLamp> lamps;
  std::deque<ScenePanel> panels;
};

void add_materials(Schema& schema, std::deque<SceneMaterial>& materials);
void add_objects(Schema& schema, std::deque<SceneMesh>& objects);
/// The four arrays of tables.
void add_scene_parts(Schema& schema, SceneParts& parts);

/// Of length 1, squared to a thousandth.
[[nodiscard]] bool is_rotation(const Quaternion& q);
/// TOOLS_CONFIG_INVALID: the quaternion is no rotation.
[[nodiscard]] Result<RigidTransform> pose_of(const SceneMesh& object);
/// One value for all bands, or three. TOOLS_CONFIG_INVALID names the key.
[[nodiscard]] Result<camera::Bands> bands_of(const std::vector<double>& values,
                                             const std::string& key);
/// CAMERA_BRDF_FILE, CAMERA_IMAGE_*, TOOLS_CONFIG_INVALID.
[[nodiscard]] Result<camera::Material> material_of(const SceneMaterial& m);
/// The same of the one of that name. TOOLS_CONFIG_INVALID: there is none.
[[nodiscard]] Result<camera::Material> find_material(const std::deque<SceneMaterial>& materials,
                                                     const std::string& name);
/// A grey surface's law: lambert, lommel_seeliger or lunar_lambert.
[[nodiscard]] camera::Law law_by_name(const std::string& name, double albedo,
                                      double lunar_lambert_l);
}  // namespace maquette::tools
