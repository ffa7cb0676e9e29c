// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file oren_nayar.hpp
/// Matt paint: Lambert facets in symmetric V-shaped cavities, with masking, shadowing and light
/// that goes from one side to the other. The full fit of Oren and Nayar 1994,
/// doi:10.1145/192161.192213 (equations 20 to 26), not the short form. Lambert at sigma = 0.

#include "camera/reflectance/angles.hpp"

namespace maquette::camera {

struct OrenNayar {
  Bands albedo{0.3, 0.3, 0.3};  ///< of the facets, 0 to 0.97: the fit gives a white
                                ///< surface 2.4 % too much at grazing incidence
  double sigma_deg = 20.0;      ///< standard deviation of the facets' slope, 0 to 60

  [[nodiscard]] Bands radiance_factor(const Angles& a) const;
};

}  // namespace maquette::camera
