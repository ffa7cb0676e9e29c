// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file devices.hpp
/// Lamps, cameras and scanners that a site file may name. Every value
/// has its source in devices.cpp or is marked as assumed there.

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace maquette::assets {

struct CameraPreset {
  std::string name;
  int width_px = 0, height_px = 0;
  double pixel_pitch_um = 0.0;
  double focal_length_mm = 0.0;
  double f_number = 8.0;
  double full_well_e = 50000.0;  ///< electrons at value 1.0
  double read_noise_e = 20.0;
};

struct LampPreset {
  std::string name;
  double power_w = 0.0;
  double colour_temperature_k = 0.0;
  double lens_diameter_mm = 0.0;  ///< 0: point
  double beam_deg = 0.0;          ///< full angle; with a table that of half the axis' intensity
  double luminous_flux_lm = 0.0;  ///< that leaves the lens; 0: not known
  /// Name of a table in assets/lamps, intensity against the angle off the axis; empty: even inside
  /// the beam, nothing outside.
  std::string intensity{};
};

/// A terrestrial phase-shift scanner.
struct ScannerPreset {
  std::string name;
  std::string vendor{}, model{};
  double lines_per_turn = 0.0;        ///< vertical resolution: points per 360 degrees
  double range_resolution_mm = 0.0;   ///< quantisation step
  double range_sigma_mm = 0.0;        ///< at 3 m, perpendicular on 50 % grey
  double noise_exponent = 0.5;        ///< range noise goes with signal^-exponent
  double beam_diameter_mm = 0.0;      ///< at exit, 1/e^2 of the irradiance
  double beam_divergence_mrad = 0.0;  ///< full angle, 1/e^2
  /// Half the modulation wavelengths, coarse to fine; the first is the longest range that is
  /// told apart from a shorter one.
  std::vector<double> unambiguous_mm{79'000.0, 9'875.0, 1'234.375};
  double turns_per_s = 25.0;          ///< of the mirror: one line each
  double largest_zenith_deg = 180.0;  ///< degrees; below it the instrument's foot hides the view
  double least_signal = 0.0;          ///< below: no point; 1: a white surface that faces it at 3 m
};

/// A camera and a projector of stripes side by side.
struct StructuredLightPreset {
  std::string name;
  std::string vendor{}, model{};
  int width_px = 0, height_px = 0;    ///< of the camera
  double focal_length_px = 0.0;       ///< of the camera, in its pixels
  double baseline_mm = 0.0;           ///< from the camera to the projector on its right
  double working_distance_mm = 0.0;   ///< at which both axes meet
  double projector_width_deg = 0.0;   ///< full angle across the stripes
  double projector_height_deg = 0.0;  ///< full angle along the stripes
  double stripe_sigma_px = 0.0;       ///< of a stripe's place in camera pixels, at full signal
  double noise_exponent = 0.5;        ///< that noise goes with signal^-exponent
  double exposure = 0.8;              ///< sensor value (1 saturates) of a white surface that faces
                                      ///< the projector at the working distance
  double least_value = 0.02;          ///< darker pixels give no point
  double steepest_deg = 80.0;         ///< of the camera's view; steeper spots give no point
  double gloss = 0.0,
         gloss_exponent = 60.0;  ///< Blinn-Phong lobe, as sensor value at the mirror angle
};

[[nodiscard]] const std::vector<CameraPreset>& camera_presets();
[[nodiscard]] const std::vector<LampPreset>& lamp_presets();
[[nodiscard]] const std::vector<ScannerPreset>& scanner_presets();
[[nodiscard]] const std::vector<StructuredLightPreset>& structured_light_presets();

/// By name, from the list of that kind; nothing if there is none.
template <class Preset>
[[nodiscard]] std::optional<Preset> find_preset(const std::vector<Preset>& presets,
                                                std::string_view name) {
  for (const Preset& p : presets)
    if (p.name == name) return p;
  return std::nullopt;
}

}  // namespace maquette::assets
