// SPDX-License-Identifier: GPL-3.0-or-later
#include "heightmap/detail/coregister.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include <oneapi/tbb/parallel_for.h>
#include "core/median.hpp"

namespace maquette::heightmap::detail {
namespace {

constexpr int kCellsPerPixel = 3;  // of the coarser surface, along each axis
constexpr double kLeastCorrelation = 0.5;

struct Spread {
  double median = 0.0, nmad = 0.0;
};

Spread spread_of(std::vector<double> values) {
  Spread s;
  s.median = median(values);
  s.nmad = nmad(std::move(values));
  return s;
}

/// Means of m x m nodes; void if more than half of them are. Nodes left over at the
/// upper and right edge are dropped.
Grid<float> block_means(const Grid<float>& z, std::ptrdiff_t m) {
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

/// Mean of 3 x 3 cells: the finer surface as the coarser pixel would have seen it.
Grid<float> mean_of_nine(const Grid<float>& z) {
  Grid<float> out(z.rows(), z.cols(), NAN);
  for (std::ptrdiff_t r = 1; r + 1 < z.rows(); ++r)
    for (std::ptrdiff_t c = 1; c + 1 < z.cols(); ++c) {
      double sum = 0.0;
      for (std::ptrdiff_t i = -1; i <= 1; ++i)
        for (std::ptrdiff_t j = -1; j <= 1; ++j) sum += static_cast<double>(z(r + i, c + j));
      out(r, c) = static_cast<float>(sum / 9.0);
    }
  return out;
}

/// Cubic convolution in cell units with its gradient; NaN if any of the 16 is missing.
std::array<double, 3> height_and_gradient(const Grid<float>& z, double x, double y) {
  const double fx = std::floor(x), fy = std::floor(y);
  const auto c = static_cast<std::ptrdiff_t>(fx), r = static_cast<std::ptrdiff_t>(fy);
  if (!(fx >= 1.0 && fy >= 1.0) || c + 2 >= z.cols() || r + 2 >= z.rows()) return {NAN, NAN, NAN};
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
  for (std::size_t j = 0; j < 4; ++j)
    for (std::size_t i = 0; i < 4; ++i) {
      const auto h = static_cast<double>(
          z(r - 1 + static_cast<std::ptrdiff_t>(j), c - 1 + static_cast<std::ptrdiff_t>(i)));
      out[0] += wy[j] * wx[i] * h;
      out[1] += wy[j] * gx[i] * h;
      out[2] += gy[j] * wx[i] * h;
    }
  return out;
}

struct Sample {
  double difference, slope_x, slope_y;
};

std::vector<Sample> compare(const Grid<float>& lower, const Grid<float>& upper, double dx,
                            double dy) {
  std::vector<Sample> out;
  for (std::ptrdiff_t r = 0; r < lower.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < lower.cols(); ++c) {
      const auto h = static_cast<double>(lower(r, c));
      if (std::isnan(h)) continue;
      const auto [u, gx, gy] =
          height_and_gradient(upper, static_cast<double>(c) + dx, static_cast<double>(r) + dy);
      if (!std::isnan(u)) out.push_back({h - u, gx, gy});
    }
  return out;
}

Spread spread_of(const std::vector<Sample>& samples) {
  std::vector<double> d(samples.size());
  std::transform(samples.begin(), samples.end(), d.begin(),
                 [](const Sample& s) { return s.difference; });
  return spread_of(std::move(d));
}

/// Correlation of the slopes of both. Noise has slopes too, but shares them with nobody.
double slope_correlation(const Grid<float>& lower, const Grid<float>& upper, double dx, double dy) {
  double ll = 0.0, uu = 0.0, lu = 0.0;
  for (std::ptrdiff_t r = 1; r + 1 < lower.rows(); ++r)
    for (std::ptrdiff_t c = 1; c + 1 < lower.cols(); ++c) {
      // The same central difference of both: at whole shifts they weigh noise alike.
      const auto at = [&](std::ptrdiff_t dr, std::ptrdiff_t dc) {
        return height_and_gradient(upper, static_cast<double>(c + dc) + dx,
                                   static_cast<double>(r + dr) + dy)[0];
      };
      const double lx = static_cast<double>(lower(r, c + 1)) - static_cast<double>(lower(r, c - 1));
      const double ly = static_cast<double>(lower(r + 1, c)) - static_cast<double>(lower(r - 1, c));
      const double ux = at(0, 1) - at(0, -1), uy = at(1, 0) - at(-1, 0);
      if (std::isnan(lx + ly + ux + uy)) continue;
      ll += lx * lx + ly * ly;
      uu += ux * ux + uy * uy;
      lu += lx * ux + ly * uy;
    }
  return ll > 0.0 && uu > 0.0 ? lu / std::sqrt(ll * uu) : 0.0;
}

struct Step {
  double dx = 0.0, dy = 0.0;
  double sigma_x = INFINITY, sigma_y = INFINITY;  ///< standard errors, cells
};

/// Slopes about their mean: the constant drops out of the normal equations.
Step solve(const std::vector<Sample>& samples, const Spread& spread) {
  const double limit = 3.0 * spread.nmad;
  double n = 0.0, mx = 0.0, my = 0.0, md = 0.0;
  const auto kept = [&](const Sample& s) {
    return std::abs(s.difference - spread.median) <= limit;
  };
  for (const Sample& s : samples)
    if (kept(s)) {
      n += 1.0;
      mx += s.slope_x;
      my += s.slope_y;
      md += s.difference;
    }
  if (n < 3.0) return {};
  mx /= n;
  my /= n;
  md /= n;
  double xx = 0.0, xy = 0.0, yy = 0.0, xd = 0.0, yd = 0.0;
  for (const Sample& s : samples)
    if (kept(s)) {
      const double x = s.slope_x - mx, y = s.slope_y - my, d = s.difference - md;
      xx += x * x;
      xy += x * y;
      yy += y * y;
      xd += x * d;
      yd += y * d;
    }
  const double det = xx * yy - xy * xy;
  if (!(det > 1e-12 * xx * yy) || !(det > 0.0)) return {};
  Step step;
  step.dx = (yy * xd - xy * yd) / det;
  step.dy = (xx * yd - xy * xd) / det;
  step.sigma_x = spread.nmad * std::sqrt(yy / det);
  step.sigma_y = spread.nmad * std::sqrt(xx / det);
  return step;
}

}  // namespace

std::optional<Coregistration> coregister(const Grid<float>& lower, const Grid<float>& upper,
                                         double spacing_m, double coarse_pixel_m) {
  const double cell_wanted = coarse_pixel_m / kCellsPerPixel / spacing_m;
  const auto smallest_side = static_cast<double>(std::min(lower.rows(), lower.cols()));
  const auto m = static_cast<std::ptrdiff_t>(
      std::max(1.0, std::round(std::min(cell_wanted, smallest_side / 16.0))));
  const double cell_m = static_cast<double>(m) * spacing_m;
  const bool resolved = cell_wanted <= smallest_side / 16.0;
  const Grid<float> low = block_means(lower, m);
  Grid<float> high = block_means(upper, m);

  Coregistration result;
  std::vector<double> differences;
  for (std::size_t i = 0; i < low.cells().size(); ++i)
    if (!std::isnan(low.cells()[i]) && !std::isnan(high.cells()[i]))
      differences.push_back(static_cast<double>(low.cells()[i]) -
                            static_cast<double>(high.cells()[i]));
  if (differences.empty()) return std::nullopt;
  const Spread raw = spread_of(std::move(differences));
  result.up_m = raw.median;
  result.nmad_before_m = result.nmad_after_m = raw.nmad;
  if (!resolved) return result;

  if (cell_wanted >= 0.5) high = mean_of_nine(high);
  double dx = 0.0, dy = 0.0;
  Step step;
  const std::vector<Sample> first = compare(low, high, 0.0, 0.0);
  // Cells of one coarse pixel are not independent of each other.
  const double per_pixel = std::max(1.0, std::pow(coarse_pixel_m / cell_m, 2.0));
  if (static_cast<double>(first.size()) < 30.0 * per_pixel) return result;
  const Spread before = spread_of(first);
  std::vector<Sample> samples = first;
  Spread spread = before;
  const double farthest = smallest_side / static_cast<double>(m) / 4.0;
  bool settled = false;
  for (int i = 0; i < 30 && !settled; ++i) {
    step = solve(samples, spread);
    if (!std::isfinite(step.sigma_x)) return result;
    dx += step.dx;
    dy += step.dy;
    if (std::hypot(dx, dy) > farthest) return result;
    samples = compare(low, high, dx, dy);
    if (static_cast<double>(samples.size()) < 30.0 * per_pixel) return result;
    spread = spread_of(samples);
    settled = std::hypot(step.dx, step.dy) < 1e-3;
  }
  const double sigma_m = std::max(step.sigma_x, step.sigma_y) * std::sqrt(per_pixel) * cell_m;
  const double shift_m = std::hypot(dx, dy) * cell_m;
  // Known to a tenth of a pixel, larger than its own error, of use, and from shared relief.
  if (!settled || sigma_m > 0.1 * coarse_pixel_m || shift_m < 3.0 * sigma_m ||
      spread.nmad > before.nmad || slope_correlation(low, high, dx, dy) < kLeastCorrelation)
    return result;
  result.horizontal = true;
  result.east_m = -dx * cell_m;
  result.north_m = -dy * cell_m;
  result.up_m = spread.median;
  result.nmad_before_m = before.nmad;
  result.nmad_after_m = spread.nmad;
  return result;
}

}  // namespace maquette::heightmap::detail
