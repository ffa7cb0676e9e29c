// SPDX-License-Identifier: GPL-3.0-or-later

// What milling_sim.hpp claims, and how each claim is attacked:
//
//   the closed form is the ball's envelope ...... groove, slope, plunge by hand; then random
//                                                 moves against a search along each move
//   precision() holds ........................... the same random moves, also steep and long
//   skipping blocks changes nothing ............. the search knows no blocks
//   order changes nothing but collisions ........ moves reversed, and in pieces: bit for bit
//   any number of threads, the same bits ........ 1 against 3
//   rapids through material are counted ......... before and after the groove is cut

#include "cnc/milling_sim.hpp"

#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include "core/random.hpp"

namespace maquette::cnc {
namespace {

constexpr double kTop = 10.0;

struct Job {
  std::ptrdiff_t rows = 150, cols = 300;  // more than one tile, not a multiple of one
  double x0 = -3.0, y0 = 2.0, cell = 0.125, radius = 3.0;
  [[nodiscard]] MillingSim sim() const { return {rows, cols, x0, y0, cell, radius, kTop}; }
  [[nodiscard]] double x(std::ptrdiff_t c) const { return x0 + cell * static_cast<double>(c); }
  [[nodiscard]] double y(std::ptrdiff_t r) const { return y0 + cell * static_cast<double>(r); }
};

Grid<float> cut(const Job& job, const std::vector<ToolMove>& moves) {
  MillingSim sim = job.sim();
  sim.cut(moves);
  return sim.take_stock();
}

// ---- closed forms ----------------------------------------------------------

// Single precision: at the depths met here, h > R / 4, an underside is steeper than 4 nowhere.
constexpr double kRounding_mm = 2e-5;

TEST(MillingSim, StraightGroove) {
  const Job job;
  const double y = 12.0, tip = 8.0;  // 2 mm deep
  const Grid<float> z = cut(job, {{{-10.0, y, tip}, {50.0, y, tip}}});
  for (std::ptrdiff_t r = 0; r < job.rows; ++r)
    for (std::ptrdiff_t c = 0; c < job.cols; ++c) {
      const double d = job.y(r) - y;
      const double under = std::abs(d) < 3.0 ? tip + 3.0 - std::sqrt(9.0 - d * d) : INFINITY;
      ASSERT_NEAR(z(r, c), std::fmin(kTop, under), kRounding_mm) << r << " " << c;
    }
}

// Rising 3 in 4: the cross-section through the axis is a line R sqrt(1 + m^2) below the
// axis of the ball's centre, sideways an ellipse.
TEST(MillingSim, SlopingMove) {
  const Job job;
  const double m = 0.75, y = 12.0;
  const Grid<float> z = cut(job, {{{-20.0, y, -9.0}, {60.0, y, 51.0}}});
  for (std::ptrdiff_t r = 0; r < job.rows; ++r)
    for (std::ptrdiff_t c = 0; c < job.cols; ++c) {
      const double d = job.y(r) - y, along = job.x(c) + 20.0;
      if (std::abs(d) > 2.9) continue;
      const double under = -9.0 + m * along + 3.0 - std::sqrt(9.0 - d * d) * std::sqrt(1.0 + m * m);
      ASSERT_NEAR(z(r, c), std::fmin(kTop, under), kRounding_mm) << r << " " << c;
    }
}

TEST(MillingSim, PlungeLeavesASphere) {
  const Job job;
  const Vec3 tip{5.0, 10.0, 9.0};
  const Grid<float> z = cut(job, {{{5.0, 10.0, 30.0}, tip}, {tip, {5.0, 10.0, 30.0}}});
  for (std::ptrdiff_t r = 0; r < job.rows; ++r)
    for (std::ptrdiff_t c = 0; c < job.cols; ++c) {
      const double d2 = std::pow(job.x(c) - tip.x, 2) + std::pow(job.y(r) - tip.y, 2);
      const double under = d2 < 9.0 ? tip.z + 3.0 - std::sqrt(9.0 - d2) : INFINITY;
      ASSERT_NEAR(z(r, c), std::fmin(kTop, under), kRounding_mm) << r << " " << c;
    }
}

// Wherever it lies within a block, a cut of 2 um is made: skipping has no slack to lose it.
TEST(MillingSim, ShallowCutsAreNotSkipped) {
  const Job job;
  for (int i = 0; i < 16; ++i)
    for (int j = 0; j < 16; ++j)
      for (const double along : {0.0, 0.4}) {
        const Vec3 tip{job.x(40) + 0.5 * job.cell * j, job.y(24) + 0.5 * job.cell * i,
                       kTop - 0.002};
        const Grid<float> z = cut(job, {{tip, tip + Vec3{along, 0.0, 0.0}}});
        const auto r = 24 + i / 2, c = 40 + j / 2;
        const double d2 = std::pow(job.x(c) - tip.x, 2) + std::pow(job.y(r) - tip.y, 2);
        ASSERT_NEAR(z(r, c), tip.z + 3.0 - std::sqrt(9.0 - d2), kRounding_mm) << i << " " << j;
      }
}

TEST(MillingSim, MovesBesideAndAboveTheStockCutNothing) {
  const Job job;
  MillingSim sim = job.sim();
  const std::vector<ToolMove> moves = {{{-100, -100, 0}, {100, -1.01, 0}},
                                       {{0, 10, 10}, {10, 12, 10}},
                                       {{-3 - 3.01, 0, -5}, {-3 - 3.01, 50, -5}},
                                       {{0, 500, 0}, {0, 500, -50}}};
  sim.cut(moves);
  EXPECT_THAT(sim.stock_mm().cells(), testing::Each(static_cast<float>(kTop)));
}

// ---- random moves against a search -----------------------------------------

/// Underside of the ball on its way, by ternary search for the lowest place: a convex
/// function of the place, so the search cannot miss. Also the height h of the ball's centre
/// above the contact.
struct Under {
  double z = INFINITY, h = 0.0;
};
Under searched(const ToolMove& move, double x, double y, double radius) {
  const Vec3 a = move.from_mm, v = move.to_mm - move.from_mm;
  const double vv = v.x * v.x + v.y * v.y;
  const auto gap2 = [&](double t) {
    return std::pow(a.x + t * v.x - x, 2) + std::pow(a.y + t * v.y - y, 2);
  };
  // The part of the move from which the ball covers the point.
  double lo = 0.0, hi = 1.0;
  if (vv > 0.0) {
    const double nearest = ((x - a.x) * v.x + (y - a.y) * v.y) / vv;
    const double left = radius * radius - gap2(nearest);
    if (left <= 0.0) return {};
    const double half = std::sqrt(left / vv);
    lo = std::fmax(0.0, nearest - half);
    hi = std::fmin(1.0, nearest + half);
    if (lo > hi) return {};
  } else if (gap2(0.0) >= radius * radius) {
    return {};
  }
  const auto height = [&](double t) {
    return a.z + t * v.z + radius - std::sqrt(std::fmax(0.0, radius * radius - gap2(t)));
  };
  for (int i = 0; i < 90; ++i) {
    const double p = lo + (hi - lo) / 3.0, q = hi - (hi - lo) / 3.0;
    (height(p) <= height(q) ? hi : lo) = height(p) <= height(q) ? q : p;
  }
  const double t = 0.5 * (lo + hi);
  return {height(t), std::sqrt(std::fmax(0.0, radius * radius - gap2(t)))};
}

std::vector<ToolMove> random_moves(std::uint64_t seed, const Job& job, int count) {
  std::vector<ToolMove> moves;
  std::uint64_t draw = 0;
  const auto uniform = [&](double lo, double hi) {
    return lo + (hi - lo) * random_uniform(seed, draw++);
  };
  const double width = job.cell * static_cast<double>(job.cols - 1);
  const double depth = job.cell * static_cast<double>(job.rows - 1);
  for (int i = 0; i < count; ++i) {
    const Vec3 a{job.x0 + uniform(-4.0, width + 4.0), job.y0 + uniform(-4.0, depth + 4.0),
                 uniform(6.0, 11.0)};
    Vec3 b = a;
    switch (i % 6) {
      case 0:  // short, as in finishing
        b = a + Vec3{uniform(-0.6, 0.6), uniform(-0.6, 0.6), uniform(-0.3, 0.3)};
        break;
      case 1:  // along an axis
        (uniform(0, 1) < 0.5 ? b.x : b.y) += uniform(-20.0, 20.0);
        b.z += uniform(-2.0, 2.0);
        break;
      case 2:  // across everything
        b = {uniform(-2000.0, 2000.0), uniform(-2000.0, 2000.0), uniform(5.0, 60.0)};
        break;
      case 3:  // steep on either side of where the sweep changes to double precision
        b = a + Vec3{uniform(-0.2, 0.2), uniform(-0.2, 0.2), uniform(-3.0, 3.0)};
        break;
      case 4:  // vertical
        b.z += uniform(-3.0, 3.0);
        break;
      default:  // nearly vertical
        b = a + Vec3{uniform(-1e-5, 1e-5), uniform(-1e-5, 1e-5), uniform(-3.0, 3.0)};
    }
    moves.push_back({a, b, false});
  }
  return moves;
}

class MillingSimRandom : public testing::TestWithParam<int> {};

TEST_P(MillingSimRandom, EqualsTheSearchWithinItsPrecision) {
  const auto seed = static_cast<std::uint64_t>(GetParam());
  const Job job{.rows = 139, .cols = 200, .cell = seed % 2 == 0 ? 0.1 : 0.23};
  MillingSim sim = job.sim();
  const std::vector<ToolMove> moves = random_moves(seed, job, 60);
  sim.cut(moves);
  const MillingSim::Precision precision = sim.precision(60.0);
  double worst = 0.0;
  std::ptrdiff_t touched = 0;
  for (std::ptrdiff_t r = 0; r < job.rows; ++r)
    for (std::ptrdiff_t c = 0; c < job.cols; ++c) {
      Under low;
      for (const ToolMove& move : moves) {
        const Under under = searched(move, job.x(c), job.y(r), job.radius);
        if (under.z < low.z) low = under;
      }
      const double z = static_cast<double>(sim.stock_mm()(r, c));
      const double expected = std::fmin(kTop, low.z);
      touched += expected < kTop;
      // A ball displaced sideways by e: its wall at height h below the centre moves by at
      // most R e / h; nearer the rim than its own displacement it may appear or not.
      const double wall = low.h > std::sqrt(4.0 * job.radius * precision.horizontal_mm)
                              ? precision.horizontal_mm * job.radius / (low.h * 0.5)
                              : std::fmax(0.0, kTop - low.z) +
                                    std::sqrt(8.0 * job.radius * precision.horizontal_mm);
      const double allowed = precision.vertical_mm + wall;
      ASSERT_LE(std::abs(z - expected), allowed) << "seed " << seed << " at " << r << " " << c;
      if (low.h > 1.0) worst = std::fmax(worst, std::abs(z - expected));
    }
  EXPECT_GT(touched, 1000);
  RecordProperty("worst_nm", static_cast<int>(worst * 1e6));
}
INSTANTIATE_TEST_SUITE_P(Seed, MillingSimRandom, testing::Range(1, 9),
                         testing::PrintToStringParamName());

TEST(MillingSim, OrderAndPiecesDoNotMatter) {
  const Job job;
  std::vector<ToolMove> moves = random_moves(77, job, 400);
  const Grid<float> once = cut(job, moves);
  MillingSim pieces = job.sim();
  for (std::size_t i = 0; i < moves.size(); i += 7)
    pieces.cut(std::span(moves).subspan(i, std::min<std::size_t>(7, moves.size() - i)));
  EXPECT_EQ(pieces.stock_mm(), once);
  std::reverse(moves.begin(), moves.end());
  EXPECT_EQ(cut(job, moves), once);
}

TEST(MillingSim, SameBitsForAnyNumberOfThreads) {
  const Job job{.rows = 500, .cols = 700};
  const std::vector<ToolMove> moves = random_moves(5, job, 3000);
  std::vector<Grid<float>> results;
  for (const std::size_t threads : {1U, 3U}) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    results.push_back(cut(job, moves));
  }
  EXPECT_EQ(results[0], results[1]);
}

// ---- rapids ----------------------------------------------------------------

TEST(MillingSim, RapidsThroughMaterialAreCountedInProgramOrder) {
  const Job job;
  const ToolMove groove{{-10, 12, 8}, {50, 12, 8}, false};
  const ToolMove rapid{{0, 12, 8}, {20, 12, 8}, true};  // crosses two tiles
  const ToolMove retract{{20, 12, 8}, {20, 12, 30}, true};
  const ToolMove high{{0, 12, 10}, {20, 12, 10}, true};
  const auto collisions = [&](const std::vector<ToolMove>& moves) {
    MillingSim sim = job.sim();
    sim.cut(moves);
    return sim.rapid_collisions();
  };
  EXPECT_EQ(collisions({groove, rapid, retract, high}), 0U);
  EXPECT_EQ(collisions({rapid, groove, retract}), 1U);
  EXPECT_EQ(collisions({rapid, rapid, retract}), 1U) << "the first one has cleared the way";
  EXPECT_EQ(collisions({retract, rapid, high}), 2U);
}

TEST(MillingSim, ARapidAtTheThresholdDepth) {
  const Job job;
  for (const double depth : {0.5 * kCollisionDepth_mm, 2.0 * kCollisionDepth_mm}) {
    MillingSim sim = job.sim();
    // A cell centre lies under the tip: x0 + 40 cells, y0 + 80 cells.
    const Vec3 low{job.x(40), job.y(80), kTop - depth};
    const std::vector<ToolMove> moves = {{low + Vec3{0, 0, 5}, low, true}};
    sim.cut(moves);
    EXPECT_EQ(sim.rapid_collisions(), depth > kCollisionDepth_mm ? 1U : 0U) << depth;
  }
}

}  // namespace
}  // namespace maquette::cnc
