// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file veiling_glare.hpp
/// Light that is scattered between the faces of the lens and the barrel lies over the picture as an
/// even veil: a share of all light goes from where it belongs to everywhere. ISO 9358:1994 measures
/// this share as the veiling glare index. The picture's mean stays.

#include "camera/effects/frame.hpp"

namespace maquette::camera {

struct VeilingGlare {
  double share = 0.0;  ///< 0.01 to 0.05 for photographic lenses

  static constexpr EffectInfo kInfo{
      "veiling_glare", Signal::radiance, Signal::radiance,
      "all light that reaches the sensor is scattered a little, the last thing before it arrives"};
};

[[nodiscard]] Result<void> check(const VeilingGlare& e, const Shot& shot);
void apply(const VeilingGlare& e, const Shot& shot, Frame& frame);

}  // namespace maquette::camera
