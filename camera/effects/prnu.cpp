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
    with_normals(stream, row, bands, [&](float& v, float z) { v *= 1.0F + sigma * z; });
  };
}

}  // namespace maquette::camera
