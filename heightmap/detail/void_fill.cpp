// SPDX-License-Identifier: GPL-3.0-or-later
#include "heightmap/detail/void_fill.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace maquette::heightmap::detail {
namespace {

/// Means of 2 x 2, of what is there.
Grid<float> halved(const Grid<float>& z) {
  Grid<float> out((z.rows() + 1) / 2, (z.cols() + 1) / 2, NAN);
  for (std::ptrdiff_t r = 0; r < out.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < out.cols(); ++c) {
      double sum = 0.0;
      int n = 0;
      for (std::ptrdiff_t i = 2 * r; i < std::min(2 * r + 2, z.rows()); ++i)
        for (std::ptrdiff_t j = 2 * c; j < std::min(2 * c + 2, z.cols()); ++j)
          if (!std::isnan(z(i, j))) {
            sum += static_cast<double>(z(i, j));
            ++n;
          }
      if (n > 0) out(r, c) = static_cast<float>(sum / n);
    }
  return out;
}

float bilinear(const Grid<float>& z, double row, double col) {
  const double y = std::clamp(row, 0.0, static_cast<double>(z.rows() - 1));
  const double x = std::clamp(col, 0.0, static_cast<double>(z.cols() - 1));
  const auto r = static_cast<std::ptrdiff_t>(y), c = static_cast<std::ptrdiff_t>(x);
  const std::ptrdiff_t r1 = std::min(r + 1, z.rows() - 1), c1 = std::min(c + 1, z.cols() - 1);
  const double t = y - static_cast<double>(r), s = x - static_cast<double>(c);
  return static_cast<float>(
      (1 - t) * ((1 - s) * static_cast<double>(z(r, c)) + s * static_cast<double>(z(r, c1))) +
      t * ((1 - s) * static_cast<double>(z(r1, c)) + s * static_cast<double>(z(r1, c1))));
}

}  // namespace

Grid<float> distance_to(const Grid<float>& z, bool to_voids) {
  constexpr float kDiagonal = std::numbers::sqrt2_v<float>;
  Grid<float> d(z.rows(), z.cols(), INFINITY);
  for (std::size_t i = 0; i < d.cells().size(); ++i)
    if (std::isnan(z.cells()[i]) == to_voids) d.cells()[i] = 0.0F;
  const auto relax = [&](std::ptrdiff_t r, std::ptrdiff_t c, std::ptrdiff_t dr) {
    float best = d(r, c);
    if (c + dr >= 0 && c + dr < d.cols()) best = std::min(best, d(r, c + dr) + 1.0F);
    if (r + dr >= 0 && r + dr < d.rows()) {
      best = std::min(best, d(r + dr, c) + 1.0F);
      if (c > 0) best = std::min(best, d(r + dr, c - 1) + kDiagonal);
      if (c + 1 < d.cols()) best = std::min(best, d(r + dr, c + 1) + kDiagonal);
    }
    d(r, c) = best;
  };
  for (std::ptrdiff_t r = 0; r < d.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < d.cols(); ++c) relax(r, c, -1);
  for (std::ptrdiff_t r = d.rows() - 1; r >= 0; --r)
    for (std::ptrdiff_t c = d.cols() - 1; c >= 0; --c) relax(r, c, 1);
  return d;
}

std::ptrdiff_t fill_voids(Grid<float>& z) {
  const auto voids =
      std::count_if(z.cells().begin(), z.cells().end(), [](float h) { return std::isnan(h); });
  if (voids == 0) return 0;
  MAQUETTE_CHECK(z.rows() > 1 || z.cols() > 1 || voids == 0, "nothing to fill from");
  Grid<float> coarse = halved(z);
  fill_voids(coarse);
  for (std::ptrdiff_t r = 0; r < z.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < z.cols(); ++c)
      if (std::isnan(z(r, c)))
        z(r, c) = bilinear(coarse, 0.5 * static_cast<double>(r) - 0.25,
                           0.5 * static_cast<double>(c) - 0.25);
  return voids;
}

}  // namespace maquette::heightmap::detail
