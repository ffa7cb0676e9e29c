// SPDX-License-Identifier: GPL-3.0-or-later

// What is claimed in cnc/waterline.hpp and level_contours.hpp, and how each claim is attacked:
//
//   place of the contour .......... ramp and cone: closed forms; elsewhere exact cutter locations
//                                   on both sides of each vertex
//   gouge between vertices ........ exact cutter locations every few um, on kind and harsh ground,
//                                   against the tolerance and against the reported bounds
//   takes what is steep ........... ramp milled point by point: ridges of the closed form
//   only what is steep ............ contact slopes; gentle ground gives nothing
//   allowance ..................... distance of milled points from the ramp
//   surface to the right .......... each vertex
//   no rapid through stock ........ milled point by point
//   contours ...................... every edge with ends on both sides, once
//   same moves, errors, cancel

#include "cnc/waterline.hpp"

#include <set>
#include <stop_token>
#include <tuple>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <oneapi/tbb/global_control.h>

#include "cnc/cutter_location.hpp"
#include "cnc/level_contours.hpp"
#include "cnc/mill.hpp"
#include "core/random.hpp"
#include "support/matchers.hpp"
#include "support/milled_stock.hpp"
#include "support/terrain.hpp"

namespace maquette::cnc {
namespace {

using heightmap::ModelField;
using testing_support::FailsWith;
using testing_support::flat_field;
using testing_support::Ground;
using testing_support::MilledStock;

struct Milled {
  WaterlineReport report;
  Toolpath path;  // all pieces
};

Milled milled(const ModelField& design, const WaterlineOptions& o) {
  Milled m;
  const auto report = waterline(design, o, [&](const Toolpath& piece) -> Result<void> {
    if (m.path.moves.empty()) {
      m.path.start = piece.start;
    } else {
      EXPECT_EQ(piece.start, m.path.moves.back().to);
    }
    m.path.moves.insert(m.path.moves.end(), piece.moves.begin(), piece.moves.end());
    return {};
  });
  EXPECT_TRUE(report) << report.error().message;
  if (report) m.report = *report;
  return m;
}

struct Cut {
  double ax, ay, bx, by, z;
};
/// Moves at feed that stay on a level.
std::vector<Cut> cuts(const Toolpath& path) {
  std::vector<Cut> found;
  ToolPosition at = path.start;
  for (const PathMove& m : path.moves) {
    if (m.kind == PathMove::Kind::line && m.to.z == at.z)
      found.push_back({mm_of_ticks(at.x), mm_of_ticks(at.y), mm_of_ticks(m.to.x),
                       mm_of_ticks(m.to.y), mm_of_ticks(m.to.z)});
    at = m.to;
  }
  return found;
}

/// Rises along x by `slope` from x = 10 to 20 mm; flat on both sides.
ModelField ramp(double slope) {
  ModelField f = flat_field(41, 61, 0.5, 0.0F);
  for (std::ptrdiff_t r = 0; r < 41; ++r)
    for (std::ptrdiff_t c = 0; c < 61; ++c)
      f.z_mm(r, c) =
          static_cast<float>(slope * std::clamp(0.5 * static_cast<double>(c) - 10.0, 0.0, 10.0));
  return f;
}

ModelField steep_ground(Ground kind, std::uint64_t seed) {
  ModelField f = testing_support::ground(kind, seed, 61, 0.5);
  for (float& z : f.z_mm.cells()) {
    z = std::clamp(z, -30.0F, 30.0F);
    if (kind == Ground::rolling) z *= 6.0F;
  }
  return f;
}

// ---- closed forms ----------------------------------------------------------------------

TEST(Waterline, RampHasStraightContoursAtTheirPlace) {
  const double slope = 2.0, R = 2.0, theta = std::atan(slope);
  WaterlineOptions o;
  o.ball_radius_mm = R;
  o.step_mm = 0.75;
  const Milled m = milled(ramp(slope), o);
  const std::vector<Cut> all = cuts(m.path);
  ASSERT_GT(all.size(), 100U);
  std::set<double> levels;
  for (const Cut& c : all) {
    // On the plane the tip is slope (x - 10) + R (1 / cos theta - 1).
    const double x = 10.0 + (c.z - R * (1.0 / std::cos(theta) - 1.0)) / slope;
    if (c.z > 3.0 && c.z < 18.0) {
      EXPECT_LE(c.ax, x + 1e-9);
      EXPECT_GE(c.ax, x - 0.0011);  // the lattice
      EXPECT_GT(c.by, c.ay - 1e-9) << "the wall, at larger x, lies to the right going north";
    }
    levels.insert(c.z);
  }
  EXPECT_EQ(static_cast<int>(levels.size()), m.report.levels);
  EXPECT_LE(m.report.certified_gouge_mm, o.tolerance_mm);
  double before = 0.0;
  for (const double z : levels) {
    if (before > 0.0) {
      EXPECT_NEAR(z - before, 0.75, 0.0011);
    }
    before = z;
  }
}

// Ridges between levels: normal to the plane (step / sin theta)^2 / 8 R to first order; exactly
// R - sqrt(R^2 - (s / 2)^2).
TEST(Waterline, RampIsLeftWithRidgesOfTheClosedForm) {
  const double slope = 2.0, R = 2.0, theta = std::atan(slope);
  WaterlineOptions o;
  o.ball_radius_mm = R;
  o.step_mm = 0.5;
  o.allowance_mm = 0.25;
  const ModelField design = ramp(slope);
  const Milled m = milled(design, o);
  MilledStock stock(10.0, 8.0, 0.05, 41, 181,
                    [&](double x, double y) { return heightmap::height_at(design, x, y) + 1.5; });
  stock.mill(m.path, Cutter::ball(R), 0.05);
  EXPECT_EQ(stock.deepest_rapid, 0.0);
  const double s = o.step_mm / std::sin(theta);
  const double ridge = R - std::sqrt(R * R - 0.25 * s * s);
  double least = INFINITY, most = -INFINITY;
  for (std::ptrdiff_t r = 0; r < 41; ++r)
    for (std::ptrdiff_t c = 0; c < 181; ++c) {
      const double x = stock.x(c);
      if (x < 13.0 || x > 17.0) continue;
      const double normal = (stock.z()(r, c) - slope * (x - 10.0)) * std::cos(theta);
      least = std::min(least, normal), most = std::max(most, normal);
    }
  EXPECT_GE(least, o.allowance_mm - 1e-4);  // float heights
  EXPECT_LE(least, o.allowance_mm + 0.002);
  EXPECT_NEAR(most, o.allowance_mm + ridge, 0.003);  // lattice and points
}

TEST(Waterline, ConeHasCircles) {
  const double slope = 1.8, R = 1.5, theta = std::atan(slope);
  ModelField f = flat_field(241, 241, 0.125, 0.0F);
  for (std::ptrdiff_t r = 0; r < 241; ++r)
    for (std::ptrdiff_t c = 0; c < 241; ++c)
      f.z_mm(r, c) = static_cast<float>(
          slope * std::max(0.0, 12.0 - std::hypot(f.x_mm(c) - 15.0, f.y_mm(r) - 15.0)));
  WaterlineOptions o;
  o.ball_radius_mm = R;
  o.step_mm = 4.0;
  const Milled m = milled(f, o);
  EXPECT_EQ(m.report.contours, static_cast<std::uint64_t>(m.report.levels));
  double length = 0.0, expected = 0.0;
  std::set<double> levels;
  for (const Cut& c : cuts(m.path)) {
    // The offset cone: its apex stands R / cos theta above the cone's, minus R for the tip.
    const double radius = (12.0 * slope + R / std::cos(theta) - R - c.z) / slope;
    if (c.z > 12.0 * slope - 7.0 || c.z < 2.0) continue;
    // The mesh is inside the cone by up to its sagitta, 0.125^2 slope / (8 rho) upwards.
    EXPECT_NEAR(std::hypot(c.ax - 15.0, c.ay - 15.0), radius, 0.003);
    length += std::hypot(c.bx - c.ax, c.by - c.ay);
    if (levels.insert(c.z).second) expected += 2.0 * 3.14159265358979 * radius;
  }
  ASSERT_GE(levels.size(), 2U);
  EXPECT_NEAR(length, expected, 1e-3 * expected);
}

// ---- laws on random ground ------------------------------------------------------------

class WaterlineGround : public testing::TestWithParam<Ground> {};

TEST_P(WaterlineGround, NeverCutsDeeperThanItSays) {
  const ModelField design = steep_ground(GetParam(), 31);
  WaterlineOptions o;
  o.step_mm = GetParam() == Ground::rolling ? 1.7 : 6.0;
  o.ball_radius_mm = 2.0;
  const Milled m = milled(design, o);
  const std::vector<Cut> all = cuts(m.path);
  ASSERT_GT(all.size(), 50U);
  DropCutter cutter(design, Cutter::ball(2.0));
  double worst = -INFINITY, kept = 0.0, steep = 0.0;
  std::uint64_t n = 0;
  for (const Cut& c : all) {
    const double h = std::hypot(c.bx - c.ax, c.by - c.ay);
    ++n;
    for (int i = 0; i <= 8; ++i) {
      // Eight places, shifted at random so that nothing is systematically missed.
      const double t = std::clamp(
          (i + random_uniform(5, 9 * n + static_cast<std::uint64_t>(i)) - 0.5) / 8.0, 0.0, 1.0);
      const CutterContact contact = cutter.drop(c.ax + t * (c.bx - c.ax), c.ay + t * (c.by - c.ay));
      worst = std::max(worst, contact.tip_mm - c.z);
      if (i == 4) {
        const double sine = std::hypot(contact.dx_mm, contact.dy_mm) / 2.0;
        kept += h;
        if (sine >= std::sin((o.least_slope_deg - 1.0) * 0.017453292519943295)) steep += h;
      }
    }
    EXPECT_LE(cutter.drop(c.ax, c.ay).tip_mm, c.z + 1e-9);
  }
  EXPECT_LE(worst, m.report.certified_gouge_mm + 1e-9);
  // Facets steeper than the tolerance can follow in chords of 0.01 mm only by vertical walls.
  EXPECT_LE(worst, o.tolerance_mm);
  EXPECT_LE(m.report.certified_normal_gouge_mm, o.tolerance_mm);
  EXPECT_NEAR(m.report.cutting_length_mm, kept, 1e-6 * kept);
  EXPECT_GT(steep, 0.3 * kept);

  MilledStock stock(design.x0.value(), design.y0.value(), 0.25, 121, 121,
                    [&](double x, double y) { return heightmap::height_at(design, x, y); });
  stock.mill(m.path, Cutter::ball(2.0 - 0.01), 0.5);
  EXPECT_EQ(stock.deepest_rapid, 0.0);
}

INSTANTIATE_TEST_SUITE_P(Kinds, WaterlineGround,
                         testing::Values(Ground::rolling, Ground::spikes, Ground::cliffs,
                                         Ground::knife_edges),
                         [](const testing::TestParamInfo<Ground>& g) {
                           return std::string(testing_support::name(g.param));
                         });

// Each vertex inside the steep part lies within the lattice of the true contour.
TEST(Waterline, VerticesStandJustBesideTheSurface) {
  const ModelField design = steep_ground(Ground::rolling, 12);
  WaterlineOptions o;
  o.step_mm = 3.0;
  o.overlap_mm = 0.0;
  DropCutter cutter(design, Cutter::ball(3.0));
  int right = 0, all = 0;
  for (const Cut& c : cuts(milled(design, o).path)) {
    const double h = std::hypot(c.bx - c.ax, c.by - c.ay);
    if (h < 0.02) continue;
    const double nx = (c.by - c.ay) / h, ny = -(c.bx - c.ax) / h;
    const double mx = 0.5 * (c.ax + c.bx), my = 0.5 * (c.ay + c.by);
    ++all;
    if (cutter.drop(mx + 0.006 * nx, my + 0.006 * ny).tip_mm > c.z) ++right;
    EXPECT_LE(cutter.drop(mx - 0.006 * nx, my - 0.006 * ny).tip_mm, c.z);
  }
  ASSERT_GT(all, 200);
  EXPECT_GE(right, all - all / 1000);  // not at kinks, see the header
}

TEST(Waterline, GentleGroundGivesNothing) {
  ModelField design = testing_support::ground(Ground::rolling, 3, 61, 0.5);
  for (float& z : design.z_mm.cells()) z *= 0.5F;
  const Milled m = milled(design, {});
  EXPECT_EQ(m.report.levels, 0);
  EXPECT_TRUE(m.path.moves.empty());
}

TEST(Waterline, RapidsClearTheStockThatIsGiven) {
  const ModelField design = steep_ground(Ground::rolling, 9);
  ModelField stock = design;
  for (float& z : stock.z_mm.cells()) z += 2.0F;
  stock.z_mm(30, 30) = 90.0F;
  WaterlineOptions o;
  o.step_mm = 4.0;
  o.stock = &stock;
  MilledStock points(design.x0.value(), design.y0.value(), 0.25, 121, 121,
                     [&](double x, double y) { return heightmap::height_at(stock, x, y); });
  points.mill(milled(design, o).path, Cutter::ball(3.0), 0.2);
  EXPECT_EQ(points.deepest_rapid, 0.0);
}

// ---- contours -------------------------------------------------------------------------

TEST(LevelContours, PassEveryEdgeBetweenBelowAndAboveOnce) {
  Grid<float> field(40, 50);
  for (std::size_t i = 0; i < field.cells().size(); ++i)
    field.cells()[i] = static_cast<float>(random_uniform(77, i));
  const auto contours = level_contours(field, 0.5, [](auto, auto) { return true; });
  std::set<std::tuple<int, int, bool>> seen;
  for (const LevelContour& c : contours) {
    const std::size_t n = c.edges.size();
    for (std::size_t i = 0; i < n; ++i) {
      const GridEdge e = c.edges[i];
      EXPECT_TRUE(seen.insert({e.row, e.col, e.along_x}).second);
      const double a = field(e.row, e.col);
      const double b = e.along_x ? field(e.row, e.col + 1) : field(e.row + 1, e.col);
      EXPECT_NE(a <= 0.5, b <= 0.5);
      if (i + 1 == n && !c.closed) {
        const bool border = e.along_x ? e.row == 0 || e.row == 39 : e.col == 0 || e.col == 49;
        EXPECT_TRUE(border);
        continue;
      }
      // What is below lies to the left of the way to the next edge.
      const GridEdge f = c.edges[(i + 1) % n];
      const double ex = e.col + (e.along_x ? 0.5 : 0.0), ey = e.row + (e.along_x ? 0.0 : 0.5);
      const double fx = f.col + (f.along_x ? 0.5 : 0.0), fy = f.row + (f.along_x ? 0.0 : 0.5);
      EXPECT_LE(std::hypot(fx - ex, fy - ey), 1.0 + 1e-9);
      const double low_x = a <= 0.5 ? e.col : e.col + (e.along_x ? 1 : 0);
      const double low_y = a <= 0.5 ? e.row : e.row + (e.along_x ? 0 : 1);
      EXPECT_GT((fx - ex) * (low_y - ey) - (fy - ey) * (low_x - ex), 0.0);
    }
  }
  std::size_t expected = 0;
  for (std::ptrdiff_t r = 0; r < 40; ++r)
    for (std::ptrdiff_t c = 0; c < 50; ++c) {
      if (c < 49 && (field(r, c) <= 0.5F) != (field(r, c + 1) <= 0.5F)) ++expected;
      if (r < 39 && (field(r, c) <= 0.5F) != (field(r + 1, c) <= 0.5F)) ++expected;
    }
  EXPECT_EQ(seen.size(), expected);
}

// ---- contract --------------------------------------------------------------------------

TEST(Waterline, SameMovesForAnyNumberOfThreads) {
  const ModelField design = steep_ground(Ground::rolling, 4);
  std::vector<Milled> results;
  for (const std::size_t threads : {1U, 3U}) {
    const oneapi::tbb::global_control limit(oneapi::tbb::global_control::max_allowed_parallelism,
                                            threads);
    WaterlineOptions o;
    o.step_mm = 3.0;
    results.push_back(milled(design, o));
  }
  ASSERT_EQ(results[0].path.moves.size(), results[1].path.moves.size());
  for (std::size_t i = 0; i < results[0].path.moves.size(); ++i)
    EXPECT_EQ(results[0].path.moves[i].to, results[1].path.moves[i].to) << i;
}

TEST(Waterline, RefusesWhatMakesNoSense) {
  const ModelField design = ramp(2.0);
  const auto none = [](const Toolpath&) -> Result<void> { return {}; };
  const auto with = [&](auto change) {
    WaterlineOptions o;
    change(o);
    return waterline(design, o, none);
  };
  const auto code = kWaterlineOptionOutOfRange;  // CNC_WATERLINE_OPTION_OUT_OF_RANGE
  EXPECT_THAT(with([](auto& o) { o.ball_radius_mm = 0.0; }), FailsWith(code));
  EXPECT_THAT(with([](auto& o) { o.allowance_mm = -1.0; }), FailsWith(code));
  EXPECT_THAT(with([](auto& o) { o.step_mm = 0.0; }), FailsWith(code));
  EXPECT_THAT(with([](auto& o) { o.least_slope_deg = 90.0; }), FailsWith(code));
  EXPECT_THAT(with([](auto& o) { o.overlap_mm = NAN; }), FailsWith(code));
  EXPECT_THAT(with([](auto& o) { o.tolerance_mm = 0.0; }), FailsWith(code));
  EXPECT_THAT(with([](auto& o) { o.feed_mm_min = -3.0; }), FailsWith(code));
  EXPECT_THAT(with([](auto& o) { o.plunge_feed_mm_min = 0.0; }), FailsWith(code));
  EXPECT_THAT(with([](auto& o) { o.clearance_mm = -1.0; }), FailsWith(code));
  ModelField hole = design;
  hole.z_mm(4, 7) = NAN;
  EXPECT_THAT(waterline(hole, {}, none), FailsWith(kHeightNotFinite));
  const auto full = [](const Toolpath&) -> Result<void> { return fail(kCancelled, "full"); };
  EXPECT_THAT(waterline(design, {}, full), FailsWith(kCancelled));
  std::stop_source source;
  source.request_stop();
  RunContext run;
  run.stop = source.get_token();
  EXPECT_THAT(waterline(design, {}, none, run), FailsWith(kCancelled));
}

}  // namespace
}  // namespace maquette::cnc
