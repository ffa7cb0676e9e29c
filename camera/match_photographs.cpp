// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/match_photographs.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "camera/detail/match_level.hpp"

namespace maquette::camera {
namespace {

using detail::MatchLevel;
using detail::NormalEquations;
using detail::Unknowns;

constexpr double kLeastEigenvalue = 1e-9;  ///< of derivatives of unit length
constexpr double kNamed = 0.2;             ///< of a direction of length 1
constexpr double kStepDone = 0.1;          ///< of a standard deviation of independent values
constexpr double kStillWithin = 1.0;       ///< of a standard deviation
constexpr double kUnseen = 0.05;           ///< change of a picture over what is left of its values
constexpr double kStuck = 10.0;            ///< of damping: derivatives say nothing more
constexpr int kFreeSteps = 4;              ///< at the end, whose cost is not asked for
constexpr double kLeastLikeness = 0.5;
constexpr int kTries = 6;  ///< of damping, until no step is better
/// Noise of a rendering is in what is left and in its derivatives: with four samples exposure comes
/// out 0.05 % low on rough terrain, with sixteen 0.02 % high.
constexpr int kLeastSamples = 16;

Result<void> check_photos(const std::vector<MatchPhoto>& photos, const MatchSearch& search,
                          const Lighting& lighting, const MatchOptions& options) {
  const auto wrong = [](const std::string& what) { return fail(kMatchPhotograph, what); };
  for (const MatchPhoto& p : photos) {
    if (p.light.size() != 1 && p.light.size() != 3)
      return wrong(fmt::format("{} has {} bands; one or three are needed", p.name, p.light.size()));
    for (const Grid<float>& band : p.light)
      if (band.cols() != p.camera.width_px || band.rows() != p.camera.height_px)
        return wrong(fmt::format("{} has {} x {} pixels, its camera {} x {}", p.name, band.cols(),
                                 band.rows(), p.camera.width_px, p.camera.height_px));
    if (search.white_balance && p.light.size() != 3)
      return wrong(p.name + " is grey: it says nothing of white balance");
    if (!(p.exposure_scale > 0.0) || !std::isfinite(p.exposure_scale))
      return wrong(
          fmt::format("{}: exposure scale {}; more than 0 expected", p.name, p.exposure_scale));
  }
  if ((search.lamp_position || search.lamp_brightness) && lighting.lamps.empty())
    return wrong("the scene has no lamp to be searched for");
  if (options.finest_px < kCoarsest)
    return wrong(fmt::format("pictures of {} pixels across: at least {} expected",
                             options.finest_px, kCoarsest));
  return {};
}

/// Derivatives of unit length, and what hides in them.
struct Directions {
  Eigen::VectorXd length;
  Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver;

  explicit Directions(const Eigen::MatrixXd& normal)
      : length(normal.diagonal().cwiseMax(1e-300).cwiseSqrt()) {
    const Eigen::VectorXd scale = length.cwiseInverse();
    solver.compute(scale.asDiagonal() * normal * scale.asDiagonal());
  }
  [[nodiscard]] Eigen::MatrixXd inverse() const {
    const Eigen::VectorXd scale = length.cwiseInverse();
    return scale.asDiagonal() * solver.eigenvectors() *
           solver.eigenvalues().cwiseInverse().asDiagonal() * solver.eigenvectors().transpose() *
           scale.asDiagonal();
  }
};

/// What makes up for each other, by name.
Result<void> check_closed(const Eigen::MatrixXd& normal, const std::vector<std::string>& names) {
  for (Eigen::Index i = 0; i < normal.rows(); ++i)
    if (!(normal(i, i) > 0.0))
      return fail(kMatchOpen, fmt::format("the photographs do not depend on {}; leave it out of "
                                          "the search",
                                          names[static_cast<std::size_t>(i)]));
  const Directions directions(normal);
  if (directions.solver.eigenvalues()(0) > kLeastEigenvalue) return {};
  std::vector<std::string> free;
  for (Eigen::Index i = 0; i < normal.rows(); ++i)
    if (std::abs(directions.solver.eigenvectors()(i, 0)) > kNamed)
      free.push_back(names[static_cast<std::size_t>(i)]);
  return fail(kMatchOpen,
              fmt::format("the photographs do not tell {} apart: a change of one makes up for the "
                          "others. Search for fewer of them, or add photographs from other places "
                          "or under other lamps",
                          fmt::join(free, " from ")));
}

struct Step {
  MatchState state;
  Eigen::VectorXd undamped;
  bool better = false;
};

/// One step of Levenberg and Marquardt.
Result<Step> step_from(const MatchLevel& level, const MatchState& state, const NormalEquations& e,
                       const Unknowns& unknowns, double& damping, const RunContext& run) {
  Step step{state, Directions(e.normal).inverse() * e.gradient};
  for (int i = 0; i < kTries; ++i, damping *= 8.0) {
    Eigen::MatrixXd damped = e.normal;
    damped.diagonal() *= 1.0 + damping;
    const Eigen::VectorXd way = Directions(damped).inverse() * e.gradient;
    const MatchState there = unknowns.moved(state, way);
    const auto cost = level.cost(there, run);
    if (!cost && cost.error().code == kCancelled) return tl::unexpected(cost.error());
    if (!cost || !(*cost < e.cost)) continue;  // a camera in the ground is no better, either
    step.state = there;
    step.better = true;
    damping = std::max(1e-9, 0.1 * damping);
    return step;
  }
  return step;
}

/// Covariance of a step's numbers where the level stands.
Eigen::MatrixXd covariance_at(const NormalEquations& e, const detail::ScoreSums& sums) {
  const Eigen::MatrixXd bread = Directions(e.bread).inverse();
  const auto cells = static_cast<double>(sums.cells), unknowns = static_cast<double>(bread.rows());
  const double few = cells / std::max(1.0, cells - unknowns);
  const Eigen::MatrixXd meat = 0.5 * (sums.of_cells + sums.of_cells.transpose());
  return few * bread * meat * bread;
}

class Matcher {
 public:
  Matcher(const PreparedScene& scene, const std::vector<MatchPhoto>& photos,
          const MatchOptions& options, const MatchState& start)
      : scene_(scene),
        photos_(photos),
        options_(options),
        unknowns_(options.search, photos.size()),
        start_(start),
        names_(unknowns_.names(photos)) {}

  Result<PhotographMatch> match(const RunContext& run) {
    if (unknowns_.count() == 0)
      return fail(kMatchPhotograph,
                  "nothing to search for: exposure, exposure_each, white_balance, "
                  "lamp_position, lamp_brightness, pose");
    int width = 0;
    for (const MatchPhoto& p : photos_) width = std::max(width, p.camera.width_px);
    const int finest = detail::factor_for(width, options_.finest_px);
    int factor = std::max(finest, detail::factor_for(width, 2 * kCoarsest - 1));
    PhotographMatch out;
    out.state = start_;
    double share = 0.0;
    for (;; factor /= 2) {
      RenderOptions render = options_.render;
      render.samples_per_pixel = std::max(kLeastSamples, render.samples_per_pixel);
      MatchLevel level(scene_, photos_, unknowns_, render, factor);
      MAQUETTE_TRY_VOID(settle(level, factor == finest, out, run));
      share = 1.0 - 0.7 * (1.0 - share);  // the last takes longest
      run.progress(factor == finest ? 1.0 : share);
      if (factor == finest) return out;
    }
  }

 private:
  Result<void> settle(MatchLevel& level, bool last, PhotographMatch& out, const RunContext& run) {
    double damping = 1e-3;
    for (int i = 0;; ++i) {
      MAQUETTE_TRY_VOID(level.stand_at(out.state, run));
      const NormalEquations e = level.equations();
      MAQUETTE_TRY_VOID(check_closed(e.normal, names_));
      MAQUETTE_TRY(const Step step, step_from(level, out.state, e, unknowns_, damping, run));
      const auto n = static_cast<double>(unknowns_.count());
      const double size = std::sqrt(step.undamped.dot(e.normal * step.undamped) / n);
      ++out.steps;
      out.state = step.state;
      const bool goes_on = step.better && size > kStepDone && damping < kStuck &&
                           (last || e.change_by(step.undamped) > kUnseen);
      if (goes_on && i + 1 < options_.most_steps) continue;
      return last ? finish(level, out, run) : Result<void>{};
    }
  }

  /// Pixels take other samples of the scene wherever the camera stands, so the cost is rough by
  /// what these differ by, and has small hollows beside its lowest place. Where derivatives say
  /// that nothing is left to gain counts, not the hollow: plain steps, of which the one that has
  /// the shortest before it is taken.
  Result<void> finish(MatchLevel& level, PhotographMatch& out, const RunContext& run) {
    MatchState best;
    double shortest = INFINITY, change = INFINITY;
    for (int i = 0; i < kFreeSteps; ++i) {
      MAQUETTE_TRY_VOID(level.stand_at(out.state, run));
      const NormalEquations e = level.equations();
      MAQUETTE_TRY_VOID(check_closed(e.bread, names_));
      const Eigen::VectorXd step = Directions(e.normal).inverse() * e.gradient;
      Eigen::MatrixXd covariance = covariance_at(e, level.scores());
      const double left = std::sqrt(std::max(0.0, step.dot(covariance.ldlt().solve(step))) /
                                    static_cast<double>(unknowns_.count()));
      ++out.steps;
      if (left < shortest) {
        shortest = left;
        change = e.change_by(step);
        best = out.state;
      }
      if (left < kStepDone) break;
      out.state = unknowns_.moved(out.state, step);
    }
    if (!(shortest < kStillWithin) && !(change < kUnseen))
      return fail(kMatchNotConverged,
                  fmt::format("after {} steps the next one would still be {:.2g} standard "
                              "deviations long; start closer, or search for less",
                              out.steps, shortest));
    out.state = best;
    MAQUETTE_TRY_VOID(level.stand_at(out.state, run));
    return conclude(level, out);
  }

  /// The level stands at the result.
  Result<void> conclude(const MatchLevel& level, PhotographMatch& out) {
    const NormalEquations e = level.equations();
    const detail::ScoreSums sums = level.scores();
    Eigen::MatrixXd covariance = covariance_at(e, sums);
    const Eigen::VectorXd left = Directions(e.normal).inverse() * e.gradient;
    const Eigen::VectorXd scattered = covariance.diagonal();
    covariance += left * left.transpose();
    const auto n = static_cast<double>(unknowns_.count());
    const auto alike = level.likeness();
    for (std::size_t p = 0; p < photos_.size(); ++p)
      if (alike[p] < kLeastLikeness)
        return fail(kMatchNotConverged,
                    fmt::format("{} does not look like its rendering (correlation {:.2f}): its "
                                "pose, the lamp or the surface is too far off to start from",
                                photos_[p].name, alike[p]));
    const Eigen::MatrixXd bread = Directions(e.bread).inverse(),
                          single = bread * sums.of_values * bread;
    double share = 0.0;
    for (Eigen::Index i = 0; i < covariance.rows(); ++i)
      share += std::min(1.0, single(i, i) / scattered(i)) / n;
    out.pixels = sums.values;
    out.independent_pixels = share * static_cast<double>(sums.values);
    out.rms_255 = 255.0 * level.scatter();
    out.numbers = unknowns_.numbers(start_, out.state, photos_, covariance);
    for (Eigen::Index i = 0; i < covariance.rows(); ++i) {
      auto& row = out.covariance.emplace_back();
      for (Eigen::Index j = 0; j < covariance.cols(); ++j) row.push_back(covariance(i, j));
    }
    return {};
  }

  const PreparedScene& scene_;
  const std::vector<MatchPhoto>& photos_;
  const MatchOptions& options_;
  Unknowns unknowns_;
  const MatchState& start_;
  std::vector<std::string> names_;
};

}  // namespace

Result<PhotographMatch> match_photographs(const PreparedScene& scene,
                                          const std::vector<MatchPhoto>& photos,
                                          const Lighting& lighting, const Bands& white_balance,
                                          const MatchOptions& options, const RunContext& run) {
  MAQUETTE_TRY_VOID(check_photos(photos, options.search, lighting, options));
  MatchState start{{}, white_balance, lighting, {}};
  for (const MatchPhoto& p : photos) {
    start.exposure_scale.push_back(p.exposure_scale);
    start.model_from_camera.push_back(p.model_from_camera);
  }
  return Matcher(scene, photos, options, start).match(run);
}

}  // namespace maquette::camera
