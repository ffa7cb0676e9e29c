// SPDX-License-Identifier: GPL-3.0-or-later

// meshing/stones.hpp, plan and lay:
//   sizes fall, numbers 1, 2, ... ........... compared
//   inner share rounded up, distances from
//   the borders, no overlap ................. every pair and border, several seeds
//   origin above the site position; scale ... 1:2500 with exaggeration 2
//   horizontal plane, tilted plane .......... closed forms of height, normal, heading, depth
//   the plane is the least squares fit ...... its defining equations on random terrain
//   no rim vertex above the surface ......... every vertex of the lowest share; and one touches
//                                             when the stone had to be sunk further
//   the same stone at 1:1000 and 1:200 ...... position, orientation, shape
//   outside, over the border, on a void ..... left out
//   envelope exact at the nodes ............. slow oracle: vertical line against every triangle
//   same bits for any number of threads ..... compared for 1 and 4
//   a catalogue's shapes and sizes ......... counted; each diameter the nearest step
//   every error of the plan ................. reached
// stones.json and stones.csv: stone_files_test.cpp.

#include "meshing/stones.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <set>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <oneapi/tbb/global_control.h>

#include "core/random.hpp"
#include "support/matchers.hpp"
#include "support/mesh_properties.hpp"

namespace maquette::meshing {
namespace {

using heightmap::height_at;
using heightmap::ModelField;
using testing_support::FailsWith;
using testing_support::Succeeds;

/// A field from any function of x and y in millimetres.
template <class Height>
ModelField field(std::ptrdiff_t nodes, double spacing, Height&& height, double x0 = 0.0,
                 double y0 = 0.0) {
  ModelField f{.z_mm = Grid<float>(nodes, nodes),
               .spacing = Millimetres{spacing},
               .x0 = Millimetres{x0},
               .y0 = Millimetres{y0}};
  for (std::ptrdiff_t r = 0; r < nodes; ++r)
    for (std::ptrdiff_t c = 0; c < nodes; ++c)
      f.z_mm(r, c) = static_cast<float>(height(f.x_mm(c), f.y_mm(r)));
  return f;
}

/// Terrain of the site in metres: a few waves, slopes up to about 0.5.
double terrain_m(std::uint64_t seed, double east_m, double north_m) {
  double z = 0.0;
  for (std::uint64_t i = 0; i < 6; ++i) {
    const double length = 3.0 * std::pow(1.8, static_cast<double>(i));
    const double turn = 2.0 * std::numbers::pi * random_uniform(seed, 2 * i);
    const double phase = 2.0 * std::numbers::pi * random_uniform(seed, 2 * i + 1);
    z += 0.03 * length *
         std::sin(phase + 2.0 * std::numbers::pi / length *
                              (east_m * std::cos(turn) + north_m * std::sin(turn)));
  }
  return z;
}

SiteStone stone_at(double east_m, double north_m, double diameter_m, std::uint64_t seed = 3) {
  return {.number = 1,
          .shape = {.seed = seed, .subdivisions = 3},
          .diameter = Metres{diameter_m},
          .east_m = east_m,
          .north_m = north_m,
          .heading = degrees(40)};
}

// ---- plan ----------------------------------------------------------------------

class Plan : public ::testing::TestWithParam<std::uint64_t> {};
INSTANTIATE_TEST_SUITE_P(Seeds, Plan, ::testing::Values(1, 2, 3, 77, 20260101));

TEST_P(Plan, KeepsDistancesAndShares) {
  const SitePlanRequest request{.count = 25,
                                .inner_share = 0.5,
                                .half_width = Metres{100},
                                .inner_half_width = Metres{25},
                                .seed = GetParam()};
  const auto stones = plan_stones(request);
  ASSERT_THAT(stones, Succeeds());
  ASSERT_EQ(stones->size(), 25u);
  std::vector<double> reach_m;
  for (const SiteStone& s : *stones) {
    double r = 0.0;
    for (const Vec3& v : assets::make_rock(s.shape).vertices_mm) r = std::fmax(r, norm(v));
    reach_m.push_back(r * s.diameter.value());
  }
  int inner = 0;
  for (std::size_t i = 0; i < stones->size(); ++i) {
    const SiteStone& s = (*stones)[i];
    const double d = s.diameter.value();
    const double from_centre = std::fmax(std::abs(s.east_m), std::abs(s.north_m));
    EXPECT_EQ(s.number, static_cast<int>(i) + 1);
    EXPECT_GE(d, 2.0);
    EXPECT_LE(d, i == 0 ? 5.0 : (*stones)[i - 1].diameter.value());
    EXPECT_LE(from_centre, 100.0 - d);
    EXPECT_TRUE(from_centre <= 25.0 - d || from_centre >= 25.0 + d) << from_centre;
    if (from_centre < 25.0) ++inner;
    for (std::size_t j = 0; j < i; ++j) {
      const SiteStone& o = (*stones)[j];
      EXPECT_GT(std::hypot(s.east_m - o.east_m, s.north_m - o.north_m), reach_m[i] + reach_m[j]);
    }
  }
  EXPECT_EQ(inner, 13);  // 12.5 rounded up
}

TEST_P(Plan, IsAFunctionOfTheSeed) {
  SitePlanRequest request{.half_width = Metres{50}, .seed = GetParam()};
  const auto a = plan_stones(request), b = plan_stones(request);
  request.seed += 1;
  const auto c = plan_stones(request);
  ASSERT_TRUE(a && b && c);
  for (std::size_t i = 0; i < a->size(); ++i) {
    EXPECT_EQ((*a)[i].shape, (*b)[i].shape);
    EXPECT_EQ((*a)[i].east_m, (*b)[i].east_m);
    EXPECT_EQ((*a)[i].heading, (*b)[i].heading);
    EXPECT_NE((*a)[i].shape.seed, (*c)[i].shape.seed);
  }
}

TEST(PlanStones, RoundsTheShareUpButNotForRoundingErrors) {
  const auto inside = [](int count, double share) {
    const auto stones = plan_stones({.count = count,
                                     .inner_share = share,
                                     .half_width = Metres{200},
                                     .inner_half_width = Metres{60}});
    EXPECT_THAT(stones, Succeeds());
    return std::count_if(stones->begin(), stones->end(), [](const SiteStone& s) {
      return std::fmax(std::abs(s.east_m), std::abs(s.north_m)) < 60.0;
    });
  };
  EXPECT_EQ(inside(30, 0.1), 3);  // 0.1 * 30 > 3 in double
  EXPECT_EQ(inside(3, 0.5), 2);
  EXPECT_EQ(inside(5, 0.0), 0);
  EXPECT_EQ(inside(5, 1.0), 5);
  EXPECT_EQ(inside(0, 0.5), 0);
}

TEST(PlanStones, DrawsFromACatalogue) {
  SitePlanRequest request{.count = 400, .half_width = Metres{1500}, .inner_half_width = Metres{0}};
  request.k = 0.5;
  request.min_diameter = Metres{0.1};
  request.max_diameter = Metres{0.8};
  const auto free = plan_stones(request).value();
  request.shapes = 7;
  request.sizes = 4;
  const auto stones = plan_stones(request).value();
  ASSERT_EQ(stones.size(), free.size());
  std::set<std::uint64_t> shapes;
  std::set<double> sizes;
  for (std::size_t i = 0; i < stones.size(); ++i) {
    shapes.insert(stones[i].shape.seed);
    sizes.insert(stones[i].diameter.value());
    // Steps of a factor 2: the nearest by ratio is within its square root.
    EXPECT_LE(std::abs(std::log(stones[i].diameter.value() / free[i].diameter.value())),
              0.5 * std::log(2.0) + 1e-12);
  }
  EXPECT_EQ(shapes.size(), 7U);
  ASSERT_EQ(sizes.size(), 4U);
  for (const double step : {0.1, 0.2, 0.4, 0.8})
    EXPECT_NEAR(*sizes.lower_bound(step - 1e-9), step, 1e-9);
}

TEST(PlanStones, SaysWhenAStoneIsLargerThanItsSquare) {
  EXPECT_THAT(plan_stones({.half_width = Metres{2}}), FailsWith(kStoneLargerThanSite));
  EXPECT_THAT(plan_stones({.half_width = Metres{100}, .inner_half_width = Metres{2}}),
              FailsWith(kStoneLargerThanSite));
}

TEST(PlanStones, SaysHowManyFit) {
  const auto crowded = plan_stones({.count = 300, .half_width = Metres{20}});
  ASSERT_THAT(crowded, FailsWith(kStonesDoNotFit));
  EXPECT_THAT(crowded.error().message, ::testing::HasSubstr("of 300 stones fit"));
  // No room at all outside the inner square.
  const auto full =
      plan_stones({.count = 4, .half_width = Metres{20}, .inner_half_width = Metres{20}});
  EXPECT_THAT(full, FailsWith(kStonesDoNotFit));
}

// ---- lay: closed forms -----------------------------------------------------------

TEST(LayStones, OnAHorizontalPlane) {
  const ModelField flat = field(
      201, 0.25, [](double, double) { return 2.0; }, -5.0, 3.0);
  // 1:2500 would show a confusion of metres and millimetres, exaggeration one of axes.
  const ModelScale scale(2500.0, 2.0);
  const SiteStone stone = stone_at(130.0, 160.0, 20.0);
  const auto laid = lay_stones(std::vector{stone}, flat, scale, 80.0, 90.0, 0.25);
  ASSERT_EQ(laid.size(), 1u);
  const PlacedStone& p = laid[0];
  EXPECT_EQ(p.number, 1);
  EXPECT_EQ(p.shape, stone.shape);
  EXPECT_DOUBLE_EQ(p.scale_mm, 8.0);  // 20 m at 1:2500; heights only are exaggerated
  EXPECT_DOUBLE_EQ(p.model_from_stone.translation_mm.x, 20.0);  // (130 - 80) m
  EXPECT_DOUBLE_EQ(p.model_from_stone.translation_mm.y, 28.0);
  const Box3 box = assets::make_rock(stone.shape).bounds();
  const double height = 8.0 * (box.max.z - box.min.z);
  EXPECT_NEAR(p.embedded_depth_mm, 0.25 * height, 1e-12);  // rounding only
  EXPECT_NEAR(stone_mesh(p).bounds().min.z, 2.0 - 0.25 * height, 1e-12);
  const Vec3 along = p.model_from_stone.direction({1, 0, 0});
  EXPECT_NEAR(std::atan2(along.y, along.x), degrees(40).value(), 1e-14);
  EXPECT_NEAR(along.z, 0.0, 1e-15);
}

TEST(LayStones, OnATiltedPlane) {
  const double sx = 0.5, sy = -0.25;  // dyadic: float heights are exact
  const ModelField f = field(257, 0.125, [&](double x, double y) { return 8 + sx * x + sy * y; });
  const auto laid =
      lay_stones(std::vector{stone_at(16.0, 16.0, 6.0)}, f, ModelScale(1000), 0, 0, 0.2);
  ASSERT_EQ(laid.size(), 1u);
  const RigidTransform& t = laid[0].model_from_stone;
  const Vec3 normal = normalized(Vec3{-sx, -sy, 1.0});
  EXPECT_LT(norm(t.direction({0, 0, 1}) - normal), 1e-12);
  EXPECT_EQ(t.translation_mm.x, 16.0);
  EXPECT_EQ(t.translation_mm.y, 16.0);
  // The base lies under the plane by the share of the height, measured along the normal.
  const TriMesh rock = assets::make_rock(laid[0].shape);
  const TriMesh mesh = stone_mesh(laid[0]);
  double low = INFINITY, high = -INFINITY;
  for (const Vec3& v : mesh.vertices_mm) {
    const double above = dot(v - Vec3{0, 0, 8}, normal);
    low = std::fmin(low, above);
    high = std::fmax(high, above);
  }
  const double height = 6.0 * (rock.bounds().max.z - rock.bounds().min.z);
  EXPECT_NEAR(high - low, height, 1e-12);
  EXPECT_NEAR(low, -0.2 * height, 1e-9);
  // The shortest way from the vertical: the axis of the tilt is horizontal, so the
  // long axis keeps its heading up to the tilt.
  const Quaternion heading = rotation_about({0, 0, 1}, degrees(40).value());
  EXPECT_NEAR((t.rotation * heading.conjugate()).z, 0.0, 1e-14);
}

// ---- lay: laws on random terrain ---------------------------------------------------

class Lay : public ::testing::TestWithParam<std::uint64_t> {
 protected:
  [[nodiscard]] ModelField terrain(double denominator, double half_m, double spacing_mm) const {
    const double m = denominator / 1000.0;  // metres of site per millimetre of model
    const auto nodes = static_cast<std::ptrdiff_t>(std::lround(2.0 * half_m / m / spacing_mm)) + 1;
    return field(nodes, spacing_mm, [&](double x, double y) {
      return 30.0 + terrain_m(GetParam(), m * x - half_m, m * y - half_m) / m;
    });
  }
};
INSTANTIATE_TEST_SUITE_P(Seeds, Lay, ::testing::Range<std::uint64_t>(1, 9));

TEST_P(Lay, FitsThePlaneByLeastSquares) {
  const ModelField f = terrain(1000, 20, 0.25);
  const SiteStone stone = stone_at(1.3, -2.7, 5.0, GetParam());
  const auto laid = lay_stones(std::vector{stone}, f, ModelScale(1000), -20, -20);
  ASSERT_EQ(laid.size(), 1u);
  const Vec3 n = laid[0].model_from_stone.direction({0, 0, 1});
  const Vec3 at = laid[0].model_from_stone.translation_mm;
  double radius = 0.0;
  for (const Vec3& v : assets::make_rock(stone.shape).vertices_mm)
    radius = std::fmax(radius, 5.0 * std::hypot(v.x, v.y));
  // Residuals of the nodes against a plane of this normal, free in height.
  std::vector<Vec3> residual;
  for (std::ptrdiff_t r = 0; r < f.z_mm.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < f.z_mm.cols(); ++c) {
      const double x = f.x_mm(c) - at.x, y = f.y_mm(r) - at.y;
      if (std::hypot(x, y) <= radius)
        residual.push_back({x, y, double{f.z_mm(r, c)} + (n.x * x + n.y * y) / n.z});
    }
  Vec3 mean;
  for (const Vec3& p : residual) mean += (1.0 / static_cast<double>(residual.size())) * p;
  double along_x = 0.0, along_y = 0.0, size = 0.0;
  for (const Vec3& p : residual) {
    along_x += (p.x - mean.x) * (p.z - mean.z);
    along_y += (p.y - mean.y) * (p.z - mean.z);
    size += (p.x - mean.x) * (p.x - mean.x);
  }
  ASSERT_GT(residual.size(), 200u);
  EXPECT_NEAR(along_x / size, 0.0, 1e-10);  // what would still have to be added to the slope
  EXPECT_NEAR(along_y / size, 0.0, 1e-10);
}

TEST_P(Lay, LeavesNoGapUnderTheRim) {
  for (const double spacing : {0.1, 0.5, 2.0})
    for (const double share : {0.0, 0.1, 0.25, 0.6}) {
      SCOPED_TRACE(testing::Message() << "spacing " << spacing << ", share " << share);
      const ModelField f = terrain(1000, 20, spacing);
      const SiteStone stone = stone_at(3.1, 2.2, 5.0, GetParam());
      const auto laid = lay_stones(std::vector{stone}, f, ModelScale(1000), -20, -20, share);
      ASSERT_EQ(laid.size(), 1u);
      const TriMesh rock = assets::make_rock(stone.shape), mesh = stone_mesh(laid[0]);
      const Box3 box = rock.bounds();
      double highest_rim = -INFINITY, deepest = -INFINITY, lowest = INFINITY;
      for (std::size_t i = 0; i < mesh.vertices_mm.size(); ++i) {
        const Vec3 p = mesh.vertices_mm[i];
        const double above = p.z - height_at(f, p.x, p.y);
        if (rock.vertices_mm[i].z <= box.min.z + share * (box.max.z - box.min.z))
          highest_rim = std::fmax(highest_rim, above);
        if (p.z < lowest) lowest = p.z, deepest = -above;
      }
      EXPECT_LT(highest_rim, 1e-9);  // rounding of coordinates of 50 mm
      EXPECT_NEAR(laid[0].embedded_depth_mm, deepest, 1e-9);
      // On this terrain the plane never covers all rim vertices: the stone was sunk
      // further, and no more than needed.
      if (share <= 0.25) {
        EXPECT_GT(highest_rim, -1.0);
      }
      if (spacing < 1.0 && share > 0.0) {
        EXPECT_NEAR(highest_rim, 0.0, 1e-9);
      }
    }
}

TEST_P(Lay, TheSameStoneAtTwoScales) {
  const ModelField small = terrain(1000, 50, 0.125), large = terrain(200, 22, 0.25);
  std::vector<SiteStone> stones;
  for (int i = 0; i < 5; ++i) {
    stones.push_back(stone_at(-16.0 + 8.0 * i, 11.0 - 5.0 * i, 3.0 + 0.4 * i,
                              GetParam() + static_cast<std::uint64_t>(i)));
    stones.back().number = i + 1;
  }
  stones.push_back(stone_at(40.0, 0.0, 3.0));  // beyond the large-scale section
  const auto far = lay_stones(stones, small, ModelScale(1000), -50, -50);
  const auto near = lay_stones(stones, large, ModelScale(200), -22, -22);
  ASSERT_EQ(far.size(), 6u);
  ASSERT_EQ(near.size(), 5u);
  for (std::size_t i = 0; i < near.size(); ++i) {
    EXPECT_EQ(near[i].number, far[i].number);
    EXPECT_EQ(near[i].shape, far[i].shape);
    EXPECT_NEAR(near[i].scale_mm, 5.0 * far[i].scale_mm, 1e-12);
    const Vec3 a = far[i].model_from_stone.translation_mm;
    const Vec3 b = near[i].model_from_stone.translation_mm;
    EXPECT_NEAR(0.2 * b.x - 22.0, a.x - 50.0, 1e-12);
    EXPECT_NEAR(0.2 * b.y - 22.0, a.y - 50.0, 1e-12);
    // In metres of the site. The terrain's shortest wave (3 m, 0.09 m high) is sampled
    // every 0.125 m and 0.05 m: linear interpolation errs by h^2/8 (2 pi / L)^2 A = 0.8 mm,
    // and the footprint's rim moves by a node: 0.125 m times the residual slope of 0.2.
    EXPECT_NEAR(0.2 * (b.z - 30.0), a.z - 30.0, 0.025);
    EXPECT_LT(norm(near[i].model_from_stone.direction({0, 0, 1}) -
                   far[i].model_from_stone.direction({0, 0, 1})),
              0.02);
  }
}

TEST_P(Lay, GivesTheSameBitsForAnyNumberOfThreads) {
  const ModelField f = terrain(1000, 50, 0.25);
  const auto plan = plan_stones({.half_width = Metres{50}, .seed = GetParam()});
  ASSERT_THAT(plan, Succeeds());
  const auto with_threads = [&](std::size_t n) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, n);
    return lay_stones(*plan, f, ModelScale(1000), -50, -50);
  };
  const auto one = with_threads(1), four = with_threads(4);
  EXPECT_EQ(one.size(), plan->size());
  EXPECT_EQ(one, four);
  EXPECT_EQ(with_stones(f, one).z_mm, with_stones(f, four).z_mm);
}

TEST(LayStones, LeavesOutWhatDoesNotLieOnTheSurface) {
  ModelField f = field(101, 0.5, [](double, double) { return 1.0; });
  const auto laid = [&](double x, double y) {
    return lay_stones(std::vector{stone_at(x, y, 4.0)}, f, ModelScale(1000), 0, 0).size();
  };
  EXPECT_EQ(laid(25, 25), 1u);
  EXPECT_EQ(laid(60, 25), 0u);  // outside
  EXPECT_EQ(laid(-5, 25), 0u);
  EXPECT_EQ(laid(0.5, 25), 0u);  // over the border
  EXPECT_EQ(laid(25, 49.5), 0u);
  EXPECT_EQ(laid(NAN, 25), 0u);
  f.z_mm(52, 50) = NAN;
  EXPECT_EQ(laid(25, 25), 0u);  // a void under it
  EXPECT_EQ(laid(35, 25), 1u);
}

TEST(LayStones, StoneSmallerThanACell) {
  // Few nodes, and not around the stone: a plane is still found exactly.
  const ModelField f = field(11, 5.0, [](double x, double y) { return 0.5 * x - 0.25 * y; });
  const auto laid =
      lay_stones(std::vector{stone_at(22.0, 23.5, 0.7)}, f, ModelScale(1000), 0, 0, 0.25);
  ASSERT_EQ(laid.size(), 1u);
  const Vec3 normal = normalized(Vec3{-0.5, 0.25, 1});
  EXPECT_LT(norm(laid[0].model_from_stone.direction({0, 0, 1}) - normal), 1e-12);
  double low = INFINITY, high = -INFINITY;
  for (const Vec3& v : stone_mesh(laid[0]).vertices_mm) {
    low = std::fmin(low, dot(v, normal));  // the plane passes through the origin
    high = std::fmax(high, dot(v, normal));
  }
  EXPECT_NEAR(low, -0.25 * (high - low), 1e-12);
}

// ---- envelope ------------------------------------------------------------------------

/// Height of the mesh above (x, y) by the plane of every triangle; -inf if none.
double top_of(const TriMesh& m, double x, double y) {
  double top = -INFINITY;
  for (const auto& t : m.triangles) {
    const Vec3 a = m.vertices_mm[t[0]], b = m.vertices_mm[t[1]], c = m.vertices_mm[t[2]];
    const double det = (b.x - a.x) * (c.y - a.y) - (c.x - a.x) * (b.y - a.y);
    if (std::abs(det) < 1e-12) continue;
    const double v = ((x - a.x) * (c.y - a.y) - (c.x - a.x) * (y - a.y)) / det;
    const double w = ((b.x - a.x) * (y - a.y) - (x - a.x) * (b.y - a.y)) / det;
    if (v >= -1e-9 && w >= -1e-9 && v + w <= 1.0 + 1e-9)
      top = std::fmax(top, a.z + v * (b.z - a.z) + w * (c.z - a.z));
  }
  return top;
}

TEST_P(Lay, TheEnvelopeIsExactAtTheNodes) {
  ModelField f = terrain(1000, 12, 0.25);
  std::vector<SiteStone> stones{stone_at(-3.0, 2.0, 5.0, GetParam()),
                                stone_at(-1.0, 3.0, 4.0, GetParam() + 1),  // the two overlap
                                stone_at(5.0, -4.0, 3.0, GetParam() + 2)};
  const auto laid = lay_stones(stones, f, ModelScale(1000), -12, -12);
  ASSERT_EQ(laid.size(), 3u);
  f.z_mm(56, 36) = NAN;  // a void under the first stone stays one
  const ModelField raised = with_stones(f, laid);
  EXPECT_EQ(raised.spacing, f.spacing);
  EXPECT_EQ(raised.x0, f.x0);
  std::vector<TriMesh> meshes;
  for (const PlacedStone& s : laid) meshes.push_back(stone_mesh(s));
  int higher = 0;
  for (std::ptrdiff_t r = 0; r < f.z_mm.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < f.z_mm.cols(); ++c) {
      if (std::isnan(f.z_mm(r, c))) {
        EXPECT_TRUE(std::isnan(raised.z_mm(r, c)));
        continue;
      }
      double expected = f.z_mm(r, c);
      for (std::size_t i = 0; i < laid.size(); ++i) {
        // The nodes far from a stone need no oracle: the maximum is the field.
        const Vec3 d = laid[i].model_from_stone.translation_mm - Vec3{f.x_mm(c), f.y_mm(r), 0};
        if (std::hypot(d.x, d.y) < 1.2 * laid[i].scale_mm)
          expected = std::fmax(expected, top_of(meshes[i], f.x_mm(c), f.y_mm(r)));
      }
      // Half a unit of float at 30 mm is 1e-6.
      ASSERT_NEAR(raised.z_mm(r, c), expected, 2e-6) << r << " " << c;
      if (raised.z_mm(r, c) > f.z_mm(r, c)) ++higher;
    }
  EXPECT_GT(higher, 200);
}

TEST(WithStones, LeavesNoHolesWhereNodesLieOnEdges) {
  // A stone whose vertices and edges fall onto nodes: no rotation, dyadic coordinates.
  const ModelField f = field(
      65, 0.125, [](double, double) { return 0.0; }, -4.0, -4.0);
  const PlacedStone stone{.number = 1,
                          .shape = {.angularity = 0.0, .roughness = 0.0, .subdivisions = 2},
                          .scale_mm = 4.0,
                          .model_from_stone = {},
                          .embedded_depth_mm = 0.0};
  const ModelField raised = with_stones(f, std::vector{stone});
  const TriMesh mesh = stone_mesh(stone);
  for (std::ptrdiff_t r = 0; r < 65; ++r)
    for (std::ptrdiff_t c = 0; c < 65; ++c)
      ASSERT_NEAR(raised.z_mm(r, c), std::fmax(0.0, top_of(mesh, f.x_mm(c), f.y_mm(r))), 1e-6);
}

TEST(StoneMesh, IsClosedAndOutward) {
  const PlacedStone stone{.number = 1,
                          .shape = {.seed = 4},
                          .scale_mm = 10.0,
                          .model_from_stone = {.rotation = rotation_about({0, 1, 0}, 0.3),
                                               .translation_mm = {5, 6, 7}}};
  const TriMesh m = stone_mesh(stone);
  EXPECT_THAT(m, testing_support::IsClosedAndOriented());
  EXPECT_GT(testing_support::signed_volume_mm3(m), 100.0);
}

}  // namespace
}  // namespace maquette::meshing
