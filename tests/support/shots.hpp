// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include "camera/stack.hpp"

namespace maquette::testing_support {

/// A shot with the pixel pitch that a Shot has by default.
[[nodiscard]] inline camera::Shot shot_of(int width, int height, double focal_length_mm = 35.0) {
  camera::Shot shot;
  shot.focal_length_mm = focal_length_mm;
  shot.intrinsics = camera::intrinsics_of(width, height, shot.pixel_pitch_um, focal_length_mm);
  return shot;
}

/// One value everywhere.
[[nodiscard]] inline camera::Frame flat(int width, int height, double value,
                                        std::size_t bands = 1) {
  camera::Frame frame;
  frame.bands.assign(bands, Grid<float>(height, width, static_cast<float>(value)));
  return frame;
}

}  // namespace maquette::testing_support
