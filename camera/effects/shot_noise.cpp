// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/effects/shot_noise.hpp"

#include "camera/effects/noise.hpp"

namespace maquette::camera {

RowFunction rows(const ShotNoise&, const Shot& shot, const Frame&) {
  const NoiseStream stream = temporal_noise(shot, ShotNoise::kInfo.name);
  return [stream](std::ptrdiff_t row, const std::vector<std::span<float>>& bands) {
    const NormalTable& table = normal_table();
    for (std::size_t b = 0; b < bands.size(); ++b)
      poisson_counts(table, stream, draw_number(row, 0, b), bands[b]);
  };
}

}  // namespace maquette::camera
