// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/scene_parts.hpp"

#include <fmt/format.h>

#include "camera/image_io.hpp"
#include "tools/scene_lamps.hpp"

namespace maquette::tools {
namespace {

constexpr double kInf = INFINITY;

void describe(Schema& e, SceneMaterial& m) {
  e.add({"name", &m.name, "", -kInf, kInf, {}, true});
  e.add({"law",
         &m.law,
         "",
         -kInf,
         kInf,
         {"lambert", "lommel_seeliger", "lunar_lambert", "hapke", "oren_nayar", "ggx", "table"}});
  e.add({"albedo", &m.albedo, "one value or R, G, B; normal radiance factor", 0, 1});
  e.add({"lunar_lambert_l", &m.lunar_lambert_l, "McEwen's L", 0, 1});
  e.add({"w", &m.w, "hapke: single scattering albedo", 0, 1});
  e.add({"form", &m.form, "hapke", -kInf, kInf, {"1981", "1993", "2012"}});
  e.add({"b", &m.b, "hapke: asymmetry of the lobes", -0.99, 0.99});
  e.add({"c", &m.c, "hapke: share of the backward lobe", -1, 2});
  e.add({"surge", &m.surge, "hapke: shadow-hiding opposition", 0, 10});
  e.add({"surge_width", &m.surge_width, "hapke", 1e-6, 1e3});
  e.add({"coherent", &m.coherent, "hapke: coherent backscatter", 0, 10});
  e.add({"coherent_width", &m.coherent_width, "hapke", 1e-6, 1e3});
  e.add({"roughness_deg", &m.roughness_deg, "hapke: mean slope", 0, 59});
  e.add({"filling", &m.filling, "hapke: 1 - porosity", 0, 0.74});
  e.add({"sigma_deg", &m.sigma_deg, "oren_nayar: slope of the facets", 0, 60});
  e.add({"n", &m.n, "ggx: refractive index", 1e-3, 100});
  e.add({"k", &m.k, "ggx: its imaginary part", 0, 100});
  e.add({"tint", &m.tint, "ggx: what a film on top lets pass", 0, 1});
  e.add({"alpha", &m.alpha, "ggx: slope of the facets", 1e-3, 1});
  e.add({"table", &m.table, "table: CSV of a BRDF"});
  e.add({"scale", &m.scale, "table: factor", 0, 1e6});
  e.add({"albedo_map", &m.albedo_map, "image of factors, linear; north up"});
  e.add({"map_rectangle_mm", &m.map_rectangle_mm, "min x, min y, max x, max y", -1e9, 1e9});
}

Result<camera::Law> law_of(const SceneMaterial& m) {
  const auto key = [&m](const char* name) { return fmt::format("material {}: {}", m.name, name); };
  MAQUETTE_TRY(const auto albedo, bands_of(m.albedo, key("albedo")));
  if (m.law == "lommel_seeliger") return camera::LommelSeeliger{albedo};
  if (m.law == "lunar_lambert") return camera::LunarLambert{albedo, m.lunar_lambert_l};
  if (m.law == "oren_nayar") return camera::OrenNayar{albedo, m.sigma_deg};
  if (m.law == "ggx") {
    MAQUETTE_TRY(const auto n, bands_of(m.n, key("n")));
    MAQUETTE_TRY(const auto k, bands_of(m.k, key("k")));
    MAQUETTE_TRY(const auto tint, bands_of(m.tint, key("tint")));
    return camera::Ggx{n, k, tint, m.alpha};
  }
  if (m.law == "hapke") {
    using Form = camera::Hapke::Form;
    MAQUETTE_TRY(const auto w, bands_of(m.w, key("w")));
    return camera::Hapke{m.form == "1981"   ? Form::y1981
                         : m.form == "1993" ? Form::y1993
                                            : Form::y2012,
                         w,
                         m.b,
                         m.c,
                         m.surge,
                         m.surge_width,
                         m.coherent,
                         m.coherent_width,
                         m.roughness_deg,
                         m.filling};
  }
  if (m.law == "table") {
    if (m.table.empty())
      return fail(kConfigInvalid,
                  fmt::format("material {}: law = \"table\" needs table = \"FILE.csv\"", m.name));
    MAQUETTE_TRY(auto table, camera::read_brdf_table(m.table));
    table.scale = m.scale;
    return table;
  }
  return camera::Lambert{albedo};
}

Result<std::shared_ptr<const camera::AlbedoMap>> map_of(const SceneMaterial& m) {
  if (m.map_rectangle_mm.size() != 4)
    return fail(
        kConfigInvalid,
        fmt::format("material {}: albedo_map needs map_rectangle_mm = [min x, min y, max x, "
                    "max y]",
                    m.name));
  MAQUETTE_TRY(const auto image, camera::read_image(m.albedo_map));
  auto map = std::make_shared<camera::AlbedoMap>();
  map->min_x_mm = m.map_rectangle_mm[0], map->min_y_mm = m.map_rectangle_mm[1];
  map->max_x_mm = m.map_rectangle_mm[2], map->max_y_mm = m.map_rectangle_mm[3];
  for (std::size_t b = 0; b < 3; ++b) {
    const Grid<float>& from = image.channels[image.channels.size() >= 3 ? b : 0];
    Grid<float>& to = map->factor[b];
    to = Grid<float>(from.rows(), from.cols());
    for (std::ptrdiff_t r = 0; r < from.rows(); ++r)  // image files have north up
      for (std::ptrdiff_t c = 0; c < from.cols(); ++c) to(r, c) = from(from.rows() - 1 - r, c);
  }
  return map;
}

}  // namespace

void add_materials(Schema& schema, std::deque<SceneMaterial>& materials) {
  schema.array("material", "named, for the surface, stones and objects", [&materials] {
    Schema e;
    describe(e, materials.emplace_back());
    return e;
  });
}

void add_objects(Schema& schema, std::deque<SceneMesh>& objects) {
  schema.array("object", "meshes such as a spacecraft's parts", [&objects] {
    SceneMesh& o = objects.emplace_back();
    Schema e;
    e.add({"mesh", &o.mesh, "closed, mm", -kInf, kInf, {}, true});
    e.add({"material", &o.material, "name of a [[material]]; none: as the mesh's file has it"});
    e.add({"position_mm", &o.position_mm, "of the mesh's origin"});
    e.add({"quaternion_wxyz", &o.quaternion_wxyz, "model_from_mesh", -1, 1});
    e.add({"scale", &o.scale, "of the mesh", 1e-9, 1e9});
    return e;
  });
}

void add_scene_parts(Schema& schema, SceneParts& parts) {
  add_materials(schema, parts.materials);
  add_objects(schema, parts.objects);
  schema.array("lamp", "more lamps", [&parts] {
    SceneLamp& l = parts.lamps.emplace_back();
    Schema e;
    e.add({"preset", &l.preset, "what is not given here is as of that lamp", -kInf, kInf,
           lamp_names()});
    e.add({"position_mm", &l.position_mm, "", -kInf, kInf, {}, true});
    e.add({"target_mm", &l.target_mm, "", -kInf, kInf, {}, true});
    e.add({"diameter_mm", &l.diameter_mm, "of the lens; 0: point", 0, 1e5});
    e.add({"beam_deg", &l.beam_deg, "full angle; stretches a preset's intensities", 0.01, 360});
    e.add({"sun_diameter_deg", &l.sun_diameter_deg, "a sun in that direction; -1: a lamp", -1, 60});
    e.add({"irradiance", &l.irradiance, "at the target, one value or R, G, B", 0, 1e9});
    e.add({"kelvin", &l.kelvin, "colour temperature; 0: white", 0, 1e5});
    e.add({"intensity", &l.intensity, "against angle: .ies (LM-63) or CSV"});
    e.add({"spectrum", &l.spectrum, "CSV wavelength_nm,value, instead of kelvin"});
    return e;
  });
  schema.array("panel", "bright rectangles of the room", [&parts] {
    ScenePanel& p = parts.panels.emplace_back();
    Schema e;
    e.add({"corner_mm", &p.corner_mm, "", -kInf, kInf, {}, true});
    e.add({"side_a_mm", &p.side_a_mm, "from the corner", -kInf, kInf, {}, true});
    e.add({"side_b_mm", &p.side_b_mm, "from the corner", -kInf, kInf, {}, true});
    e.add({"radiance", &p.radiance, "1: white under the lamp; one value or R, G, B", 0, 1e9});
    return e;
  });
}

bool is_rotation(const Quaternion& q) {
  return std::abs(q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z - 1.0) <= 1e-3;
}

Result<RigidTransform> pose_of(const SceneMesh& object) {
  if (!is_rotation(object.quaternion_wxyz))
    return fail(kConfigInvalid, fmt::format("object {}: the quaternion is no rotation; its length "
                                            "must be 1",
                                            object.mesh.string()));
  return RigidTransform{normalized(object.quaternion_wxyz), object.position_mm};
}

Result<camera::Bands> bands_of(const std::vector<double>& values, const std::string& key) {
  if (values.size() == 1) return camera::Bands{values[0], values[0], values[0]};
  if (values.size() == 3) return camera::Bands{values[0], values[1], values[2]};
  return fail(kConfigInvalid, fmt::format("{}: one value or three (R, G, B) expected, {} given",
                                          key, values.size()));
}

Result<camera::Material> material_of(const SceneMaterial& m) {
  MAQUETTE_TRY(auto law, law_of(m));
  camera::Material material{m.name, std::move(law), {}};
  if (!m.albedo_map.empty()) {
    MAQUETTE_TRY(material.map, map_of(m));
  }
  MAQUETTE_TRY_VOID(camera::check_material(material));
  return material;
}

Result<camera::Material> find_material(const std::deque<SceneMaterial>& materials,
                                       const std::string& name) {
  for (const SceneMaterial& m : materials)
    if (m.name == name) return material_of(m);
  std::string known;
  for (const SceneMaterial& m : materials) known += (known.empty() ? "" : ", ") + m.name;
  return fail(kConfigInvalid,
              fmt::format("material \"{}\" is not described; [[material]] tables: {}", name,
                          known.empty() ? "none" : known));
}

camera::Law law_by_name(const std::string& name, double albedo, double lunar_lambert_l) {
  const camera::Bands bands{albedo, albedo, albedo};
  if (name == "lommel_seeliger") return camera::LommelSeeliger{bands};
  if (name == "lunar_lambert") return camera::LunarLambert{bands, lunar_lambert_l};
  return camera::Lambert{bands};
}

}  // namespace maquette::tools
