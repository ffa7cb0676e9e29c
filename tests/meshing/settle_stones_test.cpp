// SPDX-License-Identifier: GPL-3.0-or-later

// meshing/settle_stones.hpp:
//   a cube on a slope lies flush ............ pose by closed form
//   a column on a slope falls over .......... pose by closed form, downhill
//   a bar over two ridges between nodes ..... height by closed form: only edges touch edges
//   a ball on a plane ....................... height by closed form; it stays, or rolls on a slope
//   three contacts hold the centre of mass .. on random terrain, two shapes, by the test's own
//                                             ground, contacts and centre of mass
//   nothing is in the ground ................ the same contacts' gaps
//   sunk straight down by the share ......... compared with the pose at rest
//   no slope above repose ................... the test's own plane fit, on steep terrain
//   stones keep apart and to their square ... every pair, every stone
//   what slides is moved or refused ......... slope above flat ground; slope everywhere; told
//   places same bits for seed and threads .......... compared for 1 and 4 every error
//   ............................. reached

#include "meshing/settle_stones.hpp"

#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <oneapi/tbb/global_control.h>

#include "core/random.hpp"
#include "support/matchers.hpp"
#include "support/terrain.hpp"

namespace maquette::meshing {
namespace {

using heightmap::ModelField;
using testing::HasSubstr;
using testing_support::FailsWith;
using testing_support::field_of;
using testing_support::Succeeds;

/// Waves of 2 to 40 mm; `steep` scales slopes, about 0.35 rms at 1.
double waves(std::uint64_t seed, double steep, double x, double y) {
  double z = 0.0;
  for (std::uint64_t i = 0; i < 7; ++i) {
    const double length = 2.0 * std::pow(1.65, static_cast<double>(i));
    const double turn = 2.0 * std::numbers::pi * random_uniform(seed, 2 * i);
    const double phase = 2.0 * std::numbers::pi * random_uniform(seed, 2 * i + 1);
    z += steep * 0.03 * length *
         std::sin(phase +
                  2.0 * std::numbers::pi / length * (x * std::cos(turn) + y * std::sin(turn)));
  }
  return z;
}

/// The model at 1:1000, its lower left corner at site (0, 0) minus `half`.
StoneGround ground_of(const ModelField& f, double half_m) {
  return {
      .surface = f, .scale = ModelScale(1000), .east_of_x0_m = -half_m, .north_of_y0_m = -half_m};
}

SitePlanRequest site_of(double half_m) {
  return {.half_width = Metres{half_m}};
}

/// Box of these extents as a body of diameter 1, upright; triangles as they come.
StoneBodyPtr box_body(Vec3 size) {
  StoneBody body;
  body.name = body.source = "box";
  for (int i = 0; i < 8; ++i)
    body.mesh.vertices_mm.push_back({(i & 1) ? 0.5 * size.x : -0.5 * size.x,
                                     (i & 2) ? 0.5 * size.y : -0.5 * size.y,
                                     (i & 4) ? 0.5 * size.z : -0.5 * size.z});
  body.mesh.triangles = {{0, 2, 1}, {1, 2, 3}, {4, 5, 6}, {5, 7, 6}, {0, 1, 4}, {1, 5, 4},
                         {2, 6, 3}, {3, 6, 7}, {0, 4, 2}, {2, 4, 6}, {1, 3, 5}, {3, 7, 5}};
  const double d = assets::equivalent_diameter(body.mesh.vertices_mm);
  for (Vec3& v : body.mesh.vertices_mm) v = (1.0 / d) * v;
  return std::make_shared<const StoneBody>(std::move(body));
}

/// A box of so many millimetres at a place of the model at 1:1000 whose corner is site (-20, -20).
SiteStone box_at(double x, double y, Vec3 size, Radians heading) {
  return {.number = 1,
          .body = box_body(size),
          .diameter = Metres{2.0 * std::sqrt(size.x * size.y / std::numbers::pi)},
          .east_m = x - 20.0,
          .north_m = y - 20.0,
          .heading = heading,
          .has_place = true};
}

// ---- what the test knows of itself about ground, contacts and mass ----------------------

double ground_at(const ModelField& f, double x, double y) {
  const double s = f.spacing.value();
  const double u = x / s, v = y / s;
  const auto c = std::min(static_cast<std::ptrdiff_t>(u), f.z_mm.cols() - 2);
  const auto r = std::min(static_cast<std::ptrdiff_t>(v), f.z_mm.rows() - 2);
  const double a = u - static_cast<double>(c), b = v - static_cast<double>(r);
  const double z00 = f.z_mm(r, c), z11 = f.z_mm(r + 1, c + 1), z01 = f.z_mm(r, c + 1),
               z10 = f.z_mm(r + 1, c);
  return a >= b ? (1 - a) * z00 + (a - b) * z01 + b * z11 : (1 - b) * z00 + (b - a) * z10 + a * z11;
}

struct Gap {
  Vec3 at;
  double mm;
};

/// All corners of the overlay of stone and ground: vertices, nodes under faces, crossings of edges
/// (each with each of the ground's edges near it).
std::vector<Gap> gaps(const ModelField& f, const TriMesh& m) {
  std::vector<Gap> all;
  for (const Vec3& v : m.vertices_mm) all.push_back({v, v.z - ground_at(f, v.x, v.y)});
  const double s = f.spacing.value();
  for (const auto& t : m.triangles) {
    const Vec3 a = m.vertices_mm[t[0]], b = m.vertices_mm[t[1]], c = m.vertices_mm[t[2]];
    const Vec3 n = cross(b - a, c - a);
    const auto column = [&](double at) { return static_cast<std::ptrdiff_t>(std::floor(at / s)); };
    const auto c0 = column(std::min({a.x, b.x, c.x})), c1 = column(std::max({a.x, b.x, c.x})) + 1;
    const auto r0 = column(std::min({a.y, b.y, c.y})), r1 = column(std::max({a.y, b.y, c.y})) + 1;
    if (n.z < 0.0)
      for (auto r = r0; r <= r1; ++r)
        for (auto col = c0; col <= c1; ++col) {
          const Vec3 p{f.x_mm(col), f.y_mm(r), 0.0};
          const auto left = [&](Vec3 from, Vec3 to) {
            return (to.x - from.x) * (p.y - from.y) - (to.y - from.y) * (p.x - from.x);
          };
          if (left(a, b) > 0.0 || left(b, c) > 0.0 || left(c, a) > 0.0) continue;
          const double z = a.z - (n.x * (p.x - a.x) + n.y * (p.y - a.y)) / n.z;
          all.push_back({{p.x, p.y, z}, z - static_cast<double>(f.z_mm(r, col))});
        }
    for (auto r = r0; r < r1; ++r)
      for (auto col = c0; col < c1; ++col)
        for (const auto& [dc, dr] : {std::pair{1, 0}, std::pair{0, 1}, std::pair{1, 1}}) {
          const double gx = f.x_mm(col), gy = f.y_mm(r), hx = s * dc, hy = s * dr;
          for (const auto& [p, q] : {std::pair{a, b}, std::pair{b, c}, std::pair{c, a}}) {
            const double dx = q.x - p.x, dy = q.y - p.y, det = dx * hy - dy * hx;
            if (std::abs(det) < 1e-12) continue;
            const double t_stone = ((gx - p.x) * hy - (gy - p.y) * hx) / det;
            const double t_ground = ((gx - p.x) * dy - (gy - p.y) * dx) / det;
            if (t_stone < 0 || t_stone > 1 || t_ground < 0 || t_ground > 1) continue;
            const Vec3 at = p + t_stone * (q - p);
            const double z0 = f.z_mm(r, col), z1 = f.z_mm(r + dr, col + dc);
            all.push_back({at, at.z - (z0 + t_ground * (z1 - z0))});
          }
        }
  }
  return all;
}

Vec3 centre_of_mass(const TriMesh& m) {
  double volume = 0.0;
  Vec3 sum;
  for (const auto& t : m.triangles) {
    const Vec3 a = m.vertices_mm[t[0]], b = m.vertices_mm[t[1]], c = m.vertices_mm[t[2]];
    const double v = dot(a, cross(b, c));
    volume += v;
    sum += 0.25 * v * (a + b + c);
  }
  return (1.0 / volume) * sum;
}

/// Largest angle between neighbouring directions in which contacts lie, seen from the centre of
/// mass. Three of them hold it if and only if that is not more than pi.
double widest_gap(const std::vector<Gap>& contacts, Vec3 mass) {
  std::vector<double> angles;
  for (const Gap& c : contacts) angles.push_back(std::atan2(c.at.y - mass.y, c.at.x - mass.x));
  std::sort(angles.begin(), angles.end());
  double widest = angles.front() + 2.0 * std::numbers::pi - angles.back();
  for (std::size_t i = 1; i < angles.size(); ++i)
    widest = std::fmax(widest, angles[i] - angles[i - 1]);
  return widest;
}

/// The claim of rest, of a stone that is not sunk.
void expect_rests(const ModelField& f, const PlacedStone& stone) {
  const TriMesh mesh = stone_mesh(stone);
  std::vector<Gap> contacts;
  double least = INFINITY;
  for (const Gap& g : gaps(f, mesh)) {
    least = std::fmin(least, g.mm);
    if (g.mm <= 0.01) contacts.push_back(g);
  }
  EXPECT_GT(least, -kSunken_mm) << "stone " << stone.number;
  ASSERT_GE(contacts.size(), 3u) << "stone " << stone.number;
  // Held to 1e-5 mm beside a line of contacts, which are at least some 0.1 mm away.
  EXPECT_LT(widest_gap(contacts, centre_of_mass(mesh)), std::numbers::pi + 1e-3)
      << "stone " << stone.number;
}

/// Slope of the least squares plane of all nodes nearer than `radius`.
double slope_under(const ModelField& f, double x, double y, double radius) {
  double n = 0, sx = 0, sy = 0, sz = 0, xx = 0, xy = 0, yy = 0, xz = 0, yz = 0;
  for (std::ptrdiff_t r = 0; r < f.z_mm.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < f.z_mm.cols(); ++c) {
      const double u = f.x_mm(c) - x, v = f.y_mm(r) - y, z = f.z_mm(r, c);
      if (std::hypot(u, v) > radius) continue;
      n += 1, sx += u, sy += v, sz += z, xx += u * u, xy += u * v, yy += v * v, xz += u * z,
          yz += v * z;
    }
  xx -= sx * sx / n, xy -= sx * sy / n, yy -= sy * sy / n, xz -= sx * sz / n, yz -= sy * sz / n;
  const double det = xx * yy - xy * xy;
  return std::atan(std::hypot((xz * yy - yz * xy) / det, (yz * xx - xz * xy) / det));
}

double circumscribed_mm(const PlacedStone& stone) {
  double r = 0.0;
  for (const Vec3& v : unit_stone(stone.shape, stone.body).vertices_mm) r = std::fmax(r, norm(v));
  return r * stone.scale_mm;
}

// ---- closed forms --------------------------------------------------------------------------

TEST(SettleStones, ACubeLiesFlushOnASlope) {
  const double slope = 0.5;  // 26.6 degrees; dyadic, so that heights are exact
  const ModelField f = field_of(81, 0.5, [&](double x, double) { return slope * x; });
  for (const double heading : {0.0, 33.0}) {
    const auto placed = settle_stones(std::vector{box_at(20, 20, {3, 3, 3}, degrees(heading))},
                                      site_of(20), ground_of(f, 20), {.embedded_share = 0.0});
    ASSERT_THAT(placed, Succeeds());
    ASSERT_EQ(placed->size(), 1u);
    const RigidTransform& t = (*placed)[0].model_from_stone;
    const Vec3 normal = normalized(Vec3{-slope, 0, 1});
    EXPECT_LT(norm(t.direction({0, 0, 1}) - normal), 1e-9);
    EXPECT_EQ(t.translation_mm.x, 20.0);
    EXPECT_EQ(t.translation_mm.y, 20.0);
    // Its middle is half an edge from the slope along the normal.
    EXPECT_NEAR(t.translation_mm.z, slope * 20 + 1.5 / normal.z, 1e-9);
    expect_rests(f, (*placed)[0]);
  }
}

TEST(SettleStones, AColumnOnASlopeFallsDownhill) {
  // 2 x 2 x 6 mm: held up to 18.4 degrees. At 26.6 it falls about its lower edge onto its side.
  const double slope = 0.5;
  const ModelField f = field_of(81, 0.5, [&](double x, double) { return slope * x; });
  auto stone = box_at(20, 20, {2, 2, 6}, degrees(0));
  stone.diameter = Metres{2.0 * std::sqrt(4.0 / std::numbers::pi)};
  stone.has_place = false;  // it goes farther than its diameter
  const auto placed =
      settle_stones(std::vector{stone}, site_of(20), ground_of(f, 20), {.embedded_share = 0.0});
  ASSERT_THAT(placed, Succeeds());
  const RigidTransform& t = (*placed)[0].model_from_stone;
  const Vec3 normal = normalized(Vec3{-slope, 0, 1}), down = normalized(Vec3{-1, 0, -slope});
  EXPECT_LT(norm(t.direction({0, 0, 1}) - down), 1e-6);  // its long axis now points downhill
  // Dropped upright, its middle 3 mm above the slope at x = 20; the edge it falls about is 1 mm
  // down the slope from there, and its middle comes to lie 3 mm beyond that edge, 1 mm above.
  const double up = 3.0 / normal.z;
  const Vec3 dropped{20, 20, slope * 20 + up};
  const Vec3 edge = dropped - 3.0 * normal + 1.0 * down;
  EXPECT_LT(norm(t.translation_mm - (edge + 3.0 * down + 1.0 * normal)), 1e-5);
  expect_rests(f, (*placed)[0]);
}

TEST(SettleStones, ABarRestsOnRidgesBetweenNodes) {
  // Ridges at x = 2, 6, 10 ... of height 1; the bar of 5 x 1 x 1 mm lies between the rows of nodes
  // at y = 20 and 22 and covers none.
  const ModelField f =
      field_of(21, 2.0, [](double x, double) { return std::fmod(x, 4.0) == 2.0 ? 1.0 : 0.0; });
  const auto placed = settle_stones(std::vector{box_at(20, 21, {5, 1, 1}, degrees(0))}, site_of(20),
                                    ground_of(f, 20), {.embedded_share = 0.0});
  ASSERT_THAT(placed, Succeeds());
  const RigidTransform& t = (*placed)[0].model_from_stone;
  EXPECT_NEAR(t.translation_mm.z, 1.5, 1e-9);
  EXPECT_NEAR(t.direction({0, 0, 1}).z, 1.0, 1e-12);
  expect_rests(f, (*placed)[0]);
}

TEST(SettleStones, ABallStaysOnAPlaneAndRollsOnASlope) {
  SiteStone ball{.number = 1,
                 .shape = {.angularity = 0.0, .flatness = 1.0, .elongation = 1.0, .roughness = 0.0},
                 .diameter = Metres{4.0}};
  const ModelField level = field_of(81, 0.5, [](double, double) { return 2.0; });
  const auto lies =
      settle_stones(std::vector{ball}, site_of(20), ground_of(level, 20), {.embedded_share = 0.0});
  ASSERT_THAT(lies, Succeeds());
  const Vec3 at = (*lies)[0].model_from_stone.translation_mm;
  // Of 5120 triangles with edges of at most 0.09 radii, it lies on a facet: 2 (1 - cos 0.052)
  // lower.
  EXPECT_NEAR(at.z, 4.0, 0.006);
  EXPECT_LT(std::hypot(at.x - 20, at.y - 20), 0.2);

  const ModelField slope = field_of(81, 0.5, [](double x, double) { return 0.25 * x; });
  ball.has_place = true;
  const auto rolls = settle_stones(std::vector{ball}, site_of(20), ground_of(slope, 20), {});
  if (rolls)
    EXPECT_TRUE(rolls->empty());  // off the surface
  else
    EXPECT_THAT(rolls, FailsWith(kStoneDoesNotRest));
}

// ---- laws on random terrain ------------------------------------------------------------------

class Settle : public ::testing::TestWithParam<std::uint64_t> {
 protected:
  [[nodiscard]] ModelField terrain(double half, double spacing, double steep) const {
    return field_of(std::lround(2 * half / spacing) + 1, spacing,
                    [&](double x, double y) { return 30.0 + waves(GetParam(), steep, x, y); });
  }
  [[nodiscard]] std::vector<SiteStone> plan(const SitePlanRequest& request,
                                            double angularity) const {
    auto stones = plan_stones(request).value();
    for (SiteStone& s : stones) s.shape.angularity = angularity;
    return stones;
  }
};
INSTANTIATE_TEST_SUITE_P(Seeds, Settle, ::testing::Range<std::uint64_t>(1, 5));

TEST_P(Settle, OnThreeContactsThatHoldTheCentreOfMass) {
  const SitePlanRequest request{.count = 12, .half_width = Metres{40}, .seed = GetParam()};
  for (const double spacing : {0.5, 2.0})
    for (const double angularity : {0.3, 0.8}) {
      SCOPED_TRACE(testing::Message() << "spacing " << spacing << ", angularity " << angularity);
      const ModelField f = terrain(40, spacing, 0.6);
      const auto stones = plan(request, angularity);
      const auto placed = settle_stones(stones, request, ground_of(f, 40), {.embedded_share = 0.0});
      ASSERT_THAT(placed, Succeeds());
      ASSERT_EQ(placed->size(), stones.size());
      for (const PlacedStone& s : *placed) expect_rests(f, s);
    }
}

TEST_P(Settle, SinksStraightDownByTheShare) {
  const SitePlanRequest request{.count = 5, .half_width = Metres{40}, .seed = GetParam()};
  const ModelField f = terrain(40, 0.5, 0.6);
  const auto stones = plan(request, 0.6);
  const auto rest = settle_stones(stones, request, ground_of(f, 40), {.embedded_share = 0.0});
  const auto sunk = settle_stones(stones, request, ground_of(f, 40), {.embedded_share = 0.25});
  ASSERT_TRUE(rest && sunk);
  for (std::size_t i = 0; i < rest->size(); ++i) {
    const Box3 box = stone_mesh((*rest)[i]).bounds();
    Vec3 expected = (*rest)[i].model_from_stone.translation_mm;
    expected.z -= 0.25 * (box.max.z - box.min.z);
    EXPECT_LT(norm((*sunk)[i].model_from_stone.translation_mm - expected), 1e-9);
    EXPECT_EQ((*sunk)[i].model_from_stone.rotation, (*rest)[i].model_from_stone.rotation);
    const TriMesh mesh = stone_mesh((*sunk)[i]);
    const Vec3 lowest = *std::min_element(mesh.vertices_mm.begin(), mesh.vertices_mm.end(),
                                          [](Vec3 a, Vec3 b) { return a.z < b.z; });
    EXPECT_NEAR((*sunk)[i].embedded_depth_mm, ground_at(f, lowest.x, lowest.y) - lowest.z, 1e-9);
  }
}

TEST_P(Settle, NotOnSteepGroundNotOnOthersAndInItsSquare) {
  const SitePlanRequest request{
      .count = 16, .half_width = Metres{50}, .inner_half_width = Metres{22}, .seed = GetParam()};
  const ModelField f = terrain(50, 0.5, 1.6);
  const auto stones = plan(request, 0.7);
  const double repose = degrees(25).value();
  const auto placed = settle_stones(stones, request, ground_of(f, 50), {.repose = Radians{repose}});
  ASSERT_THAT(placed, Succeeds());
  ASSERT_EQ(placed->size(), stones.size());
  int moved = 0;
  for (std::size_t i = 0; i < stones.size(); ++i) {
    const PlacedStone& s = (*placed)[i];
    const Vec3 at = s.model_from_stone.translation_mm;
    double footprint = 0.0;
    for (const Vec3& v : unit_stone(s.shape, s.body).vertices_mm)
      footprint = std::fmax(footprint, s.scale_mm * std::hypot(v.x, v.y));
    EXPECT_LE(slope_under(f, at.x, at.y, footprint), repose + 1e-6) << s.number;
    const double from_centre = std::fmax(std::abs(at.x - 50), std::abs(at.y - 50));
    EXPECT_EQ(from_centre < 22, stones[i].is_inner);
    EXPECT_TRUE(from_centre <= 22 - s.scale_mm || from_centre >= 22 + s.scale_mm) << from_centre;
    EXPECT_LE(from_centre, 50 - s.scale_mm);
    for (std::size_t j = 0; j < i; ++j) {
      const Vec3 o = (*placed)[j].model_from_stone.translation_mm;
      EXPECT_GT(std::hypot(at.x - o.x, at.y - o.y),
                circumscribed_mm(s) + circumscribed_mm((*placed)[j]));
    }
    if (std::hypot(at.x - 50 - stones[i].east_m, at.y - 50 - stones[i].north_m) > s.scale_mm)
      ++moved;
  }
  EXPECT_GT(moved, 1);  // else this terrain has tested nothing
}

TEST_P(Settle, GivesTheSameBitsForAnyNumberOfThreads) {
  const SitePlanRequest request{.count = 6, .half_width = Metres{40}, .seed = GetParam()};
  const ModelField f = terrain(40, 0.5, 1.2);
  const auto stones = plan(request, 0.6);
  const auto with_threads = [&](std::size_t n) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, n);
    return settle_stones(stones, request, ground_of(f, 40)).value();
  };
  EXPECT_EQ(with_threads(1), with_threads(4));
}

// ---- what slides -------------------------------------------------------------------------------

TEST(SettleStones, WhatSlidesComesToLieBelow) {
  // 45 degrees down to x = 20, level from there.
  const ModelField f =
      field_of(161, 0.25, [](double x, double) { return std::fmax(0.0, 20.0 - x); });
  SiteStone stone = box_at(17, 20, {2, 2, 1}, degrees(10));
  stone.has_place = false;
  const auto placed = settle_stones(std::vector{stone}, site_of(20), ground_of(f, 20), {});
  ASSERT_THAT(placed, Succeeds());
  const Vec3 at = (*placed)[0].model_from_stone.translation_mm;
  EXPECT_GT(at.x, 18.5);
  EXPECT_LT(at.x, 22.5);  // at the foot, not thrown anywhere
  EXPECT_NEAR(at.y, 20.0, 0.5);
}

TEST(SettleStones, WhatFindsNoFlatGroundIsRefused) {
  const ModelField f = field_of(161, 0.25, [](double x, double) { return x; });
  SiteStone stone = box_at(20, 20, {2, 2, 1}, degrees(10));
  const auto told = settle_stones(std::vector{stone}, site_of(20), ground_of(f, 20), {});
  ASSERT_THAT(told, FailsWith(kStoneSlides));
  EXPECT_THAT(told.error().message,
              testing::AllOf(HasSubstr("stone 1 (box)"), HasSubstr("45.0 degrees"),
                             HasSubstr("stones.repose_deg is 35")));
  stone.has_place = false;
  EXPECT_THAT(settle_stones(std::vector{stone}, site_of(20), ground_of(f, 20), {}),
              FailsWith(kStoneSlides));
  EXPECT_THAT(
      settle_stones(std::vector{stone}, site_of(20), ground_of(f, 20), {.repose = degrees(50)}),
      Succeeds());
}

TEST(SettleStones, ToldPlacesThatDoNotHoldAreRefused) {
  // A column that falls by more than its diameter.
  const ModelField f = field_of(81, 0.5, [](double x, double) { return 0.5 * x; });
  EXPECT_THAT(settle_stones(std::vector{box_at(20, 20, {2, 2, 6}, degrees(0))}, site_of(20),
                            ground_of(f, 20), {}),
              FailsWith(kStoneDoesNotRest));
  // Beyond the surface, or on its border: left out, as lay_stones does.
  for (const double x : {70.0, 0.5}) {
    const auto off = settle_stones(std::vector{box_at(x, 20, {3, 3, 3}, degrees(0))}, site_of(20),
                                   ground_of(f, 20), {});
    ASSERT_THAT(off, Succeeds());
    EXPECT_TRUE(off->empty());
  }
}

TEST(SettleStones, StopsWhenAsked) {
  const ModelField f = field_of(81, 0.5, [](double, double) { return 0.0; });
  std::stop_source stop;
  stop.request_stop();
  EXPECT_THAT(settle_stones(std::vector{box_at(20, 20, {3, 3, 3}, degrees(0))}, site_of(20),
                            ground_of(f, 20), {}, {.stop = stop.get_token()}),
              FailsWith(kCancelled));
}

}  // namespace
}  // namespace maquette::meshing
