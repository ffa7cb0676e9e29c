// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cmath>
#include <numbers>

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

/// Mean squared distance from the middle of a disc of this radius, or of a regular polygon of its
/// area: R^2 / 2, a^2 (1 + tan^2(pi / n) / 3) / 2 of apothem a.
[[nodiscard]] inline double second_moment_of_opening(double radius, int blades) {
  if (blades == 0) return 0.5 * radius * radius;
  const double tangent = std::tan(std::numbers::pi / blades);
  const double apothem2 = std::numbers::pi * radius * radius / (blades * tangent);
  return 0.5 * apothem2 * (1.0 + tangent * tangent / 3.0);
}

}  // namespace maquette::testing_support
