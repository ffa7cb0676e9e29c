// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/scene_loading.hpp"

#include <algorithm>
#include <cmath>
#include <map>

#include <fmt/format.h>

#include "heightmap/field_io.hpp"
#include "meshing/mesh_io.hpp"
#include "meshing/stones.hpp"
#include "tools/corrections_file.hpp"
#include "tools/jobs.hpp"
#include "tools/scene_cover.hpp"
#include "tools/scene_lamps.hpp"

namespace maquette::tools {
namespace {

constexpr double kBaseThicknessMm = 10.0;  ///< of a field's block, as where it is made a mesh

Result<void> load_surface(const Scene& s, const camera::Material& material, LoadedScene& to,
                          const RunContext& run) {
  if (is_field(s.surface) && s.corrections.empty()) {
    MAQUETTE_TRY(to.field, heightmap::read_model_field(s.surface));
    const auto lowest = static_cast<double>(heightmap::height_range(to.field.z_mm).min);
    camera::SceneObject ground;
    ground.material = material;
    ground.field = &to.field;
    ground.base_mm = lowest - kBaseThicknessMm;
    to.objects.push_back(std::move(ground));
    to.triangles +=
        2 * static_cast<std::size_t>((to.field.z_mm.rows() - 1) * (to.field.z_mm.cols() - 1));
    return {};
  }
  MAQUETTE_TRY(TriMesh mesh, load_solid(s.surface, run));
  if (!s.corrections.empty()) {
    MAQUETTE_TRY(const Corrections corrections, read_corrections(s.corrections));
    for (Vec3& v : mesh.vertices_mm) v = corrections.actual_from_planned.point(v);
  }
  to.meshes.push_back(std::move(mesh));
  to.objects.push_back({&to.meshes.back(), material});
  return {};
}

/// Stones of one shape have one mesh in as many poses and sizes; a stone whose shape no other has
/// lies in the model frame as it is.
void add_stones(const std::vector<meshing::PlacedStone>& stones, const camera::Material& material,
                const RigidTransform& lies, LoadedScene& to) {
  struct Shape {
    const meshing::PlacedStone* first;
    std::size_t stones = 0;
    const TriMesh* mesh = nullptr;
  };
  std::deque<Shape> shapes;
  std::vector<Shape*> shape_of;
  for (const auto& stone : stones) {
    auto known = std::find_if(shapes.begin(), shapes.end(),
                              [&](const Shape& s) { return meshing::same_shape(*s.first, stone); });
    if (known == shapes.end()) known = shapes.insert(shapes.end(), Shape{&stone});
    ++known->stones;
    shape_of.push_back(&*known);
  }
  for (std::size_t i = 0; i < stones.size(); ++i) {
    const auto& stone = stones[i];
    Shape& shape = *shape_of[i];
    camera::SceneObject object{nullptr, material, lies};
    if (shape.stones == 1) {
      to.meshes.push_back(meshing::stone_mesh(stone));
      object.mesh = &to.meshes.back();
    } else {
      if (shape.mesh == nullptr) {
        to.meshes.push_back(meshing::unit_stone(stone.shape, stone.body));
        shape.mesh = &to.meshes.back();
      }
      object.mesh = shape.mesh;
      object.scale = stone.scale_mm;
      object.model_from_mesh = lies * stone.model_from_stone;
    }
    to.objects.push_back(std::move(object));
  }
}

Result<void> load_objects(const Scene& s, const camera::Material& surface, LoadedScene& to,
                          const RunContext& run) {
  if (!s.stones.empty()) {
    camera::Material material = surface;
    if (!s.stone_material.empty()) {
      MAQUETTE_TRY(material, find_material(s.parts.materials, s.stone_material));
    }
    MAQUETTE_TRY(const auto stones, meshing::read_stone_plan(s.stones));
    RigidTransform lies;  // glued on, they go with the surface
    if (!s.corrections.empty()) {
      MAQUETTE_TRY(const Corrections corrections, read_corrections(s.corrections));
      lies = corrections.actual_from_planned;
    }
    add_stones(stones, material, lies, to);
  }
  // One copy of a file, painted or not: its triangles are the same.
  struct Known {
    const TriMesh* mesh = nullptr;
    std::shared_ptr<const camera::MeshCover> cover;
  };
  std::map<fs::path, Known> known;
  for (const SceneMesh& o : s.parts.objects) {
    Known& of = known[o.mesh];
    camera::Material material;
    if (!o.material.empty()) {
      MAQUETTE_TRY(material, find_material(s.parts.materials, o.material));
    }
    const bool painted = o.material.empty();
    if (painted && of.cover == nullptr) {
      MAQUETTE_TRY(auto fresh, load_covered_mesh(o.mesh, s.parts.materials, run));
      of.cover = std::move(fresh.cover);
      to.files.insert(to.files.end(), fresh.files.begin(), fresh.files.end());
      if (of.mesh == nullptr) {
        to.meshes.push_back(std::move(fresh.mesh));
        of.mesh = &to.meshes.back();
      }
    }
    if (of.mesh == nullptr) {
      MAQUETTE_TRY(TriMesh fresh, meshing::read_mesh(o.mesh, run));
      to.meshes.push_back(std::move(fresh));
      of.mesh = &to.meshes.back();
    }
    MAQUETTE_TRY(const RigidTransform pose, pose_of(o));
    camera::SceneObject object{of.mesh, material, pose};
    object.scale = o.scale;
    if (painted) object.cover = of.cover;
    to.objects.push_back(std::move(object));
  }
  for (const TriMesh& mesh : to.meshes) to.triangles += mesh.triangles.size();
  return {};
}

constexpr double kFirstBeamDeg = 56.0;  ///< of the first lamp, unless it says otherwise

SceneLamp first_lamp_of(const Scene& s) {
  SceneLamp first;
  first.preset = s.lamp_preset;
  first.position_mm = s.lamp_position_mm;
  first.target_mm = s.lamp_target_mm;
  first.diameter_mm = s.lamp_diameter_mm;
  first.beam_deg = s.lamp_beam_deg;
  first.sun_diameter_deg = s.sun_diameter_deg;
  first.kelvin = s.lamp_kelvin;
  first.illuminance_lux = s.lamp_illuminance_lux;
  first.irradiance = s.lamp_irradiance;
  first.intensity = s.lamp_intensity;
  first.spectrum = s.lamp_spectrum;
  return first;
}

Result<void> load_lighting(const Scene& s, LoadedScene& to) {
  MAQUETTE_TRY(const Filters filters, filters_of(s.filters));
  const SceneLamp first = first_lamp_of(s);
  MAQUETTE_TRY(auto lamp, lamp_of(first, filters, kFirstBeamDeg));
  MAQUETTE_TRY(to.white_radiance, white_radiance_of(first, lamp, filters));
  to.lighting.lamps.push_back(std::move(lamp));
  for (const SceneLamp& l : s.parts.lamps) {
    MAQUETTE_TRY(auto more, lamp_of(l, filters));
    to.lighting.lamps.push_back(std::move(more));
  }
  MAQUETTE_TRY(to.lighting.ambient, bands_of(s.ambient, "ambient"));
  for (const ScenePanel& p : s.parts.panels) {
    MAQUETTE_TRY(const auto radiance, bands_of(p.radiance, "panel: radiance"));
    to.lighting.panels.push_back({p.corner_mm, p.side_a_mm, p.side_b_mm, radiance});
  }
  return {};
}

}  // namespace

Result<std::unique_ptr<LoadedScene>> load_scene(const Scene& s, const RunContext& run) {
  auto loaded = std::make_unique<LoadedScene>();
  camera::Material surface{"surface", law_by_name(s.reflectance, s.albedo, s.lunar_lambert_l), {}};
  if (!s.surface_material.empty()) {
    MAQUETTE_TRY(surface, find_material(s.parts.materials, s.surface_material));
  }
  MAQUETTE_TRY_VOID(load_surface(s, surface, *loaded, run));
  MAQUETTE_TRY_VOID(load_objects(s, surface, *loaded, run));
  MAQUETTE_TRY_VOID(load_lighting(s, *loaded));
  return loaded;
}

camera::CameraModel camera_of(const Scene& s) {
  const bool middle = s.principal_point_px.empty();
  return {static_cast<int>(s.resolution_px[0]),
          static_cast<int>(s.resolution_px[1]),
          s.pixel_pitch_um,
          s.focal_length_mm,
          middle ? NAN : s.principal_point_px[0],
          middle ? NAN : s.principal_point_px[1],
          s.aspect,
          s.skew_px,
          s.through_lens ? camera::LensOpening{s.f_number, s.focus_mm, static_cast<int>(s.blades),
                                               s.blade_rotation_deg}
                         : camera::LensOpening{}};
}

RigidTransform pose_of(const Scene& s) {
  return std::isnan(s.camera_target_mm.x)
             ? RigidTransform{normalized(s.camera_quaternion_wxyz), s.camera_position_mm}
             : camera::look_at(s.camera_position_mm, s.camera_target_mm);
}

Result<std::vector<RigidTransform>> poses_of(const Scene& s) {
  std::vector<RigidTransform> poses;
  for (const ScenePose& p : s.poses) {
    if (!std::isnan(p.target_mm.x)) {
      poses.push_back(camera::look_at(p.position_mm, p.target_mm));
      continue;
    }
    if (!is_rotation(p.quaternion_wxyz))
      return fail(kConfigInvalid, fmt::format("pose {}: the quaternion is no rotation; its length "
                                              "must be 1",
                                              poses.size() + 1));
    poses.push_back({normalized(p.quaternion_wxyz), p.position_mm});
  }
  return poses;
}

Result<camera::RenderOptions> render_options_of(const Scene& s) {
  camera::RenderOptions options;
  options.samples_per_pixel = static_cast<int>(s.samples_per_pixel);
  options.lamp_samples = static_cast<int>(s.lamp_samples);
  options.exposure_scale = s.exposure_scale;
  MAQUETTE_TRY(options.white_balance, bands_of(s.white_balance, "white_balance"));
  options.seed = static_cast<std::uint64_t>(s.seed);
  options.gather_samples = static_cast<int>(s.gather_samples);
  options.bounce = s.bounce;
  options.noise_target = s.noise_target;
  options.max_samples = static_cast<int>(s.max_samples);
  options.geometry = s.geometry;
  return options;
}

}  // namespace maquette::tools
