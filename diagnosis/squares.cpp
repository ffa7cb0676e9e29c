// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/squares.hpp"

#include <cmath>

#include "diagnosis/detail/ridge.hpp"

namespace maquette::diagnosis::detail {
namespace {
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// Sums of products over some sets, the residual last.
MatrixXd plain_sums(const Bank& bank, const std::vector<int>& model, const std::vector<int>& sets) {
  std::vector<int> at = model;
  at.push_back(bank.y());
  const auto n = static_cast<Index>(at.size());
  MatrixXd sum = MatrixXd::Zero(n, n);
  for (const int set : sets) {
    const auto& s = bank.sets[static_cast<std::size_t>(set)];
    for (const auto& g : s.gram) sum += g(at, at);
    for (const auto& top : s.top)
      if (!top.weight.empty())
        sum += top.points() / static_cast<double>(top.weight.size()) * top.gram[0](at, at);
  }
  return sum;
}

/// The first `p` unknowns of normal equations by a right-hand side.
VectorXd solve(const MatrixXd& sum, Index p, const VectorXd& right) {
  return ridge_solve(sum.topLeftCorner(p, p), right, 1e-10);
}

}  // namespace

VectorXd levelled(const Bank& bank, const std::vector<int>& model, VectorXd b,
                  const std::vector<int>& sets) {
  const MatrixXd sum = plain_sums(bank, model, sets);
  const Index p = bank.nuisances, causes = b.size() - p;
  b.head(p) =
      solve(sum, p, sum.col(b.size()).head(p) - sum.block(0, p, p, causes) * b.tail(causes));
  return b;
}

double squares(const Bank& bank, const std::vector<int>& model, const VectorXd& b,
               const std::vector<int>& sets, double* count) {
  const VectorXd level = levelled(bank, model, b, sets);
  VectorXd v(b.size() + 1);
  v << -level, 1.0;
  if (count != nullptr)
    for (const int set : sets) *count += bank.sets[static_cast<std::size_t>(set)].top[0].points();
  return std::fmax(0.0, v.dot(plain_sums(bank, model, sets) * v));
}

double rms_beside_nuisances(const Bank& bank, int column) {
  std::vector<int> model;
  for (int i = 0; i < bank.nuisances; ++i) model.push_back(i);
  model.push_back(column);
  const MatrixXd sum = plain_sums(bank, model, kAll);
  const Index p = bank.nuisances;
  double points = 0.0;
  for (const SetSums& s : bank.sets) points += s.top[0].points();
  const VectorXd across = sum.col(p).head(p);
  return std::sqrt(std::fmax(0.0, sum(p, p) - solve(sum, p, across).dot(across)) /
                   std::fmax(1.0, points));
}

}  // namespace maquette::diagnosis::detail
