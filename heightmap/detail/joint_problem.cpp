// SPDX-License-Identifier: GPL-3.0-or-later
#include "heightmap/detail/joint_problem.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include <oneapi/tbb/parallel_for.h>
#include <Eigen/Dense>

namespace maquette::heightmap::detail {
namespace {

constexpr int kMostSteps = 30;
constexpr double kSettled_px = 5e-4;       // a tenth of what four surfaces of 128 pixels tell
constexpr double kSettled_sigma = 0.01;    // of the unknown
constexpr double kCycle_sigma = 0.2;       // cells that enter and leave make steps to and fro
constexpr int kCycleAfter = 8;             // steps; three are usual
constexpr double kSeamClearance_px = 2.0;  // of the coarser pixel: blurred over the seam
constexpr double kMostSamples = 4e5;       // of a pair

/// The derivatives of what is added to a surface at (x, y) by its unknowns beyond the shift;
/// (u, v) is the place in its own frame.
void height_terms(const JointSurface& s, const JointBlock& b, double half, double x, double y,
                  double u, double v, double* out) {
  *out++ = 1.0;
  *out++ = x;
  *out++ = y;
  if (b.bow > 0) {
    const double p = x / half, q = y / half;
    *out++ = p * p;
    *out++ = p * q;
    *out++ = q * q;
  }
  for (const Seam& seam : s.seams) *out++ = seam.side(u, v);
}

}  // namespace

JointProblem::JointProblem(const std::vector<JointSurface>& surfaces, double spacing_m)
    : s_(&surfaces), spacing_(spacing_m), blocks_(surfaces.size()), pose_(surfaces.size()) {
  const Grid<float>& z = *surfaces.front().z_m;
  half_ = 0.5 * spacing_m * static_cast<double>(std::max(z.rows(), z.cols()) - 1);
  pose_[0].found = true;
}

/// Every pair that tells its shift, and the first poses along the pairs with the most ground.
bool JointProblem::pair_up() {
  const auto& s = *s_;
  for (std::size_t i = 0; i < s.size(); ++i)
    for (std::size_t j = i + 1; j < s.size(); ++j) {
      if (!s[i].horizontal || !s[j].horizontal) continue;
      // A bow or a step is in the residuals still: what they tell is judged in the end.
      CoregisterOptions options;
      if (s[i].bow || s[j].bow || !s[i].seams.empty() || !s[j].seams.empty())
        options.most_sigma_pixels = INFINITY;
      auto alone = coregister(*s[i].z_m, *s[j].z_m, spacing_, s[i].pixel_m, s[j].pixel_m, options);
      if (!alone || !alone->horizontal) continue;
      AlignedPair p;
      p.i = i;
      p.j = j;
      p.pixel_m = std::max(s[i].pixel_m, s[j].pixel_m);
      p.cells = cells_of(*s[i].z_m, *s[j].z_m, spacing_, p.pixel_m);
      bring_to_one_resolution(p.cells, s[i].pixel_m, s[j].pixel_m);
      p.stride = static_cast<std::ptrdiff_t>(std::max(
          1.0,
          std::ceil(std::sqrt(static_cast<double>(p.cells.lower.cells().size()) / kMostSamples))));
      p.nmad = std::max(p.cells.least_spread_m, alone->nmad_after_m);
      p.alone = std::move(*alone);
      pairs_.push_back(std::move(p));
    }
  for (bool grown = true; grown;) {
    grown = false;
    const AlignedPair* best = nullptr;
    for (const AlignedPair& p : pairs_)
      if (pose_[p.i].found != pose_[p.j].found &&
          (best == nullptr || p.alone.overlap / p.pixel_m > best->alone.overlap / best->pixel_m))
        best = &p;
    if (best == nullptr) break;
    const bool forward = pose_[best->i].found;
    const JointPose& from = pose_[forward ? best->i : best->j];
    JointPose& to = pose_[forward ? best->j : best->i];
    const double sign = forward ? 1.0 : -1.0;
    to.east_m = from.east_m + sign * best->alone.east_m;
    to.north_m = from.north_m + sign * best->alone.north_m;
    to.up_m = from.up_m + sign * best->alone.up_m;
    to.tilt_east = from.tilt_east + sign * best->alone.tilt_east;
    to.tilt_north = from.tilt_north + sign * best->alone.tilt_north;
    to.found = grown = true;
  }
  std::erase_if(pairs_, [&](const AlignedPair& p) { return !pose_[p.i].found; });
  return !pairs_.empty();
}

void JointProblem::lay_out() {
  unknowns_ = 0;
  for (std::size_t k = 0; k < blocks_.size(); ++k) {
    pose_[k].half_width_m = half_;
    pose_[k].steps_m.assign((*s_)[k].seams.size(), 0.0);
    JointBlock& b = blocks_[k];
    b.seams = (*s_)[k].seams.size();
    if (k == 0) {  // stays, but its seams are steps too
      b.first = b.seams > 0 ? unknowns_ : -1;
      unknowns_ += static_cast<Eigen::Index>(b.seams);
      continue;
    }
    if (!pose_[k].found) continue;
    b.bow = (*s_)[k].bow ? 3 : 0;
    b.first = unknowns_;
    unknowns_ += static_cast<Eigen::Index>(b.size());
  }
}

/// Cell (r, c) of a pair, in the lower surface's own frame.
JointSample JointProblem::sample(const AlignedPair& p, std::ptrdiff_t r, std::ptrdiff_t c,
                                 bool with_rows) const {
  JointSample out;
  const auto lower = static_cast<double>(p.cells.lower(r, c));
  if (std::isnan(lower)) return out;
  const auto& s = *s_;
  const JointPose &low = pose_[p.i], &up = pose_[p.j];
  const Grid<float>& nodes = *s[0].z_m;
  const double m = static_cast<double>(p.cells.nodes);
  const double x_own =
      ((static_cast<double>(c) + 0.5) * m - 0.5 * static_cast<double>(nodes.cols())) * spacing_;
  const double y_own =
      ((static_cast<double>(r) + 0.5) * m - 0.5 * static_cast<double>(nodes.rows())) * spacing_;
  const double x = x_own + low.east_m, y = y_own + low.north_m;
  const double u = x - up.east_m, v = y - up.north_m;
  const double clear = kSeamClearance_px * p.pixel_m;
  for (const Seam& seam : s[p.i].seams)
    if (seam.distance_m(x_own, y_own) < clear) return out;
  for (const Seam& seam : s[p.j].seams)
    if (seam.distance_m(u, v) < clear) return out;
  const double cell = p.cells.cell_m;
  const auto [z, gx, gy] =
      height_and_gradient(p.cells.upper, static_cast<double>(c) + (u - x_own) / cell,
                          static_cast<double>(r) + (v - y_own) / cell);
  const auto [l, lx, ly] = height_and_gradient_at(p.cells.lower, r, c);
  if (std::isnan(z + l)) return out;
  out.x = x;
  out.y = y;
  out.residual = lower + low.raised_m(x, y, s[p.i].seams) - z - up.raised_m(x, y, s[p.j].seams);
  if (std::isnan(out.residual) || !with_rows) return out;
  const auto row = [&](double sx, double sy) {
    Eigen::VectorXd d = Eigen::VectorXd::Zero(unknowns_);
    double terms[64];
    const auto put = [&](std::size_t k, double sign, double own_x, double own_y) {
      const JointBlock& b = blocks_[k];
      if (b.first < 0) return;
      height_terms(s[k], b, half_, x, y, own_x, own_y, terms);
      if (k == 0) {
        for (std::size_t t = 0; t < b.seams; ++t)
          d[b.first + static_cast<Eigen::Index>(t)] = sign * terms[3 + t];
        return;
      }
      d[b.first] = -sign * sx / cell;
      d[b.first + 1] = -sign * sy / cell;
      for (std::size_t t = 0; t + 2 < b.size(); ++t)
        d[b.first + 2 + static_cast<Eigen::Index>(t)] = sign * terms[t];
    };
    put(p.j, 1.0, u, v);
    put(p.i, -1.0, x_own, y_own);
    return d;
  };
  out.row_lower = row(lx, ly);
  out.row_upper = row(gx, gy);
  return out;
}

Spread JointProblem::spread(const AlignedPair& p) const {
  const std::ptrdiff_t rows = (p.cells.lower.rows() + p.stride - 1) / p.stride;
  std::vector<std::vector<double>> of_row(static_cast<std::size_t>(rows));
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, rows, [&](std::ptrdiff_t k) {
    for_samples(
        p, k * p.stride,
        [&](const JointSample& q) { of_row[static_cast<std::size_t>(k)].push_back(q.residual); },
        false);
  });
  std::vector<double> all;
  for (const auto& row : of_row) all.insert(all.end(), row.begin(), row.end());
  return spread_of(all);
}

/// Derivative and value of the sum of a pair's scores, weighed by its spread.
JointSystem JointProblem::system_of(const AlignedPair& p) const {
  const std::ptrdiff_t rows = (p.cells.lower.rows() + p.stride - 1) / p.stride;
  struct Part {
    JointSystem s;
    MeanSlope slope;
  };
  std::vector<Part> part(static_cast<std::size_t>(rows));
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, rows, [&](std::ptrdiff_t k) {
    Part& q = part[static_cast<std::size_t>(k)];
    q.s.a = Eigen::MatrixXd::Zero(unknowns_, unknowns_);
    q.s.b = Eigen::VectorXd::Zero(unknowns_);
    for_samples(p, k * p.stride, [&](const JointSample& one) {
      q.slope.add(one.residual, limit(p));
      q.s.b += psi(one.residual, limit(p)) * (p.cells.by_upper ? one.row_upper : one.row_lower);
      q.s.a.selfadjointView<Eigen::Lower>().rankUpdate(one.row_upper, one.row_lower, 0.5);
    });
  });
  Part sum{{Eigen::MatrixXd::Zero(unknowns_, unknowns_), Eigen::VectorXd::Zero(unknowns_)}, {}};
  for (const Part& q : part) {  // in order: the same for any number of threads
    sum.s.a += q.s.a;
    sum.s.b += q.s.b;
    sum.slope.add(q.slope);
  }
  const double weight = 1.0 / (p.nmad * p.nmad);
  sum.s.a = weight * sum.slope.value() * Eigen::MatrixXd(sum.s.a.selfadjointView<Eigen::Lower>());
  sum.s.b *= weight;
  return sum.s;
}

Eigen::MatrixXd scaled_inverse(const Eigen::MatrixXd& a) {
  const Eigen::VectorXd d = a.diagonal();
  if (!(d.minCoeff() > 0.0)) return {};
  const Eigen::VectorXd scale = d.cwiseSqrt().cwiseInverse();
  const Eigen::MatrixXd m = scale.asDiagonal() * a * scale.asDiagonal();
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(m);
  if (!(eigen.eigenvalues()[0] > 1e-8)) return {};
  return scale.asDiagonal() * m.inverse() * scale.asDiagonal();
}

bool JointProblem::solve() {
  double finest = INFINITY;
  for (const AlignedPair& p : pairs_) finest = std::min(finest, p.pixel_m);
  for (int i = 0; i < kMostSteps; ++i) {
    JointSystem sum{Eigen::MatrixXd::Zero(unknowns_, unknowns_), Eigen::VectorXd::Zero(unknowns_)};
    for (AlignedPair& p : pairs_) {
      p.nmad = std::max(p.cells.least_spread_m, spread(p).nmad);
      const JointSystem one = system_of(p);
      sum.a += one.a;
      sum.b += one.b;
    }
    bread_ = scaled_inverse(sum.a);
    if (bread_.size() == 0) return false;
    const Eigen::VectorXd step = bread_ * sum.b;
    double moved = 0.0;
    bool below_noise = true;
    const double enough = i < kCycleAfter ? kSettled_sigma : kCycle_sigma;
    for (std::size_t k = 0; k < blocks_.size(); ++k) {
      const JointBlock& b = blocks_[k];
      if (b.first < 0) continue;
      JointPose& pose = pose_[k];
      Eigen::Index at = b.first;
      if (k > 0) {
        moved = std::max(moved, std::hypot(step[at], step[at + 1]));
        for (const Eigen::Index q : {at, at + 1})
          below_noise = below_noise && std::abs(step[q]) < enough * std::sqrt(bread_(q, q));
        pose.east_m += step[at++];
        pose.north_m += step[at++];
        pose.up_m += step[at++];
        pose.tilt_east += step[at++];
        pose.tilt_north += step[at++];
        for (std::size_t t = 0; t < b.bow; ++t) pose.bow_m[t] += step[at++];
      }
      for (double& one : pose.steps_m) one += step[at++];
    }
    if ((moved < kSettled_px * finest || below_noise) && i > 1) return true;
  }
  return false;
}

}  // namespace maquette::heightmap::detail
