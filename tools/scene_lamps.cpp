// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/scene_lamps.hpp"

#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>
#include <optional>

#include "assets/devices.hpp"
#include "core/check.hpp"
#include "tools/built_in_lamps.hpp"

namespace maquette::tools {
namespace {

std::optional<assets::LampPreset> preset_of(const SceneLamp& l) {
  if (l.preset.empty()) return std::nullopt;
  auto preset = assets::find_preset(assets::lamp_presets(), l.preset);
  MAQUETTE_CHECK(preset.has_value(), "no lamp {}", l.preset);
  return preset;
}

/// The first of the two that is a number, else what stands for both.
double given(double value, double of_preset, double otherwise) {
  if (!std::isnan(value)) return value;
  return std::isnan(of_preset) ? otherwise : of_preset;
}

Result<camera::IntensityTable> built_in_intensity(const std::string& name) {
  const auto* const lamp =
      std::find_if(std::begin(kBuiltInLamps), std::end(kBuiltInLamps),
                   [&](const BuiltInLamp& built_in) { return built_in.name == name; });
  MAQUETTE_CHECK(lamp != std::end(kBuiltInLamps), "no intensities of {}", name);
  return camera::read_intensity_csv(name, lamp->text);
}

/// Nothing: white.
Result<std::optional<camera::SpectralCurve>> spectrum_of(const SceneLamp& l) {
  if (!l.spectrum.empty()) {
    MAQUETTE_TRY(auto curve, camera::read_spectrum(l.spectrum));
    return curve;
  }
  const auto preset = preset_of(l);
  const double kelvin = given(l.kelvin, preset ? preset->colour_temperature_k : NAN, 0.0);
  if (kelvin == 0.0) return std::nullopt;
  return camera::black_body(kelvin);
}

/// Sets the lamp's table and where its light ends.
Result<void> put_intensity(const SceneLamp& l, double beam_deg, camera::Lamp& lamp) {
  const auto preset = preset_of(l);
  lamp.beam_deg = given(l.beam_deg, preset ? preset->beam_deg : NAN, beam_deg);
  const bool from_file = !l.intensity.empty();
  if (!from_file && (!preset || preset->intensity.empty())) return {};
  camera::IntensityTable table;
  if (from_file) {
    MAQUETTE_TRY(table, camera::read_intensity(l.intensity));
  } else {
    MAQUETTE_TRY(table, built_in_intensity(preset->intensity));
    const double stretched = lamp.beam_deg / preset->beam_deg;
    for (double& angle : table.angle_deg) angle *= stretched;
  }
  if (preset && (!from_file || std::isnan(l.beam_deg)))
    lamp.beam_deg = std::min(360.0, 2.0 * table.angle_deg.back());
  lamp.intensity = std::make_shared<camera::IntensityTable>(std::move(table));
  return {};
}

}  // namespace

Result<Filters> filters_of(const std::filesystem::path& file) {
  if (file.empty()) return camera::box_bands();
  return camera::read_filters(file);
}

std::vector<std::string> lamp_names() {
  std::vector<std::string> names;
  for (const auto& preset : assets::lamp_presets()) names.push_back(preset.name);
  return names;
}

Result<camera::Lamp> lamp_of(const SceneLamp& l, const Filters& filters, double beam_deg) {
  const auto preset = preset_of(l);
  camera::Lamp lamp;
  lamp.position_mm = l.position_mm;
  lamp.target_mm = l.target_mm;
  lamp.lens_diameter_mm = given(l.diameter_mm, preset ? preset->lens_diameter_mm : NAN, 0.0);
  if (l.sun_diameter_deg >= 0.0) lamp.sun_diameter_deg = l.sun_diameter_deg;
  MAQUETTE_TRY(lamp.colour, bands_of(l.irradiance, "lamp: irradiance"));
  MAQUETTE_TRY_VOID(put_intensity(l, beam_deg, lamp));
  MAQUETTE_TRY(const auto spectrum, spectrum_of(l));
  if (!spectrum) return lamp;
  const auto colour = camera::colour_of(*spectrum, filters);
  if (!colour)
    return fail(kConfigInvalid, "a lamp's spectrum has no light in the green band to scale by");
  for (std::size_t b = 0; b < 3; ++b) lamp.colour[b] *= (*colour)[b];
  return lamp;
}

Result<camera::Bands> white_radiance_of(const SceneLamp& l, const camera::Lamp& lamp,
                                        const Filters& filters) {
  const auto preset = preset_of(l);
  double lux = std::isnan(l.illuminance_lux) ? 0.0 : l.illuminance_lux;
  if (std::isnan(l.illuminance_lux) && preset && preset->luminous_flux_lm > 0.0 &&
      !lamp.sun_diameter_deg) {
    const double even =
        2.0 * std::numbers::pi * (1.0 - std::cos(0.5 * lamp.beam_deg * std::numbers::pi / 180.0));
    const double candela = preset->luminous_flux_lm /
                           (lamp.intensity ? camera::solid_angle_sr(*lamp.intensity) : even);
    const double metres = 1e-3 * norm(lamp.target_mm - lamp.position_mm);
    if (metres > 0.0) lux = candela / (metres * metres);
  }
  MAQUETTE_TRY(const auto spectrum, spectrum_of(l));
  if (!(lux > 0.0) || !spectrum) return camera::Bands{};
  return camera::white_radiance(*spectrum, lux, filters);
}

}  // namespace maquette::tools
