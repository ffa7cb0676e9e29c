// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/frame_series.hpp"

#include <cmath>

#include <tbb/parallel_for.h>

#include "core/check.hpp"

namespace maquette::camera {
namespace {

std::size_t plane_of(const FrameSeries& s, std::ptrdiff_t row, std::ptrdiff_t col) {
  return s.planes == 1 ? 0U : static_cast<std::size_t>(2 * (row & 1) + (col & 1));
}

/// What one row of a frame adds to the sums.
struct RowSums {
  std::array<double, 2> sum{};
  std::size_t zero = 0;
  std::array<std::size_t, 2> most{};
};

/// Mean and its standard error from the scatter of the values.
Measured mean_of(const std::vector<double>& values) {
  const auto n = static_cast<double>(values.size());
  double sum = 0.0, square = 0.0;
  for (const double v : values) sum += v;
  const double mean = sum / n;
  for (const double v : values) square += (v - mean) * (v - mean);
  return {mean, std::sqrt(square / (n * std::max(1.0, n - 1.0)))};
}

}  // namespace

void add_frame(FrameSeries& s, const Grid<float>& frame, double largest_dn) {
  const std::ptrdiff_t rows = frame.rows(), cols = frame.cols();
  const std::size_t parities = s.planes == 1 ? 1 : 2;
  const auto planes = static_cast<std::size_t>(s.planes);
  if (s.frames == 0) {
    s.mean_dn = Grid<float>(rows, cols);
    s.square_sum_dn2 = Grid<float>(rows, cols);
    s.at_most.assign(planes, 0);
  }
  MAQUETTE_CHECK(s.mean_dn.rows() == rows && s.mean_dn.cols() == cols, "{} x {} pixels in a series",
                 cols, rows);
  const auto most = static_cast<float>(largest_dn - 0.5);
  std::vector<RowSums> sums(static_cast<std::size_t>(rows));
  tbb::parallel_for(std::ptrdiff_t{0}, rows, [&](std::ptrdiff_t r) {
    RowSums& to = sums[static_cast<std::size_t>(r)];
    const auto row = frame.row(r);
    for (std::size_t c = 0; c < row.size(); ++c) {
      const std::size_t parity = c % parities;
      to.sum[parity] += static_cast<double>(row[c]);
      to.zero += row[c] <= 0.5F ? 1U : 0U;
      to.most[parity] += row[c] >= most ? 1U : 0U;
    }
  });
  // In order, so that the sums are the same for any number of threads.
  std::vector<double> mean(planes, 0.0);
  std::vector<std::size_t> count(planes, 0);
  for (std::ptrdiff_t r = 0; r < rows; ++r)
    for (std::size_t p = 0; p < parities; ++p) {
      const std::size_t plane = plane_of(s, r, static_cast<std::ptrdiff_t>(p));
      const RowSums& from = sums[static_cast<std::size_t>(r)];
      mean[plane] += from.sum[p];
      s.at_most[plane] += from.most[p];
      count[plane] += (static_cast<std::size_t>(cols) + parities - 1 - p) / parities;
      if (p == 0) s.at_zero += from.zero;
    }
  for (std::size_t k = 0; k < planes; ++k) {
    mean[k] /= static_cast<double>(count[k]);
    s.frame_mean_dn.push_back(mean[k]);
  }
  ++s.frames;
  const float share = 1.0F / static_cast<float>(s.frames);
  tbb::parallel_for(std::ptrdiff_t{0}, rows, [&](std::ptrdiff_t r) {
    const auto row = frame.row(r);
    const auto mean_row = s.mean_dn.row(r), square = s.square_sum_dn2.row(r);
    std::array<float, 2> shift{};
    for (std::size_t p = 0; p < parities; ++p) {
      const std::size_t k = plane_of(s, r, static_cast<std::ptrdiff_t>(p));
      shift[p] = static_cast<float>(mean[k] - s.frame_mean_dn[k]);  // over the first frame's
    }
    for (std::size_t c = 0; c < row.size(); ++c) {
      const float v = row[c] - shift[c % parities];
      const float d = v - mean_row[c];
      mean_row[c] += share * d;
      square[c] += d * (v - mean_row[c]);
    }
  });
  for (std::ptrdiff_t r = 0; r < rows; ++r)
    for (std::size_t p = 0; p < parities; ++p) {
      const std::size_t k = plane_of(s, r, static_cast<std::ptrdiff_t>(p));
      const auto n = (static_cast<std::size_t>(cols) + parities - 1 - p) / parities;
      s.row_mean_dn.push_back(sums[static_cast<std::size_t>(r)].sum[p] / static_cast<double>(n) -
                              (mean[k] - s.frame_mean_dn[k]));
    }
}

LevelStatistics statistics_of(const FrameSeries& s, int plane) {
  MAQUETTE_CHECK(s.frames >= 2, "{} frames", s.frames);
  LevelStatistics out;
  out.exposure_s = s.exposure_s, out.frames = s.frames, out.plane = plane;
  const std::size_t parities = s.planes == 1 ? 1 : 2, planes = static_cast<std::size_t>(s.planes);
  const std::ptrdiff_t rows = s.mean_dn.rows(), cols = s.mean_dn.cols();
  const bool all = plane < 0 || s.planes == 1;
  const std::ptrdiff_t first_row = all ? 0 : plane / 2, row_step = all ? 1 : 2;
  const std::ptrdiff_t first_col = all ? 0 : plane % 2, col_step = all ? 1 : 2;
  const double frames = s.frames;

  std::vector<double> variance, row_variance;
  for (std::ptrdiff_t r = first_row; r < rows; r += row_step) {
    double sum = 0.0;
    std::size_t n = 0;
    for (std::ptrdiff_t c = first_col; c < cols; c += col_step, ++n)
      sum += static_cast<double>(s.square_sum_dn2(r, c));
    out.pixels += n;
    // Alignment takes one degree of freedom a frame, of the whole picture.
    variance.push_back(sum / (static_cast<double>(n) * (frames - 1.0)));
    const auto row_mean = [&](int frame) {
      const auto at = [&](std::size_t p) {
        return s.row_mean_dn[(static_cast<std::size_t>(frame) * static_cast<std::size_t>(rows) +
                              static_cast<std::size_t>(r)) *
                                 parities +
                             p];
      };
      if (!all) return at(static_cast<std::size_t>(first_col));
      return parities == 1 ? at(0) : 0.5 * (at(0) + at(1));
    };
    double mean = 0.0, square = 0.0;
    for (int f = 0; f < s.frames; ++f) mean += row_mean(f) / frames;
    for (int f = 0; f < s.frames; ++f) square += (row_mean(f) - mean) * (row_mean(f) - mean);
    row_variance.push_back(square / (frames - 1.0));
  }
  const auto lines = static_cast<double>(variance.size());
  const double across = static_cast<double>(out.pixels) / lines;
  out.variance_dn2 = mean_of(variance);
  const Measured of_row_means = mean_of(row_variance);
  // The mean of a row's n pixels scatters by what they share, and by 1/n of what each has alone.
  const double share = 1.0 / across;
  out.row_variance_dn2 = {(of_row_means.value - out.variance_dn2.value * share) / (1.0 - share),
                          of_row_means.u / (1.0 - share)};
  double sum = 0.0;
  std::size_t count = 0, most = 0;
  for (std::size_t k = 0; k < planes; ++k) {
    if (!all && static_cast<int>(k) != plane) continue;
    for (int f = 0; f < s.frames; ++f, ++count)
      sum += s.frame_mean_dn[static_cast<std::size_t>(f) * planes + k];
    most += s.at_most[k];
  }
  out.mean_dn = {sum / static_cast<double>(count),
                 std::sqrt(of_row_means.value / (lines * frames))};
  const double values = static_cast<double>(out.pixels) * frames;
  out.share_at_most = static_cast<double>(most) / values;
  out.share_at_zero = static_cast<double>(s.at_zero) /
                      (static_cast<double>(rows) * static_cast<double>(cols) * frames);
  return out;
}

}  // namespace maquette::camera
