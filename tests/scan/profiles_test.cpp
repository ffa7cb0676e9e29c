// SPDX-License-Identifier: GPL-3.0-or-later

// What is claimed in scan/profiles.hpp, worst_places.hpp and of stone_regions(), and how:
//
//   means ............ a wave along a line at an angle, without noise: its closed form
//   sigma ............ many lines over independent noise: normalised errors have rms 1; correlation
//                      and a pose's covariance by their formulas
//   which points ..... by hand: width, ends, gaps
//   worst places ..... the farthest beyond the level of detection first, none beside one before,
//   ties in a fixed order stones ........... each vertex of a stone is in its outline, what is
//   beside it is not

#include "scan/profiles.hpp"

#include <cmath>
#include <limits>
#include <numbers>

#include <fmt/format.h>
#include <gtest/gtest.h>

#include "core/random.hpp"
#include "scan/regions.hpp"
#include "scan/worst_places.hpp"
#include "support/scan_terrain.hpp"

namespace maquette::scan {
namespace {

using heightmap::ModelField;

const ModelField kFlat{Grid<float>(101, 101, 5.0F), Millimetres{1.0}};

TEST(Profiles, OfAWaveIsTheWave) {
  // Along (3, 4) / 5; the deviation is a wave of that direction, 40 mm long.
  std::vector<Vec3> points;
  std::vector<float> d;
  constexpr double kLong = 40.0;
  for (int i = 0; i < 1000; ++i)
    for (int j = 0; j < 1000; ++j) {
      const Vec3 p{0.1 * i, 0.1 * j, 5.0};
      points.push_back(p);
      d.push_back(static_cast<float>(
          std::sin(2.0 * std::numbers::pi * (0.6 * (p.x - 10.0) + 0.8 * (p.y - 10.0)) / kLong)));
    }
  const Profile p =
      profile_along(points, d, {"w", {10, 10, 0}, {64, 82, 0}, 4.0, 2.0}, kFlat, 1.0, nullptr);
  ASSERT_EQ(p.mean_mm.size(), 45U);  // 90 mm
  EXPECT_DOUBLE_EQ(p.step_mm, 2.0);
  // A stretch of 2 mm holds some 800 places: the mean of a wave over it is sinc(2/40) = 0.996 of
  // its middle; places 0.1 mm apart leave the middle uncertain by 0.005 mm, 0.0008 of the wave.
  const double part = std::sin(std::numbers::pi * 2.0 / kLong) / (std::numbers::pi * 2.0 / kLong);
  for (std::size_t k = 0; k < p.mean_mm.size(); ++k) {
    EXPECT_NEAR(p.along_mm[k], 2.0 * static_cast<double>(k) + 1.0, 1e-9);
    EXPECT_NEAR(p.mean_mm[k], part * std::sin(2.0 * std::numbers::pi * p.along_mm[k] / kLong), 2e-3)
        << k;
    EXPECT_NEAR(p.at_mm[k].x, 10.0 + 0.6 * p.along_mm[k], 1e-9);
    EXPECT_EQ(p.at_mm[k].z, 5.0);
  }
}

TEST(Profiles, StateTheirUncertainty) {
  // 20 lines of some 100 stretches: rms of 2000 normalised errors is 1 to 0.016.
  double square = 0.0, n = 0.0;
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    std::vector<Vec3> points;
    std::vector<float> d;
    for (std::uint64_t i = 0; i < 100'000; ++i) {
      points.push_back(
          {100.0 * random_uniform(seed, 2 * i), 100.0 * random_uniform(seed, 2 * i + 1), 5.0});
      d.push_back(static_cast<float>(0.3 + 0.2 * random_normal(seed + 100, i)));
    }
    const double y = 20.0 + 3.0 * static_cast<double>(seed);
    const Profile p = profile_along(points, d, {"n", {1, y, 0}, {99, 100.0 - y, 0}, 2.0, 0.0},
                                    kFlat, 1.0, nullptr);
    EXPECT_GT(p.mean_mm.size(), 50U);
    for (std::size_t k = 0; k < p.mean_mm.size(); ++k, n += 1.0)
      square += std::pow((p.mean_mm[k] - 0.3) / p.sigma_mm[k], 2);
  }
  RecordProperty("rms", fmt::format("{:.3f}", std::sqrt(square / n)));
  EXPECT_NEAR(std::sqrt(square / n), 1.0, 0.05);
}

TEST(Profiles, CountPointsWithinTheirWidth) {
  // 20 points a stretch at +-0.1: variance 0.01 * 20 / 19 in each.
  std::vector<Vec3> points;
  std::vector<float> d;
  for (int stretch = 0; stretch < 10; ++stretch)
    for (int k = 0; k < 20; ++k) {
      if (stretch == 4 && k > 1) continue;  // a gap: two points
      points.push_back({10.0 + stretch + 0.05 * k + 0.01, 50.0 + (k % 2 == 0 ? 0.9 : -0.9), 5.0});
      d.push_back(k % 2 == 0 ? 0.1F : -0.1F);
    }
  for (const Vec3 beside :
       {Vec3{9.9, 50, 5}, Vec3{20.1, 50, 5}, Vec3{15, 51.1, 5}, Vec3{15, 48.9, 5}}) {
    points.push_back(beside);
    d.push_back(9.0F);
  }
  points.push_back({15.5, 50.0, 5.0});
  d.push_back(NAN);
  Registration pose;
  pose.covariance[14] = 0.03 * 0.03;  // along z
  const ProfileLine line{"p", {10, 50, 0}, {20, 50, 0}, 2.0, 1.0};
  const Profile known = profile_along(points, d, line, kFlat, 1.0, nullptr);
  const Profile unsure = profile_along(points, d, line, kFlat, 1.5, &pose);
  ASSERT_EQ(known.mean_mm.size(), 10U);
  // Freedom 19 is below 20: pooled with the others, of which all but the gap's are alike.
  const double variance = 0.01 * 20.0 / 19.0;
  for (std::size_t k = 0; k < 10; ++k) {
    EXPECT_EQ(known.points[k], k == 4 ? 2U : 20U) << k;
    EXPECT_EQ(std::isnan(known.mean_mm[k]), k == 4) << k;
    if (k == 4) continue;
    EXPECT_NEAR(known.mean_mm[k], 0.0, 1e-8);
    EXPECT_NEAR(known.sigma_mm[k], std::sqrt(variance / 20.0), 2e-4);
    EXPECT_NEAR(unsure.sigma_mm[k], std::hypot(1.5 * known.sigma_mm[k], 0.03), 1e-12);
  }
}

TEST(WorstPlaces, AreTheLargestOfEachNeighbourhood) {
  CellMap map;
  map.cell_mm = 2.0;
  map.x0_mm = 10.0;
  map.y0_mm = -4.0;
  map.mean_mm = Grid<float>(20, 30, 0.01F);
  map.lod_mm = Grid<float>(20, 30, 0.05F);
  map.significant = Grid<std::uint8_t>(20, 30, 0);
  map.mean_mm(3, 4) = -0.5F;
  map.mean_mm(3, 5) = -0.4F;  // 2 mm beside it
  map.mean_mm(10, 20) = 0.3F;
  map.mean_mm(15, 2) = -0.3F;  // as large: the southern one first
  map.mean_mm(0, 0) = NAN;
  map.mean_mm(19, 29) = 0.9F;  // the largest, and hardly known
  map.lod_mm(19, 29) = 0.88F;
  map.significant(3, 4) = map.significant(10, 20) = 1;
  const auto places = worst_places(map, 3, 5.0);
  ASSERT_EQ(places.size(), 3U);
  EXPECT_EQ(places[0].at_mm, (Vec3{10.0 + 4.5 * 2.0, -4.0 + 3.5 * 2.0, 0.0}));
  EXPECT_NEAR(places[0].mean_mm, -0.5, 1e-7);
  EXPECT_NEAR(places[0].lod_mm, 0.05, 1e-7);
  EXPECT_TRUE(places[0].significant);
  EXPECT_NEAR(places[1].mean_mm, 0.3, 1e-7);
  EXPECT_NEAR(places[2].mean_mm, -0.3, 1e-7);
  EXPECT_FALSE(places[2].significant);
  Finding wide;
  wide.min_mm = {10.0, 24.0, 0.0};
  wide.max_mm = {20.0, 30.0, 0.0};
  EXPECT_TRUE(worst_places(map, 3, 5.0, {&wide, 1})[2].significant);
  EXPECT_EQ(worst_places(map, 1000, 100.0).size(), 1U);
  EXPECT_TRUE(worst_places(CellMap{}, 5, 1.0).empty());
}

TEST(StoneRegions, CoverTheStone) {
  std::vector<meshing::PlacedStone> plan(2);
  for (int k = 0; k < 2; ++k) {
    auto& s = plan[static_cast<std::size_t>(k)];
    s.number = k + 4;
    s.shape.seed = 7 + static_cast<std::uint64_t>(k);
    s.shape.flatness = 0.6;
    s.shape.elongation = 0.5;
    s.scale_mm = 12.0;
    s.model_from_stone.rotation = rotation_about({0, 0, 1}, 1.0 + k);
    s.model_from_stone.translation_mm = {30.0 + 40.0 * k, 50.0, 5.0};
  }
  const auto regions = stone_regions(plan);
  ASSERT_EQ(regions.size(), 2U);
  for (std::size_t k = 0; k < 2; ++k) {
    EXPECT_EQ(regions[k].name, fmt::format("stone {}", k + 4));
    const TriMesh mesh = meshing::stone_mesh(plan[k]);
    const Box3 box = mesh.bounds();
    const Vec3 middle = 0.5 * (box.min + box.max);
    for (const Vec3& v : mesh.vertices_mm) {
      // A hair inwards: corners of the outline are on it.
      EXPECT_TRUE(regions[k].holds(v.x + 1e-6 * (middle.x - v.x), v.y + 1e-6 * (middle.y - v.y)));
    }
    // No direction in which the outline goes beyond the stone.
    for (int a = 0; a < 360; a += 10) {
      const double c = std::cos(a * std::numbers::pi / 180.0),
                   s = std::sin(a * std::numbers::pi / 180.0);
      double most = -INFINITY, outline = -INFINITY;
      for (const Vec3& v : mesh.vertices_mm) most = std::fmax(most, c * v.x + s * v.y);
      for (const auto& [x, y] : regions[k].rings_mm[0]) outline = std::fmax(outline, c * x + s * y);
      EXPECT_EQ(outline, most);
    }
  }
  EXPECT_FALSE(regions[0].holds(70.0, 50.0));
}

}  // namespace
}  // namespace maquette::scan
