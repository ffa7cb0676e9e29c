// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file quantum_efficiency.hpp
/// Photons free electrons: mean number by band (Shot::quantum_efficiency). Which of the photons do
/// is part of the shot noise: a thinned Poisson count is one of the smaller mean.
/// Source: EMVA 1288 release 4.0, section 2.1.

#include "camera/effects/frame.hpp"

namespace maquette::camera {

struct QuantumEfficiency {
  static constexpr EffectInfo kInfo{"quantum_efficiency", Signal::photons, Signal::electrons,
                                    "photons that the filters let through free electrons"};
};

[[nodiscard]] inline Result<void> check(const QuantumEfficiency&, const Shot&) {
  return {};
}
[[nodiscard]] inline RowFunction rows(const QuantumEfficiency&, const Shot& shot,
                                      const Frame& frame) {
  return [qe = shot.quantum_efficiency, mosaic = frame.mosaic](
             std::ptrdiff_t row, const std::vector<std::span<float>>& bands) {
    for (std::size_t b = 0; b < bands.size(); ++b) {
      float even = static_cast<float>(of_band(qe, b)), odd = even;
      if (mosaic) {
        even = static_cast<float>(of_band(qe, static_cast<std::size_t>(mosaic->at(row, 0))));
        odd = static_cast<float>(of_band(qe, static_cast<std::size_t>(mosaic->at(row, 1))));
      }
      for (std::size_t c = 0; c < bands[b].size(); ++c) bands[b][c] *= (c & 1) != 0 ? odd : even;
    }
  };
}

}  // namespace maquette::camera
