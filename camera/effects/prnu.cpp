// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/effects/prnu.hpp"

#include "camera/effects/noise.hpp"

namespace maquette::camera {

Result<void> check(const Prnu& e, const Shot&) {
  return in_range("prnu", "sigma", e.sigma, 0.0, 0.2);
}

RowFunction rows(const Prnu& e, const Shot& shot, const Frame&) {
  const NoiseStream stream = fixed_pattern(shot, Prnu::kInfo.name);
  return [stream, sigma = static_cast<float>(e.sigma)](std::ptrdiff_t row,
                                                       const std::vector<std::span<float>>& bands) {
    const NormalTable& table = normal_table();
    for (std::size_t b = 0; b < bands.size(); ++b) {
      const std::uint64_t first = draw_number(row, 0, b);
      const std::size_t cols = bands[b].size();
      std::array<float, kDraws> z;
      for (std::size_t c = 0; c < cols; c += kDraws) {
        const std::size_t n = std::min(kDraws, cols - c);
        normals_at(table, stream, first + c, n, z.data());
        float* to = bands[b].data() + c;
        for (std::size_t i = 0; i < n; ++i) to[i] *= 1.0F + sigma * z[i];
      }
    }
  };
}

}  // namespace maquette::camera
