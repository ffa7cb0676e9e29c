// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/reflectance/ggx.hpp"

#include <complex>
#include <numbers>

namespace maquette::camera {

double fresnel_conductor(double cosine, double n, double k) {
  const std::complex<double> index(n, k);
  const double sine_squared = std::max(0.0, 1.0 - cosine * cosine);
  // Cosine inside, times the index.
  const std::complex<double> inside = std::sqrt(index * index - sine_squared);
  const auto s = (cosine - inside) / (cosine + inside);
  const auto p = (index * index * cosine - inside) / (index * index * cosine + inside);
  return 0.5 * (std::norm(s) + std::norm(p));
}

Bands Ggx::radiance_factor(const Angles& a) const {
  if (!a.front()) return {};
  // The half vector h of light l and view v: |l + v|^2 = 2 + 2 l.v.
  const double length = std::sqrt(std::max(2.0 + 2.0 * a.cos_phase, 1e-300));
  const double cos_half = std::min((a.mu0 + a.mu) / length, 1.0);  // n.h
  const double cos_facet = std::min(0.5 * length, 1.0);            // l.h = v.h
  const double alpha2 = alpha * alpha;
  const double q = cos_half * cos_half * (alpha2 - 1.0) + 1.0;
  const double facets = alpha2 / (std::numbers::pi * q * q);
  // 1 + Lambda(l) + Lambda(v), both over the cosines so that nothing is divided by zero.
  const auto root = [alpha2](double mu) { return std::sqrt(alpha2 + (1.0 - alpha2) * mu * mu); };
  const double shadowed = 2.0 * a.mu0 * a.mu / (a.mu * root(a.mu0) + a.mu0 * root(a.mu));
  const double common = std::numbers::pi * facets * shadowed / (4.0 * a.mu);
  Bands result;
  for (std::size_t i = 0; i < 3; ++i)
    result[i] = tint[i] * common * fresnel_conductor(cos_facet, n[i], k[i]);
  return result;
}

}  // namespace maquette::camera
