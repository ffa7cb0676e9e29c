// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/pictures.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include <oneapi/tbb/parallel_for.h>

#include "camera/effects/sampling.hpp"

namespace maquette::diagnosis::detail {
namespace {

/// Gaussians of less variance are no longer that when sampled at pixels (a tenth too narrow at
/// 0.27, 0.2 % at this): they are three values that have it.
constexpr double kNarrow_px2 = 0.49;

/// Weights of a pixel and its neighbours on a line, the pixel in the middle. As a box of a pixel's
/// width is in every sample's way anyway, a Gaussian is sampled at pixels.
void take_kernel(double variance, std::vector<float>& weights) {
  weights.clear();
  if (variance < kNarrow_px2) {
    const auto side = static_cast<float>(0.5 * variance);
    weights.assign({side, 1.0F - 2.0F * side, side});
    return;
  }
  const auto reach = static_cast<int>(std::ceil(4.0 * std::sqrt(variance)));
  double sum = 0.0;
  for (int i = -reach; i <= reach; ++i) sum += std::exp(-0.5 * i * i / variance);
  for (int i = -reach; i <= reach; ++i)
    weights.push_back(static_cast<float>(std::exp(-0.5 * i * i / variance) / sum));
}

}  // namespace

float bilinear(const Grid<float>& g, double row, double col) {
  return camera::bilinear(g, static_cast<float>(col) + 0.5F, static_cast<float>(row) + 0.5F);
}

float cubic(const Grid<float>& g, double row, double col) {
  return camera::bicubic(g, static_cast<float>(col) + 0.5F, static_cast<float>(row) + 0.5F);
}

void blur(Grid<float>& image, double variance_px2) {
  if (!(variance_px2 > 0.0)) return;
  std::vector<float> k;
  take_kernel(variance_px2, k);
  const auto reach = static_cast<std::ptrdiff_t>(k.size() / 2);
  const std::ptrdiff_t rows = image.rows(), cols = image.cols();
  Grid<float> half(rows, cols, 0.0F);
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, rows, [&](std::ptrdiff_t r) {
    for (std::ptrdiff_t c = 0; c < cols; ++c) {
      float sum = 0.0F;
      for (std::ptrdiff_t i = -reach; i <= reach; ++i)
        sum += k[static_cast<std::size_t>(i + reach)] *
               image(r, std::clamp<std::ptrdiff_t>(c + i, 0, cols - 1));
      half(r, c) = sum;
    }
  });
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, rows, [&](std::ptrdiff_t r) {
    for (std::ptrdiff_t c = 0; c < cols; ++c) {
      float sum = 0.0F;
      for (std::ptrdiff_t i = -reach; i <= reach; ++i)
        sum += k[static_cast<std::size_t>(i + reach)] *
               half(std::clamp<std::ptrdiff_t>(r + i, 0, rows - 1), c);
      image(r, c) = sum;
    }
  });
}

void blur_by_place(Grid<float>& image, const Grid<float>& variance_px2) {
  const Grid<float> from = image;
  const std::ptrdiff_t rows = image.rows(), cols = image.cols();
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, rows, [&](std::ptrdiff_t r) {
    std::vector<float> k;
    for (std::ptrdiff_t c = 0; c < cols; ++c) {
      const auto variance = static_cast<double>(variance_px2(r, c));
      if (!(variance > 0.0)) continue;
      take_kernel(variance, k);
      const auto reach = static_cast<std::ptrdiff_t>(k.size() / 2);
      float sum = 0.0F;
      for (std::ptrdiff_t i = -reach; i <= reach; ++i) {
        float along = 0.0F;
        for (std::ptrdiff_t j = -reach; j <= reach; ++j)
          along += k[static_cast<std::size_t>(j + reach)] *
                   from(std::clamp<std::ptrdiff_t>(r + i, 0, rows - 1),
                        std::clamp<std::ptrdiff_t>(c + j, 0, cols - 1));
        sum += k[static_cast<std::size_t>(i + reach)] * along;
      }
      image(r, c) = sum;
    }
  });
}

void smear(Grid<float>& image, const std::array<double, 3>& tensor_px2,
           const std::function<bool(std::ptrdiff_t row, std::ptrdiff_t col)>& wanted) {
  const auto& [along_cols, both, along_rows] = tensor_px2;
  const double mean = 0.5 * (along_cols + along_rows),
               apart = std::hypot(0.5 * (along_cols - along_rows), both),
               across = std::fmax(0.0, mean - apart), along = mean + apart - across;
  if (!(along > 1e-6)) return blur(image, across);
  const double angle = 0.5 * std::atan2(2.0 * both, along_cols - along_rows);
  const int n = std::max(3, 2 * static_cast<int>(std::ceil(std::sqrt(12.0 * along))) + 1);
  // So far apart that n values have the line's variance.
  const double step = std::sqrt(12.0 * along / (n * n - 1.0));
  const Grid<float> from = image;
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, image.rows(), [&](std::ptrdiff_t r) {
    for (std::ptrdiff_t c = 0; c < image.cols(); ++c) {
      if (!wanted(r, c)) continue;
      float sum = 0.0F;
      for (int i = 0; i < n; ++i) {
        const double at = step * (i - 0.5 * (n - 1));
        sum += cubic(from, static_cast<double>(r) + at * std::sin(angle),
                     static_cast<double>(c) + at * std::cos(angle));
      }
      image(r, c) = sum / static_cast<float>(n);
    }
  });
  blur(image, across);
}

}  // namespace maquette::diagnosis::detail
