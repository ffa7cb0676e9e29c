// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>

#include "diagnosis/detail/points.hpp"

namespace maquette::diagnosis::detail {
using Eigen::Index;
using Eigen::VectorXd;

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
      VectorXd e = p.residual.col(0).segment(cell.row[g], cell.rows[g]).cast<double>();
      Index at = 0;
      for (const FloatRows& block : p.blocks) {
        const VectorXd b = coefficients.segment(at, block.cols());
        if (b.squaredNorm() > 0.0)
          e -= block.middleRows(cell.row[g], cell.rows[g]).cast<double>() * b;
        at += block.cols();
      }
      score[g].resize(k);
      at = 0;
      for (const FloatRows& block : p.blocks) {
        score[g].segment(at, block.cols()) =
            block.middleRows(cell.row[g], cell.rows[g]).cast<double>().transpose() * e;
        at += block.cols();
      }
    }
  });
  std::unordered_map<std::uint64_t, std::size_t> index;
  for (std::size_t i = 0; i < p.cells.size(); ++i) index[p.cells[i].at] = i;
  Weights weights;
  for (std::size_t g = 0; g < kGroups; ++g) {
    VectorXd real = VectorXd::Zero(k), free = VectorXd::Zero(k);
    for (std::size_t i = 0; i < p.cells.size(); ++i) {
      VectorXd near = VectorXd::Zero(k);
      const std::uint64_t r = p.cells[i].at / p.cells_a_row, c = p.cells[i].at % p.cells_a_row;
      for (std::uint64_t row = r == 0 ? 0 : r - 1; row <= r + 1; ++row)
        for (std::uint64_t col = c == 0 ? 0 : c - 1; col <= c + 1 && col < p.cells_a_row; ++col)
          if (const auto at = index.find(row * p.cells_a_row + col);
              at != index.end() && p.cells[at->second].set == p.cells[i].set)
            near += scores[at->second][g];
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
