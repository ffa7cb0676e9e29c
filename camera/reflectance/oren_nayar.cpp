// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/reflectance/oren_nayar.hpp"

#include <numbers>

namespace maquette::camera {

Bands OrenNayar::radiance_factor(const Angles& a) const {
  if (!a.front()) return {};
  constexpr double kPi = std::numbers::pi;
  const double sigma = sigma_deg * kPi / 180.0;
  const double variance = sigma * sigma;
  const double incidence = std::acos(std::min(a.mu0, 1.0)),
               emission = std::acos(std::min(a.mu, 1.0));
  const double alpha = std::max(incidence, emission), beta = std::min(incidence, emission);
  const double azimuth = a.cos_azimuth();
  const double spread = variance / (variance + 0.09);
  const double turned = 2.0 * beta / kPi;
  const double c1 = 1.0 - 0.5 * variance / (variance + 0.33);
  const double c2 =
      0.45 * spread * (std::sin(alpha) - (azimuth < 0.0 ? turned * turned * turned : 0.0));
  const double c3 = 0.125 * spread * std::pow(4.0 * alpha * beta / (kPi * kPi), 2);
  const double once = c1 + azimuth * c2 * std::tan(beta) +
                      (1.0 - std::abs(azimuth)) * c3 * std::tan(0.5 * (alpha + beta));
  const double twice = 0.17 * variance / (variance + 0.13) * (1.0 - azimuth * turned * turned);
  Bands result;
  for (std::size_t i = 0; i < 3; ++i) result[i] = albedo[i] * a.mu0 * (once + albedo[i] * twice);
  return result;
}

}  // namespace maquette::camera
