// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/scene_file.hpp"

#include <fmt/format.h>

#include "tools/camera_file.hpp"
#include "tools/scene_lamps.hpp"

namespace maquette::tools {
namespace {

constexpr double kInf = INFINITY;

/// A camera by its name, or by its file beside the one that names it.
Result<CameraFile> camera_of(const std::string& name, const std::filesystem::path& from) {
  const std::filesystem::path path(name);
  return read_camera(path.extension() == ".toml" && path.is_relative()
                         ? (from.parent_path() / path).string()
                         : name);
}

/// 0 if the camera has none.
double read_noise_of(const CameraFile& camera) {
  for (const camera::Effect& e : camera.stack)
    if (const auto* noise = std::get_if<camera::ReadNoise>(&e)) return noise->sigma_e;
  return 0.0;
}

}  // namespace

Result<std::unique_ptr<Scene>> read_scene(const std::filesystem::path& path) {
  auto scene = std::make_unique<Scene>();
  Scene& s = *scene;
  Schema t;
  t.add({"schema", &s.schema_name, "", -kInf, kInf, {"maquette.scene/1"}});
  t.add({"surface", &s.surface, "mesh or model field", -kInf, kInf, {}, true});
  t.add({"corrections", &s.corrections, "of `deviate`: where the surface really lies"});
  t.add({"stones", &s.stones, "stones.json: laid on the surface"});
  t.add({"surface_material", &s.surface_material,
         "name of a [[material]], instead of albedo and reflectance"});
  t.add(
      {"stone_material", &s.stone_material, "the same for the stones; the surface's unless given"});
  t.add({"camera", &s.camera,
         "name or .toml (docs/camera.md), instead of the four keys that follow"});
  t.add({"resolution_px", &s.resolution_px, "width, height", 1, 100000});
  t.add({"principal_point_px", &s.principal_point_px, "the middle unless given", -1e6, 1e6});
  t.add({"pixel_pitch_um", &s.pixel_pitch_um, "", 0.01, 1000});
  t.add({"focal_length_mm", &s.focal_length_mm, "", 0.1, 100000});
  t.add({"through_lens", &s.through_lens,
         "rays through the lens' opening instead of a pinhole: what is out of focus is blurred"});
  t.add({"f_number", &s.f_number, "with through_lens; `camera`'s, or 8", 0.5, 1000});
  t.add(
      {"focus_mm", &s.focus_mm,
       "with through_lens: distance in focus along the axis; 0: what the middle sees; `camera`'s, "
       "or 0",
       0, kInf});
  t.add({"blades", &s.blades, "with through_lens: of the opening; 0: round; `camera`'s, or 0", 0,
         30});
  t.add({"blade_rotation_deg", &s.blade_rotation_deg, "with through_lens; `camera`'s, or 0", -360,
         360});
  t.add({"camera_position_mm", &s.camera_position_mm, ""});
  t.add({"camera_quaternion_wxyz", &s.camera_quaternion_wxyz,
         "model_from_camera, camera looks along -z, y up", -1, 1});
  t.add({"camera_target_mm", &s.camera_target_mm, "looked at, instead of the quaternion"});
  t.add({"lamp_position_mm", &s.lamp_position_mm, ""});
  t.add({"lamp_target_mm", &s.lamp_target_mm, ""});
  t.add({"lamp_preset", &s.lamp_preset, "what no lamp_ key says is as of that lamp", -kInf, kInf,
         lamp_names()});
  t.add({"lamp_diameter_mm", &s.lamp_diameter_mm, "0: point lamp", 0, 1e5});
  t.add({"lamp_beam_deg", &s.lamp_beam_deg, "full angle; stretches a preset's intensities", 0.01,
         180});
  t.add({"exposure_scale", &s.exposure_scale,
         "value of a white Lambert surface that faces the lamp at its target", 1e-9, 1e9});
  t.add({"white_balance", &s.white_balance, "factors on the picture's bands, besides", 0, 1e6});
  t.add({"lamp_irradiance", &s.lamp_irradiance,
         "of the first lamp at its target, beside those of [[lamp]], ambient and panels", 0, 1e9});
  t.add({"albedo", &s.albedo, "", 0.001, 1});
  t.add({"reflectance",
         &s.reflectance,
         "",
         -kInf,
         kInf,
         {"lambert", "lommel_seeliger", "lunar_lambert"}});
  t.add({"lunar_lambert_l", &s.lunar_lambert_l, "McEwen's L", 0, 1});
  t.add({"samples_per_pixel", &s.samples_per_pixel, "a square number", 1, 1024});
  t.add({"lamp_samples", &s.lamp_samples, "", 1, 1024});
  t.add({"seed", &s.seed, "", 0, 1e15});
  t.add({"sun_diameter_deg", &s.sun_diameter_deg,
         "the lamp is a sun in its direction, of this angle; -1: a lamp", -1, 60});
  t.add({"lamp_intensity", &s.lamp_intensity, "against angle: .ies (LM-63) or CSV"});
  t.add({"lamp_kelvin", &s.lamp_kelvin, "colour temperature; 0: white", 0, 1e5});
  t.add({"lamp_spectrum", &s.lamp_spectrum, "CSV wavelength_nm,value, instead of lamp_kelvin"});
  t.add(
      {"filters", &s.filters,
       "CSV wavelength_nm,r,g,b: through which lamps with a colour are seen; boxes unless given"});
  t.add({"lamp_illuminance_lux", &s.lamp_illuminance_lux,
         "at the target: the picture's metadata say what 1.0 is in W/m2/sr; 0: not known", 0, 1e9});
  t.add({"ambient", &s.ambient, "radiance of the room's walls, one value or R, G, B", 0, 1e9});
  t.add({"gather_samples", &s.gather_samples, "rays per sample for the room and the bounce", 0,
         4096});
  t.add({"bounce", &s.bounce, "one diffuse interreflection"});
  t.add({"noise_target", &s.noise_target, "standard error as a share of the value; 0: off", 0, 1});
  t.add({"max_samples", &s.max_samples, "per pixel, with a noise target", 1, 65536});
  t.add({"geometry", &s.geometry, "normals, positions, angles and parts in the EXR"});
  t.add({"trajectory", &s.trajectory,
         "CSV time_s,x_mm,y_mm,z_mm,qw,qx,qy,qz: numbered pictures instead of one"});
  t.array("pose", "a picture from each, numbered, instead of the one from camera_position_mm",
          [&s] {
            ScenePose& pose = s.poses.emplace_back();
            Schema e;
            e.add({"position_mm", &pose.position_mm, "", -kInf, kInf, {}, true});
            e.add({"target_mm", &pose.target_mm, "looked at, instead of the quaternion"});
            e.add({"quaternion_wxyz", &pose.quaternion_wxyz,
                   "model_from_camera, camera looks along -z, y up", -1, 1});
            return e;
          });
  add_scene_parts(t, s.parts);
  MAQUETTE_TRY_VOID(t.read(path));
  if (s.resolution_px.size() != 2)
    return fail(kConfigInvalid,
                fmt::format("{}: resolution_px must be [width, height]", path.string()));
  if (!s.principal_point_px.empty() && s.principal_point_px.size() != 2)
    return fail(kConfigInvalid,
                fmt::format("{}: principal_point_px must be [x, y]", path.string()));
  if (!s.poses.empty() && !s.trajectory.empty())
    return fail(kConfigInvalid, fmt::format("{}: a trajectory and [[pose]] tables; either expected",
                                            path.string()));
  for (const auto& [key, given] : {std::pair{"f_number", !std::isnan(s.f_number)},
                                   {"focus_mm", !std::isnan(s.focus_mm)},
                                   {"blades", s.blades >= 0},
                                   {"blade_rotation_deg", !std::isnan(s.blade_rotation_deg)}})
    if (given && !s.through_lens)
      return fail(kConfigInvalid,
                  fmt::format("{}: {} without through_lens = true, without which all is sharp",
                              path.string(), key));
  camera::LensOpening lens{8.0, 0.0, 0, 0.0};
  if (!s.camera.empty()) {
    MAQUETTE_TRY(const CameraFile file, camera_of(s.camera, path));
    lens.f_number = file.shot.f_number;
    for (const camera::Effect& e : file.stack)
      if (const auto* blur = std::get_if<camera::DepthOfField>(&e))
        lens = {lens.f_number, blur->focus_mm, blur->blades, blur->rotation_deg};
    const camera::Shot& shot = file.shot;
    const camera::Intrinsics& k = shot.intrinsics;
    s.resolution_px = {1.0 * k.width_px, 1.0 * k.height_px};
    s.pixel_pitch_um = shot.pixel_pitch_um, s.focal_length_mm = shot.focal_length_mm;
    s.principal_point_px = {k.cx_px, k.cy_px};
    s.aspect = k.fy_px / k.fx_px, s.skew_px = k.skew_px;
  }
  if (std::isnan(s.f_number)) s.f_number = lens.f_number;
  if (std::isnan(s.focus_mm)) s.focus_mm = lens.focus_mm;
  if (s.blades < 0) s.blades = lens.blades;
  if (std::isnan(s.blade_rotation_deg)) s.blade_rotation_deg = lens.rotation_deg;
  return scene;
}

Result<std::unique_ptr<Case>> read_case(const std::filesystem::path& path) {
  auto result = std::make_unique<Case>();
  Case& c = *result;
  Schema t;
  t.add({"schema", &c.schema_name, "", -kInf, kInf, {"maquette.case/1"}});
  t.add({"design",
         &c.design,
         "designed surface, model frame, mm: a field, for deviate also a mesh",
         -kInf,
         kInf,
         {},
         true});
  t.add({"gcode", &c.gcode, "the program that was run; a list for bands, in the order of milling"});
  t.add(
      {"ground", &c.ground, "the design without stones; with `stones`, their poses are measured"});
  t.add({"stones", &c.stones, "plan of the stones"});
  t.add({"as_milled", &c.as_milled,
         "simulated cut of the ground: what it leaves on the design is expected, not found"});
  t.add({"tool.ball_diameter_mm", &c.ball_diameter_mm, "", 0.01, 1000});
  t.add({"tool.contact",
         &c.contact,
         "which pass made a place: that whose ball touches it, or, of a much finer cutter, the one "
         "just above; not given: what fits the data better",
         -kInf,
         kInf,
         {"ball", "tip"}});
  t.add({"coating.thickness_mm", &c.coating_thickness_mm, "as declared", 0, 100});
  t.add({"coating.roughness_sigma_mm", &c.coating_roughness_sigma_mm, "", 0, 10});
  t.add({"coating.roughness_correlation_mm", &c.coating_roughness_correlation_mm, "", 0, 1000});
  t.add({"deviation.reach_mm", &c.reach_mm, "farther points are off the part", 0.01, 1000});
  t.add({"deviation.scale", &c.scale, "the scans' scale is unknown and estimated"});
  t.add({"deviation.regions", &c.regions,
         "GeoJSON polygons in mm, with name, lower_mm, upper_mm; or closed curves of a DXF"});
  t.add({"deviation.bands", &c.bands,
         "statistics per band: bands.json of `maquette bands`, whose joints keep off stones"});
  t.add({"deviation.band_width_mm", &c.band_width_mm,
         "the same of even strips along x, at most so wide; 0: none", 0, 1e5});
  const auto datum_schema = [&c] {
    CaseDatum& datum = c.datums.emplace_back();
    Schema e;
    e.add({"kind", &datum.kind, "", -kInf, kInf, {"pad", "sphere", "dowel"}, true});
    e.add({"name", &datum.name, ""});
    e.add({"at_mm", &datum.at_mm, "middle of a pad, centre of a sphere, end of a dowel"});
    e.add({"axis", &datum.axis, "of a dowel, from its end", -1, 1});
    e.add({"radius_mm", &datum.radius_mm, "sphere, dowel", 0, 1000});
    e.add({"length_mm", &datum.length_mm, "dowel", 0, 1000});
    e.add({"half_x_mm", &datum.half_x_mm, "pad", 0, 1e5});
    e.add({"half_y_mm", &datum.half_y_mm, "pad", 0, 1e5});
    return e;
  };
  t.array("datum", "features that tie the pose: bare pads, spheres, dowels", datum_schema);
  t.add({"datums", &c.datum_file, "file with more [[datum]], as `maquette spheres` writes it"});
  t.array("scan", "measured point clouds", [&c] {
    CaseScan& scan = c.scans.emplace_back();
    Schema e;
    e.add({"points", &scan.points, "point cloud, mm", -kInf, kInf, {}, true});
    e.add({"scanner_position_mm", &scan.scanner_position_mm, "in the cloud's frame"});
    e.add({"range_sigma_mm", &scan.range_sigma_mm, "", 0, 100});
    e.add({"beam_diameter_mm", &scan.beam_diameter_mm,
           "at the part: points that are mixed of two surfaces, and those whose beam crosses the "
           "rim, are "
           "left out; 0: a ray",
           0, 100});
    return e;
  });
  t.array("axis", "linear axes of the set-up", [&c] {
    CaseAxis& axis = c.axes.emplace_back();
    Schema e;
    e.add({"name", &axis.name, "", -kInf, kInf, {}, true});
    e.add({"stops",
           &axis.stops,
           "CSV of position_mm,x_mm,y_mm,z_mm of a mark on the carriage",
           -kInf,
           kInf,
           {},
           true});
    return e;
  });
  t.array("profile", "lines over the part along which deviations are shown", [&c] {
    CaseProfile& line = c.profiles.emplace_back();
    Schema e;
    e.add({"name", &line.name, ""});
    e.add({"from_mm", &line.from_mm, "x, y of the model frame", -1e5, 1e5, {}, true});
    e.add({"to_mm", &line.to_mm, "x, y of the model frame", -1e5, 1e5, {}, true});
    e.add({"width_mm", &line.width_mm, "points up to half of it to either side count", 1e-3, 1e4});
    e.add({"step_mm", &line.step_mm, "of one value; 0: as some 30 points need", 0, 1e4});
    return e;
  });
  t.array("probe", "probed or CMM points", [&c] {
    CaseProbe& probe = c.probes.emplace_back();
    Schema e;
    e.add({"points", &probe.points, "CSV, mm", -kInf, kInf, {}, true});
    return e;
  });
  t.array("cause", "what a diagnosis has added to the model", [&c] {
    CaseCause& cause = c.causes.emplace_back();
    Schema e;
    e.add({"effect", &cause.effect, "", -kInf, kInf, {}, true});
    e.add({"law", &cause.law, ""});
    e.add({"contact", &cause.contact, "as of tool, for all causes", -kInf, kInf, {"ball", "tip"}});
    e.add({"names", &cause.names, "of the parameters"});
    e.add({"values", &cause.values, "of the parameters", -1e12, 1e12});
    e.add({"fixed_names", &cause.fixed_names, "of what the law fixes"});
    e.add({"fixed_values", &cause.fixed_values, "of what the law fixes", -1e12, 1e12});
    return e;
  });
  add_materials(t, c.materials);
  add_objects(t, c.objects);
  t.array("photo", "photographs", [&c] {
    CasePhoto& p = c.photos.emplace_back();
    Schema e;
    e.add({"image", &p.image, "", -kInf, kInf, {}, true});
    e.add({"camera", &p.camera,
           "name or .toml (docs/camera.md), instead of resolution, principal point, pitch, focal "
           "length, full well and read noise"});
    e.add({"encoding", &p.encoding, "", -kInf, kInf, {"linear", "srgb"}});
    e.add({"resolution_px", &p.resolution_px, "width, height", 1, 100000});
    e.add({"principal_point_px", &p.principal_point_px, "the middle unless given", -1e6, 1e6});
    e.add({"pixel_pitch_um", &p.pixel_pitch_um, "", 0.01, 1000});
    e.add({"focal_length_mm", &p.focal_length_mm, "", 0.1, 100000});
    e.add({"camera_position_mm", &p.camera_position_mm, ""});
    e.add({"camera_quaternion_wxyz", &p.camera_quaternion_wxyz, "", -1, 1});
    e.add({"lamp_position_mm", &p.lamp_position_mm, ""});
    e.add({"lamp_target_mm", &p.lamp_target_mm, ""});
    e.add({"lamp_diameter_mm", &p.lamp_diameter_mm, "", 0, 1e5});
    e.add({"lamp_beam_deg", &p.lamp_beam_deg, "", 0.01, 180});
    e.add({"exposure_scale", &p.exposure_scale, "", 1e-9, 1e9});
    e.add({"albedo", &p.albedo, "", 0.001, 1});
    e.add({"reflectance",
           &p.reflectance,
           "",
           -kInf,
           kInf,
           {"lambert", "lommel_seeliger", "lunar_lambert"}});
    e.add({"material", &p.material, "name of a [[material]], instead of albedo and reflectance"});
    e.add({"full_well_e", &p.full_well_e, "", 1, 1e9});
    e.add({"read_noise_e", &p.read_noise_e, "", 0, 1e6});
    e.add({"surface", &p.surface, "", -kInf, kInf, {"design", "as_milled"}});
    e.add({"held_out", &p.held_out, "has no part in the diagnosis: compared with what was found"});
    return e;
  });
  MAQUETTE_TRY_VOID(t.read(path));
  if (!c.datum_file.empty()) {
    Schema more;
    more.array("datum", "", datum_schema);
    MAQUETTE_TRY_VOID(more.read(c.datum_file));
  }
  for (CaseProfile& line : c.profiles) {
    if (line.name.empty()) line.name = fmt::format("profile {}", &line - &c.profiles.front() + 1);
    if (line.from_mm.size() != 2 || line.to_mm.size() != 2 || line.from_mm == line.to_mm)
      return fail(kConfigInvalid,
                  fmt::format("{}: {}: from_mm and to_mm must be two different places [x, y]",
                              path.string(), line.name));
  }
  for (CasePhoto& p : c.photos) {
    if (p.camera.empty()) continue;
    MAQUETTE_TRY(const CameraFile file, camera_of(p.camera, path));
    const camera::Shot& shot = file.shot;
    const camera::Intrinsics& k = shot.intrinsics;
    if (k.fx_px != k.fy_px || k.skew_px != 0.0)
      return fail(kConfigInvalid,
                  fmt::format("{}: {}: camera '{}' has skew or pixels that are not square; a "
                              "diagnosis knows square ones only: resample the photograph",
                              path.string(), p.image.string(), p.camera));
    p.resolution_px = {1.0 * k.width_px, 1.0 * k.height_px};
    p.principal_point_px = {k.cx_px, k.cy_px};
    p.pixel_pitch_um = shot.pixel_pitch_um, p.focal_length_mm = shot.focal_length_mm;
    p.full_well_e = shot.full_well_e;
    p.read_noise_e = read_noise_of(file);
  }
  if (c.scans.empty() && c.probes.empty() && c.photos.empty())
    return fail(kConfigInvalid,
                fmt::format("{}: no measurement; add a [[scan]] table with points = \"FILE\"",
                            path.string()));
  return result;
}

}  // namespace maquette::tools
