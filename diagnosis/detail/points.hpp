// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

// The observations sorted into cells, and their values taken apart into details, blind to what is
// smooth over cells.
//
// Details say how a square's quarters differ from it (sums.hpp). Those of a smooth process are
// alike over many cells; taken for independent they would say far more about a smooth cause than is
// known. So what the cells of a block lead to expect within each of its cells is subtracted first:
// the process (Layout::smooth, with trend) is predicted from the means of the cells and taken as a
// quadric of heights within each: of what a process of 4 cells' length varies by within a cell 5 %
// remains, 9 % at 2.5, 25 % at 1.5. Means are not changed, so that likelihoods of details and
// means together are those of the values (lifting: Sweldens, SIAM J. Math. Anal. 29 (1998),
// doi:10.1137/S0036141095289051). Where the means show no such process nothing is subtracted:
// their own roughness would only be carried into the details.

#include <array>
#include <cstdint>
#include <utility>
#include <vector>

#include <oneapi/tbb/parallel_for.h>
#include <Eigen/Dense>

#include "diagnosis/detail/sums.hpp"

namespace maquette::diagnosis::detail {

using RowMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
using FloatRows = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

inline constexpr std::size_t kStripes = 8;  // fixed: sums do not depend on threads

/// Details as floats: sums are of doubles, and a column rounded to 24 bits is a column as good.
struct Points {
  struct Cell {
    int set;
    std::size_t begin, end;                       // of `order`
    std::array<Eigen::Index, kGroups> row, rows;  // of its details
    Eigen::Index mean, means;                     // one over the set-ups, then differences
    std::uint64_t at = 0;                         // row of cells times their number a row + column
    Vec3 centre;
    double rise = 1.0;  // mean z of the points' `along`
    // Rows after `mean` of the differences whose two sides see the same of the cell: the others are
    // not compared (TopSums).
    std::vector<Eigen::Index> differences{};
  };
  /// Cells that tell of each other, and for each of them its quadric from their means.
  struct Block {
    std::vector<std::size_t> cells;
    std::vector<Eigen::MatrixXf> quadric;  // kQuadric x cells
  };
  std::vector<std::pair<std::uint64_t, std::uint32_t>> order;  // by cell, square, set-up
  std::vector<Cell> cells;
  std::vector<Block> smooth;
  std::uint64_t cells_a_row = 1;
  Eigen::Index rows = 0;
  FloatRows shape;                // details of heights of a quadric's terms
  std::vector<FloatRows> blocks;  // columns, in the bank's order
  FloatRows residual;             // NaN in sets that it is not told of
  OfSets told{};
  std::vector<char> answered;  // by column: its products with the residual are in the sums
  struct Top {
    Eigen::MatrixXd factor, white;  // Cholesky's, of the means' covariance; columns' means over it
    Eigen::VectorXd white_y;
  };
  std::array<std::array<std::vector<Top>, kTops>, kSets> top;  // by theta
  std::vector<Top> joint;
};

/// Sorted, and counted into the bank's sums. @param only  one set, or -1 for all
[[nodiscard]] Points sort_points(const std::vector<Observation>& all, const Layout& layout,
                                 int only, Bank& bank);

/// Calls work(stripe, cell) for all cells, stripes in parallel.
template <class Work>
void each_cell(const Points& points, const Work& work) {
  oneapi::tbb::parallel_for(std::size_t{0}, kStripes, [&](std::size_t s) {
    const std::size_t n = points.cells.size();
    for (std::size_t i = s * n / kStripes; i < (s + 1) * n / kStripes; ++i)
      work(s, points.cells[i]);
  });
}

/// Details of one cell's values (rows: its points in their order), from points up to its means.
void transform(const Points& points, const Points::Cell& cell, RowMatrix& values, FloatRows& out);
/// Subtracts what the means lead to expect.
void lift(const Points& points, FloatRows& details, const OfSets& sets);

inline constexpr OfSets kEverySet{true, true, true};
/// Details of columns. @param value  of (observation's number, column) @param sets  NaN in others
template <class Value>
[[nodiscard]] FloatRows details_of(const Points& points, Eigen::Index columns, const Value& value,
                                   const OfSets& sets = kEverySet) {
  FloatRows out(points.rows, columns);
  each_cell(points, [&](std::size_t, const Points::Cell& cell) {
    if (!sets[static_cast<std::size_t>(cell.set)]) {
      out.middleRows(cell.row[0], cell.mean + cell.means - cell.row[0]).setConstant(NAN);
      return;
    }
    RowMatrix x(static_cast<Eigen::Index>(cell.end - cell.begin), columns);
    for (Eigen::Index i = 0; i < x.rows(); ++i) {
      const std::uint32_t o = points.order[cell.begin + static_cast<std::size_t>(i)].second;
      for (Eigen::Index j = 0; j < columns; ++j) x(i, j) = value(o, j);
    }
    transform(points, cell, x, out);
  });
  lift(points, out, sets);
  return out;
}

}  // namespace maquette::diagnosis::detail
