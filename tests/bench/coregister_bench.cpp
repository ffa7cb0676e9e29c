// SPDX-License-Identifier: GPL-3.0-or-later

// Alignment of known surfaces beside Ceres: the same cells, interpolation, slopes and Tukey's loss,
// but as the minimum of a sum over residuals, which starts half a cell from the truth. Errors
// and CPU seconds; ours finds its start and states its covariance in that time as well.

#include <array>
#include <memory>
#include <vector>

#include <ceres/ceres.h>
#include <fmt/format.h>

#include "heightmap/detail/coregister.hpp"
#include "heightmap/detail/surface_pair.hpp"
#include "support/bench_times.hpp"
#include "support/moved_relief.hpp"

namespace {

using namespace maquette;
using namespace maquette::testing_support;
using namespace maquette::heightmap::detail;

/// Lower less upper at one cell. Unknowns, in cells and metres: where the upper is looked up,
/// height, tilt.
class HeightDifference final : public ceres::SizedCostFunction<1, 5> {
 public:
  HeightDifference(const SurfacePair& pair, std::ptrdiff_t row, std::ptrdiff_t col)
      : pair_(&pair), row_(row), col_(col) {}
  bool Evaluate(double const* const* at, double* residual, double** jacobian) const override {
    const double* v = at[0];
    const auto r = static_cast<double>(row_), c = static_cast<double>(col_);
    const double x = c + 0.5 - 0.5 * static_cast<double>(pair_->lower.cols()),
                 y = r + 0.5 - 0.5 * static_cast<double>(pair_->lower.rows());
    auto [z, gx, gy] = height_and_gradient(pair_->upper, c + v[0], r + v[1]);
    const bool common = !std::isnan(z);
    residual[0] =
        common ? static_cast<double>(pair_->lower(row_, col_)) - z - v[2] - v[3] * x - v[4] * y
               : 0.0;
    if (jacobian == nullptr || jacobian[0] == nullptr) return true;
    const std::array<double, 5> row{-gx, -gy, -1.0, -x, -y};
    for (std::size_t i = 0; i < 5; ++i) jacobian[0][i] = common ? row[i] : 0.0;
    return true;
  }

 private:
  const SurfacePair* pair_;
  std::ptrdiff_t row_, col_;
};

/// One minimisation; the loss' width is that of the residuals where it starts.
void minimise(const SurfacePair& pair, double* unknowns) {
  std::vector<double> residuals;
  std::vector<std::unique_ptr<HeightDifference>> terms;
  for (std::ptrdiff_t r = 0; r < pair.lower.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < pair.lower.cols(); ++c) {
      if (std::isnan(pair.lower(r, c))) continue;
      auto term = std::make_unique<HeightDifference>(pair, r, c);
      double e = 0.0;
      term->Evaluate(&unknowns, &e, nullptr);
      if (e == 0.0) continue;  // not common
      residuals.push_back(e);
      terms.push_back(std::move(term));
    }
  ceres::TukeyLoss loss(kTukey * std::max(pair.least_spread_m, spread_of(residuals).nmad));
  ceres::Problem::Options ours;
  ours.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ceres::Problem problem(ours);
  for (auto& term : terms) problem.AddResidualBlock(term.release(), &loss, unknowns);
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_NORMAL_CHOLESKY;
  options.num_threads = 2;
  options.function_tolerance = options.parameter_tolerance = 1e-10;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
}

/// Shift in metres.
std::array<double, 2> by_ceres(const Grid<float>& lower, const Grid<float>& upper, double lower_px,
                               double upper_px, const Truth& truth) {
  SurfacePair pair = cells_of(lower, upper, 1.0, std::max(lower_px, upper_px));
  bring_to_one_resolution(pair, lower_px, upper_px);
  const auto m = static_cast<double>(pair.nodes);
  std::array<double, 5> v{-truth.east / m + 0.3, -truth.north / m - 0.4, truth.up,
                          truth.tilt_east * m, truth.tilt_north * m};
  for (int round = 0; round < 3; ++round) minimise(pair, v.data());
  return {-v[0] * m, -v[1] * m};
}

struct Kind {
  const char* name;
  double pixel, lower_noise_m, upper_noise_m;
  std::ptrdiff_t nodes;
  std::uint64_t seeds;
};

void compare(const Kind& k) {
  double ours_px2 = 0.0, ceres_px2 = 0.0, ours_s = 0.0, ceres_s = 0.0, n = 0.0;
  for (std::uint64_t seed = 1; seed <= k.seeds; ++seed) {
    const Ground& g = kGrounds[seed % 3];
    const WaveRelief relief(seed, g.hurst, g.roughness, g.directions_rad);
    const Truth truth = drawn(100 * seed, 3.0);
    const Grid<float> upper = seen(relief, k.nodes, truth, k.upper_noise_m, 300 + seed);
    const Grid<float> lower =
        k.pixel > 1.0
            ? seen_coarsely(relief, k.nodes, static_cast<int>(k.pixel), k.lower_noise_m, 200 + seed)
            : seen(relief, k.nodes, {}, k.lower_noise_m, 200 + seed);
    double start = cpu_seconds();
    const auto found = coregister(lower, upper, 1.0, k.pixel, 1.0);
    if (!found || !found->horizontal) continue;
    ours_s += cpu_seconds() - start;
    start = cpu_seconds();
    const auto peer = by_ceres(lower, upper, k.pixel, 1.0, truth);
    ceres_s += cpu_seconds() - start;
    const auto px2 = [&](double east, double north) {
      return 0.5 * (std::pow(east - truth.east, 2.0) + std::pow(north - truth.north, 2.0)) /
             (k.pixel * k.pixel);
    };
    ours_px2 += px2(found->east_m, found->north_m);
    ceres_px2 += px2(peer[0], peer[1]);
    n += 1.0;
  }
  fmt::print("{:32} {:3.0f} {:10.5f} {:10.5f} {:10.3f} {:10.3f}\n", k.name, n,
             std::sqrt(ours_px2 / n), std::sqrt(ceres_px2 / n), ours_s / n, ceres_s / n);
}

}  // namespace

int main() {
  fmt::print("rms of an axis in pixels of the coarser surface, CPU seconds a pair\n");
  fmt::print("{:32} {:>3} {:>10} {:>10} {:>10} {:>10}\n", "", "n", "ours px", "Ceres px", "ours s",
             "Ceres s");
  compare({"128 pixels, noise 0.02", 1.0, 0.02, 0.02, 128, 40});
  compare({"128 pixels, noise 0.05", 1.0, 0.05, 0.05, 128, 40});
  compare({"128 pixels, noise 0.15", 1.0, 0.15, 0.15, 128, 40});
  compare({"ten fine to a coarse one", 10.0, 0.1, 0.05, 1000, 6});
}
