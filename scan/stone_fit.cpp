// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/detail/stone_fit.hpp"

#include <algorithm>
#include <cmath>

#include <Eigen/Dense>

#include "core/chi_squared.hpp"
#include "core/median.hpp"
#include "scan/detail/registration_steps.hpp"

namespace maquette::scan::detail {
namespace {

using Vector6 = Eigen::Matrix<double, 6, 1>;
using Matrix6 = Eigen::Matrix<double, 6, 6>;
constexpr int kAll = 8;  // pose; share of all lengths, length outwards

constexpr std::size_t kLeastRanges = 25;
constexpr int kMostIterations = 25;
// Seen flatter than this (the mean cosine) a range says more of the facet than of the stone.
constexpr double kLeastCosine = 0.25;
// Half of a beam must meet the stone. By the share that few rays find, this is surely less.
constexpr double kMaybeOnStone = 0.25;
constexpr std::size_t kAngles = 4;
constexpr int kScaleIterations = 5;  // later, and near its rest, the limit is kept
constexpr double kAtRestSigmas = 0.05;
// Rays that hop between facets and over the rim keep the pose moving by some tenth of its standard
// deviation; half of it would add an eighth to that.
constexpr double kNearlySigmas = 0.5;

/// Measured minus computed, and its derivatives by the stone's pose and size; both by how much less
/// certain than a plain range it is.
struct Residual {
  double mm = 0.0;
  Eigen::Matrix<double, kAll, 1> by;
  double cosine = 1.0;  ///< of incidence, mean over the beam
  std::size_t point = 0;
};

/// What a beam would measure of stone and ground, and how that hangs on the stone's pose and size.
struct Expected {
  double share = 0.0, energy = 0.0, on_stone = 0.0;
  double length_mm = 0.0;  ///< beyond the measured range, times energy
  Eigen::Matrix<double, kAll, 1> by = Eigen::Matrix<double, kAll, 1>::Zero();
  BeamDepth depth;

  void add(const BeamSample& sample, double cosine, double beyond_mm) {
    energy += sample.weight * cosine;
    length_mm += sample.weight * cosine * beyond_mm;
    depth.add(beyond_mm, sample.x, sample.y);
  }
};

Expected expected_of(std::span<const StoneRanges::Ray> rays, double range_mm,
                     const StoneScene& stone, const heightmap::ModelField& ground,
                     const StoneFrame& frame, const RigidTransform& pose,
                     const RigidTransform& back, double seam_mm) {
  Expected e;
  for (const StoneRanges::Ray& ray : rays) {
    const double weight = ray.sample.weight;
    e.share += weight;
    const auto hit =
        stone.trace(back.point(ray.from_mm), back.direction(ray.direction), ray.ground_mm);
    if (!hit) {
      if (!std::isinf(ray.ground_mm)) e.add(ray.sample, ray.ground_cos, ray.ground_mm - range_mm);
      continue;
    }
    const Vec3 normal = pose.direction(hit->normal);
    const double cosine = -dot(normal, ray.direction);
    if (!(cosine > 0.0)) continue;
    const Vec3 place = ray.from_mm + hit->distance_mm * ray.direction;
    const double under = heightmap::height_at(ground, place.x, place.y);
    if (!(place.z - under < seam_mm)) e.on_stone += weight * cosine;
    e.add(ray.sample, cosine, hit->distance_mm - range_mm);
    // A facet that moves by m along its normal shortens the ray by m / cosine: its weight's
    // cosine goes.
    const Vec3 turn = (1.0 / frame.arm_mm) * cross(place - frame.middle_mm, normal);
    e.by.head<6>() += weight * Vector6{normal.x, normal.y, normal.z, turn.x, turn.y, turn.z};
    e.by(6) += weight * dot(normal, place - frame.middle_mm);
    e.by(7) += weight;
  }
  return e;
}

std::vector<Residual> residuals_at(const StoneRanges& seen, const StoneScene& stone,
                                   const heightmap::ModelField& ground, const StoneFrame& frame,
                                   const RigidTransform& pose, const StoneNoise& noise) {
  const RigidTransform back = pose.inverse();
  const std::span<const StoneRanges::Ray> all(seen.rays);
  std::vector<Residual> residuals;
  for (const StoneRanges::Range& range : seen.ranges) {
    const auto expected = [&](std::size_t first, std::size_t rays) {
      return expected_of(all.subspan(first, rays), range.range_mm, stone, ground, frame, pose, back,
                         noise.seam_mm);
    };
    Expected e = expected(range.first, range.rays);
    if (e.on_stone < kMaybeOnStone * e.energy) continue;
    if (range.edge_rays > 0 && e.depth.beyond_plane_mm() > kEdgeOfNoise * noise.range_mm)
      e = expected(range.first + range.rays, range.edge_rays);
    if (!(e.energy > kLeastCosine * e.share) || e.on_stone < 0.5 * e.energy) continue;
    const double larger = std::hypot(1.0, kBeamShape * e.depth.whole_mm() / noise.range_mm);
    Residual r;
    r.cosine = e.energy / e.share;
    r.by = e.by / (e.energy * larger);
    r.mm = -e.length_mm / (e.energy * larger);
    r.point = range.point;
    residuals.push_back(r);
  }
  return residuals;
}

double scale_of(const std::vector<Residual>& residuals) {
  std::vector<double> size;
  for (const Residual& r : residuals) size.push_back(std::abs(r.mm));
  return std::fmax(kLeastScaleMm, kMadToSigma * median(std::move(size)));
}

/// Of the first N unknowns.
template <int N>
struct Normal {
  using Matrix = Eigen::Matrix<double, N, N>;
  Matrix weighted = Matrix::Zero(), bread = Matrix::Zero(), meat = Matrix::Zero();
  Eigen::Matrix<double, N, 1> gradient = Eigen::Matrix<double, N, 1>::Zero();
};

/// The meat takes residuals of one angle of incidence as equally noisy. One by one, the few that a
/// turn hangs on would say how noisy they are: a standard deviation that is itself known to a
/// fifth.
template <int N>
Normal<N> normal_of(std::vector<Residual>& residuals, const Loss& loss) {
  std::sort(residuals.begin(), residuals.end(),
            [](const Residual& a, const Residual& b) { return a.cosine < b.cosine; });
  Normal<N> n;
  for (std::size_t k = 0; k < kAngles; ++k) {
    const std::size_t first = k * residuals.size() / kAngles;
    const std::size_t end = (k + 1) * residuals.size() / kAngles;
    typename Normal<N>::Matrix all = Normal<N>::Matrix::Zero();
    double square = 0.0;
    for (std::size_t i = first; i < end; ++i) {
      const Residual& r = residuals[i];
      const Eigen::Matrix<double, N, 1> by = r.by.template head<N>();
      const typename Normal<N>::Matrix jj = by * by.transpose();
      all += jj;
      const auto [w, psi, slope] = influence(loss, {r.mm, {}});
      n.weighted += w * jj;
      n.bread += slope * jj;
      n.gradient += psi * by;
      square += psi * psi;
    }
    n.meat += square / static_cast<double>(end - first) * all;
  }
  return n;
}

RigidTransform moved_by(const RigidTransform& pose, const StoneFrame& frame, const Vector6& step) {
  Vector7 all = Vector7::Zero();
  all.head<6>() = step;
  return moved({pose, 1.0}, {frame.middle_mm, frame.arm_mm}, all).rigid;
}

}  // namespace

StoneFit fit_stone(const StoneRanges& seen, const StoneScene& stone,
                   const heightmap::ModelField& ground, const StoneFrame& frame,
                   const RigidTransform& start, const StoneNoise& noise) {
  StoneFit fit;
  RigidTransform pose = start;
  double scale = 0.0, damping = 1.0, sigmas = INFINITY;
  Vector6 last = Vector6::Zero();
  std::vector<Residual> residuals;
  for (int i = 0; i < kMostIterations; ++i) {
    residuals = residuals_at(seen, stone, ground, frame, pose, noise);
    if (residuals.size() < kLeastRanges) return fit;
    if (i < kScaleIterations || sigmas > 1.0) scale = scale_of(residuals);
    const Normal<6> normal = normal_of<6>(residuals, {Loss::Kind::tukey, kTukey * scale});
    const Eigen::SelfAdjointEigenSolver<Matrix6> eigen(normal.weighted);
    // A turn that noise alone moves by more than half the stone is not determined by its shape.
    Eigen::Index held = 0;
    while (held < 6 && !(scale < 0.5 * frame.arm_mm * std::sqrt(eigen.eigenvalues()(held)))) ++held;
    if (held == 6) return fit;
    const Eigen::MatrixXd kept = eigen.eigenvectors().rightCols(6 - held);
    Vector6 step = -kept * (kept.transpose() * normal.weighted * kept)
                               .ldlt()
                               .solve(kept.transpose() * normal.gradient);
    const Eigen::MatrixXd bread = kept.transpose() * normal.bread * kept;
    const Eigen::MatrixXd inverse = bread.inverse();
    const auto n = static_cast<double>(residuals.size());
    const Eigen::MatrixXd within =
        inverse * (kept.transpose() * normal.meat * kept) * inverse * (n / (n - 6.0));
    const Eigen::VectorXd short_step = kept.transpose() * step;
    sigmas = std::sqrt(std::fmax(0.0, short_step.dot(within.ldlt().solve(short_step))));
    fit.covariance = kept * within * kept.transpose();
    fit.kept = kept;
    if (sigmas < kAtRestSigmas) break;
    // Beams hop between facets, to and fro: halve until the pose rests between.
    if (step.dot(last) < 0.0) damping = std::fmax(0.1, 0.5 * damping);
    last = step;
    step *= damping * std::fmin(1.0, 0.2 * frame.arm_mm / std::fmax(1e-300, step.norm()));
    pose = moved_by(pose, frame, step);
  }
  if (!(sigmas < kNearlySigmas)) return fit;
  fit.actual_from_planned = pose;
  fit.noise_mm = scale_of(residuals);
  for (const Residual& r : residuals) fit.points.push_back(r.point);
  return fit;
}

StoneSizeTerms size_terms(const StoneRanges& seen, const StoneScene& stone,
                          const heightmap::ModelField& ground, const StoneFrame& frame,
                          const StoneFit& fit, const StoneNoise& noise) {
  StoneSizeTerms terms;
  auto residuals = residuals_at(seen, stone, ground, frame, fit.actual_from_planned, noise);
  if (residuals.size() < kLeastRanges) return terms;
  const auto all = normal_of<kAll>(residuals, {Loss::Kind::tukey, kTukey * fit.noise_mm});
  // Of the size's equations what the pose takes goes. Weights, not slopes: about a wrong size those
  // of the rim, which weigh most, are below zero.
  const Eigen::MatrixXd within =
      fit.kept.transpose() * all.weighted.topLeftCorner<6, 6>() * fit.kept;
  Eigen::Matrix<double, 2, kAll> rest = Eigen::Matrix<double, 2, kAll>::Zero();
  rest.leftCols<6>() =
      -all.weighted.bottomLeftCorner<2, 6>() * fit.kept * within.inverse() * fit.kept.transpose();
  rest.rightCols<2>().setIdentity();
  const double weight = 1.0 / (fit.noise_mm * fit.noise_mm);
  const Eigen::Vector2d score = weight * rest * all.gradient;
  const Eigen::Matrix2d bread = weight * rest * all.weighted.rightCols<2>();
  const Eigen::Matrix2d meat = weight * weight * rest * all.meat * rest.transpose();
  terms.score = {score(0), score(1)};
  terms.bread = {bread(0, 0), bread(0, 1), bread(1, 1)};
  terms.meat = {meat(0, 0), meat(0, 1), meat(1, 1)};
  return terms;
}

double chance_of_standing(const StoneRanges& seen, const StoneScene& stone,
                          const heightmap::ModelField& ground, const StoneFrame& frame,
                          const StoneFit& fit, const Matrix6& scan_pose, const StoneNoise& noise) {
  auto residuals = residuals_at(seen, stone, ground, frame, {}, noise);
  if (residuals.size() < kLeastRanges) return 0.0;
  const Normal<6> at_plan = normal_of<6>(residuals, {Loss::Kind::huber, kHuber * fit.noise_mm});
  const Matrix6 variance = at_plan.meat + at_plan.bread * scan_pose * at_plan.bread;
  const Eigen::VectorXd score = fit.kept.transpose() * at_plan.gradient;
  const Eigen::MatrixXd within = fit.kept.transpose() * variance * fit.kept;
  return chi_squared_tail(score.dot(within.ldlt().solve(score)), static_cast<int>(score.size()));
}

}  // namespace maquette::scan::detail
