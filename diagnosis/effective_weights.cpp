// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>

#include "diagnosis/detail/points.hpp"

namespace maquette::diagnosis::detail {
using Eigen::Index;
using Eigen::VectorXd;

namespace {

/// What the cells about each and of its set have together, itself included.
class Neighbours {
 public:
  explicit Neighbours(const Points& points) : points_(points) {
    for (std::size_t i = 0; i < points.cells.size(); ++i) index_[points.cells[i].at] = i;
  }
  template <class Add>
  void each(std::size_t i, const Add& add) const {
    const Points::Cell& cell = points_.cells[i];
    const std::uint64_t r = cell.at / points_.cells_a_row, c = cell.at % points_.cells_a_row;
    for (std::uint64_t row = r == 0 ? 0 : r - 1; row <= r + 1; ++row)
      for (std::uint64_t col = c == 0 ? 0 : c - 1; col <= c + 1 && col < points_.cells_a_row; ++col)
        if (const auto at = index_.find(row * points_.cells_a_row + col);
            at != index_.end() && points_.cells[at->second].set == cell.set)
          add(at->second);
  }

 private:
  const Points& points_;
  std::unordered_map<std::uint64_t, std::size_t> index_;
};

/// Columns times coefficients (one for each of the bank's) at a cell's details of a group.
VectorXd combined(const Points& p, const Points::Cell& cell, std::size_t g,
                  const VectorXd& coefficients) {
  VectorXd sum = VectorXd::Zero(cell.rows[g]);
  Index at = 0;
  for (const FloatRows& block : p.blocks)
    for (Index j = 0; j < block.cols(); ++j, ++at)
      if (coefficients(at) != 0.0)
        sum += coefficients(at) * block.col(j).segment(cell.row[g], cell.rows[g]).cast<double>();
  return sum;
}
/// What they leave of the residual there.
VectorXd left_of(const Points& p, const Points::Cell& cell, std::size_t g,
                 const VectorXd& coefficients) {
  return p.residual.col(0).segment(cell.row[g], cell.rows[g]).cast<double>() -
         combined(p, cell, g, coefficients);
}

}  // namespace

double overstated(const Bank& bank, const std::vector<int>& model, const std::vector<int>& without,
                  const Fit& fit) {
  // Of the cause as fitted: the direction of all coefficients that leaves the others' best.
  std::vector<Index> own;
  for (std::size_t i = 0; i < model.size(); ++i)
    if (std::find(without.begin(), without.end(), model[i]) == without.end())
      own.push_back(static_cast<Index>(i));
  if (own.empty()) return 1.0;
  const VectorXd size = fit.coefficients(own);
  const VectorXd weighed = Eigen::MatrixXd(fit.covariance(own, own)).ldlt().solve(size);
  const VectorXd direction = fit.covariance(Eigen::all, own) * weighed;
  const double claimed = size.dot(weighed);
  const Points& p = *bank.points;
  VectorXd along = VectorXd::Zero(bank.y()), fitted = along;
  for (std::size_t i = 0; i < model.size(); ++i) {
    along(model[i]) = direction(static_cast<Index>(i));
    fitted(model[i]) = fit.coefficients(static_cast<Index>(i));
  }
  std::vector<double> score(p.cells.size(), 0.0), information(p.cells.size(), 0.0);
  each_cell(p, [&](std::size_t, const Points::Cell& cell) {
    const auto i = static_cast<std::size_t>(&cell - p.cells.data());
    for (std::size_t g = 0; g < kGroups; ++g) {
      const VectorXd e = left_of(p, cell, g, fitted), x = combined(p, cell, g, along);
      const double weight = bank.weight[g] / fit.variance[g];
      score[i] += weight * x.dot(e);
      information[i] += weight * x.squaredNorm();
    }
  });
  const Neighbours neighbours(p);
  double real = 0.0, free = 0.0;
  for (std::size_t i = 0; i < p.cells.size(); ++i) {
    double near = 0.0;
    neighbours.each(i, [&](std::size_t other) { near += score[other]; });
    real += score[i] * near;
    free += information[i];
  }
  return std::fmax(1.0, 1.0 + (real - free) / claimed);
}

Weights effective_weights(const Bank& bank, const std::vector<int>& model, const Fit& fit) {
  const Points& p = *bank.points;
  const Index k = bank.y();
  // Scores of each cell and column.
  std::vector<std::array<VectorXd, kGroups>> scores(p.cells.size());
  VectorXd coefficients = VectorXd::Zero(k);
  for (std::size_t i = 0; i < model.size(); ++i)
    coefficients(model[i]) = fit.coefficients(static_cast<Index>(i));
  each_cell(p, [&](std::size_t, const Points::Cell& cell) {
    auto& score = scores[static_cast<std::size_t>(&cell - p.cells.data())];
    for (std::size_t g = 0; g < kGroups; ++g) {
      const VectorXd e = left_of(p, cell, g, coefficients);
      score[g].resize(k);
      Index at = 0;
      for (const FloatRows& block : p.blocks) {
        score[g].segment(at, block.cols()) =
            block.middleRows(cell.row[g], cell.rows[g]).cast<double>().transpose() * e;
        at += block.cols();
      }
    }
  });
  const Neighbours neighbours(p);
  Weights weights;
  for (std::size_t g = 0; g < kGroups; ++g) {
    VectorXd real = VectorXd::Zero(k), free = VectorXd::Zero(k);
    for (std::size_t i = 0; i < p.cells.size(); ++i) {
      VectorXd near = VectorXd::Zero(k);
      neighbours.each(i, [&](std::size_t other) { near += scores[other][g]; });
      real += scores[i][g].cwiseProduct(near);
    }
    for (const SetSums& s : bank.sets) free += fit.variance[g] * s.gram[g].diagonal().head(k);
    std::vector<double> ratio;
    for (Index j = bank.nuisances; j < k; ++j)
      if (free(j) > 0.0) ratio.push_back(real(j) / free(j));
    weights[g] = 1.0;
    if (ratio.empty()) continue;
    const auto middle = ratio.begin() + static_cast<std::ptrdiff_t>(ratio.size() / 2);
    std::nth_element(ratio.begin(), middle, ratio.end());
    weights[g] = 1.0 / std::fmax(1.0, *middle);
  }
  return weights;
}

}  // namespace maquette::diagnosis::detail
