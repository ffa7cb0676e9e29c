// SPDX-License-Identifier: GPL-3.0-or-later

// What is claimed in scan/mesh_cloud.hpp, and how each claim is attacked:
//
//   closed bodies ......... a ball seen from six sides: no border, Euler's number, radius, volume,
//                           facing out
//   open, holes stated .... a plane with a square gap: two loops, their lengths and areas; closed:
//                           no border left
//   pinholes .............. gaps of 2.5 voxels and those of chance are closed, of six voxels stay;
//   a
//                           stray piece is not closed upon itself
//   manifold .............. crossing sheets, sheets a voxel apart, stray points: CGAL agrees, open
//   and
//                           closed; all signs of a cell
//   accuracy .............. a simulated scan of rough ground against the ground itself
//   colours ............... a ramp comes back at the vertices
//   file .................. read back by another reader
//   every refusal ......... one case each

#include "scan/mesh_cloud.hpp"

#include <cmath>
#include <map>
#include <numbers>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/random.hpp"
#include "meshing/mesh_checks.hpp"
#include "meshing/mesh_io.hpp"
#include "scan/detail/dual_mesh.hpp"
#include "scan/scanner_sim.hpp"
#include "support/matchers.hpp"
#include "support/scan_terrain.hpp"

namespace maquette::scan {
namespace {

using heightmap::ModelField;
using testing_support::FailsWith;
using testing_support::ScratchFolder;
using testing_support::Succeeds;

std::size_t border_edges(const TriMesh& mesh) {
  std::map<std::pair<std::uint32_t, std::uint32_t>, int> count;
  for (const auto& t : mesh.triangles)
    for (std::size_t k = 0; k < 3; ++k) ++count[std::minmax(t[k], t[(k + 1) % 3])];
  std::size_t border = 0;
  for (const auto& [edge, n] : count) border += n == 1 ? 1 : 0;
  return border;
}

double volume_of(const TriMesh& m) {
  double six = 0.0;
  for (const auto& t : m.triangles)
    six += dot(m.vertices_mm[t[0]], cross(m.vertices_mm[t[1]], m.vertices_mm[t[2]]));
  return six / 6.0;
}

/// A ball from six stations; each has the points of its side.
Cloud ball(double radius, int points, double sigma_mm) {
  std::vector<std::vector<Vec3>> sides(6);
  for (int i = 0; i < points; ++i) {
    const auto k = static_cast<std::uint64_t>(i);
    const Vec3 d = normalized(
        Vec3{random_normal(1, 3 * k), random_normal(1, 3 * k + 1), random_normal(1, 3 * k + 2)});
    const double c[3] = {d.x, d.y, d.z};
    std::size_t axis = 0;
    for (std::size_t a = 1; a < 3; ++a)
      if (std::abs(c[a]) > std::abs(c[axis])) axis = a;
    sides[2 * axis + (c[axis] < 0.0 ? 1 : 0)].push_back((radius + sigma_mm * random_normal(2, k)) *
                                                        d);
  }
  Cloud cloud;
  for (std::size_t s = 0; s < 6; ++s) {
    const double far = (s % 2 == 0 ? 1.0 : -1.0) * 50.0 * radius;
    ScanStation station;
    station.position_mm = Vec3{s / 2 == 0 ? far : 0, s / 2 == 1 ? far : 0, s / 2 == 2 ? far : 0};
    station.points = sides[s].size();
    cloud.stations.push_back(station);
    cloud.points_mm.insert(cloud.points_mm.end(), sides[s].begin(), sides[s].end());
  }
  return cloud;
}

TEST(MeshCloud, ClosesABall) {
  MeshCloudOptions o;
  o.voxel_mm = 1.0;
  const auto mesh = mesh_cloud(ball(20.0, 60'000, 0.05), o);
  ASSERT_THAT(mesh, Succeeds());
  EXPECT_TRUE(mesh->holes.empty());
  EXPECT_EQ(border_edges(mesh->mesh), 0U);
  const auto v = static_cast<double>(mesh->mesh.vertices_mm.size()),
             f = static_cast<double>(mesh->mesh.triangles.size());
  EXPECT_EQ(v - 1.5 * f + f, 2.0) << "Euler";
  double worst = 0.0, mean = 0.0;
  for (const Vec3& p : mesh->mesh.vertices_mm) {
    worst = std::max(worst, std::abs(norm(p) - 20.0));
    mean += (norm(p) - 20.0) / v;
  }
  EXPECT_LT(std::abs(mean), 1.0 / 20.0) << "voxel^2 / R";
  EXPECT_LT(worst, 1.0 / 20.0 + 5 * 0.05 / 2.0);
  const double exact = 4.0 / 3.0 * std::numbers::pi * 8000.0;
  EXPECT_NEAR(volume_of(mesh->mesh), exact, 0.01 * exact) << "facing out";
}

Cloud plane_with_gap(double side, double gap) {
  Cloud cloud;
  for (std::uint64_t i = 0; i < 80'000; ++i) {
    const Vec3 p{side * random_uniform(5, 2 * i), side * random_uniform(5, 2 * i + 1), 3.0};
    if (std::abs(p.x - 0.5 * side) < 0.5 * gap && std::abs(p.y - 0.5 * side) < 0.5 * gap) continue;
    cloud.points_mm.push_back(p);
    cloud.colours.push_back(
        {static_cast<std::uint16_t>(200.0 * p.x), 30'000, static_cast<std::uint16_t>(200.0 * p.y)});
  }
  cloud.station_mm = Vec3{50, 50, 900};
  return cloud;
}

TEST(MeshCloud, SaysWhereItHasHoles) {
  const Cloud cloud = plane_with_gap(100.0, 20.0);
  MeshCloudOptions o;
  o.voxel_mm = 1.0;
  const auto open = mesh_cloud(cloud, o);
  ASSERT_THAT(open, Succeeds());
  ASSERT_EQ(open->holes.size(), 2U);
  // The mesh reaches beyond the last points by up to a voxel.
  EXPECT_NEAR(open->holes[1].area_mm2, 400.0, 400.0 - 18.0 * 18.0);
  EXPECT_NEAR(open->holes[0].area_mm2, 10'000.0, 2.0 * 400.0);
  EXPECT_NEAR(open->holes[1].middle_mm.x, 50.0, 0.5);
  EXPECT_NEAR(open->holes[1].middle_mm.y, 50.0, 0.5);
  EXPECT_GE(open->holes[1].length_mm, 72.0);
  EXPECT_LE(open->holes[1].length_mm, 110.0);
  EXPECT_EQ(border_edges(open->mesh), open->holes[0].edges + open->holes[1].edges);
  for (std::size_t i = 0; i < open->mesh.vertices_mm.size(); ++i) {
    const Vec3 p = open->mesh.vertices_mm[i];
    ASSERT_NEAR(p.z, 3.0, 1e-6) << "means are single precision within a voxel";
    if (p.x < 3 || p.x > 97 || p.y < 3 || p.y > 97 || std::abs(p.x - 50) + std::abs(p.y - 50) < 30)
      continue;
    // A ramp of 200 a mm; points lie unevenly in a voxel.
    ASSERT_NEAR(open->colours[i].red, 200.0 * p.x, 80.0);
    ASSERT_EQ(open->colours[i].green, 30'000);
  }
  for (const auto& t : open->mesh.triangles) {
    const auto& v = open->mesh.vertices_mm;
    ASSERT_GT(cross(v[t[1]] - v[t[0]], v[t[2]] - v[t[0]]).z, 0.0) << "towards the scanner";
  }
  o.closed = true;
  const auto closed = mesh_cloud(cloud, o);
  ASSERT_THAT(closed, Succeeds());
  EXPECT_EQ(border_edges(closed->mesh), 0U);
  EXPECT_EQ(closed->holes.size(), 2U) << "what was not seen is still said";
  EXPECT_EQ(closed->colours.size(), closed->mesh.vertices_mm.size());
}

/// A plane of points as chance has them, without those in round gaps.
Cloud plane_with_round_gaps(std::uint64_t seed, double side, double per_mm2,
                            const std::vector<Vec3>& middles, double width) {
  Cloud cloud;
  for (std::uint64_t i = 0; i < static_cast<std::uint64_t>(per_mm2 * side * side); ++i) {
    const Vec3 p{side * random_uniform(seed, 2 * i), side * random_uniform(seed, 2 * i + 1), 3.0};
    if (std::none_of(middles.begin(), middles.end(),
                     [&](Vec3 m) { return std::hypot(p.x - m.x, p.y - m.y) < 0.5 * width; }))
      cloud.points_mm.push_back(p);
  }
  cloud.station_mm = Vec3{50, 50, 900};
  return cloud;
}

// Gaps of 2.5 voxels, and those that chance leaves, are closed; of six voxels all stay, with no
// area covered; a stray piece whose outline is as short as a pinhole's stays as it is.
TEST(MeshCloud, ClosesPinholesOnly) {
  std::vector<Vec3> middles;
  for (int i = 0; i < 16; ++i)
    middles.push_back({20.0 + 20.0 * (i % 4) + 0.37 * i, 20.0 + 20.0 * (i / 4) + 0.21 * i, 3.0});
  MeshCloudOptions o;
  o.voxel_mm = 1.0;
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    const auto small = mesh_cloud(plane_with_round_gaps(seed, 100.0, 4.0, middles, 2.5), o);
    ASSERT_THAT(small, Succeeds());
    EXPECT_EQ(small->holes.size(), 1U) << "the rim";
    EXPECT_GE(small->pinholes, 4U);
    EXPECT_EQ(border_edges(small->mesh), small->holes[0].edges);
    for (const auto& t : small->mesh.triangles) {
      const auto& v = small->mesh.vertices_mm;
      ASSERT_GE(cross(v[t[1]] - v[t[0]], v[t[2]] - v[t[0]]).z, 0.0);
    }
    const auto large = mesh_cloud(plane_with_round_gaps(seed, 100.0, 4.0, middles, 6.0), o);
    ASSERT_THAT(large, Succeeds());
    EXPECT_EQ(large->holes.size(), 17U) << "the rim and all gaps";
    for (std::size_t k = 1; k < large->holes.size(); ++k)
      EXPECT_GT(large->holes[k].area_mm2, 0.25 * std::numbers::pi * 4.0 * 4.0) << "a voxel less";
  }
  Cloud stray = plane_with_round_gaps(1, 40.0, 8.0, {}, 0.0);
  for (std::uint64_t i = 0; i < 30; ++i)
    stray.points_mm.push_back(
        {20.0 + 1.2 * random_uniform(9, 2 * i), 20.0 + 1.2 * random_uniform(9, 2 * i + 1), 30.0});
  const auto with_stray = mesh_cloud(stray, o);
  ASSERT_THAT(with_stray, Succeeds());
  ASSERT_EQ(with_stray->holes.size(), 2U);
  EXPECT_LT(with_stray->holes[1].length_mm, 16.0);
  EXPECT_NEAR(with_stray->holes[1].middle_mm.z, 30.0, 0.5);
}

TEST(MeshCloud, FollowsRoughGround) {
  const ModelField part = testing_support::rough_part(3, 301, 301, 1.0, 1.0);
  ScanOptions o;
  o.scanner.lines_per_turn = 8'000.0;
  o.scanner.range_sigma_mm = 1.0;
  o.station_mm = {150.0, -100.0, 650.0};
  o.footprint_rays = 1;
  const auto cloud = simulate_scan(part, {}, o);
  ASSERT_THAT(cloud, Succeeds());
  double noise = 0.0;
  for (const Vec3& p : cloud->points_mm)
    if (const double h = heightmap::height_at(part, p.x, p.y); !std::isnan(h))
      noise += (p.z - h) * (p.z - h);
  noise = std::sqrt(noise / static_cast<double>(cloud->points_mm.size()));
  MeshCloudOptions m;
  m.voxel_mm = 2.0;
  const auto mesh = mesh_cloud(*cloud, m);
  ASSERT_THAT(mesh, Succeeds());
  double square = 0.0;
  int n = 0;
  for (const Vec3& p : mesh->mesh.vertices_mm) {
    if (p.x < 5 || p.x > 295 || p.y < 5 || p.y > 295) continue;
    square += std::pow(p.z - heightmap::height_at(part, p.x, p.y), 2);
    ++n;
  }
  ASSERT_GT(n, 10'000);
  // Some 10 points and more a neighbourhood of two voxels: a quarter of the noise and the sag.
  EXPECT_GT(noise, 0.15);
  EXPECT_LT(std::sqrt(square / n), 0.35 * noise + 0.02);
  // One outer border, nothing else.
  EXPECT_EQ(mesh->holes.size(), 1U);
}

/// A cloud that is hard on a mesher: sheets a voxel apart, crossing ones, gaps, stray points.
Cloud tangle(std::uint64_t seed, int points) {
  Cloud cloud;
  for (int i = 0; i < points; ++i) {
    const auto k = static_cast<std::uint64_t>(i);
    const double u = 40.0 * random_uniform(seed, 4 * k), v = 40.0 * random_uniform(seed, 4 * k + 1);
    const double lift = 0.4 * random_normal(seed + 100, k);
    Vec3 p{u, v, 10.0 + 3.0 * std::sin(0.5 * u) + lift};
    if (i % 4 == 1) p = {u, v, 11.5 - 0.05 * u + lift};
    if (i % 4 == 2) p = {u, 20.0 + lift, 0.5 * v};
    if (i % 40 == 3) p = {u, v, 20.0 * random_uniform(seed, 4 * k + 2)};
    if (std::hypot(p.x - 12.0, p.y - 30.0) < 4.0) continue;
    cloud.points_mm.push_back(p);
  }
  cloud.colours.resize(cloud.points_mm.size(), {1000, 2000, 3000});
  cloud.station_mm = Vec3{20, -300, 400};
  return cloud;
}

TEST(MeshCloud, IsAManifoldWhateverThePoints) {
  std::uint64_t triangles = 0;
  for (std::uint64_t seed = 1; seed <= 12; ++seed)
    for (const bool closed : {false, true}) {
      MeshCloudOptions o;
      o.voxel_mm = seed % 2 == 0 ? 0.7 : 1.3;
      o.closed = closed;
      const auto mesh = mesh_cloud(tangle(seed, 15'000), o);
      ASSERT_THAT(mesh, Succeeds());
      meshing::MeshCheckOptions checks;
      checks.self_intersections = false;
      const auto certificate = meshing::check_mesh(mesh->mesh, nullptr, checks);
      ASSERT_THAT(certificate, Succeeds());
      ASSERT_TRUE(certificate->manifold) << seed;
      ASSERT_EQ(certificate->closed, closed) << seed;
      ASSERT_EQ(mesh->colours.size(), mesh->mesh.vertices_mm.size());
      triangles += certificate->triangles;
    }
  EXPECT_GT(triangles, 100'000U);
}

/// Every sign of the eight corners, and random values for each: pieces are cycles of edges.
TEST(DualCells, MeetOnEachFaceAlike) {
  for (unsigned below = 1; below < 255; ++below)
    for (std::uint64_t seed = 0; seed < 40; ++seed) {
      std::array<float, 8> f{};
      for (unsigned c = 0; c < 8; ++c)
        f[c] = static_cast<float>((below >> c & 1U ? -1.0 : 1.0) *
                                  (0.05 + random_uniform(seed, 8 * below + c)));
      const detail::CellSurfaces s = detail::surfaces_of(f);
      ASSERT_EQ(s.below, below);
      ASSERT_GE(s.count, 1);
      ASSERT_LE(s.count, 4);
      std::array<int, 4> edges{};
      for (unsigned e = 0; e < 12; ++e)
        if (s.crosses(e)) ++edges[s.piece(e)];
      // Three edges at least, and none without.
      for (unsigned k = 0; k < 4; ++k) ASSERT_TRUE(k < s.count ? edges[k] >= 3 : edges[k] == 0);
    }
}

TEST(MeshCloud, ChoosesItsVoxel) {
  const auto mesh = mesh_cloud(plane_with_gap(100.0, 0.0));
  ASSERT_THAT(mesh, Succeeds());
  // 8 points a mm^2, four a voxel.
  EXPECT_NEAR(mesh->voxel_mm, std::sqrt(0.5), 0.2);
}

TEST(MeshCloud, IsWrittenForOthers) {
  const ScratchFolder folder;
  MeshCloudOptions o;
  o.voxel_mm = 2.0;
  const auto mesh = mesh_cloud(plane_with_gap(100.0, 20.0), o);
  ASSERT_THAT(mesh, Succeeds());
  ASSERT_THAT(write_mesh_ply(*mesh, folder / "m.ply"), Succeeds());
  const auto back = meshing::read_mesh(folder / "m.ply");
  ASSERT_THAT(back, Succeeds());
  EXPECT_EQ(back->vertices_mm, mesh->mesh.vertices_mm);
  EXPECT_EQ(back->triangles, mesh->mesh.triangles);
}

TEST(MeshCloudRefuses, WhatMakesNoSurface) {
  Cloud few;
  for (int i = 0; i < 10; ++i) few.points_mm.push_back({1.0 * i, 0, 0});
  EXPECT_THAT(mesh_cloud(few), FailsWith(kMeshCloudSparse));
  Cloud line;
  for (int i = 0; i < 500; ++i) line.points_mm.push_back({0.1 * i, 0, 0});
  EXPECT_THAT(mesh_cloud(line), FailsWith(kMeshCloudSparse));
  MeshCloudOptions o;
  o.voxel_mm = -1.0;
  EXPECT_THAT(mesh_cloud(plane_with_gap(100.0, 0.0), o), FailsWith(kMeshCloudOptions));
  o.voxel_mm = 1e-6;
  EXPECT_THAT(mesh_cloud(plane_with_gap(100.0, 0.0), o), FailsWith(kMeshCloudOptions));
  std::stop_source stop;
  stop.request_stop();
  RunContext run;
  run.stop = stop.get_token();
  EXPECT_THAT(mesh_cloud(plane_with_gap(100.0, 0.0), {}, run), FailsWith(kCancelled));
}

}  // namespace
}  // namespace maquette::scan
