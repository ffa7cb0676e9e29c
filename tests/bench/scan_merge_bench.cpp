// SPDX-License-Identifier: GPL-3.0-or-later

// Merging and meshing of clouds on a part of 2 m x 2 m: wall and CPU seconds, memory, and how far
// pose and mesh are from the truth.
//
//   scan_merge_bench [million points]     20 unless given, 0.3 mm of noise, from four scans

#include <chrono>
#include <cmath>
#include <cstdlib>

#include <fmt/format.h>
#include <sys/resource.h>

#include "scan/merge.hpp"
#include "scan/mesh_cloud.hpp"
#include "support/scan_terrain.hpp"

namespace maquette::scan {
namespace {

using namespace testing_support;

struct Times {
  double wall = 0.0, cpu = 0.0;
};
Times now() {
  rusage u{};
  ::getrusage(RUSAGE_SELF, &u);
  const auto wall = std::chrono::steady_clock::now().time_since_epoch();
  return {std::chrono::duration<double>(wall).count(),
          static_cast<double>(u.ru_utime.tv_sec + u.ru_stime.tv_sec) +
              1e-6 * static_cast<double>(u.ru_utime.tv_usec + u.ru_stime.tv_usec)};
}
void print(const char* what, Times start) {
  const Times end = now();
  rusage u{};
  ::getrusage(RUSAGE_SELF, &u);
  fmt::print("{:<8} {:7.1f} s wall, {:7.1f} s CPU, most memory so far {:.1f} GiB\n", what,
             end.wall - start.wall, end.cpu - start.cpu,
             static_cast<double>(u.ru_maxrss) / 1048576.0);
}

int run(double million) {
  const heightmap::ModelField part = rough_part(1, 4001, 4001, 0.5);
  const Vec3 middle{1000.0, 1000.0, 10.0};
  std::vector<Cloud> scans;
  std::vector<RigidTransform> moved;
  for (std::uint64_t i = 0; i < 4; ++i) {
    moved.push_back(i == 0 ? RigidTransform{} : random_pose(i, middle, 0.003, 10.0));
    Cloud cloud = points_on(part, static_cast<std::size_t>(250'000.0 * million), 7 + i, 0.3);
    cloud.colours.resize(cloud.points_mm.size(), {30'000, 20'000, 10'000});
    cloud.station_mm = middle + Vec3{0.0, 0.0, 3000.0};
    scans.push_back(seen_from(cloud, moved.back()));
  }
  fmt::print("{} M points of 0.3 mm, four scans, up to 10 mm and 0.17 degrees off\n", million);
  Times start = now();
  const auto merge = merge_scans(scans);
  if (!merge) {
    fmt::print("{}\n", merge.error().message);
    return 1;
  }
  print("merge", start);
  for (std::size_t i = 1; i < 4; ++i) {
    const RigidTransform left = merge->scans[i].correction * moved[i];
    double square = 0.0;
    for (const Vec3 corner :
         {Vec3{0, 0, 0}, Vec3{2000, 0, 0}, Vec3{0, 2000, 0}, Vec3{2000, 2000, 0}})
      square += std::pow(norm(left.point(corner) - corner), 2);
    fmt::print("  scan {}: {:.4f} mm rms at the corners, pieces of {:.2f} mm\n", i + 1,
               std::sqrt(square / 4.0), merge->voxel_mm);
  }
  for (std::size_t i = 0; i < 4; ++i) apply(merge->scans[i], scans[i]);
  const Cloud all = join(std::move(scans));
  start = now();
  const auto mesh = mesh_cloud(all);
  if (!mesh) {
    fmt::print("{}\n", mesh.error().message);
    return 1;
  }
  print("mesh", start);
  double square = 0.0;
  std::size_t n = 0;
  for (const Vec3& p : mesh->mesh.vertices_mm) {
    const double h = heightmap::height_at(part, p.x, p.y);
    if (std::isnan(h) || p.x < 5 || p.x > 1995 || p.y < 5 || p.y > 1995) continue;
    square += (p.z - h) * (p.z - h);
    ++n;
  }
  fmt::print("  {:.2f} M triangles, voxel {:.3f} mm, {} border loops, {:.4f} mm rms of height\n",
             1e-6 * static_cast<double>(mesh->mesh.triangles.size()), mesh->voxel_mm,
             mesh->holes.size(), std::sqrt(square / static_cast<double>(n)));
  return 0;
}

}  // namespace
}  // namespace maquette::scan

int main(int argc, char** argv) {
  return maquette::scan::run(argc > 1 ? std::atof(argv[1]) : 20.0);
}
