// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/reflectance/hapke.hpp"

#include <numbers>

namespace maquette::camera {
namespace {

constexpr double kPi = std::numbers::pi;

double henyey_greenstein(double b, double cos_phase) {
  const double q = 1.0 + 2.0 * b * cos_phase + b * b;
  return (1.0 - b * b) / (q * std::sqrt(q));
}

double multiple(Hapke::Form form, double w, double x) {
  const double gamma = std::sqrt(std::max(0.0, 1.0 - w));
  if (form == Hapke::Form::y1981) return (1.0 + 2.0 * x) / (1.0 + 2.0 * x * gamma);
  if (x <= 0.0) return 1.0;
  const double r0 = (1.0 - gamma) / (1.0 + gamma);
  if (form == Hapke::Form::y1993)
    return 1.0 / (1.0 - (1.0 - gamma) * x * (r0 + (1.0 - 0.5 * r0 - r0 * x) * std::log1p(1.0 / x)));
  return 1.0 / (1.0 - w * x * (r0 + 0.5 * (1.0 - 2.0 * r0 * x) * std::log1p(1.0 / x)));
}

double porosity_factor(double filling) {
  if (filling <= 0.0) return 1.0;
  const double x = 1.209 * std::cbrt(filling * filling);
  return -std::log1p(-x) / x;
}

/// What one of the two angles contributes to the shadowing.
struct Tilt {
  double cosine, sine, e1 = 0.0, e2 = 0.0, eta;

  Tilt(double mu, double tan_theta, double chi)
      : cosine(mu), sine(std::sqrt(std::max(0.0, 1.0 - mu * mu))) {
    if (sine > 0.0) {
      const double x = cosine / (sine * tan_theta);  // cot theta cot angle
      e1 = std::exp(-2.0 / kPi * x);
      e2 = std::exp(-x * x / kPi);
    }
    eta = chi * (cosine + sine * tan_theta * e2 / (2.0 - e1));
  }
};

struct Rough {
  double mu0e, mue, shadowing;
};

/// Equations 46 to 53 of Hapke 1984: the tilt that is steeper decides which of the two areas in
/// shadow, seen or lit, lies inside the other.
Rough roughness(const Angles& a, double theta_deg) {
  if (theta_deg <= 0.0) return {a.mu0, a.mu, 1.0};
  const double tan_theta = std::tan(theta_deg * kPi / 180.0);
  const double chi = 1.0 / std::sqrt(1.0 + kPi * tan_theta * tan_theta);
  const Tilt light(a.mu0, tan_theta, chi), view(a.mu, tan_theta, chi);
  const double cos_psi = a.cos_azimuth();
  const double psi = std::acos(cos_psi);
  const double sin2_half = 0.5 * (1.0 - cos_psi);
  const double overlap = psi < kPi ? std::exp(-2.0 * std::tan(0.5 * psi)) : 0.0;
  const bool view_steeper = a.mu0 >= a.mu;
  const Tilt& low = view_steeper ? view : light;   // the larger angle
  const Tilt& high = view_steeper ? light : view;  // the smaller one
  const double below = 2.0 - low.e1 - psi / kPi * high.e1;
  const double far = low.e2 - sin2_half * high.e2;
  const double near = cos_psi * low.e2 + sin2_half * high.e2;
  const double mu_low = chi * (low.cosine + low.sine * tan_theta * far / below);
  const double mu_high = chi * (high.cosine + high.sine * tan_theta * near / below);
  const double shadowing = (view_steeper ? mu_low : mu_high) / view.eta * (a.mu0 / light.eta) *
                           chi / (1.0 - overlap + overlap * chi * high.cosine / high.eta);
  return view_steeper ? Rough{mu_high, mu_low, shadowing} : Rough{mu_low, mu_high, shadowing};
}

}  // namespace

Bands Hapke::radiance_factor(const Angles& a) const {
  if (!a.front()) return {};
  const Rough rough = roughness(a, roughness_deg);
  if (!(rough.mu0e > 0.0) || !(rough.mue > 0.0)) return {};
  // tan(g/2) from the cosine; infinite light from straight behind does not occur in front.
  const double cosine = std::clamp(a.cos_phase, -1.0, 1.0);
  const double tan_half = std::sqrt((1.0 - cosine) / std::max(1.0 + cosine, 1e-300));
  const double once =
      ((1.0 - c) * henyey_greenstein(b, cosine) + c * henyey_greenstein(-b, cosine)) *
      (1.0 + surge / (1.0 + tan_half / surge_width));
  double porous = 1.0, enhanced = 1.0;
  if (form == Form::y2012) {
    porous = porosity_factor(filling);
    const double x = tan_half / coherent_width;
    const double ladder = x > 1e-8 ? -std::expm1(-x) / x : 1.0;
    enhanced = 1.0 + coherent * (1.0 + ladder) / (2.0 * (1.0 + x) * (1.0 + x));
  }
  const double common =
      0.25 * porous * rough.mu0e / (rough.mu0e + rough.mue) * rough.shadowing * enhanced;
  Bands result;
  for (std::size_t i = 0; i < 3; ++i) {
    if (i > 0 && w[i] == w[i - 1]) {
      result[i] = result[i - 1];
      continue;
    }
    result[i] = std::max(0.0, w[i] * common *
                                  (once +
                                   multiple(form, w[i], rough.mu0e / porous) *
                                       multiple(form, w[i], rough.mue / porous) -
                                   1.0));
  }
  return result;
}

}  // namespace maquette::camera
