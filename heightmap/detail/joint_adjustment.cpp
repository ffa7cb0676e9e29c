// SPDX-License-Identifier: GPL-3.0-or-later
#include "heightmap/detail/joint_adjustment.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include <Eigen/Dense>

#include "heightmap/detail/joint_problem.hpp"

namespace maquette::heightmap::detail {
namespace {

constexpr double kMostSigma_px = 0.1;  // of its pairs' coarsest

/// What shifts around each three surfaces fail to close by.
void report_loops(JointAdjustment& out) {
  std::map<std::pair<std::size_t, std::size_t>, const JointPair*> by;
  for (const JointPair& p : out.pairs) by[{p.lower, p.upper}] = &p;
  for (const JointPair& ij : out.pairs)
    for (const JointPair& jk : out.pairs) {
      const auto found = by.find({ij.lower, jk.upper});
      if (jk.lower != ij.upper || found == by.end()) continue;
      const JointPair& ik = *found->second;
      const double pixel = std::max({ij.pixel_m, jk.pixel_m, ik.pixel_m});
      const double before = std::hypot(ij.before_east_m + jk.before_east_m - ik.before_east_m,
                                       ij.before_north_m + jk.before_north_m - ik.before_north_m);
      const double after = std::hypot(ij.off_east_m + jk.off_east_m - ik.off_east_m,
                                      ij.off_north_m + jk.off_north_m - ik.off_north_m);
      out.loop_before_px = std::max(out.loop_before_px, before / pixel);
      if (after / pixel < out.loop_after_px) continue;
      out.loop_after_px = after / pixel;
      out.loop_sigma_px = std::hypot(ij.sigma_m, jk.sigma_m, ik.sigma_m) / pixel;
    }
}

}  // namespace

void JointProblem::report_pairs(JointAdjustment& out) const {
  for (const AlignedPair& p : pairs_) {
    JointPair r;
    r.lower = p.i;
    r.upper = p.j;
    r.pixel_m = p.pixel_m;
    r.before_east_m = p.alone.east_m;
    r.before_north_m = p.alone.north_m;
    r.median_before_m = p.alone.median_before_m;
    r.nmad_before_m = p.alone.nmad_before_m;
    r.overlap = p.alone.overlap;
    r.sigma_m =
        std::hypot(p.alone.sigma(Coregistration::kEast), p.alone.sigma(Coregistration::kNorth));
    const Spread after = spread(p);
    r.median_after_m = after.median;
    r.nmad_after_m = after.nmad;
    // A step of the upper (or lower, if the upper stays) surface alone.
    const JointSystem one = system_of(p);
    const bool upper = blocks_[p.j].first >= 0 && p.j > 0;
    const JointBlock& b = blocks_[upper ? p.j : p.i];
    const auto size = static_cast<Eigen::Index>(kRigid);
    const Eigen::MatrixXd inv = scaled_inverse(one.a.block(b.first, b.first, size, size));
    if (inv.size() > 0) {
      const Eigen::VectorXd step = inv * one.b.segment(b.first, size);
      r.off_east_m = (upper ? 1.0 : -1.0) * step[0];
      r.off_north_m = (upper ? 1.0 : -1.0) * step[1];
    }
    out.pairs.push_back(r);
  }
}

JointAdjustment JointProblem::result() {
  const Eigen::MatrixXd covariance = bread_ * meat() * bread_;
  for (std::size_t k = 0; k < pose_.size(); ++k) {
    const JointBlock& b = blocks_[k];
    if (b.first < 0) continue;
    const auto size = static_cast<Eigen::Index>(k == 0 ? b.seams : b.size());
    double pixel_m = 0.0;
    for (const AlignedPair& p : pairs_)
      if (p.i == k || p.j == k) pixel_m = std::max(pixel_m, p.pixel_m);
    Eigen::MatrixXd own = covariance.block(b.first, b.first, size, size);
    if (k > 0)
      for (const int i : {0, 1}) own(i, i) += std::pow(kInterpolation_px * pixel_m, 2.0);
    pose_[k].covariance.assign(own.data(), own.data() + own.size());
    if (k > 0 && !(std::sqrt(std::max(own(0, 0), own(1, 1))) <= kMostSigma_px * pixel_m))
      pose_[k].found = false;
  }
  JointAdjustment out;
  report_pairs(out);
  report_loops(out);
  out.poses = pose_;
  return out;
}

double Seam::side(double x, double y) const {
  const double cross =
      (end_x_m - begin_x_m) * (y - begin_y_m) - (end_y_m - begin_y_m) * (x - begin_x_m);
  return cross >= 0.0 ? 0.5 : -0.5;
}

double Seam::distance_m(double x, double y) const {
  const double cross =
      (end_x_m - begin_x_m) * (y - begin_y_m) - (end_y_m - begin_y_m) * (x - begin_x_m);
  return std::abs(cross) / std::hypot(end_x_m - begin_x_m, end_y_m - begin_y_m);
}

double JointPose::raised_m(double x, double y, const std::vector<Seam>& seams) const {
  const double p = x / half_width_m, q = y / half_width_m;
  double up = up_m + tilt_east * x + tilt_north * y + bow_m[0] * p * p + bow_m[1] * p * q +
              bow_m[2] * q * q;
  for (std::size_t i = 0; i < steps_m.size(); ++i)
    up += steps_m[i] * seams[i].side(x - east_m, y - north_m);
  return up;
}

std::optional<JointAdjustment> joint_adjustment(const std::vector<JointSurface>& surfaces,
                                                double spacing_m) {
  JointProblem problem(surfaces, spacing_m);
  if (!problem.pair_up()) return std::nullopt;
  problem.lay_out();
  if (!problem.solve()) return std::nullopt;
  return problem.result();
}

}  // namespace maquette::heightmap::detail
