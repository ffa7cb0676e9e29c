// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/effects/exposure.hpp"

#include <algorithm>
#include <numbers>

namespace maquette::camera {

double photons_at_one(const Exposure& e, const Shot& shot, std::size_t band) {
  const double radiance = of_band(e.radiance_of_one, band);
  if (radiance <= 0.0) {
    const double best =
        *std::max_element(shot.quantum_efficiency.begin(), shot.quantum_efficiency.end());
    return (e.electrons_at_one > 0.0 ? e.electrons_at_one : shot.full_well_e) / best;
  }
  constexpr double kPlanck = 6.62607015e-34, kLight = 299792458.0;  // SI 2019, exact
  const double wider = shot.f_number * (1.0 + e.magnification);
  const double irradiance = std::numbers::pi * radiance * e.transmission / (4.0 * wider * wider);
  const double side_m = shot.pixel_pitch_um * 1e-6;
  const double energy_j = irradiance * side_m * side_m * shot.exposure_s;
  return energy_j * of_band(shot.wavelength_nm, band) * 1e-9 / (kPlanck * kLight);
}

Result<void> check(const Exposure& e, const Shot&) {
  if (e.radiance_of_one.empty())
    return fail(kEffectOutOfRange,
                "exposure.radiance_of_one is empty; give one value or one for "
                "each band");
  for (const double v : e.radiance_of_one)
    MAQUETTE_TRY_VOID(in_range("exposure", "radiance_of_one", v, 0.0, 1e12));
  MAQUETTE_TRY_VOID(in_range("exposure", "transmission", e.transmission, 1e-6, 1.0));
  MAQUETTE_TRY_VOID(in_range("exposure", "magnification", e.magnification, 0.0, 100.0));
  return in_range("exposure", "electrons_at_one", e.electrons_at_one, 0.0, 1e12);
}

RowFunction rows(const Exposure& e, const Shot& shot, const Frame& frame) {
  std::vector<float> factor;
  for (std::size_t b = 0; b < frame.bands.size(); ++b)
    factor.push_back(static_cast<float>(photons_at_one(e, shot, b)));
  return [factor](std::ptrdiff_t, const std::vector<std::span<float>>& bands) {
    for (std::size_t b = 0; b < bands.size(); ++b)
      // Light is not negative; a sharpening filter of the renderer may say so.
      for (float& v : bands[b]) v = v > 0.0F ? v * factor[b] : 0.0F;
  };
}

}  // namespace maquette::camera
