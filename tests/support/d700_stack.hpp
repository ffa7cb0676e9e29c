// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file d700_stack.hpp
/// All effects that the preset nikon_d700_55deg lists, at its numbers, for benchmarks.

#include "camera/effects/noise.hpp"
#include "camera/stack.hpp"

namespace maquette::testing_support {

struct D700 {
  static constexpr int width_px = 4256, height_px = 2832;
  static constexpr double pitch_um = 8.45, focal_mm = 34.54232;
  camera::Shot shot;
  camera::Stack lens, sensor;

  D700() {
    using namespace camera;
    shot.intrinsics = intrinsics_of(width_px, height_px, pitch_um, focal_mm);
    shot.focal_length_mm = focal_mm;
    shot.quantum_efficiency = {0.20, 0.38, 0.28};
    shot.gain_e_per_dn = 3.26;
    Distortion bend;
    bend.coefficients = {-0.05, 0.01}, bend.band_scale = {2e-4, 0.0, -2e-4};
    Vignetting fall;
    fall.polynomial = {-0.05, 0.0, 0.0};
    lens = {MotionBlur{}, DepthOfField{.blades = 9}, bend,
            fall,         Diffraction{.blades = 9},  VeilingGlare{0.01}};
    sensor = {Exposure{},
              Bayer{},
              QuantumEfficiency{},
              Prnu{0.005},
              DarkCurrent{},
              HotPixels{},
              ShotNoise{},
              FullWell{},
              Dsnu{2.0},
              ReadNoise{16.0},
              RowColumnNoise{1.0, 1.0},
              Adc{},
              Demosaic{},
              WhiteBalance{},
              Tone{}};
  }
  [[nodiscard]] camera::Stack whole() const {
    camera::Stack both = lens;
    both.insert(both.end(), sensor.begin(), sensor.end());
    return both;
  }
};

}  // namespace maquette::testing_support
