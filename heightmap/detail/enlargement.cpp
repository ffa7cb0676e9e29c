// SPDX-License-Identifier: GPL-3.0-or-later
#include "heightmap/detail/enlargement.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include <oneapi/tbb/parallel_for.h>
#include <Eigen/SparseCore>
#include <Eigen/SparseLU>

#include "core/check.hpp"

namespace maquette::heightmap::detail {
namespace {

constexpr double kRounding = 1e-6;  // of a node, where cells just meet

/// Weights of some values in a row, from `first` on.
struct Weights {
  std::ptrdiff_t first = 0;
  std::vector<double> of;
};

/// One direction: which wide nodes have their cells within, and their means over fine nodes.
struct Axis {
  std::ptrdiff_t first = 0;      ///< of these wide nodes
  std::vector<Weights> mean;     ///< of each
  std::vector<Weights> between;  ///< of each fine node: cubic interpolation of these wide nodes
};

std::vector<double> keys(double t) {
  const double s = 1.0 - t;
  return {-0.5 * t * s * s, 1.0 + t * t * (1.5 * t - 2.5), 1.0 + s * s * (1.5 * s - 2.5),
          -0.5 * s * t * t};
}

/// `start`: place of the first wide node in fine nodes from the first of them; `step` likewise.
Axis axis_of(double start, double step, std::ptrdiff_t wide, std::ptrdiff_t fine) {
  Axis axis;
  const auto end = static_cast<double>(fine) - 0.5;
  for (std::ptrdiff_t i = 0; i < wide; ++i) {
    const double low = start + step * (static_cast<double>(i) - 0.5), high = low + step;
    if (low < -0.5 - kRounding || high > end + kRounding) continue;
    if (axis.mean.empty()) axis.first = i;
    Weights w;
    w.first = std::max<std::ptrdiff_t>(0, std::lround(std::floor(low + 0.5 + kRounding)));
    for (std::ptrdiff_t k = w.first; k < fine; ++k) {
      const auto node = static_cast<double>(k);
      const double part = std::min(high, node + 0.5) - std::max(low, node - 0.5);
      if (part <= kRounding) break;
      w.of.push_back(part / step);
    }
    axis.mean.push_back(std::move(w));
  }
  const auto last = static_cast<std::ptrdiff_t>(axis.mean.size()) - 1;
  for (std::ptrdiff_t k = 0; k < fine && last >= 0; ++k) {
    const double at =
        std::clamp((static_cast<double>(k) - start) / step - static_cast<double>(axis.first), 0.0,
                   static_cast<double>(last));
    const auto cell =
        std::min(static_cast<std::ptrdiff_t>(at), std::max<std::ptrdiff_t>(0, last - 1));
    const std::vector<double> four = keys(at - static_cast<double>(cell));
    Weights w;
    w.first = std::max<std::ptrdiff_t>(0, cell - 1);
    w.of.assign(static_cast<std::size_t>(std::min(last, cell + 2) - w.first + 1), 0.0);
    for (std::ptrdiff_t j = 0; j < 4; ++j)  // beyond the last node it goes on level
      w.of[static_cast<std::size_t>(std::clamp<std::ptrdiff_t>(cell - 1 + j, 0, last) - w.first)] +=
          four[static_cast<std::size_t>(j)];
    axis.between.push_back(std::move(w));
  }
  return axis;
}

struct Axes {
  Axis along_x, along_y;
  [[nodiscard]] bool empty() const { return along_x.mean.empty() || along_y.mean.empty(); }
};

Axes axes_of(const NodeGrid& fine, const NodeGrid& wide) {
  const double step = wide.spacing_m / fine.spacing_m;
  MAQUETTE_CHECK(step >= 1.0, "nodes every {} m enlarge nodes every {} m", fine.spacing_m,
                 wide.spacing_m);
  return {axis_of((wide.x0_m - fine.x0_m) / fine.spacing_m, step, wide.cols, fine.cols),
          axis_of((wide.y0_m - fine.y0_m) / fine.spacing_m, step, wide.rows, fine.rows)};
}

/// Wide less the mean of fine, for the wide nodes of the axes.
Eigen::MatrixXd missing(const Grid<float>& fine_m, const Grid<float>& wide_m, const Axes& axes) {
  const Axis &x = axes.along_x, &y = axes.along_y;
  Eigen::MatrixXd out(static_cast<Eigen::Index>(y.mean.size()),
                      static_cast<Eigen::Index>(x.mean.size()));
  oneapi::tbb::parallel_for(std::size_t{0}, y.mean.size(), [&](std::size_t i) {
    // Less one height of the row: heights of kilometres keep their last digits.
    const std::ptrdiff_t row = y.first + static_cast<std::ptrdiff_t>(i);
    const auto level = static_cast<double>(wide_m(row, x.first));
    std::vector<double> line(static_cast<std::size_t>(fine_m.cols()), 0.0);
    for (std::size_t k = 0; k < y.mean[i].of.size(); ++k) {
      const auto from = fine_m.row(y.mean[i].first + static_cast<std::ptrdiff_t>(k));
      for (std::size_t c = 0; c < line.size(); ++c)
        line[c] += y.mean[i].of[k] * (static_cast<double>(from[c]) - level);
    }
    for (std::size_t j = 0; j < x.mean.size(); ++j) {
      const Weights& w = x.mean[j];
      double mean = 0.0;
      for (std::size_t k = 0; k < w.of.size(); ++k)
        mean += w.of[k] * line[static_cast<std::size_t>(w.first) + k];
      out(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j)) =
          static_cast<double>(wide_m(row, x.first + static_cast<std::ptrdiff_t>(j))) - level - mean;
    }
  });
  return out;
}

/// Means over wide cells of what interpolation makes of values at wide nodes.
Eigen::SparseMatrix<double> mean_of_between(const Axis& axis) {
  std::vector<Eigen::Triplet<double>> entries;
  for (std::size_t i = 0; i < axis.mean.size(); ++i)
    for (std::size_t k = 0; k < axis.mean[i].of.size(); ++k) {
      const Weights& b = axis.between[static_cast<std::size_t>(axis.mean[i].first) + k];
      for (std::size_t j = 0; j < b.of.size(); ++j)
        entries.emplace_back(static_cast<int>(i),
                             static_cast<int>(b.first + static_cast<std::ptrdiff_t>(j)),
                             axis.mean[i].of[k] * b.of[j]);
    }
  const auto n = static_cast<Eigen::Index>(axis.mean.size());
  Eigen::SparseMatrix<double> out(n, n);
  out.setFromTriplets(entries.begin(), entries.end());
  return out;
}

Eigen::MatrixXd solved(const Axis& axis, const Eigen::MatrixXd& right) {
  const Eigen::SparseLU<Eigen::SparseMatrix<double>> lu(mean_of_between(axis));
  MAQUETTE_CHECK(lu.info() == Eigen::Success, "means of {} nodes do not tell their heights",
                 axis.mean.size());
  return lu.solve(right);
}

}  // namespace

double farthest_mean(const Grid<float>& fine_m, const NodeGrid& fine, const Grid<float>& wide_m,
                     const NodeGrid& wide) {
  const Axes axes = axes_of(fine, wide);
  if (axes.empty()) return 0.0;
  return missing(fine_m, wide_m, axes).cwiseAbs().maxCoeff<Eigen::PropagateNaN>();
}

void match_means(Grid<float>& fine_m, const NodeGrid& fine, const Grid<float>& wide_m,
                 const NodeGrid& wide) {
  const Axes axes = axes_of(fine, wide);
  if (axes.empty()) return;
  const Eigen::MatrixXd rows = solved(axes.along_y, missing(fine_m, wide_m, axes));
  // Row-wise from here on: the inner loop runs along x.
  const Eigen::MatrixXd by_column = solved(axes.along_x, rows.transpose());  // [x][y]
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, fine_m.rows(), [&](std::ptrdiff_t r) {
    const Weights& wy = axes.along_y.between[static_cast<std::size_t>(r)];
    Eigen::VectorXd line = Eigen::VectorXd::Zero(by_column.rows());
    for (std::size_t k = 0; k < wy.of.size(); ++k)
      line += wy.of[k] * by_column.col(wy.first + static_cast<Eigen::Index>(k));
    const auto to = fine_m.row(r);
    for (std::size_t c = 0; c < to.size(); ++c) {
      const Weights& wx = axes.along_x.between[c];
      double sum = 0.0;
      for (std::size_t k = 0; k < wx.of.size(); ++k)
        sum += wx.of[k] * line[wx.first + static_cast<Eigen::Index>(k)];
      to[c] = static_cast<float>(static_cast<double>(to[c]) + sum);
    }
  });
}

}  // namespace maquette::heightmap::detail
