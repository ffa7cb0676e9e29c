// SPDX-License-Identifier: GPL-3.0-or-later

// Merging and meshing of coloured scans in files on a part of 2 m x 2 m: wall and CPU seconds,
// memory, and how far pose and mesh are from the truth.
//
//   scan_merge_bench [million points [FOLDER [cloud]]]   20 unless given, 0.3 mm of noise, from
//                    four scans; the files lie in FOLDER or where others that pass do; cloud: no
//                    mesh

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <filesystem>

#include <fmt/format.h>

#include "scan/merge_files.hpp"
#include "scan/mesh_cloud.hpp"
#include "support/bench_times.hpp"
#include "support/matchers.hpp"
#include "support/scan_terrain.hpp"

namespace maquette::scan {
namespace {

using namespace testing_support;

double peak_gib() {
  return peak_mib() / 1024.0;
}

void print(const char* what, Times start) {
  const Times end = now();
  fmt::print("{:<8} {:7.1f} s wall, {:7.1f} s CPU, most memory so far {:.1f} GiB\n", what,
             end.wall - start.wall, end.cpu - start.cpu, peak_gib());
}

/// In batches: the scan is never held.
bool write_scan(const heightmap::ModelField& part, std::uint64_t scan, std::uint64_t points,
                const RigidTransform& moved, Vec3 middle, const std::filesystem::path& path) {
  const auto writer = create_cloud(path);
  if (!writer) return false;
  ScanStation station;
  station.model_from_station.translation_mm = moved.point(middle + Vec3{0.0, 0.0, 3000.0});
  station.position_mm = station.model_from_station.translation_mm;
  station.points = points;
  station.fields.colour = true;
  const RigidTransform back = station.model_from_station.inverse() * moved;
  if (!(*writer)->begin_station(station)) return false;
  PointBatch batch;
  for (std::uint64_t from = 0; from < points; from += batch.size()) {
    const std::uint64_t n = std::min<std::uint64_t>(65'536, points - from);
    batch.clear();
    batch.points_mm = points_on(part, n, 7 + scan + 1000 * (from / 65'536), 0.3).points_mm;
    for (Vec3& p : batch.points_mm) p = back.point(p);
    batch.colours.assign(n, {30'000, 20'000, 10'000});
    if (!(*writer)->write(batch)) return false;
  }
  return (*writer)->finish().has_value();
}

int run(double million, const std::filesystem::path& folder, bool with_mesh) {
  const heightmap::ModelField part = rough_part(1, 4001, 4001, 0.5);
  const Vec3 middle{1000.0, 1000.0, 10.0};
  std::vector<std::filesystem::path> files;
  std::vector<RigidTransform> moved;
  for (std::uint64_t i = 0; i < 4; ++i) {
    moved.push_back(i == 0 ? RigidTransform{} : random_pose(i, middle, 0.003, 10.0));
    files.push_back(folder / fmt::format("scan_{}.e57", i + 1));
    if (!write_scan(part, i, static_cast<std::uint64_t>(250'000.0 * million), moved.back(), middle,
                    files.back())) {
      fmt::print("{} cannot be written\n", files.back().string());
      return 1;
    }
  }
  fmt::print("{} M points of 0.3 mm, four scans, up to 10 mm and 0.17 degrees off\n", million);
  const double held = peak_gib();
  fmt::print("most memory before, with the part: {:.2f} GiB\n", held);
  Times start = now();
  const auto merged = merge_files(files);
  if (!merged) {
    fmt::print("{}\n", merged.error().message);
    return 1;
  }
  print("poses", start);
  for (std::size_t i = 1; i < 4; ++i) {
    const RigidTransform left = merged->merge.scans[i].correction * moved[i];
    double square = 0.0;
    for (const Vec3 corner :
         {Vec3{0, 0, 0}, Vec3{2000, 0, 0}, Vec3{0, 2000, 0}, Vec3{2000, 2000, 0}})
      square += std::pow(norm(left.point(corner) - corner), 2);
    fmt::print("  scan {}: {:.4f} mm rms at the corners, pieces of {:.2f} mm, {} of {} points\n",
               i + 1, std::sqrt(square / 4.0), merged->merge.voxel_mm, merged->scans[i].used,
               merged->scans[i].points);
  }
  const OpenCloud open = [&] { return open_merged(*merged); };
  start = now();
  if (!copy_cloud(open, folder / "merged.e57")) return 1;
  print("cloud", start);
  if (!with_mesh) return 0;
  start = now();
  const auto mesh = mesh_cloud(open);
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
  fmt::print(
      "  {:.2f} M triangles, voxel {:.3f} mm, {} border loops, {} pinholes closed, {:.4f} mm rms "
      "of "
      "height\n",
      1e-6 * static_cast<double>(mesh->mesh.triangles.size()), mesh->voxel_mm, mesh->holes.size(),
      mesh->pinholes, std::sqrt(square / static_cast<double>(n)));
  return 0;
}

}  // namespace
}  // namespace maquette::scan

int main(int argc, char** argv) {
  const maquette::testing_support::ScratchFolder scratch;
  return maquette::scan::run(argc > 1 ? std::atof(argv[1]) : 20.0,
                             argc > 2 ? std::filesystem::path(argv[2]) : scratch.path(), argc < 4);
}
