// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file dark_current.hpp
/// Electrons that heat frees: a rate for each pixel that grows with the temperature as
///
///     D(T) ~ T^1.5 exp(-Eg(T) / (2 k T)),   Eg = 1.1557 - 7.021e-4 T^2 / (1108 + T) eV
///
/// (Janesick, Scientific Charge-Coupled Devices, SPIE 2001, eq. 7.16, doi:10.1117/3.374903; the gap
/// of silicon: Varshni 1967, doi:10.1016/0031-8914(67)90062-6). It doubles every 6 to 8 K near
/// room temperature. Its shot noise is that of ShotNoise, which counts all charge.

#include "camera/effects/frame.hpp"

namespace maquette::camera {

struct DarkCurrent {
  double rate_e_s = 1.0;      ///< electrons a second and pixel
  double reference_c = 20.0;  ///< temperature at which it is that

  static constexpr EffectInfo kInfo{
      "dark_current", Signal::electrons, Signal::electrons,
      "heat frees electrons in the well beside those of light, before they are counted"};
};

/// D(T) / D(reference).
[[nodiscard]] double dark_growth(double temperature_c, double reference_c);
[[nodiscard]] Result<void> check(const DarkCurrent& e, const Shot& shot);
[[nodiscard]] RowFunction rows(const DarkCurrent& e, const Shot& shot, const Frame& frame);

}  // namespace maquette::camera
