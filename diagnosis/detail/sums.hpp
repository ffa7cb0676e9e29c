// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

// Normal equations of all candidate columns at once, split by scale and by set of blocks, so that
// any model (any choice of columns) costs a small solve.
//
// Scales. Squares of four sizes halve into each other (cell, cell / 2, / 4, / 8). What is summed at
// one scale is the scatter of the means of a square's quarters about the square's mean (Haar
// details), of points within the smallest squares at the finest. Details of different scales
// of correlated noise are nearly uncorrelated, and each scale has a variance of its own, which the
// residuals give: rough coats make the coarser ones larger. The means of the cells
// themselves have a dense covariance: white + a stationary process (theta), of the part or of
// each set-up.
//
// Sets. Blocks of cells in plan are drawn by the seed for choosing, confirming, reporting;
// points within `buffer` of a border between blocks count for none.

#include <array>
#include <string>
#include <unordered_map>
#include <vector>

#include <Eigen/Dense>

#include "diagnosis/effect.hpp"
#include "diagnosis/observation.hpp"

namespace maquette::diagnosis::detail {

inline constexpr int kScales = 4;  // three of details of squares, one of points
enum Set : int { kChoose = 0, kConfirm = 1, kReport = 2, kSets = 3 };

/// Smooth noise of the cell means, relative to the white part.
struct Theta {
  bool gauss = false;  ///< else exponential correlation
  double length_mm = 0.0;
  double ratio = 0.0;       ///< variance over that of the white part of a mean cell; 0: white
  bool per_set_up = false;  ///< else of the part, the same in all set-ups
};
[[nodiscard]] std::vector<Theta> thetas(double cell_mm);

struct Layout {
  double x0 = 0.0, y0 = 0.0, cell_mm = 8.0;
  std::ptrdiff_t rows = 0, cols = 0, block = 4;  ///< cells; cells of a block's side
  double buffer_mm = 1.0;
  std::vector<int> set_of_block;
  std::ptrdiff_t block_cols = 0;
  /// -1: in a buffer.
  [[nodiscard]] int set_of(double x, double y) const;
  [[nodiscard]] int block_of(double x, double y) const;
};
[[nodiscard]] Layout lay_out(const Box3& box, std::uint64_t seed);

struct SetSums {
  std::array<Eigen::MatrixXd, kScales> gram;  ///< columns, the residual last
  std::array<double, kScales> count{};        ///< degrees of freedom
  Eigen::MatrixXd rows;                       ///< of cell means
  std::vector<double> weight;                 ///< points of each
  std::vector<Vec3> centre;
  std::vector<std::uint32_t> set_up;
  std::vector<Eigen::MatrixXd> top;  ///< by theta
  std::vector<double> log_det;
};

struct Bank {
  std::vector<Column> columns;  ///< nuisances first
  std::unordered_map<std::string, int> index;
  int nuisances = 0;
  std::array<SetSums, kSets> sets;
  std::vector<Theta> theta;
  [[nodiscard]] int y() const { return static_cast<int>(columns.size()); }
};

/// @param theta  nullptr: all; @param only  one set, or -1 for all
[[nodiscard]] Bank sum_up(const std::vector<Observation>& observations,
                          const std::vector<Column>& nuisances, const std::vector<Column>& columns,
                          const Layout& layout, const std::vector<Theta>* theta = nullptr,
                          int only = -1);

/// A model fitted to some of the sets.
struct Fit {
  double objective = INFINITY;  ///< -2 log likelihood, up to a constant
  int theta = 0;
  Eigen::VectorXd coefficients;  ///< in the order of the model's columns
  Eigen::MatrixXd covariance;
  std::array<double, kScales> variance{};  ///< of one point, by scale
  double top_variance = 0.0;
};
/// @param model  indices of columns
[[nodiscard]] Fit fit(const Bank& bank, const std::vector<int>& model,
                      const std::vector<int>& sets);
/// -2 log likelihood of sets with coefficients held except the nuisances (the first ones), noise
/// profiled.
[[nodiscard]] double objective_held(const Bank& bank, const std::vector<int>& model,
                                    const Eigen::VectorXd& coefficients, int free_columns,
                                    const std::vector<int>& sets);

}  // namespace maquette::diagnosis::detail
