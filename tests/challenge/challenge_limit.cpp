// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>

#include <Eigen/Dense>

#include "challenge/challenge_world.hpp"

namespace challenge {
namespace {

constexpr int kNodes = 160;  // of 1 mm
constexpr double kNode = kSide / kNodes;
constexpr int kPoseColumns = 12;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// Orthonormal cosines: reflected at the border, so that a drift has no step there.
MatrixXd cosines() {
  MatrixXd c(kNodes, kNodes);
  for (int k = 0; k < kNodes; ++k)
    for (int i = 0; i < kNodes; ++i)
      c(k, i) = std::sqrt((k == 0 ? 1.0 : 2.0) / kNodes) * std::cos(kPi * k * (i + 0.5) / kNodes);
  return c;
}

/// Values at rays as a map of means.
struct Map {
  MatrixXd sum = MatrixXd::Zero(kNodes, kNodes), count = MatrixXd::Zero(kNodes, kNodes);
  void add(double x, double y, double v) {
    const auto c = static_cast<int>(x / kNode), r = static_cast<int>(y / kNode);
    if (r < 0 || c < 0 || r >= kNodes || c >= kNodes) return;
    sum(r, c) += v;
    count(r, c) += 1;
  }
  MatrixXd mean() const { return (sum.array() / count.array().max(1.0)).matrix(); }
};

}  // namespace

std::vector<Shown> over_limit(const Options& options) {
  Draw d{std::mt19937_64(options.seed * 7919 + 13)};
  const World w = draw_world(options, d);
  const std::size_t effects = w.hidden.size();
  if (effects == 0) return {};
  const Cut plain = cut_of(w, {});
  const double plain_top = above(plain.surface);
  const std::size_t columns = effects + kPoseColumns;
  // Of each column what it moves along the normal, by scan.
  std::vector<std::array<Map, 2>> maps(columns);
  std::array<double, 2> incidence{}, met{};
  std::vector<Cut> cuts;
  std::vector<double> tops;
  for (const Hidden& h : w.hidden) {
    const bool cut_anew = h.machine || h.radius || h.radial > 0 || h.bend || h.surface;
    cuts.push_back(cut_anew ? cut_of(w, {h}) : plain);
    tops.push_back(above(cuts.back().surface));
  }
  for (int k = 0; k < 2; ++k) {
    const auto ku = static_cast<std::size_t>(k);
    const Vec3 o = w.station[ku];
    rays_of(w, k, options.points / 4).each([&](double azimuth, double elevation) {
      const Echo e = echo(plain, plain_top, {}, k, o, azimuth, elevation);
      if (!e.met) return;
      const Vec3 p = o + e.range * e.beam, n = e.normal, about = p - kMiddle;
      incidence[ku] += std::pow(maquette::dot(n, e.beam), 2);
      met[ku] += 1;
      const double pose[6] = {n.x,
                              n.y,
                              n.z,
                              n.z * about.y - n.y * about.z,
                              n.x * about.z - n.z * about.x,
                              n.y * about.x - n.x * about.y};
      for (std::size_t c = 0; c < 6; ++c) maps[effects + 6 * ku + c][ku].add(p.x, p.y, pose[c]);
      for (std::size_t j = 0; j < effects; ++j) {
        const Echo f = echo(cuts[j], tops[j], {w.hidden[j]}, k, o, azimuth, elevation);
        if (!f.met) continue;
        const double moved = maquette::dot(n, o + f.range * direction(f.azimuth, f.elevation) - p);
        // A ray that passes an edge on the other side tells of the edge.
        if (std::abs(moved) < 1.0) maps[j][ku].add(p.x, p.y, moved);
      }
    });
  }
  // Whitened, mean of the scans above and half their difference below.
  const MatrixXd cosine = cosines();
  const double density = options.points / (kSide * kSide);
  MatrixXd means(kNodes, kNodes), halves(kNodes, kNodes);
  for (int r = 0; r < kNodes; ++r)
    for (int c = 0; c < kNodes; ++c) {
      const double k2 = std::pow(kPi / kSide, 2) * (r * r + c * c);
      const Noise& law = w.noise;
      double white = 0;
      for (std::size_t s = 0; s < 2; ++s)
        white += 0.25 * law.sigma * law.sigma * incidence[s] / met[s] / density;
      const double l = 0.7 * law.rough_length, v = law.wavy_length;
      const double rough = law.rough * law.rough * 4 * kPi * l * l * std::exp(-k2 * l * l),
                   wavy = law.wavy * law.wavy * 2 * kPi * v * v * std::exp(-0.5 * k2 * v * v);
      means(r, c) = 1 / std::sqrt((white + rough + wavy) / (kNode * kNode));
      halves(r, c) = 1 / std::sqrt(white / (kNode * kNode));
    }
  MatrixXd x(2 * kNodes * kNodes, static_cast<Eigen::Index>(columns)), plainly = x;
  for (std::size_t j = 0; j < columns; ++j) {
    const MatrixXd a = maps[j][0].mean(), b = maps[j][1].mean();
    const auto put = [&](MatrixXd& to, const MatrixXd& upper, const MatrixXd& lower) {
      const auto at = static_cast<Eigen::Index>(j);
      to.col(at).head(kNodes * kNodes) = upper.reshaped();
      to.col(at).tail(kNodes * kNodes) = lower.reshaped();
    };
    put(plainly, a, b);
    const auto spectrum = [&](const MatrixXd& m) -> MatrixXd {
      return cosine * m * cosine.transpose();
    };
    put(x, spectrum(0.5 * (a + b)).cwiseProduct(means),
        spectrum(0.5 * (a - b)).cwiseProduct(halves));
  }
  // What is left of each effect beside everything else.
  const auto left = [&](const MatrixXd& of, std::size_t j) {
    MatrixXd others(of.rows(), of.cols() - 1);
    for (Eigen::Index c = 0, to = 0; c < of.cols(); ++c)
      if (c != static_cast<Eigen::Index>(j)) others.col(to++) = of.col(c).normalized();
    const VectorXd y = of.col(static_cast<Eigen::Index>(j));
    MatrixXd gram = others.transpose() * others;
    gram.diagonal().array() += 1e-10;
    return (y - others * gram.ldlt().solve(others.transpose() * y)).norm();
  };
  std::vector<Shown> shown;
  for (std::size_t j = 0; j < effects; ++j) {
    const double rms = left(plainly, j) / std::sqrt(2.0 * kNodes * kNodes);
    shown.push_back({std::min(left(x, j) / kLimitSigma, rms / kLimitRms_mm), rms});
  }
  return shown;
}

}  // namespace challenge
