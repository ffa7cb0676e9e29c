// SPDX-License-Identifier: GPL-3.0-or-later

// Exact cutter locations a second on all cores: grids (0.5 mm nodes, 6 mm ball and others, a full
// 2 m x 2 m), meshes with stones. In the same run the reference: every triangle of the surface, or
// every one in reach, tried for each point (tests/cnc/slow_contact.hpp); `ratio` is to it, and
// `off_mm` the largest difference found. Then blocks and samples per metre of path.
//
//   cnc_bench --benchmark_counters_tabular=true
//
// points/s are of the clock; points/cpu_s of one core's time, which tells more on a busy machine.

#include <unistd.h>
#include <algorithm>
#include <cmath>
#include <ctime>
#include <fstream>
#include <numbers>
#include <vector>

#include <benchmark/benchmark.h>
#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/parallel_for.h>

#include "cnc/cutter_location.hpp"
#include "cnc/fit_moves.hpp"
#include "cnc/mesh_cutter.hpp"
#include "cnc/pass_sampler.hpp"
#include "cnc/slow_contact.hpp"
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

/// 2 m x 2 m: the terrain and its mirror images, 4000 x 4000 cells.
const ModelField& full_size() {
  static const ModelField field = [] {
    ModelField f = terrain();
    f.z_mm = Grid<float>(4001, 4001);
    const auto folded = [](std::ptrdiff_t i) {
      const std::ptrdiff_t k = i % (2 * (kNodes - 1));
      return k < kNodes ? k : 2 * (kNodes - 1) - k;
    };
    for (std::ptrdiff_t r = 0; r < 4001; ++r)
      for (std::ptrdiff_t c = 0; c < 4001; ++c) f.z_mm(r, c) = terrain().z_mm(folded(r), folded(c));
    return f;
  }();
  return field;
}

double resident_mib() {
  std::ifstream statm("/proc/self/statm");
  long total = 0, resident = 0;
  statm >> total >> resident;
  return static_cast<double>(resident) * static_cast<double>(sysconf(_SC_PAGESIZE)) / 1048576.0;
}

/// Points a second of the clock and of the processor.
class Counted {
 public:
  explicit Counted(benchmark::State& state) : state_(state), from_(std::clock()) {}
  void finish(double per_iteration) {
    const double points = per_iteration * static_cast<double>(state_.iterations());
    cpu_rate_ = points * CLOCKS_PER_SEC / static_cast<double>(std::clock() - from_);
    state_.counters["points/s"] = benchmark::Counter(points, benchmark::Counter::kIsRate);
    state_.counters["points/cpu_s"] = cpu_rate_;
  }
  [[nodiscard]] double cpu_rate() const { return cpu_rate_; }

 private:
  benchmark::State& state_;
  std::clock_t from_;
  double cpu_rate_ = 0.0;
};

template <class Dropper>
double drop_rows(const Dropper& cutter, std::ptrdiff_t rows, std::ptrdiff_t cols, double x0,
                 double y0, double step_x, double step_y) {
  oneapi::tbb::enumerable_thread_specific<double> sums(0.0);
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, rows, [&](std::ptrdiff_t r) {
    double sum = 0.0;
    for (std::ptrdiff_t c = 0; c < cols; ++c)
      sum += cutter.drop(x0 + step_x * static_cast<double>(c), y0 + step_y * static_cast<double>(r))
                 .tip_mm;
    sums.local() += sum;
  });
  return sums.combine([](double a, double b) { return a + b; });
}

/// What the reference found is compared with the cutter, and its rate with the cutter's.
template <class Dropper, class Slow>
void against_reference(benchmark::State& state, const Dropper& cutter, double fast_rate,
                       std::ptrdiff_t points, double x0, double y0, Slow&& slow) {
  double off = 0.0;
  const std::clock_t from = std::clock();
  for (std::ptrdiff_t i = 0; i < points; ++i) {
    const double x = x0 + 1.37 * static_cast<double>(i), y = y0 + 0.613 * static_cast<double>(i);
    off = std::max(off, std::abs(slow(x, y) - cutter.drop(x, y).tip_mm));
  }
  const double seconds = static_cast<double>(std::clock() - from) / CLOCKS_PER_SEC;
  state.counters["reference/cpu_s"] = static_cast<double>(points) / seconds;
  state.counters["ratio"] = fast_rate * seconds / static_cast<double>(points);
  state.counters["off_mm"] = off;
}

double slow_on_grid(const ModelField& f, const Slow& slow, double x, double y, bool all) {
  const double d = f.spacing.value();
  const auto cell = [&](double t, std::ptrdiff_t n) {
    return std::clamp<std::ptrdiff_t>(static_cast<std::ptrdiff_t>(std::floor(t / d)), 0, n - 2);
  };
  const double px = x - f.x0.value(), py = y - f.y0.value();
  const std::ptrdiff_t r0 = all ? 0 : cell(py - slow.R, f.z_mm.rows());
  const std::ptrdiff_t r1 = all ? f.z_mm.rows() - 2 : cell(py + slow.R, f.z_mm.rows());
  const std::ptrdiff_t c0 = all ? 0 : cell(px - slow.R, f.z_mm.cols());
  const std::ptrdiff_t c1 = all ? f.z_mm.cols() - 2 : cell(px + slow.R, f.z_mm.cols());
  double best = -INFINITY;
  for (std::ptrdiff_t r = r0; r <= r1; ++r)
    for (std::ptrdiff_t c = c0; c <= c1; ++c) {
      const auto p = [&](std::ptrdiff_t i, std::ptrdiff_t j) {
        return Vec3{f.x_mm(c + j), f.y_mm(r + i), static_cast<double>(f.z_mm(r + i, c + j))};
      };
      best = std::max(
          {best, slow(p(0, 0), p(0, 1), p(1, 1), x, y), slow(p(0, 0), p(1, 1), p(1, 0), x, y)});
    }
  return best;
}

/// All nodes of 2 m x 2 m, or as many places beside them (off: shift in cells; 0.37 and such have
/// no tables of their own). Reference: all 32 M triangles at 2 points.
void FullSize(benchmark::State& state, const Cutter& tool, double off) {
  const ModelField& field = full_size();
  const double before = resident_mib();
  const DropCutter cutter(field, tool);
  const double after = resident_mib();
  const double x0 = field.x0.value() + 0.5 * off, y0 = field.y0.value() + 0.3 * off;
  Counted counted(state);
  for (auto _ : state) benchmark::DoNotOptimize(drop_rows(cutter, 4000, 4000, x0, y0, 0.5, 0.5));
  counted.finish(16e6);
  const Slow slow(tool);
  against_reference(state, cutter, counted.cpu_rate(), 2, x0 + 900.0, y0 + 700.0,
                    [&](double x, double y) { return slow_on_grid(field, slow, x, y, true); });
  state.counters["MiB"] = after - before;
}
BENCHMARK_CAPTURE(FullSize, ball_at_nodes, Cutter::ball(3.0), 0.0)->UseRealTime()->Iterations(1);
BENCHMARK_CAPTURE(FullSize, ball_on_lattice, Cutter::ball(3.0), 0.625)
    ->UseRealTime()
    ->Iterations(1);
BENCHMARK_CAPTURE(FullSize, ball_anywhere, Cutter::ball(3.0), 0.37)->UseRealTime()->Iterations(1);

/// The same on 0.4 m x 0.4 m. Reference: all triangles in reach.
void Grid(benchmark::State& state, const Cutter& tool, double off) {
  const DropCutter cutter(terrain(), tool);
  const double x0 = terrain().x0.value() + 0.5 * off, y0 = terrain().y0.value() + 0.3 * off;
  Counted counted(state);
  for (auto _ : state) benchmark::DoNotOptimize(drop_rows(cutter, 800, 800, x0, y0, 0.5, 0.5));
  counted.finish(640e3);
  const Slow slow(tool);
  against_reference(state, cutter, counted.cpu_rate(), 200, x0 + 20.0, y0 + 20.0,
                    [&](double x, double y) { return slow_on_grid(terrain(), slow, x, y, false); });
}
BENCHMARK_CAPTURE(Grid, ball_3, Cutter::ball(3.0), 0.0)->UseRealTime();
BENCHMARK_CAPTURE(Grid, ball_1_5, Cutter::ball(1.5), 0.0)->UseRealTime();
BENCHMARK_CAPTURE(Grid, bull_3_corner_1, Cutter::bull(3.0, 1.0), 0.0)->UseRealTime();
BENCHMARK_CAPTURE(Grid, bull_6_corner_2, Cutter::bull(6.0, 2.0), 0.0)->UseRealTime();
BENCHMARK_CAPTURE(Grid, flat_3, Cutter::flat(3.0), 0.0)->UseRealTime();
BENCHMARK_CAPTURE(Grid, flat_6, Cutter::flat(6.0), 0.0)->UseRealTime();

/// Holder of 20 to 25 mm radius, 30 mm above the tip.
void Holder(benchmark::State& state) {
  Cutter tool = Cutter::ball(3.0);
  tool.holder = {{30.0, 5.0, 20.0, 25.0}, {35.0, 40.0, 25.0, 25.0}};
  struct Of {
    DropCutter cutter;
    [[nodiscard]] CutterContact drop(double x, double y) const { return cutter.drop_holder(x, y); }
  } const holder{DropCutter(terrain(), tool)};
  Counted counted(state);
  for (auto _ : state)
    benchmark::DoNotOptimize(
        drop_rows(holder, 200, 200, terrain().x0.value(), terrain().y0.value(), 2.0, 2.0));
  counted.finish(40e3);
}
BENCHMARK(Holder)->UseRealTime();

/// The terrain's triangles and half-buried, faceted stones, `cells` a side.
TriMesh with_stones(std::ptrdiff_t cells, bool ground, bool stones) {
  TriMesh mesh;
  const ModelField& f = full_size();
  if (ground) {
    const auto n = static_cast<std::uint32_t>(cells);
    for (std::ptrdiff_t r = 0; r <= cells; ++r)
      for (std::ptrdiff_t c = 0; c <= cells; ++c)
        mesh.vertices_mm.push_back({f.x_mm(c), f.y_mm(r), static_cast<double>(f.z_mm(r, c))});
    for (std::uint32_t r = 0; r < n; ++r)
      for (std::uint32_t c = 0; c < n; ++c) {
        const std::uint32_t v = r * (n + 1) + c;
        mesh.triangles.push_back({v, v + 1, v + n + 2});
        mesh.triangles.push_back({v, v + n + 2, v + n + 1});
      }
  }
  if (!stones) return mesh;
  constexpr std::uint32_t kRings = 40, kSides = 80;
  for (std::uint64_t s = 0; s < 60; ++s) {
    const double span = 0.5 * static_cast<double>(cells);
    const double x = f.x0.value() + span * random_uniform(9, 3 * s);
    const double y = f.y0.value() + span * random_uniform(9, 3 * s + 1);
    const double z = heightmap::height_at(f, x, y), R = 3.0 + 9.0 * random_uniform(9, 3 * s + 2);
    TriMesh stone;
    for (std::uint32_t i = 0; i <= kRings; ++i)
      for (std::uint32_t j = 0; j < kSides; ++j) {
        const double polar = std::numbers::pi * i / kRings,
                     turn = 2.0 * std::numbers::pi * j / kSides;
        const double r = R * (0.95 + 0.1 * random_uniform(s, i * kSides + j));
        stone.vertices_mm.push_back({x + r * std::sin(polar) * std::cos(turn),
                                     y + r * std::sin(polar) * std::sin(turn),
                                     z + r * std::cos(polar)});
      }
    for (std::uint32_t i = 0; i < kRings; ++i)
      for (std::uint32_t j = 0; j < kSides; ++j) {
        const std::uint32_t a = i * kSides + j, b = i * kSides + (j + 1) % kSides;
        stone.triangles.push_back({a, a + kSides, b});
        stone.triangles.push_back({b, a + kSides, b + kSides});
      }
    append(mesh, stone);
  }
  return mesh;
}

double slow_on_mesh(const TriMesh& mesh, const Slow& slow, double x, double y) {
  double best = -INFINITY;
  for (const auto& t : mesh.triangles)
    best = std::max(
        best, slow(mesh.vertices_mm[t[0]], mesh.vertices_mm[t[1]], mesh.vertices_mm[t[2]], x, y));
  return best;
}

/// Argument: cells a side. Reference: all triangles at 3 points. MiB: beside the mesh.
void MeshWithStones(benchmark::State& state, const Cutter& tool) {
  const TriMesh mesh = with_stones(state.range(0), true, true);
  const std::clock_t from = std::clock();
  const MeshCutter cutter(mesh, tool);
  const double built = static_cast<double>(std::clock() - from) / CLOCKS_PER_SEC;
  Counted counted(state);
  const double x0 = full_size().x0.value() + 0.1, y0 = full_size().y0.value() + 0.2;
  // Every 0.5 mm along 200 lines.
  const std::ptrdiff_t cols = state.range(0);
  const double apart = static_cast<double>(cols) * 0.5 / 200.0;
  for (auto _ : state) benchmark::DoNotOptimize(drop_rows(cutter, 200, cols, x0, y0, 0.5, apart));
  counted.finish(200.0 * static_cast<double>(cols));
  const Slow slow(tool);
  against_reference(state, cutter, counted.cpu_rate(), 3, x0 + 90.0, y0 + 70.0,
                    [&](double x, double y) { return slow_on_mesh(mesh, slow, x, y); });
  state.counters["MiB"] = static_cast<double>(cutter.bytes()) / 1048576.0;
  state.counters["triangles"] = static_cast<double>(mesh.triangles.size());
  state.counters["build_cpu_s"] = built;
}
BENCHMARK_CAPTURE(MeshWithStones, ball, Cutter::ball(3.0))->Arg(700)->Arg(2828)->UseRealTime();
BENCHMARK_CAPTURE(MeshWithStones, bull, Cutter::bull(3.0, 1.0))->Arg(700)->UseRealTime();
BENCHMARK_CAPTURE(MeshWithStones, flat, Cutter::flat(3.0))->Arg(700)->UseRealTime();

/// The same as a grid and a mesh of the stones alone.
void GridWithStones(benchmark::State& state) {
  const TriMesh stones = with_stones(700, false, true);
  const GroundAndStones cutter(terrain(), stones, Cutter::ball(3.0));
  Counted counted(state);
  for (auto _ : state)
    benchmark::DoNotOptimize(drop_rows(cutter, 700, 700, terrain().x0.value() + 0.1,
                                       terrain().y0.value() + 0.2, 0.5, 0.5));
  counted.finish(490e3);
}
BENCHMARK(GridWithStones)->UseRealTime();

void CertifiedPath(benchmark::State& state) {
  DropCutter cutter(terrain(), kBall);
  const SteepnessTiles tiles(terrain(), kBall);
  std::vector<PathSample> samples;
  std::vector<FittedMove> moves;
  const LatticeLine line{std::llround(terrain().x0.value() * 1e4), 1012500, kResolution, 0};
  Counted counted(state);
  for (auto _ : state) {
    sample_line(cutter, tiles, terrain(), kBall, line, 0, 400000, {}, samples);
    benchmark::DoNotOptimize(fit_moves(samples, line.step_mm(), {}, moves));
  }
  state.counters["samples/m"] = static_cast<double>(samples.size()) / 0.4;
  state.counters["blocks/m"] = static_cast<double>(moves.size()) / 0.4;
  counted.finish(static_cast<double>(samples.size()));
}
BENCHMARK(CertifiedPath);

}  // namespace
}  // namespace maquette::cnc
