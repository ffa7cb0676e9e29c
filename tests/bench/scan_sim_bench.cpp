// SPDX-License-Identifier: GPL-3.0-or-later

// Rays per CPU second, and per second on all cores, of the simulated scanner on 4000 x 4000 quads
// of 0.5 mm, beside the rays of its tracer alone and Embree's (robust, the same quads as one grid),
// and the memory of a scan that is streamed into a file.
//
//   scan_sim_bench [lines_per_turn]     20000 unless given

#include <chrono>
#include <cstdio>
#include <cstdlib>

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/task_arena.h>

#include "heightmap/field_tracer.hpp"
#include "scan/scanner_sim.hpp"
#include "support/bench_times.hpp"
#include "support/embree_terrain.hpp"
#include "support/matchers.hpp"
#include "support/scan_terrain.hpp"

namespace maquette::scan {
namespace {

using namespace testing_support;

/// Rays per CPU second of `trace` over a grid of directions from `station`.
template <class Trace>
double rate(Vec3 station, double side, const Trace& trace) {
  constexpr int kRays = 1500;
  const double start = cpu_seconds();
  std::vector<int> hits(kRays);
  oneapi::tbb::parallel_for(0, kRays, [&](int i) {
    for (int j = 0; j < kRays; ++j) {
      const Vec3 target{side * (i + 0.5) / kRays, side * (j + 0.5) / kRays, 10.0};
      if (trace(station, normalized(target - station))) ++hits[static_cast<std::size_t>(i)];
    }
  });
  const double s = cpu_seconds() - start;
  long all = 0;
  for (const int h : hits) all += h;
  fmt::print("    {:.2f} of the rays hit\n", static_cast<double>(all) / kRays / kRays);
  return static_cast<double>(kRays) * kRays / s;
}

int run(double lines) {
  const heightmap::ModelField part = testing_support::rough_part(1, 4001, 4001, 0.5);
  const Vec3 station{1000.0, -1500.0, 2000.0};
  fmt::print(
      "4000 x 4000 quads; per second of CPU, and by the clock (an otherwise idle machine)\n");
  const double held = peak_mib();
  std::vector<double> rates;
  for (const int rays : {1, 7}) {
    ScanOptions o;
    o.scanner = *assets::find_preset(assets::scanner_presets(), "zf5006h");
    o.scanner.lines_per_turn = lines;
    o.station_mm = station;
    o.footprint_rays = rays;
    o.max_points = 1'000'000'000;
    const testing_support::ScratchFolder folder;
    const auto writer = create_cloud(folder / "scan.ply");
    if (!writer) return 1;
    const double start = cpu_seconds();
    const auto clock = std::chrono::steady_clock::now();
    const auto figures = simulate_scan(part, {}, o, **writer);
    if (!figures) {
      fmt::print("{}\n", figures.error().message);
      return 1;
    }
    if (!(*writer)->finish()) return 1;
    const double s = cpu_seconds() - start;
    const double wall =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - clock).count();
    rates.push_back(rays * static_cast<double>(figures->directions) / s);
    fmt::print(
        "  scan, {} rays a point     {:6.2f} M rays/CPU s, {:.2f} M/s on {} cores; {:.2f} M points "
        "in "
        "{:.1f} CPU s, file included\n",
        rays, 1e-6 * rates.back(), 1e-6 * rates.back() * s / wall,
        oneapi::tbb::this_task_arena::max_concurrency(),
        1e-6 * static_cast<double>(figures->points), s);
  }
  fmt::print("  memory of a scan beside the surface: {:.0f} MiB\n", peak_mib() - held);
  const heightmap::FieldTracer tracer(part);
  const double ours =
      rate(station, 2000.0, [&](Vec3 o, Vec3 d) { return tracer.trace(o, d).has_value(); });
  const EmbreeTerrain embree(part);
  const double theirs = rate(station, 2000.0, [&](Vec3 o, Vec3 d) { return embree.trace(o, d); });
  fmt::print("  Embree, one ray a call   {:6.2f} M rays/CPU s\n", 1e-6 * theirs);
  fmt::print(
      "  FieldTracer, likewise    {:6.2f} M rays/CPU s, {:.2f} of Embree; scans {:.2f} (1 ray), "
      "{:.2f} (7)\n",
      1e-6 * ours, ours / theirs, rates[0] / theirs, rates[1] / theirs);
  return 0;
}

}  // namespace
}  // namespace maquette::scan

int main(int argc, char** argv) {
  return maquette::scan::run(argc > 1 ? std::atof(argv[1]) : 20'000.0);
}
