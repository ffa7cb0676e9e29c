// SPDX-License-Identifier: GPL-3.0-or-later
#include "heightmap/detail/surface_pair.hpp"

#include <algorithm>
#include <cmath>

#include <oneapi/tbb/parallel_for.h>

#include "core/median.hpp"

namespace maquette::heightmap::detail {
namespace {

constexpr int kCellsPerPixel = 3;    // of the coarser surface, along each axis
constexpr double kCommonBlur = 0.5;  // of both, in coarser pixels (standard deviation)

/// Voids where a cell is off the median of its neighbours by more than six times what cells
/// usually are: spikes, which smoothing would spread.
Grid<float> without_spikes(const Grid<float>& z) {
  Grid<float> off(z.rows(), z.cols(), NAN);
  oneapi::tbb::parallel_for(std::ptrdiff_t{1}, z.rows() - 1, [&](std::ptrdiff_t r) {
    for (std::ptrdiff_t c = 1; c + 1 < z.cols(); ++c) {
      std::array<float, 8> around;
      std::size_t n = 0;
      for (std::ptrdiff_t i = r - 1; i <= r + 1; ++i)
        for (std::ptrdiff_t j = c - 1; j <= c + 1; ++j)
          if ((i != r || j != c) && !std::isnan(z(i, j))) around[n++] = z(i, j);
      if (n < 5 || std::isnan(z(r, c))) continue;
      const auto middle = around.begin() + static_cast<std::ptrdiff_t>(n / 2);
      std::nth_element(around.begin(), middle, around.begin() + static_cast<std::ptrdiff_t>(n));
      off(r, c) = std::abs(z(r, c) - *middle);
    }
  });
  std::vector<double> size;
  const std::size_t step = 1 + z.cells().size() / 1'000'000;
  for (std::size_t i = 0; i < off.cells().size(); i += step)
    if (!std::isnan(off.cells()[i])) size.push_back(static_cast<double>(off.cells()[i]));
  const auto limit = static_cast<float>(6.0 * kMadToSigma * median(std::move(size), INFINITY));
  Grid<float> out = z;
  for (std::size_t i = 0; i < out.cells().size(); ++i)
    if (off.cells()[i] > limit) out.cells()[i] = NAN;
  return out;
}

/// One pass along a line of n values `stride` apart; voids are left out where the rest of the
/// kernel weighs three quarters.
void convolve_line(const float* in, float* out, std::ptrdiff_t n, std::ptrdiff_t stride,
                   const std::vector<double>& kernel) {
  const auto reach = static_cast<std::ptrdiff_t>(kernel.size()) - 1;  // kernel[0] is the middle
  for (std::ptrdiff_t i = 0; i < n; ++i) {
    double sum = 0.0, weight = 0.0;
    for (std::ptrdiff_t k = std::max(-reach, -i); k <= std::min(reach, n - 1 - i); ++k) {
      const float v = in[(i + k) * stride];
      const double w = std::isnan(v) ? 0.0 : kernel[static_cast<std::size_t>(std::abs(k))];
      weight += w;
      if (w != 0.0) sum += w * static_cast<double>(v);
    }
    out[i * stride] = weight >= 0.75 ? static_cast<float>(sum / weight) : NAN;
  }
}

Grid<float> convolved(const Grid<float>& z, const std::vector<double>& kernel) {
  if (kernel.size() == 1) return z;
  Grid<float> half(z.rows(), z.cols(), NAN), out(z.rows(), z.cols(), NAN);
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, z.rows(), [&](std::ptrdiff_t r) {
    convolve_line(&z(r, 0), &half(r, 0), z.cols(), 1, kernel);
  });
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, z.cols(), [&](std::ptrdiff_t c) {
    convolve_line(&half(0, c), &out(0, c), z.rows(), z.cols(), kernel);
  });
  return out;
}

std::vector<double> gaussian(double sigma) {
  std::vector<double> kernel{1.0};
  for (double x = 1.0; x <= std::ceil(3.0 * sigma) && sigma > 0.05; ++x)
    kernel.push_back(std::exp(-0.5 * x * x / (sigma * sigma)));
  double sum = -kernel[0];
  for (const double k : kernel) sum += 2.0 * k;
  for (double& k : kernel) k /= sum;
  return kernel;
}

/// Mean over `width` cells, the outermost of them by their share.
std::vector<double> box(double width) {
  std::vector<double> kernel{std::min(1.0, 1.0 / width)};
  for (double x = 1.0; x - 0.5 < 0.5 * width; ++x)
    kernel.push_back(std::min(1.0, 0.5 * width - (x - 0.5)) / width);
  return kernel;
}

}  // namespace

Grid<float> block_means(const Grid<float>& z, std::ptrdiff_t m) {
  if (m == 1) return z;
  Grid<float> out(z.rows() / m, z.cols() / m, NAN);
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, out.rows(), [&](std::ptrdiff_t r) {
    for (std::ptrdiff_t c = 0; c < out.cols(); ++c) {
      double sum = 0.0;
      std::ptrdiff_t n = 0;
      for (std::ptrdiff_t i = r * m; i < (r + 1) * m; ++i)
        for (std::ptrdiff_t j = c * m; j < (c + 1) * m; ++j)
          if (const float h = z(i, j); !std::isnan(h)) {
            sum += static_cast<double>(h);
            ++n;
          }
      if (2 * n >= m * m && n > 0) out(r, c) = static_cast<float>(sum / static_cast<double>(n));
    }
  });
  return out;
}

std::array<double, 3> height_and_gradient(const Grid<float>& z, double x, double y) {
  const double fx = std::floor(x), fy = std::floor(y);
  if (!(fx >= 1.0 && fy >= 1.0 && fx + 2.0 < static_cast<double>(z.cols()) &&
        fy + 2.0 < static_cast<double>(z.rows())))
    return {NAN, NAN, NAN};
  const auto c = static_cast<std::ptrdiff_t>(fx), r = static_cast<std::ptrdiff_t>(fy);
  const auto weights = [](double t) {
    const double s = 1.0 - t;
    return std::array<double, 4>{-0.5 * t * s * s, 1.0 + t * t * (1.5 * t - 2.5),
                                 1.0 + s * s * (1.5 * s - 2.5), -0.5 * s * t * t};
  };
  const auto slopes = [](double t) {
    const double s = 1.0 - t;
    return std::array<double, 4>{-0.5 * s * s + t * s, t * (4.5 * t - 5.0), -s * (4.5 * s - 5.0),
                                 0.5 * t * t - s * t};
  };
  const auto wx = weights(x - fx), wy = weights(y - fy), gx = slopes(x - fx), gy = slopes(y - fy);
  std::array<double, 3> out{0.0, 0.0, 0.0};
  for (std::size_t j = 0; j < 4; ++j) {
    const float* row = &z(r - 1 + static_cast<std::ptrdiff_t>(j), c - 1);
    double value = 0.0, slope = 0.0;
    for (std::size_t i = 0; i < 4; ++i) {
      value += wx[i] * static_cast<double>(row[i]);
      slope += gx[i] * static_cast<double>(row[i]);
    }
    out[0] += wy[j] * value;
    out[1] += wy[j] * slope;
    out[2] += gy[j] * value;
  }
  return out;
}

Spread spread_of(const std::vector<double>& residual) {
  std::vector<double> known;
  for (const double e : residual)
    if (!std::isnan(e)) known.push_back(e);
  return {median(known), nmad(known), known.size()};
}

double psi(double e, double limit) {
  const double u = e / limit, w = 1.0 - u * u;
  return w > 0.0 ? e * w * w : 0.0;
}
double psi_slope(double e, double limit) {
  const double u = e / limit, w = 1.0 - u * u;
  return w > 0.0 ? w * (1.0 - 5.0 * u * u) : 0.0;
}

SurfacePair cells_of(const Grid<float>& lower, const Grid<float>& upper, double spacing_m,
                     double coarse_m) {
  SurfacePair pair;
  const double cell_wanted = coarse_m / kCellsPerPixel / spacing_m;
  const auto smallest_side = static_cast<double>(std::min(lower.rows(), lower.cols()));
  pair.resolved = cell_wanted <= smallest_side / 16.0;
  pair.nodes = static_cast<std::ptrdiff_t>(
      std::max(1.0, std::round(std::min(cell_wanted, smallest_side / 16.0))));
  pair.cell_m = static_cast<double>(pair.nodes) * spacing_m;
  pair.lower = block_means(without_spikes(lower), pair.nodes);
  pair.upper = block_means(without_spikes(upper), pair.nodes);
  return pair;
}

void bring_to_one_resolution(SurfacePair& pair, double lower_pixel_m, double upper_pixel_m) {
  const double coarse_m = std::max(lower_pixel_m, upper_pixel_m);
  const double fine_m = std::min(lower_pixel_m, upper_pixel_m);
  Grid<float>& sharper = lower_pixel_m <= upper_pixel_m ? pair.lower : pair.upper;
  const double seen = std::sqrt(std::max(0.0, coarse_m * coarse_m - fine_m * fine_m)) / pair.cell_m;
  if (seen > 1.0) sharper = convolved(sharper, box(seen));
  const std::vector<double> blur = gaussian(kCommonBlur * coarse_m / pair.cell_m);
  pair.lower = convolved(pair.lower, blur);
  pair.upper = convolved(pair.upper, blur);
  // The lower surface's slopes stand on nodes: no interpolation couples their noise to heights.
  // A much finer upper surface has next to no noise after all its means, and better slopes.
  pair.by_upper = 1.5 * upper_pixel_m < lower_pixel_m;
}

}  // namespace maquette::heightmap::detail
