// SPDX-License-Identifier: GPL-3.0-or-later

// What is claimed in scan/surface_distance.hpp, and how each claim is attacked:
//
//   distance to a triangle ........... every region of its features, closed form
//   distance to the surface .......... planes, a roof, a pit; all triangles by brute force
//                                      on rough ground, with voids
//   edges, nodes ..................... points exactly on them give exactly zero
//   steep sides of stones ............ a wall of one cell: the distance is sideways
//   sign ............................. above positive, below negative, also beside a step
//   what is off the part ............. beside, over voids, too far, on the part's walls

#include "scan/surface_distance.hpp"
#include "core/triangle_distance.hpp"

#include <cmath>

#include <gtest/gtest.h>

#include "support/scan_terrain.hpp"

namespace maquette::scan {
namespace {

using heightmap::ModelField;
using testing_support::rough_part;

TEST(TriangleDistance, KnowsItsSevenRegions) {
  const Vec3 a{0, 0, 0}, b{4, 0, 0}, c{0, 3, 0};
  struct Case {
    Vec3 p;
    double distance2;
  };
  for (const Case& k : std::vector<Case>{{{1, 1, 5}, 25},
                                         {{1, 1, -5}, 25},
                                         {{-3, -4, 0}, 25},
                                         {{7, -4, 0}, 25},
                                         {{-3, 7, 0}, 25},
                                         {{2, -2, 0}, 4},
                                         {{-2, 1, 1}, 5},
                                         // Across the long side: 3 x + 4 y = 12.
                                         {{2 + 3, 1.5 + 4, 0}, 25}}) {
    EXPECT_NEAR(triangle_distance2(k.p, a, b, c), k.distance2, 1e-13);
    EXPECT_NEAR(triangle_distance2(k.p, b, c, a), k.distance2, 1e-13);
    EXPECT_NEAR(triangle_distance2(k.p, c, b, a), k.distance2, 1e-13);
  }
  EXPECT_TRUE(std::isnan(triangle_distance2({1, 1, 1}, a, b, {0, 3, NAN})));
}

TEST(SurfaceDistance, OfAPlane) {
  ModelField f{Grid<float>(41, 61), Millimetres{0.5}};
  for (std::ptrdiff_t r = 0; r < 41; ++r)
    for (std::ptrdiff_t c = 0; c < 61; ++c)
      f.z_mm(r, c) = static_cast<float>(0.75 * f.x_mm(c));  // a 3-4-5 slope
  for (const double d : {0.01, 0.7, 3.0, -0.01, -0.3, -2.0}) {
    const Vec3 on{15.1, 9.3, 0.75 * 15.1};
    EXPECT_NEAR(signed_distance_mm(f, on + d * Vec3{-0.6, 0.0, 0.8}, 5.0), d, 1e-12);
  }
}

TEST(SurfaceDistance, IsZeroOnNodesEdgesAndFaces) {
  const ModelField f = rough_part(4, 33, 33, 0.25);
  for (std::ptrdiff_t r = 0; r < 33; ++r)
    for (std::ptrdiff_t c = 0; c < 33; ++c)
      EXPECT_EQ(
          signed_distance_mm(f, {f.x_mm(c), f.y_mm(r), static_cast<double>(f.z_mm(r, c))}, 1.0),
          0.0);
  // On edges the height itself is rounded; an ulp of 10 mm is 2e-15.
  for (int i = 0; i < 2'000; ++i) {
    const double x = 8.0 * random_uniform(5, static_cast<std::uint64_t>(i));
    for (const Vec3 p : {Vec3{x, 2.25, 0.0}, Vec3{2.25, x, 0.0}, Vec3{x, x, 0.0}})
      EXPECT_NEAR(signed_distance_mm(f, {p.x, p.y, heightmap::height_at(f, p.x, p.y)}, 1.0), 0.0,
                  1e-14);
  }
}

class SurfaceDistanceSeeded : public testing::TestWithParam<int> {};
INSTANTIATE_TEST_SUITE_P(Seed, SurfaceDistanceSeeded, testing::Range(1, 7));

TEST_P(SurfaceDistanceSeeded, EqualsAllTriangles) {
  const auto seed = static_cast<std::uint64_t>(GetParam());
  ModelField f = rough_part(seed, 37, 45, 0.7, 3.0);
  f.x0 = Millimetres{-100.0};
  f.y0 = Millimetres{33.0};
  // Rough at the scale of a node, and steps as a stone's side makes them.
  for (std::ptrdiff_t r = 0; r < 37; ++r)
    for (std::ptrdiff_t c = 0; c < 45; ++c) {
      f.z_mm(r, c) +=
          static_cast<float>(0.2 * random_normal(seed, static_cast<std::uint64_t>(r * 45 + c)));
      if (r > 10 && r < 20 && c > 12 && c < 30) f.z_mm(r, c) += 4.0F;
    }
  if (seed % 2 == 0) f.z_mm(25, 25) = f.z_mm(5, 40) = NAN;
  const double reach = 3.0;
  int near = 0, far = 0;
  for (std::uint64_t i = 0; i < 3'000; ++i) {
    const double x = f.x_mm(0) + (f.x_mm(44) - f.x_mm(0)) * random_uniform(seed + 50, 3 * i);
    const double y = f.y_mm(0) + (f.y_mm(36) - f.y_mm(0)) * random_uniform(seed + 50, 3 * i + 1);
    const double h = heightmap::height_at(f, x, y);
    const Vec3 p{x, y,
                 (std::isnan(h) ? 10.0 : h) + 4.0 * (random_uniform(seed + 50, 3 * i + 2) - 0.4)};
    double best2 = INFINITY;
    for (std::ptrdiff_t r = 0; r < 36; ++r)
      for (std::ptrdiff_t c = 0; c < 44; ++c) {
        const auto node = [&](std::ptrdiff_t k, std::ptrdiff_t j) {
          return Vec3{f.x_mm(c + j), f.y_mm(r + k), static_cast<double>(f.z_mm(r + k, c + j))};
        };
        best2 = std::fmin(best2, triangle_distance2(p, node(0, 0), node(0, 1), node(1, 1)));
        best2 = std::fmin(best2, triangle_distance2(p, node(0, 0), node(1, 1), node(1, 0)));
      }
    const double distance = std::sqrt(best2);
    const double wall = std::min({x - f.x_mm(0), f.x_mm(44) - x, y - f.y_mm(0), f.y_mm(36) - y});
    const double found = signed_distance_mm(f, p, reach);
    if (std::isnan(h) || distance > reach || (p.z < h - 0.7 && wall < distance)) {
      ASSERT_TRUE(std::isnan(found)) << "point " << i;
      ++far;
      continue;
    }
    ASSERT_NEAR(std::abs(found), distance, 1e-12) << "point " << i;
    ASSERT_EQ(std::signbit(found), p.z < h) << "point " << i;
    ++near;
  }
  EXPECT_GT(near, 2'000);
  EXPECT_GT(far, 5);
}

TEST(SurfaceDistance, BesideAStoneIsMeasuredSideways) {
  // Ground at 0, a block 6 mm high whose side falls within one cell of 0.25 mm.
  ModelField f{Grid<float>(81, 81, 0.0F), Millimetres{0.25}};
  for (std::ptrdiff_t r = 20; r <= 60; ++r)
    for (std::ptrdiff_t c = 40; c <= 60; ++c) f.z_mm(r, c) = 6.0F;
  // The side goes from (9.75, 0) to (10, 6): normal (-6, 0.25) / 6.0052.
  const double length = std::hypot(6.0, 0.25);
  for (const double d : {0.05, 0.5, -0.05, -0.5}) {
    const Vec3 p{9.875 - 6.0 / length * d, 10.1, 3.0 + 0.25 / length * d};
    EXPECT_NEAR(signed_distance_mm(f, p, 5.0), d, 1e-12)
        << "the vertical distance would be " << p.z - heightmap::height_at(f, p.x, p.y);
  }
}

TEST(SurfaceDistance, OfManyPointsIsThatOfEach) {
  ModelField f = rough_part(7, 37, 45, 0.7, 3.0);
  f.x0 = Millimetres{-100.0};
  f.z_mm(20, 20) = NAN;
  std::vector<Vec3> points;
  for (std::uint64_t i = 0; i < 2'000; ++i)  // some beside the part, one is no place at all
    points.push_back({-102.0 + 35.0 * random_uniform(8, 3 * i),
                      -2.0 + 30.0 * random_uniform(8, 3 * i + 1),
                      10.0 + 3.0 * (random_uniform(8, 3 * i + 2) - 0.5)});
  points[77].x = NAN;
  std::vector<double> distances(points.size());
  signed_distances_mm(f, points, 3.0, distances);
  int numbers = 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const double alone = signed_distance_mm(f, points[i], 3.0);
    ASSERT_EQ(std::isnan(distances[i]), std::isnan(alone));
    if (std::isnan(alone)) continue;
    ASSERT_EQ(distances[i], alone);
    ++numbers;
  }
  EXPECT_GT(numbers, 1'000);
  EXPECT_LT(numbers, 1'900);
}

TEST(SurfaceDistance, SaysWhatIsOffThePart) {
  const ModelField f{Grid<float>(21, 21, 10.0F), Millimetres{1.0}};
  EXPECT_EQ(signed_distance_mm(f, {5.0, 5.0, 13.0}, 3.0), 3.0) << "reach itself is within";
  EXPECT_TRUE(std::isnan(signed_distance_mm(f, {5.0, 5.0, 13.01}, 3.0)));
  EXPECT_TRUE(std::isnan(signed_distance_mm(f, {-0.01, 5.0, 10.0}, 3.0)));
  EXPECT_TRUE(std::isnan(signed_distance_mm(f, {5.0, 20.01, 10.0}, 3.0)));
  EXPECT_EQ(signed_distance_mm(f, {20.0 + 1e-9, 5.0, 10.5}, 3.0), 0.5) << "rounding of a pose";
  // A wall: 0.02 mm inside the outline, 2 mm down. At the rim, less than a spacing down,
  // it is a point of the surface.
  EXPECT_TRUE(std::isnan(signed_distance_mm(f, {0.02, 5.0, 8.0}, 3.0)));
  EXPECT_EQ(signed_distance_mm(f, {0.02, 5.0, 9.9}, 3.0), 9.9 - 10.0);
  EXPECT_EQ(signed_distance_mm(f, {0.02, 5.0, 12.0}, 3.0), 2.0) << "above there is no wall";
  EXPECT_TRUE(std::isnan(signed_distance_mm(f, {NAN, 5.0, 10.0}, 3.0)));
}

}  // namespace
}  // namespace maquette::scan
