// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file reflectance.hpp
/// How bright a surface is, from the cosines of incidence and emission.
///
/// All are normalised to 1 for light and view along the normal, so that an albedo
/// in front means the same for each:
///   Lambert           mu0
///   Lommel-Seeliger   2 mu0 / (mu0 + mu)
///   lunar-Lambert     L 2 mu0 / (mu0 + mu) + (1 - L) mu0
/// McEwen 1991, doi:10.1016/0019-1035(91)90053-V; none depends on the phase angle
/// (McEwen's L may be chosen for one).

#include "core/vec.hpp"

namespace maquette::camera {

enum class Reflectance { lambert, lommel_seeliger, lunar_lambert };

struct Material {
  Reflectance reflectance = Reflectance::lambert;
  double albedo = 0.3;           ///< brightness at normal light and view; 1 = white Lambert
  double lunar_lambert_l = 0.5;  ///< McEwen's L; 1 = Lommel-Seeliger, 0 = Lambert
};

/// @param mu0  cosine of incidence; @param mu  cosine of emission
/// @return 0 if either is not positive; without the albedo
[[nodiscard]] constexpr double relative_brightness(const Material& material, double mu0,
                                                   double mu) {
  if (!(mu0 > 0.0) || !(mu > 0.0)) return 0.0;
  const double lommel_seeliger = 2.0 * mu0 / (mu0 + mu);
  switch (material.reflectance) {
    case Reflectance::lambert:
      return mu0;
    case Reflectance::lommel_seeliger:
      return lommel_seeliger;
    case Reflectance::lunar_lambert:
      return material.lunar_lambert_l * lommel_seeliger + (1.0 - material.lunar_lambert_l) * mu0;
  }
  return 0.0;
}

}  // namespace maquette::camera
