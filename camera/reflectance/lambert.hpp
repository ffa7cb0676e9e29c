// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file lambert.hpp
/// Equally bright from everywhere: Lambert, Photometria, 1760.

#include "camera/reflectance/angles.hpp"

namespace maquette::camera {

struct Lambert {
  Bands albedo{0.3, 0.3, 0.3};  ///< share of the light that comes back, 0 to 1

  [[nodiscard]] Bands radiance_factor(const Angles& a) const {
    if (!a.front()) return {};
    return {albedo[0] * a.mu0, albedo[1] * a.mu0, albedo[2] * a.mu0};
  }
};

}  // namespace maquette::camera
