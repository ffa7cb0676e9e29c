// SPDX-License-Identifier: GPL-3.0-or-later

// What is claimed in cnc/cutter_reach.hpp, and how each claim is attacked:
//
//   reach ......... spherical pits narrower and wider than the ball, grooves: closed forms of what
//                   stays, of its place and its share of the plan; ground the ball fits everywhere
//   slope ......... planes, turned any way; a roof of two; facets of random ground one by one
//   depth ......... highest less lowest
//   same for any number of threads

#include "cnc/cutter_reach.hpp"

#include <cmath>
#include <numbers>

#include <gtest/gtest.h>
#include <oneapi/tbb/global_control.h>

#include "support/matchers.hpp"
#include "support/terrain.hpp"

namespace maquette::cnc {
namespace {

using heightmap::ModelField;
using testing_support::flat_field;
using testing_support::Ground;
using testing_support::Succeeds;

constexpr double kBall = 3.0, kSpacing = 0.1, kSide = 16.0;
constexpr double kDegree = std::numbers::pi / 180.0;

template <class Height>
ModelField shaped(const Height& height, double spacing = kSpacing) {
  const auto n = static_cast<std::ptrdiff_t>(std::lround(kSide / spacing)) + 1;
  ModelField f = flat_field(n, n, spacing, 0.0F);
  for (std::ptrdiff_t r = 0; r < n; ++r)
    for (std::ptrdiff_t c = 0; c < n; ++c)
      f.z_mm(r, c) = static_cast<float>(height(f.x_mm(c), f.y_mm(r)));
  return f;
}

/// A part of a sphere below z = 0, about the middle, whose sides end at `rim_deg` from level.
struct Pit {
  double radius, rim_deg;
  [[nodiscard]] double rim() const { return radius * std::sin(rim_deg * kDegree); }
  [[nodiscard]] double depth_at(double rho) const {
    return rho >= rim()
               ? 0.0
               : std::sqrt(radius * radius - rho * rho) - radius * std::cos(rim_deg * kDegree);
  }
  /// A wider ball rests on the rim all round.
  [[nodiscard]] double stays_at(double rho) const {
    if (rho >= rim()) return 0.0;
    return depth_at(rho) -
           (std::sqrt(kBall * kBall - rho * rho) - std::sqrt(kBall * kBall - rim() * rim()));
  }
  [[nodiscard]] ModelField field() const {
    return shaped([&](double x, double y) { return -depth_at(std::hypot(x - 8.0, y - 8.0)); });
  }
};

TEST(CutterReach, APitNarrowerThanTheBallKeepsWhatTheClosedFormSays) {
  for (const Pit pit : {Pit{2.0, 60.0}, Pit{1.0, 80.0}}) {
    const ModelField design = pit.field();
    const auto reach = map_cutter_reach(design, {kBall}, Millimetres{0.05}, 90.0);
    ASSERT_THAT(reach, Succeeds());
    // The rim is a polygon whose corners lie up to a cell beside the circle; what that lets the
    // ball down is cell * tan of the ball's slope at the rim.
    const double slope = pit.rim() / std::sqrt(kBall * kBall - pit.rim() * pit.rim());
    const double tolerance = 1.5 * kSpacing * slope + 0.005;
    EXPECT_NEAR(reach->rest.highest_mm, pit.stays_at(0.0), tolerance) << pit.radius;
    EXPECT_GT(reach->rest.highest_mm, 0.05 + tolerance) << pit.radius;
    EXPECT_NEAR(reach->deepest_x_mm, 8.0, 0.3) << pit.radius;
    EXPECT_NEAR(reach->deepest_y_mm, 8.0, 0.3) << pit.radius;
    double edge = pit.rim();  // of what counts
    while (pit.stays_at(edge) < 0.05) edge -= 1e-4;
    const double area = std::numbers::pi * edge * edge;
    // A cell along the border, either way.
    EXPECT_NEAR(reach->rest.area_mm2, area, 2.0 * std::numbers::pi * edge * kSpacing) << pit.radius;
    const auto nodes = static_cast<double>(design.z_mm.cells().size());
    EXPECT_NEAR(reach->unreached_share * nodes * kSpacing * kSpacing, reach->rest.area_mm2, 1e-9);
    EXPECT_NEAR(reach->relief_mm, pit.depth_at(0.0), 1e-6);
  }
}

TEST(CutterReach, APitWiderThanTheBallIsReachedEverywhere) {
  for (const Pit pit : {Pit{3.3, 60.0}, Pit{5.0, 70.0}, Pit{20.0, 15.0}}) {
    const auto reach = map_cutter_reach(pit.field(), {kBall}, Millimetres{0.05}, 90.0);
    ASSERT_THAT(reach, Succeeds());
    // Facets meet at angles of up to sqrt(2) cells over the radius, steeper by the slope; and below
    // the threshold the ball is put over nodes alone, up to 0.71 of a cell beside its best place.
    // In a pit hardly wider than the ball that is far for its centre: there only the threshold
    // holds.
    const double cosine = std::cos(pit.rim_deg * kDegree);
    const double turn = 1.5 * kSpacing / pit.radius / cosine;
    const double beside = 0.5 * kSpacing * kSpacing / (2.0 * kBall * std::pow(cosine, 3.0));
    if (pit.radius > 1.5 * kBall) {
      EXPECT_LT(reach->rest.highest_mm, kBall * turn * turn / 8.0 / cosine + beside + 1e-3)
          << pit.radius;
    }
    EXPECT_EQ(reach->unreached_share, 0.0) << pit.radius;
  }
}

TEST(CutterReach, AGrooveKeepsItsBottom) {
  constexpr double kCell = 0.2;
  for (const double m : {0.3, 1.0}) {
    const ModelField design =
        shaped([&](double, double y) { return m * std::abs(y - 8.0); }, kCell);
    const auto reach = map_cutter_reach(design, {kBall}, Millimetres{0.05}, 90.0);
    ASSERT_THAT(reach, Succeeds());
    const double stretch = std::sqrt(1.0 + m * m);
    const auto stays = [&](double y) {
      return kBall * stretch - std::sqrt(kBall * kBall - y * y) - m * y;
    };
    EXPECT_NEAR(reach->rest.highest_mm, stays(0.0), 0.01) << m;
    double edge = 0.0;
    while (stays(edge + 1e-4) > 0.05) edge += 1e-4;
    const double share = 2.0 * edge / kSide;
    EXPECT_NEAR(reach->unreached_share, share, 2.0 * kCell / kSide) << m;
    EXPECT_NEAR(reach->slope.highest_deg, std::atan(m) / kDegree, 1e-3) << m;
  }
}

TEST(CutterSlope, PlanesHaveTheirOwn) {
  for (const double slope_deg : {0.0, 1.0, 30.0, 60.0, 80.0})
    for (const double heading : {0.0, 0.4, 1.9, 3.6}) {
      const double m = std::tan(slope_deg * kDegree);
      const ModelField design = shaped(
          [&](double x, double y) { return m * (x * std::cos(heading) + y * std::sin(heading)); },
          0.5);
      // Heights up to 130 mm are rounded to 4e-6 mm; over 0.5 mm that is 1e-5 of slope and some.
      const SlopeMap map = map_slope(design, slope_deg + 0.01);
      EXPECT_NEAR(map.highest_deg, slope_deg, 2e-3);
      EXPECT_EQ(map.share_above, 0.0);
      for (const float s : map.steepest_deg.cells())
        ASSERT_NEAR(static_cast<double>(s), slope_deg, 2e-3);
      if (slope_deg > 0.0) {
        EXPECT_EQ(map_slope(design, slope_deg - 0.01).share_above, 1.0);
      }
    }
}

TEST(CutterSlope, OfARoofIsOfEachSide) {
  // Steep to x = 4, a quarter of the plan.
  const ModelField design =
      shaped([](double x, double) { return x < 4.0 ? 2.0 * x : 8.0 + 0.1 * (x - 4.0); });
  const SlopeMap map = map_slope(design, 45.0);
  EXPECT_NEAR(map.share_above, 0.25, 1e-9);
  EXPECT_LT(map.highest_x_mm, 4.0);
  EXPECT_EQ(map_slope(design, 90.0).share_above, 0.0);
  for (std::ptrdiff_t c = 0; c < design.z_mm.cols(); ++c)  // the ridge belongs to both
    EXPECT_NEAR(static_cast<double>(map.steepest_deg(7, c)),
                std::atan(design.x_mm(c) < 4.05 ? 2.0 : 0.1) / kDegree, 1e-2)
        << c;
}

TEST(CutterSlope, OfRandomGroundIsThatOfItsFacets) {
  const ModelField design = testing_support::ground(Ground::rough, 3, 40, 0.7);
  const SlopeMap map = map_slope(design, 30.0);
  Grid<float> steepest(40, 40, 0.0F);
  double above = 0.0, highest = 0.0;
  for (std::ptrdiff_t r = 0; r < 39; ++r)
    for (std::ptrdiff_t c = 0; c < 39; ++c)
      for (const bool right : {true, false}) {
        const auto at = [&](std::ptrdiff_t i, std::ptrdiff_t j) {
          return Vec3{design.x_mm(j), design.y_mm(i), static_cast<double>(design.z_mm(i, j))};
        };
        const Vec3 a = at(r, c), b = right ? at(r, c + 1) : at(r + 1, c), d = at(r + 1, c + 1);
        const Vec3 n = normalized(cross(b - a, d - a));
        const double slope = std::acos(std::min(1.0, std::abs(n.z))) / kDegree;
        above += slope > 30.0 ? 1.0 : 0.0;
        highest = std::max(highest, slope);
        for (const auto& [i, j] : {std::pair{r, c}, std::pair{right ? r : r + 1, right ? c + 1 : c},
                                   std::pair{r + 1, c + 1}})
          steepest(i, j) = std::max(steepest(i, j), static_cast<float>(slope));
      }
  EXPECT_NEAR(map.highest_deg, highest, 1e-4);
  EXPECT_NEAR(map.share_above, above / (2.0 * 39 * 39), 1e-12);
  for (std::size_t i = 0; i < steepest.cells().size(); ++i)
    ASSERT_NEAR(map.steepest_deg.cells()[i], steepest.cells()[i], 1e-3) << i;
}

TEST(CutterReach, IsTheSameForAnyNumberOfThreads) {
  const ModelField design = testing_support::ground(Ground::pits, 5, 60, 0.5);
  const auto many = map_cutter_reach(design, {kBall}, Millimetres{0.05}, 30.0);
  const oneapi::tbb::global_control one(oneapi::tbb::global_control::max_allowed_parallelism, 1);
  const auto single = map_cutter_reach(design, {kBall}, Millimetres{0.05}, 30.0);
  ASSERT_THAT(many, Succeeds());
  ASSERT_THAT(single, Succeeds());
  EXPECT_EQ(many->rest.remaining.z_mm, single->rest.remaining.z_mm);
  EXPECT_EQ(many->slope.steepest_deg, single->slope.steepest_deg);
}

}  // namespace
}  // namespace maquette::cnc
