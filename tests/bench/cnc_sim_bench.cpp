// SPDX-License-Identifier: GPL-3.0-or-later

// Simulated cut and proof of a finishing program on 100 x 100 mm of rolling ground (6 mm ball, 0.5
// mm stepover, 0.1 mm cells, all cores), beside the same cut by a textbook loop: every cell under
// each move's bounding box, distance to the segment, one core.
//
// "textbook/this" is the ratio of processor times, which other work on the machine does not change
// much; the sweep also does arcs as arcs, and says what each move removed and touched.
//
//   tools/bench cnc_sim

#include <cmath>
#include <ctime>
#include <filesystem>
#include <vector>

#include <benchmark/benchmark.h>

#include "cnc/mill.hpp"
#include "cnc/milling_sim.hpp"
#include "cnc/path_certificate.hpp"
#include "cnc/tool_moves.hpp"
#include "cnc/verify.hpp"
#include "support/terrain.hpp"

namespace maquette::cnc {
namespace {

constexpr double kCell_mm = 0.1;

struct Work {
  heightmap::ModelField design;
  std::filesystem::path program;
  std::vector<Motion> motions;
  std::vector<ToolMove> moves;
  Cutter ball = Cutter::ball(3.0);
  double top = 0.0;
};

const Work& work() {
  static const Work made = [] {
    Work w;
    w.design = testing_support::ground(testing_support::Ground::rolling, 1, 201, 0.5);
    w.program = std::filesystem::temp_directory_path() / "maquette_cnc_sim_bench.ngc";
    if (!mill(w.design, {}, w.program)) std::abort();
    const MotionSink sink = [&](std::span<const Motion> some) -> Result<void> {
      w.motions.insert(w.motions.end(), some.begin(), some.end());
      return {};
    };
    if (!read_gcode(w.program, sink)) std::abort();
    for (std::size_t i = 0; i < w.motions.size(); ++i)
      append_tool_moves(w.motions[i], w.ball, 0, static_cast<std::uint32_t>(i), w.moves);
    w.top = static_cast<double>(heightmap::height_range(w.design.z_mm).max) + 1.0;
    return w;
  }();
  return made;
}

Grid<float> stock() {
  const auto n = static_cast<std::ptrdiff_t>(std::lround(100.0 / kCell_mm)) + 1;
  return {n, n, static_cast<float>(work().top)};
}

void counted(benchmark::State& state) {
  state.counters["moves/s"] = benchmark::Counter(
      static_cast<double>(work().motions.size() * static_cast<std::size_t>(state.iterations())),
      benchmark::Counter::kIsRate);
}

/// Arcs as their chords: cheaper than what it is compared with.
void textbook_cut(Grid<float>& z) {
  const double R = 3.0, x0 = work().design.x0.value(), y0 = work().design.y0.value();
  for (const Motion& m : work().motions) {
    const Vec3 a = m.from_mm, d = m.to_mm - m.from_mm;
    const double dd = d.x * d.x + d.y * d.y;
    const auto cell = [&](double mm, double origin, std::ptrdiff_t count) {
      return std::clamp<std::ptrdiff_t>(static_cast<std::ptrdiff_t>((mm - origin) / kCell_mm), 0,
                                        count - 1);
    };
    const std::ptrdiff_t c0 = cell(std::fmin(a.x, a.x + d.x) - R, x0, z.cols()),
                         c1 = cell(std::fmax(a.x, a.x + d.x) + R, x0, z.cols()),
                         r0 = cell(std::fmin(a.y, a.y + d.y) - R, y0, z.rows()),
                         r1 = cell(std::fmax(a.y, a.y + d.y) + R, y0, z.rows());
    for (std::ptrdiff_t r = r0; r <= r1; ++r)
      for (std::ptrdiff_t c = c0; c <= c1; ++c) {
        const double x = x0 + kCell_mm * static_cast<double>(c) - a.x;
        const double y = y0 + kCell_mm * static_cast<double>(r) - a.y;
        const double t = dd > 0.0 ? std::clamp((x * d.x + y * d.y) / dd, 0.0, 1.0) : 0.0;
        const double q = R * R - (x - t * d.x) * (x - t * d.x) - (y - t * d.y) * (y - t * d.y);
        if (q <= 0.0) continue;
        const double under = a.z + t * d.z + R - std::sqrt(q);
        if (under < static_cast<double>(z(r, c))) z(r, c) = static_cast<float>(under);
      }
  }
}

double processor_s() {
  return static_cast<double>(std::clock()) / CLOCKS_PER_SEC;
}

/// Processor time of the loop, however many others want the machine.
double textbook_s() {
  static const double measured = [] {
    Grid<float> z = stock();
    const double begin = processor_s();
    textbook_cut(z);
    benchmark::DoNotOptimize(z.cells().data());
    return processor_s() - begin;
  }();
  return measured;
}

void TextbookLoop(benchmark::State& state) {
  for (auto _ : state) {
    Grid<float> z = stock();
    textbook_cut(z);
    benchmark::DoNotOptimize(z.cells().data());
  }
  counted(state);
}
BENCHMARK(TextbookLoop)->MeasureProcessCPUTime()->Unit(benchmark::kMillisecond)->Iterations(1);

void Sweep(benchmark::State& state) {
  const double reference = textbook_s(), begin = processor_s();
  for (auto _ : state) {
    MillingSim sim({work().design.x0.value(), work().design.y0.value(), kCell_mm}, {work().ball},
                   stock());
    MoveEffects effects(work().motions.size());
    sim.cut(work().moves, effects);
    benchmark::DoNotOptimize(effects.removed.data());
  }
  const double each = (processor_s() - begin) / static_cast<double>(state.iterations());
  state.counters["textbook/this"] = reference / each;
  counted(state);
}
BENCHMARK(Sweep)->MeasureProcessCPUTime()->UseRealTime()->Unit(benchmark::kMillisecond);

void PathProven(benchmark::State& state) {
  PathCertificate certificate;
  for (auto _ : state) {
    PathProof proof(work().design, BallNose{3.0});
    proof.add(work().motions);
    certificate = proof.finish();
  }
  counted(state);
  state.counters["drops/move"] =
      static_cast<double>(certificate.drops) / static_cast<double>(certificate.motions);
  state.counters["proven_um"] = 1e3 * certificate.proven_mm;
}
BENCHMARK(PathProven)->MeasureProcessCPUTime()->UseRealTime()->Unit(benchmark::kMillisecond);

void WholeVerify(benchmark::State& state) {
  const RowSink nowhere = [](const MilledShape&, std::ptrdiff_t,
                             std::span<const float>) -> Result<void> { return {}; };
  for (auto _ : state)
    if (!verify(std::span(&work().program, 1), work().design, {}, nowhere)) std::abort();
  counted(state);
}
BENCHMARK(WholeVerify)->MeasureProcessCPUTime()->UseRealTime()->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace maquette::cnc
