// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

// Normal equations some of whose unknowns the data say nothing of.

#include <vector>

#include <Eigen/Dense>

namespace maquette::diagnosis::detail {

/// x of a x = b, a symmetric, to whose diagonal `ridge` times `squares` is added: what no datum
/// tells comes out as 0.
[[nodiscard]] inline Eigen::MatrixXd ridge_solve(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b,
                                                 double ridge, const Eigen::VectorXd& squares) {
  const Eigen::VectorXd d = squares.cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
  Eigen::MatrixXd scaled = d.asDiagonal() * a * d.asDiagonal();
  scaled.diagonal().array() += ridge;
  return d.asDiagonal() * scaled.ldlt().solve(d.asDiagonal() * b);
}
[[nodiscard]] inline Eigen::MatrixXd ridge_solve(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b,
                                                 double ridge) {
  return ridge_solve(a, b, ridge, a.diagonal());
}

/// Reduced normal equations: of some columns, what others can take of them taken off.
struct Reduced {
  Eigen::MatrixXd a;
  Eigen::VectorXd b;

  /// @param gram  of columns and, last, the residual
  Reduced(const Eigen::MatrixXd& gram, const std::vector<int>& mine, const std::vector<int>& others)
      : a(gram(mine, mine)), b(gram.col(gram.cols() - 1)(mine)) {
    if (others.empty()) return;
    const Eigen::MatrixXd across = gram(others, mine);
    const Eigen::MatrixXd taken = ridge_solve(gram(others, others), across, 1e-8);
    a -= across.transpose() * taken;
    b -= taken.transpose() * gram.col(gram.cols() - 1)(others);
  }
};

}  // namespace maquette::diagnosis::detail
