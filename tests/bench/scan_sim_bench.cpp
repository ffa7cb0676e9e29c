// SPDX-License-Identifier: GPL-3.0-or-later

// Rays per CPU second of the simulated scanner on 4000 x 4000 quads of 0.5 mm with 12 stones,
// beside the rays of its tracer alone and Embree's (robust, the same triangles) on a part of the
// surface.
//
//   scan_sim_bench [lines_per_turn]     20000 unless given
//
// The last line is the memory of a scan that is streamed into a file.

#include <cstdio>
#include <cstdlib>

#include <embree3/rtcore.h>
#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>
#include <sys/resource.h>

#include "heightmap/field_tracer.hpp"
#include "scan/scanner_sim.hpp"
#include "support/matchers.hpp"
#include "support/scan_terrain.hpp"

namespace maquette::scan {
namespace {

/// CPU time of all threads: the machine may have other work.
double cpu_seconds() {
  rusage u{};
  ::getrusage(RUSAGE_SELF, &u);
  return static_cast<double>(u.ru_utime.tv_sec + u.ru_stime.tv_sec) +
         1e-6 * static_cast<double>(u.ru_utime.tv_usec + u.ru_stime.tv_usec);
}

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

struct EmbreeTerrain {
  RTCDevice device = rtcNewDevice(nullptr);
  RTCScene scene = rtcNewScene(device);
  explicit EmbreeTerrain(const heightmap::ModelField& f) {
    rtcSetSceneFlags(scene, RTC_SCENE_FLAG_ROBUST);
    RTCGeometry g = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
    const auto rows = static_cast<std::size_t>(f.z_mm.rows()),
               cols = static_cast<std::size_t>(f.z_mm.cols());
    auto* v = static_cast<float*>(
        rtcSetNewGeometryBuffer(g, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 12, rows * cols));
    auto* t = static_cast<unsigned*>(rtcSetNewGeometryBuffer(
        g, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 12, 2 * (rows - 1) * (cols - 1)));
    for (std::size_t r = 0; r < rows; ++r)
      for (std::size_t c = 0; c < cols; ++c) {
        *v++ = static_cast<float>(f.x_mm(static_cast<std::ptrdiff_t>(c)));
        *v++ = static_cast<float>(f.y_mm(static_cast<std::ptrdiff_t>(r)));
        *v++ = f.z_mm(static_cast<std::ptrdiff_t>(r), static_cast<std::ptrdiff_t>(c));
      }
    for (std::size_t r = 0; r + 1 < rows; ++r)
      for (std::size_t c = 0; c + 1 < cols; ++c) {
        const auto a = static_cast<unsigned>(r * cols + c), b = a + 1,
                   d = static_cast<unsigned>(a + cols + 1), e = d - 1;
        for (const unsigned i : {a, b, d, a, d, e}) *t++ = i;
      }
    rtcCommitGeometry(g);
    rtcAttachGeometry(scene, g);
    rtcReleaseGeometry(g);
    rtcCommitScene(scene);
  }
  ~EmbreeTerrain() {
    rtcReleaseScene(scene);
    rtcReleaseDevice(device);
  }
  [[nodiscard]] bool trace(Vec3 o, Vec3 d) const {
    RTCRayHit q{};
    q.ray.org_x = static_cast<float>(o.x);
    q.ray.org_y = static_cast<float>(o.y);
    q.ray.org_z = static_cast<float>(o.z);
    q.ray.dir_x = static_cast<float>(d.x);
    q.ray.dir_y = static_cast<float>(d.y);
    q.ray.dir_z = static_cast<float>(d.z);
    q.ray.tfar = 1e9F;
    q.ray.mask = ~0U;
    q.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    rtcIntersect1(scene, &context, &q);
    return q.hit.geomID != RTC_INVALID_GEOMETRY_ID;
  }
};

int run(double lines) {
  const heightmap::ModelField part = testing_support::rough_part(1, 4001, 4001, 0.5);
  const Vec3 station{1000.0, -1500.0, 2000.0};
  const heightmap::FieldTracer tracer(part);
  fmt::print("4000 x 4000 quads; rays per second of CPU (two cores give twice as many)\n");
  const double ours =
      rate(station, 2000.0, [&](Vec3 o, Vec3 d) { return tracer.trace(o, d).has_value(); });
  fmt::print("  FieldTracer              {:6.2f} M rays/CPU s\n", 1e-6 * ours);
  {
    // A part of 1000 x 1000 quads: Embree's tree of all would take 3 GiB.
    const heightmap::ModelField small = testing_support::rough_part(1, 1001, 1001, 2.0);
    const heightmap::FieldTracer small_tracer(small);
    const EmbreeTerrain embree(small);
    const double theirs = rate(station, 2000.0, [&](Vec3 o, Vec3 d) { return embree.trace(o, d); });
    const double same =
        rate(station, 2000.0, [&](Vec3 o, Vec3 d) { return small_tracer.trace(o, d).has_value(); });
    fmt::print(
        "  1000 x 1000 quads: Embree {:6.2f}, FieldTracer {:6.2f} M rays/CPU s, ratio {:.2f}\n",
        1e-6 * theirs, 1e-6 * same, same / theirs);
  }
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
    const auto figures = simulate_scan(part, {}, o, **writer);
    if (!figures) {
      fmt::print("{}\n", figures.error().message);
      return 1;
    }
    if (!(*writer)->finish()) return 1;
    const double s = cpu_seconds() - start;
    fmt::print(
        "  scan, {} rays a point     {:6.2f} M rays/CPU s, {:.2f} M points in {:.1f} CPU s\n", rays,
        1e-6 * rays * static_cast<double>(figures->directions) / s,
        1e-6 * static_cast<double>(figures->points), s);
  }
  rusage usage{};
  ::getrusage(RUSAGE_SELF, &usage);
  fmt::print("  most memory held {:.0f} MiB\n", static_cast<double>(usage.ru_maxrss) / 1024.0);
  return 0;
}

}  // namespace
}  // namespace maquette::scan

int main(int argc, char** argv) {
  return maquette::scan::run(argc > 1 ? std::atof(argv[1]) : 20'000.0);
}
