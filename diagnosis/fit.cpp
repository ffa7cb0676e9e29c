// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>
#include <numeric>

#include "diagnosis/detail/sums.hpp"

namespace maquette::diagnosis::detail {
namespace {
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// The sums of a model's columns: small dense matrices.
struct Small {
  std::array<MatrixXd, kGroups> gram;
  std::array<double, kGroups> count{};
  struct Top {
    std::vector<MatrixXd> gram;
    std::vector<double> log_det;
    double count = 0.0, freedom = 0.0;
  };
  std::array<Top, kTops> top;
};

Small pick(const Bank& bank, const std::vector<int>& model, const std::vector<int>& sets) {
  Small s;
  std::vector<int> at = model;
  at.push_back(bank.y());
  const auto n = static_cast<Index>(at.size());
  for (std::size_t g = 0; g < kGroups; ++g) {
    s.gram[g] = MatrixXd::Zero(n, n);
    for (const int set : sets) {
      const SetSums& from = bank.sets[static_cast<std::size_t>(set)];
      s.gram[g] += bank.weight[g] * from.gram[g](at, at);
      s.count[g] += bank.weight[g] * from.count[g];
    }
  }
  for (std::size_t u = 0; u < kTops; ++u) {
    Small::Top& top = s.top[u];
    top.gram.assign(bank.theta.size(), MatrixXd::Zero(n, n));
    top.log_det.assign(bank.theta.size(), 0.0);
    for (const int set : sets) {
      const TopSums& from = bank.sets[static_cast<std::size_t>(set)].top[u];
      top.count += static_cast<double>(from.weight.size());
      if (from.weight.empty()) continue;
      for (std::size_t t = 0; t < bank.theta.size(); ++t) {
        top.gram[t] += from.gram[t](at, at);
        top.log_det[t] += from.log_det[t];
      }
    }
    top.freedom = std::fmax(1.0, top.count - 0.5 * static_cast<double>(bank.nuisances));
  }
  return s;
}

double rss(const MatrixXd& gram, const VectorXd& b) {
  const Index p = b.size();
  return std::fmax(
      0.0, gram(p, p) - 2.0 * b.dot(gram.col(p).head(p)) + b.dot(gram.topLeftCorner(p, p) * b));
}

constexpr double kLeastVariance = 1e-12;  // a nanometre: exact data keep finite logarithms

/// Solves for the coefficients, given variances; columns that add nothing get none.
VectorXd solve(const MatrixXd& a, const VectorXd& b, MatrixXd* covariance) {
  const VectorXd d = a.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
  MatrixXd scaled = d.asDiagonal() * a * d.asDiagonal();
  scaled.diagonal().array() += 1e-10;
  const Eigen::LDLT<MatrixXd> ldlt(scaled);
  if (covariance != nullptr)
    *covariance =
        d.asDiagonal() * ldlt.solve(MatrixXd::Identity(a.rows(), a.cols())) * d.asDiagonal();
  return d.asDiagonal() * ldlt.solve(d.asDiagonal() * b);
}

}  // namespace

namespace {

/// One turn of "coefficients given the noise, noise given the coefficients": each lowers the
/// objective. @param free  theta is chosen anew, else held
void improve(const Small& s, Fit& f, bool free, MatrixXd& a) {
  const Index p = s.gram[0].rows() - 1;
  a = MatrixXd::Zero(p, p);
  VectorXd b = VectorXd::Zero(p);
  const auto add = [&](const MatrixXd& gram, double variance) {
    a += gram.topLeftCorner(p, p) / variance;
    b += gram.col(p).head(p) / variance;
  };
  for (std::size_t g = 0; g < kGroups; ++g) add(s.gram[g], f.variance[g]);
  for (std::size_t u = 0; u < kTops; ++u)
    if (s.top[u].count > 0.0)
      add(s.top[u].gram[static_cast<std::size_t>(f.theta[u])], f.top_variance[u]);
  f.coefficients = solve(a, b, nullptr);
  f.objective = 0.0;
  for (std::size_t g = 0; g < kGroups; ++g) {
    if (!(s.count[g] > 0.0)) continue;
    f.variance[g] = std::fmax(kLeastVariance, rss(s.gram[g], f.coefficients) / s.count[g]);
    f.objective += s.count[g] * std::log(f.variance[g]);
  }
  for (std::size_t u = 0; u < kTops; ++u) {
    const Small::Top& top = s.top[u];
    if (!(top.count > 0.0)) continue;
    double least = INFINITY;
    const auto held = static_cast<std::size_t>(f.theta[u]);
    for (std::size_t t = free ? 0 : held; t < (free ? top.gram.size() : held + 1); ++t) {
      const double variance =
          std::fmax(kLeastVariance, rss(top.gram[t], f.coefficients) / top.freedom);
      const double here = top.log_det[t] + top.count * std::log(variance);
      if (here >= least) continue;
      least = here;
      f.theta[u] = static_cast<int>(t);
      f.top_variance[u] = variance;
    }
    f.objective += least;
  }
}

}  // namespace

Fit fit(const Bank& bank, const std::vector<int>& model, const std::vector<int>& sets) {
  const Small s = pick(bank, model, sets);
  const auto p = static_cast<Index>(model.size());
  Fit start;
  for (std::size_t g = 0; g < kGroups; ++g)
    start.variance[g] =
        std::fmax(kLeastVariance, s.count[g] > 0.0 ? s.gram[g](p, p) / s.count[g] : 1.0);
  for (std::size_t u = 0; u < kTops; ++u)
    start.top_variance[u] =
        std::fmax(kLeastVariance, s.top[u].gram[0](p, p) / std::fmax(1.0, s.top[u].count));
  // There are several optima: a drift is a cause, or a long process. One start for each kind and
  // length of process, the best two followed to rest.
  MatrixXd a;
  std::vector<Fit> starts;
  for (std::size_t t = 0; t < bank.theta.size(); ++t) {
    const Theta& theta = bank.theta[t];
    if (theta.ratio != 0.0 && theta.ratio != kStartRatio && bank.theta.size() > 8) continue;
    Fit f = start;
    f.theta[0] = static_cast<int>(t);
    for (int round = 0; round < 3; ++round) improve(s, f, false, a);
    starts.push_back(std::move(f));
  }
  std::sort(starts.begin(), starts.end(),
            [](const Fit& x, const Fit& y) { return x.objective < y.objective; });
  Fit best;
  for (std::size_t k = 0; k < std::min<std::size_t>(2, starts.size()); ++k) {
    Fit& f = starts[k];
    for (int round = 0; round < 20; ++round) {
      const double before = f.objective;
      improve(s, f, true, a);
      if (before - f.objective < 0.01) break;
    }
    if (f.objective < best.objective) {
      best = f;
      solve(a, VectorXd::Zero(p), &best.covariance);
    }
  }
  return best;
}

Beside beside(const Bank& bank, const std::vector<int>& model, const Fit& f, int column,
              const std::vector<int>& sets) {
  std::vector<int> wide = model;
  wide.push_back(column);
  const Small s = pick(bank, wide, sets);
  const Index p = static_cast<Index>(wide.size());
  MatrixXd a = MatrixXd::Zero(p + 1, p + 1);
  for (std::size_t g = 0; g < kGroups; ++g) a += s.gram[g] / f.variance[g];
  for (std::size_t u = 0; u < kTops; ++u)
    if (s.top[u].count > 0.0)
      a += s.top[u].gram[static_cast<std::size_t>(f.theta[u])] / f.top_variance[u];
  Beside b;
  b.absorbed = solve(a.topLeftCorner(p - 1, p - 1), a.col(p - 1).head(p - 1), nullptr);
  b.information = std::fmax(1e-12 * a(p - 1, p - 1),
                            a(p - 1, p - 1) - b.absorbed.dot(a.col(p - 1).head(p - 1)));
  b.estimate = (a(p, p - 1) - b.absorbed.dot(a.col(p).head(p - 1))) / b.information;
  return b;
}

double objective_held(const Bank& bank, const std::vector<int>& model, const VectorXd& coefficients,
                      int free_columns, const std::vector<int>& sets) {
  // The held part is moved to the residual's side.
  Bank moved;
  std::vector<int> at = model;
  at.push_back(bank.y());
  MatrixXd map = MatrixXd::Zero(static_cast<Index>(at.size()), free_columns + 1);
  map.topLeftCorner(free_columns, free_columns).setIdentity();
  map(static_cast<Index>(at.size()) - 1, free_columns) = 1.0;
  for (Index i = free_columns; i < static_cast<Index>(model.size()); ++i)
    map(i, free_columns) = -coefficients(i);
  moved.columns.resize(static_cast<std::size_t>(free_columns));
  moved.nuisances = bank.nuisances;
  moved.weight = bank.weight;
  moved.theta = bank.theta;
  for (const int set : sets) {
    const SetSums& from = bank.sets[static_cast<std::size_t>(set)];
    SetSums& to = moved.sets[static_cast<std::size_t>(set)];
    for (std::size_t g = 0; g < kGroups; ++g) {
      to.gram[g] = map.transpose() * from.gram[g](at, at) * map;
      to.count[g] = from.count[g];
    }
    for (std::size_t u = 0; u < kTops; ++u) {
      to.top[u].weight = from.top[u].weight;
      to.top[u].log_det = from.top[u].log_det;
      to.top[u].gram.resize(from.top[u].gram.size());
      for (std::size_t t = 0; t < from.top[u].gram.size(); ++t)
        to.top[u].gram[t] = map.transpose() * from.top[u].gram[t](at, at) * map;
    }
  }
  std::vector<int> nuisances(static_cast<std::size_t>(free_columns));
  std::iota(nuisances.begin(), nuisances.end(), 0);
  return fit(moved, nuisances, sets).objective;
}

}  // namespace maquette::diagnosis::detail
