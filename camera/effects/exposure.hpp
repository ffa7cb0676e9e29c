// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file exposure.hpp
/// Radiance to photons that arrive at a pixel while the shutter is open.
///
/// Absolute:  N = pi L tau / (4 F^2 (1 + m)^2) A t lambda / (h c)
/// (thin lens in air, on the axis; the fall to the corners is Vignetting). With `radiance_of_one`
/// not known, value 1 fills `electrons_at_one` in the band with the highest quantum efficiency,
/// which is the full well unless given: 1 saturates, the convention of scene files.
/// Source: EMVA 1288 release 4.0, section 2.2 (photons per pixel); the camera equation in any
/// textbook of photometry.

#include "camera/effects/frame.hpp"

namespace maquette::camera {

struct Exposure {
  /// W m^-2 sr^-1 in the band that value 1 stands for; one for all bands or one each. 0: not known.
  std::vector<double> radiance_of_one{0.0};
  double transmission = 0.9;      ///< tau of the lens
  double magnification = 0.0;     ///< m of the image
  double electrons_at_one = 0.0;  ///< 0: the full well

  static constexpr EffectInfo kInfo{
      "exposure", Signal::radiance, Signal::photons,
      "light that has passed the lens arrives as photons while the shutter is open"};
};

/// Photons at a pixel for value 1.
[[nodiscard]] double photons_at_one(const Exposure& e, const Shot& shot, std::size_t band);

[[nodiscard]] Result<void> check(const Exposure& e, const Shot& shot);
[[nodiscard]] RowFunction rows(const Exposure& e, const Shot& shot, const Frame& frame);

}  // namespace maquette::camera
