// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/scanner_file.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <toml++/toml.h>

#include "core/nearest_name.hpp"
#include "tools/jobs.hpp"
#include "tools/schema.hpp"

namespace maquette::tools {
namespace {

constexpr double kInf = INFINITY;
constexpr double kArcsec = 4.84813681109536e-6;  // radians

/// What the file holds in its own units.
struct PhaseShiftText {
  PhaseShiftScanner s;
  std::string kind = "phase_shift", base;
  std::int64_t rays = 7;
  double noise = 0, index = 0, collimation = 0, trunnion = 0, ecc_h = 0, ecc_h_phase = 0, ecc_v = 0,
         ecc_v_phase = 0, cyclic_phase = 0;
};

Schema schema_of(PhaseShiftText& t) {
  assets::ScannerPreset& p = t.s.preset;
  Schema s;
  s.add({"kind", &t.kind, "", -kInf, kInf, {"phase_shift"}, true});
  s.add({"preset", &t.base, "whose values count where a key is absent"});
  s.add({"name", &p.name, ""});
  s.add({"vendor", &p.vendor, "written into files that hold it"});
  s.add({"model", &p.model, "written into files that hold it"});
  s.add({"lines_per_turn", &p.lines_per_turn, "steps of both angles in 360 degrees", 4, 1e9});
  s.add({"turns_per_s", &p.turns_per_s, "of the mirror, a line each", 1e-6, 1e6});
  s.add({"largest_zenith_deg", &p.largest_zenith_deg, "below it the foot hides the view", 1, 180});
  s.add({"least_signal", &p.least_signal, "below: no point; 1: white, facing, at 3 m", 0, 1e6});
  s.section("range", "");
  s.add({"range.resolution_mm", &p.range_resolution_mm, "ranges are whole steps; 0: not", 0, 1e3});
  s.add({"range.sigma_mm", &p.range_sigma_mm, "at 3 m, perpendicular on 50 % grey", 0, 1e3});
  s.add({"range.noise_exponent", &p.noise_exponent, "noise goes with signal^-this", 0, 4});
  s.add({"range.unambiguous_mm", &p.unambiguous_mm, "half modulation wavelengths, coarse to fine",
         1e-3, 1e9});
  s.add({"range.offset_mm", &t.s.range.offset_mm, "error", -1e3, 1e3});
  s.add({"range.scale_ppm", &t.s.range.scale_ppm, "error", -1e5, 1e5});
  s.add({"range.cyclic_mm", &t.s.range.cyclic_mm, "error with the finest wavelength", -1e3, 1e3});
  s.add({"range.cyclic_phase_deg", &t.cyclic_phase, "", -360, 360});
  s.add(
      {"range.incidence_mm", &t.s.range.incidence_mm, "error, times tan^2(incidence)", -1e3, 1e3});
  s.section("beam", "");
  s.add({"beam.diameter_mm", &p.beam_diameter_mm, "at exit, 1/e^2", 0, 1e3});
  s.add({"beam.divergence_mrad", &p.beam_divergence_mrad, "full angle, 1/e^2", 0, 100});
  s.add({"beam.footprint_rays", &t.rays,
         "1: without width; 7: of smooth surfaces, 61 at edges; more: everywhere", 1, 10000});
  s.section("angles", "errors, seconds of arc");
  s.add({"angles.encoder_noise_arcsec", &t.noise, "standard deviation, each circle", 0, 2e4});
  s.add({"angles.vertical_index_arcsec", &t.index, "", -2e4, 2e4});
  s.add({"angles.collimation_arcsec", &t.collimation, "over sin(zenith)", -2e4, 2e4});
  s.add({"angles.trunnion_arcsec", &t.trunnion, "times cot(zenith)", -2e4, 2e4});
  s.add({"angles.eccentricity_h_arcsec", &t.ecc_h, "of the horizontal circle", -2e4, 2e4});
  s.add({"angles.eccentricity_h_phase_deg", &t.ecc_h_phase, "", -360, 360});
  s.add({"angles.eccentricity_v_arcsec", &t.ecc_v, "of the vertical circle", -2e4, 2e4});
  s.add({"angles.eccentricity_v_phase_deg", &t.ecc_v_phase, "", -360, 360});
  return s;
}

struct StructuredLightText {
  assets::StructuredLightPreset p;
  std::string kind = "structured_light", base;
  std::int64_t width = 0, height = 0;
};

Schema schema_of(StructuredLightText& t) {
  assets::StructuredLightPreset& p = t.p;
  Schema s;
  s.add({"kind", &t.kind, "", -kInf, kInf, {"structured_light"}, true});
  s.add({"preset", &t.base, "whose values count where a key is absent"});
  s.add({"name", &p.name, ""});
  s.add({"vendor", &p.vendor, "written into files that hold it"});
  s.add({"model", &p.model, "written into files that hold it"});
  s.section("camera", "");
  s.add({"camera.width_px", &t.width, "", 1, 100000});
  s.add({"camera.height_px", &t.height, "", 1, 100000});
  s.add({"camera.focal_length_px", &p.focal_length_px, "in its pixels", 1, 1e7});
  s.add({"camera.exposure", &p.exposure,
         "sensor value (1 saturates) of white that faces the projector at the working distance",
         1e-9, 1e9});
  s.add({"camera.least_value", &p.least_value, "darker pixels give no point", 0, 1});
  s.add(
      {"camera.steepest_deg", &p.steepest_deg, "incidence of the view; steeper: no point", 0, 90});
  s.section("projector", "");
  s.add({"projector.baseline_mm", &p.baseline_mm, "to the right of the camera", 1e-3, 1e5});
  s.add({"projector.working_distance_mm", &p.working_distance_mm, "where both axes meet", 1, 1e6});
  s.add(
      {"projector.width_deg", &p.projector_width_deg, "full angle across the stripes", 0.01, 170});
  s.add(
      {"projector.height_deg", &p.projector_height_deg, "full angle along the stripes", 0.01, 170});
  s.section("noise", "");
  s.add({"noise.stripe_sigma_px", &p.stripe_sigma_px, "of a stripe's place, in camera pixels", 0,
         100});
  s.add({"noise.exponent", &p.noise_exponent, "noise goes with value^-this", 0, 4});
  s.section("gloss", "of the surface");
  s.add({"gloss.value", &p.gloss, "sensor value at the mirror angle", 0, 1e9});
  s.add({"gloss.exponent", &p.gloss_exponent, "of the lobe", 0, 1e6});
  return s;
}

PhaseShiftText text_of(const PhaseShiftScanner& s) {
  PhaseShiftText t;
  t.s = s;
  t.rays = s.footprint_rays;
  const scan::AngularErrors& a = s.angular;
  t.noise = a.encoder_noise_rad / kArcsec;
  t.index = a.vertical_index_rad / kArcsec;
  t.collimation = a.collimation_rad / kArcsec;
  t.trunnion = a.trunnion_rad / kArcsec;
  t.ecc_h = a.eccentricity_h_rad / kArcsec;
  t.ecc_v = a.eccentricity_v_rad / kArcsec;
  t.ecc_h_phase = a.eccentricity_h_phase_rad / degrees(1.0).value();
  t.ecc_v_phase = a.eccentricity_v_phase_rad / degrees(1.0).value();
  t.cyclic_phase = s.range.cyclic_phase_rad / degrees(1.0).value();
  return t;
}

PhaseShiftScanner scanner_of(const PhaseShiftText& t) {
  PhaseShiftScanner s = t.s;
  s.footprint_rays = static_cast<int>(t.rays);
  scan::AngularErrors& a = s.angular;
  a.encoder_noise_rad = t.noise * kArcsec;
  a.vertical_index_rad = t.index * kArcsec;
  a.collimation_rad = t.collimation * kArcsec;
  a.trunnion_rad = t.trunnion * kArcsec;
  a.eccentricity_h_rad = t.ecc_h * kArcsec;
  a.eccentricity_v_rad = t.ecc_v * kArcsec;
  a.eccentricity_h_phase_rad = degrees(t.ecc_h_phase).value();
  a.eccentricity_v_phase_rad = degrees(t.ecc_v_phase).value();
  s.range.cyclic_phase_rad = degrees(t.cyclic_phase).value();
  return s;
}

StructuredLightText text_of(const assets::StructuredLightPreset& p) {
  StructuredLightText t;
  t.p = p;
  t.width = p.width_px;
  t.height = p.height_px;
  return t;
}

/// A string key at the top of a file that may be wrong elsewhere; that is said later.
std::string peek(const std::filesystem::path& file, const char* key) {
  try {
    return toml::parse_file(file.string())[key].value_or(std::string{});
  } catch (const toml::parse_error&) {
    return {};
  }
}

}  // namespace

std::vector<std::string> scanner_names() {
  std::vector<std::string> names;
  for (const auto& p : assets::scanner_presets()) names.push_back(p.name);
  for (const auto& p : assets::structured_light_presets()) names.push_back(p.name);
  return names;
}

const std::string& scanner_name(const Scanner& scanner) {
  if (const auto* s = std::get_if<PhaseShiftScanner>(&scanner)) return s->preset.name;
  return std::get<assets::StructuredLightPreset>(scanner).name;
}

Result<Scanner> find_scanner(const std::string& name) {
  if (const auto p = assets::find_preset(assets::scanner_presets(), name))
    return PhaseShiftScanner{*p, {}, {}, 7};
  if (const auto p = assets::find_preset(assets::structured_light_presets(), name)) return *p;
  const std::filesystem::path file = name;
  if (file.extension() != ".toml") {
    const std::string near = nearest_name(name, scanner_names());
    return fail(kUnknownName,
                fmt::format("no scanner is called '{}'; known: {}, or a .toml file{}", name,
                            fmt::join(scanner_names(), ", "),
                            near.empty() ? "" : fmt::format("; did you mean '{}'?", near)));
  }
  const std::string base = peek(file, "preset");
  if (peek(file, "kind") == "structured_light") {
    assets::StructuredLightPreset preset = assets::structured_light_presets().front();
    if (!base.empty()) {
      const auto p = assets::find_preset(assets::structured_light_presets(), base);
      if (!p) return fail(kUnknownName, fmt::format("{}: no preset '{}' of this kind", name, base));
      preset = *p;
    }
    StructuredLightText t = text_of(preset);
    MAQUETTE_TRY_VOID(schema_of(t).read(file));
    t.p.width_px = static_cast<int>(t.width);
    t.p.height_px = static_cast<int>(t.height);
    return t.p;
  }
  PhaseShiftScanner start{assets::scanner_presets().front(), {}, {}, 7};
  if (!base.empty()) {
    const auto p = assets::find_preset(assets::scanner_presets(), base);
    if (!p) return fail(kUnknownName, fmt::format("{}: no preset '{}' of this kind", name, base));
    start.preset = *p;
  }
  PhaseShiftText t = text_of(start);
  MAQUETTE_TRY_VOID(schema_of(t).read(file));
  return scanner_of(t);
}

std::string scanner_file_text(const Scanner& scanner) {
  if (const auto* s = std::get_if<PhaseShiftScanner>(&scanner)) {
    PhaseShiftText t = text_of(*s);
    t.base = s->preset.name;
    return schema_of(t).template_text();
  }
  StructuredLightText t = text_of(std::get<assets::StructuredLightPreset>(scanner));
  t.base = t.p.name;
  return schema_of(t).template_text();
}

}  // namespace maquette::tools
