// SPDX-License-Identifier: GPL-3.0-or-later

// meshing/crater_density.hpp, plan_stones with a density:
//   travel distance on level ground ......... distance from the circle, closed form, at every node
//   steep ground is slower .................. a tilted plane, along and across the slope, closed
//   form nearest of several rims, part on site ... closed form the density's law
//   ....................... far share, 1/e at the decay length, 1:2500 the plan is a sample of it
//   .............. counts a ring, chi-square; even plans fail the same test a function of the seed
//   .................. compared the error ............................... reached

#include "meshing/crater_density.hpp"

#include <cmath>
#include <numbers>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "support/matchers.hpp"
#include "support/terrain.hpp"

namespace maquette::meshing {
namespace {

using heightmap::ModelField;
using testing_support::FailsWith;
using testing_support::field_of;
using testing_support::Succeeds;

/// A model at 1:2500 of 100 mm, 250 m on the planet, its middle the site's.
constexpr double kScale = 2500, kHalf_m = 125;
StoneGround ground_of(const ModelField& f) {
  return {.surface = f,
          .scale = ModelScale(kScale, 2.0),
          .east_of_x0_m = -kHalf_m,
          .north_of_y0_m = -kHalf_m};
}

TEST(TravelFromRims, OnLevelGroundIsTheDistanceFromTheCircle) {
  const ModelField f = field_of(201, 0.5, [](double, double) { return 3.0; });
  // One in the middle, one half beyond the eastern border.
  const std::vector<Crater> craters{{10.0, -20.0, Metres{60.0}}, {125.0, 60.0, Metres{50.0}}};
  const auto travel = travel_from_rims(craters, ground_of(f), 1.0);
  ASSERT_THAT(travel, Succeeds());
  double worst = 0.0;
  for (std::ptrdiff_t r = 0; r < 201; ++r)
    for (std::ptrdiff_t c = 0; c < 201; ++c) {
      const double east = 2.5 * f.x_mm(c) - kHalf_m, north = 2.5 * f.y_mm(r) - kHalf_m;
      double expected = INFINITY;
      for (const Crater& k : craters)
        expected = std::fmin(expected, std::abs(std::hypot(east - k.east_m, north - k.north_m) -
                                                0.5 * k.diameter.value()) /
                                           2.5);
      worst = std::fmax(worst, std::abs(static_cast<double>(travel->z_mm(r, c)) - expected));
    }
  // First order: half a cell near the rim's chords, and where waves meet.
  EXPECT_LT(worst, 0.35);
}

TEST(TravelFromRims, SteepGroundIsSlower) {
  // Of slope 0.5 towards x: a metre across it counts as 1 + 2 * 0.5, one along it is as much
  // longer.
  const ModelField f = field_of(201, 0.5, [](double x, double) { return 0.5 * x; });
  const auto travel =
      travel_from_rims(std::vector<Crater>{{0.0, 0.0, Metres{5.0}}}, ground_of(f), 2.0);
  ASSERT_THAT(travel, Succeeds());
  const auto at = [&](double x, double y) { return heightmap::height_at(*travel, x, y); };
  const double along = 2.0 * std::sqrt(1.25), across = 2.0;
  // The rim is a circle of 1 mm seen from above. First order: 3 %.
  EXPECT_NEAR(at(90, 50), along * 39, 0.03 * along * 39);
  EXPECT_NEAR(at(10, 50), along * 39, 0.03 * along * 39);
  EXPECT_NEAR(at(50, 90), across * 39, 0.03 * across * 39);
  EXPECT_NEAR(at(50, 10), across * 39, 0.03 * across * 39);
}

TEST(DensityAround, FallsByTheDecayLength) {
  ModelField travel = field_of(101, 1.0, [](double x, double) { return x; });
  const auto density = density_around(travel, ground_of(travel), Metres{50.0}, 0.2);
  // 20 mm of the model are 50 m.
  EXPECT_NEAR(density(-kHalf_m, 0.0), 1.0, 1e-6);
  EXPECT_NEAR(density(-kHalf_m + 50.0, 30.0), 0.2 + 0.8 / std::numbers::e, 1e-6);
  EXPECT_NEAR(density(-kHalf_m + 100.0, 0.0), 0.2 + 0.8 * std::exp(-2.0), 1e-6);
  EXPECT_EQ(density(200.0, 0.0), 0.2);  // beyond the surface
}

/// Chi-square of stones counted in rings round the rim against the law, over all rings.
double chi_square(const std::vector<SiteStone>& stones, const Crater& crater, double decay_m,
                  double far_share, int rings) {
  const double reach = 90.0;
  std::vector<double> counted(static_cast<std::size_t>(rings)), expected(counted);
  const auto ring_of = [&](double east, double north) {
    const double d = std::abs(std::hypot(east - crater.east_m, north - crater.north_m) -
                              0.5 * crater.diameter.value());
    return std::min(static_cast<std::size_t>(d / reach * rings), counted.size() - 1);
  };
  for (const SiteStone& s : stones) counted[ring_of(s.east_m, s.north_m)] += 1.0;
  double total = 0.0;
  for (double east = -124.75; east < kHalf_m; east += 0.5)
    for (double north = -124.75; north < kHalf_m; north += 0.5) {
      const double d = std::abs(std::hypot(east - crater.east_m, north - crater.north_m) -
                                0.5 * crater.diameter.value());
      const double w = far_share + (1.0 - far_share) * std::exp(-d / decay_m);
      expected[ring_of(east, north)] += w;
      total += w;
    }
  double sum = 0.0;
  for (std::size_t i = 0; i < counted.size(); ++i) {
    const double e = expected[i] * static_cast<double>(stones.size()) / total;
    sum += (counted[i] - e) * (counted[i] - e) / e;
  }
  return sum;
}

TEST(PlanStones, IsASampleOfTheDensity) {
  const ModelField f = field_of(201, 0.5, [](double, double) { return 3.0; });
  const Crater crater{10.0, -20.0, Metres{80.0}};
  SitePlanRequest request{.count = 1500,
                          .half_width = Metres{kHalf_m},
                          .min_diameter = Metres{0.05},
                          .max_diameter = Metres{0.1}};
  const int rings = 12;
  // 11 degrees of freedom: below 31.3 with p = 0.999.
  for (const std::uint64_t seed : {1U, 2U}) {
    request.seed = seed;
    request.density = nullptr;
    const auto even = plan_stones(request);
    auto travel = travel_from_rims(std::vector{crater}, ground_of(f), 1.0);
    ASSERT_TRUE(even && travel);
    request.density = density_around(std::move(*travel), ground_of(f), Metres{20.0}, 0.1);
    const auto around = plan_stones(request);
    ASSERT_TRUE(around);
    EXPECT_LT(chi_square(*around, crater, 20.0, 0.1, rings), 31.3) << seed;
    EXPECT_LT(chi_square(*even, crater, 20.0, 1.0, rings), 31.3) << seed;
    EXPECT_GT(chi_square(*even, crater, 20.0, 0.1, rings), 200.0) << seed;
    EXPECT_GT(chi_square(*around, crater, 40.0, 0.1, rings), 31.3) << seed;
    for (std::size_t i = 0; i < around->size(); ++i)
      EXPECT_EQ((*around)[i].diameter, (*even)[i].diameter);
  }
}

TEST(PlanStones, WithADensityIsAFunctionOfTheSeed) {
  SitePlanRequest request{.count = 20, .half_width = Metres{kHalf_m}};
  request.density = [](double east, double) { return east > 0.0 ? 1.0 : 0.0; };
  const auto a = plan_stones(request), b = plan_stones(request);
  request.seed = 2;
  const auto c = plan_stones(request);
  ASSERT_TRUE(a && b && c);
  for (std::size_t i = 0; i < a->size(); ++i) {
    EXPECT_GT((*a)[i].east_m, 0.0);
    EXPECT_EQ((*a)[i].east_m, (*b)[i].east_m);
    EXPECT_NE((*a)[i].east_m, (*c)[i].east_m);
  }
  for (std::uint64_t k = 0; k < 100; ++k)
    if (const auto other = draw_other_place(request, (*c)[0], k)) {
      EXPECT_GT(other->east_m, 0.0);
      EXPECT_TRUE(keeps_to_its_square(request, (*c)[0], other->east_m, other->north_m));
    }
}

TEST(TravelFromRims, NeedsARimOnTheSurface) {
  const ModelField f = field_of(21, 5.0, [](double, double) { return 3.0; });
  EXPECT_THAT(travel_from_rims(std::vector<Crater>{{300.0, 0.0, Metres{60.0}}}, ground_of(f), 1.0),
              FailsWith(kNoRimOnSite));
}

}  // namespace
}  // namespace maquette::meshing
