// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file srgb.hpp
/// The transfer function of sRGB, IEC 61966-2-1, values 0 to 1.

#include <cmath>

namespace maquette::camera {

template <class T>
[[nodiscard]] T srgb_of_linear(T linear) {
  return linear <= T(0.0031308) ? T(12.92) * linear
                                : T(1.055) * std::pow(linear, T(1.0 / 2.4)) - T(0.055);
}
template <class T>
[[nodiscard]] T linear_of_srgb(T display) {
  return display <= T(0.04045) ? display / T(12.92)
                               : std::pow((display + T(0.055)) / T(1.055), T(2.4));
}

}  // namespace maquette::camera
