// SPDX-License-Identifier: GPL-3.0-or-later

// What is claimed in scan/structured_light.hpp, and how each claim is attacked:
//
//   points ................ without noise on a plane and a ball, in the directions of their pixels
//   seen by both .......... beside a block the shadows of camera and projector are where lines
//                           past its edges say, and everything else is there
//   stripes' cone ......... points end where the projector's light ends
//   noise ................. depth_sigma_mm() by chi squared, its square in depth, its growth with
//                           incidence
//   no data ............... saturated near the mirror point, dark, steep
//   look_at ............... axes
//   codes ................. each

#include "scan/structured_light.hpp"

#include <cmath>
#include <numbers>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "support/matchers.hpp"
#include "support/scan_terrain.hpp"
#include "support/shapes.hpp"

namespace maquette::scan {
namespace {

using heightmap::ModelField;
using testing_support::FailsWith;
using testing_support::Succeeds;

StructuredLightOptions head(Vec3 eye, Vec3 target) {
  StructuredLightOptions o;
  o.scanner = *assets::find_preset(assets::structured_light_presets(), "structured_light");
  o.scanner.width_px = 400;
  o.scanner.height_px = 300;
  o.scanner.focal_length_px = 650.0;
  o.scanner.stripe_sigma_px = 0.0;
  o.model_from_station = look_at(eye, target);
  return o;
}

TriMesh ball_mesh(Vec3 centre, double radius, int subdivisions) {
  TriMesh m = testing_support::unit_sphere(subdivisions);
  for (Vec3& v : m.vertices_mm) v = centre + radius * v;
  return m;
}

ModelField plane(float z = 0.0F) {
  return {Grid<float>(201, 201, z), Millimetres{10.0}, Millimetres{-1000.0}, Millimetres{-1000.0}};
}

TEST(LookAt, PointsMinusZAtTheTarget) {
  for (const Vec3 eye : {Vec3{0, 0, 800}, Vec3{300, -500, 700}, Vec3{-20, 900, -100},
                         Vec3{0, 0, -5}, Vec3{1000, 0, 0}, Vec3{-1000, 3, 1}}) {
    const RigidTransform pose = look_at(eye, {1, 2, 3});
    EXPECT_EQ(pose.point({}), eye);
    EXPECT_LT(norm(pose.direction({0, 0, -1}) - normalized(Vec3{1, 2, 3} - eye)), 1e-12);
    EXPECT_NEAR(pose.direction({1, 0, 0}).z, 0.0, 1e-12) << "level";
    EXPECT_GE(pose.direction({0, 1, 0}).z, -1e-12) << "upright";
  }
  EXPECT_LT(norm(look_at({0, 0, 800}, {}).direction({1, 0, 0}) - Vec3{1, 0, 0}), 1e-12);
}

TEST(StructuredLight, PointsLieOnAPlaneInTheDirectionsOfTheirPixels) {
  const StructuredLightOptions o = head({50, -300, 750}, {0, 0, 0});
  const auto cloud = simulate_structured_light(plane(2.0F), {}, o);
  ASSERT_THAT(cloud, Succeeds());
  EXPECT_GT(cloud->points_mm.size(), 60'000U) << "nearly all of 400 x 300 see it";
  const RigidTransform camera = o.model_from_station.inverse();
  for (std::size_t i = 0; i < cloud->points_mm.size(); ++i) {
    ASSERT_NEAR(cloud->points_mm[i].z, 2.0, 1e-9);
    const Vec3 q = camera.point(cloud->points_mm[i]);
    ASSERT_NEAR(200.0 + 650.0 * q.x / -q.z, cloud->grid[i].column + 0.5, 1e-6);
    ASSERT_NEAR(150.0 - 650.0 * q.y / -q.z, cloud->grid[i].row + 0.5, 1e-6);
    if (i > 0) {
      ASSERT_TRUE(cloud->grid[i].column > cloud->grid[i - 1].column ||
                  (cloud->grid[i].column == cloud->grid[i - 1].column &&
                   cloud->grid[i].row > cloud->grid[i - 1].row));
    }
  }
}

TEST(StructuredLight, PointsLieOnABall) {
  const TriMesh ball = ball_mesh({0, 0, 60}, 60.0, 6);
  StructuredLightOptions o = head({-150, 0, 800}, {0, 0, 60});
  o.scanner.focal_length_px = 2000.0;
  const auto cloud = simulate_structured_light(plane(-500.0F), std::span(&ball, 1), o);
  ASSERT_THAT(cloud, Succeeds());
  const Vec3 camera = o.model_from_station.point({});
  const Vec3 projector = o.model_from_station.point({o.scanner.baseline_mm, 0, 0});
  int n = 0;
  for (const Vec3& p : cloud->points_mm) {
    const Vec3 r = p - Vec3{0, 0, 60};
    if (norm(r) > 61.0) continue;
    ++n;
    ASSERT_NEAR(norm(r), 60.0, 0.01) << "facets of 1.9 mm";
    ASSERT_GT(dot(r, camera - p), 0.0);
    ASSERT_GT(dot(r, projector - p), -60.0 * 800.0 * 0.03) << "lit, within the slope of a facet";
  }
  EXPECT_GT(n, 10'000);
}

TEST(StructuredLight, NeedsBothViews) {
  // A wall along y from x = -10 to 10, 100 high. Camera at x = -150, projector at x = +150, 800
  // above: the camera does not see right of the wall up to its sight line, the projector does
  // not light left of it.
  TriMesh wall;
  for (int i = 0; i < 8; ++i)
    wall.vertices_mm.push_back(
        {i & 1 ? 10.0 : -10.0, i & 2 ? 400.0 : -400.0, i & 4 ? 100.0 : -1.0});
  wall.triangles = {{0, 2, 1}, {1, 2, 3}, {4, 5, 6}, {5, 7, 6}, {0, 1, 4}, {1, 5, 4},
                    {2, 6, 3}, {3, 6, 7}, {0, 4, 2}, {2, 4, 6}, {1, 3, 5}, {3, 7, 5}};
  StructuredLightOptions o = head({-150, 0, 800}, {-150, 0, 0});
  o.scanner.steepest_deg = 90.0;
  o.scanner.least_value = 0.0;
  o.scanner.projector_width_deg = 120.0;
  o.scanner.projector_height_deg = 90.0;
  const auto cloud = simulate_structured_light(plane(), std::span(&wall, 1), o);
  ASSERT_THAT(cloud, Succeeds());
  // From 800 over the edge at 100: farther by 160 * 100 / 700 on the ground.
  const double reach = 10.0 + 160.0 * 100.0 / 700.0;
  int left = 0, right = 0;
  double nearest_left = 1e9, nearest_right = 1e9;
  for (const Vec3& p : cloud->points_mm) {
    if (p.z > 0.5 || std::abs(p.y) > 200) continue;
    ASSERT_GE(std::abs(p.x), reach - 1e-6) << "in a shadow";
    (p.x < 0 ? left : right) += 1;
    double& nearest = p.x < 0 ? nearest_left : nearest_right;
    nearest = std::min(nearest, std::abs(p.x));
  }
  EXPECT_GT(left, 5000);
  EXPECT_GT(right, 2000);
  // And the shadows are no wider: a pixel is 1.2 mm there.
  EXPECT_LT(nearest_left, reach + 1.5);
  EXPECT_LT(nearest_right, reach + 1.5);
}

TEST(StructuredLight, EndsWhereTheStripesEnd) {
  StructuredLightOptions o = head({0, 0, 800}, {0, 0, 0});
  o.scanner.projector_width_deg = 10.0;
  const auto cloud = simulate_structured_light(plane(), {}, o);
  ASSERT_THAT(cloud, Succeeds());
  // Projector at (300, 0, 800), its axis through the origin.
  const double axis = std::atan(300.0 / 800.0), half = 5.0 * std::numbers::pi / 180.0;
  const double from = 300.0 - 800.0 * std::tan(axis + half),
               to = 300.0 - 800.0 * std::tan(axis - half);
  double least = 1e9, most = -1e9;
  for (const Vec3& p : cloud->points_mm) {
    least = std::min(least, p.x);
    most = std::max(most, p.x);
  }
  EXPECT_NEAR(least, from, 1.3);
  EXPECT_NEAR(most, to, 1.3);
  EXPECT_GE(least, from - 1e-9);
  EXPECT_LE(most, to + 1e-9);
}

TEST(StructuredLight, NoiseIsWhatWasAsked) {
  std::vector<double> spread;
  for (const double height : {500.0, 1000.0}) {
    StructuredLightOptions o = head({0, 0, height}, {0, 0, 0});
    o.scanner.stripe_sigma_px = 0.05;
    o.scanner.noise_exponent = 0.0;
    o.scanner.exposure = 0.3;
    const auto cloud = simulate_structured_light(plane(), {}, o);
    ASSERT_THAT(cloud, Succeeds());
    double square = 0.0, chi = 0.0;
    for (std::size_t i = 0; i < cloud->points_mm.size(); ++i) {
      const Vec3 q = o.model_from_station.inverse().point(cloud->points_mm[i]);
      const Vec3 true_place = (height / -q.z) * q;
      chi += std::pow((-q.z - height) / depth_sigma_mm(o.scanner, true_place, 0.3), 2);
      square += std::pow(-q.z - height, 2);
    }
    const auto n = static_cast<double>(cloud->points_mm.size());
    EXPECT_NEAR(chi / n, 1.0, 4.0 * std::sqrt(2.0 / n)) << height;
    // Near the foot: z^2 / b (1 + p^2) s / f.
    const double p = 300.0 / height;
    EXPECT_NEAR(depth_sigma_mm(o.scanner, {0, 0, -height}, 0.3),
                height * height / 300.0 * (1 + p * p) * 0.05 / 650.0, 1e-12);
  }
}

TEST(StructuredLight, NoiseGrowsWithIncidence) {
  // The same place, seen on level ground and on a slope that turns away from the light.
  const auto spread = [&](double slope) {
    ModelField f = plane();
    for (std::ptrdiff_t r = 0; r < 201; ++r)
      for (std::ptrdiff_t c = 0; c < 201; ++c) f.z_mm(r, c) = static_cast<float>(slope * f.y_mm(r));
    StructuredLightOptions o = head({0, 0, 800}, {0, 0, 0});
    o.scanner.stripe_sigma_px = 0.05;
    const StructuredLightOptions quiet = head({0, 0, 800}, {0, 0, 0});
    const auto noisy = simulate_structured_light(f, {}, o),
               exact = simulate_structured_light(f, {}, quiet);
    EXPECT_THAT(noisy, Succeeds());
    EXPECT_EQ(noisy->points_mm.size(), exact->points_mm.size());
    double square = 0.0;
    int n = 0;
    for (std::size_t i = 0; i < exact->points_mm.size(); ++i) {
      if (std::hypot(exact->points_mm[i].x, exact->points_mm[i].y) > 20.0) continue;
      square += std::pow(norm(noisy->points_mm[i] - exact->points_mm[i]), 2);
      ++n;
    }
    EXPECT_GT(n, 500);
    return std::pair{std::sqrt(square / n), n};
  };
  const auto [level, n1] = spread(0.0);
  const auto [tilted, n2] = spread(1.0);
  // 45 degrees about x: the light's cosine falls by sqrt 2, the noise rises by its root.
  EXPECT_NEAR(tilted / level, std::pow(2.0, 0.25), 5.0 / std::sqrt(2.0 * std::min(n1, n2)) + 0.02);
}

TEST(StructuredLight, HasNoDataWhereItIsTooBrightTooDarkOrTooSteep) {
  StructuredLightOptions o = head({0, 0, 800}, {0, 0, 0});
  o.scanner.projector_width_deg = 90.0;
  o.scanner.projector_height_deg = 60.0;
  const auto all = simulate_structured_light(plane(), {}, o);
  ASSERT_THAT(all, Succeeds());
  EXPECT_EQ(all->points_mm.size(), 400U * 300U);
  // A mirror lobe: the ground point midway between camera and projector is lost, and around it.
  o.scanner.gloss = 5.0;
  o.scanner.gloss_exponent = 400.0;
  const auto glossy = simulate_structured_light(plane(), {}, o);
  ASSERT_THAT(glossy, Succeeds());
  double nearest = 1e9;
  for (const Vec3& p : glossy->points_mm) nearest = std::min(nearest, std::hypot(p.x - 150.0, p.y));
  // cos^400 = 0.75 / 5 or so: 5.6 degrees of the half vector, about twice that of the view.
  EXPECT_GT(nearest, 60.0);
  EXPECT_LT(nearest, 120.0);
  EXPECT_GT(glossy->points_mm.size(), 80'000U);
  o.scanner.gloss = 0.0;
  o.scanner.exposure = 5.0;  // grey saturates
  EXPECT_THAT(simulate_structured_light(plane(), {}, o), FailsWith(kNothingHit));
  o.scanner.exposure = 0.03;
  EXPECT_THAT(simulate_structured_light(plane(), {}, o), FailsWith(kNothingHit));
  o.scanner.exposure = 0.8;
  o.scanner.steepest_deg = 10.0;
  const auto steep = simulate_structured_light(plane(), {}, o);
  ASSERT_THAT(steep, Succeeds());
  double farthest = 0.0;
  for (const Vec3& p : steep->points_mm) farthest = std::max(farthest, std::hypot(p.x, p.y));
  EXPECT_NEAR(farthest, 800.0 * std::tan(10.0 * std::numbers::pi / 180.0), 1.3);
}

TEST(StructuredLight, ThinsItsPixelsToStayBelowTheLimit) {
  StructuredLightOptions o = head({0, 0, 800}, {0, 0, 0});
  o.max_points = 10'000;
  const auto cloud = simulate_structured_light(plane(), {}, o);
  ASSERT_THAT(cloud, Succeeds());
  EXPECT_LE(cloud->points_mm.size(), 10'000U);
  EXPECT_GT(cloud->points_mm.size(), 4'000U);
}

TEST(StructuredLightRefuses, WhatMakesNoSense) {
  const StructuredLightOptions good = head({0, 0, 800}, {0, 0, 0});
  std::vector<StructuredLightOptions> bad(6, good);
  bad[0].scanner.width_px = 0;
  bad[1].scanner.focal_length_px = NAN;
  bad[2].scanner.baseline_mm = 0.0;
  bad[3].scanner.least_value = 2.0;
  bad[4].max_points = 1;
  bad[5].model_from_station.rotation.w = 2.0;
  for (const StructuredLightOptions& o : bad)
    EXPECT_THAT(simulate_structured_light(plane(), {}, o), FailsWith(kScanOptions));
  EXPECT_THAT(simulate_structured_light(plane(), {}, head({0, 0, -10}, {0, 1, -20})),
              FailsWith(kStationUnderSurface));
  EXPECT_THAT(simulate_structured_light(plane(), {}, head({0, 0, 800}, {0, 0, 900})),
              FailsWith(kNothingHit));
  std::stop_source stop;
  stop.request_stop();
  RunContext run;
  run.stop = stop.get_token();
  EXPECT_THAT(simulate_structured_light(plane(), {}, good, run), FailsWith(kCancelled));
}

}  // namespace
}  // namespace maquette::scan
