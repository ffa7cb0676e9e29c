// SPDX-License-Identifier: GPL-3.0-or-later

// What is claimed in cnc/linking.hpp, and how it is attacked:
//
//   never less than clearance .... thousands of random links on kind and harsh ground, exact
//                                  cutter locations at steps far finer than the link's own
//   lowest safe height ........... the excess over that height on flat ground, planes and gentle
//                                  ground; a far-off tower does not raise a link that avoids it
//   moves ........................ order, kinds, feeds, no piece of no length
//   plunge in stock .............. starts above the stock, not above the target
//   stock to its rim ............. nodes at cells' centres, a block of flat top: the rim is met as
//   a
//                                  ball meets an edge, by hand; farther short: the highest counts
//   no plunge faster than limit .. every move that descends below `approach` is at plunge feed

#include "cnc/linking.hpp"

#include <algorithm>
#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "cnc/cutter_location.hpp"
#include "core/check.hpp"
#include "core/random.hpp"
#include "support/terrain.hpp"

namespace maquette::cnc {
namespace {

using heightmap::ModelField;
using Kind = PathMove::Kind;
using testing_support::flat_field;
using testing_support::Ground;

std::int64_t ticks(double mm) {
  return std::llround(mm * 1e4);
}

/// Least distance of the tip above the exact cutter location along the rapids across and down.
double least_clearance(const Toolpath& path, const ModelField& field, double radius,
                       bool across_only) {
  DropCutter cutter(field, Cutter::ball(radius));
  double least = INFINITY;
  ToolPosition at = path.start;
  for (const PathMove& m : path.moves) {
    const double x0 = mm_of_ticks(at.x), y0 = mm_of_ticks(at.y), z0 = mm_of_ticks(at.z);
    const double dx = mm_of_ticks(m.to.x - at.x), dy = mm_of_ticks(m.to.y - at.y),
                 dz = mm_of_ticks(m.to.z - at.z);
    const bool across = dx != 0.0 || dy != 0.0;
    if (m.kind == Kind::rapid && (across || (!across_only && dz < 0.0))) {
      const int n = static_cast<int>(std::ceil(std::hypot(dx, dy) / 0.03)) + 1;
      for (int k = 0; k <= n; ++k) {
        const double t = static_cast<double>(k) / n;
        least = std::min(least, z0 + t * dz - cutter.drop(x0 + t * dx, y0 + t * dy).tip_mm);
      }
    }
    at = m.to;
  }
  return least;
}

TEST(Linking, OverFlatGroundGoesUpAcrossDownAndPlunges) {
  const CutterClearance clearance(flat_field(41, 41, 0.5, 2.0F), Cutter::ball(3.0));
  Toolpath path;
  path.start = {ticks(2.0), ticks(3.0), ticks(2.0)};
  append_link(path, {ticks(17.0), ticks(12.0), ticks(2.0)}, clearance.for_thread(),
              {2.0, 1.0, 600.0});
  const std::int64_t across = ticks(2.0 + 2.0), above = ticks(2.0 + 1.0);
  ASSERT_EQ(path.moves.size(), 4U);
  EXPECT_EQ(path.moves[0].kind, Kind::rapid);
  EXPECT_EQ(path.moves[0].to, (ToolPosition{ticks(2.0), ticks(3.0), across}));
  EXPECT_EQ(path.moves[1].kind, Kind::rapid);
  EXPECT_EQ(path.moves[1].to, (ToolPosition{ticks(17.0), ticks(12.0), across}));
  EXPECT_EQ(path.moves[2].kind, Kind::rapid);
  EXPECT_EQ(path.moves[2].to, (ToolPosition{ticks(17.0), ticks(12.0), above}));
  EXPECT_EQ(path.moves[3].kind, Kind::line);
  EXPECT_EQ(path.moves[3].to, (ToolPosition{ticks(17.0), ticks(12.0), ticks(2.0)}));
  EXPECT_EQ(path.moves[3].feed_mm_min, 600.0);
}

TEST(Linking, ATowerRaisesOnlyTheLinksThatPassIt) {
  ModelField field = flat_field(81, 81, 0.5, 0.0F);
  field.z_mm(40, 40) = 30.0F;  // at (20, 20)
  const LinkSurface surface = CutterClearance(field, Cutter::ball(3.0)).for_thread();
  const auto height = [&](double x0, double y0, double x1, double y1) {
    return highest_tip(surface, x0, y0, x1, y1);
  };
  EXPECT_DOUBLE_EQ(height(2.0, 10.0, 38.0, 10.0), 0.0);
  EXPECT_GE(height(2.0, 20.0, 38.0, 20.0), 30.0);
  EXPECT_LE(height(2.0, 20.0, 38.0, 20.0), 30.0);
  // Beside the tower at distance 2: the ball touches it sqrt(9 - 4) below its centre.
  const double beside = 30.0 + std::sqrt(5.0) - 3.0;
  EXPECT_GE(height(2.0, 22.0, 38.0, 22.0), beside);
  EXPECT_LE(height(2.0, 22.0, 38.0, 22.0), beside + 0.25 * 2.0 / std::sqrt(5.0) + 0.01);
}

TEST(Linking, NothingInReachIsNoObstacle) {
  const LinkSurface surface =
      CutterClearance(flat_field(11, 11, 0.5, 0.0F), Cutter::ball(3.0)).for_thread();
  EXPECT_EQ(highest_tip(surface, 20.0, 0.0, 30.0, 0.0), -INFINITY);
  Toolpath path;
  path.start = {ticks(20.0), 0, ticks(-4.0)};
  append_link(path, {ticks(30.0), 0, ticks(-5.0)}, surface, {});
  ASSERT_EQ(path.moves.size(), 2U);
  EXPECT_EQ(path.moves[0].to, (ToolPosition{ticks(30.0), 0, ticks(-4.0)}));
  EXPECT_EQ(path.moves[1].kind, Kind::rapid);
}

TEST(Linking, NoMoveToWhereThePathEnds) {
  const LinkSurface surface =
      CutterClearance(flat_field(11, 11, 0.5, 0.0F), Cutter::ball(3.0)).for_thread();
  Toolpath path;
  path.start = {ticks(1.0), ticks(1.0), ticks(0.0)};
  append_link(path, path.start, surface, {});
  EXPECT_TRUE(path.moves.empty());
  append_link(path, {ticks(1.0), ticks(1.0), ticks(4.0)}, surface, {});
  ASSERT_EQ(path.moves.size(), 1U);
  EXPECT_EQ(path.moves[0].kind, Kind::rapid);
}

TEST(Linking, PlungeIntoStockStartsAboveTheStock) {
  const LinkSurface stock =
      CutterClearance(flat_field(41, 41, 0.5, 8.0F), Cutter::ball(3.0)).for_thread();
  for (const double from_x : {2.0, 10.0}) {  // the second: straight above
    Toolpath path;
    path.start = {ticks(from_x), ticks(10.0), ticks(20.0)};
    append_link(path, {ticks(10.0), ticks(10.0), ticks(5.0)}, stock, {2.0, 1.0, 300.0});
    ASSERT_GE(path.moves.size(), 2U);
    const PathMove& plunge = path.moves.back();
    EXPECT_EQ(plunge.kind, Kind::line);
    EXPECT_EQ(plunge.feed_mm_min, 300.0);
    EXPECT_EQ(path.moves[path.moves.size() - 2].to.z, ticks(9.0));
  }
}

TEST(Linking, FlatAndBullNosedCuttersKeepTheirClearanceToo) {
  for (const Cutter& shape : {Cutter::flat(3.0), Cutter::bull(3.0, 1.0), Cutter::ball(2.0)})
    for (const Ground kind : {Ground::rough, Ground::spikes, Ground::cliffs}) {
      const ModelField field = testing_support::ground(kind, 7, 40, 0.5);
      const LinkSurface surface = CutterClearance(field, shape).for_thread();
      DropCutter cutter(field, shape);
      for (std::uint64_t i = 0; i < 30; ++i) {
        const auto along = [&](std::uint64_t k) { return 19.5 * random_uniform(7, 4 * i + k); };
        const double x0 = along(0) - 3.0, y0 = along(1) + 1.25, x1 = along(2) - 3.0,
                     y1 = along(3) + 1.25;
        const double height = highest_tip(surface, x0, y0, x1, y1);
        double highest = -INFINITY;
        for (int k = 0; k <= 700; ++k) {
          const double t = k / 700.0;
          highest = std::max(highest, cutter.drop(x0 + t * (x1 - x0), y0 + t * (y1 - y0)).tip_mm);
        }
        EXPECT_GE(height, highest - 1e-9);
      }
    }
}

TEST(Linking, StockWithNodesAtCellCentresReachesToItsRim) {
  const ModelField design = flat_field(21, 21, 0.5, 2.0F);
  ModelField stock = flat_field(10, 10, 1.0, 8.0F);
  stock.x0 = stock.y0 = Millimetres{0.5};
  const Cutter ball = Cutter::ball(3.0);
  const LinkSurface wide = stock_clearance(stock, design, ball).for_thread(),
                    narrow = CutterClearance(stock, ball).for_thread();
  for (const double out : {0.0, 1.0, 2.0, 2.9}) {
    // The ball's lowest point when it rests on the block's edge, the block reaching from 0 to 10.
    const double on_rim = 8.0 - 3.0 + std::sqrt(9.0 - out * out);
    for (const auto& [x, y] :
         {std::pair{-out, 5.0}, {10.0 + out, 5.0}, {5.0, -out}, {5.0, 10.0 + out}})
      EXPECT_GE(wide.tip_mm(x, y), on_rim) << x << ", " << y;
  }
  EXPECT_LT(narrow.tip_mm(-2.9, 5.0), 6.0) << "that is what is wrong without";
  EXPECT_EQ(wide.tip_mm(-4.0, 5.0), -INFINITY);
  // A stock that ends farther in says nothing of what stands there: its highest point.
  stock = flat_field(5, 5, 1.0, 3.0F);
  stock.x0 = stock.y0 = Millimetres{3.0};
  stock.z_mm(2, 2) = 8.0F;
  EXPECT_GE(stock_clearance(stock, design, ball).for_thread().tip_mm(0.0, 0.0), 8.0);
}

TEST(Linking, UnknownPositionsAreABug) {
  const LinkSurface surface =
      CutterClearance(flat_field(11, 11, 0.5, 0.0F), Cutter::ball(3.0)).for_thread();
  Toolpath path;
  EXPECT_THROW(append_link(path, {0, 0, 0}, surface, {}), CheckFailed);
}

class LinksOverGround : public testing::TestWithParam<std::tuple<Ground, int>> {};

TEST_P(LinksOverGround, KeepTheirClearance) {
  const auto [kind, number] = GetParam();
  const auto seed = static_cast<std::uint64_t>(number);
  const double spacing = std::vector{0.5, 0.37, 1.0}[seed % 3], radius = seed % 2 == 0 ? 3.0 : 1.5;
  const ModelField field = testing_support::ground(kind, seed, 40, spacing);
  const double step = seed % 2 == 0 ? 0.5 : 0.2;
  const LinkSurface surface = CutterClearance(field, Cutter::ball(radius), step).for_thread();
  DropCutter cutter(field, Cutter::ball(radius));
  const double side = 39.0 * spacing;
  for (std::uint64_t i = 0; i < 40; ++i) {
    const auto place = [&](std::uint64_t k) {
      // A little beyond the outline as well, where lead-ins start.
      const double x = -3.0 + side * (1.1 * random_uniform(seed, 8 * i + k) - 0.05);
      const double y = 1.25 + side * (1.1 * random_uniform(seed, 8 * i + k + 1) - 0.05);
      const double tip = cutter.drop(mm_of_ticks(ticks(x)), mm_of_ticks(ticks(y))).tip_mm;
      return ToolPosition{ticks(x), ticks(y), ticks(std::max(tip, -10.0)) + 1};
    };
    Toolpath path;
    path.start = place(0);
    const ToolPosition to = place(2);
    const LinkOptions options{1.5, 0.7, 450.0};
    append_link(path, to, surface, options);
    ASSERT_EQ(end_of(path), to);
    EXPECT_GE(least_clearance(path, field, radius, true), 1.5 - 1e-9);
    EXPECT_GE(least_clearance(path, field, radius, false), 0.7 - 1e-9);
    for (const PathMove& m : path.moves)
      if (m.kind == Kind::line) {
        EXPECT_EQ(m.feed_mm_min, 450.0);
        EXPECT_EQ(m.to, to);
      }
    if (kind == Ground::flat || kind == Ground::rolling) {
      // Slopes there stay below 0.7; widened to both sides and by half a step ahead.
      EXPECT_LE(least_clearance(path, field, radius, true), 1.5 + 0.5 * step * 0.7 * 1.5 + 2e-4);
    }
  }
}
INSTANTIATE_TEST_SUITE_P(Seeds, LinksOverGround,
                         testing::Combine(testing::ValuesIn(testing_support::kGrounds),
                                          testing::Range(1, 5)),
                         [](const auto& param) {
                           return std::string(testing_support::name(std::get<0>(param.param))) +
                                  "_seed" + std::to_string(std::get<1>(param.param));
                         });

}  // namespace
}  // namespace maquette::cnc
