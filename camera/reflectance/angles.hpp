// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file angles.hpp
/// What every law of reflectance takes and gives.
///
/// A law gives the radiance factor (Hapke's RADF, I/F): pi f mu0 with f the bidirectional
/// reflectance distribution function in 1/sr. It is the radiance of the surface over that of a
/// white Lambert surface that faces the same light, so a white Lambert law gives mu0. Reciprocity
/// means that radiance factor over mu0 does not change when light and view trade places.

#include <algorithm>
#include <array>
#include <cmath>

namespace maquette::camera {

/// Values in the bands R, G, B.
using Bands = std::array<double, 3>;

/// Light and view at a point of a surface.
struct Angles {
  double mu0 = 1.0;        ///< cosine of incidence
  double mu = 1.0;         ///< cosine of emission
  double cos_phase = 1.0;  ///< of the angle between light and view

  [[nodiscard]] bool front() const { return mu0 > 0.0 && mu > 0.0; }
  [[nodiscard]] double sin_incidence() const { return std::sqrt(std::max(0.0, 1.0 - mu0 * mu0)); }
  [[nodiscard]] double sin_emission() const { return std::sqrt(std::max(0.0, 1.0 - mu * mu)); }
  /// Cosine of the azimuth between light and view, 1 with the Sun behind; 1 where there is none.
  [[nodiscard]] double cos_azimuth() const {
    const double sines = sin_incidence() * sin_emission();
    return sines > 0.0 ? std::clamp((cos_phase - mu0 * mu) / sines, -1.0, 1.0) : 1.0;
  }
};

}  // namespace maquette::camera
