// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file distortion.hpp
/// Where the lens puts what a pinhole would have put at X, for each band its own: the differences
/// of the bands are lateral chromatic aberration. Lengths in units of the focal length (tangents of
/// the field angle), from the distortion centre, which is the principal point.
///
///   quotient       X_R = X_C + (X_i - X_C) / L(r),  L(r) = 1 + k1 r + k2 r^2 + k3 r^3 + ...,
///                  r = |X_i - X_C|: X_i ideal, X_R on the real picture. k > 0: barrel.
///   division       the same formula with X_i on the real picture and X_R ideal (Fitzgibbon 2001,
///                  doi:10.1109/CVPR.2001.990465, has its even terms). k > 0: pincushion.
///   brown_conrady  x_d = x (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6)
///                        + 2 p1 x y + p2 (r^2 + 2 x^2),  and y_d with p1, p2 exchanged:
///                  OpenCV's coefficients in its order k1, k2, p1, p2, k3, k4, k5, k6 (Brown 1966;
///                  Conrady 1919, doi:10.1093/mnras/79.5.384).
///
/// Accuracy: the way back is solved by Newton to 1e-9 of the focal length at the nodes of a raster
/// that is made finer until a quarter of its cells' middles agree with what is interpolated there
/// to 0.002 pixel; pictures are sampled bicubically.

#include <string>

#include "camera/effects/frame.hpp"

namespace maquette::camera {

struct Distortion {
  std::string model = "brown_conrady";  ///< quotient, division, brown_conrady
  /// Of the lens; quotient and division: k1, k2, ... (at most 8).
  std::vector<double> coefficients{};
  /// Magnification of each band beside 1, e.g. {2e-4, 0, -3e-4}: lateral chromatic aberration of
  /// first order. One for all bands or one each.
  std::vector<double> band_scale{0.0};
  /// Of red and blue in place of `coefficients`, where they are known; empty: as the lens.
  std::vector<double> red{}, blue{};

  static constexpr EffectInfo kInfo{
      "distortion", Signal::radiance, Signal::radiance,
      "the lens bends rays on their way to the sensor: what fixes itself to the sensor (fall of "
      "light, pixels, rows) comes after it, what happens in the scene before it"};
};

/// Real place of an ideal one, in tangents. NaN where the formula has none.
[[nodiscard]] Vec2 distorted(const Distortion& e, Vec2 ideal, std::size_t band);
/// Ideal place of a real one; nothing if there is none near.
[[nodiscard]] std::optional<Vec2> undistorted(const Distortion& e, Vec2 real, std::size_t band);

/// CAMERA_EFFECT_OUT_OF_RANGE also where the formula folds the picture over itself.
[[nodiscard]] Result<void> check(const Distortion& e, const Shot& shot);
/// Bands, and depth and lit (nearest pixel) where there are any. Places that no ray reaches are the
/// edge's.
void apply(const Distortion& e, const Shot& shot, Frame& frame);

}  // namespace maquette::camera
