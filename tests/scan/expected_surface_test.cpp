// SPDX-License-Identifier: GPL-3.0-or-later

// What is claimed in scan/expected_surface.hpp, and how each claim is attacked:
//
//   excess ... scallops finer than the grid: their mean, in closed form; coarser fields; voids
//   stones ... nodes of a stone stay the design's
//   coat ..... parallel plane of a slope, exact
//   use ...... a scan of a cut with a deep remainder and a coat has nothing significant against the
//              expected surface, and both against the design (4 seeds)

#include "scan/expected_surface.hpp"

#include <array>
#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "scan/deviate.hpp"
#include "scan/significance.hpp"
#include "support/matchers.hpp"
#include "support/scan_terrain.hpp"

namespace maquette::scan {
namespace {

using heightmap::ModelField;
using testing_support::points_on;
using testing_support::random_pose;
using testing_support::rough_part;
using testing_support::seen_from;
using testing_support::Succeeds;

constexpr double kPi = 3.141592653589793;

ModelField field_of(std::ptrdiff_t n, double spacing, auto height) {
  ModelField f{Grid<float>(n, n), Millimetres{spacing}};
  for (std::ptrdiff_t r = 0; r < n; ++r)
    for (std::ptrdiff_t c = 0; c < n; ++c)
      f.z_mm(r, c) = static_cast<float>(height(f.x_mm(c), f.y_mm(r)));
  return f;
}

TEST(ExpectedSurface, CountsRidgesFinerThanTheGridWithTheirMean) {
  const ModelField design = field_of(41, 1.0, [](double x, double y) { return 0.25 * x + y; });
  // Ridges along x, one a spacing, 0.02 mm high: their mean is 0.01, at nodes it is 0.
  const ModelField cut = field_of(641, 0.0625, [](double x, double y) {
    return 0.25 * x + y + 0.01 - 0.01 * std::cos(2.0 * kPi * y);
  });
  const ModelField e = expected_surface(design, design, &cut, Millimetres{0.0});
  for (std::ptrdiff_t r = 1; r < 40; ++r)
    for (std::ptrdiff_t c = 1; c < 40; ++c)
      // 17 rows of nodes, both ends at the crest: 0.01 (1 + 1/17); floats of 50 mm have 4e-6.
      ASSERT_NEAR(static_cast<double>(e.z_mm(r, c) - design.z_mm(r, c)), 0.01 * (1 + 1.0 / 17.0),
                  1e-5);
}

TEST(ExpectedSurface, TakesCoarserFieldsAndLeavesVoidsAndStones) {
  const ModelField ground = field_of(41, 1.0, [](double, double) { return 10.0; });
  ModelField design = ground;
  design.z_mm(20, 20) = 13.0F;  // a stone
  design.z_mm(5, 5) = NAN;
  ModelField cut = field_of(11, 4.0, [](double, double) { return 10.125; });
  cut.z_mm(0, 0) = NAN;
  const ModelField e = expected_surface(design, ground, &cut, Millimetres{0.0});
  EXPECT_EQ(e.z_mm(20, 20), 13.0F);
  EXPECT_TRUE(std::isnan(e.z_mm(5, 5)));
  EXPECT_EQ(e.z_mm(20, 21), 10.125F);
  EXPECT_EQ(e.z_mm(0, 0), 10.0F) << "not covered by the cut";
}

TEST(ExpectedSurface, CoatIsTheParallelPlane) {
  const ModelField design = field_of(9, 1.0, [](double x, double y) { return 0.75 * x + y; });
  const ModelField e = expected_surface(design, design, nullptr, Millimetres{0.5});
  for (const Vec3 p : {Vec3{4, 4, 0}, Vec3{2.3, 6.1, 0}}) {
    // A point of the design, moved by the coat along the normal, lies on the expected surface.
    const Vec3 n = normalized(Vec3{-0.75, -1.0, 1.0});
    const Vec3 on = Vec3{p.x, p.y, 0.75 * p.x + p.y} + 0.5 * n;
    EXPECT_NEAR(heightmap::height_at(e, on.x, on.y), on.z, 2e-6);
  }
}

class ExpectedSurfaceSeeded : public testing::TestWithParam<int> {};
INSTANTIATE_TEST_SUITE_P(Seed, ExpectedSurfaceSeeded, testing::Range(1, 5));

TEST_P(ExpectedSurfaceSeeded, WhatWasKnownBeforeIsNoFinding) {
  const auto seed = static_cast<std::uint64_t>(GetParam());
  const ModelField design = rough_part(seed, 201, 201, 1.0, 0.3);
  // A crease of 6 mm that the ball does not reach, at the rim as on the default site.
  ModelField cut = design;
  for (std::ptrdiff_t r = 0; r < 201; ++r)
    for (std::ptrdiff_t c = 0; c < 201; ++c)
      cut.z_mm(r, c) +=
          static_cast<float>(0.4 * std::exp(-0.5 * (std::pow((design.x_mm(c) - 2.5) / 2.0, 2) +
                                                    std::pow((design.y_mm(r) - 113.0) / 2.0, 2))));
  const ModelField made = expected_surface(cut, cut, nullptr, Millimetres{0.25});
  const Cloud truth = points_on(made, 160'000, seed, 0.1);
  const Cloud seen = seen_from(truth, random_pose(seed, {100, 100, 10}, 0.01, 2.0));
  const ModelField expected = expected_surface(design, design, &cut, Millimetres{0.25});
  const auto pose = register_scan(seen, expected);
  ASSERT_THAT(pose, Succeeds());
  std::vector<Vec3> points;
  for (const Vec3& p : seen.points_mm) points.push_back(pose->model_from_scan.point(p));
  const std::array scans{ScanPose{*pose, points.size()}};
  const auto against_expected = deviate(seen, pose->model_from_scan, expected);
  ASSERT_THAT(against_expected, Succeeds());
  EXPECT_TRUE(significance(points, against_expected->per_point_mm, scans).findings.empty());
  const auto against_design = deviate(seen, pose->model_from_scan, design);
  ASSERT_THAT(against_design, Succeeds());
  EXPECT_NEAR(against_design->statistics.mean_mm, 0.25, 0.01) << "the coat is not absorbed";
  const Significance s = significance(points, against_design->per_point_mm, scans);
  EXPECT_GT(s.maps.back().significant_share, 0.99);
}

}  // namespace
}  // namespace maquette::scan
