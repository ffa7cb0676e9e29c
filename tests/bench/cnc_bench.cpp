// SPDX-License-Identifier: GPL-3.0-or-later

// Exact cutter locations a second (6 mm ball, 0.5 mm nodes, all cores) and the same by
// visiting every cell that the ball could touch without any bound; blocks and samples
// per metre of path.
//
//   cnc_bench --benchmark_counters_tabular=true

#include <algorithm>
#include <cmath>
#include <vector>

#include <benchmark/benchmark.h>
#include <oneapi/tbb/parallel_for.h>

#include "cnc/cutter_location.hpp"
#include "cnc/fit_moves.hpp"
#include "cnc/pass_sampler.hpp"
#include "support/terrain.hpp"

namespace maquette::cnc {
namespace {

using heightmap::ModelField;

constexpr std::ptrdiff_t kNodes = 801;
constexpr BallNose kBall{3.0};

const ModelField& terrain() {
  static const ModelField field =
      testing_support::ground(testing_support::Ground::rolling, 1, kNodes, 0.5);
  return field;
}

void counted(benchmark::State& state, double per_iteration) {
  state.counters["points/s"] = benchmark::Counter(
      per_iteration * static_cast<double>(state.iterations()), benchmark::Counter::kIsRate);
}

/// Argument: points per cell; 16 and less share tables, more do not.
void ExactPoints(benchmark::State& state) {
  const DropCutter shared(terrain(), kBall);
  const double step = 0.5 / static_cast<double>(state.range(0));
  constexpr int kLines = 64, kPoints = 4000;
  for (auto _ : state)
    oneapi::tbb::parallel_for(0, kLines, [&](int line) {
      DropCutter cutter = shared;
      const double y = terrain().y0.value() + 6.0 * line;
      double sum = 0.0;
      for (int i = 0; i < kPoints; ++i)
        sum += cutter.drop(terrain().x0.value() + std::fmod(step * i, 400.0), y).tip_mm;
      benchmark::DoNotOptimize(sum);
    });
  counted(state, kLines * kPoints);
}
BENCHMARK(ExactPoints)->Arg(2)->Arg(8)->Arg(16)->Arg(37)->UseRealTime();

/// What a point costs if every facet in reach is tried, one core, with only one edge a facet:
/// a lower limit of what the bounds save.
void AllFacetsInReach(benchmark::State& state) {
  const ModelField& f = terrain();
  const double R = kBall.radius_mm;
  const auto reach = static_cast<std::ptrdiff_t>(std::ceil(R / f.spacing.value()));
  double x = f.x0.value() + 50.0;
  const double y = f.y0.value() + 50.13;
  for (auto _ : state) {
    x += 0.0625;
    if (x > f.x0.value() + 350.0) x -= 300.0;
    const auto col = static_cast<std::ptrdiff_t>((x - f.x0.value()) / f.spacing.value());
    const auto row = static_cast<std::ptrdiff_t>((y - f.y0.value()) / f.spacing.value());
    double best = -INFINITY;
    for (std::ptrdiff_t r = row - reach; r <= row + reach; ++r)
      for (std::ptrdiff_t c = col - reach; c <= col + reach; ++c) {
        const auto z = [&](std::ptrdiff_t i, std::ptrdiff_t j) {
          return static_cast<double>(f.z_mm(r + i, c + j));
        };
        const auto facet = [&](double z0, double gx, double gy, bool upper) {
          const double root = std::sqrt(1.0 + gx * gx + gy * gy);
          const double px = x - f.x_mm(c), py = y - f.y_mm(r);
          const double lx = px + R * gx / root, ly = py + R * gy / root;
          const bool inside =
              upper ? lx >= 0.0 && ly >= lx && ly <= 0.5 : ly >= 0.0 && lx >= ly && lx <= 0.5;
          if (inside) best = std::max(best, z0 + gx * px + gy * py + R * root);
          const double m = gx, q = R * R - py * py;  // one edge of three
          if (q > 0.0) {
            const double k = std::sqrt(q * (1.0 + m * m)), s = px + m * k / (1.0 + m * m);
            if (s > 0.0 && s < 0.5) best = std::max(best, z0 + m * px + k);
          }
        };
        facet(z(0, 0), 2.0 * (z(0, 1) - z(0, 0)), 2.0 * (z(1, 1) - z(0, 1)), false);
        facet(z(0, 0), 2.0 * (z(1, 1) - z(1, 0)), 2.0 * (z(1, 0) - z(0, 0)), true);
      }
    benchmark::DoNotOptimize(best);
  }
  counted(state, 1.0);
}
BENCHMARK(AllFacetsInReach);

void CertifiedPath(benchmark::State& state) {
  DropCutter cutter(terrain(), kBall);
  const SteepnessTiles tiles(terrain(), kBall);
  std::vector<PathSample> samples;
  std::vector<FittedMove> moves;
  const LatticeLine line{std::llround(terrain().x0.value() * 1e4), 1012500, kResolution, 0};
  for (auto _ : state) {
    sample_line(cutter, tiles, terrain(), kBall, line, 0, 400000, {}, samples);
    benchmark::DoNotOptimize(fit_moves(samples, line.step_mm(), {}, moves));
  }
  state.counters["samples/m"] = static_cast<double>(samples.size()) / 0.4;
  state.counters["blocks/m"] = static_cast<double>(moves.size()) / 0.4;
  counted(state, static_cast<double>(samples.size()));
}
BENCHMARK(CertifiedPath);

}  // namespace
}  // namespace maquette::cnc
