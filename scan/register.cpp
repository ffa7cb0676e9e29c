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
#include "scan/detail/noise_model.hpp"
#include "scan/detail/registration_steps.hpp"

namespace maquette::scan {
namespace {

using detail::Fit;
using detail::Pose;
using detail::Pyramid;
using heightmap::ModelField;

constexpr std::size_t kSample = 30'000;
constexpr std::size_t kFewer = 5'000;  // to find the way down the pyramid
constexpr std::size_t kPlaces = 20;
// Weights that differ by less gain less than 4 % of the pose's standard deviation.
constexpr double kWorthWeights = 1.5;

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

}  // namespace

Result<Registration> register_scan(const Cloud& cloud, const ModelField& design,
                                   const RegisterOptions& options, const RunContext& run) {
  MAQUETTE_CHECK(design.z_mm.rows() >= 2 && design.z_mm.cols() >= 2, "design of {} x {} nodes",
                 design.z_mm.rows(), design.z_mm.cols());
  if (cloud.points_mm.size() < detail::kLeastPoints) return detail::too_few(cloud.points_mm.size());
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
                                         {detail::Loss::Kind::huber, INFINITY});
    result.rms_before_mm =
        sums.count > 0 ? std::sqrt(sums.square / static_cast<double>(sums.count)) : INFINITY;
  }
  const auto over = static_cast<std::size_t>(before.over * static_cast<double>(some.size()) + 0.5);
  if (!options.anywhere && over < detail::kLeastPoints) return detail::too_few(over);
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
  // Seen from a known place, points count by their own noise.
  std::optional<detail::NoiseModel> noise;
  if (cloud.station_mm)
    noise.emplace(detail::meet(some, place.pose, *level.surface),
                  place.pose.point(*cloud.station_mm));
  const bool weighted = noise && noise->spread() > kWorthWeights;
  std::optional<detail::WeightedSurface> own, own_facets;
  // No part has facets: what lies between nodes otherwise than they do (ridges between passes,
  // creases that the ball fills) pulls at their normals, and hardly at smooth ones. A simulated cut
  // came to lie 0.0017 mm off by its facets' normals, 0.0003 by smooth ones.
  detail::Level finest = level;
  finest.surface = &smooth;
  finest.quick = level.surface;
  if (weighted) {
    finest.surface = &own.emplace(smooth, *noise);
    finest.quick = &own_facets.emplace(*level.surface, *noise);
  }
  MAQUETTE_TRY(const detail::Rest rest,
               detail::come_to_rest(cloud.points_mm, some, place.pose, finest, *finest.surface,
                                    place.fit.frame, options, run));
  const Fit fit = detail::fit_of(some, rest.pose, *level.surface);
  if (!fit.good(least)) return poor_fit(fit, least, options.anywhere);
  detail::state(result, cloud.points_mm, some, rest, *finest.surface, place.fit.frame);
  result.noise_mm = fit.noise_mm;
  result.overlap = fit.overlap;
  result.likeness = fit.likeness;
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
