// SPDX-License-Identifier: GPL-3.0-or-later

// From a pose that is nearly right to one that is at rest, and how well it fits there.

#include <algorithm>
#include <cmath>
#include <limits>

#include <Eigen/Dense>

#include "scan/detail/registration_steps.hpp"

namespace maquette::scan::detail {

using heightmap::ModelField;

namespace {

constexpr std::ptrdiff_t kCoarsestNodes = 24;  // the pyramid ends before fewer a side
constexpr int kSettleIterations = 20;          // per level
// False minima on rough ground were seen with slopes up to 0.66.
constexpr double kLeastLikeness = 0.8;
// The best place for other ground of the same kind explains up to some 0.7 of its relief.
constexpr double kLeastExplained = 0.9;

/// Means over square blocks, of the residuals (cut off at five times the noise) and of the
/// design without its plane.
void explain(Fit& fit, const Met& met, const Eigen::Vector3d& plane_d) {
  constexpr std::ptrdiff_t kBlocks = 24;
  struct Block {
    double e = 0.0, d = 0.0, n = 0.0;
  };
  std::vector<Block> blocks(kBlocks * kBlocks);
  const double per_mm = static_cast<double>(kBlocks) / (3.5 * fit.frame.arm_mm);
  const auto index = [&](double off) {
    return std::clamp(static_cast<std::ptrdiff_t>(off * per_mm + 0.5 * kBlocks), std::ptrdiff_t{0},
                      kBlocks - 1);
  };
  for (std::size_t i = 0; i < met.feet.size(); ++i) {
    const double e = met.feet[i].e_mm;
    if (std::isnan(e)) continue;
    const Vec3 arm = met.points_mm[i] - fit.frame.centre_mm;
    Block& b = blocks[static_cast<std::size_t>(index(arm.y) * kBlocks + index(arm.x))];
    const double height = arm.z - e / met.feet[i].normal.z;
    b.e += std::clamp(e, -5.0 * fit.noise_mm, 5.0 * fit.noise_mm);
    b.d += height - plane_d.dot(Eigen::Vector3d{arm.x, arm.y, 1.0});
    b.n += 1.0;
  }
  double e2 = 0.0, d2 = 0.0, d1 = 0.0, chance = 0.0, used = 0.0;
  for (const Block& b : blocks) {
    if (b.n < 4.0) continue;
    used += 1.0;
    e2 += (b.e / b.n) * (b.e / b.n);
    d1 += b.d / b.n;
    d2 += (b.d / b.n) * (b.d / b.n);
    chance += fit.noise_mm * fit.noise_mm / b.n;
  }
  fit.explained = 1.0;
  if (used < 4.0) return;
  const double relief = d2 - d1 * d1 / used;
  if (!(relief > 0.0)) return;
  fit.explained = 1.0 - std::fmax(0.0, e2 - chance) / relief;
  fit.explained_sigma = chance * std::sqrt(2.0 / used) / relief;
}

/// Eigenvalues of the mean outer product of J below this are no relief: a slope of 1e-4
/// (0.1 micrometre in a millimetre), or what rounding heights to float makes of a plane.
double flat_eigenvalue(const ModelField& field) {
  const auto range = heightmap::height_range(field.z_mm);
  const float largest = std::fmax(std::abs(range.min), std::abs(range.max));
  const double step =
      static_cast<double>(std::nextafter(largest, INFINITY) - largest) / field.spacing.value();
  return std::fmax(1e-8, 4.0 * step * step);
}

}  // namespace

Matrix7 sandwich(const Eigen::MatrixXd& kept, const Matrix7& bread, const Matrix7& meat) {
  const Eigen::MatrixXd inverse =
      kept * (kept.transpose() * bread * kept).inverse() * kept.transpose();
  return inverse * meat * inverse;
}

Solution solve(const Sums& s, const Certainty& certainty) {
  const auto n = static_cast<double>(s.count);
  const Eigen::Index unknowns = certainty.scale ? 7 : 6;
  const Matrix7 mean = s.weighted / s.weight;
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(Eigen::MatrixXd(
      (certainty.shape != nullptr ? *certainty.shape : mean).topLeftCorner(unknowns, unknowns)));
  Eigen::MatrixXd vectors = Eigen::MatrixXd::Zero(7, unknowns);
  vectors.topRows(unknowns) = eigen.eigenvectors();
  std::vector<Eigen::Index> held, kept;
  for (Eigen::Index k = 0; k < unknowns; ++k) {
    const double value = eigen.eigenvalues()(k);
    const bool certain =
        value >= certainty.flat &&
        certainty.noise_mm / std::sqrt(certainty.independent * value) <= certainty.least_certain_mm;
    (certain ? kept : held).push_back(k);
  }
  Solution result;
  result.free = vectors(Eigen::all, held);
  result.kept = vectors(Eigen::all, kept);
  if (kept.empty()) return result;
  const Eigen::MatrixXd& v = result.kept;
  result.step = -v * (v.transpose() * s.weighted * v).ldlt().solve(v.transpose() * s.gradient);
  result.covariance = sandwich(v, s.bread, s.meat) * (n / std::fmax(1.0, n - 7.0));
  const Eigen::MatrixXd within = v.transpose() * result.covariance * v;
  const Eigen::VectorXd step = v.transpose() * result.step;
  const double square = step.dot(within.ldlt().solve(step));
  result.step_sigmas = square >= 0.0 ? std::sqrt(square) : INFINITY;
  return result;
}

Pose settle(std::span<const Vec3> points, Pose pose, const Level& level) {
  for (int i = 0; i < kSettleIterations; ++i) {
    const Met met = meet(points, pose, *level.surface);
    const Spread spread = spread_of(met);
    if (spread.count < kLeastPoints) break;
    const double noise = std::fmax(kLeastScaleMm, robust_scale(met));
    const Sums s = accumulate(met, spread.frame, {Loss::Kind::huber, kHuber * noise});
    // Residuals at a coarse level are relief that was smoothed away: no more of them are
    // independent than the level has cells.
    Vector7 step = solve(s, {noise, level.flat, level.spacing_mm,
                             std::fmin(static_cast<double>(s.count), level.cells)})
                       .step;
    // Beyond a few cells the linear model says nothing.
    const double length = step.norm();
    step *= std::fmin(1.0, 4.0 * level.spacing_mm / std::fmax(length, 1e-300));
    pose = moved(pose, spread.frame, step);
    if (length < 1e-2 * level.spacing_mm) break;
  }
  return pose;
}

Pyramid::Pyramid(const ModelField& design) {
  const auto smaller_side = [](const ModelField& f) {
    return std::min(f.z_mm.rows(), f.z_mm.cols());
  };
  coarse.reserve(32);  // a field never has 2^32 nodes a side: no reallocation below
  for (const ModelField* f = &design; smaller_side(*f) >= 2 * kCoarsestNodes; f = &coarse.back())
    coarse.push_back(coarser(*f));
  surfaces.reserve(coarse.size() + 1);
  const double flat = flat_eigenvalue(design);
  const auto add = [&](const ModelField& f) {
    surfaces.emplace_back(f);
    levels.push_back({&surfaces.back(), f.spacing.value(),
                      static_cast<double>(f.z_mm.rows() * f.z_mm.cols()), flat});
  };
  add(design);
  for (const ModelField& f : coarse) add(f);
}

Pose descend(std::span<const Vec3> points, Pose pose, const Pyramid& pyramid,
             std::size_t from_level) {
  for (std::size_t level = from_level + 1; level-- > 0;)
    pose = settle(points, pose, pyramid.levels[level]);
  return pose;
}

Fit fit_of(std::span<const Vec3> points, const Pose& pose, const Surface& field) {
  const Met met = meet(points, pose, field);
  const Spread spread = spread_of(met);
  Fit fit;
  fit.frame = spread.frame;
  const auto all = static_cast<double>(points.size());
  fit.over = static_cast<double>(spread.count) / all;
  if (spread.count < kLeastPoints) return fit;
  fit.noise_mm = std::fmax(kLeastScaleMm, robust_scale(met));

  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right_c = Eigen::Vector3d::Zero(), right_d = right_c;
  std::vector<std::size_t> near;
  std::size_t within = 0;
  const auto row = [&](std::size_t i) {
    const Vec3 arm = met.points_mm[i] - spread.frame.centre_mm;
    return Eigen::Vector3d{arm.x, arm.y, 1.0};
  };
  const auto heights = [&](std::size_t i) {
    const double c = met.points_mm[i].z - spread.frame.centre_mm.z;
    return std::array{c, c - met.feet[i].e_mm / met.feet[i].normal.z};
  };
  for (std::size_t i = 0; i < met.feet.size(); ++i) {
    const double e = met.feet[i].e_mm;
    if (!(std::abs(e) <= 5.0 * fit.noise_mm)) continue;
    ++within;
    // Vertically: along the normal, the whole side of a missing stone would be near; and a
    // missing stone must not look like a wrong place.
    if (!(std::abs(e) <= 5.0 * fit.noise_mm * met.feet[i].normal.z)) continue;
    near.push_back(i);
    const auto [c, d] = heights(i);
    normal += row(i) * row(i).transpose();
    right_c += c * row(i);
    right_d += d * row(i);
  }
  fit.overlap = static_cast<double>(within) / all;
  const Eigen::Vector3d plane_c = normal.ldlt().solve(right_c);
  const Eigen::Vector3d plane_d = normal.ldlt().solve(right_d);
  double dd = 0.0, cd = 0.0;
  for (const std::size_t i : near) {
    const auto [c, d0] = heights(i);
    const double d = d0 - plane_d.dot(row(i));
    dd += d * d;
    cd += (c - plane_c.dot(row(i))) * d;
  }
  explain(fit, met, plane_d);
  fit.likeness = dd > 0.0 ? cd / dd : 1.0;
  fit.likeness_sigma = dd > 0.0 ? fit.noise_mm / std::sqrt(dd) : 0.0;
  fit.relief_mm = near.empty() ? 0.0 : std::sqrt(dd / static_cast<double>(near.size()));
  return fit;
}

bool Fit::good(double least_overlap) const {
  return overlap >= least_overlap && likeness >= kLeastLikeness - 3.0 * likeness_sigma &&
         explained >= kLeastExplained - 3.0 * explained_sigma;
}

bool Fit::beyond_doubt() const {
  return overlap >= 0.7 && std::abs(likeness - 1.0) < 0.1 && explained > 0.98;
}

}  // namespace maquette::scan::detail
