// SPDX-License-Identifier: GPL-3.0-or-later

// Registration of a cloud to a height field.
//
// 1. On a sample, down the design's pyramid. From several starting levels: coarse levels see
//    far, but where relief is only fine they know nothing; fine levels see sharply, but not
//    far. The start that ends with the smallest robust residual wins.
// 2. If that does not fit: the same from wherever the heights correlate.
// 3. From there with all points until nothing moves; then blocks for the covariance.

#include "scan/register.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <Eigen/Dense>

#include "core/check.hpp"
#include "scan/detail/registration_steps.hpp"

namespace maquette::scan {
namespace {

using detail::Fit;
using detail::Loss;
using detail::Matrix7;
using detail::Pose;
using detail::Pyramid;
using detail::Solution;
using detail::Sums;
using heightmap::ModelField;

constexpr std::size_t kSample = 30'000;
constexpr std::size_t kFewer = 5'000;  // to find the way down the pyramid
constexpr int kFullIterations = 100;
constexpr double kAtRestMm = 1e-6;
constexpr double kAtRestSigmas = 0.01;
constexpr std::size_t kPlaces = 20;
constexpr std::ptrdiff_t kFinestBlocks = 256;  // a side; halved down to 16
constexpr int kBlockLevels = 5;

tl::unexpected<Error> too_few(std::size_t count) {
  return fail(kTooFewPoints,
              fmt::format("{} points lie on the design, at least {} are needed; check the pose of "
                          "the scan",
                          count, detail::kLeastPoints));
}

struct Candidate {
  Pose pose;
  Fit fit;
};

struct Sample {
  std::vector<Vec3> some, fewer;
};

Candidate look_from(const Sample& points, const Pyramid& pyramid, const Pose& start,
                    std::size_t level) {
  Candidate c;
  c.pose = detail::descend(points.fewer, start, pyramid, level);
  c.fit = detail::fit_of(points.some, c.pose, *pyramid.levels[0].surface);
  return c;
}

/// What fits by rule goes before what does not; then the smaller residual.
bool better(const Candidate& a, const Candidate& b, double least_overlap) {
  const bool good_a = a.fit.good(least_overlap), good_b = b.fit.good(least_overlap);
  return good_a != good_b ? good_a : a.fit.noise_mm < b.fit.noise_mm;
}

Candidate capture_near(const Sample& some, const Pyramid& pyramid, const Pose& start,
                       double least_overlap) {
  const std::size_t top = pyramid.levels.size() - 1;
  Candidate best;
  best.pose = start;
  std::size_t last = top + 1;
  for (const std::size_t level : {top, top * 2 / 3, top / 3, std::size_t{0}}) {
    if (level == last) continue;
    last = level;
    const Candidate c = look_from(some, pyramid, start, level);
    if (better(c, best, least_overlap)) best = c;
    if (best.fit.beyond_doubt()) break;
  }
  return best;
}

Candidate capture_anywhere(const Sample& points, std::optional<Vec3> station,
                           const ModelField& design, const Pyramid& pyramid, double least_overlap) {
  Candidate best;
  for (const Pose& start : detail::places_anywhere(points.some, design, station, kPlaces)) {
    const Candidate c = look_from(points, pyramid, start, pyramid.levels.size() - 1);
    if (better(c, best, least_overlap)) best = c;
    if (best.fit.beyond_doubt()) break;
  }
  return best;
}

/// The covariance with residuals summed over blocks: of the finest partition whose blocks
/// hold what is correlated, which is where variance stops growing; the largest is taken, if it
/// is larger than chance makes it.
Matrix7 correlated_covariance(std::span<const Vec3> points, const Pose& pose,
                              const detail::Surface& surface, const detail::Frame& frame,
                              const Loss& loss, const Solution& solution, const Sums& sums,
                              const Box3& box) {
  const auto blocks =
      detail::block_meat(points, pose, surface, frame, loss, box, kFinestBlocks, kBlockLevels);
  const double independent = solution.covariance.trace();
  Matrix7 covariance = solution.covariance;
  double largest = 1.0;
  for (std::size_t k = 0; k < blocks.levels.size(); ++k) {
    const auto n = static_cast<double>(blocks.occupied[k]);
    if (n < 100.0) continue;
    const Matrix7 c =
        detail::sandwich(solution.kept, sums.bread, blocks.levels[k]) * (n / (n - 1.0));
    const double ratio = c.trace() / independent;
    if (ratio > largest && ratio > 1.0 + 4.0 * std::sqrt(2.0 / n)) {
      largest = ratio;
      covariance = c;
    }
  }
  return covariance;
}

tl::unexpected<Error> poor_fit(const Fit& fit, double least_overlap, bool everywhere) {
  const char* remedy = everywhere ? "looked everywhere; is it a scan of another part?"
                                  : "a false minimum or another part; give a better pose";
  if (fit.overlap < least_overlap)
    return fail(kPoorFit, fmt::format("only {:.0f} % of the points come to lie on the design, at "
                                      "least {:.0f} % must: {}",
                                      100.0 * fit.overlap, 100.0 * least_overlap, remedy));
  return fail(kPoorFit, fmt::format("at rest, but only {:.2f} of the design's relief is in the "
                                    "cloud: {}",
                                    std::fmin(fit.likeness, fit.explained), remedy));
}

/// A mirror image that fits where the cloud itself does not.
bool fits_mirrored(Sample points, std::optional<Vec3> station, const ModelField& design,
                   const Pyramid& pyramid, double least_overlap) {
  for (auto* list : {&points.some, &points.fewer})
    for (Vec3& p : *list) p.x = -p.x;
  if (station) station->x = -station->x;
  const Candidate c = capture_anywhere(points, station, design, pyramid, least_overlap);
  return c.fit.good(least_overlap) && c.fit.beyond_doubt();
}

/// All points until nothing moves.
struct Rest {
  Pose pose;
  Sums sums;
  Solution solution;
  Loss loss;
  int iterations = 0;
};
Result<Rest> come_to_rest(std::span<const Vec3> points, const std::vector<Vec3>& some,
                          const Pose& start, const detail::Level& level,
                          const detail::Surface& smooth, const detail::Frame& frame, bool scale,
                          const RunContext& run) {
  Rest r;
  r.pose = start;
  double noise = 0.0, damping = 1.0;
  detail::Vector7 last = detail::Vector7::Zero();
  Matrix7 shape;
  while (r.iterations < kFullIterations) {
    if (run.stopped()) return fail(kCancelled, "the registration was cancelled");
    // Later the limit is kept: one that follows the residuals moves the solution and never
    // comes quite to rest.
    if (r.iterations < 2) {
      const detail::Met met = detail::meet(some, r.pose, smooth);
      noise = std::fmax(detail::kLeastScaleMm, detail::robust_scale(met));
      r.loss = {Loss::Kind::tukey, detail::kTukey * noise};
      const Sums sums = detail::accumulate(met, frame, r.loss);
      shape = sums.weighted / sums.weight;
    }
    r.sums = detail::accumulate(points, r.pose, *level.surface, frame, r.loss);
    if (r.sums.count < detail::kLeastPoints) return too_few(r.sums.count);
    r.solution = detail::solve(r.sums, {noise, level.flat, level.spacing_mm,
                                        static_cast<double>(r.sums.count), scale, &shape});
    if (r.solution.free.cols() > 3)
      return fail(kUnderDetermined,
                  fmt::format("the points determine only {} of 6 directions (do they lie on a "
                              "line?); undetermined: {}",
                              6 - r.solution.free.cols(),
                              fmt::join(detail::name_directions(r.solution.free, frame), ", ")));
    ++r.iterations;
    run.progress(0.5 + 0.4 * r.iterations / kFullIterations);
    const double full = r.solution.step.norm();
    // Back and forth over the edges of triangles: halve until it rests between them.
    if (r.solution.step.dot(last) < 0.0 && full > 0.7 * last.norm()) damping *= 0.5;
    last = r.solution.step;
    const detail::Vector7 step = damping * r.solution.step;
    r.pose = detail::moved(r.pose, frame, step);
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

void state_covariance(Registration& result, const Matrix7& c, const detail::Frame& frame) {
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

Result<Registration> register_scan(const Cloud& cloud, const ModelField& design,
                                   const RegisterOptions& options, const RunContext& run) {
  MAQUETTE_CHECK(design.z_mm.rows() >= 2 && design.z_mm.cols() >= 2, "design of {} x {} nodes",
                 design.z_mm.rows(), design.z_mm.cols());
  if (cloud.points_mm.size() < detail::kLeastPoints) return too_few(cloud.points_mm.size());
  MAQUETTE_TRY_VOID(check_unit(cloud, design));
  const Sample points{detail::sample(cloud.points_mm, kSample),
                      detail::sample(cloud.points_mm, kFewer)};
  const std::vector<Vec3>& some = points.some;
  const Pyramid pyramid(design);
  const detail::Level& level = pyramid.levels[0];
  const Pose given{options.model_from_scan, 1.0};
  const double least = options.least_overlap;

  Registration result;
  const Fit before = detail::fit_of(some, given, *level.surface);
  {
    const auto sums = detail::accumulate(detail::meet(some, given, *level.surface), before.frame,
                                         {Loss::Kind::huber, INFINITY});
    result.rms_before_mm =
        sums.count > 0 ? std::sqrt(sums.square / static_cast<double>(sums.count)) : INFINITY;
  }
  const auto over = static_cast<std::size_t>(before.over * static_cast<double>(some.size()) + 0.5);
  if (!options.anywhere && over < detail::kLeastPoints) return too_few(over);
  Candidate place;
  place.pose = given;
  if (over >= detail::kLeastPoints) place = capture_near(points, pyramid, given, least);
  if (run.stopped()) return fail(kCancelled, "the registration was cancelled");
  run.progress(0.2);
  if (!place.fit.good(least) && options.anywhere) {
    const Candidate other = capture_anywhere(points, cloud.station_mm, design, pyramid, least);
    result.found_anywhere = better(other, place, least);
    if (result.found_anywhere) place = other;
    if (!place.fit.good(least) && fits_mirrored(points, cloud.station_mm, design, pyramid, least))
      return fail(kMirrored,
                  "the scan fits the design only as its mirror image: its frame is left-handed or "
                  "an axis has the wrong sign; negate one axis and try again");
  }
  if (run.stopped()) return fail(kCancelled, "the registration was cancelled");
  if (!place.fit.good(least)) return poor_fit(place.fit, least, options.anywhere);
  run.progress(0.5);

  const detail::SmoothFieldSurface smooth(design);
  MAQUETTE_TRY(const Rest rest, come_to_rest(cloud.points_mm, some, place.pose, level, smooth,
                                             place.fit.frame, options.scale, run));
  const Fit fit = detail::fit_of(some, rest.pose, *level.surface);
  if (!fit.good(least)) return poor_fit(fit, least, options.anywhere);
  Box3 box;
  for (const Vec3& p : some) box.add(rest.pose.point(p));
  const Matrix7 covariance =
      correlated_covariance(cloud.points_mm, rest.pose, *level.surface, place.fit.frame, rest.loss,
                            rest.solution, rest.sums, box);
  state_covariance(result, covariance, place.fit.frame);
  const auto n = static_cast<double>(rest.sums.count);
  const double stated = covariance.trace();
  result.effective_points =
      stated > 0.0 ? n * std::fmin(1.0, rest.solution.covariance.trace() / stated) : n;
  result.model_from_scan = rest.pose.rigid;
  result.scale = rest.pose.scale;
  result.rms_after_mm = std::sqrt(rest.sums.square / n);
  result.noise_mm = fit.noise_mm;
  result.overlap = fit.overlap;
  result.likeness = fit.likeness;
  result.iterations = rest.iterations;
  result.last_step_sigmas = rest.solution.step_sigmas;
  result.free_directions = detail::name_directions(rest.solution.free, place.fit.frame);
  run.progress(1.0);
  return result;
}

double pose_sigma_mm(const Registration& r, Vec3 point, Vec3 normal) {
  const auto j = pose_columns(point, normal, r.centre_mm);
  double variance = 0.0;
  for (std::size_t a = 0; a < 6; ++a)
    for (std::size_t b = 0; b < 6; ++b) variance += j[a] * r.covariance[6 * a + b] * j[b];
  return std::sqrt(std::fmax(0.0, variance));
}

}  // namespace maquette::scan
