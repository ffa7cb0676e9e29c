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

/// Distance of a height from the median of those around; of an even number from the farther of the
/// two in the middle: with the upper one of them, four high outliers of eight would let a fifth
/// pass and four low ones not, which draws the mean.
float off_the_median(float z, std::array<float, 8>& around, std::size_t n) {
  const auto begin = around.begin(), middle = begin + static_cast<std::ptrdiff_t>(n / 2);
  std::nth_element(begin, middle, begin + static_cast<std::ptrdiff_t>(n));
  const float upper = std::abs(z - *middle);
  return n % 2 == 1 ? upper : std::max(upper, std::abs(z - *std::max_element(begin, middle)));
}

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
      if (n >= 5 && !std::isnan(z(r, c))) off(r, c) = off_the_median(z(r, c), around, n);
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

/// One pass along a line of n values `stride` apart; nothing beyond its ends.
void convolve_line(const float* in, float* out, std::ptrdiff_t n, std::ptrdiff_t stride,
                   const std::vector<double>& kernel) {
  const auto reach = static_cast<std::ptrdiff_t>(kernel.size()) - 1;  // kernel[0] is the middle
  for (std::ptrdiff_t i = 0; i < n; ++i) {
    double sum = 0.0;
    for (std::ptrdiff_t k = std::max(-reach, -i); k <= std::min(reach, n - 1 - i); ++k)
      sum +=
          kernel[static_cast<std::size_t>(std::abs(k))] * static_cast<double>(in[(i + k) * stride]);
    out[i * stride] = static_cast<float>(sum);
  }
}

Grid<float> both_ways(const Grid<float>& z, const std::vector<double>& kernel) {
  Grid<float> half(z.rows(), z.cols()), out(z.rows(), z.cols());
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, z.rows(), [&](std::ptrdiff_t r) {
    convolve_line(&z(r, 0), &half(r, 0), z.cols(), 1, kernel);
  });
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, z.cols(), [&](std::ptrdiff_t c) {
    convolve_line(&half(0, c), &out(0, c), z.rows(), z.cols(), kernel);
  });
  return out;
}

/// Voids are left out where the rest of the kernel weighs three quarters, both ways together: a
/// single one, as an outlier leaves it, is closed.
Grid<float> convolved(const Grid<float>& z, const std::vector<double>& kernel) {
  if (kernel.size() == 1) return z;
  // Around the mean, or single precision is lost on the sums of heights without their voids.
  double sum = 0.0, n = 0.0;
  for (const float v : z.cells())
    if (!std::isnan(v)) {
      sum += static_cast<double>(v);
      n += 1.0;
    }
  const auto mean = static_cast<float>(n > 0.0 ? sum / n : 0.0);
  Grid<float> height(z.rows(), z.cols(), 0.0F), weight(z.rows(), z.cols(), 0.0F);
  for (std::size_t i = 0; i < z.cells().size(); ++i)
    if (!std::isnan(z.cells()[i])) {
      height.cells()[i] = z.cells()[i] - mean;
      weight.cells()[i] = 1.0F;
    }
  height = both_ways(height, kernel);
  weight = both_ways(weight, kernel);
  for (std::size_t i = 0; i < height.cells().size(); ++i) {
    const float w = weight.cells()[i];
    height.cells()[i] = w >= 0.75F ? mean + height.cells()[i] / w : NAN;
  }
  return height;
}

/// Median of the absolute differences from cell to cell along rows, of a million of them at most.
double usual_step(const Grid<float>& z) {
  std::vector<double> size;
  const std::size_t step = 1 + z.cells().size() / 1'000'000;
  const auto cols = static_cast<std::size_t>(z.cols());
  for (std::size_t i = 1; i < z.cells().size(); i += step)
    if (const float d = z.cells()[i] - z.cells()[i - 1]; i % cols != 0 && !std::isnan(d))
      size.push_back(static_cast<double>(std::abs(d)));
  return median(std::move(size), 0.0);
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

namespace {

/// Lagrange's weights of n points about a place t in [0, 1) beyond the middle one, and their
/// derivatives.
template <std::size_t n>
struct Weights {
  static constexpr double kBefore = static_cast<double>(n / 2 - 1);  ///< points left of the middle
  std::array<double, n> of_height{}, of_slope{};
  explicit Weights(double t) {
    // Products of the distances to all points on the left, and on the right, with derivatives.
    std::array<double, n + 1> left{1.0}, left_slope{}, right{}, right_slope{};
    right[n] = 1.0;
    const auto distance = [t](std::size_t i) { return t + kBefore - static_cast<double>(i); };
    for (std::size_t i = 0; i < n; ++i) {
      left[i + 1] = left[i] * distance(i);
      left_slope[i + 1] = left_slope[i] * distance(i) + left[i];
    }
    for (std::size_t i = n; i-- > 0;) {
      right[i] = right[i + 1] * distance(i);
      right_slope[i] = right_slope[i + 1] * distance(i) + right[i + 1];
    }
    for (std::size_t i = 0; i < n; ++i) {
      of_height[i] = left[i] * right[i + 1] / kScale[i];
      of_slope[i] = (left_slope[i] * right[i + 1] + left[i] * right_slope[i + 1]) / kScale[i];
    }
  }

 private:
  /// Products of each point's distances to all others.
  static constexpr std::array<double, n> kScale = [] {
    std::array<double, n> scale{};
    for (std::size_t i = 0; i < n; ++i) {
      scale[i] = 1.0;
      for (std::size_t j = 0; j < n; ++j)
        if (j != i) scale[i] *= static_cast<double>(i) - static_cast<double>(j);
    }
    return scale;
  }();
};

template <std::size_t n>
std::array<double, 3> height_and_gradient_by(const Grid<float>& z, double x, double y) {
  const double fx = std::floor(x) - Weights<n>::kBefore, fy = std::floor(y) - Weights<n>::kBefore;
  constexpr auto kReach = static_cast<double>(n) - 1.0;
  if (!(fx >= 0.0 && fy >= 0.0 && fx + kReach < static_cast<double>(z.cols()) &&
        fy + kReach < static_cast<double>(z.rows())))
    return {NAN, NAN, NAN};
  const auto c = static_cast<std::ptrdiff_t>(fx), r = static_cast<std::ptrdiff_t>(fy);
  const Weights<n> wx(x - std::floor(x)), wy(y - std::floor(y));
  std::array<double, 3> out{0.0, 0.0, 0.0};
  for (std::size_t j = 0; j < n; ++j) {
    const float* row = &z(r + static_cast<std::ptrdiff_t>(j), c);
    double value = 0.0, slope = 0.0;
    for (std::size_t i = 0; i < n; ++i) {
      value += wx.of_height[i] * static_cast<double>(row[i]);
      slope += wx.of_slope[i] * static_cast<double>(row[i]);
    }
    out[0] += wy.of_height[j] * value;
    out[1] += wy.of_height[j] * slope;
    out[2] += wy.of_slope[j] * value;
  }
  return out;
}

}  // namespace

std::array<double, 3> height_and_gradient(const Grid<float>& z, double x, double y) {
  const auto out = height_and_gradient_by<8>(z, x, y);
  return std::isnan(out[0]) ? height_and_gradient_by<4>(z, x, y) : out;
}

std::array<double, 3> height_and_gradient_at(const Grid<float>& z, std::ptrdiff_t r,
                                             std::ptrdiff_t c) {
  const auto slope = [&](std::ptrdiff_t dr, std::ptrdiff_t dc) {
    const auto off = [&](std::ptrdiff_t k) {
      return z.contains(r + k * dr, c + k * dc) && z.contains(r - k * dr, c - k * dc)
                 ? static_cast<double>(z(r + k * dr, c + k * dc)) -
                       static_cast<double>(z(r - k * dr, c - k * dc))
                 : NAN;
    };
    const double near = off(1), wide = (45.0 * near - 9.0 * off(2) + off(3)) / 60.0;
    return std::isnan(wide) ? 0.5 * near : wide;
  };
  const std::array<double, 3> out{static_cast<double>(z(r, c)), slope(0, 1), slope(1, 0)};
  return std::isnan(out[1] + out[2]) ? std::array<double, 3>{NAN, NAN, NAN} : out;
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
  pair.least_spread_m = std::max(1e-9, 1e-3 * usual_step(pair.lower));
}

void MeanSlope::add(double e, double limit) {
  slope_ += psi_slope(e, limit);
  weight_ += e != 0.0 ? psi(e, limit) / e : 1.0;
  n_ += 1.0;
}
void MeanSlope::add(const MeanSlope& other) {
  slope_ += other.slope_;
  weight_ += other.weight_;
  n_ += other.n_;
}
double MeanSlope::value() const {
  return std::max(slope_, 0.5 * weight_) / std::max(1.0, n_);
}

}  // namespace maquette::heightmap::detail
