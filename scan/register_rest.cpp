// SPDX-License-Identifier: GPL-3.0-or-later

// All points until nothing moves, and how sure that is.

#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <Eigen/Dense>

#include "scan/detail/registration_steps.hpp"

namespace maquette::scan::detail {
namespace {

constexpr double kAtRestMm = 1e-6;
constexpr double kAtRestSigmas = 0.01;
constexpr double kNearRestSigmas = 10.0;
constexpr std::ptrdiff_t kFinestBlocks = 256;  // a side; halved down to 16
constexpr int kBlockLevels = 5;

/// The covariance with residuals summed over blocks: of the finest partition whose blocks
/// hold what is correlated, which is where variance stops growing; the largest is taken, if it
/// is larger than chance makes it.
Matrix7 correlated_covariance(std::span<const Vec3> points, const Pose& pose,
                              const Surface& surface, const Frame& frame, const Loss& loss,
                              const Solution& solution, const Sums& sums, const Box3& box) {
  const auto blocks =
      block_meat(points, pose, surface, frame, loss, box, kFinestBlocks, kBlockLevels);
  const double independent = solution.covariance.trace();
  Matrix7 covariance = solution.covariance;
  double largest = 1.0;
  for (std::size_t k = 0; k < blocks.levels.size(); ++k) {
    const auto n = static_cast<double>(blocks.occupied[k]);
    if (n < 100.0) continue;
    const Matrix7 c = sandwich(solution.kept, sums.bread, blocks.levels[k]) * (n / (n - 1.0));
    const double ratio = c.trace() / independent;
    if (ratio > largest && ratio > 1.0 + 4.0 * std::sqrt(2.0 / n)) {
      largest = ratio;
      covariance = c;
    }
  }
  return covariance;
}

void state_covariance(Registration& result, const Matrix7& c, const Frame& frame) {
  for (Eigen::Index i = 0; i < 6; ++i)
    for (Eigen::Index j = 0; j < 6; ++j)
      result.covariance[static_cast<std::size_t>(6 * i + j)] =
          c(i, j) / ((i < 3 ? 1.0 : frame.arm_mm) * (j < 3 ? 1.0 : frame.arm_mm));
  const auto largest = [](const Eigen::Matrix3d& m) {
    return std::sqrt(
        std::fmax(0.0, Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(m).eigenvalues()(2)));
  };
  result.centre_mm = frame.centre_mm;
  result.sigma_translation_mm = largest(c.block<3, 3>(0, 0));
  result.sigma_rotation_rad = largest(c.block<3, 3>(3, 3)) / frame.arm_mm;
  result.sigma_scale = std::sqrt(std::fmax(0.0, c(6, 6))) / frame.arm_mm;
}

}  // namespace

tl::unexpected<Error> too_few(std::size_t count) {
  return fail(kTooFewPoints,
              fmt::format("{} points lie on the design, at least {} are needed; check the pose of "
                          "the scan",
                          count, kLeastPoints));
}

Result<Rest> come_to_rest(std::span<const Vec3> points, const std::vector<Vec3>& some,
                          const Pose& start, const Level& level, const Surface& smooth,
                          const Frame& frame, const RegisterOptions& options,
                          const RunContext& run) {
  Rest r;
  r.pose = start;
  double noise = 0.0, damping = 1.0;
  Vector7 last = Vector7::Zero();
  Matrix7 shape;
  const Surface* surface = level.quick != nullptr ? level.quick : level.surface;
  while (r.iterations < options.most_iterations) {
    if (run.stopped()) return fail(kCancelled, "the registration was cancelled");
    // Later the limit is kept: one that follows the residuals moves the solution and never
    // comes quite to rest.
    if (r.iterations < 2) {
      const Met met = meet(some, r.pose, smooth);
      noise = std::fmax(kLeastScaleMm, robust_scale(met));
      r.loss = {Loss::Kind::tukey, kTukey * noise};
      const Sums sums = accumulate(met, frame, r.loss);
      shape = sums.weighted / sums.weight;
    }
    r.sums = accumulate(points, r.pose, *surface, frame, r.loss);
    if (r.sums.count < kLeastPoints) return too_few(r.sums.count);
    r.solution = solve(r.sums, {noise, level.flat, level.spacing_mm,
                                static_cast<double>(r.sums.count), options.scale, &shape});
    if (r.solution.free.cols() > 3)
      return fail(kUnderDetermined,
                  fmt::format("the points determine only {} of 6 directions (do they lie on a "
                              "line?); undetermined: {}",
                              6 - r.solution.free.cols(),
                              fmt::join(name_directions(r.solution.free, frame), ", ")));
    ++r.iterations;
    run.progress(0.5 + 0.4 * r.iterations / options.most_iterations);
    const double full = r.solution.step.norm();
    // Back and forth over the edges of triangles: halve until it rests between them.
    if (r.solution.step.dot(last) < 0.0 && full > 0.7 * last.norm()) damping *= 0.5;
    last = r.solution.step;
    const Vector7 step = damping * r.solution.step;
    r.pose = moved(r.pose, frame, step);
    if (surface != level.surface) {
      // What is still to go is then less than what the normals differ by.
      if (r.solution.step_sigmas < kNearRestSigmas || full < kAtRestMm) {
        surface = level.surface;
        last.setZero();
        damping = 1.0;
      }
      continue;
    }
    // Where points hop between triangles updates alternate: they have been halved down to
    // nothing, and the full one is below a quarter of its standard deviation.
    if (full < kAtRestMm || r.solution.step_sigmas < kAtRestSigmas ||
        (step.norm() < kAtRestMm && r.solution.step_sigmas < 0.25))
      return r;
  }
  return fail(kNotConverged,
              fmt::format("after {} iterations the pose still moves by {:.3g} mm; give a better "
                          "pose in the file or clean the scan",
                          r.iterations, last.norm()));
}

void state(Registration& result, std::span<const Vec3> points, std::span<const Vec3> some,
           const Rest& rest, const Surface& surface, const Frame& frame) {
  Box3 box;
  for (const Vec3& p : some) box.add(rest.pose.point(p));
  const Matrix7 covariance = correlated_covariance(points, rest.pose, surface, frame, rest.loss,
                                                   rest.solution, rest.sums, box);
  state_covariance(result, covariance, frame);
  const auto n = static_cast<double>(rest.sums.count);
  const double stated = covariance.trace();
  result.effective_points =
      stated > 0.0 ? n * std::fmin(1.0, rest.solution.covariance.trace() / stated) : n;
  result.model_from_scan = rest.pose.rigid;
  result.scale = rest.pose.scale;
  result.rms_after_mm = std::sqrt(rest.sums.square / n);
  result.iterations = rest.iterations;
  result.last_step_sigmas = rest.solution.step_sigmas;
  result.free_directions = name_directions(rest.solution.free, frame);
}

}  // namespace maquette::scan::detail
