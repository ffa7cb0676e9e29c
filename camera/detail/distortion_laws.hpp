// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file distortion_laws.hpp
/// The formulas of camera/effects/distortion.hpp for any number type: doubles for pictures, numbers
/// with derivatives for calibration. Coefficients that are not there are 0.

#include <array>
#include <cstddef>
#include <span>

namespace maquette::camera::detail {

/// L(r) = 1 + k1 r + k2 r^2 + ...
template <class T>
[[nodiscard]] T quotient_law(std::span<const T> k, const T& r) {
  T sum(0.0);
  for (std::size_t i = k.size(); i-- > 0;) sum = (sum + k[i]) * r;
  return T(1.0) + sum;
}

template <class T>
[[nodiscard]] std::array<T, 2> brown_conrady_law(std::span<const T> k, const T& x, const T& y) {
  const auto at = [&](std::size_t i) { return i < k.size() ? k[i] : T(0.0); };
  const T r2 = x * x + y * y, r4 = r2 * r2, r6 = r4 * r2;
  const T radial = (T(1.0) + at(0) * r2 + at(1) * r4 + at(4) * r6) /
                   (T(1.0) + at(5) * r2 + at(6) * r4 + at(7) * r6);
  return {x * radial + T(2.0) * at(2) * x * y + at(3) * (r2 + T(2.0) * x * x),
          y * radial + at(2) * (r2 + T(2.0) * y * y) + T(2.0) * at(3) * x * y};
}

}  // namespace maquette::camera::detail
