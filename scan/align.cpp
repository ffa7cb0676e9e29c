// SPDX-License-Identifier: GPL-3.0-or-later

// Registration of a cloud to a height field.
//
// 1. The design's pyramid. From several starting levels, Gauss-Newton on a sample of
//    the points goes down to the full design; the start that ends with the smallest
//    robust residual wins (coarse levels see far, but where relief is only fine they
//    know nothing; fine levels see sharply, but not far).
// 2. From there with all points until nothing moves.

#include <algorithm>
#include <cmath>
#include <limits>

#include <fmt/format.h>
#include <Eigen/Eigenvalues>

#include "core/check.hpp"
#include "core/random.hpp"
#include "scan/detail/point_to_plane.hpp"
#include "scan/deviate.hpp"

namespace maquette::scan {
namespace {

using detail::Frame6;
using detail::Matrix6;
using detail::Sums;
using detail::Vector6;
using heightmap::ModelField;

constexpr std::size_t kLeastPoints = 30;
constexpr std::size_t kSample = 30'000;
constexpr std::ptrdiff_t kCoarsestNodes = 24;  // the pyramid ends before fewer a side
constexpr int kSampleIterations = 20;          // per level
constexpr int kFullIterations = 60;
// Huber's 95 % efficiency at the normal distribution, in standard deviations.
constexpr double kHuber = 1.345;
// Below any height step of a float field; keeps the Huber threshold above zero when cloud
// and design agree exactly.
constexpr double kLeastScaleMm = 1e-5;
constexpr double kAtRestMm = 1e-6;

/// One point out of each of m equal stretches of the cloud, at a random place in it: a
/// fixed stride would fall into step with the scan lines.
std::vector<Vec3> sample(const std::vector<Vec3>& points, std::size_t m) {
  if (points.size() <= m) return points;
  std::vector<Vec3> some(m);
  for (std::size_t k = 0; k < m; ++k) {
    const std::size_t first = k * points.size() / m, end = (k + 1) * points.size() / m;
    some[k] = points[first + random_bits(0x5ca1ab1e, k) % (end - first)];
  }
  return some;
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

struct Solution {
  Vector6 step = Vector6::Zero();        ///< full update, unknowns of Frame6
  double step_sigma_mm = 0.0;            ///< standard deviation along that update
  Eigen::MatrixXd free;                  ///< columns: directions that are held
  Matrix6 covariance = Matrix6::Zero();  ///< of the unknowns
};

/// @param noise_mm       for the decision what is determined
/// @param least_certain  a direction with a larger standard deviation is held, mm
Solution solve(const Sums& s, double noise_mm, double flat, double least_certain_mm,
               double independent) {
  const auto n = static_cast<double>(s.count);
  const Eigen::SelfAdjointEigenSolver<Matrix6> eigen(s.weighted / s.weight);
  Solution result;
  std::vector<Eigen::Index> held, kept;
  for (Eigen::Index k = 0; k < 6; ++k) {
    const double value = eigen.eigenvalues()(k);
    const bool certain =
        value >= flat && noise_mm / std::sqrt(independent * value) <= least_certain_mm;
    (certain ? kept : held).push_back(k);
  }
  result.free = eigen.eigenvectors()(Eigen::all, held);
  const Eigen::MatrixXd basis = eigen.eigenvectors()(Eigen::all, kept);
  for (const Eigen::Index k : kept) {
    const Vector6 v = eigen.eigenvectors().col(k);
    result.step -= v * (v.dot(s.gradient) / (eigen.eigenvalues()(k) * s.weight));
  }

  // Huber and Ronchetti 2009, section 7.6: A^-1 B A^-1 with A = sum psi' J J' and
  // B = sum psi^2 J J', here within the directions that are determined.
  const Eigen::MatrixXd inverse =
      basis * (basis.transpose() * s.bread * basis).inverse() * basis.transpose();
  result.covariance = inverse * s.meat * inverse * (n / std::fmax(1.0, n - 6.0));
  const double length = result.step.norm();
  if (length > 0.0)
    result.step_sigma_mm =
        std::sqrt(std::fmax(0.0, result.step.dot(result.covariance * result.step))) / length;
  return result;
}

RigidTransform moved(const RigidTransform& pose, const Frame6& frame, const Vector6& step) {
  const Vec3 turn{step(3) / frame.arm_mm, step(4) / frame.arm_mm, step(5) / frame.arm_mm};
  const double angle = norm(turn);
  RigidTransform update;
  if (angle > 0.0) update.rotation = rotation_about((1.0 / angle) * turn, angle);
  const Vec3 c = frame.centre_mm;
  update.translation_mm = c - rotate(update.rotation, c) + Vec3{step(0), step(1), step(2)};
  RigidTransform result = update * pose;
  result.rotation = normalized(result.rotation);
  return result;
}

/// Iterates on a sample at one level until the steps are small against the spacing.
RigidTransform settle(const std::vector<Vec3>& points, RigidTransform pose, const ModelField& field,
                      double flat) {
  const double spacing = field.spacing.value();
  for (int i = 0; i < kSampleIterations; ++i) {
    const auto spread = detail::spread_on(points, pose, field);
    if (spread.count < kLeastPoints) break;
    const double scale = std::fmax(kLeastScaleMm, detail::robust_scale(points, pose, field));
    const Sums s = detail::accumulate(points, pose, field, spread.frame, kHuber * scale);
    // Residuals at a coarse level are relief that was smoothed away: no more of them are
    // independent than the level has cells.
    const double cells = static_cast<double>(field.z_mm.rows() * field.z_mm.cols());
    Vector6 step =
        solve(s, scale, flat, spacing, std::fmin(static_cast<double>(s.count), cells)).step;
    // Beyond a few cells the linear model says nothing.
    step *= std::fmin(1.0, 4.0 * spacing / std::fmax(step.norm(), 1e-300));
    pose = moved(pose, spread.frame, step);
    if (step.norm() < 1e-3 * spacing) break;
  }
  return pose;
}

struct Candidate {
  RigidTransform pose;
  double scale = INFINITY;
};

/// Tries several starting levels; the best end on the full design wins.
Result<RigidTransform> capture(const std::vector<Vec3>& points, const ModelField& design,
                               double flat, const RunContext& run) {
  std::vector<ModelField> coarse;  // level 1, 2, ...
  const auto smaller_side = [](const ModelField& f) {
    return std::min(f.z_mm.rows(), f.z_mm.cols());
  };
  for (const ModelField* f = &design; smaller_side(*f) >= 2 * kCoarsestNodes; f = &coarse.back())
    coarse.push_back(detail::coarser(*f));
  Candidate best;
  const std::size_t levels = coarse.size();
  std::size_t last_start = std::numeric_limits<std::size_t>::max();
  for (const std::size_t start : {levels, levels * 2 / 3, levels / 3, std::size_t{0}}) {
    if (start == last_start) continue;
    last_start = start;
    if (run.stopped()) return fail(kCancelled, "the registration was cancelled");
    Candidate c;
    for (std::size_t level = start; level > 0; --level)
      c.pose = settle(points, c.pose, coarse[level - 1], flat);
    c.pose = settle(points, c.pose, design, flat);
    if (detail::spread_on(points, c.pose, design).count >=
        std::max(kLeastPoints, detail::spread_on(points, {}, design).count / 2))
      c.scale = detail::robust_scale(points, c.pose, design);
    if (c.scale < best.scale) best = c;
  }
  return best.pose;
}

/// Does the cloud's relief follow the design's? The slope of the regression of the
/// cloud's heights on the design's, both without their mean plane. At the right place it
/// is 1 whatever the noise (all noise is in the cloud); at a false minimum two grounds of
/// one kind lie on each other that have little in common. Outliers beyond five times the
/// residuals' spread are left out: a missing stone must not look like a wrong place.
struct Likeness {
  double slope = 1.0;
  double sigma = 0.0;  ///< standard deviation of the slope
};

Likeness likeness(const std::vector<Vec3>& points, const RigidTransform& pose,
                  const ModelField& design, double noise_mm) {
  std::vector<Eigen::Vector3d> at;  // x, y, 1
  std::vector<double> cloud_z, design_z;
  const Vec3 centre = detail::spread_on(points, pose, design).frame.centre_mm;
  for (const Vec3& q : points) {
    const Vec3 p = pose.point(q);
    const double h = heightmap::height_at(design, p.x, p.y);
    // Vertically: along the normal, the whole side of a missing stone would be near.
    if (!(std::abs(p.z - h) <= 5.0 * noise_mm)) continue;
    at.emplace_back(p.x - centre.x, p.y - centre.y, 1.0);
    cloud_z.push_back(p.z - centre.z);
    design_z.push_back(h - centre.z);
  }
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right_c = Eigen::Vector3d::Zero(), right_d = right_c;
  for (std::size_t i = 0; i < at.size(); ++i) {
    normal += at[i] * at[i].transpose();
    right_c += cloud_z[i] * at[i];
    right_d += design_z[i] * at[i];
  }
  const Eigen::Vector3d plane_c = normal.ldlt().solve(right_c);
  const Eigen::Vector3d plane_d = normal.ldlt().solve(right_d);
  double dd = 0.0, cd = 0.0;
  for (std::size_t i = 0; i < at.size(); ++i) {
    const double d = design_z[i] - plane_d.dot(at[i]);
    dd += d * d;
    cd += (cloud_z[i] - plane_c.dot(at[i])) * d;
  }
  if (!(dd > 0.0)) return {};
  return {cd / dd, noise_mm / std::sqrt(dd)};
}

/// False minima on rough ground were seen with slopes up to 0.66.
constexpr double kLeastSlope = 0.8;

tl::unexpected<Error> too_few(std::size_t count) {
  return fail(kTooFewPoints,
              fmt::format("{} points lie on the design, at least {} are needed; check the pose of "
                          "the scan",
                          count, kLeastPoints));
}

}  // namespace

Result<Alignment> align(const Cloud& cloud, const ModelField& design, const RunContext& run) {
  MAQUETTE_CHECK(design.z_mm.rows() >= 2 && design.z_mm.cols() >= 2, "design of {} x {} nodes",
                 design.z_mm.rows(), design.z_mm.cols());
  if (cloud.points_mm.size() < kLeastPoints) return too_few(cloud.points_mm.size());
  MAQUETTE_TRY_VOID(check_unit(cloud, design));
  const std::vector<Vec3> some = sample(cloud.points_mm, kSample);
  if (const auto s = detail::spread_on(some, {}, design); s.count < kLeastPoints)
    return too_few(s.count);

  Alignment result;
  const double flat = flat_eigenvalue(design);
  MAQUETTE_TRY(RigidTransform pose, capture(some, design, flat, run));
  run.progress(0.5);

  const auto& points = cloud.points_mm;
  Frame6 frame = detail::spread_on(some, pose, design).frame;
  {
    const Sums before = detail::accumulate(points, {}, design, frame, INFINITY);
    result.rms_before_mm = std::sqrt(before.square / static_cast<double>(before.count));
  }
  double scale = 0.0, damping = 1.0, last_step = INFINITY;
  Sums sums;
  Solution solution;
  for (result.iterations = 0; result.iterations < kFullIterations && !result.converged;) {
    if (run.stopped()) return fail(kCancelled, "the registration was cancelled");
    // Later the threshold is kept: a threshold that follows the residuals moves the
    // solution and never comes quite to rest.
    if (result.iterations < 2)
      scale = std::fmax(kLeastScaleMm, detail::robust_scale(some, pose, design));
    sums = detail::accumulate(points, pose, design, frame, kHuber * scale);
    if (sums.count < kLeastPoints) return too_few(sums.count);
    solution = solve(sums, scale, flat, design.spacing.value(), static_cast<double>(sums.count));
    if (solution.free.cols() > 3)
      return fail(kUnderDetermined,
                  fmt::format("the points determine only {} of 6 directions (do they lie on a "
                              "line?); undetermined: {}",
                              6 - solution.free.cols(),
                              fmt::join(detail::name_directions(solution.free), ", ")));
    ++result.iterations;
    run.progress(0.5 + 0.5 * result.iterations / kFullIterations);
    const double full = solution.step.norm();
    if (result.iterations > 3 && full > 0.7 * last_step) damping *= 0.5;
    last_step = full;
    const Vector6 step = damping * solution.step;
    pose = moved(pose, frame, step);
    result.converged =
        full < kAtRestMm || (step.norm() < kAtRestMm && full < 0.25 * solution.step_sigma_mm);
  }
  if (!result.converged)
    return fail(kNotConverged,
                fmt::format("after {} iterations the pose still moves by {:.3g} mm; give a better "
                            "pose in the file or clean the scan",
                            result.iterations, last_step));
  sums = detail::accumulate(points, pose, design, frame, kHuber * scale);
  result.noise_mm = std::fmax(kLeastScaleMm, detail::robust_scale(some, pose, design));
  if (const Likeness l = likeness(some, pose, design, result.noise_mm);
      l.slope < kLeastSlope - 3.0 * l.sigma)
    return fail(kNotConverged,
                fmt::format("at rest, but the cloud shows only {:.2f} of the design's relief: a "
                            "false minimum or another part; give a better pose in the file",
                            l.slope));

  result.model_from_scan = pose;
  result.rms_after_mm = std::sqrt(sums.square / static_cast<double>(sums.count));
  result.centre_mm = frame.centre_mm;
  result.free_directions = detail::name_directions(solution.free);
  for (Eigen::Index i = 0; i < 6; ++i)
    for (Eigen::Index j = 0; j < 6; ++j)
      result.covariance[static_cast<std::size_t>(6 * i + j)] =
          solution.covariance(i, j) / ((i < 3 ? 1.0 : frame.arm_mm) * (j < 3 ? 1.0 : frame.arm_mm));
  const auto largest = [](const Eigen::Matrix3d& m) {
    return std::sqrt(
        std::fmax(0.0, Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(m).eigenvalues()(2)));
  };
  result.sigma_translation_mm = largest(solution.covariance.topLeftCorner<3, 3>());
  result.sigma_rotation_rad = largest(solution.covariance.bottomRightCorner<3, 3>()) / frame.arm_mm;
  run.progress(1.0);
  return result;
}

}  // namespace maquette::scan
