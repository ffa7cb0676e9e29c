// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/effects/dark_current.hpp"

#include <cmath>

namespace maquette::camera {

double dark_growth(double temperature_c, double reference_c) {
  const auto law = [](double celsius) {
    constexpr double kBoltzmannEv = 8.617333262e-5;
    const double t = celsius + 273.15;
    const double gap_ev = 1.1557 - 7.021e-4 * t * t / (1108.0 + t);
    return 1.5 * std::log(t) - gap_ev / (2.0 * kBoltzmannEv * t);
  };
  return std::exp(law(temperature_c) - law(reference_c));
}

Result<void> check(const DarkCurrent& e, const Shot&) {
  MAQUETTE_TRY_VOID(in_range("dark_current", "rate_e_s", e.rate_e_s, 0.0, 1e9));
  return in_range("dark_current", "reference_c", e.reference_c, -200.0, 150.0);
}

RowFunction rows(const DarkCurrent& e, const Shot& shot, const Frame&) {
  const auto added = static_cast<float>(e.rate_e_s * shot.exposure_s *
                                        dark_growth(shot.temperature_c, e.reference_c));
  return [added](std::ptrdiff_t, const std::vector<std::span<float>>& bands) {
    for (const auto& band : bands)
      for (float& v : band) v += added;
  };
}

}  // namespace maquette::camera
