// SPDX-License-Identifier: GPL-3.0-or-later

// What stock_depth.hpp claims, and how each claim is attacked:
//
//   flat ground .......... depth is the stock's thickness: closed form
//   planes ............... R (1 - cos(slope + acos(1 - t / R))): closed form
//   a bound .............. random terrain and stock, the ball's points tried one by one
//   stock from a file .... where it is void, the thickness counts
//   limits of feeds ...... every axis and the way down within the machine's

#include "cnc/stock_depth.hpp"

#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "cnc/cutter_location.hpp"
#include "cnc/feeds.hpp"
#include "core/random.hpp"

namespace maquette::cnc {
namespace {

using heightmap::ModelField;

ModelField plane(double slope) {
  ModelField f{Grid<float>(41, 41), Millimetres{0.5}, {}, {}};
  for (std::ptrdiff_t r = 0; r < 41; ++r)
    for (std::ptrdiff_t c = 0; c < 41; ++c)
      f.z_mm(r, c) = static_cast<float>(slope * 0.5 * static_cast<double>(c));
  return f;
}

TEST(StockDepth, OfPlanesIsTheClosedForm) {
  for (const double slope : {0.0, 0.25, 1.0, 2.0})
    for (const double t : {0.1, 0.5, 1.5}) {
      const StockDepth depth(plane(slope), nullptr, t, Cutter::ball(3.0));
      const double angle = std::atan(slope) + std::acos(1.0 - t / 3.0);
      const double expected = angle < std::acos(0.0) ? 3.0 * (1.0 - std::cos(angle)) : 3.0 + t;
      EXPECT_NEAR(depth.along_mm(8, 8, 12, 10), expected, 1e-5) << slope << " " << t;
      EXPECT_NEAR(depth.deepest_mm(), expected, 1e-5);
    }
  EXPECT_EQ(StockDepth(plane(1.0), nullptr, 0.0, Cutter::ball(3.0)).deepest_mm(), 0.0);
  EXPECT_NEAR(StockDepth(plane(0.0), nullptr, 0.7, Cutter::bull(6.0, 1.0)).deepest_mm(), 0.7, 1e-6);
}

TEST(StockDepth, IsABoundOnTerrain) {
  constexpr double R = 2.0;
  for (const std::uint64_t seed : {1U, 2U, 3U}) {
    ModelField design = plane(0.0), stock = plane(0.0);
    for (std::size_t i = 0; i < design.z_mm.cells().size(); ++i) {
      design.z_mm.cells()[i] = static_cast<float>(0.4 * random_uniform(seed, 2 * i));
      stock.z_mm.cells()[i] =
          design.z_mm.cells()[i] + static_cast<float>(0.8 * random_uniform(seed, 2 * i + 1));
    }
    const StockDepth depth(design, &stock, NAN, Cutter::ball(R));
    DropCutter cutter(design, BallNose{R});
    for (std::uint64_t k = 0; k < 200; ++k) {
      const double x = 4.0 + 12.0 * random_uniform(seed + 9, 2 * k);
      const double y = 4.0 + 12.0 * random_uniform(seed + 9, 2 * k + 1);
      const double tip = cutter.drop(x, y).tip_mm;
      // Highest point of the ball's underside that is inside of the stock.
      double engaged = 0.0;
      for (double dx = -R; dx <= R; dx += 0.1)
        for (double dy = -R; dy <= R; dy += 0.1) {
          const double q = R * R - dx * dx - dy * dy;
          if (q < 0.0) continue;
          const double up = R - std::sqrt(q);
          if (tip + up < heightmap::height_at(stock, x + dx, y + dy))
            engaged = std::max(engaged, up);
        }
      EXPECT_LE(engaged, depth.along_mm(x, y, x, y) + 1e-6) << seed << " " << x << " " << y;
    }
  }
}

TEST(StockDepth, VoidsOfTheStockHaveTheThickness) {
  ModelField stock = plane(0.0);
  for (float& z : stock.z_mm.cells()) z = 0.2F;
  EXPECT_NEAR(StockDepth(plane(0.0), &stock, 1.0, Cutter::ball(3.0)).deepest_mm(), 0.2, 1e-6);
  for (std::ptrdiff_t r = 30; r < 41; ++r)
    for (float& z : stock.z_mm.row(r)) z = NAN;
  const StockDepth depth(plane(0.0), &stock, 1.0, Cutter::ball(3.0));
  EXPECT_NEAR(depth.along_mm(10, 19, 10, 19), 1.0, 1e-6);
  EXPECT_NEAR(depth.along_mm(10, 2, 10, 2), 0.2, 1e-6);
}

TEST(StockDepth, FeedsAreLimitedByAxesAndPlunge) {
  Machine m = *find_machine("portal_mill_2500");
  m.max_feed_mm_min = {3000.0, 1000.0, 500.0};
  m.max_plunge_mm_min = 200.0;
  Toolpath path;
  path.start = {0, 0, 0};
  const auto go = [&](std::int64_t x, std::int64_t y, std::int64_t z) {
    PathMove move;
    move.to = {x * 10000, y * 10000, z * 10000};
    move.feed_mm_min = 2345.0;
    path.moves.push_back(move);
  };
  go(10, 0, 0);
  go(10, 10, 0);
  go(10, 10, 5);
  go(10, 10, 0);
  go(13, 14, 0);
  limit_feeds(path, m);
  EXPECT_EQ(path.moves[0].feed_mm_min, 2345.0) << "within the limits: as asked for, to the digit";
  EXPECT_NEAR(path.moves[1].feed_mm_min, 1000.0, 10.0);
  EXPECT_LE(path.moves[1].feed_mm_min, 1000.0);
  EXPECT_NEAR(path.moves[2].feed_mm_min, 500.0, 5.0);
  EXPECT_NEAR(path.moves[3].feed_mm_min, 200.0, 2.0);
  EXPECT_NEAR(path.moves[4].feed_mm_min, 1250.0, 12.0) << "y makes four fifths of it";
}

}  // namespace
}  // namespace maquette::cnc
