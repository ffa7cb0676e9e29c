// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/vignetting_fit.hpp"

#include <algorithm>
#include <cmath>
#include <map>

#include <ceres/ceres.h>
#include <fmt/format.h>
#include <Eigen/Dense>

#include "camera/detail/normal_matrix.hpp"
#include "camera/detail/quiet_ceres.hpp"

namespace maquette::camera {
namespace {

constexpr double kClippedShare = 1e-3;

/// Relative distance of a block from the law.
struct BlockMiss {
  const Shot* shot;
  double cosine_power = 4.0;
  bool barrel = false;
  FlatBlock block;
  double across = 0.0, down = 0.0;  ///< place, -1/2 to 1/2 over the picture

  bool operator()(const double* level, const double* slope, const double* law, double* miss) const {
    Vignetting v;
    v.cosine_power = cosine_power;
    if (barrel) {
      // Differences are taken across the bounds, too.
      v.barrel_ratio = std::max(1.0, law[0]), v.barrel_shift = std::max(0.0, law[1]);
    } else {
      v.polynomial = {law[0], law[1], law[2]};
    }
    const double light = fall_of_light(v, *shot, block.middle_px);
    *miss = *level * (1.0 + slope[0] * across + slope[1] * down) * light / block.light_dn - 1.0;
    return true;
  }
};

struct Unknowns {
  std::map<std::pair<int, int>, double> level;  ///< by flat and plane
  std::map<int, std::array<double, 2>> slope;   ///< by flat
  std::array<double, 3> law{};
};

void build(ceres::Problem& problem, Unknowns& x, const std::vector<FlatBlock>& blocks,
           const Shot& shot, bool barrel, double cosine_power) {
  const Intrinsics& k = shot.intrinsics;
  for (const FlatBlock& b : blocks) {
    auto* miss = new BlockMiss{&shot,
                               cosine_power,
                               barrel,
                               b,
                               b.middle_px.x / k.width_px - 0.5,
                               b.middle_px.y / k.height_px - 0.5};
    problem.AddResidualBlock(
        new ceres::NumericDiffCostFunction<BlockMiss, ceres::CENTRAL, 1, 1, 2, 3>(miss), nullptr,
        &x.level[{b.flat, b.plane}], x.slope[b.flat].data(), x.law.data());
  }
  if (barrel) {
    problem.SetManifold(x.law.data(), new ceres::SubsetManifold(3, {2}));
    problem.SetParameterLowerBound(x.law.data(), 0, 1.0);
    problem.SetParameterLowerBound(x.law.data(), 1, 0.0);
  }
}

double solve(Unknowns& x, const std::vector<FlatBlock>& blocks, const Shot& shot, bool barrel,
             double cosine_power) {
  ceres::Problem problem;
  build(problem, x, blocks, shot, barrel, cosine_power);
  detail::quiet_ceres();
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_NORMAL_CHOLESKY;
  options.max_num_iterations = 200;
  options.function_tolerance = 1e-14;
  options.num_threads = 1;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  return summary.IsSolutionUsable() ? summary.final_cost : INFINITY;
}

}  // namespace

Result<std::vector<FlatBlock>> flat_blocks(const FrameSeries& s, const FrameSeries* dark,
                                           double black_dn, int flat, std::ptrdiff_t side) {
  const std::ptrdiff_t rows = s.mean_dn.rows(), cols = s.mean_dn.cols();
  const double values = static_cast<double>(rows * cols) * s.frames;
  std::size_t most = 0;
  for (const std::size_t n : s.at_most) most += n;
  if (static_cast<double>(most) > kClippedShare * values)
    return fail(kCalibrationFrames,
                fmt::format("flat {}: {:.1f} % of its values are at the converter's end; take it "
                            "with less light",
                            flat + 1, 100.0 * static_cast<double>(most) / values));
  std::vector<FlatBlock> blocks;
  const std::ptrdiff_t step = s.planes == 1 ? 1 : 2;
  for (int plane = 0; plane < s.planes; ++plane)
    for (std::ptrdiff_t top = 0; top < rows; top += side)
      for (std::ptrdiff_t left = 0; left < cols; left += side) {
        double light = 0.0, x = 0.0, y = 0.0, n = 0.0;
        for (std::ptrdiff_t r = top + plane / 2; r < std::min(top + side, rows); r += step)
          for (std::ptrdiff_t c = left + plane % 2; c < std::min(left + side, cols); c += step) {
            const double black =
                dark != nullptr ? static_cast<double>(dark->mean_dn(r, c)) : black_dn;
            light += static_cast<double>(s.mean_dn(r, c)) - black;
            x += static_cast<double>(c) + 0.5, y += static_cast<double>(r) + 0.5, n += 1.0;
          }
        if (n < 1.0) continue;
        if (!(light > 0.0))
          return fail(kCalibrationFrames,
                      fmt::format("flat {}: no light over black around row {:.0f}, column {:.0f}; "
                                  "an evenly lit surface over the whole picture is needed",
                                  flat + 1, y / n, x / n));
        blocks.push_back({flat, plane, {x / n, y / n}, light / n});
      }
  return blocks;
}

Result<VignettingFit> fit_vignetting(const std::vector<FlatBlock>& blocks, const Shot& shot,
                                     const std::string& law, double cosine_power) {
  if (law != "polynomial" && law != "barrel")
    return fail(kEffectOutOfRange,
                fmt::format("vignetting.law is \"{}\"; polynomial or barrel is possible", law));
  const bool barrel = law == "barrel";
  constexpr std::size_t kFewest = 50;
  if (blocks.size() < kFewest)
    return fail(kCalibrationFrames,
                fmt::format("flats of {} blocks; at least {} are needed", blocks.size(), kFewest));
  Unknowns start;
  for (const FlatBlock& b : blocks) {
    double& level = start.level[{b.flat, b.plane}];
    level = std::max(level, b.light_dn);
    start.slope[b.flat] = {0.0, 0.0};
  }
  Unknowns best = start;
  double least = INFINITY;
  const double corner =
      0.5 * std::hypot(shot.intrinsics.width_px, shot.intrinsics.height_px) / shot.intrinsics.fx_px;
  if (barrel) {
    // A barrel cuts only from some radius on: within it there is no slope to follow.
    for (const double ratio : {1.05, 1.3, 1.8, 2.5})
      for (const double cut : {0.3, 0.8, 1.3}) {
        Unknowns x = start;
        x.law = {ratio, (ratio - 1.0 + cut) / corner, 0.0};
        const double cost = solve(x, blocks, shot, true, cosine_power);
        if (cost < least) least = cost, best = x;
      }
  } else {
    least = solve(best, blocks, shot, false, cosine_power);
  }
  if (!std::isfinite(least))
    return fail(kCalibrationFrames, "the fall of light in the flats has no solution");

  ceres::Problem problem;
  build(problem, best, blocks, shot, barrel, cosine_power);
  ceres::Problem::EvaluateOptions options;
  options.parameter_blocks = {best.law.data()};
  for (auto& [key, level] : best.level) options.parameter_blocks.push_back(&level);
  for (auto& [key, slope] : best.slope) options.parameter_blocks.push_back(slope.data());
  ceres::CRSMatrix jacobian;
  VignettingFit out;
  problem.Evaluate(options, nullptr, &out.off, nullptr, &jacobian);
  const detail::NormalMatrix normal(jacobian);
  if (!normal.tells_all())
    return fail(kCalibrationFrames,
                fmt::format("the flats do not decide the parameters of the law '{}': {}", law,
                            barrel ? "the barrel cuts nothing there; take law = \"polynomial\""
                                   : "take flats that fill the picture"));
  const Eigen::MatrixXd inverse = normal.inverse();
  double square = 0.0;
  for (const double v : out.off) square += v * v;
  const double variance =
      square / (static_cast<double>(blocks.size()) - static_cast<double>(jacobian.num_cols));
  out.rms = std::sqrt(square / static_cast<double>(blocks.size()));
  out.vignetting.cosine_power = cosine_power;
  const std::size_t count = barrel ? 2 : 3;
  for (std::size_t i = 0; i < count; ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    out.parameters.push_back({best.law[i], std::sqrt(variance * inverse(k, k)) * normal.scale(k)});
  }
  if (barrel)
    out.vignetting.barrel_ratio = best.law[0], out.vignetting.barrel_shift = best.law[1];
  else
    out.vignetting.polynomial = {best.law[0], best.law[1], best.law[2]};
  for (const auto& [flat, slope] : best.slope) out.slopes.push_back({slope[0], slope[1]});
  return out;
}

}  // namespace maquette::camera
