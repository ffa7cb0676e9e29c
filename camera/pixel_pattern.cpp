// SPDX-License-Identifier: GPL-3.0-or-later

// dark_pattern and response_pattern of photon_transfer.hpp.

#include <algorithm>
#include <cmath>

#include "camera/photon_transfer.hpp"
#include "core/check.hpp"

namespace maquette::camera {
namespace {

constexpr int kDegree = 6;         ///< of the smooth surface that is not the sensor's
constexpr double kHotSigma = 6.0;  ///< 2e-9 of a normal distribution

/// Orthonormal polynomials of degree 0 to kDegree on n equidistant places.
std::vector<std::vector<double>> polynomials(std::size_t n) {
  std::vector<std::vector<double>> p;
  for (int degree = 0; degree <= kDegree && static_cast<std::size_t>(degree) < n; ++degree) {
    std::vector<double> v(n);
    for (std::size_t i = 0; i < n; ++i) {
      const double x = (2.0 * static_cast<double>(i) + 1.0) / static_cast<double>(n) - 1.0;
      v[i] = degree == 0 ? 1.0 : x * p.back()[i];
    }
    for (int twice = 0; twice < 2; ++twice)  // Gram and Schmidt; once more against rounding
      for (const auto& q : p) {
        double dot = 0.0;
        for (std::size_t i = 0; i < n; ++i) dot += q[i] * v[i];
        for (std::size_t i = 0; i < n; ++i) v[i] -= dot * q[i];
      }
    double norm = 0.0;
    for (const double a : v) norm += a * a;
    for (double& a : v) a /= std::sqrt(norm);
    p.push_back(std::move(v));
  }
  return p;
}

/// The polynomial of total degree kDegree that fits best.
Grid<double> smooth(const Grid<double>& g) {
  const auto px = polynomials(static_cast<std::size_t>(g.cols()));
  const auto py = polynomials(static_cast<std::size_t>(g.rows()));
  std::vector<std::vector<double>> weight(py.size(), std::vector<double>(px.size(), 0.0));
  for (std::ptrdiff_t r = 0; r < g.rows(); ++r)
    for (std::size_t i = 0; i < px.size(); ++i) {
      double dot = 0.0;
      const auto row = g.row(r);
      for (std::size_t c = 0; c < row.size(); ++c) dot += px[i][c] * row[c];
      for (std::size_t j = 0; i + j <= kDegree && j < py.size(); ++j)
        weight[j][i] += dot * py[j][static_cast<std::size_t>(r)];
    }
  Grid<double> out(g.rows(), g.cols());
  for (std::ptrdiff_t r = 0; r < g.rows(); ++r)
    for (std::size_t i = 0; i < px.size(); ++i) {
      double along = 0.0;
      for (std::size_t j = 0; j < py.size(); ++j)
        along += weight[j][i] * py[j][static_cast<std::size_t>(r)];
      const auto row = out.row(r);
      for (std::size_t c = 0; c < row.size(); ++c) row[c] += along * px[i][c];
    }
  return out;
}

constexpr int kTerms = (kDegree + 1) * (kDegree + 2) / 2;

double median(std::vector<double>& v) {
  const auto middle = v.begin() + static_cast<std::ptrdiff_t>(v.size() / 2);
  std::nth_element(v.begin(), middle, v.end());
  return *middle;
}

/// Root of a variance and its uncertainty.
Measured root_of(double variance, double u) {
  const double root = std::sqrt(std::max(0.0, variance));
  return {root, root * root > u ? 0.5 * u / root : std::sqrt(0.5 * u)};
}

/// Sets hot pixels to the median and counts them.
void take_out_hot(Grid<double>& map, DarkPattern& out) {
  std::vector<double> values(map.cells().begin(), map.cells().end());
  const double middle = median(values);
  for (double& v : values) v = std::abs(v - middle);
  const double limit = kHotSigma * 1.4826 * median(values);
  double beyond = 0.0;
  for (double& v : map.cells()) {
    if (!(limit > 0.0) || v - middle <= limit) continue;
    beyond += v - middle - limit;
    ++out.hot_found;
    v = middle;
  }
  if (out.hot_found == 0) return;
  // An exponential distribution has no memory: beyond the limit it has the mean that it has from 0.
  out.hot_mean_dn = beyond / static_cast<double>(out.hot_found);
  out.hot_share = static_cast<double>(out.hot_found) / static_cast<double>(map.cells().size()) *
                  std::exp(limit / out.hot_mean_dn);
}

}  // namespace

DarkPattern dark_pattern(const FrameSeries& dark) {
  MAQUETTE_CHECK(dark.planes == 1 && dark.frames >= 2, "{} planes, {} frames", dark.planes,
                 dark.frames);
  DarkPattern out;
  const std::ptrdiff_t rows = dark.mean_dn.rows(), cols = dark.mean_dn.cols();
  Grid<double> map(rows, cols);
  for (std::size_t i = 0; i < map.cells().size(); ++i)
    map.cells()[i] = static_cast<double>(dark.mean_dn.cells()[i]);
  take_out_hot(map, out);
  const Grid<double> trend = smooth(map);
  std::vector<double> row_mean(static_cast<std::size_t>(rows), 0.0),
      col_mean(static_cast<std::size_t>(cols), 0.0);
  for (std::ptrdiff_t r = 0; r < rows; ++r)
    for (std::ptrdiff_t c = 0; c < cols; ++c) {
      const double v = map(r, c) -= trend(r, c);
      row_mean[static_cast<std::size_t>(r)] += v / static_cast<double>(cols);
      col_mean[static_cast<std::size_t>(c)] += v / static_cast<double>(rows);
    }
  double sum = 0.0, square = 0.0;
  for (std::ptrdiff_t r = 0; r < rows; ++r)
    for (std::ptrdiff_t c = 0; c < cols; ++c) {
      const double e =
          map(r, c) - row_mean[static_cast<std::size_t>(r)] - col_mean[static_cast<std::size_t>(c)];
      sum += e * e, square += e * e * e * e;
    }
  const LevelStatistics time = statistics_of(dark, -1);
  const double n = static_cast<double>(map.cells().size()), frames = dark.frames;
  const double inside = static_cast<double>((rows - 1) * (cols - 1)) - kTerms;
  const double raw = sum / inside;  // pixels' own, and what is left of their noise in time
  const double in_time = (time.variance_dn2.value - time.row_variance_dn2.value) / frames;
  const double u_raw = std::sqrt(std::max(0.0, square / n - (sum / n) * (sum / n)) / n);
  const double pixel = raw - in_time, u_pixel = std::hypot(u_raw, time.variance_dn2.u / frames);
  const auto variance_of = [](const std::vector<double>& means) {
    double s = 0.0;
    for (const double v : means) s += v * v;
    return s / (static_cast<double>(means.size()) - 1.0 - kDegree);
  };
  const auto lines = [](double count) { return std::sqrt(2.0 / (count - 1.0)); };
  const double of_columns = variance_of(col_mean), of_rows = variance_of(row_mean);
  const double column = of_columns - raw / static_cast<double>(rows);
  const double row =
      of_rows - raw / static_cast<double>(cols) - time.row_variance_dn2.value / frames;
  const double u_column = of_columns * lines(static_cast<double>(cols));
  const double u_row =
      std::hypot(of_rows * lines(static_cast<double>(rows)), time.row_variance_dn2.u / frames);
  out.pixel_dn = root_of(pixel, u_pixel);
  out.column_dn = root_of(column, u_column);
  out.row_dn = root_of(row, u_row);
  out.dsnu_dn = root_of(std::max(0.0, pixel) + std::max(0.0, column) + std::max(0.0, row),
                        std::hypot(u_pixel, u_column, u_row));
  return out;
}

Measured response_pattern(const FrameSeries& bright, const FrameSeries& dark) {
  MAQUETTE_CHECK(bright.frames >= 2 && dark.frames >= 2 && dark.planes == 1 &&
                     bright.mean_dn.rows() == dark.mean_dn.rows() &&
                     bright.mean_dn.cols() == dark.mean_dn.cols(),
                 "bright and dark frames of one size are needed");
  double weighted = 0.0, weight = 0.0;
  const std::ptrdiff_t step = bright.planes == 1 ? 1 : 2;
  for (int plane = 0; plane < bright.planes; ++plane) {
    const std::ptrdiff_t first_row = plane / 2, first_col = plane % 2;
    const std::ptrdiff_t rows = (bright.mean_dn.rows() - first_row + step - 1) / step;
    const std::ptrdiff_t cols = (bright.mean_dn.cols() - first_col + step - 1) / step;
    Grid<double> signal(rows, cols);
    const auto at = [&](const Grid<float>& g, std::ptrdiff_t r, std::ptrdiff_t c) {
      return static_cast<double>(g(first_row + step * r, first_col + step * c));
    };
    for (std::ptrdiff_t r = 0; r < rows; ++r)
      for (std::ptrdiff_t c = 0; c < cols; ++c)
        signal(r, c) = at(bright.mean_dn, r, c) - at(dark.mean_dn, r, c);
    const Grid<double> trend = smooth(signal);
    double sum = 0.0, square = 0.0, in_time = 0.0;
    for (std::ptrdiff_t r = 0; r < rows; ++r)
      for (std::ptrdiff_t c = 0; c < cols; ++c) {
        const double light = std::max(trend(r, c), 1e-9);
        const double e = signal(r, c) / light - 1.0;
        sum += e * e, square += e * e * e * e;
        // Noise in time that the means of the frames have left.
        in_time += (at(bright.square_sum_dn2, r, c) / (bright.frames * (bright.frames - 1.0)) +
                    at(dark.square_sum_dn2, r, c) / (dark.frames * (dark.frames - 1.0))) /
                   (light * light);
      }
    const double n = static_cast<double>(rows * cols);
    const double variance = sum / (n - kTerms) - in_time / n;
    // Noise in time is known as well as the scatter of n (frames - 1) squares.
    const double u = std::hypot(std::sqrt(std::max(0.0, square / n - (sum / n) * (sum / n)) / n),
                                in_time / n * std::sqrt(2.0 / (n * (bright.frames - 1.0))));
    weighted += variance / (u * u), weight += 1.0 / (u * u);
  }
  return root_of(weighted / weight, 1.0 / std::sqrt(weight));
}

}  // namespace maquette::camera
