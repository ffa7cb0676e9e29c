// SPDX-License-Identifier: GPL-3.0-or-later
#include "heightmap/detail/blend.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include <oneapi/tbb/parallel_for.h>

#include "heightmap/detail/void_fill.hpp"

namespace maquette::heightmap::detail {
namespace {

constexpr double kCellsPerPixel = 4.0;  // of the coarser source
constexpr double kRimPixels = 3.0;      // of the finer one, in which detail comes up
constexpr double kWidthInPixels = 0.5;  // of the Gaussian (standard deviation)

double smoothstep(double t) {
  t = std::clamp(t, 0.0, 1.0);
  return t * t * (3.0 - 2.0 * t);
}

/// Means of both over cells of m x m nodes where the layer has a height, and how many.
struct Cells {
  Grid<double> below, layer, count;
};

Cells cells_of(const Grid<float>& z, const Grid<float>& layer, std::ptrdiff_t m) {
  const std::ptrdiff_t rows = (z.rows() + m - 1) / m, cols = (z.cols() + m - 1) / m;
  Cells out{Grid<double>(rows, cols, 0.0), Grid<double>(rows, cols, 0.0),
            Grid<double>(rows, cols, 0.0)};
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, rows, [&](std::ptrdiff_t i) {
    for (std::ptrdiff_t j = 0; j < cols; ++j) {
      double below = 0.0, above = 0.0, n = 0.0;
      for (std::ptrdiff_t r = i * m; r < std::min(z.rows(), (i + 1) * m); ++r)
        for (std::ptrdiff_t c = j * m; c < std::min(z.cols(), (j + 1) * m); ++c)
          if (const float l = layer(r, c); !std::isnan(l)) {
            above += static_cast<double>(l);
            below += static_cast<double>(z(r, c));
            n += 1.0;
          }
      if (n == 0.0) continue;
      out.below(i, j) = below / n;
      out.layer(i, j) = above / n;
      out.count(i, j) = n;
    }
  });
  return out;
}

/// Sums with a symmetric kernel along rows and columns; kernel[0] is the middle, beyond the edge is
/// zero.
Grid<double> summed(const Grid<double>& in, const std::vector<double>& kernel) {
  const auto reach = static_cast<std::ptrdiff_t>(kernel.size()) - 1;
  Grid<double> half(in.rows(), in.cols(), 0.0), out(in.rows(), in.cols(), 0.0);
  const auto pass = [&](const Grid<double>& from, Grid<double>& to, bool along_row) {
    oneapi::tbb::parallel_for(std::ptrdiff_t{0}, from.rows(), [&](std::ptrdiff_t r) {
      for (std::ptrdiff_t c = 0; c < from.cols(); ++c) {
        double sum = 0.0;
        for (std::ptrdiff_t k = -reach; k <= reach; ++k) {
          const std::ptrdiff_t i = along_row ? r : r + k, j = along_row ? c + k : c;
          if (i >= 0 && j >= 0 && i < from.rows() && j < from.cols())
            sum += kernel[static_cast<std::size_t>(std::abs(k))] * from(i, j);
        }
        to(r, c) = sum;
      }
    });
  };
  pass(in, half, true);
  pass(half, out, false);
  return out;
}

/// Mean over a width in cells, the outermost by their share.
std::vector<double> box(double width) {
  std::vector<double> kernel{std::min(1.0, width)};
  for (double x = 1.0; x - 0.5 < 0.5 * width; ++x)
    kernel.push_back(std::min(1.0, 0.5 * width - (x - 0.5)));
  return kernel;
}

/// What both say differently of the waves that both resolve, on cells; zero where they share none.
/// @param pixel_cells  of the coarser one
Grid<double> disagreement(const Cells& cells, double pixel_cells, bool layer_is_finer) {
  const Grid<double>& finer = layer_is_finer ? cells.layer : cells.below;
  const Grid<double>& coarser = layer_is_finer ? cells.below : cells.layer;
  Grid<double> there(finer.rows(), finer.cols(), 0.0);
  for (std::size_t i = 0; i < there.cells().size(); ++i)
    there.cells()[i] = cells.count.cells()[i] > 0.0 ? 1.0 : 0.0;
  const std::vector<double> pixel = box(pixel_cells);
  const Grid<double> mean = summed(finer, pixel), seen = summed(there, pixel);
  const double whole = *std::max_element(seen.cells().begin(), seen.cells().end());
  Grid<double> q(finer.rows(), finer.cols(), 0.0), weight(finer.rows(), finer.cols(), 0.0);
  for (std::size_t i = 0; i < q.cells().size(); ++i) {
    // Only where the whole pixel is seen: a part of it would have another mean.
    if (seen.cells()[i] < 0.999 * whole || cells.count.cells()[i] == 0.0) continue;
    weight.cells()[i] = cells.count.cells()[i];
    q.cells()[i] = weight.cells()[i] * (mean.cells()[i] / seen.cells()[i] - coarser.cells()[i]);
    if (!layer_is_finer) q.cells()[i] = -q.cells()[i];
  }
  const double wide = kWidthInPixels * pixel_cells;
  std::vector<double> gaussian;
  for (double x = 0.0; x <= std::ceil(4.0 * wide); ++x)
    gaussian.push_back(std::exp(-0.5 * x * x / (wide * wide)));
  q = summed(q, gaussian);
  weight = summed(weight, gaussian);
  for (std::size_t i = 0; i < q.cells().size(); ++i)
    q.cells()[i] = weight.cells()[i] > 0.0 ? q.cells()[i] / weight.cells()[i] : 0.0;
  return q;
}

/// Cubic B-spline through smooth values: no creases at cells. Its own smoothing is below that of
/// the Gaussian.
double between(const Grid<double>& g, double row, double col) {
  const double fr = std::floor(row), fc = std::floor(col);
  const auto weights = [](double t) {
    const double s = 1.0 - t;
    return std::array<double, 4>{s * s * s / 6.0, (4.0 - 6.0 * t * t + 3.0 * t * t * t) / 6.0,
                                 (4.0 - 6.0 * s * s + 3.0 * s * s * s) / 6.0, t * t * t / 6.0};
  };
  const auto wr = weights(row - fr), wc = weights(col - fc);
  double sum = 0.0;
  for (std::ptrdiff_t i = 0; i < 4; ++i)
    for (std::ptrdiff_t j = 0; j < 4; ++j) {
      const auto r =
          std::clamp<std::ptrdiff_t>(static_cast<std::ptrdiff_t>(fr) - 1 + i, 0, g.rows() - 1);
      const auto c =
          std::clamp<std::ptrdiff_t>(static_cast<std::ptrdiff_t>(fc) - 1 + j, 0, g.cols() - 1);
      sum += wr[static_cast<std::size_t>(i)] * wc[static_cast<std::size_t>(j)] * g(r, c);
    }
  return sum;
}

}  // namespace

void blend(Grid<float>& z, Grid<float>& sigma_m, Grid<std::uint8_t>& source,
           const Grid<float>& layer, const BlendScales& scales, std::uint8_t index) {
  const double coarse = std::max(scales.below_pixel, scales.layer_pixel);
  const double fine = std::min(scales.below_pixel, scales.layer_pixel);
  const auto m = std::max<std::ptrdiff_t>(1, static_cast<std::ptrdiff_t>(coarse / kCellsPerPixel));
  const Grid<double> q = disagreement(cells_of(z, layer, m), coarse / static_cast<double>(m),
                                      scales.layer_pixel <= scales.below_pixel);
  // Noise of both in means over a coarse pixel, white at their own.
  const double below = scales.below_sigma_m * scales.below_pixel / coarse;
  const double above = scales.layer_sigma_m * scales.layer_pixel / coarse;
  const double share = below * below / (below * below + above * above);
  const double ramp = std::max(2.0, scales.ramp);
  const double rim = std::min(ramp, std::max(2.0, kRimPixels * fine));
  const Grid<float> distance = distance_to(layer, true);
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, z.rows(), [&](std::ptrdiff_t r) {
    const double row = (static_cast<double>(r) + 0.5) / static_cast<double>(m) - 0.5;
    for (std::ptrdiff_t c = 0; c < z.cols(); ++c) {
      const auto inside = static_cast<double>(distance(r, c));
      if (inside == 0.0) continue;
      const double s = share * smoothstep(inside / ramp), v = smoothstep(inside / rim);
      const double differ =
          between(q, row, (static_cast<double>(c) + 0.5) / static_cast<double>(m) - 0.5);
      const double below_m = static_cast<double>(z(r, c));
      const double above_m = static_cast<double>(layer(r, c)) - (1.0 - s) * differ;
      z(r, c) = static_cast<float>(below_m + v * (above_m - below_m));
      sigma_m(r, c) = static_cast<float>(
          std::hypot((1.0 - s) * static_cast<double>(sigma_m(r, c)), v * scales.layer_sigma_m));
      if (s >= 0.5 * share) source(r, c) = index;
    }
  });
}

}  // namespace maquette::heightmap::detail
