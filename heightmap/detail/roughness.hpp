// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file roughness.hpp
/// The power law of a surface's relief, and the noise of the product that shows it.
///
/// Method. Relief whose mean squared height difference over a distance L is C L^(2H) has the
/// spectrum a f^-(2H+2) with a = C / (4 pi (2 pi)^(2H) I), I = Gamma(1-H) / (2^(2H+1) H Gamma(1+H))
/// (V(L) = 2 int S (1 - J0(2 pi f L)) df over the plane). Second differences at 1, 2, 4 and 8
/// pixels, which see no slopes, are compared with what that spectrum gives as means over pixels,
/// and with 6 sigma^2 of white noise; H is tried, C and sigma are fitted.

#include "heightmap/dem_reader.hpp"
#include "heightmap/detail/node_map.hpp"

namespace maquette::heightmap::detail {

struct Roughness {
  double hurst = 0.5;
  double coefficient = 0.0;  ///< C, m^(2 - 2H)
  double noise_m = 0.0;      ///< white, of one pixel

  /// a above, lengths in metres.
  [[nodiscard]] double spectrum() const;
};

/// Coefficient 0 if there are too few pixels. Accuracy (test: ten Gaussian reliefs, half of
/// 128 x 128 pixels each): H to 0.1, noise to 10 %, power of waves of 8 pixels to 25 %.
[[nodiscard]] Roughness measure_roughness(const PixelWindow& window, const PixelSize& pixel);

}  // namespace maquette::heightmap::detail
