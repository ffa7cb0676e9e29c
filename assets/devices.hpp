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
  double beam_deg = 0.0;          ///< full angle
};

struct ScannerPreset {
  std::string name;
  double lines_per_turn = 0.0;        ///< vertical resolution: points per 360 degrees
  double range_resolution_mm = 0.0;   ///< quantisation step
  double range_sigma_mm = 0.0;        ///< at 3 m on 50 % grey
  double beam_diameter_mm = 0.0;      ///< at exit
  double beam_divergence_mrad = 0.0;  ///< full angle
};

[[nodiscard]] const std::vector<CameraPreset>& camera_presets();
[[nodiscard]] const std::vector<LampPreset>& lamp_presets();
[[nodiscard]] const std::vector<ScannerPreset>& scanner_presets();

/// By name, from the list of that kind; nothing if there is none.
template <class Preset>
[[nodiscard]] std::optional<Preset> find_preset(const std::vector<Preset>& presets,
                                                std::string_view name) {
  for (const Preset& p : presets)
    if (p.name == name) return p;
  return std::nullopt;
}

}  // namespace maquette::assets
