// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file lommel_seeliger.hpp
/// Single isotropic scattering in a dark, deep layer, albedo 2 mu0 / (mu0 + mu): Seeliger 1887,
/// Abh. Bayer. Akad. Wiss. 16, 403. With a single scattering albedo w the factor in front is w/8,
/// and of light at mu0 the share (w/2)(1 - mu0 ln(1 + 1/mu0)) comes back.

#include "camera/reflectance/angles.hpp"

namespace maquette::camera {

struct LommelSeeliger {
  Bands albedo{0.1, 0.1, 0.1};  ///< radiance factor at normal light and view; w/8, so above 0.25
                                ///< more light comes back at grazing incidence than arrives

  /// 1 at normal light and view.
  [[nodiscard]] static double shape(const Angles& a) {
    return a.front() ? 2.0 * a.mu0 / (a.mu0 + a.mu) : 0.0;
  }
  [[nodiscard]] Bands radiance_factor(const Angles& a) const {
    const double s = shape(a);
    return {albedo[0] * s, albedo[1] * s, albedo[2] * s};
  }
};

}  // namespace maquette::camera
