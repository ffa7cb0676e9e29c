// SPDX-License-Identifier: GPL-3.0-or-later

// What is claimed in scan/overhangs.hpp, and how each claim is attacked:
//
//   what is found ... a ball that stands out of the ground by more than half: its lower side and
//   the
//                     ground under it, all of them; with a coat, too
//   what stays ...... its upper side, the ground around, and where it is missing, ground that is
//   too
//                     low or too high beside it
//   use ............. a simulated scan of balls where they should be has next to nothing
//   significant
//                     without these points, and with them has (4 seeds)
//   place ........... means beside outlines of balls that overhang and of such that do not are zero
//                     by where points were looked at, and are not by where noise has put them (8
//                     seeds)

#include "scan/overhangs.hpp"

#include <cmath>
#include <numbers>
#include <string>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/random.hpp"
#include "scan/deviate.hpp"
#include "scan/scanner_sim.hpp"
#include "scan/significance.hpp"
#include "support/matchers.hpp"
#include "support/scan_terrain.hpp"
#include "support/shapes.hpp"

namespace maquette::scan {
namespace {

using heightmap::ModelField;
using testing_support::Succeeds;

constexpr double kTurn = 2.0 * std::numbers::pi;
constexpr double kNoise = 0.1, kRadius = 5.0, kAbove = 3.0;  // mm; of the ball and its middle
constexpr Vec3 kMiddle{30.0, 30.0, 10.0 + kAbove};

TriMesh ball_at(Vec3 middle, double radius) {
  TriMesh ball = testing_support::unit_sphere(5);
  for (Vec3& v : ball.vertices_mm) v = middle + radius * v;
  return ball;
}

ModelField flat(std::ptrdiff_t n) {
  return {Grid<float>(n, n, 10.0F), Millimetres{0.5}};
}

ModelField with_balls(ModelField ground, std::span<const Vec3> middles, double radius) {
  for (std::ptrdiff_t r = 0; r < ground.z_mm.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < ground.z_mm.cols(); ++c)
      for (const Vec3& m : middles) {
        const double away2 = std::pow(ground.x_mm(c) - m.x, 2) + std::pow(ground.y_mm(r) - m.y, 2);
        if (away2 < radius * radius)
          ground.z_mm(r, c) = std::fmax(
              ground.z_mm(r, c), static_cast<float>(m.z + std::sqrt(radius * radius - away2)));
      }
  return ground;
}

struct Ball {
  ModelField ground = flat(121), envelope = with_balls(flat(121), std::array{kMiddle}, kRadius);
  TriMesh mesh = ball_at(kMiddle, kRadius);
  [[nodiscard]] double share_of(const std::vector<Vec3>& points, double coat = 0.0) const {
    const auto beyond =
        judge_by_heights(points, envelope, ground, std::span(&mesh, 1), coat, kNoise)
            .value()
            .beyond;
    return static_cast<double>(std::count(beyond.begin(), beyond.end(), 1)) /
           static_cast<double>(points.size());
  }
};

/// At random on the ball between two heights over its middle, with noise across it.
std::vector<Vec3> on_ball(double from, double to, double radius = kRadius) {
  std::vector<Vec3> points;
  for (std::uint64_t i = 0; i < 2'000; ++i) {
    const double z = from + (to - from) * random_uniform(1, i),
                 angle = kTurn * random_uniform(2, i);
    const double across = std::sqrt(kRadius * kRadius - z * z);
    const Vec3 out{across * std::cos(angle), across * std::sin(angle), z};
    const double noise = 0.5 * kNoise * random_normal(3, i);
    points.push_back(kMiddle + (1.0 / kRadius) * (radius + noise) * out);
  }
  return points;
}

/// At random on the ground between two distances from the ball's axis.
std::vector<Vec3> on_ground(double from, double to, double height = 10.0) {
  std::vector<Vec3> points;
  for (std::uint64_t i = 0; i < 2'000; ++i) {
    const double away = from + (to - from) * random_uniform(4, i),
                 angle = kTurn * random_uniform(5, i);
    points.push_back({kMiddle.x + away * std::cos(angle), kMiddle.y + away * std::sin(angle),
                      height + 0.5 * kNoise * random_normal(6, i)});
  }
  return points;
}

TEST(BeyondHeights, IsWhatStandsUnderAnOverhang) {
  const Ball ball;
  // Half a millimetre and more within the ball's outline: its nodes are all under the ball.
  EXPECT_EQ(ball.share_of(on_ball(-2.9, -2.2)), 1.0);
  EXPECT_EQ(ball.share_of(on_ground(4.1, 4.4)), 1.0);
  // A coat of 0.2 mm: the points stand that much higher.
  Ball coated = ball;
  for (float& z : coated.ground.z_mm.cells()) z += 0.2F;
  coated.envelope = with_balls(coated.ground, std::array{kMiddle}, kRadius + 0.2);
  EXPECT_EQ(coated.share_of(on_ball(-2.6, -2.2, kRadius + 0.2), 0.2), 1.0);
}

TEST(BeyondHeights, LeavesWhatHeightsCanJudge) {
  const Ball ball;
  // Where the nodes miss the ball by less than 0.03 mm.
  EXPECT_EQ(ball.share_of(on_ball(3.5, 5.0)), 0.0);
  EXPECT_EQ(ball.share_of(on_ground(5.6, 25.0)), 0.0);
  // A pit and a heap beside the ball, the ball itself missing or standing 1 mm lower.
  EXPECT_EQ(ball.share_of(on_ground(5.6, 9.0, 9.0)), 0.0);
  EXPECT_EQ(ball.share_of(on_ground(5.6, 9.0, 11.0)), 0.0);
  EXPECT_EQ(ball.share_of(on_ground(0.0, 3.3)), 0.0);
  EXPECT_EQ(ball.share_of(on_ball(3.5, 5.0, kRadius - 1.0)), 0.0);
}

TEST(BeyondHeights, LeavesNextToNothingSignificant) {
  std::vector<Vec3> middles;
  std::vector<TriMesh> balls;
  for (int i = 0; i < 9; ++i) {
    middles.push_back({15.0 + 15.0 * (i % 3), 15.0 + 15.0 * (i / 3), 13.0});
    balls.push_back(ball_at(middles.back(), kRadius));
  }
  const ModelField ground = flat(121), envelope = with_balls(ground, middles, kRadius);
  std::size_t with = 0, without = 0;
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    ScanOptions o;
    o.scanner = *assets::find_preset(assets::scanner_presets(), "zf5006h");
    o.scanner.lines_per_turn = 20'000;  // ten points a mm^2
    o.footprint_rays = 1;
    o.station_mm = {30.0, -600.0, 500.0};
    o.seed = seed;
    auto cloud = simulate_scan(ground, balls, o);
    ASSERT_THAT(cloud, Succeeds());
    const double noise = range_sigma_mm(o.scanner, 800.0, 0.6, 0.5);
    const auto findings = [&] {
      const auto d = deviate(*cloud, {}, envelope, Millimetres{5.0});
      EXPECT_THAT(d, Succeeds());
      ScanPose pose;
      pose.registration.noise_mm = noise;
      pose.points = cloud->points_mm.size();
      return significance(cloud->points_mm, d->per_point_mm, std::span(&pose, 1)).findings.size();
    };
    with += findings();
    const auto beyond =
        judge_by_heights(cloud->points_mm, envelope, ground, balls, 0.0, noise).value().beyond;
    std::size_t to = 0;
    for (std::size_t i = 0; i < beyond.size(); ++i)
      if (beyond[i] == 0) cloud->points_mm[to++] = cloud->points_mm[i];
    EXPECT_GT(to, beyond.size() * 8 / 10);
    cloud->points_mm.resize(to);
    cloud->intensity.clear();
    without += findings();
  }
  EXPECT_GE(with, 36U);  // each of nine balls
  // Where nodes cut a ball short by less than what is called wrong.
  EXPECT_LE(without, with / 36);
  RecordProperty("with", static_cast<int>(with));
  RecordProperty("without", static_cast<int>(without));
}

struct Mean {
  double sum = 0.0, square = 0.0, n = 0.0;
  void add(double d) { sum += d, square += d * d, n += 1.0; }
  [[nodiscard]] double value() const { return sum / n; }
  [[nodiscard]] double sigma() const { return std::sqrt(square) / n; }
  [[nodiscard]] std::string text() const {
    return fmt::format("{:+.4f} +- {:.4f} mm ({:.0f})", value(), sigma(), n);
  }
};

// Within a millimetre of the outline, on either side, where a ball's side and the ground meet;
// noise of a quarter of a millimetre.
TEST(JudgeByHeights, LeavesNoStepBesideOutlines) {
  constexpr double kLarge = 14.0;
  for (const double above : {4.0, -4.0}) {
    const Vec3 middle{30.0, 30.0, 10.0 + above};
    const TriMesh ball = ball_at(middle, kLarge);
    const auto balls = std::span(&ball, 1);
    const ModelField ground = flat(121), envelope = with_balls(ground, {&middle, 1}, kLarge);
    const double outline = above > 0.0 ? kLarge : std::sqrt(kLarge * kLarge - above * above);
    const auto add = [&](Vec3 at, double deviation, double within_mm, Mean& beside) {
      const double beyond = std::hypot(at.x - middle.x, at.y - middle.y) - outline;
      if (std::abs(beyond) < within_mm) beside.add(deviation);
    };
    Mean by_place, by_point;
    double noise = 0.0;
    for (std::uint64_t seed = 1; seed <= 8; ++seed) {
      ScanOptions o;
      o.scanner = *assets::find_preset(assets::scanner_presets(), "zf5006h");
      o.scanner.range_sigma_mm *= 3.0;
      o.footprint_rays = 1;
      o.station_mm = {30.0, -600.0, 700.0};
      o.seed = seed;
      const auto cloud = simulate_scan(ground, balls, o);
      ASSERT_THAT(cloud, Succeeds());
      noise = range_sigma_mm(o.scanner, 900.0, 0.7, 0.5);
      const auto d = deviate(*cloud, {}, envelope, Millimetres{5.0});
      ASSERT_THAT(d, Succeeds());
      const auto& points = cloud->points_mm;
      const Viewpoint view{o.station_mm, 0.0, points.size()};
      const auto known =
          judge_by_heights(points, envelope, ground, balls, 0.0, noise, std::span(&view, 1));
      ASSERT_THAT(known, Succeeds());
      for (const SeenAt& seen : known->seen_at)
        add(seen.place_mm, static_cast<double>(d->per_point_mm[seen.point]), 4.0, by_place);
      const auto unknown = judge_by_heights(points, envelope, ground, balls, 0.0, noise);
      ASSERT_THAT(unknown, Succeeds());
      EXPECT_TRUE(unknown->seen_at.empty());
      for (std::size_t i = 0; i < points.size(); ++i)
        if (unknown->beyond[i] == 0)
          add(points[i], static_cast<double>(d->per_point_mm[i]), 1.0, by_point);
    }
    const std::string which = fmt::format("middle {} mm above, noise {:.2f} mm: {}; by point {}",
                                          above, noise, by_place.text(), by_point.text());
    RecordProperty(above > 0.0 ? "overhanging" : "lying", which);
    EXPECT_GT(by_place.n, 5'000.0) << which;
    EXPECT_LT(std::abs(by_place.value()), 0.05 * noise) << which;
    EXPECT_GT(by_point.value(), 8.0 * by_point.sigma()) << which;
  }
}

}  // namespace
}  // namespace maquette::scan
