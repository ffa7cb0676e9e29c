// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file tone.hpp
/// Linear values to display values: sRGB (IEC 61966-2-1), a power 1 / gamma, or none; what is below
/// 0 or above 1 is cut.

#include <string>

#include "camera/effects/frame.hpp"

namespace maquette::camera {

struct Tone {
  std::string curve = "srgb";  ///< srgb, gamma, linear
  double gamma = 2.2;

  static constexpr EffectInfo kInfo{"tone", Signal::linear, Signal::display,
                                    "the curve bends what has been balanced in linear light"};
};

[[nodiscard]] double encoded(const Tone& e, double linear);
[[nodiscard]] Result<void> check(const Tone& e, const Shot& shot);
[[nodiscard]] RowFunction rows(const Tone& e, const Shot& shot, const Frame& frame);

}  // namespace maquette::camera
