// SPDX-License-Identifier: GPL-3.0-or-later

// cnc/fillet.hpp:
//   a crease gets the ball's radius ........ valleys of several angles, along nodes and across
//   them,
//                                            closed form, to the search's step
//   a bowl wider than the ball stays, a narrower one gets its radius ... closed form
//   where the ball fits nothing moves ...... plane with its outline, hill, wide bowl: to the bit
//   the ball then fits everywhere .......... random terrain: filleted again it rises by no more
//   than
//                                            tolerance and facets
//   nowhere below the design, nor above the highest place of the ball ... random terrain: from the
//                                            closing over a lattice of places, slow and independent
//   bad input .............................. radius, void

#include "cnc/fillet.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "cnc/cutter_location.hpp"
#include "cnc/mill.hpp"
#include "cnc/rest.hpp"
#include "support/matchers.hpp"
#include "support/shapes.hpp"
#include "support/terrain.hpp"

namespace maquette::cnc {
namespace {

using heightmap::ModelField;
using testing_support::FailsWith;
using testing_support::field_of;

TEST(Fillet, ACreaseGetsTheRadius) {
  const double R = 2.0;
  for (const double slope : {0.4, 1.0, 2.0}) {
    // Along y at x = 1, where nodes are.
    const ModelField f =
        field_of(41, 81, 0.25, [&](double x, double) { return slope * std::abs(x - 1.0); });
    const Fillet filleted = fillet_surface(f, Millimetres{R}).value();
    const double steep = std::sqrt(1.0 + slope * slope);
    const double reach = R * slope / steep;  // of the round, from its middle
    double area = 0.0;
    for (std::ptrdiff_t c = 0; c < 81; ++c) {
      const double x = std::abs(f.x_mm(c) - 1.0);
      const double known = x < reach ? R * steep - std::sqrt(R * R - x * x) : slope * x;
      const double rise = known - slope * x;
      area += rise > 0.02 ? 0.25 * 0.25 : 0.0;
      for (const std::ptrdiff_t r : {0, 20, 40}) {
        const double off = static_cast<double>(filleted.surface.z_mm(r, c)) - known;
        EXPECT_LE(off, 0.004 + 1e-4 * std::pow(steep, 3.0)) << slope << ' ' << x;
        EXPECT_GE(off, rise > 0.02 ? -1e-5 : -0.02) << slope << ' ' << x;
      }
    }
    EXPECT_NEAR(filleted.highest_mm, R * (steep - 1.0), 0.005);
    EXPECT_NEAR(filleted.area_mm2, 41.0 * area, 41.0 * 4.0 * 0.0625);
  }
}

TEST(Fillet, ACreaseAcrossTheNodes) {
  // The same valley turned by 30 degrees, so that no edge lies along it: facets fill it a little.
  const double R = 3.0, ux = std::cos(0.52), uy = std::sin(0.52);
  const ModelField f = field_of(
      81, 81, 0.25, [&](double x, double y) { return std::abs(ux * (x - 6.0) + uy * (y - 12.0)); });
  const ModelField s = fillet_surface(f, Millimetres{R}).value().surface;
  for (std::ptrdiff_t r = 0; r < 81; ++r)
    for (std::ptrdiff_t c = 0; c < 81; ++c) {
      const double away = std::abs(ux * (f.x_mm(c) - 6.0) + uy * (f.y_mm(r) - 12.0));
      const double known =
          away < R / std::sqrt(2.0) ? R * std::sqrt(2.0) - std::sqrt(R * R - away * away) : away;
      // An edge across the valley lies at most half a spacing, 2 * 0.125 * 0.5, above its bottom.
      EXPECT_NEAR(s.z_mm(r, c), known, 0.13);
      EXPECT_GE(s.z_mm(r, c), std::max(static_cast<double>(f.z_mm(r, c)), known - 0.02) - 1e-5);
    }
}

TEST(Fillet, NarrowBowlsGetTheRadius) {
  // A bowl of radius 2 in level ground, as deep as 1: the ball of 3 rests on its rim.
  const double R = 3.0, rim = std::sqrt(3.0);
  const ModelField f = field_of(61, 61, 0.125, [&](double x, double y) {
    const double r2 = (x - 0.0) * (x - 0.0) + (y - 6.0) * (y - 6.0);
    return r2 < 3.0 ? 1.0 - std::sqrt(4.0 - r2) : 0.0;
  });
  const ModelField s = fillet_surface(f, Millimetres{R}).value().surface;
  for (std::ptrdiff_t r = 0; r < 61; ++r)
    for (std::ptrdiff_t c = 0; c < 61; ++c) {
      const double away = std::hypot(f.x_mm(c), f.y_mm(r) - 6.0);
      const double known =
          away < rim ? std::sqrt(R * R - rim * rim) - std::sqrt(R * R - away * away) : 0.0;
      EXPECT_NEAR(s.z_mm(r, c), known, 0.035) << away;  // nodes do not lie on the rim
    }
}

TEST(Fillet, NothingMovesWhereTheBallFits) {
  const auto same = [](const ModelField& f, double R) {
    const Fillet filleted = fillet_surface(f, Millimetres{R}).value();
    EXPECT_TRUE(filleted.surface.z_mm == f.z_mm);
    EXPECT_EQ(filleted.highest_mm, 0.0);
    EXPECT_EQ(filleted.volume_mm3, 0.0);
  };
  same(field_of(41, 51, 0.5, [](double x, double y) { return 0.9 * x - 0.5 * y; }), 3.0);
  same(field_of(41, 51, 0.25, [](double x, double y) { return -0.05 * (x * x + y * y); }), 3.0);
  // A bowl with a radius of 10 and more.
  same(field_of(41, 51, 0.25, [](double x, double y) { return 0.05 * (x * x + y * y); }), 5.0);
}

class FilletTerrain : public testing::TestWithParam<std::uint64_t> {};

TEST_P(FilletTerrain, TheBallThenFitsEverywhere) {
  const double R = 2.5, d = 0.5, tolerance = 0.02;
  const ModelField f = testing_support::random_terrain(GetParam(), 61, 71, d, 0.4);
  const Fillet once = fillet_surface(f, Millimetres{R}, Millimetres{tolerance}).value();
  EXPECT_GT(once.highest_mm, 0.1);
  const Fillet twice = fillet_surface(once.surface, Millimetres{R}).value();
  EXPECT_LT(twice.highest_mm, 2.0 * tolerance + d * d / (4.0 * R));

  // The closing over a lattice of places of a tenth of a spacing, inside, where nothing beyond the
  // outline is touched.
  const DropCutter cutter(f, Cutter::ball(R));
  const auto at = [&](std::ptrdiff_t i) { return 0.1 * d * static_cast<double>(i); };
  for (std::ptrdiff_t r = 12; r < 49; r += 4)
    for (std::ptrdiff_t c = 12; c < 59; c += 4) {
      double closing = INFINITY;
      for (std::ptrdiff_t i = -50; i <= 50; ++i)
        for (std::ptrdiff_t j = -50; j <= 50; ++j) {
          const double q = R * R - at(i) * at(i) - at(j) * at(j);
          if (q < 0.0) continue;
          closing = std::fmin(
              closing, cutter.drop(f.x_mm(c) + at(j), f.y_mm(r) + at(i)).tip_mm + R - std::sqrt(q));
        }
      const auto here = static_cast<double>(once.surface.z_mm(r, c));
      EXPECT_GE(here, static_cast<double>(f.z_mm(r, c)));
      EXPECT_NEAR(here, std::fmax(closing, static_cast<double>(f.z_mm(r, c))), 1.2 * tolerance);
    }
}
INSTANTIATE_TEST_SUITE_P(Seeds, FilletTerrain, testing::Values(1, 2, 3));

TEST(Fillet, RefusesBadInput) {
  ModelField f = field_of(5, 5, 0.5, [](double, double) { return 1.0; });
  for (const double R : {0.0, -1.0, 101.0, double{NAN}, double{INFINITY}})
    EXPECT_THAT(fillet_surface(f, Millimetres{R}), FailsWith(kRestOptionOutOfRange)) << R;
  EXPECT_THAT(fillet_surface(f, Millimetres{1.0}, Millimetres{0.0}),
              FailsWith(kRestOptionOutOfRange));
  f.z_mm(2, 3) = NAN;
  EXPECT_THAT(fillet_surface(f, Millimetres{1.0}), FailsWith(kHeightNotFinite));
}

}  // namespace
}  // namespace maquette::cnc
