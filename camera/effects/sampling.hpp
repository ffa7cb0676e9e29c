// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file sampling.hpp
/// Values between pixel centres; the edge goes on beyond the picture.

#include <algorithm>
#include <cmath>
#include <cstring>

#include "core/grid.hpp"

namespace maquette::camera {

/// Bilinear, at (x, y) in pixels from the upper left corner.
[[nodiscard]] inline float bilinear(const Grid<float>& g, float x, float y) {
  const float u = std::clamp(x - 0.5F, 0.0F, static_cast<float>(g.cols() - 1));
  const float v = std::clamp(y - 0.5F, 0.0F, static_cast<float>(g.rows() - 1));
  const auto c =
      std::min(static_cast<std::ptrdiff_t>(u), std::max<std::ptrdiff_t>(g.cols() - 2, 0));
  const auto r =
      std::min(static_cast<std::ptrdiff_t>(v), std::max<std::ptrdiff_t>(g.rows() - 2, 0));
  const float s = u - static_cast<float>(c), t = v - static_cast<float>(r);
  const std::ptrdiff_t right = g.cols() > 1 ? 1 : 0, down = g.rows() > 1 ? 1 : 0;
  const float upper = g(r, c) + s * (g(r, c + right) - g(r, c));
  const float lower = g(r + down, c) + s * (g(r + down, c + right) - g(r + down, c));
  return upper + t * (lower - upper);
}

/// Weights of Catmull and Rom's cubic for the share s of a step: sharp, exact for quadratics.
[[nodiscard]] inline std::array<float, 4> cubic_weights(float s) {
  const float s2 = s * s, s3 = s2 * s;
  return {-0.5F * s3 + s2 - 0.5F * s, 1.5F * s3 - 2.5F * s2 + 1.0F,
          -1.5F * s3 + 2.0F * s2 + 0.5F * s, 0.5F * s3 - 0.5F * s2};
}

/// Bicubic (Catmull-Rom), never below 0: light is not negative.
[[nodiscard]] inline float bicubic(const Grid<float>& g, float x, float y) {
  const float u = x - 0.5F, v = y - 0.5F;
  const float fu = std::floor(u), fv = std::floor(v);
  const auto c = static_cast<std::ptrdiff_t>(fu), r = static_cast<std::ptrdiff_t>(fv);
  if (c < 1 || r < 1 || c + 3 > g.cols() || r + 3 > g.rows()) return bilinear(g, x, y);
  using Four = float __attribute__((vector_size(16)));
  const std::array<float, 4> wx = cubic_weights(u - fu), wy = cubic_weights(v - fv);
  const float* at = &g(r - 1, c - 1);
  Four sum{};
  for (std::size_t k = 0; k < 4; ++k, at += g.cols()) {
    Four row;
    std::memcpy(&row, at, sizeof row);
    sum += row * wy[k];
  }
  const float value = (sum[0] * wx[0] + sum[1] * wx[1]) + (sum[2] * wx[2] + sum[3] * wx[3]);
  return value > 0.0F ? value : 0.0F;
}

/// bicubic() at kSampleLanes places at once, the same bits.
inline constexpr std::size_t kSampleLanes = 8;
inline void bicubic_lanes(const Grid<float>& g, const float* x, const float* y, float* to) {
  constexpr std::size_t n = kSampleLanes;
  std::array<float, n> s, t;
  std::array<int, n> c, r;
  int inside = 1;
  const int last_c = static_cast<int>(g.cols()) - 3, last_r = static_cast<int>(g.rows()) - 3;
  for (std::size_t l = 0; l < n; ++l) {
    const float u = x[l] - 0.5F, v = y[l] - 0.5F;
    const float fu = std::floor(u), fv = std::floor(v);
    c[l] = static_cast<int>(fu), r[l] = static_cast<int>(fv);
    s[l] = u - fu, t[l] = v - fv;
    inside &= static_cast<int>(c[l] >= 1) & static_cast<int>(r[l] >= 1) &
              static_cast<int>(c[l] <= last_c) & static_cast<int>(r[l] <= last_r);
  }
  if (inside == 0) {
    for (std::size_t l = 0; l < n; ++l) to[l] = bicubic(g, x[l], y[l]);
    return;
  }
  std::array<std::array<float, n>, 4> wx, wy;
  for (std::size_t l = 0; l < n; ++l) {
    const auto a = cubic_weights(s[l]), b = cubic_weights(t[l]);
    for (std::size_t k = 0; k < 4; ++k) wx[k][l] = a[k], wy[k][l] = b[k];
  }
  int side_by_side = 1;
  for (std::size_t l = 1; l < n; ++l)
    side_by_side &=
        static_cast<int>(c[l] == c[0] + static_cast<int>(l)) & static_cast<int>(r[l] == r[0]);
  if (side_by_side != 0) {
    // The picture is hardly scaled: most of the time each lane's pixels lie beside the last one's.
    std::array<std::array<float, n>, 4> sum{};
    const float* at = &g(r[0] - 1, c[0] - 1);
    for (std::size_t k = 0; k < 4; ++k, at += g.cols())
      for (std::size_t j = 0; j < 4; ++j)
        for (std::size_t l = 0; l < n; ++l) sum[j][l] += at[j + l] * wy[k][l];
    for (std::size_t l = 0; l < n; ++l) {
      const float value = (sum[0][l] * wx[0][l] + sum[1][l] * wx[1][l]) +
                          (sum[2][l] * wx[2][l] + sum[3][l] * wx[3][l]);
      to[l] = value > 0.0F ? value : 0.0F;
    }
    return;
  }
  using Four = float __attribute__((vector_size(16)));
  for (std::size_t l = 0; l < n; ++l) {
    const float* at = &g(r[l] - 1, c[l] - 1);
    Four sum{};
    for (std::size_t k = 0; k < 4; ++k, at += g.cols()) {
      Four row;
      std::memcpy(&row, at, sizeof row);
      sum += row * wy[k][l];
    }
    const float value =
        (sum[0] * wx[0][l] + sum[1] * wx[1][l]) + (sum[2] * wx[2][l] + sum[3] * wx[3][l]);
    to[l] = value > 0.0F ? value : 0.0F;
  }
}

}  // namespace maquette::camera
