// SPDX-License-Identifier: GPL-3.0-or-later

// What is claimed in scan/find_objects.hpp, and how each claim is attacked:
//
//   nothing in noise ... 4 seeds, 400 000 points; planned stones that are there are no objects
//   place and size ..... a half ball, a bar turned by 30 degrees, a stone of the plan laid
//   elsewhere resembles .......... that stone by its number, only while it is missing where it
//   belongs

#include "scan/find_objects.hpp"

#include <array>
#include <cmath>
#include <numbers>

#include <gtest/gtest.h>

#include "support/scan_terrain.hpp"

namespace maquette::scan {
namespace {

using heightmap::ModelField;
using meshing::PlacedStone;
using testing_support::points_on;
using testing_support::rough_part;

constexpr double kNoise = 0.1;

PlacedStone stone_at(const ModelField& ground, int number, double size, double x, double y) {
  PlacedStone s;
  s.number = number;
  s.shape.seed = static_cast<std::uint64_t>(number);
  s.scale_mm = size;
  s.model_from_stone.translation_mm = {x, y, heightmap::height_at(ground, x, y) + 0.2 * size};
  return s;
}

/// The ground four times as fine.
ModelField finer(const ModelField& f) {
  ModelField g{Grid<float>(4 * (f.z_mm.rows() - 1) + 1, 4 * (f.z_mm.cols() - 1) + 1),
               0.25 * f.spacing};
  for (std::ptrdiff_t r = 0; r < g.z_mm.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < g.z_mm.cols(); ++c)
      g.z_mm(r, c) = static_cast<float>(heightmap::height_at(f, g.x_mm(c), g.y_mm(r)));
  return g;
}

class FindObjectsSeeded : public testing::TestWithParam<int> {};
INSTANTIATE_TEST_SUITE_P(Seed, FindObjectsSeeded, testing::Range(1, 5));

TEST_P(FindObjectsSeeded, WhatIsInNoPlan) {
  const auto seed = static_cast<std::uint64_t>(GetParam());
  const ModelField ground = rough_part(seed, 201, 201, 1.0, 0.2);
  const std::vector<PlacedStone> plan{stone_at(ground, 1, 16.0, 50, 50),
                                      stone_at(ground, 2, 10.0, 150, 60)};
  ModelField seen = meshing::with_stones(finer(ground), plan);
  const auto search = [&](const ModelField& f, std::span<const int> missing) {
    const Cloud cloud = points_on(f, 400'000, seed, kNoise);
    return find_objects(cloud.points_mm, ground, plan, missing, kNoise);
  };
  EXPECT_TRUE(search(seen, {}).empty()) << "stones that were planned";

  // A half ball of 6 mm radius and a bar of 30 x 6 x 2 mm.
  const double turn = std::numbers::pi / 6.0;
  for (std::ptrdiff_t r = 0; r < seen.z_mm.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < seen.z_mm.cols(); ++c) {
      const double x = seen.x_mm(c), y = seen.y_mm(r);
      const double ball = std::hypot(x - 60.0, y - 140.0);
      if (ball < 6.0) seen.z_mm(r, c) += static_cast<float>(std::sqrt(36.0 - ball * ball));
      const double u = (x - 130.0) * std::cos(turn) + (y - 140.0) * std::sin(turn);
      const double w = (y - 140.0) * std::cos(turn) - (x - 130.0) * std::sin(turn);
      if (std::abs(u) < 15.0 && std::abs(w) < 3.0) seen.z_mm(r, c) += 2.0F;
    }
  const auto objects = search(seen, {});
  ASSERT_EQ(objects.size(), 2U);
  const ExtraObject& ball = objects[0];  // 452 mm^3, the bar has 360
  EXPECT_NEAR(ball.centre_mm.x, 60.0, 0.3);
  EXPECT_NEAR(ball.centre_mm.y, 140.0, 0.3);
  EXPECT_NEAR(ball.height_mm, 6.0, 0.5);
  EXPECT_NEAR(ball.length_mm, 12.0, 1.0);
  EXPECT_NEAR(ball.volume_mm3, 452.0, 45.0);
  const ExtraObject& bar = objects[1];
  EXPECT_NEAR(bar.centre_mm.x, 130.0, 0.5);
  EXPECT_NEAR(bar.height_mm, 2.0, 0.3);
  // An ellipse of a bar's moments is longer than the bar by 4 / root 12.
  EXPECT_NEAR(bar.length_mm, 30.0 * 4.0 / std::sqrt(12.0), 1.5);
  EXPECT_NEAR(bar.width_mm, 6.0 * 4.0 / std::sqrt(12.0), 1.0);
  EXPECT_EQ(ball.resembles, 0);
  EXPECT_EQ(bar.resembles, 0);
}

TEST_P(FindObjectsSeeded, AStoneThatWasLaidElsewhere) {
  const auto seed = static_cast<std::uint64_t>(GetParam());
  const ModelField ground = rough_part(seed, 201, 201, 1.0, 0.1);
  const std::vector<PlacedStone> plan{stone_at(ground, 1, 20.0, 50, 50),
                                      stone_at(ground, 2, 10.0, 150, 60)};
  std::vector<PlacedStone> laid = plan;
  laid[0] = stone_at(ground, 1, 20.0, 120, 150);
  const ModelField seen = meshing::with_stones(finer(ground), laid);
  const Cloud cloud = points_on(seen, 400'000, seed, kNoise);
  const auto found = find_objects(cloud.points_mm, ground, plan, std::array{1}, kNoise);
  ASSERT_EQ(found.size(), 1U);
  EXPECT_NEAR(found[0].centre_mm.x, 120.0, 2.0);
  EXPECT_NEAR(found[0].centre_mm.y, 150.0, 2.0);
  EXPECT_EQ(found[0].resembles, 1);
  const auto other = find_objects(cloud.points_mm, ground, plan, std::array{2}, kNoise);
  ASSERT_EQ(other.size(), 2U) << "and stone 2 itself, which is said to be missing";
  EXPECT_EQ(other[0].resembles, 0) << "twice the size";
  EXPECT_EQ(other[1].resembles, 2);
}

}  // namespace
}  // namespace maquette::scan
