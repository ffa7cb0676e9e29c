// SPDX-License-Identifier: GPL-3.0-or-later

// What milling_sim.hpp claims, and how each claim is attacked:
//
//   the closed form is the ball's envelope ...... groove, slope, plunge by hand; then random
//                                                 moves against a search along each move
//   precision() holds ........................... the same random moves, also steep and long
//   skipping blocks changes nothing ............. the search knows no blocks
//   order changes nothing but collisions ........ moves reversed, and in pieces: bit for bit
//   any number of threads, the same bits ........ 1 against 3
//   arcs, bull noses and flat ends too .......... random lines and arcs in all planes, against a
//                                                 search along the motion as the reader defines it
//   a window gets what the whole grid gets ...... four windows against the whole, bit for bit
//   removed volume .............................. a groove's cross-section; windows add up
//   rapids through material are counted ......... before and after the groove is cut
//   holders and shanks .......................... a wall at all distances and heights

#include "cnc/milling_sim.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include "cnc/tool_moves.hpp"
#include "core/random.hpp"
#include "support/motions.hpp"

namespace maquette::cnc {
namespace {

using testing_support::Draws;
using testing_support::place_at;
using testing_support::random_arc;

constexpr double kTop = 10.0;

struct Job {
  std::ptrdiff_t rows = 150, cols = 300;  // more than one tile, not a multiple of one
  double x0 = -3.0, y0 = 2.0, cell = 0.125, radius = 3.0;
  [[nodiscard]] MillingSim sim(Cutter cutter) const {
    return {{x0, y0, cell}, {std::move(cutter)}, Grid<float>(rows, cols, static_cast<float>(kTop))};
  }
  [[nodiscard]] MillingSim sim() const { return sim(Cutter::ball(radius)); }
  [[nodiscard]] double x(std::ptrdiff_t c) const { return x0 + cell * static_cast<double>(c); }
  [[nodiscard]] double y(std::ptrdiff_t r) const { return y0 + cell * static_cast<double>(r); }
};

struct Move {
  Vec3 from_mm, to_mm;
  bool rapid = false;
};

std::vector<ToolMove> tool_moves(std::span<const Move> moves) {
  std::vector<ToolMove> all;
  for (const Move& m : moves)
    all.push_back({{.from_mm = m.from_mm, .to_mm = m.to_mm},
                   m.rapid,
                   0,
                   static_cast<std::uint32_t>(all.size())});
  return all;
}

MoveEffects cut(MillingSim& sim, std::span<const Move> moves) {
  MoveEffects effects(moves.size());
  sim.cut(tool_moves(moves), effects);
  return effects;
}

Grid<float> cut(const Job& job, const std::vector<Move>& moves) {
  MillingSim sim = job.sim();
  cut(sim, moves);
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
  const std::vector<Move> moves = {{{-100, -100, 0}, {100, -1.01, 0}},
                                   {{0, 10, 10}, {10, 12, 10}},
                                   {{-3 - 3.01, 0, -5}, {-3 - 3.01, 50, -5}},
                                   {{0, 500, 0}, {0, 500, -50}}};
  cut(sim, moves);
  EXPECT_THAT(sim.stock_mm().cells(), testing::Each(static_cast<float>(kTop)));
}

// ---- random moves against a search -----------------------------------------

/// Underside of the ball on its way, by ternary search for the lowest place: a convex
/// function of the place, so the search cannot miss. Also the height h of the ball's centre
/// above the contact.
struct Under {
  double z = INFINITY, h = 0.0;
};
Under searched(const Move& move, double x, double y, double radius) {
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

std::vector<Move> random_moves(std::uint64_t seed, const Job& job, int count) {
  std::vector<Move> moves;
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
  const std::vector<Move> moves = random_moves(seed, job, 60);
  cut(sim, moves);
  const MillingSim::Precision precision = MillingSim::precision(60.0, job.radius, job.cell);
  double worst = 0.0;
  std::ptrdiff_t touched = 0;
  for (std::ptrdiff_t r = 0; r < job.rows; ++r)
    for (std::ptrdiff_t c = 0; c < job.cols; ++c) {
      Under low;
      for (const Move& move : moves) {
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
  std::vector<Move> moves = random_moves(77, job, 400);
  const Grid<float> once = cut(job, moves);
  MillingSim pieces = job.sim();
  for (std::size_t i = 0; i < moves.size(); i += 7)
    cut(pieces, std::span(moves).subspan(i, std::min<std::size_t>(7, moves.size() - i)));
  EXPECT_EQ(pieces.stock_mm(), once);
  std::reverse(moves.begin(), moves.end());
  EXPECT_EQ(cut(job, moves), once);
}

TEST(MillingSim, SameBitsForAnyNumberOfThreads) {
  const Job job{.rows = 500, .cols = 700};
  const std::vector<Move> moves = random_moves(5, job, 3000);
  std::vector<Grid<float>> results;
  for (const std::size_t threads : {1U, 3U}) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    results.push_back(cut(job, moves));
  }
  EXPECT_EQ(results[0], results[1]);
}

// ---- any cutter, any motion ---------------------------------------------------

double profile(const Cutter& c, double dist) {
  if (!(dist < c.radius_mm)) return INFINITY;
  const double e = std::fmax(0.0, dist - (c.radius_mm - c.corner_radius_mm));
  return c.corner_radius_mm -
         std::sqrt(std::fmax(0.0, c.corner_radius_mm * c.corner_radius_mm - e * e));
}

/// Underside of the cutter over (x, y): dense places of the motion, then a search around the best.
double searched_anywhere(const Motion& m, const Cutter& cutter, double x, double y) {
  constexpr int kPlaces = 1000;
  // Places out of reach of all of the motion are told by a few of its own.
  double gap = INFINITY;
  constexpr int kCoarse = 16;
  for (int i = 0; i <= kCoarse; ++i) {
    const Vec3 p = place_at(m, static_cast<double>(i) / kCoarse);
    gap = std::fmin(gap, std::hypot(p.x - x, p.y - y));
  }
  if (gap > cutter.radius_mm + length_mm(m) / kCoarse) return INFINITY;
  const auto height = [&](double share) {
    const Vec3 p = place_at(m, share);
    return p.z + profile(cutter, std::hypot(p.x - x, p.y - y));
  };
  double best = INFINITY;
  int nearest = 0;
  for (int i = 0; i <= kPlaces; ++i)
    if (const double h = height(static_cast<double>(i) / kPlaces); h < best) best = h, nearest = i;
  double lo = std::fmax(0.0, (nearest - 1.0) / kPlaces),
         hi = std::fmin(1.0, (nearest + 1.0) / kPlaces);
  for (int i = 0; i < 60; ++i) {
    const double p = lo + (hi - lo) / 3.0, q = hi - (hi - lo) / 3.0;
    const double at_p = height(p), at_q = height(q);
    best = std::fmin(best, std::fmin(at_p, at_q));
    // Of two that do not cover the place, the one nearer the best sample is kept.
    const bool left =
        std::isinf(at_p) && std::isinf(at_q) ? 0.5 * (lo + hi) * kPlaces > nearest : at_p <= at_q;
    (left ? hi : lo) = left ? q : p;
  }
  return best;
}

struct ShapeCase {
  const char* name;
  Cutter cutter;
};
class AnyCutter : public testing::TestWithParam<ShapeCase> {};

struct Compared {
  std::ptrdiff_t touched = 0, at_rim = 0;
};

/// Fails where the sweep is farther from the search than its precision allows.
void expect_equals_search(const Job& job, const Cutter& cutter, const Motion& m, int name,
                          Compared& compared) {
  std::vector<ToolMove> moves;
  append_tool_moves(m, cutter, 0, 0, moves);
  double deviation = 0.0;
  for (const ToolMove& move : moves) deviation = std::fmax(deviation, move.piece.deviation_mm);
  MillingSim sim = job.sim(cutter);
  MoveEffects effects(1);
  sim.cut(moves, effects);
  const auto precision = MillingSim::precision(kTop, cutter.radius_mm, job.cell);
  const double aside = precision.horizontal_mm + deviation + 1e-9;
  const double slack = precision.vertical_mm + deviation + kSolvedHeight_mm + 1e-7;
  for (std::ptrdiff_t r = 0; r < job.rows; ++r)
    for (std::ptrdiff_t c = 0; c < job.cols; ++c) {
      const double z = static_cast<double>(sim.stock_mm()(r, c));
      const auto expected = [&](double dx, double dy) {
        return std::fmin(kTop, searched_anywhere(m, cutter, job.x(c) + dx, job.y(r) + dy));
      };
      const double here = expected(0.0, 0.0);
      compared.touched += here < kTop;
      if (std::abs(z - here) <= slack) continue;
      // Near walls: between what the cutter does a little to all sides.
      double low = here, high = here;
      for (int k = 0; k < 8; ++k) {
        const double angle = 0.25 * std::numbers::pi * k;
        const double e = expected(aside * std::cos(angle), aside * std::sin(angle));
        low = std::fmin(low, e);
        high = std::fmax(high, e);
      }
      ++compared.at_rim;
      ASSERT_GE(z, low - slack) << "motion " << name << " at " << r << " " << c << ": " << here;
      ASSERT_LE(z, high + slack) << "motion " << name << " at " << r << " " << c << ": " << here;
    }
}

TEST_P(AnyCutter, LinesAndArcsEqualTheSearch) {
  const Cutter& cutter = GetParam().cutter;
  const Job job{.rows = 37, .cols = 41, .x0 = 0.0, .y0 = 0.0, .cell = 0.3};
  Draws draw(17);
  Compared compared;
  for (int i = 0; i < 22; ++i) {
    const Vec3 from{draw(1.0, 11.0), draw(1.0, 10.0), draw(7.0, 9.5)};
    Motion m;
    m.from_mm = from;
    if (i % 3 == 0) {
      const double rise = i % 2 == 0 ? 0.0 : draw(-2.0, 2.0);
      m.to_mm = from + Vec3{draw(-5, 5), draw(-5, 5), rise};
    } else {
      m = random_arc(draw, from, draw(0.3, 9.0), i % 4 == 0 ? 1e-4 : 0.0, i % 7 == 0 ? 0.7 : 0.0);
    }
    expect_equals_search(job, cutter, m, i, compared);
    if (HasFatalFailure()) return;
  }
  EXPECT_GT(compared.touched, 1000);
  EXPECT_LT(compared.at_rim, compared.touched / 10);
}
INSTANTIATE_TEST_SUITE_P(Shapes, AnyCutter,
                         testing::Values(ShapeCase{"ball", Cutter::ball(3.0)},
                                         ShapeCase{"smallBall", Cutter::ball(1.0)},
                                         ShapeCase{"flat", Cutter::flat(2.5)},
                                         ShapeCase{"bull", Cutter::bull(3.0, 0.75)},
                                         ShapeCase{"almostBall", Cutter::bull(2.0, 1.9)}),
                         [](const auto& p) { return p.param.name; });

/// In G18 or G19, above or below its centre; slope: an angle, in its middle.
Motion vertical_arc(ArcPlane plane, Vec3 middle, double radius, double length, double slope,
                    bool upper) {
  Motion m;
  m.kind = Motion::Kind::arc;
  m.plane = plane;
  m.feed_mm_min = 100.0;
  // From the vertical towards the way.
  const double mid = (upper ? 0.0 : std::numbers::pi) - slope, half = 0.5 * length / radius;
  const auto place = [&](double angle) {
    const double along = radius * (std::sin(angle) - std::sin(mid));
    const double up = radius * (std::cos(angle) - std::cos(mid));
    return middle + (plane == ArcPlane::zx ? Vec3{along, 0.0, up} : Vec3{0.0, along, up});
  };
  m.from_mm = place(mid - half);
  m.to_mm = place(mid + half);
  const double along = -radius * std::sin(mid), up = -radius * std::cos(mid);
  m.centre_mm = middle + (plane == ArcPlane::zx ? Vec3{along, 0.0, up} : Vec3{0.0, along, up});
  m.sweep_rad = (plane == ArcPlane::zx ? 2.0 : -2.0) * half;
  return m;
}

// Nearly straight ones too: single precision has 7 digits, a radius of 20 m and a height to 5
// nm 10.
TEST(MillingSim, TheRadiusOfAnArcCostsNoDigits) {
  const Job job{.rows = 37, .cols = 41, .x0 = 0.0, .y0 = 0.0, .cell = 0.3};
  Draws draw(29);
  Compared compared;
  for (int i = 0; i < 40; ++i) {
    const double radius = std::pow(10.0, draw(0.9, 4.3));
    const double length = std::fmin(radius, draw(0.1, 9.0)), slope = draw(-0.95, 0.95);
    const Vec3 middle{draw(1.0, 11.0), draw(1.0, 10.0), draw(7.0, 9.5)};
    const Motion m = vertical_arc(i % 2 == 0 ? ArcPlane::zx : ArcPlane::yz, middle, radius, length,
                                  slope, i % 4 < 2);
    expect_equals_search(job, Cutter::ball(3.0), m, i, compared);
    if (HasFatalFailure()) return;
  }
  EXPECT_GT(compared.touched, 1000);
  EXPECT_LT(compared.at_rim, compared.touched / 10);
}

/// Motions of all kinds with four cutters.
std::vector<ToolMove> mixed_moves(const Job& job, const std::vector<Cutter>& cutters, int count) {
  Draws draw(23);
  std::vector<ToolMove> moves;
  for (int i = 0; i < count; ++i) {
    const auto k = static_cast<std::uint16_t>(draw.pick(static_cast<int>(cutters.size())));
    const Vec3 from{job.x0 + draw(-2.0, job.cell * static_cast<double>(job.cols)),
                    job.y0 + draw(-2.0, job.cell * static_cast<double>(job.rows)), draw(6.0, 10.0)};
    Motion m;
    m.kind = i % 5 == 0 ? Motion::Kind::rapid : Motion::Kind::line;
    m.from_mm = from;
    m.to_mm = from + Vec3{draw(-9, 9), draw(-9, 9), i % 3 == 0 ? 0.0 : draw(-1, 1)};
    if (i % 2 == 0) m = random_arc(draw, from, draw(0.3, 9.0), 0.0, 0.0);
    append_tool_moves(m, cutters[k], k, static_cast<std::uint32_t>(i), moves);
  }
  return moves;
}

TEST(MillingSim, AWindowGetsWhatTheWholeGets) {
  const Job job{.rows = 333, .cols = 402, .cell = 0.1};
  std::vector<Cutter> cutters{Cutter::ball(3.0), Cutter::flat(2.0), Cutter::bull(3.0, 1.0)};
  cutters[1].flute_length_mm = 1.5;
  const auto moves = mixed_moves(job, cutters, 300);
  const SimGrid grid{job.x0, job.y0, job.cell};
  MillingSim whole(grid, cutters, Grid<float>(job.rows, job.cols, 10.0F));
  MoveEffects all(300);
  whole.cut(moves, all);
  MoveEffects sum(300);
  for (const std::ptrdiff_t r0 : {0, 136})
    for (const std::ptrdiff_t c0 : {0, 200}) {
      SimGrid window = grid;
      window.first_row = r0;
      window.first_col = c0;
      const std::ptrdiff_t rows = r0 == 0 ? 136 : job.rows - 136;
      const std::ptrdiff_t cols = c0 == 0 ? 200 : job.cols - 200;
      MillingSim part(window, cutters, Grid<float>(rows, cols, 10.0F));
      part.cut(moves, sum);
      for (std::ptrdiff_t r = 0; r < rows; ++r)
        for (std::ptrdiff_t c = 0; c < cols; ++c)
          ASSERT_EQ(part.stock_mm()(r, c), whole.stock_mm()(r0 + r, c0 + c)) << r << " " << c;
    }
  EXPECT_EQ(sum.removed, all.removed);
  EXPECT_EQ(sum.touched, all.touched);
  EXPECT_THAT(all.touched, testing::Contains(MoveEffects::kRapid));
  EXPECT_THAT(all.touched, testing::Contains(MoveEffects::kHolder));
  for (const std::size_t threads : {1U, 2U, 4U}) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    MillingSim again(grid, cutters, Grid<float>(job.rows, job.cols, 10.0F));
    MoveEffects effects(300);
    again.cut(moves, effects);
    EXPECT_EQ(again.stock_mm(), whole.stock_mm());
    EXPECT_EQ(effects.removed, all.removed);
    EXPECT_EQ(effects.touched, all.touched);
  }
}

TEST(MillingSim, RemovedVolumeIsThatOfTheGroove) {
  const Job job{.rows = 200, .cols = 400, .x0 = 0.0, .y0 = 0.0, .cell = 0.1};
  MillingSim sim = job.sim();
  // 2 mm deep from x = -10 to 50: across the whole stock of 400 cells.
  const std::vector<Move> moves = {{{-10, 10.03, 8}, {50, 10.03, 8}},
                                   {{-10, 10.03, 8}, {50, 10.03, 8}}};
  const MoveEffects effects = cut(sim, moves);
  const double half = std::sqrt(9.0 - 1.0);
  const double section = 9.0 * std::acos(1.0 / 3.0) - half * 1.0;
  const double volume = static_cast<double>(effects.removed[0]) * MoveEffects::kUnit_mm * 0.01;
  // Edges: cells are counted whole, the groove's walls are 70 degrees there.
  EXPECT_NEAR(volume, section * 40.0, 0.01 * section * 40.0);
  EXPECT_EQ(effects.removed[1], 0) << "air";
}

// ---- holder and shank ------------------------------------------------------------

// A wall from x = 20 on stands at kTop; the rest is at 0. The tool goes along y beside it.
TEST(MillingSim, HoldersTouchWhatStandsHigher) {
  const Job job{.rows = 80, .cols = 240, .x0 = 0.0, .y0 = 0.0, .cell = 0.125};
  const auto touches = [&](const Cutter& cutter, double x, double z, double dz = 0.0) {
    Grid<float> stock(job.rows, job.cols, 0.0F);
    for (std::ptrdiff_t r = 0; r < job.rows; ++r)
      for (std::ptrdiff_t c = 160; c < job.cols; ++c) stock(r, c) = static_cast<float>(kTop);
    MillingSim sim({job.x0, job.y0, job.cell}, {cutter}, stock);
    const std::vector<Move> moves = {{{x, 4.0, z}, {x, 6.0, z + dz}}};
    return (cut(sim, moves).touched[0] & MoveEffects::kHolder) != 0;
  };
  Cutter cutter = Cutter::ball(1.0);
  EXPECT_FALSE(touches(cutter, 19.5, 5.0)) << "no holder is known";
  cutter.holder = {{6.0, 20.0, 5.0, 5.0}};  // a cylinder from 6 mm above the tip
  EXPECT_TRUE(touches(cutter, 15.1, 3.0));
  EXPECT_FALSE(touches(cutter, 14.9, 3.0)) << "beside the wall";
  EXPECT_FALSE(touches(cutter, 15.1, 4.01)) << "above the wall";
  EXPECT_TRUE(touches(cutter, 15.1, 3.99, 1.0)) << "low at one end";
  EXPECT_FALSE(touches(cutter, 15.1, 4.11, 1.0));
  cutter.holder = {{6.0, 4.0, 2.0, 6.0}};  // a cone: radius 2 + (height above 6)
  EXPECT_TRUE(touches(cutter, 15.1, 1.0)) << "3 mm into the cone it is 5 wide";
  EXPECT_FALSE(touches(cutter, 14.9, 1.0));
  EXPECT_FALSE(touches(cutter, 15.1, 1.2));
  cutter.holder = {};
  cutter.flute_length_mm = 6.0;
  EXPECT_TRUE(touches(cutter, 19.2, 3.0)) << "the shank";
  EXPECT_FALSE(touches(cutter, 18.9, 3.0));
  EXPECT_FALSE(touches(cutter, 19.2, 4.5)) << "its flutes reach as far as the wall is high";
}

// ---- rapids ----------------------------------------------------------------

TEST(MillingSim, RapidsThroughMaterialAreCountedInProgramOrder) {
  const Job job;
  const Move groove{{-10, 12, 8}, {50, 12, 8}, false};
  const Move rapid{{0, 12, 8}, {20, 12, 8}, true};  // crosses two tiles
  const Move retract{{20, 12, 8}, {20, 12, 30}, true};
  const Move high{{0, 12, 10}, {20, 12, 10}, true};
  const auto collisions = [&](const std::vector<Move>& moves) {
    MillingSim sim = job.sim();
    const MoveEffects effects = cut(sim, moves);
    return std::count(effects.touched.begin(), effects.touched.end(), MoveEffects::kRapid);
  };
  EXPECT_EQ(collisions({groove, rapid, retract, high}), 0);
  EXPECT_EQ(collisions({rapid, groove, retract}), 1);
  EXPECT_EQ(collisions({rapid, rapid, retract}), 1) << "the first one has cleared the way";
  EXPECT_EQ(collisions({retract, rapid, high}), 2);
}

// Cells whose middles lie exactly on the cutter's wall, (3.6, 4.8) and the like at a radius of 6.
TEST(MillingSim, ARetractAlongAWallTouchesNothing) {
  const Job job{.rows = 150, .cols = 300, .x0 = -0.5, .y0 = 54.0, .cell = 0.1, .radius = 6.0};
  for (const Cutter& cutter : {Cutter::flat(6.0), Cutter::bull(6.0, 1.0), Cutter::ball(6.0)})
    for (const double from : {0.5, -0.5, 0.3}) {
      MillingSim sim = job.sim(cutter);
      const auto at = [&](double x, double y, double z) { return Vec3{14.5 + x, 61.5 + y, z}; };
      const std::vector<Move> moves{
          {at(from, 0, 30), at(from, 0, 8)},   {at(from, 0, 8), at(0, 0, 7.9)},
          {at(0, 0, 7.9), at(from, 0, 7.85)},  {at(from, 0, 7.85), at(0, 0, 7.8)},
          {at(0, 0, 7.8), at(0, 0, 30), true}, {at(0, 0.05, 30), at(0, 0.05, 7.7), true}};
      const MoveEffects effects = cut(sim, moves);
      EXPECT_EQ(effects.touched[4], 0) << cutter.corner_radius_mm << " from " << from;
      EXPECT_EQ(effects.touched[5], MoveEffects::kRapid) << "a twentieth beside it";
    }
}

TEST(MillingSim, ARapidAtTheThresholdDepth) {
  const Job job;
  for (const double depth : {0.5 * kCollisionDepth_mm, 2.0 * kCollisionDepth_mm}) {
    MillingSim sim = job.sim();
    // A cell centre lies under the tip: x0 + 40 cells, y0 + 80 cells.
    const Vec3 low{job.x(40), job.y(80), kTop - depth};
    const std::vector<Move> moves = {{low + Vec3{0, 0, 5}, low, true}};
    const MoveEffects effects = cut(sim, moves);
    EXPECT_EQ(effects.touched[0], depth > kCollisionDepth_mm ? MoveEffects::kRapid : 0) << depth;
  }
}

}  // namespace
}  // namespace maquette::cnc
