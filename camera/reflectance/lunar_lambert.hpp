// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file lunar_lambert.hpp
/// A mixture of Lommel-Seeliger and Lambert, albedo (L 2 mu0 / (mu0 + mu) + (1 - L) mu0):
/// McEwen 1991, doi:10.1016/0019-1035(91)90053-V. L may be chosen for a phase angle; it is a
/// constant here.

#include "camera/reflectance/lommel_seeliger.hpp"

namespace maquette::camera {

struct LunarLambert {
  Bands albedo{0.1, 0.1, 0.1};  ///< radiance factor at normal light and view
  double l = 0.5;               ///< 0 Lambert .. 1 Lommel-Seeliger

  [[nodiscard]] Bands radiance_factor(const Angles& a) const {
    if (!a.front()) return {};
    const double s = l * LommelSeeliger::shape(a) + (1.0 - l) * a.mu0;
    return {albedo[0] * s, albedo[1] * s, albedo[2] * s};
  }
};

}  // namespace maquette::camera
