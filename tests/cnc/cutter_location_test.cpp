// SPDX-License-Identifier: GPL-3.0-or-later

// What is claimed in cnc/cutter_location.hpp, tool.hpp and steepness.hpp, and how each
// claim is attacked:
//
//   closed forms ................. plane, tilted plane, spike, ridge, outline
//   exact to 1e-9 mm ............. brute force over all triangles (features in 3-D vectors) on
//                                  rough ground, spikes, cliffs, knife edges, narrow pits
//   the brute force is right ..... nested search for the maximum, no formula in common
//   grows with the surface ....... raising nodes never lowers the tip
//   moves with the surface ....... shift in z, shift by whole cells
//   history does not matter ...... same bits from a fresh cutter, in any order
//   contact point is a contact ... it lies on the surface and on the ball
//   least depth of contact ....... no contact found by drop() is shallower
//
// Heights come from a seed that is part of the test's name.

#include "cnc/cutter_location.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "cnc/steepness.hpp"
#include "core/random.hpp"
#include "core/vec.hpp"
#include "support/terrain.hpp"

namespace maquette::cnc {
namespace {

using heightmap::ModelField;
using testing_support::flat_field;

// ---- slow oracle: every triangle, contact by 3-D vectors ---------------------------------

/// Centre height of the ball on one triangle; -inf if out of reach.
double on_vertex(Vec3 a, double x, double y, double R) {
  const double r = std::hypot(a.x - x, a.y - y);
  return r <= R ? a.z + std::sqrt((R - r) * (R + r)) : -INFINITY;
}
double on_edge(Vec3 a, Vec3 b, double x, double y, double R) {
  // The ball of radius R touches the line where a cylinder around it meets the vertical axis.
  const Vec3 e = normalized(b - a);
  const Vec3 p{x, y, 0.0}, up{0.0, 0.0, 1.0};
  const Vec3 f = cross(e, up), g = cross(e, p - a);  // |g + t f| = R
  const double A = dot(f, f), B = dot(f, g), C = dot(g, g) - R * R;
  const double disc = B * B - A * C;
  if (A == 0.0 || disc < 0.0) return -INFINITY;
  const double t = (-B + std::sqrt(disc)) / A;
  const double s = dot(Vec3{x, y, t} - a, e);
  return s >= 0.0 && s <= norm(b - a) ? t : -INFINITY;
}
double on_facet(Vec3 a, Vec3 b, Vec3 c, double x, double y, double R) {
  Vec3 n = normalized(cross(b - a, c - a));
  if (n.z < 0.0) n = -n;
  const double t = a.z + (R - n.x * (x - a.x) - n.y * (y - a.y)) / n.z;
  const Vec3 q = Vec3{x, y, t} - R * n;
  const auto side = [&](Vec3 u, Vec3 v) {
    return (v.x - u.x) * (q.y - u.y) - (v.y - u.y) * (q.x - u.x);
  };
  const double s1 = side(a, b), s2 = side(b, c), s3 = side(c, a);
  const bool inside = (s1 >= 0 && s2 >= 0 && s3 >= 0) || (s1 <= 0 && s2 <= 0 && s3 <= 0);
  return inside ? t : -INFINITY;
}
double on_triangle(Vec3 a, Vec3 b, Vec3 c, double x, double y, double R) {
  return std::max({on_vertex(a, x, y, R), on_vertex(b, x, y, R), on_vertex(c, x, y, R),
                   on_edge(a, b, x, y, R), on_edge(b, c, x, y, R), on_edge(c, a, x, y, R),
                   on_facet(a, b, c, x, y, R)});
}
/// The same by search alone: the height under the ball is concave on the triangle.
double on_triangle_by_search(Vec3 a, Vec3 b, Vec3 c, double x, double y, double R) {
  const auto value = [&](double u, double v) {
    const Vec3 q = a + u * (b - a) + (u * v) * (c - b);
    const double r2 = (q.x - x) * (q.x - x) + (q.y - y) * (q.y - y);
    // Outside the disc: a steep cone that leads the search back to it.
    return r2 <= R * R ? q.z + std::sqrt(R * R - r2) : -1e6 * std::sqrt(r2);
  };
  const auto search = [](auto&& f) {
    constexpr double kGolden = 0.61803398874989485;
    double low = 0.0, high = 1.0;
    for (int i = 0; i < 75; ++i) {
      const double p = high - kGolden * (high - low), q = low + kGolden * (high - low);
      (f(p) < f(q) ? low : high) = f(p) < f(q) ? p : q;
    }
    return std::max({f(0.0), f(1.0), f(0.5 * (low + high))});
  };
  const double best =
      search([&](double u) { return search([&](double v) { return value(u, v); }); });
  return best < -1e3 ? -INFINITY : best;
}

template <class OnTriangle>
double brute_force(const ModelField& f, double x, double y, double R, OnTriangle&& on) {
  double best = -INFINITY;
  for (std::ptrdiff_t r = 0; r + 1 < f.z_mm.rows(); ++r)
    for (std::ptrdiff_t c = 0; c + 1 < f.z_mm.cols(); ++c) {
      const auto p = [&](std::ptrdiff_t i, std::ptrdiff_t j) {
        return Vec3{f.x_mm(c + j), f.y_mm(r + i), static_cast<double>(f.z_mm(r + i, c + j))};
      };
      best = std::max(
          {best, on(p(0, 0), p(0, 1), p(1, 1), x, y, R), on(p(0, 0), p(1, 1), p(1, 0), x, y, R)});
    }
  return best - R;
}

// ---- closed forms ------------------------------------------------------------------------

TEST(DropCutter, StandsOnFlatGround) {
  DropCutter cutter(flat_field(41, 33, 0.5, 7.25F), {3.0});
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
      DropCutter cutter(plane, {3.0});
      const double raise = 3.0 * (std::sqrt(1.0 + gx * gx + gy * gy) - 1.0);
      for (const double x : {9.0, 10.123, 10.9})
        EXPECT_NEAR(cutter.drop(x, 10.3).tip_mm, gx * x + gy * 10.3 + raise, 1e-10);
    }
}

TEST(DropCutter, RollsOverASpikeOnACircle) {
  ModelField ground = flat_field(41, 41, 0.5, 0.0F);
  ground.z_mm(20, 20) = 50.0F;  // far steeper than any contact on its top
  DropCutter cutter(ground, {3.0});
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
  DropCutter cutter(ridge, {3.0});
  for (double h = -2.8; h < 2.9; h += 0.13)
    EXPECT_NEAR(cutter.drop(9.77, 10.0 + h).tip_mm,
                m * 9.77 + std::sqrt((9.0 - h * h) * (1.0 + m * m)) - 3.0, 1e-9)
        << h;
}

TEST(DropCutter, HangsOverTheEdgeOfTheOutline) {
  DropCutter cutter(flat_field(21, 21, 0.5, 2.0F), {3.0});
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
  DropCutter cutter(ground, {3.0});
  const double x = 7.00005, r = 10.0 - x;
  EXPECT_NEAR(cutter.drop(x, 10.0).tip_mm, 500.0 + std::sqrt(9.0 - r * r) - 3.0, 1e-9);
}

// ---- against brute force -----------------------------------------------------------------

class DropCutterOnTerrain
    : public testing::TestWithParam<std::tuple<testing_support::Ground, int>> {
 protected:
  const testing_support::Ground kind = std::get<0>(GetParam());
  const std::uint64_t seed = static_cast<std::uint64_t>(std::get<1>(GetParam()));
  // Ratios of radius to spacing from far below one to twelve.
  const double spacing = std::vector{0.5, 0.3, 1.0, 2.0}[seed % 4];
  const double radius = std::vector{3.0, 3.0, 1.5, 0.8, 2.2}[seed % 5];
  const ModelField ground = testing_support::ground(kind, seed, 26, spacing);
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
  DropCutter cutter(ground, {radius});
  double worst = 0.0;
  for (std::uint64_t i = 0; i < 400; ++i) {
    const double x = ground.x0.value() + somewhere(2 * i);
    const double y = ground.y0.value() + somewhere(2 * i + 1 + (i / 4) % 4);
    const double fast = cutter.drop(x, y).tip_mm;
    const double slow = brute_force(ground, x, y, radius, on_triangle);
    if (std::isinf(slow) && std::isinf(fast)) continue;
    worst = std::max(worst, std::abs(fast - slow));
    ASSERT_NEAR(fast, slow, 1e-9) << "at " << x << ", " << y;
  }
  RecordProperty("worst_fm", static_cast<int>(worst * 1e12));
}

TEST_P(DropCutterOnTerrain, ContactLiesOnTheSurfaceAndOnTheBall) {
  DropCutter cutter(ground, {radius});
  for (std::uint64_t i = 0; i < 200; ++i) {
    const double span = spacing * 25.0;
    const double x = ground.x0.value() + span * random_uniform(seed, i);
    const double y = ground.y0.value() + span * random_uniform(seed, i + 1000);
    const CutterContact c = cutter.drop(x, y);
    const double w = std::sqrt(radius * radius - c.dx_mm * c.dx_mm - c.dy_mm * c.dy_mm);
    const double h =
        heightmap::height_at(ground, std::clamp(x + c.dx_mm, ground.x0.value(), ground.x_mm(25)),
                             std::clamp(y + c.dy_mm, ground.y0.value(), ground.y_mm(25)));
    // A wall turns the rounding of its place (1e-15) into up to 1e-11 of height.
    ASSERT_NEAR(h, c.tip_mm + radius - w, 1e-9) << "at " << x << ", " << y;
  }
}

TEST_P(DropCutterOnTerrain, NoContactIsShallowerThanTheTilesSay) {
  DropCutter cutter(ground, {radius});
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

TEST_P(DropCutterOnTerrain, GrowsAndMovesWithTheSurface) {
  ModelField higher = ground, shifted = ground;
  for (std::ptrdiff_t r = 0; r < 26; ++r)
    for (std::ptrdiff_t c = 0; c < 26; ++c) {
      if (random_uniform(seed, static_cast<std::uint64_t>(r * 26 + c)) < 0.1)
        higher.z_mm(r, c) += 0.5F;
      shifted.z_mm(r, c) += 64.0F;
    }
  shifted.x0 = Millimetres{ground.x0.value() + 12.0 * spacing};
  DropCutter cutter(ground, {radius}), above(higher, {radius}), moved(shifted, {radius});
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
  DropCutter used(ground, {radius});
  for (std::uint64_t i = 0; i < 300; ++i) (void)used.drop(somewhere(i), somewhere(i + 7));
  for (std::uint64_t i = 0; i < 60; ++i) {
    DropCutter fresh(ground, {radius});
    const double x = somewhere(5 * i), y = somewhere(3 * i + 1);
    EXPECT_EQ(std::bit_cast<std::uint64_t>(used.drop(x, y).tip_mm),
              std::bit_cast<std::uint64_t>(fresh.drop(x, y).tip_mm));
  }
}

INSTANTIATE_TEST_SUITE_P(Seeds, DropCutterOnTerrain,
                         testing::Combine(testing::ValuesIn(testing_support::kGrounds),
                                          testing::Range(1, 6)),
                         [](const auto& param) {
                           return std::string(testing_support::name(std::get<0>(param.param))) +
                                  "_seed" + std::to_string(std::get<1>(param.param));
                         });

TEST(BruteForce, AgreesWithSearchOnOneTriangle) {
  for (std::uint64_t i = 0; i < 300; ++i) {
    const auto u = [&](std::uint64_t k) { return random_uniform(4711, 16 * i + k); };
    const double steep = std::vector{0.2, 1.0, 10.0}[i % 3];
    const Vec3 a{0, 0, steep * u(0)}, b{1, 0, steep * u(1)}, c{1, 1, steep * u(2)};
    const double x = 6.0 * u(3) - 2.5, y = 6.0 * u(4) - 2.5, R = 1.0 + u(5);
    const double formula = on_triangle(a, b, c, x, y, R);
    const double search = on_triangle_by_search(a, b, c, x, y, R);
    if (std::isinf(formula) && std::isinf(search)) continue;
    // Golden section stops 1e-15 from the peak's place, 1e-8 where the disc's rim cuts it off.
    EXPECT_NEAR(formula, search, 1e-6) << i;
    EXPECT_GE(formula, search - 1e-12) << i;
  }
}

}  // namespace
}  // namespace maquette::cnc
