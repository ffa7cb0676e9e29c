// SPDX-License-Identifier: GPL-3.0-or-later
#include "assets/devices.hpp"

#include <cmath>
#include <numbers>

namespace maquette::assets {

// Each value has its source beside it. "maker" is the maker's published
// specification; "assumed" is a choice of ours that no document backs: measure
// your own device and put its values into the site file.

namespace {

double focal_length_for(double width_px, double pitch_um, double horizontal_fov_deg) {
  return 0.5 * width_px * pitch_um * 1e-3 /
         std::tan(0.5 * horizontal_fov_deg * std::numbers::pi / 180.0);
}

/// HMI lamps are sold with some 85 lumens a watt; a Fresnel lens in flood lets out about 35 % of
/// that. Both assumed: measure the illuminance where your part stands.
constexpr double kLumensPerWatt = 85.0, kShareThroughLens = 0.35;

}  // namespace

const std::vector<CameraPreset>& camera_presets() {
  static const std::vector<CameraPreset> presets = {
      {.name = "nikon_d700_55deg",
       .width_px = 4256,  // maker
       .height_px = 2832,
       .pixel_pitch_um = 8.45,                                 // maker
       .focal_length_mm = focal_length_for(4256, 8.45, 55.0),  // 55 degrees across: 34.5 mm
       .f_number = 8.0,                                        // assumed
       // Between 53 400 (E. Martin, 2007) and 65 600 (P. Facey, 2008), both measured
       // at ISO 200 on the D3, which has the same sensor; rounded.
       .full_well_e = 60000.0,
       .read_noise_e = 16.0},  // Martin, same place: 4.9 DN of 14 bit times 3.26 e-/DN
      {.name = "canon_5d3",
       .width_px = 5760,  // maker
       .height_px = 3840,
       .pixel_pitch_um = 6.25,   // maker: 36.0 mm / 5760
       .focal_length_mm = 35.0,  // assumed lens
       .f_number = 8.0,          // assumed
       .full_well_e = 67700.0,   // measured at ISO 100: Magic Lantern forum, topic 10111
       .read_noise_e = 33.0},    // assumed, of the order of published measurements at ISO 100
      {.name = "canon_5ds_r",
       .width_px = 8688,  // maker
       .height_px = 5792,
       .pixel_pitch_um = 4.14,   // maker: 36.0 mm / 8688
       .focal_length_mm = 50.0,  // assumed lens
       .f_number = 8.0,          // assumed
       .full_well_e = 30000.0,   // assumed: the 5D Mark III's, scaled with pixel area
       .read_noise_e = 15.0},    // assumed
      // A framing camera of an asteroid mission: Dawn FC, 1024 x 1024, 14 um, 150 mm,
      // 5.5 degrees, f/7.5 (Sierks et al. 2011, doi:10.1007/s11214-011-9745-4).
      {.name = "mono_space",
       .width_px = 1024,
       .height_px = 1024,
       .pixel_pitch_um = 14.0,
       .focal_length_mm = 150.0,
       .f_number = 7.5,
       .full_well_e = 200000.0,  // assumed, usual for a CCD pixel of this size
       .read_noise_e = 20.0},    // assumed
  };
  return presets;
}

const std::vector<LampPreset>& lamp_presets() {
  static const std::vector<LampPreset> presets = {
      {.name = "arri_d5",
       .power_w = 575.0,                // maker
       .colour_temperature_k = 6000.0,  // usual for the 575 W metal halide lamps it takes
       .lens_diameter_mm = 130.0,       // assumed: Fresnel lens of this class
       .beam_deg = 56.0,                // full flood
       .luminous_flux_lm = 575.0 * kLumensPerWatt * kShareThroughLens,
       .intensity = "arri_d5"},  // assumed, see there
      {.name = "point",          // the limit without penumbra; the rest as arri_d5
       .power_w = 575.0,
       .colour_temperature_k = 6000.0,
       .lens_diameter_mm = 0.0,
       .beam_deg = 56.0},
      // A far lamp that shows the Sun's angle of 0.533 degrees (IAU 2015 resolution B3
      // solar radius at 1 au) from 20 m: 20 m * 0.00930 = 186 mm. Place it there.
      {.name = "sun_at_20m",
       .power_w = 4000.0,               // assumed
       .colour_temperature_k = 5772.0,  // effective temperature, IAU 2015 resolution B3
       .lens_diameter_mm = 186.0,
       .beam_deg = 12.0},  // assumed: covers 4 m at 20 m
  };
  return presets;
}

const std::vector<ScannerPreset>& scanner_presets() {
  static const std::vector<ScannerPreset> presets = {
      // Zoller + Froehlich Imager 5006h, a phase-shift scanner.
      {.name = "zf5006h",
       .vendor = "Zoller+Froehlich",
       .model = "Imager 5006h",
       .lines_per_turn = 20000.0,     // maker, "super high": points per 360 degrees
       .range_resolution_mm = 0.1,    // maker
       .range_sigma_mm = 0.4,         // assumed at 3 m; the maker gives figures from 10 m on
       .noise_exponent = 0.5,         // shot noise of the amplitude
       .beam_diameter_mm = 3.0,       // maker
       .beam_divergence_mrad = 0.22,  // maker
       // 79 m: maker (zf-laser.com, measurement system of the series); that it takes three
       // wavelengths with a ratio of eight is assumed.
       .unambiguous_mm = {79'000.0, 9'875.0, 1'234.375},
       .turns_per_s = 25.0,          // maker: 500 000 points a second, by 20 000 points a turn
       .largest_zenith_deg = 155.0,  // maker: 310 degrees of field of view in the vertical
       .least_signal = 0.001},       // assumed: a tenth of a per cent of white at 3 m
  };
  return presets;
}

const std::vector<StructuredLightPreset>& structured_light_presets() {
  static const std::vector<StructuredLightPreset> presets = {
      // A fringe projection head of 5 megapixels for fields of half a metre: the class, no
      // particular make; all values assumed. 0.03 pixel of stripe at 800 mm and 300 mm of
      // base are 0.016 mm of depth.
      {.name = "structured_light",
       .model = "fringe projection head, 5 megapixels",
       .width_px = 2448,
       .height_px = 2050,
       .focal_length_px = 4000.0,
       .baseline_mm = 300.0,
       .working_distance_mm = 800.0,
       .projector_width_deg = 36.0,
       .projector_height_deg = 30.0,
       .stripe_sigma_px = 0.03,
       .noise_exponent = 0.5,
       .exposure = 0.8,
       .least_value = 0.02,
       .steepest_deg = 80.0,
       .gloss = 0.0,
       .gloss_exponent = 60.0},
  };
  return presets;
}

}  // namespace maquette::assets
