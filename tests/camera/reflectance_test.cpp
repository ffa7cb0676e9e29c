// SPDX-License-Identifier: GPL-3.0-or-later

// camera/reflectance.hpp, camera/reflectance/*.hpp:
//   published values ................. Hapke, Lommel-Seeliger, lunar-Lambert as image processing at
//                                      the USGS gives them, to 1e-5; Fresnel at normal incidence
//   published surfaces ............... phase curves of Ida, Mercury and Ceres against the
//   equations,
//                                      written once more; Oren-Nayar against the paper's
//   limits ........................... one law becomes another; terms that are 0 change nothing
//   reciprocity ...................... random angles, every law, 1e-12
//   directional albedo ............... closed forms of Lambert, Lommel-Seeliger, lunar-Lambert; H
//   of
//                                      1993 against the integral equation's albedo; 1e-3
//   hemispherical albedo ............. of both against a quadrature and equations of its own, 1e-3
//   energy <= 1 ...................... quadrature over all laws with parameters at their limits
//   roughness ........................ never brighter at normal light and view; shadows darken most
//                                      at large phase angles
//   GGX .............................. what a perfect mirror loses, by a separate quadrature
//   tables ........................... a Lambert table is Lambert; bad files name the line
//   nothing shines from behind ....... both cosines at and below zero

#include "camera/reflectance.hpp"

#include <cmath>
#include <fstream>
#include <numbers>

#include <fmt/format.h>
#include <gtest/gtest.h>

#include "core/random.hpp"
#include "support/matchers.hpp"

namespace maquette::camera {
namespace {

using testing_support::FailsWith;
using testing_support::Succeeds;

constexpr double kRad = std::numbers::pi / 180.0;

Bands grey(double v) {
  return {v, v, v};
}
Angles angles(double phase_deg, double incidence_deg, double emission_deg) {
  return {std::cos(kRad * incidence_deg), std::cos(kRad * emission_deg),
          std::cos(kRad * phase_deg)};
}
double at(const Law& law, const Angles& a) {
  return radiance_factor(law, a)[1];
}

Hapke hapke(Hapke::Form form, double w) {
  Hapke h;
  h.form = form;
  h.w = grey(w);
  return h;
}
/// The Moon's average of Helfenstein and Veverka 1987, doi:10.1016/0019-1035(87)90148-8, in
/// round numbers: dark, rough, with a strong surge.
Hapke moon(Hapke::Form form) {
  Hapke h = hapke(form, 0.21);
  h.b = 0.29, h.c = 0.7, h.surge = 2.0, h.surge_width = 0.07, h.roughness_deg = 20.0;
  return h;
}
BrdfTable table_of(double brdf) {
  auto grid = std::make_shared<BrdfTable::Grid3>();
  grid->incidence_deg = {0, 30, 90};
  grid->emission_deg = {0, 45, 80};
  grid->azimuth_deg = {0, 90, 180};
  for (int i = 0; i < 27; ++i) grid->brdf.push_back(grey(brdf * (1.0 + 0.01 * (i % 7))));
  return {grid, 1.0};
}
/// Every law, also with all its terms at work.
std::vector<std::pair<std::string, Law>> all_laws() {
  Hapke full = moon(Hapke::Form::y2012);
  full.coherent = 0.4, full.coherent_width = 0.02, full.filling = 0.4;
  Hapke bright = hapke(Hapke::Form::y2012, 1.0);
  return {{"lambert", Lambert{grey(1.0)}},
          {"lommel_seeliger", LommelSeeliger{grey(0.125)}},
          {"lunar_lambert", LunarLambert{grey(0.125), 0.4}},
          {"hapke 1981", moon(Hapke::Form::y1981)},
          {"hapke 1993", moon(Hapke::Form::y1993)},
          {"hapke 2012", full},
          {"hapke white", bright},
          {"oren_nayar", OrenNayar{grey(0.9), 30.0}},
          {"oren_nayar white", OrenNayar{grey(0.97), 10.0}},
          {"ggx", Ggx{}},
          {"ggx white", Ggx{grey(0.01), grey(100.0), grey(1.0), 0.5}},
          {"table", table_of(0.25)}};
}

TEST(Reflectance, HasThePublishedValues) {
  const double tol = 1e-5;
  Law law = hapke(Hapke::Form::y1981, 0.5);
  EXPECT_NEAR(at(law, angles(0, 0, 0)), 0.0965097, tol);
  EXPECT_NEAR(at(law, angles(60, 45, 30)), 0.0832883, tol);
  Hapke rough = hapke(Hapke::Form::y1981, 0.52);
  rough.surge = 1.0, rough.surge_width = 1.0, rough.roughness_deg = 30.0;
  rough.b = 0.213, rough.c = 1.0;
  EXPECT_NEAR(at(rough, angles(0, 0, 0)), 0.286048, tol);
  EXPECT_NEAR(at(rough, angles(60, 45, 30)), 0.1342, tol);
  EXPECT_NEAR(at(LommelSeeliger{grey(1)}, angles(0, 0, 0)), 1.0, tol);
  EXPECT_NEAR(at(LommelSeeliger{grey(1)}, angles(60, 45, 30)), 0.898979, tol);
  EXPECT_NEAR(at(LunarLambert{grey(1), 0.5}, angles(0, 0, 0)), 1.0, tol);
  EXPECT_NEAR(at(LunarLambert{grey(1), 0.5}, angles(60, 45, 30)), 0.803043, tol);
  EXPECT_NEAR(at(Lambert{grey(1)}, angles(60, 45, 30)), std::numbers::sqrt2 / 2, 1e-15);
}

TEST(Reflectance, OneLawBecomesAnother) {
  const Angles a = angles(40, 50, 20);
  EXPECT_NEAR(at(LunarLambert{grey(0.1), 0.0}, a), at(Lambert{grey(0.1)}, a), 1e-16);
  EXPECT_NEAR(at(LunarLambert{grey(0.1), 1.0}, a), at(LommelSeeliger{grey(0.1)}, a), 1e-16);
  EXPECT_NEAR(at(OrenNayar{grey(0.4), 0.0}, a), at(Lambert{grey(0.4)}, a), 1e-16);
  // A dark layer scatters once: w/8 of Lommel-Seeliger; H - 1 is of order w.
  EXPECT_NEAR(at(hapke(Hapke::Form::y2012, 1e-9), a) / at(LommelSeeliger{grey(1e-9 / 8)}, a), 1.0,
              1e-8);
  // Terms that are off leave the simpler forms.
  Hapke h93 = moon(Hapke::Form::y1993), h12 = moon(Hapke::Form::y2012);
  // H of 1993 and of 2012 are two fits of one function: 0.1 % apart for so dark a layer.
  EXPECT_NEAR(at(h93, a) / at(h12, a), 1.0, 1e-3);
  EXPECT_NE(at(h93, a), at(h12, a));
  Hapke smooth = h93, flat = h93;
  smooth.roughness_deg = 0.0, flat.roughness_deg = 1e-4;
  EXPECT_NEAR(at(flat, a) / at(smooth, a), 1.0, 1e-5);
  Hapke loose = h12, thin = h12;
  loose.filling = 0.0, thin.filling = 1e-9;
  EXPECT_NEAR(at(thin, a) / at(loose, a), 1.0, 1e-5);
}

// ---- once more, from the published equations ----------------------------------

/// Incidence, emission and azimuth (0: the Sun behind), radians.
struct Geometry {
  double i, e, psi;

  [[nodiscard]] double phase() const {
    return std::acos(std::clamp(
        std::cos(i) * std::cos(e) + std::sin(i) * std::sin(e) * std::cos(psi), -1.0, 1.0));
  }
  [[nodiscard]] Angles angles() const { return {std::cos(i), std::cos(e), std::cos(phase())}; }
};

/// Hapke's radiance factor in the angles of the papers (doi in camera/reflectance/hapke.hpp):
/// bidirectional reflectance of 1981 (equation 16), surge of 1986, roughness of 1984 (46 to 53), H
/// of the book of 1993 (8.57) or of 2002 (13), coherent backscatter of 2002, porosity of 2008. None
/// of the code under test is used.
double hapke_by_the_book(const Hapke& p, const Geometry& at) {
  using std::cos, std::sin, std::tan, std::exp;
  constexpr double pi = std::numbers::pi;
  const double g = at.phase(), w = p.w[1];
  double mu0 = cos(at.i), mu = cos(at.e), shade = 1.0;
  if (p.roughness_deg > 0.0) {
    const double theta = kRad * p.roughness_deg, cot = 1.0 / tan(theta);
    const double chi = 1.0 / std::sqrt(1.0 + pi * tan(theta) * tan(theta));
    const auto e1 = [&](double x) { return x > 0 ? exp(-2.0 / pi * cot / tan(x)) : 0.0; };
    const auto e2 = [&](double x) {
      return x > 0 ? exp(-cot * cot / (pi * tan(x) * tan(x))) : 0.0;
    };
    const auto eta = [&](double x) {
      return chi * (cos(x) + sin(x) * tan(theta) * e2(x) / (2.0 - e1(x)));
    };
    const double half = std::pow(sin(0.5 * at.psi), 2), turn = at.psi / pi;
    const double f = at.psi < pi ? exp(-2.0 * tan(0.5 * at.psi)) : 0.0;
    const double i = at.i, e = at.e;
    double mu0e, mue;
    if (i <= e) {
      const double under = 2.0 - e1(e) - turn * e1(i);
      mu0e = chi * (cos(i) + sin(i) * tan(theta) * (cos(at.psi) * e2(e) + half * e2(i)) / under);
      mue = chi * (cos(e) + sin(e) * tan(theta) * (e2(e) - half * e2(i)) / under);
      shade = mue / eta(e) * mu0 / eta(i) * chi / (1.0 - f + f * chi * mu0 / eta(i));
    } else {
      const double under = 2.0 - e1(i) - turn * e1(e);
      mu0e = chi * (cos(i) + sin(i) * tan(theta) * (e2(i) - half * e2(e)) / under);
      mue = chi * (cos(e) + sin(e) * tan(theta) * (cos(at.psi) * e2(i) + half * e2(e)) / under);
      shade = mue / eta(e) * mu0 / eta(i) * chi / (1.0 - f + f * chi * mu / eta(e));
    }
    mu0 = mu0e, mu = mue;
  }
  const auto lobe = [&](double xi) {
    return (1.0 - xi * xi) / std::pow(1.0 + 2.0 * xi * cos(g) + xi * xi, 1.5);
  };
  const double phase = (1.0 - p.c) * lobe(p.b) + p.c * lobe(-p.b);
  const double surge = p.surge / (1.0 + tan(0.5 * g) / p.surge_width);
  double porous = 1.0, coherent = 0.0;
  if (p.form == Hapke::Form::y2012) {
    const double x = 1.209 * std::pow(p.filling, 2.0 / 3.0);
    if (x > 0.0) porous = -std::log(1.0 - x) / x;
    const double y = tan(0.5 * g) / p.coherent_width;
    coherent =
        p.coherent * (y > 1e-9 ? 1.0 + (1.0 - exp(-y)) / y : 2.0) / (2.0 * (1 + y) * (1 + y));
  }
  const double gamma = std::sqrt(1.0 - w), r0 = (1.0 - gamma) / (1.0 + gamma);
  const auto h = [&](double x) {
    const double log = std::log((1.0 + x) / x);
    if (p.form == Hapke::Form::y1981) return (1.0 + 2.0 * x) / (1.0 + 2.0 * gamma * x);
    if (p.form == Hapke::Form::y1993)
      return 1.0 / (1.0 - (1.0 - gamma) * x * (r0 + (1.0 - 0.5 * r0 - r0 * x) * log));
    return 1.0 / (1.0 - w * x * (r0 + 0.5 * (1.0 - 2.0 * r0 * x) * log));
  };
  const double brdf = porous * w / (4.0 * pi) * mu0 / (mu0 + mu) *
                      (phase * (1.0 + surge) + h(mu0 / porous) * h(mu / porous) - 1.0) *
                      (1.0 + coherent) * shade;
  return pi * brdf;
}

/// Parameters as published, in the form in which they were fitted.
std::vector<std::pair<std::string, Hapke>> published_surfaces() {
  Hapke ida = hapke(Hapke::Form::y1993, 0.22);  // Helfenstein et al. 1996, Icarus 120, 48
  ida.b = -0.33, ida.surge = 1.5, ida.surge_width = 0.020, ida.roughness_deg = 18.0;
  // At 554 nm: doi:10.1051/0004-6361:20065850, table 1 (2006).
  Hapke mercury = hapke(Hapke::Form::y1993, 0.18);
  mercury.b = 0.18, mercury.c = 1.1, mercury.surge = 2.7, mercury.surge_width = 0.09;
  mercury.roughness_deg = 20.0;
  Hapke ceres = hapke(Hapke::Form::y2012, 0.14);  // Ciarniello et al. 2017, A&A 598, A130
  ceres.b = -0.11, ceres.surge = 1.6, ceres.surge_width = 0.06, ceres.roughness_deg = 29.0;
  Hapke porous = ceres;  // and with what no fit had: all terms of 2012 at work
  porous.filling = 0.13, porous.coherent = 0.4, porous.coherent_width = 0.02;
  return {{"Ida", ida}, {"Mercury", mercury}, {"Ceres", ceres}, {"all terms", porous}};
}

TEST(Reflectance, HapkePhaseCurvesOfPublishedSurfacesAreThoseOfTheEquations) {
  for (const auto& [name, surface] : published_surfaces()) {
    double last = INFINITY;
    for (int phase_deg = 0; phase_deg <= 120; phase_deg += 2) {
      const double g = kRad * phase_deg;
      // With the Sun and the camera to either side; and light from aside, seen from above.
      const std::vector<Geometry> seen{{0.5 * g, 0.5 * g, std::numbers::pi},
                                       {std::min(g, 1.5), 0.0, 0.0},
                                       {0.7 * g, 0.4 * g, 0.6 * g},
                                       {0.3 * g, 0.65 * g, 2.0}};
      for (const Geometry& s : seen) {
        const double value = hapke_by_the_book(surface, s);
        // The azimuth comes back from its cosine: half the digits near 0 and 180 degrees.
        ASSERT_NEAR(at(surface, s.angles()) / value, 1.0, 1e-6) << name << ' ' << phase_deg;
      }
      const double curve = at(surface, seen[0].angles());
      EXPECT_LT(curve, last) << name << ' ' << phase_deg << ": phase curves fall";
      last = curve;
    }
  }
}

/// From the equations 20 to 26 of Oren and Nayar 1994.
double oren_nayar_by_the_paper(double rho, double sigma_deg, const Geometry& at) {
  const double pi = std::numbers::pi, s2 = std::pow(kRad * sigma_deg, 2);
  const double alpha = std::max(at.i, at.e), beta = std::min(at.i, at.e), c = std::cos(at.psi);
  const double c1 = 1.0 - 0.5 * s2 / (s2 + 0.33);
  const double c2 = 0.45 * s2 / (s2 + 0.09) *
                    (c >= 0.0 ? std::sin(alpha) : std::sin(alpha) - std::pow(2.0 * beta / pi, 3));
  const double c3 = 0.125 * s2 / (s2 + 0.09) * std::pow(4.0 * alpha * beta / (pi * pi), 2);
  const double direct =
      rho / pi * std::cos(at.i) *
      (c1 + c * c2 * std::tan(beta) + (1.0 - std::abs(c)) * c3 * std::tan(0.5 * (alpha + beta)));
  const double twice = 0.17 * rho * rho / pi * std::cos(at.i) * s2 / (s2 + 0.13) *
                       (1.0 - c * std::pow(2.0 * beta / pi, 2));
  return pi * (direct + twice);
}

TEST(Reflectance, OrenNayarHasThePapersValues) {
  const OrenNayar chalk{grey(0.9), 30.0}, paint{grey(0.3), 20.0};
  const auto value = [](const OrenNayar& law, double i, double e, double psi) {
    return at(law, Geometry{kRad * i, kRad * e, kRad * psi}.angles());
  };
  // Worked out from the paper's equations elsewhere, to nine digits.
  EXPECT_NEAR(value(chalk, 60, 0, 0), 0.394602618, 1e-8);
  EXPECT_NEAR(value(chalk, 60, 45, 0), 0.514954591, 1e-7);
  EXPECT_NEAR(value(chalk, 60, 45, 180), 0.293307235, 1e-7);
  EXPECT_NEAR(value(chalk, 60, 45, 90), 0.400734725, 1e-8);
  EXPECT_NEAR(value(paint, 30, 75, 120), 0.214451712, 1e-8);
  // Seen from above nothing is left of the azimuth: C1 and the light that is reflected twice.
  const double s2 = std::pow(kRad * 30.0, 2);
  EXPECT_NEAR(
      value(chalk, 70, 0, 0),
      std::cos(kRad * 70) * (0.9 * (1 - 0.5 * s2 / (s2 + 0.33)) + 0.17 * 0.81 * s2 / (s2 + 0.13)),
      1e-12);
  for (const double i : {0.0, 20.0, 55.0, 80.0})
    for (const double e : {0.0, 35.0, 70.0, 85.0})
      for (const double psi : {0.0, 40.0, 89.0, 91.0, 150.0, 180.0})
        ASSERT_NEAR(value(chalk, i, e, psi),
                    oren_nayar_by_the_paper(0.9, 30.0, {kRad * i, kRad * e, kRad * psi}), 1e-6)
            << i << ' ' << e << ' ' << psi;
}

/// Light that comes back of what comes in from one direction: midpoints in mu^2 and the azimuth.
template <class F>
double albedo_by_midpoints(const F& radiance_factor_at, double incidence) {
  constexpr int kEmissions = 250, kAzimuths = 180;
  double sum = 0.0;
  for (int k = 0; k < kEmissions; ++k) {
    const double mu = std::sqrt((k + 0.5) / kEmissions);
    for (int a = 0; a < kAzimuths; ++a)
      sum += radiance_factor_at(
          Geometry{incidence, std::acos(mu), std::numbers::pi * (a + 0.5) / kAzimuths});
  }
  return sum / (kEmissions * kAzimuths) / std::cos(incidence);
}

TEST(Reflectance, HemisphericalAlbedoIsThatOfTheEquations) {
  for (const double incidence_deg : {0.0, 30.0, 60.0, 80.0}) {
    const double i = kRad * incidence_deg;
    for (const auto& [name, surface] : published_surfaces()) {
      const double expected =
          albedo_by_midpoints([&](const Geometry& g) { return hapke_by_the_book(surface, g); }, i);
      EXPECT_NEAR(directional_albedo(surface, std::cos(i))[1] / expected, 1.0, 1e-3)
          << name << ' ' << incidence_deg;
    }
    for (const double sigma_deg : {10.0, 35.0, 60.0}) {
      const double expected = albedo_by_midpoints(
          [&](const Geometry& g) { return oren_nayar_by_the_paper(0.8, sigma_deg, g); }, i);
      EXPECT_NEAR(directional_albedo(OrenNayar{grey(0.8), sigma_deg}, std::cos(i))[1] / expected,
                  1.0, 1e-3)
          << sigma_deg << ' ' << incidence_deg;
    }
  }
}

TEST(Reflectance, HapkeCoherentBackscatterAddsItsAmplitudeAtZeroPhaseOnly) {
  Hapke h = hapke(Hapke::Form::y2012, 0.4), with = h;
  with.coherent = 0.7, with.coherent_width = 0.01;
  EXPECT_NEAR(at(with, angles(0, 30, 30)) / at(h, angles(0, 30, 30)), 1.7, 1e-12);
  // Half width of about 0.36 h_C (Hapke 2002): half the surge where tan(g/2) = 0.36 h_C.
  const double half_deg = 2.0 * std::atan(0.36 * 0.01) / kRad;
  EXPECT_NEAR(at(with, angles(half_deg, 30, 30)) / at(h, angles(half_deg, 30, 30)), 1.35, 0.02);
  EXPECT_NEAR(at(with, angles(60, 45, 30)) / at(h, angles(60, 45, 30)), 1.0, 1e-3);
}

TEST(Reflectance, HapkeDenserPackingIsBrighter) {
  // K > 1 for a filled layer: Hapke 2008, figure 2, K(0.4) = 1.44 by its equation.
  Hapke loose = hapke(Hapke::Form::y2012, 1e-6), dense = loose;
  dense.filling = 0.4;
  const double x = 1.209 * std::pow(0.4, 2.0 / 3.0);
  EXPECT_NEAR(at(dense, angles(30, 30, 0)) / at(loose, angles(30, 30, 0)), -std::log(1 - x) / x,
              1e-5);
}

TEST(Reflectance, IsReciprocal) {
  for (const auto& [name, law] : all_laws())
    for (std::uint64_t i = 0; i < 2000; ++i) {
      const double mu0 = 0.01 + 0.99 * random_uniform(1, 3 * i);
      const double mu = 0.01 + 0.99 * random_uniform(1, 3 * i + 1);
      const double psi = std::numbers::pi * random_uniform(1, 3 * i + 2);
      const double cos_phase =
          mu0 * mu + std::sqrt((1 - mu0 * mu0) * (1 - mu * mu)) * std::cos(psi);
      const Bands there = radiance_factor(law, {mu0, mu, cos_phase});
      const Bands back = radiance_factor(law, {mu, mu0, cos_phase});
      for (std::size_t b = 0; b < 3; ++b)
        ASSERT_NEAR(there[b] / mu0, back[b] / mu, 1e-12 * std::max(1.0, there[b] / mu0))
            << name << ' ' << mu0 << ' ' << mu << ' ' << psi;
    }
}

TEST(Reflectance, DirectionalAlbedoHasItsClosedForm) {
  for (const double mu0 : {1.0, 0.7, 0.3, 0.05}) {
    const double w = 0.6, ls = 0.5 * w * (1.0 - mu0 * std::log1p(1.0 / mu0));
    EXPECT_NEAR(directional_albedo(Lambert{grey(0.37)}, mu0)[0], 0.37, 1e-3 * 0.37);
    EXPECT_NEAR(directional_albedo(LommelSeeliger{grey(w / 8)}, mu0)[1], ls, 1e-3 * ls);
    EXPECT_NEAR(directional_albedo(LunarLambert{grey(w / 8), 0.3}, mu0)[2], 0.3 * ls + 0.7 * w / 8,
                1e-3 * ls);
    // Isotropic scatterers with exact H: 1 - sqrt(1 - w) H(mu0) (Chandrasekhar 1960); the H of 1993
    // is within 1 %, that of 1981 within 4 %.
    const double gamma = std::sqrt(1.0 - w), r0 = (1 - gamma) / (1 + gamma);
    const double h = 1.0 / (1.0 - w * mu0 * (r0 + 0.5 * (1 - 2 * r0 * mu0) * std::log1p(1 / mu0)));
    EXPECT_NEAR(directional_albedo(hapke(Hapke::Form::y1993, w), mu0)[0], 1.0 - gamma * h, 0.01);
    EXPECT_NEAR(directional_albedo(hapke(Hapke::Form::y2012, w), mu0)[0], 1.0 - gamma * h, 0.01);
    EXPECT_NEAR(directional_albedo(hapke(Hapke::Form::y1981, w), mu0)[0],
                1.0 - gamma * (1 + 2 * mu0) / (1 + 2 * mu0 * gamma), 0.04);
  }
}

TEST(Reflectance, NeverMakesLight) {
  for (const auto& [name, law] : all_laws()) {
    // H is an approximation: a white layer gives back all light, give or take its error of 1 %.
    EXPECT_LE(largest_albedo(law), name == "hapke white" ? 1.01 : 1.0 + 1e-3) << name;
    EXPECT_GT(largest_albedo(law), 0.01) << name;
  }
  EXPECT_GT(largest_albedo(LommelSeeliger{grey(0.3)}), 1.0);  // the warning in the header
}

TEST(Reflectance, RoughnessTakesLightAwayMoreAtLargePhase) {
  Hapke smooth = moon(Hapke::Form::y2012), rough = smooth;
  smooth.roughness_deg = 0.0, rough.roughness_deg = 25.0;
  double last = 1.01;
  for (const double phase : {0.0, 30.0, 60.0, 90.0, 120.0}) {
    const Angles a = angles(phase, phase / 2, phase / 2);
    const double share = at(rough, a) / at(smooth, a);
    EXPECT_LT(share, last) << phase;
    last = share;
  }
  EXPECT_LT(last, 0.7);
}

TEST(Reflectance, RoughHapkeIsSmoothWhereItsTwoBranchesMeet) {
  const Law law = moon(Hapke::Form::y2012);
  for (const double psi_deg : {0.0, 40.0, 90.0, 140.0, 179.0})
    for (const double i_deg : {10.0, 45.0, 70.0}) {
      const auto value = [&](double e_deg) {
        const double cos_phase =
            std::cos(kRad * i_deg) * std::cos(kRad * e_deg) +
            std::sin(kRad * i_deg) * std::sin(kRad * e_deg) * std::cos(kRad * psi_deg);
        return at(law, {std::cos(kRad * i_deg), std::cos(kRad * e_deg), cos_phase});
      };
      // The step of 2e-6 degrees moves a smooth function of slope O(10) per radian by 4e-7.
      EXPECT_NEAR(value(i_deg - 1e-6), value(i_deg + 1e-6), 2e-6) << psi_deg << ' ' << i_deg;
    }
}

TEST(Ggx, ReflectsAtNormalIncidenceAsFresnelSays) {
  // ((n - 1)^2 + k^2) / ((n + 1)^2 + k^2): aluminium and glass.
  EXPECT_NEAR(fresnel_conductor(1.0, 0.97, 6.40), (0.03 * 0.03 + 40.96) / (1.97 * 1.97 + 40.96),
              1e-12);
  EXPECT_NEAR(fresnel_conductor(1.0, 1.5, 0.0), 0.04, 1e-12);
  // Brewster's angle of glass: half of what the s-polarised light gives, ((n^2-1)/(n^2+1))^2 / 2.
  EXPECT_NEAR(fresnel_conductor(1.0 / std::sqrt(1.0 + 2.25), 1.5, 0.0),
              0.5 * std::pow(1.25 / 3.25, 2), 1e-12);
  EXPECT_NEAR(fresnel_conductor(0.0, 1.5, 0.0), 1.0, 1e-12);
}

TEST(Ggx, LosesOnlyWhatIsReflectedTwice) {
  // A perfect mirror: all light comes back but for second reflections. The shares are those of a
  // separate quadrature of D G / (4 mu0 mu) with 500 x 500 directions, written without this code.
  const auto share = [](double alpha) {
    return directional_albedo(Ggx{grey(1e-3), grey(100.0), grey(1.0), alpha}, 0.8)[0];
  };
  const double mirror = fresnel_conductor(0.8, 1e-3, 100.0);
  EXPECT_NEAR(share(0.1) / mirror, 0.98457, 1e-3);
  EXPECT_NEAR(share(0.2) / mirror, 0.93365, 1e-3);
  EXPECT_NEAR(share(0.5) / mirror, 0.68205, 1e-3);
}

TEST(Reflectance, IsZeroFromBehind) {
  for (const auto& [name, law] : all_laws())
    for (const Angles a : {Angles{0.0, 0.5, 0.1}, Angles{-0.1, 0.5, 0.1}, Angles{0.5, 0.0, 0.1},
                           Angles{0.5, -0.5, 0.1}})
      EXPECT_EQ(at(law, a), 0.0) << name;
}

TEST(Reflectance, StaysFiniteAtTheEdges) {
  for (const auto& [name, law] : all_laws())
    for (const double mu0 : {1e-9, 0.5, 1.0})
      for (const double mu : {1e-9, 0.5, 1.0})
        for (const double cos_phase : {-1.0, 0.0, 1.0, 1.0 + 1e-15})
          EXPECT_TRUE(std::isfinite(at(law, {mu0, mu, cos_phase})))
              << name << ' ' << mu0 << ' ' << mu << ' ' << cos_phase;
}

class BrdfFile : public testing::Test {
 protected:
  testing_support::ScratchFolder folder;

  [[nodiscard]] std::filesystem::path write(const std::string& text) const {
    const auto path = folder / "table.csv";
    std::ofstream(path) << text;
    return path;
  }
  const std::string head = "incidence_deg,emission_deg,azimuth_deg,brdf\n";
};

TEST_F(BrdfFile, OfALambertSurfaceIsLambert) {
  std::string text = head;
  for (const int i : {0, 40, 80})
    for (const int e : {0, 30, 60, 85})
      for (const int a : {0, 60, 180})
        text += fmt::format("{},{},{},{}\n", i, e, a, 0.5 / std::numbers::pi);
  const auto table = read_brdf_table(write(text));
  ASSERT_THAT(table, Succeeds());
  EXPECT_NEAR(at(*table, angles(60, 45, 30)), 0.5 * std::sqrt(0.5), 1e-12);
  EXPECT_NEAR(at(*table, angles(20, 89, 80)), 0.5 * std::cos(kRad * 89), 1e-12);
}

TEST_F(BrdfFile, InterpolatesInAllThreeAngles) {
  // f = (i + e)/100 + azimuth/1000, symmetric in i and e: linear, so exact between the nodes.
  std::string text = head;
  for (const int i : {0, 45, 90})
    for (const int e : {0, 45, 90})
      for (const int a : {0, 180})
        text += fmt::format("{},{},{},{}\n", i, e, a, (i + e) * 0.01 + a * 1e-3);
  const auto table = read_brdf_table(write(text));
  ASSERT_THAT(table, Succeeds());
  const double mu0 = std::cos(kRad * 50), mu = std::cos(kRad * 20);
  const double cos_phase =
      mu0 * mu + std::sin(kRad * 50) * std::sin(kRad * 20) * std::cos(kRad * 70);
  EXPECT_NEAR(at(*table, {mu0, mu, cos_phase}), std::numbers::pi * mu0 * (0.70 + 0.07), 1e-12);
}

TEST_F(BrdfFile, IsRefusedWithItsLine) {
  const auto code = [&](const std::string& text, const std::string& says) {
    const auto table = read_brdf_table(write(text));
    ASSERT_THAT(table, FailsWith(kBrdfFile));
    EXPECT_NE(table.error().message.find(says), std::string::npos) << table.error().message;
  };
  code("i,e,a\n", "line 1");
  code(head + "0,0,0,0.1\n0,0,0,0.1\n", "line 3");
  code(head + "0,0,0,0.1\n0,95,0,0.1\n", "line 3");
  code(head + "0,0,0,-0.1\n", "line 2");
  code(head + "0,0,0,nan\n", "line 2");
  code(head + "0,0,0\n", "line 2");
  code(head, "0 rows");
  code(head + "0,0,0,0.1\n0,10,180,0.1\n", "2 rows");
}

TEST(Material, IsRefusedWithWhatItsLawDoesNotKnow) {
  Hapke steep = moon(Hapke::Form::y2012), packed = steep;
  steep.roughness_deg = 75.0, packed.filling = 0.8;
  for (const Law& law : std::vector<Law>{
           Lambert{grey(1.1)}, LommelSeeliger{grey(-0.1)}, LunarLambert{grey(0.1), 1.5},
           OrenNayar{grey(0.5), 80.0}, Ggx{grey(1.0), grey(1.0), grey(1.0), 0.0},
           hapke(Hapke::Form::y2012, NAN), steep, packed, BrdfTable{}}) {
    const auto checked = check_material({"m7", law});
    ASSERT_THAT(checked, FailsWith(kMaterialOutOfRange));
    EXPECT_NE(checked.error().message.find("m7"), std::string::npos);
  }
  for (const auto& [name, law] : all_laws()) EXPECT_THAT(check_material({name, law}), Succeeds());
}

TEST(AlbedoMap, IsLinearBetweenPixelCentres) {
  AlbedoMap map;
  map.max_x_mm = 40.0, map.max_y_mm = 20.0;
  for (auto& f : map.factor) {
    f = Grid<float>(2, 4);
    for (std::ptrdiff_t r = 0; r < 2; ++r)
      for (std::ptrdiff_t c = 0; c < 4; ++c) f(r, c) = static_cast<float>(10 * r + c);
  }
  EXPECT_NEAR(map.at(5, 5)[0], 0.0, 1e-12);     // centre of the lower left pixel
  EXPECT_NEAR(map.at(35, 15)[1], 13.0, 1e-12);  // upper right
  EXPECT_NEAR(map.at(20, 10)[2], 6.5, 1e-12);   // middle
  EXPECT_NEAR(map.at(-9, 99)[0], 10.0, 1e-12);  // beyond: as at the edge
}

}  // namespace
}  // namespace maquette::camera
