// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file normal_matrix.hpp
/// What a Ceres problem's derivatives say of its unknowns at the solution.

#include <ceres/crs_matrix.h>
#include <Eigen/Dense>

namespace maquette::camera::detail {

/// Columns of unit length: what is left of the smallest eigenvalue says whether all can be told
/// apart; 1e-10 of a normal matrix is 1e-5 of a parameter beside those that imitate it.
inline constexpr double kLeastEigenvalue = 1e-10;

struct NormalMatrix {
  Eigen::VectorXd scale;  ///< of the unknowns: one over the lengths of their columns
  Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver;  ///< of unknowns in that scale

  explicit NormalMatrix(const ceres::CRSMatrix& jacobian) {
    Eigen::MatrixXd normal = Eigen::MatrixXd::Zero(jacobian.num_cols, jacobian.num_cols);
    for (std::size_t r = 0; r + 1 < jacobian.rows.size(); ++r)
      for (int i = jacobian.rows[r]; i < jacobian.rows[r + 1]; ++i)
        for (int j = jacobian.rows[r]; j < jacobian.rows[r + 1]; ++j) {
          const auto a = static_cast<std::size_t>(i), b = static_cast<std::size_t>(j);
          normal(jacobian.cols[a], jacobian.cols[b]) += jacobian.values[a] * jacobian.values[b];
        }
    scale = normal.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
    solver.compute(scale.asDiagonal() * normal * scale.asDiagonal());
  }
  [[nodiscard]] bool tells_all() const { return solver.eigenvalues()(0) > kLeastEigenvalue; }
  /// For residuals of variance 1, in that scale. @pre tells_all()
  [[nodiscard]] Eigen::MatrixXd inverse() const {
    return solver.eigenvectors() * solver.eigenvalues().cwiseInverse().asDiagonal() *
           solver.eigenvectors().transpose();
  }
};

}  // namespace maquette::camera::detail
