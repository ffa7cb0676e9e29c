// SPDX-License-Identifier: GPL-3.0-or-later

// What is claimed in scan/detail/profile_walk.hpp and of ScanScene::look_across, and how each claim
// is attacked:
//
//   closed form ........... a slope: range and normal by hand; under its rim, and beyond it
//   the same as alone ..... against FieldTracer ray by ray, from beside, above, low and far, along
//                           the grid's lines and diagonals and anywhere; a stone among them
//   walls ................. what enters through a side meets nothing

#include "scan/detail/profile_walk.hpp"

#include <cmath>
#include <numbers>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/random.hpp"
#include "scan/detail/scan_scene.hpp"
#include "support/matchers.hpp"
#include "support/scan_terrain.hpp"
#include "support/shapes.hpp"

namespace maquette::scan::detail {
namespace {

using heightmap::ModelField;
using testing_support::rough_part;
using testing_support::Succeeds;

constexpr double kPi = std::numbers::pi;

TEST(ProfileWalk, MeetsASlopeWhereItShould) {
  ModelField slope{Grid<float>(3, 3), Millimetres{10.0}};
  for (std::ptrdiff_t r = 0; r < 3; ++r)
    for (std::ptrdiff_t c = 0; c < 3; ++c) slope.z_mm(r, c) = static_cast<float>(5 * c);
  // From (-10, 9, 10) along x: height 10 + rise s, ground (s - 10) / 2.
  ProfileWalk walk(slope, {-10.0, 9.0, 10.0}, {1.0, 0.0, 0.0});
  EXPECT_FALSE(walk.hit(1.0, -1.5)) << "5 mm under the rim";
  for (const double rise : {-0.9, -0.5, 0.0, 0.1}) {
    const double scale = 1.0 / std::hypot(1.0, rise), s = 15.0 / (0.5 - rise);
    const auto hit = walk.hit(scale, rise * scale);
    if (s > 30.0) {
      EXPECT_FALSE(hit) << rise;
      continue;
    }
    ASSERT_TRUE(hit) << rise;
    EXPECT_NEAR(hit->distance_mm, s / scale, 1e-12);
    EXPECT_LT(norm(hit->point_mm - Vec3{s - 10.0, 9.0, 10.0 + rise * s}), 1e-12);
    EXPECT_LT(norm(hit->normal - normalized(Vec3{-0.5, 0.0, 1.0})), 1e-15);
  }
  EXPECT_FALSE(walk.hit(1.0, 0.4));
  EXPECT_FALSE(walk.hit(1.0, -0.5)) << "beyond the terrain it stays there";
}

TEST(ProfileWalk, PassesBesideAPart) {
  const ModelField part = rough_part(1, 20, 20, 1.0);
  ProfileWalk beside(part, {-5.0, -5.0, 30.0}, {1.0, 0.0, 0.0});
  EXPECT_FALSE(beside.hit(0.8, -0.6));
  ProfileWalk away(part, {-5.0, 5.0, 30.0}, {-1.0, 0.0, 0.0});
  EXPECT_FALSE(away.hit(0.8, -0.6));
}

/// Directions of one plane together against each alone.
void compare(const ScanScene& scene, Vec3 origin, double azimuth, int& met, int& stones) {
  const Vec3 across{std::cos(azimuth), std::sin(azimuth), 0.0};
  std::vector<Vec3> directions;
  for (double zenith = 0.02; zenith < kPi - 0.02; zenith += 0.004)
    directions.push_back(std::sin(zenith) * across + Vec3{0.0, 0.0, std::cos(zenith)});
  std::vector<std::optional<Echo>> together(directions.size());
  scene.look_across(origin, across, directions, together);
  for (std::size_t i = 0; i < directions.size(); ++i) {
    const auto alone = scene.look(origin, directions[i]);
    ASSERT_EQ(together[i].has_value(), alone.has_value())
        << origin.x << ' ' << origin.y << ' ' << origin.z << ", azimuth " << azimuth << ", " << i;
    if (!alone) continue;
    ++met;
    stones += alone->stone ? 1 : 0;
    ASSERT_EQ(together[i]->stone, alone->stone);
    // Rounding of coordinates of 1000 mm, by an angle of a thousandth between ray and ground.
    ASSERT_NEAR(together[i]->range_mm, alone->range_mm, 1e-9);
  }
}

TEST(ProfileWalk, IsTheSameAsEachRayAlone) {
  int met = 0, stones = 0;
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    const ModelField part = rough_part(seed, 61, 84, 0.7, 3.0);
    TriMesh stone = testing_support::unit_sphere(3);
    const double ground = heightmap::height_at(part, 30.0, 20.0);
    for (Vec3& v : stone.vertices_mm) v = Vec3{30.0, 20.0, ground + 2.0} + 5.0 * v;
    const auto scene = ScanScene::build(part, std::span(&stone, 1));
    ASSERT_THAT(scene, Succeeds());
    ASSERT_TRUE(scene->whole());
    const double top = scene->bounds().max.z;
    // At a node, in a cell, beside the part, low and far; azimuths along lines and diagonals.
    for (const Vec3 origin :
         {Vec3{21.0, 14.0, top + 8.0}, Vec3{17.3, 33.1, top + 20.0}, Vec3{-40.0, -35.0, top + 30.0},
          Vec3{70.0, 14.0, top + 2.0}, Vec3{25.9, 900.0, top + 15.0}, Vec3{0.0, 0.0, top + 10.0}}) {
      for (int k = 0; k < 8; ++k) compare(*scene, origin, k * kPi / 4.0, met, stones);
      for (std::uint64_t k = 0; k < 8; ++k)
        compare(*scene, origin, 2.0 * kPi * random_uniform(seed, k), met, stones);
      const Vec3 middle{28.0, 20.0, 0.0};
      compare(*scene, origin, std::atan2(middle.y - origin.y, middle.x - origin.x), met, stones);
    }
  }
  EXPECT_GT(met, 20'000);
  EXPECT_GT(stones, 500);
}

TEST(ProfileWalk, NeedsTerrainWithoutVoids) {
  ModelField part = rough_part(1, 20, 20, 1.0);
  part.z_mm(7, 7) = NAN;
  const auto scene = ScanScene::build(part, {});
  ASSERT_THAT(scene, Succeeds());
  EXPECT_FALSE(scene->whole());
}

}  // namespace
}  // namespace maquette::scan::detail
