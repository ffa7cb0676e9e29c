// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/effects/adc.hpp"

#include <algorithm>
#include <cmath>

namespace maquette::camera {

double largest_dn(const Shot& shot) {
  return std::ldexp(1.0, shot.bits) - 1.0;
}

double gain_of(const Shot& shot) {
  if (shot.gain_e_per_dn > 0.0) return shot.gain_e_per_dn;
  return shot.full_well_e / (largest_dn(shot) - shot.black_level_dn);
}

RowFunction rows(const Adc&, const Shot& shot, const Frame&) {
  const auto scale = static_cast<float>(1.0 / gain_of(shot));
  const auto black = static_cast<float>(shot.black_level_dn);
  const auto most = static_cast<float>(largest_dn(shot));
  return [=](std::ptrdiff_t, const std::vector<std::span<float>>& bands) {
    for (const auto& band : bands)
      for (float& v : band) v = std::clamp(std::floor(black + scale * v + 0.5F), 0.0F, most);
  };
}

}  // namespace maquette::camera
