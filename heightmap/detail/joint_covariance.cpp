// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include <oneapi/tbb/parallel_for.h>
#include <Eigen/Dense>

#include "heightmap/detail/joint_problem.hpp"

namespace maquette::heightmap::detail {
namespace {

constexpr std::ptrdiff_t kMostLattice = 160;
constexpr std::ptrdiff_t kMostLag = 12;
constexpr double kLeastOfIndependent = 0.01;

/// A flat-top window may make a sum over lags that is no covariance. As Politis 2011
/// (doi:10.1017/S0266466610000484) proposes, directions of too little variance get some: a
/// hundredth of what they had if cells were independent (`at_lag_zero`).
Eigen::MatrixXd made_positive(const Eigen::MatrixXd& sum, const Eigen::MatrixXd& at_lag_zero) {
  const Eigen::LLT<Eigen::MatrixXd> root(at_lag_zero);
  if (root.info() != Eigen::Success) return sum;
  const Eigen::MatrixXd half = root.matrixL().solve(sum);
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(
      root.matrixL().solve(half.transpose()));
  if (eigen.eigenvalues()[0] >= kLeastOfIndependent) return sum;
  const Eigen::MatrixXd back = root.matrixL() * eigen.eigenvectors();
  return back * eigen.eigenvalues().cwiseMax(kLeastOfIndependent).asDiagonal() * back.transpose();
}

}  // namespace

/// Covariance of the sum of all scores, on a lattice of places in the first surface's frame.
Eigen::MatrixXd JointProblem::meat() const {
  double cell = 2.0 * half_ / static_cast<double>(kMostLattice);
  for (const AlignedPair& p : pairs_) cell = std::max(cell, p.cells.cell_m);
  const auto n = static_cast<std::ptrdiff_t>(std::ceil(2.0 * half_ / cell)) + 3;
  const auto lattice = [&](double x, double y) -> std::ptrdiff_t {
    const auto c = static_cast<std::ptrdiff_t>(std::floor((x + half_) / cell)) + 1;
    const auto r = static_cast<std::ptrdiff_t>(std::floor((y + half_) / cell)) + 1;
    return std::clamp<std::ptrdiff_t>(r, 0, n - 1) * n + std::clamp<std::ptrdiff_t>(c, 0, n - 1);
  };
  const auto count = static_cast<std::size_t>(n * n);
  Eigen::MatrixXd score = Eigen::MatrixXd::Zero(unknowns_, n * n);
  std::ptrdiff_t window = 1;
  double used = 0.0;
  for (const AlignedPair& p : pairs_) {
    std::vector<double> weighed(count, 0.0), samples(count, 0.0);
    const double weight = 1.0 / (p.nmad * p.nmad);
    for (std::ptrdiff_t r = 0; r < p.cells.lower.rows(); r += p.stride)
      for_samples(p, r, [&](const JointSample& q) {
        const std::ptrdiff_t at = lattice(q.x, q.y);
        const double e = psi(q.residual, limit(p));
        weighed[static_cast<std::size_t>(at)] += e;
        samples[static_cast<std::size_t>(at)] += 1.0;
        score.col(at) += weight * e * (p.cells.by_upper ? q.row_upper : q.row_lower);
      });
    // Up to which ring cells of this pair are alike.
    std::vector<double> ring(kMostLag + 2, 0.0), ring_n(kMostLag + 2, 0.0);
    const auto at = [n](std::ptrdiff_t r, std::ptrdiff_t c) {
      return static_cast<std::size_t>(r * n + c);
    };
    for (std::ptrdiff_t dr = 0; dr <= kMostLag; ++dr)
      for (std::ptrdiff_t dc = -kMostLag; dc <= kMostLag; ++dc) {
        const auto far = std::lround(std::hypot(static_cast<double>(dr), static_cast<double>(dc)));
        if (far > kMostLag) continue;
        for (std::ptrdiff_t r = 0; r + dr < n; ++r)
          for (std::ptrdiff_t c = std::max<std::ptrdiff_t>(0, -dc);
               c < n - std::max<std::ptrdiff_t>(0, dc); ++c) {
            const std::size_t a = at(r, c), b = at(r + dr, c + dc);
            if (samples[a] == 0.0 || samples[b] == 0.0) continue;
            ring[static_cast<std::size_t>(far)] += weighed[a] * weighed[b];
            ring_n[static_cast<std::size_t>(far)] += 1.0;
          }
      }
    const double c0 = ring[0] / std::max(1.0, ring_n[0]);
    const auto alike = [&](std::ptrdiff_t r) {
      const auto k = static_cast<std::size_t>(r);
      return r <= kMostLag && ring_n[k] > 0.0 && std::abs(ring[k] / ring_n[k]) > 0.03 * c0;
    };
    std::ptrdiff_t m = 1;
    while (m < kMostLag && (alike(m) || alike(m + 1))) ++m;
    window = std::max(window, m);
    used += ring_n[0];
  }
  used /= static_cast<double>(pairs_.size());
  const auto taper = [window](double far) {
    return std::clamp(2.0 - far / static_cast<double>(window), 0.0, 1.0);
  };
  std::vector<std::pair<std::ptrdiff_t, std::ptrdiff_t>> lags;
  double weights = -1.0;
  for (std::ptrdiff_t dr = 0; dr < 2 * window; ++dr)
    for (std::ptrdiff_t dc = dr == 0 ? 0 : -2 * window; dc <= 2 * window; ++dc)
      if (const double w = taper(std::hypot(dr, dc)); w > 0.0) {
        lags.emplace_back(dr, dc);
        weights += 2.0 * w;
      }
  std::vector<Eigen::MatrixXd> part(lags.size());
  oneapi::tbb::parallel_for(std::size_t{0}, lags.size(), [&](std::size_t k) {
    const auto [dr, dc] = lags[k];
    Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(unknowns_, unknowns_);
    for (std::ptrdiff_t r = 0; r + dr < n; ++r) {
      const std::ptrdiff_t c0 = std::max<std::ptrdiff_t>(0, -dc);
      const std::ptrdiff_t length = n - std::max<std::ptrdiff_t>(0, dc) - c0;
      sum.noalias() += score.middleCols(r * n + c0, length) *
                       score.middleCols((r + dr) * n + c0 + dc, length).transpose();
    }
    part[k] = dr == 0 && dc == 0
                  ? sum
                  : Eigen::MatrixXd(taper(std::hypot(dr, dc)) * (sum + sum.transpose()));
  });
  Eigen::MatrixXd out = Eigen::MatrixXd::Zero(unknowns_, unknowns_);
  for (const Eigen::MatrixXd& p : part) out += p;
  out = made_positive(out, part[0]);
  // The fit took the longest waves out of the residuals (coregister.cpp), of each surface its own.
  double moved = 0.0;
  for (const JointPose& pose : pose_) moved += pose.found ? 1.0 : 0.0;
  const double taken =
      static_cast<double>(unknowns_) / std::max(1.0, moved - 1.0) * weights / std::max(1.0, used);
  return out / std::fmax(0.1, 1.0 - taken);
}

}  // namespace maquette::heightmap::detail
