// SPDX-License-Identifier: GPL-3.0-or-later

// What is claimed in scan/clean.hpp, and how each claim is attacked:
//
//   mixed points .......... the Z+F 5006h at 1.4 m before stones on rough ground; each point's beam
//                           is sampled again by 37 rays, so it is known which points float between
//                           two surfaces: recall and precision, with the grid and without, at
//                           three spacings; a steep slope and rough ground have next to none
//   isolated points ....... every planted one found; both halves of the claim by counting all
//                           pairs; and which points exactly, by a map of voxels
//   thinning .............. against sums over the points of each voxel, in double; in runs of
//                           slices to the same as at once
//   normals ............... towards the scanner of each of two stations
//   off the part .......... the box
//   files ................. what is done to a file is what is done in memory; statistics come back
//   every refusal ......... one case each

#include "scan/clean.hpp"

#include <array>
#include <cmath>
#include <map>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "scan/detail/beam.hpp"
#include "scan/detail/scan_scene.hpp"
#include "scan/scanner_sim.hpp"
#include "support/matchers.hpp"
#include "support/scan_terrain.hpp"
#include "support/shapes.hpp"

namespace maquette::scan {
namespace {

using heightmap::ModelField;
using testing_support::FailsWith;
using testing_support::rough_part;
using testing_support::ScratchFolder;
using testing_support::Succeeds;

constexpr Vec3 kStation{150.0, -700.0, 1100.0};

ScanOptions phase_shift(double lines_per_turn) {
  ScanOptions o;
  o.scanner = *assets::find_preset(assets::scanner_presets(), "zf5006h");
  o.scanner.lines_per_turn = lines_per_turn;
  o.station_mm = kStation;
  return o;
}

std::vector<TriMesh> some_stones(const ModelField& ground) {
  std::vector<TriMesh> stones;
  const double side = ground.x_mm(ground.z_mm.cols() - 1);
  for (std::uint64_t i = 0; i < static_cast<std::uint64_t>(side / 25.0); ++i) {
    const Vec3 at{side * (0.15 + 0.7 * random_uniform(77, 3 * i)),
                  side * (0.15 + 0.7 * random_uniform(77, 3 * i + 1)), 0.0};
    const double radius = 10.0 + 20.0 * random_uniform(77, 3 * i + 2);
    TriMesh m = testing_support::unit_sphere(4);
    const double z = heightmap::height_at(ground, at.x, at.y) + 0.5 * radius;
    for (Vec3& v : m.vertices_mm)
      v = Vec3{at.x, at.y, z} + Vec3{radius * v.x, 0.8 * radius * v.y, 0.9 * radius * v.z};
    stones.push_back(std::move(m));
  }
  return stones;
}

// Five standard deviations of a range (0.24 mm, that of the preset on grey at 1.4 m).
constexpr double kFloats = 1.2;

struct Truth {
  std::vector<bool> floats;   // between surfaces in its beam, and kFloats away from all of them
  std::vector<bool> several;  // its beam meets surfaces that are half a millimetre apart in range
};

/// What the beams of a scan met.
Truth truth_of(const Cloud& cloud, const ModelField& ground, std::span<const TriMesh> stones,
               const ScanOptions& o) {
  const auto scene = detail::ScanScene::build(ground, stones);
  EXPECT_TRUE(scene.has_value());
  const auto samples = detail::beam_samples(o.edge_rays);
  Truth t;
  for (const Vec3& p : cloud.points_mm) {
    const Vec3 axis = normalized(p - o.station_mm);
    std::vector<double> ranges;
    for (const auto& s : samples) {
      const auto ray = detail::skew_ray(o.station_mm, axis, 0.5 * o.scanner.beam_diameter_mm,
                                        1e-3 * o.scanner.beam_divergence_mrad, s, 1.0, 0.0);
      if (const auto echo = scene->look(ray.origin_mm, ray.direction))
        ranges.push_back(echo->range_mm);
    }
    std::sort(ranges.begin(), ranges.end());
    const double range = norm(p - o.station_mm);
    double nearest = INFINITY, gap = 0.0;
    for (std::size_t i = 0; i < ranges.size(); ++i) {
      nearest = std::min(nearest, std::abs(ranges[i] - range));
      if (i > 0) gap = std::max(gap, ranges[i] - ranges[i - 1]);
    }
    t.floats.push_back(nearest > kFloats && gap > kFloats);
    t.several.push_back(gap > 0.5);
  }
  return t;
}

/// Marks what cleaning took out: what stays is a subsequence.
std::vector<bool> taken_out(const Cloud& all, const Cloud& kept) {
  std::vector<bool> out(all.points_mm.size(), true);
  std::size_t k = 0;
  for (std::size_t i = 0; i < out.size(); ++i)
    if (k < kept.points_mm.size() && kept.points_mm[k] == all.points_mm[i]) {
      out[i] = false;
      ++k;
    }
  EXPECT_EQ(k, kept.points_mm.size());
  return out;
}

CleanOptions only_mixed() {
  CleanOptions o;
  o.least_neighbours = 0;
  return o;
}

struct Score {
  int points = 0, floating = 0, found = 0, taken = 0, right = 0;
  [[nodiscard]] double recall() const { return static_cast<double>(found) / floating; }
  [[nodiscard]] double precision() const { return static_cast<double>(right) / taken; }
};

Score score_of(double lines_per_turn, std::ptrdiff_t side, bool with_grid) {
  const ModelField ground = rough_part(3, side, side, 1.0, 1.0);
  const auto stones = some_stones(ground);
  const ScanOptions o = phase_shift(lines_per_turn);
  auto cloud = simulate_scan(ground, stones, o);
  EXPECT_TRUE(cloud.has_value());
  const Truth truth = truth_of(*cloud, ground, stones, o);
  if (!with_grid) cloud->grid.clear();
  Cloud kept = *cloud;
  const auto figures = clean_cloud(kept, only_mixed());
  EXPECT_THAT(figures, Succeeds());
  const auto out = taken_out(*cloud, kept);
  Score s;
  for (std::size_t i = 0; i < out.size(); ++i) {
    ++s.points;
    s.floating += truth.floats[i] ? 1 : 0;
    s.found += truth.floats[i] && out[i] ? 1 : 0;
    s.taken += out[i] ? 1 : 0;
    s.right += out[i] && truth.several[i] ? 1 : 0;
  }
  EXPECT_EQ(figures->mixed, static_cast<std::uint64_t>(s.taken));
  EXPECT_EQ(figures->kept, kept.points_mm.size());
  return s;
}

TEST(CleanMixed, FindsWhatFloatsBetweenTwoSurfaces) {
  for (const Score& s : {score_of(20'000.0, 121, true), score_of(10'000.0, 201, true),
                         score_of(5'000.0, 301, true)}) {
    EXPECT_GT(s.floating, 100);
    EXPECT_GT(s.recall(), 0.95);
    EXPECT_GT(s.precision(), 0.90);
  }
  const Score s = score_of(10'000.0, 201, false);
  EXPECT_GT(s.recall(), 0.95);
  EXPECT_GT(s.precision(), 0.95);
}

TEST(CleanMixed, LeavesSlopesAndRoughGroundAlone) {
  // A beam without width mixes nothing: what is taken out is wrong.
  for (const double steep : {0.0, 1.5}) {
    ModelField ground = rough_part(4, 201, 201, 1.0, 1.5);
    for (std::ptrdiff_t r = 0; r < 201; ++r)
      for (std::ptrdiff_t c = 0; c < 201; ++c)
        ground.z_mm(r, c) += static_cast<float>(steep * static_cast<double>(r));
    ScanOptions o = phase_shift(8'000.0);
    o.footprint_rays = 1;
    auto cloud = simulate_scan(ground, {}, o);
    ASSERT_THAT(cloud, Succeeds());
    const auto n = static_cast<double>(cloud->points_mm.size());
    const auto figures = clean_cloud(*cloud, only_mixed());
    ASSERT_THAT(figures, Succeeds());
    EXPECT_LT(static_cast<double>(figures->mixed), (steep > 0.0 ? 0.0001 : 0.006) * n);
  }
}

TEST(CleanMixed, IsNotJudgedWithoutAScanner) {
  const ModelField ground = rough_part(3, 101, 101, 1.0, 1.0);
  auto cloud = simulate_scan(ground, some_stones(ground), phase_shift(8'000.0));
  ASSERT_THAT(cloud, Succeeds());
  Cloud plain;
  plain.points_mm = cloud->points_mm;
  const auto figures = clean_cloud(plain, only_mixed());
  ASSERT_THAT(figures, Succeeds());
  EXPECT_EQ(figures->not_judged, 1U);
  EXPECT_EQ(figures->mixed, 0U);
}

/// A plane of points, some planted around it.
Cloud plane_and_dust(std::size_t dust, std::vector<Vec3>& planted) {
  Cloud cloud;
  for (std::uint64_t i = 0; i < 20'000; ++i)
    cloud.points_mm.push_back(
        {100.0 * random_uniform(1, 3 * i), 100.0 * random_uniform(1, 3 * i + 1), 0.0});
  // In clumps of up to three, 6 mm and more from the plane and from each other.
  for (std::size_t i = 0; i < dust; ++i) {
    const Vec3 p{8.0 * static_cast<double>(i % 12), 8.0 * static_cast<double>(i / 12 % 12),
                 6.0 + 8.0 * static_cast<double>(i / 144)};
    for (std::size_t k = 0; k <= i % 3; ++k)
      planted.push_back(p + Vec3{0.0, 0.0, 0.3 * static_cast<double>(k)});
  }
  // Among the others, not behind them.
  std::size_t next = 0;
  std::vector<Vec3> all;
  for (std::size_t i = 0; i < cloud.points_mm.size(); ++i) {
    all.push_back(cloud.points_mm[i]);
    if (i % 40 == 7 && next < planted.size()) all.push_back(planted[next++]);
  }
  EXPECT_EQ(next, planted.size());
  cloud.points_mm = std::move(all);
  return cloud;
}

TEST(CleanIsolated, FindsAllThatArePlanted) {
  std::vector<Vec3> planted;
  const Cloud cloud = plane_and_dust(200, planted);
  Cloud kept = cloud;
  const auto figures = clean_cloud(kept);
  ASSERT_THAT(figures, Succeeds());
  // 2 points a mm^2: eight in voxels of 2 mm.
  EXPECT_NEAR(figures->voxel_mm, 2.0, 0.4);
  EXPECT_EQ(figures->isolated, planted.size());
  EXPECT_EQ(kept.points_mm.size(), 20'000U);
  for (const Vec3& p : kept.points_mm) ASSERT_EQ(p.z, 0.0);
}

TEST(CleanIsolated, IsWhatTheHeaderSays) {
  // Points at random in a box, from 10 a voxel at one end to one in 20 voxels at the other.
  Cloud cloud;
  for (std::uint64_t i = 0; i < 3'000; ++i)
    cloud.points_mm.push_back({40.0 * std::pow(random_uniform(9, 3 * i), 4),
                               20.0 * random_uniform(9, 3 * i + 1),
                               20.0 * random_uniform(9, 3 * i + 2)});
  CleanOptions o;
  o.voxel_mm = 1.0;
  o.least_neighbours = 10;
  Cloud kept = cloud;
  ASSERT_THAT(clean_cloud(kept, o), Succeeds());
  const auto out = taken_out(cloud, kept);
  int sure_out = 0, sure_in = 0;
  for (std::size_t i = 0; i < out.size(); ++i) {
    int within_voxel = 0, within_block = 0;
    for (const Vec3& q : cloud.points_mm) {
      const double d = norm(q - cloud.points_mm[i]);
      within_voxel += d <= 1.0 ? 1 : 0;
      within_block += d <= 2.0 * std::sqrt(3.0) ? 1 : 0;
    }
    if (within_block < 10) {
      ++sure_out;
      ASSERT_TRUE(out[i]);
    }
    if (within_voxel >= 10) {
      ++sure_in;
      ASSERT_FALSE(out[i]);
    }
  }
  EXPECT_GT(sure_out + sure_in, 5);
  // And exactly, by the voxels themselves, wherever the blocks they are kept in end.
  Box3 box;
  for (const Vec3& p : cloud.points_mm) box.add(p);
  const Vec3 corner = box.min - 4.381966 * Vec3{1, 1, 1};
  const auto voxel_of = [&](Vec3 p) {
    const Vec3 q = p - corner;
    return std::array{static_cast<long>(q.x), static_cast<long>(q.y), static_cast<long>(q.z)};
  };
  std::map<std::array<long, 3>, int> counts;
  for (const Vec3& p : cloud.points_mm) ++counts[voxel_of(p)];
  for (std::size_t i = 0; i < out.size(); ++i) {
    const auto at = voxel_of(cloud.points_mm[i]);
    int around = 0;
    for (long n = 0; n < 27; ++n) {
      const auto found = counts.find({at[0] + n / 9 - 1, at[1] + n / 3 % 3 - 1, at[2] + n % 3 - 1});
      if (found != counts.end()) around += found->second;
    }
    ASSERT_EQ(out[i], around < 10) << i;
  }
  EXPECT_GT(std::count(out.begin(), out.end(), true), 100);
  EXPECT_GT(std::count(out.begin(), out.end(), false), 100);
}

TEST(CleanThins, ToTheStatisticsOfEachVoxel) {
  const ModelField ground = rough_part(6, 151, 151, 1.0, 2.0);
  ScanOptions s = phase_shift(6'000.0);
  s.colour = true;
  s.paint = [](Vec3 p, bool) {
    return SurfaceLook{0.3,
                       {static_cast<std::uint16_t>(200.0 * p.x), 30'000,
                        static_cast<std::uint16_t>(60'000.0 - 200.0 * p.y)}};
  };
  const auto cloud = simulate_scan(ground, {}, s);
  ASSERT_THAT(cloud, Succeeds());
  CleanOptions o;
  o.mixed = false;
  o.least_neighbours = 0;
  o.thin_mm = 7.0;
  Cloud thin = *cloud;
  const auto figures = clean_cloud(thin, o);
  ASSERT_THAT(figures, Succeeds());
  ASSERT_EQ(figures->written, thin.points_mm.size());
  ASSERT_EQ(thin.counts.size(), thin.points_mm.size());
  std::uint64_t all = 0;
  for (const std::uint32_t n : thin.counts) all += n;
  EXPECT_EQ(all, cloud->points_mm.size());

  // The voxels' corner is not told: it is found as the one at which the means come out.
  Box3 box;
  for (const Vec3& p : cloud->points_mm) box.add(p);
  const Vec3 corner = box.min - 4.381966 * 7.0 * Vec3{1, 1, 1};
  struct Sums {
    std::vector<std::size_t> points;
  };
  std::map<std::array<long, 3>, Sums> voxels;
  for (std::size_t i = 0; i < cloud->points_mm.size(); ++i) {
    const Vec3 q = (1.0 / 7.0) * (cloud->points_mm[i] - corner);
    voxels[{static_cast<long>(q.x), static_cast<long>(q.y), static_cast<long>(q.z)}]
        .points.push_back(i);
  }
  ASSERT_EQ(voxels.size(), thin.points_mm.size());
  for (std::size_t k = 0; k < thin.points_mm.size(); ++k) {
    const Vec3 q = (1.0 / 7.0) * (thin.points_mm[k] - corner);
    const auto found =
        voxels.find({static_cast<long>(q.x), static_cast<long>(q.y), static_cast<long>(q.z)});
    ASSERT_NE(found, voxels.end());
    const auto& points = found->second.points;
    ASSERT_EQ(thin.counts[k], points.size());
    const auto n = static_cast<double>(points.size());
    Vec3 mean;
    double red = 0, blue = 0, intensity = 0, square = 0;
    for (const std::size_t i : points) {
      mean += (1.0 / n) * cloud->points_mm[i];
      red += cloud->colours[i].red / n;
      blue += cloud->colours[i].blue / n;
      intensity += static_cast<double>(cloud->intensity[i]) / n;
    }
    for (const std::size_t i : points)
      square += dot(cloud->points_mm[i] - mean, cloud->points_mm[i] - mean) / n;
    ASSERT_LT(norm(thin.points_mm[k] - mean), 7e-6);
    ASSERT_NEAR(static_cast<double>(thin.spread_mm[k]), std::sqrt(square), 7e-5);
    ASSERT_NEAR(thin.colours[k].red, red, 0.6);
    ASSERT_NEAR(thin.colours[k].blue, blue, 0.6);
    ASSERT_NEAR(static_cast<double>(thin.intensity[k]), intensity, 1e-5 * intensity);
  }
}

TEST(CleanThins, InRunsOfSlicesToTheSame) {
  const ModelField ground = rough_part(6, 151, 151, 1.0, 2.0);
  const auto cloud = simulate_scan(ground, {}, phase_shift(3'000.0));
  ASSERT_THAT(cloud, Succeeds());
  CleanOptions o;
  o.thin_mm = 7.0;
  Cloud whole = *cloud, runs = *cloud;
  const auto of_whole = clean_cloud(whole, o);
  ASSERT_THAT(of_whole, Succeeds());
  o.voxels_at_once = 100;  // of some 600: six runs or more
  const auto of_runs = clean_cloud(runs, o);
  ASSERT_THAT(of_runs, Succeeds());
  ASSERT_GT(of_whole->written, 500U);
  EXPECT_EQ(of_runs->written, of_whole->written);
  EXPECT_EQ(of_runs->kept, of_whole->kept);
  EXPECT_EQ(of_runs->isolated, of_whole->isolated);
  EXPECT_EQ(runs.stations.size(), 1U);
  EXPECT_NE(runs.points_mm, whole.points_mm);  // another order
  struct Row {
    std::array<double, 6> place_and_normal;
    std::uint32_t count;
    float spread, intensity;
    auto operator<=>(const Row&) const = default;
  };
  const auto rows_of = [](const Cloud& c) {
    std::vector<Row> rows;
    for (std::size_t i = 0; i < c.points_mm.size(); ++i) {
      const Vec3 p = c.points_mm[i], n = c.normals[i];
      rows.push_back({{p.x, p.y, p.z, n.x, n.y, n.z}, c.counts[i], c.spread_mm[i], c.intensity[i]});
    }
    std::sort(rows.begin(), rows.end());
    return rows;
  };
  EXPECT_EQ(rows_of(runs), rows_of(whole));
}

TEST(CleanNormals, FaceTheirScanner) {
  // A sheet seen from above by one station and from below by another.
  Cloud cloud;
  for (int side = 0; side < 2; ++side) {
    for (std::uint64_t i = 0; i < 5'000; ++i) {
      const auto u = static_cast<std::uint64_t>(side);
      const double x = 100.0 * random_uniform(20 + u, 3 * i),
                   y = 100.0 * random_uniform(20 + u, 3 * i + 1);
      cloud.points_mm.push_back({x, y, 0.2 * x + (side == 0 ? 30.0 : 0.0)});
    }
    ScanStation s;
    s.points = 5'000;
    s.position_mm = Vec3{50, 50, side == 0 ? 900.0 : -900.0};
    // Its frame is turned: normals must be brought there and back.
    s.model_from_station.rotation = rotation_about(normalized(Vec3{1, 2, 3}), 0.7);
    s.model_from_station.translation_mm = *s.position_mm;
    cloud.stations.push_back(s);
  }
  CleanOptions o;
  o.normals = true;
  ASSERT_THAT(clean_cloud(cloud, o), Succeeds());
  ASSERT_EQ(cloud.normals.size(), 10'000U);
  const Vec3 up = normalized(Vec3{-0.2, 0, 1});
  for (std::size_t i = 0; i < 10'000; ++i)
    ASSERT_LT(norm(cloud.normals[i] - (i < 5'000 ? up : -up)), 1e-4) << i;
  // Nobody knows where the scanner was: no side is the right one.
  Cloud nowhere;
  nowhere.points_mm.assign(cloud.points_mm.begin(), cloud.points_mm.begin() + 5'000);
  ASSERT_THAT(clean_cloud(nowhere, o), Succeeds());
  for (const Vec3& n : nowhere.normals) ASSERT_EQ(n, Vec3{});
}

TEST(CleanNormals, InRunsOfSlicesToTheSame) {
  const ModelField ground = rough_part(6, 151, 151, 1.0, 2.0);
  const auto cloud = simulate_scan(ground, {}, phase_shift(6'000.0));
  ASSERT_THAT(cloud, Succeeds());
  CleanOptions o;
  o.normals = true;
  Cloud whole = *cloud, runs = *cloud;
  const auto of_whole = clean_cloud(whole, o);
  ASSERT_THAT(of_whole, Succeeds());
  o.voxels_at_once = 100;
  const auto of_runs = clean_cloud(runs, o);
  ASSERT_THAT(of_runs, Succeeds());
  ASSERT_GT(of_whole->written, 8U * 600U) << "eight points a voxel: six runs or more";
  EXPECT_EQ(of_runs->isolated, of_whole->isolated);
  EXPECT_EQ(of_runs->kept, of_whole->kept);
  EXPECT_EQ(of_runs->written, of_whole->kept);
  EXPECT_EQ(runs.points_mm, whole.points_mm);
  EXPECT_EQ(runs.normals, whole.normals);
}

TEST(Clean, KeepsToThePart) {
  std::vector<Vec3> planted;
  Cloud cloud = plane_and_dust(0, planted);
  CleanOptions o;
  o.part_mm = Box3{{10, 20, -1}, {60, 90, 1}};
  const auto figures = clean_cloud(cloud, o);
  ASSERT_THAT(figures, Succeeds());
  EXPECT_EQ(figures->off_part + figures->kept, 20'000U);
  EXPECT_NEAR(static_cast<double>(figures->kept), 20'000 * 0.5 * 0.7, 4.0 * std::sqrt(20'000.0));
  for (const Vec3& p : cloud.points_mm)
    ASSERT_TRUE(p.x >= 10 && p.x <= 60 && p.y >= 20 && p.y <= 90);
}

TEST(Clean, FilesAreCleanedAsMemoryIs) {
  const ScratchFolder folder;
  const ModelField ground = rough_part(3, 151, 151, 1.0, 1.0);
  const auto stones = some_stones(ground);
  ScanOptions o = phase_shift(8'000.0);
  {
    const auto writer = create_cloud(folder / "two.e57");
    ASSERT_THAT(writer, Succeeds());
    ASSERT_THAT(simulate_scan(ground, stones, o, **writer), Succeeds());
    o.station_mm = {900.0, 100.0, 900.0};
    o.station_rotation = rotation_about(Vec3{0, 0, 1}, 0.4);
    ASSERT_THAT(simulate_scan(ground, stones, o, **writer), Succeeds());
    ASSERT_THAT((*writer)->finish(), Succeeds());
  }
  auto memory = read_cloud(folder / "two.e57");
  ASSERT_THAT(memory, Succeeds());
  CleanOptions c;
  c.normals = true;
  const auto there = clean_cloud(folder / "two.e57", folder / "clean.e57", c);
  ASSERT_THAT(there, Succeeds());
  const auto here = clean_cloud(*memory, c);
  ASSERT_THAT(here, Succeeds());
  EXPECT_GT(there->mixed, 100U);
  EXPECT_EQ(there->mixed, here->mixed);
  EXPECT_EQ(there->isolated, here->isolated);
  EXPECT_EQ(there->kept, here->kept);
  const auto back = read_cloud(folder / "clean.e57");
  ASSERT_THAT(back, Succeeds());
  ASSERT_EQ(back->stations.size(), 2U);
  ASSERT_EQ(back->points_mm.size(), memory->points_mm.size());
  for (std::size_t i = 0; i < back->points_mm.size(); ++i) {
    ASSERT_LT(norm(back->points_mm[i] - memory->points_mm[i]), 1e-9);
    ASSERT_LT(norm(back->normals[i] - memory->normals[i]), 1e-6);
  }
  c.thin_mm = 4.0;
  auto thin = *memory;
  ASSERT_THAT(clean_cloud(thin, c), Succeeds());
  for (const char* name : {"thin.ply", "thin.csv"}) {
    ASSERT_THAT(write_cloud(thin, folder / name), Succeeds());
    const auto again = read_cloud(folder / name);
    ASSERT_THAT(again, Succeeds());
    EXPECT_EQ(again->counts, thin.counts) << name;
    EXPECT_EQ(again->spread_mm, thin.spread_mm) << name;
    EXPECT_EQ(again->points_mm, thin.points_mm) << name;
  }
}

TEST(CleanRefuses, WhatItCannotClean) {
  std::vector<Vec3> planted;
  const Cloud cloud = plane_and_dust(0, planted);
  const auto with = [&](const auto& change) {
    CleanOptions o;
    change(o);
    Cloud copy = cloud;
    return clean_cloud(copy, o);
  };
  EXPECT_THAT(with([](CleanOptions& o) { o.beam_diameter_mm = -1; }), FailsWith(kCleanOptions));
  EXPECT_THAT(with([](CleanOptions& o) { o.thin_mm = NAN; }), FailsWith(kCleanOptions));
  EXPECT_THAT(with([](CleanOptions& o) { o.voxel_mm = 1e-7; }), FailsWith(kCleanOptions));
  EXPECT_THAT(with([](CleanOptions& o) { o.thin_mm = 1e-7; }), FailsWith(kCleanOptions));
  EXPECT_THAT(with([](CleanOptions& o) { o.least_neighbours = 40'000; }), FailsWith(kCleanOptions));
  EXPECT_THAT(with([](CleanOptions& o) {
                o.part_mm = Box3{{500, 0, 0}, {600, 9, 9}};
              }),
              FailsWith(kCloudEmpty));
  Cloud none;
  EXPECT_THAT(clean_cloud(none), FailsWith(kCloudEmpty));
  std::stop_source stop;
  stop.request_stop();
  RunContext run;
  run.stop = stop.get_token();
  Cloud copy = cloud;
  EXPECT_THAT(clean_cloud(copy, {}, run), FailsWith(kCancelled));
}

}  // namespace
}  // namespace maquette::scan
