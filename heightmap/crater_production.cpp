// SPDX-License-Identifier: GPL-3.0-or-later
#include "heightmap/crater_production.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "core/check.hpp"

namespace maquette::heightmap {
namespace {

/// log10 of craters per square kilometre and 10^9 years, by powers of log10 of D in kilometres.
struct Production {
  std::array<double, 12> a;
  double early, steady;  ///< of the chronology, per square kilometre
};
constexpr Production kMoon{{-3.0876, -3.557528, 0.781027, 1.021521, -0.156012, -0.444058, 0.019977,
                            0.086850, -0.005874, -0.006809, 8.25e-4, 5.54e-5},
                           5.44e-14,
                           8.38e-4};
constexpr Production kMars{{-3.384, -3.197, 1.257, 0.7915, -0.4861, -0.3630, 0.1016, 6.756e-2,
                            -1.181e-2, -4.753e-3, 6.233e-4, 5.805e-5},
                           2.68e-14,
                           4.13e-4};
constexpr double kSmallest_km = 0.010, kLargest_km = 300.0;
constexpr double kPerKm2 = 1e-6;

double polynomial(const Production& p, double x) {
  double sum = 0.0;
  for (std::size_t i = p.a.size(); i-- > 0;) sum = sum * x + p.a[i];
  return sum;
}

double slope(const Production& p, double x) {
  double sum = 0.0;
  for (std::size_t i = p.a.size(); i-- > 1;) sum = sum * x + static_cast<double>(i) * p.a[i];
  return sum;
}

}  // namespace

double craters_produced(const Body& body, double age_gyr, double diameter_m) {
  MAQUETTE_CHECK(diameter_m > 0.0 && age_gyr >= 0.0, "craters of {} m after {} Gyr", diameter_m,
                 age_gyr);
  const Production& p = body.name == "mars" ? kMars : kMoon;
  const double d_km = 1e-3 * diameter_m;
  const double x = std::log10(std::clamp(d_km, kSmallest_km, kLargest_km));
  const double log_n = polynomial(p, x) + slope(p, x) * (std::log10(d_km) - x);
  const auto of_1_km = [&](double t) { return p.early * std::expm1(6.93 * t) + p.steady * t; };
  return kPerKm2 * std::pow(10.0, log_n) * of_1_km(age_gyr) / of_1_km(1.0);
}

double craters_in_equilibrium(double diameter_m) {
  return kPerKm2 * std::pow(10.0, -1.33) * std::pow(1e-3 * diameter_m, -1.83);
}

double craters_present(const Body& body, double age_gyr, double diameter_m) {
  return std::min(craters_produced(body, age_gyr, diameter_m), craters_in_equilibrium(diameter_m));
}

}  // namespace maquette::heightmap
