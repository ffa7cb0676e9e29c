// SPDX-License-Identifier: GPL-3.0-or-later

// What is claimed in cnc/cutter_location.hpp, contact.hpp, tool.hpp and steepness.hpp, and how
// each claim is attacked:
//
//   closed forms ................. plane, tilted plane, spike, ridge, outline; ball, bull, flat
//   holder ....................... closed forms of disc and cone; brute force
//   wide cutters (by tiles) ...... brute force
//   exact to 1e-9 mm ............. brute force over all triangles (features in 3-D vectors) on
//                                  rough ground, spikes, cliffs, knife edges, narrow pits
//   the brute force is right ..... nested search for the maximum, no formula in common
//   grows with the surface ....... raising nodes never lowers the tip
//   moves with the surface ....... shift in z, shift by whole cells
//   history does not matter ...... same bits from a fresh cutter, in any order
//   contact point is a contact ... it lies on the surface and on the cutter
//   least depth of contact ....... no contact found by drop() is shallower
//
// Heights come from a seed that is part of the test's name.

#include "cnc/cutter_location.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "cnc/slow_contact.hpp"
#include "cnc/steepness.hpp"
#include "core/random.hpp"
#include "core/vec.hpp"
#include "support/terrain.hpp"

namespace maquette::cnc {
namespace {

using heightmap::ModelField;
using testing_support::flat_field;

// ---- slow oracle: every triangle (slow_contact.hpp) ---------------------------------------

template <class OnTriangle>
double over_all_triangles(const ModelField& f, OnTriangle&& on) {
  double best = -INFINITY;
  for (std::ptrdiff_t r = 0; r + 1 < f.z_mm.rows(); ++r)
    for (std::ptrdiff_t c = 0; c + 1 < f.z_mm.cols(); ++c) {
      const auto p = [&](std::ptrdiff_t i, std::ptrdiff_t j) {
        return Vec3{f.x_mm(c + j), f.y_mm(r + i), static_cast<double>(f.z_mm(r + i, c + j))};
      };
      best = std::max({best, on(p(0, 0), p(0, 1), p(1, 1)), on(p(0, 0), p(1, 1), p(1, 0))});
    }
  return best;
}
double brute_force(const ModelField& f, double x, double y, const Slow& slow) {
  return over_all_triangles(f, [&](Vec3 a, Vec3 b, Vec3 c) { return slow(a, b, c, x, y); });
}

// ---- closed forms ------------------------------------------------------------------------

TEST(DropCutter, StandsOnFlatGround) {
  DropCutter cutter(flat_field(41, 33, 0.5, 7.25F), Cutter::ball(3.0));
  for (const double x : {0.0, 3.1, 8.0, 16.0})
    for (const double y : {0.0, 4.77, 20.0}) EXPECT_NEAR(cutter.drop(x, y).tip_mm, 7.25, 1e-12);
}

// R (1 / cos t - 1) above the plane: the ball touches uphill of its tip.
TEST(DropCutter, RidesAboveATiltedPlane) {
  for (const double gx : {0.25, -0.5, 1.0})
    for (const double gy : {0.0, 0.75, -2.0}) {
      ModelField plane = flat_field(41, 41, 0.5, 0.0F);
      for (std::ptrdiff_t r = 0; r < 41; ++r)
        for (std::ptrdiff_t c = 0; c < 41; ++c)  // exact in float
          plane.z_mm(r, c) = static_cast<float>(gx * plane.x_mm(c) + gy * plane.y_mm(r));
      DropCutter cutter(plane, Cutter::ball(3.0));
      const double raise = 3.0 * (std::sqrt(1.0 + gx * gx + gy * gy) - 1.0);
      for (const double x : {9.0, 10.123, 10.9})
        EXPECT_NEAR(cutter.drop(x, 10.3).tip_mm, gx * x + gy * 10.3 + raise, 1e-10);
    }
}

// Flat end radius a, corner rc: a g + rc (sqrt(1 + g^2) - 1) above the plane.
TEST(DropCutter, EveryEndRidesAboveATiltedPlane) {
  ModelField plane = flat_field(61, 61, 0.5, 0.0F);
  for (std::ptrdiff_t r = 0; r < 61; ++r)
    for (std::ptrdiff_t c = 0; c < 61; ++c)  // exact in float
      plane.z_mm(r, c) = static_cast<float>(0.25 * plane.x_mm(c) - 0.75 * plane.y_mm(r));
  const double g = std::hypot(0.25, 0.75);
  for (const double rc : {0.0, 0.5, 2.0, 3.0}) {
    DropCutter cutter(plane, Cutter::bull(3.0, rc));
    for (const double x : {14.0, 15.123})
      EXPECT_NEAR(cutter.drop(x, 15.3).tip_mm,
                  0.25 * x - 0.75 * 15.3 + (3.0 - rc) * g + rc * (std::hypot(1.0, g) - 1.0), 1e-10);
  }
}

TEST(DropCutter, AFlatEndStandsOnTheHighestPointUnderIt) {
  ModelField ground = flat_field(41, 41, 0.5, 1.0F);
  ground.z_mm(20, 20) = 6.0F;
  DropCutter flat(ground, Cutter::flat(2.0)), bull(ground, Cutter::bull(2.0, 0.5));
  for (const double x : {8.0, 8.25, 9.3, 10.0, 12.0}) {
    EXPECT_EQ(flat.drop(x, 10.0).tip_mm, 6.0) << x;  // the rim counts
    const double t = std::max(0.0, std::abs(10.0 - x) - 1.5);
    if (t > 0.49) continue;  // the corner touches the spike's slope before its top
    EXPECT_NEAR(bull.drop(x, 10.0).tip_mm, 6.0 - 0.5 + std::sqrt(0.25 - t * t), 1e-12) << x;
  }
  // The spike's slope 10 : 1 begins half a cell further out.
  EXPECT_NEAR(flat.drop(7.75, 10.0).tip_mm, 6.0 - 10.0 * 0.25, 1e-12);
  EXPECT_EQ(flat.drop(7.4, 10.0).tip_mm, 1.0);
}

TEST(DropCutter, RollsOverASpikeOnACircle) {
  ModelField ground = flat_field(41, 41, 0.5, 0.0F);
  ground.z_mm(20, 20) = 50.0F;  // far steeper than any contact on its top
  DropCutter cutter(ground, Cutter::ball(3.0));
  for (double r = 0.0; r < 2.9; r += 0.07) {
    const double x = 10.0 + 0.6 * r, y = 10.0 - 0.8 * r;
    EXPECT_NEAR(cutter.drop(x, y).tip_mm, 50.0 + std::sqrt(9.0 - r * r) - 3.0, 1e-9) << r;
  }
}

TEST(DropCutter, RollsOverARidgeThatRises) {
  // Ridge along x at y = 10 with slope m: tip = z + sqrt((R^2 - h^2)(1 + m^2)) - R.
  const double m = 0.5;
  ModelField ridge = flat_field(41, 41, 0.5, -100.0F);
  for (std::ptrdiff_t c = 0; c < 41; ++c) ridge.z_mm(20, c) = static_cast<float>(m * ridge.x_mm(c));
  DropCutter cutter(ridge, Cutter::ball(3.0));
  for (double h = -2.8; h < 2.9; h += 0.13)
    EXPECT_NEAR(cutter.drop(9.77, 10.0 + h).tip_mm,
                m * 9.77 + std::sqrt((9.0 - h * h) * (1.0 + m * m)) - 3.0, 1e-9)
        << h;
}

TEST(DropCutter, HangsOverTheEdgeOfTheOutline) {
  DropCutter cutter(flat_field(21, 21, 0.5, 2.0F), Cutter::ball(3.0));
  EXPECT_NEAR(cutter.drop(-1.0, 5.0).tip_mm, 2.0 + std::sqrt(8.0) - 3.0, 1e-12);
  EXPECT_NEAR(cutter.drop(11.2, 11.6).tip_mm, 2.0 + std::sqrt(9.0 - 1.44 - 2.56) - 3.0, 1e-12);
  for (const double far : {-3.1, 13.1, -300.0, 1e300, double{NAN}})
    EXPECT_EQ(cutter.drop(far, 5.0).tip_mm, -INFINITY) << far;
}

TEST(Scallop, IsTheShortSideOfATriangle) {
  EXPECT_DOUBLE_EQ(scallop_mm({2.5}, 3.0), 0.5);
  EXPECT_EQ(scallop_mm({2.5}, 0.0), 0.0);
  EXPECT_DOUBLE_EQ(scallop_mm({2.5}, 5.0), 2.5);
}

// Tables are shared by positions up to 0.00006 mm apart; at the rim of the ball that is worth
// 0.02 mm of height, more than the two spikes differ in what they ask for.
TEST(DropCutter, SeesASpikeThatOnlyJustCameIntoReach) {
  ModelField ground = flat_field(41, 41, 0.5, 0.0F);
  ground.z_mm(20, 20) = 500.0F;     // at (10, 10): the last 0.00005 mm of the radius
  ground.z_mm(20, 14) = 497.0078F;  // at (7, 10): under the tip
  ground.z_mm(27, 14) = 600.0F;     // out of reach, but its cell is not: looked at first
  DropCutter cutter(ground, Cutter::ball(3.0));
  const double x = 7.00005, r = 10.0 - x;
  EXPECT_NEAR(cutter.drop(x, 10.0).tip_mm, 500.0 + std::sqrt(9.0 - r * r) - 3.0, 1e-9);
}

// A bound for the cell under the ball that is too low by d^2 / (8 R) = 0.01 mm would lose it to a
// spike elsewhere that asks for 0.0001 mm less.
TEST(DropCutter, FlatGroundBeatsASpikeThatIsAlmostHighEnough) {
  for (const double x : {10.25, 10.27}) {  // with tables of its own, and without
    const double r2 = (12.5 - x) * (12.5 - x) + 0.0625;
    ModelField ground = flat_field(41, 41, 0.5, 0.0F);
    ground.z_mm(20, 25) = static_cast<float>(3.0 - std::sqrt(9.0 - r2) - 1e-4);
    DropCutter cutter(ground, Cutter::ball(3.0));
    EXPECT_NEAR(cutter.drop(x, 10.25).tip_mm, 0.0, 1e-12);
    ground.z_mm(20, 25) += 2e-4F;
    EXPECT_NEAR(DropCutter(ground, Cutter::ball(3.0)).drop(x, 10.25).tip_mm, 1e-4, 1e-6);
  }
}

// ---- against brute force -----------------------------------------------------------------

enum class End { ball, bull, flat };

class DropCutterOnTerrain
    : public testing::TestWithParam<std::tuple<testing_support::Ground, int, End>> {
 protected:
  const testing_support::Ground kind = std::get<0>(GetParam());
  const std::uint64_t seed = static_cast<std::uint64_t>(std::get<1>(GetParam()));
  // Ratios of radius to spacing from far below one to twelve.
  const double spacing = std::vector{0.5, 0.3, 1.0, 2.0}[seed % 4];
  const double radius = std::vector{3.0, 3.0, 1.5, 0.8, 2.2}[seed % 5];
  const ModelField ground = testing_support::ground(kind, seed, 26, spacing);
  const Cutter tool = std::get<2>(GetParam()) == End::ball ? Cutter::ball(radius)
                      : std::get<2>(GetParam()) == End::flat
                          ? Cutter::flat(radius)
                          : Cutter::bull(radius, radius* std::vector{0.1, 0.4, 0.9}[seed % 3]);
  /// Positions on nodes, on the table lattice, rounded near it, and anywhere.
  [[nodiscard]] double somewhere(std::uint64_t i) const {
    const double width = spacing * 25.0;
    const double t = random_uniform(seed + 99, i) * (width + 2.0) - 1.0;
    switch (i % 4) {
      case 0:
        return std::round(t / spacing) * spacing;
      case 1:
        return std::round(t / spacing * 16.0) * spacing / 16.0;
      case 2:
        return std::round(t * 10000.0) / 10000.0;
      default:
        return t;
    }
  }
};

TEST_P(DropCutterOnTerrain, EqualsBruteForceOverAllTriangles) {
  DropCutter cutter(ground, tool);
  const Slow slow(tool);
  // At the very rim the tip jumps (flat) or falls steeply (corner): there 1e-12 mm of the radius
  // decides, and both sides of it are right.
  Cutter less = tool, more = tool;
  (less.radius_mm -= 1e-12, more.radius_mm += 1e-12);
  if (tool.is_ball()) (less.corner_radius_mm -= 1e-12, more.corner_radius_mm += 1e-12);
  double worst = 0.0;
  int at_rim = 0;
  for (std::uint64_t i = 0; i < (tool.is_ball() ? 160U : 60U); ++i) {
    const double x = ground.x0.value() + somewhere(2 * i);
    const double y = ground.y0.value() + somewhere(2 * i + 1 + (i / 4) % 4);
    const double fast = cutter.drop(x, y).tip_mm;
    const double truth = brute_force(ground, x, y, slow);
    if (std::isinf(truth) && std::isinf(fast)) continue;
    if (!(std::abs(fast - truth) <= 1e-9)) {
      ++at_rim;
      ASSERT_GE(fast, brute_force(ground, x, y, Slow(less)) - 1e-9) << "at " << x << ", " << y;
      ASSERT_LE(fast, brute_force(ground, x, y, Slow(more)) + 1e-9) << "at " << x << ", " << y;
    } else {
      worst = std::max(worst, std::abs(fast - truth));
    }
  }
  EXPECT_LE(at_rim, tool.is_ball() ? 0 : 40);
  RecordProperty("worst_fm", static_cast<int>(worst * 1e12));
  RecordProperty("at_rim", at_rim);
}

TEST_P(DropCutterOnTerrain, ContactLiesOnTheSurfaceAndOnTheCutter) {
  DropCutter cutter(ground, tool);
  const Slow slow(tool);
  for (std::uint64_t i = 0; i < 200; ++i) {
    const double span = spacing * 25.0;
    const double x = ground.x0.value() + span * random_uniform(seed, i);
    const double y = ground.y0.value() + span * random_uniform(seed, i + 1000);
    const CutterContact c = cutter.drop(x, y);
    const double r = std::hypot(c.dx_mm, c.dy_mm);
    ASSERT_LE(r, radius * (1.0 + 1e-15));
    const double h =
        heightmap::height_at(ground, std::clamp(x + c.dx_mm, ground.x0.value(), ground.x_mm(25)),
                             std::clamp(y + c.dy_mm, ground.y0.value(), ground.y_mm(25)));
    // A wall turns the rounding of its place (1e-15) into up to 1e-11 of height.
    ASSERT_NEAR(h, c.tip_mm + slow.rise(std::min(r, radius)), 1e-9) << "at " << x << ", " << y;
  }
}

TEST_P(DropCutterOnTerrain, NoContactIsShallowerThanTheTilesSay) {
  if (!tool.is_ball()) return;  // a statement about balls
  DropCutter cutter(ground, Cutter::ball(radius));
  const SteepnessTiles tiles(ground, {radius});
  for (std::uint64_t i = 0; i < 60; ++i) {
    const double span = spacing * 25.0, length = 0.3 * random_uniform(seed, 7 * i + 3);
    const double x = ground.x0.value() + (span - length) * random_uniform(seed, 7 * i);
    const double y = ground.y0.value() + span * random_uniform(seed, 7 * i + 1);
    double lowest = INFINITY;
    std::vector<CutterContact> contacts;
    for (int k = 0; k <= 40; ++k) {
      contacts.push_back(cutter.drop(x + length * k / 40.0, y));
      lowest = std::min(lowest, contacts.back().tip_mm);
    }
    const ContactBound bound = tiles.bound(x, x + length, y, y, lowest - 1e-9);
    for (const CutterContact& c : contacts) {
      const double w = std::sqrt(radius * radius - c.dx_mm * c.dx_mm - c.dy_mm * c.dy_mm);
      ASSERT_GE(w, bound.least_depth_mm - 1e-6) << "at " << x << ", " << y;
      ASSERT_GE(bound.highest_mm, c.tip_mm - 1e-9);
    }
  }
}

// Too many cells for windows: the same by tiles.
TEST_P(DropCutterOnTerrain, WideCuttersEqualBruteForceToo) {
  Cutter wide = tool;
  const double R = 24.3 * spacing;
  wide.corner_radius_mm *= R / wide.radius_mm;
  wide.radius_mm = R;
  if (tool.is_ball()) wide.corner_radius_mm = R;
  const ModelField large = testing_support::ground(kind, seed, 40, spacing);
  DropCutter cutter(large, wide);
  const Slow slow(wide);
  for (std::uint64_t i = 0; i < 6; ++i) {
    const double x = large.x0.value() + somewhere(2 * i) * 2.0;
    const double y = large.y0.value() + somewhere(2 * i + 1 + (i / 4) % 4);
    EXPECT_NEAR(cutter.drop(x, y).tip_mm, brute_force(large, x, y, slow), 1e-9)
        << "at " << x << ", " << y;
  }
}

// ---- holder ------------------------------------------------------------------------------

Cutter with_holder() {
  Cutter cutter = Cutter::ball(1.0);
  cutter.holder = {{10.0, 10.0, 2.0, 2.0}, {20.0, 6.0, 4.0, 7.0}, {26.0, 30.0, 9.0, 5.0}};
  return cutter;
}

TEST(DropHolder, IsNowhereWithoutAHolder) {
  DropCutter cutter(flat_field(21, 21, 0.5, 2.0F), Cutter::ball(1.0));
  EXPECT_EQ(cutter.drop_holder(5.0, 5.0).tip_mm, -INFINITY);
}

TEST(DropHolder, TouchesWithItsLowestPartOnFlatGround) {
  DropCutter cutter(flat_field(81, 81, 0.5, 2.0F), with_holder());
  EXPECT_EQ(cutter.drop_holder(20.0, 20.0).tip_mm, 2.0 - 10.0);
  // Beside the outline by 2.5 mm: the shank passes, the disc of the holder does not.
  EXPECT_EQ(cutter.drop_holder(-2.5, 20.0).tip_mm, 2.0 - 20.0);
  // By 5.5 mm: the cone, halfway out.
  EXPECT_NEAR(cutter.drop_holder(-5.5, 20.0).tip_mm, 2.0 - 23.0, 1e-12);
  EXPECT_EQ(cutter.drop_holder(-8.0, 20.0).tip_mm, 2.0 - 26.0);
  EXPECT_EQ(cutter.drop_holder(-9.1, 20.0).tip_mm, -INFINITY);
}

TEST(DropHolder, ASteepPlaneMeetsTheRimAGentleOneTheDisc) {
  for (const double g : {0.5, 1.75, 3.0}) {
    ModelField plane = flat_field(81, 81, 0.5, 0.0F);
    for (std::ptrdiff_t r = 0; r < 81; ++r)
      for (std::ptrdiff_t c = 0; c < 81; ++c)
        plane.z_mm(r, c) = static_cast<float>(g * plane.x_mm(c));
    Cutter tool = Cutter::ball(1.0);
    tool.holder = {{20.0, 6.0, 4.0, 7.0}};  // a cone of slope 2
    DropCutter cutter(plane, tool);
    const double above = g < 2.0 ? g * 4.0 : g * 7.0 - 6.0;
    EXPECT_NEAR(cutter.drop_holder(20.0, 20.3).tip_mm, g * 20.0 + above - 20.0, 1e-10);
  }
}

TEST(DropHolder, EqualsBruteForce) {
  const Cutter tool = with_holder();
  for (const testing_support::Ground kind : testing_support::kGrounds)
    for (std::uint64_t seed = 1; seed <= 2; ++seed) {
      ModelField ground = testing_support::ground(kind, seed, 45, 0.5);
      if (kind == testing_support::Ground::rolling)  // slopes on both sides of the cone's
        for (float& z : ground.z_mm.cells()) z *= 8.0F;
      DropCutter cutter(ground, tool);
      for (std::uint64_t i = 0; i < 25; ++i) {
        const double x = ground.x0.value() - 6.0 + 34.0 * random_uniform(seed, 2 * i);
        const double y = ground.y0.value() - 6.0 + 34.0 * random_uniform(seed, 2 * i + 1);
        double slow = -INFINITY;
        for (const HolderPart& part : tool.holder)
          slow = std::max(slow, over_all_triangles(ground, [&](Vec3 a, Vec3 b, Vec3 c) {
                            return slow_part(part, a, b, c, x, y);
                          }));
        const double fast = cutter.drop_holder(x, y).tip_mm;
        if (std::isinf(slow) && std::isinf(fast)) continue;
        ASSERT_NEAR(fast, slow, 1e-9) << testing_support::name(kind) << " " << x << ", " << y;
      }
    }
}

TEST_P(DropCutterOnTerrain, GrowsAndMovesWithTheSurface) {
  ModelField higher = ground, shifted = ground;
  for (std::ptrdiff_t r = 0; r < 26; ++r)
    for (std::ptrdiff_t c = 0; c < 26; ++c) {
      if (random_uniform(seed, static_cast<std::uint64_t>(r * 26 + c)) < 0.1)
        higher.z_mm(r, c) += 0.5F;
      shifted.z_mm(r, c) += 64.0F;
    }
  shifted.x0 = Millimetres{ground.x0.value() + 12.0 * spacing};
  DropCutter cutter(ground, tool), above(higher, tool), moved(shifted, tool);
  for (std::uint64_t i = 0; i < 200; ++i) {
    const double x = ground.x0.value() + spacing * 25.0 * random_uniform(seed, 2 * i);
    const double y = ground.y0.value() + spacing * 25.0 * random_uniform(seed, 2 * i + 1);
    const double tip = cutter.drop(x, y).tip_mm;
    EXPECT_GE(above.drop(x, y).tip_mm, tip - 1e-9);
    // The shifted heights are rounded to float once more: 2^-17 mm, on a slope up to 200.
    EXPECT_NEAR(moved.drop(x + 12.0 * spacing, y).tip_mm, tip + 64.0, 1e-4);
  }
}

TEST_P(DropCutterOnTerrain, DoesNotDependOnWhatWasAskedBefore) {
  DropCutter used(ground, tool);
  for (std::uint64_t i = 0; i < 100; ++i) (void)used.drop(somewhere(i), somewhere(i + 7));
  for (std::uint64_t i = 0; i < 5; ++i) {
    DropCutter fresh(ground, tool);
    const double x = somewhere(5 * i), y = somewhere(3 * i + 1);
    EXPECT_EQ(std::bit_cast<std::uint64_t>(used.drop(x, y).tip_mm),
              std::bit_cast<std::uint64_t>(fresh.drop(x, y).tip_mm));
  }
}

std::string case_name(const testing::TestParamInfo<DropCutterOnTerrain::ParamType>& param) {
  constexpr std::array kEnds{"_ball", "_bull", "_flat"};
  return std::string(testing_support::name(std::get<0>(param.param))) + "_seed" +
         std::to_string(std::get<1>(param.param)) +
         kEnds[static_cast<std::size_t>(std::get<2>(param.param))];
}
INSTANTIATE_TEST_SUITE_P(Seeds, DropCutterOnTerrain,
                         testing::Combine(testing::ValuesIn(testing_support::kGrounds),
                                          testing::Range(1, 6),
                                          testing::Values(End::ball, End::bull, End::flat)),
                         case_name);

TEST(BruteForce, AgreesWithSearchOnOneTriangle) {
  for (std::uint64_t i = 0; i < 300; ++i) {
    const auto u = [&](std::uint64_t k) { return random_uniform(4711, 16 * i + k); };
    const double steep = std::vector{0.2, 1.0, 10.0}[i % 3];
    const Vec3 a{0, 0, steep * u(0)}, b{1, 0, steep * u(1)}, c{1, 1, steep * u(2)};
    const double x = 6.0 * u(3) - 2.5, y = 6.0 * u(4) - 2.5, R = 1.0 + u(5);
    const Slow slow(Cutter::bull(R, R * std::vector{1.0, 0.3, 0.0, 0.8}[i % 4]));
    const double formula = slow(a, b, c, x, y), search = tip_by_search(slow, a, b, c, x, y);
    if (std::isinf(formula) && std::isinf(search)) continue;
    if (slow.rc > 0.0) {
      // Golden section stops 1e-15 from the peak's place, 1e-8 where the rim cuts it off.
      EXPECT_NEAR(formula, search, 1e-6) << i;
    } else {  // the search stops anywhere on the rim, but a corner of 1e-7 is no lower
      EXPECT_LE(formula, Slow(Cutter::bull(R, 1e-7))(a, b, c, x, y) + 1e-7) << i;
    }
    EXPECT_GE(formula, search - 1e-12) << i;
  }
}

}  // namespace
}  // namespace maquette::cnc
