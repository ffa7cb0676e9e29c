// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file depth_of_field.hpp
/// What lies before or behind the distance in focus spreads over a circle of confusion: for a thin
/// lens of aperture A = f / F focused at s, a point at distance z (both along the axis, from the
/// lens) becomes a picture of the aperture with diameter
///
///     c = A f |z - s| / (z (s - f))
///
/// (Potmesil and Chakravarty 1981, doi:10.1145/800224.806818). Each pixel's light is spread over
/// the picture of the aperture, a regular polygon of as many sides as there are blades with the
/// area of that circle, in layers by depth: nearer light covers what lies behind it in the share of
/// the aperture that it hides, farther light does not spread over sharper things before it. What
/// lies hidden behind a blurred edge is taken from beside it.
///
/// Circles up to one pixel wide leave no trace. Exact for a picture of one depth and before a
/// background in focus; tests compare with rays through the lens.

#include "camera/effects/frame.hpp"

namespace maquette::camera {

struct DepthOfField {
  double focus_mm =
      0.0;         ///< along the axis; infinite allowed; 0: the depth in the picture's middle
  int blades = 0;  ///< 0: round; else 3 to 30
  double rotation_deg = 0.0;

  static constexpr EffectInfo kInfo{"depth_of_field", Signal::radiance, Signal::radiance,
                                    "the lens spreads light by the depth it comes from, which is "
                                    "known only in the picture as the "
                                    "scene has it, before the lens bends it"};
};

/// Diameter on the sensor in mm, positive behind the focus, negative before it; 0 < z, f < focus.
[[nodiscard]] double circle_of_confusion_mm(double focal_length_mm, double f_number,
                                            double focus_mm, double z_mm);

[[nodiscard]] Result<void> check(const DepthOfField& e, const Shot& shot);
/// @return CAMERA_FRAME: no depth; CAMERA_EFFECT_OUT_OF_RANGE: circles more than 256 pixels wide,
/// or
///         the focus is nearer than the focal length
[[nodiscard]] Result<void> apply(const DepthOfField& e, const Shot& shot, Frame& frame);

}  // namespace maquette::camera
