// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/effects/white_balance.hpp"

#include <algorithm>

#include "camera/effects/adc.hpp"

namespace maquette::camera {

Result<void> check(const WhiteBalance& e, const Shot&) {
  if (e.gains.empty())
    return fail(kEffectOutOfRange,
                "white_balance.gains is empty; give one value or one for each "
                "band");
  for (const double v : e.gains)
    MAQUETTE_TRY_VOID(in_range("white_balance", "gains", v, 0.0, 1000.0));
  return {};
}

double gain_of_band(const WhiteBalance& e, const Shot& shot, std::size_t band) {
  const double given = of_band(e.gains, band);
  if (given > 0.0) return given;
  const auto& qe = shot.quantum_efficiency;
  return *std::max_element(qe.begin(), qe.end()) / of_band(qe, band);
}

RowFunction rows(const WhiteBalance& e, const Shot& shot, const Frame& frame) {
  const double range = largest_dn(shot) - shot.black_level_dn;
  std::array<float, 3> scale{};
  for (std::size_t b = 0; b < 3; ++b)
    scale[b] = static_cast<float>(
        gain_of_band(e, shot, std::min(b, shot.quantum_efficiency.size() - 1)) / range);
  return [scale, black = static_cast<float>(shot.black_level_dn), mosaic = frame.mosaic](
             std::ptrdiff_t row, const std::vector<std::span<float>>& bands) {
    for (std::size_t b = 0; b < bands.size(); ++b) {
      float even = scale[b], odd = even;
      if (mosaic) {
        even = scale[static_cast<std::size_t>(mosaic->at(row, 0))];
        odd = scale[static_cast<std::size_t>(mosaic->at(row, 1))];
      }
      auto& band = bands[b];
      for (std::size_t c = 0; c < band.size(); ++c)
        band[c] = (band[c] - black) * ((c & 1) != 0 ? odd : even);
    }
  };
}

}  // namespace maquette::camera
