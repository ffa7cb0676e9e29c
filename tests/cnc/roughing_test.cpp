// SPDX-License-Identifier: GPL-3.0-or-later

// What is claimed in cnc/roughing.hpp, stock_grid.hpp, level_region.hpp, piece_order.hpp and
// cutter_shape.hpp, and how each claim is attacked (by the slow milling of milled_stock.hpp):
//
//   keeps the allowance ........... milled points against balls of the allowance's radius around
//                                   the design, on kind and harsh ground, three cutters
//   what is left .................. plane: exactly; elsewhere against the lowest level of each free
//                                   place, found by dropping the cutter on dense points
//   returned stock ................ nowhere below the milled points
//   only where stock remains ...... a second run does nothing; a bump alone is cut
//   entry angle, side entry ....... every move that goes down and takes something
//   no rapid through stock ........ every rapid
//   same bytes, errors, cancel

#include "cnc/roughing.hpp"

#include <set>
#include <stop_token>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <oneapi/tbb/global_control.h>

#include "cnc/cutter_shape.hpp"
#include "cnc/level_region.hpp"
#include "cnc/mill.hpp"
#include "cnc/piece_order.hpp"
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

RoughingOptions small_cutter() {
  RoughingOptions o;
  o.cutter = Cutter::bull(3.0, 1.0);
  o.allowance_mm = 0.5;
  o.step_down_mm = 2.0;
  o.stepover_mm = 3.0;
  o.cell_mm = 0.5;
  o.ramp_angle_deg = 5.0;
  return o;
}

StockBox box_over(const ModelField& f, double top) {
  return {f.x0.value(), f.y0.value(), f.x_mm(f.z_mm.cols() - 1), f.y_mm(f.z_mm.rows() - 1), top};
}

MilledStock milled(const StockBox& box, const Toolpath& path, const Cutter& cutter,
                   double step = 0.25) {
  MilledStock stock(box.x0_mm, box.y0_mm, step,
                    static_cast<std::ptrdiff_t>(std::lround((box.y1_mm - box.y0_mm) / step)) + 1,
                    static_cast<std::ptrdiff_t>(std::lround((box.x1_mm - box.x0_mm) / step)) + 1,
                    [&](double, double) { return box.top_mm; });
  stock.mill(path, cutter);
  return stock;
}

/// Least of (milled point - upper side of the balls of radius a around the design's points).
double least_margin(const MilledStock& stock, const ModelField& design, double a) {
  const double step = 0.125;  // dense points of the design
  double least = INFINITY;
  for (std::ptrdiff_t r = 0; r < stock.z().rows(); ++r)
    for (std::ptrdiff_t c = 0; c < stock.z().cols(); ++c) {
      const double x = stock.x(c), y = stock.y(r);
      const int n = static_cast<int>(a / step);
      for (int i = -n; i <= n; ++i)
        for (int j = -n; j <= n; ++j) {
          const double h = heightmap::height_at(design, x + step * j, y + step * i);
          const double q = a * a - step * step * (i * i + j * j);
          if (std::isnan(h) || q < 0.0) continue;
          least = std::min(least, stock.z()(r, c) - h - std::sqrt(q));
        }
    }
  return least;
}

/// Lifted so that its lowest point is at 0 and steep enough to be interesting.
ModelField relief(Ground kind, std::uint64_t seed, std::ptrdiff_t n = 61) {
  ModelField f = testing_support::ground(kind, seed, n, 0.5);
  float low = INFINITY;
  for (float& z : f.z_mm.cells()) {
    z = std::min(z * (kind == Ground::rolling ? 3.0F : 1.0F), 25.0F);
    low = std::min(low, z);
  }
  for (float& z : f.z_mm.cells()) z -= low;
  return f;
}

double highest(const ModelField& f) {
  return static_cast<double>(*std::max_element(f.z_mm.cells().begin(), f.z_mm.cells().end()));
}

// ---- closed forms ----------------------------------------------------------------------

TEST(CutterShape, UndersideIsFlatThenACircleThenNothing) {
  const Cutter bull = Cutter::bull(5.0, 2.0);
  EXPECT_EQ(underside_mm(bull, 3.0), 0.0);
  EXPECT_NEAR(underside_mm(bull, 4.2), 2.0 - 1.6, 1e-15);
  EXPECT_EQ(underside_mm(bull, 5.0), 2.0);
  EXPECT_EQ(underside_mm(bull, 5.0001), INFINITY);
  EXPECT_EQ(underside_mm(Cutter::flat(5.0), 5.0), 0.0);
  EXPECT_EQ(underside_mm(Cutter::ball(5.0), 3.0), 1.0);
}

// The moved and the grown cutter are where the original may be: points of the sum, one by one.
TEST(CutterShape, GrownCuttersContainTheOriginal) {
  const Cutter bull = Cutter::bull(5.0, 2.0);
  const double by = 0.75;
  for (int k = 0; k <= 200; ++k) {
    const double d = 0.025 * k;
    EXPECT_LE(underside_mm(moved_sideways(bull, by), d + by), underside_mm(bull, d) + 1e-12);
    for (int i = 0; i <= 40; ++i) {  // ball of radius `by` around the point of the underside
      const double t = 3.14159265358979 * (1.0 + i / 40.0);
      const double x = std::abs(d + by * std::cos(t)), z = underside_mm(bull, d) + by * std::sin(t);
      EXPECT_LE(underside_mm(with_allowance(bull, by), x) - by, z + 1e-12) << d << " " << t;
    }
  }
}

TEST(Roughing, PlaneIsLeftExactlyTheAllowance) {
  const ModelField design = flat_field(81, 121, 0.5, 5.0F);
  RoughingOptions o = small_cutter();
  o.step_down_mm = 5.0;
  const StockBox box = box_over(design, 30.0);
  const auto result = rough(design, box, o);
  ASSERT_TRUE(result) << result.error().message;
  EXPECT_EQ(result->report.levels, 5);  // 24.5 mm in steps of 5
  EXPECT_NEAR(result->report.lowest_tip_mm, 5.5, 1e-6);
  EXPECT_EQ(result->report.ramps, 0U);  // the block is entered from beside it
  const MilledStock stock = milled(box, result->path, o.cutter);
  const double scallop = underside_mm(o.cutter, 0.5 * o.stepover_mm);
  for (const double z : stock.z().cells()) {
    EXPECT_GE(z, 5.5 - 1e-9);
    EXPECT_LE(z, 5.5 + scallop + 1e-6);  // tips stand on ticks, points of the path 0.1 mm apart
  }
  EXPECT_EQ(stock.deepest_rapid, 0.0);
  EXPECT_EQ(stock.steepest_entry_deg, 0.0);
}

TEST(Roughing, TerraceIsReachedOnBothLevels) {
  ModelField design = flat_field(81, 81, 0.5, 0.0F);
  for (std::ptrdiff_t r = 0; r < 81; ++r)
    for (std::ptrdiff_t c = 41; c < 81; ++c) design.z_mm(r, c) = 10.0F;
  RoughingOptions o = small_cutter();
  const StockBox box = box_over(design, 14.0);
  const auto result = rough(design, box, o);
  ASSERT_TRUE(result) << result.error().message;
  const MilledStock stock = milled(box, result->path, o.cutter);
  // Levels 0.5, 2.5 ... 12.5: on the terrace down to the last one not below 10.5.
  const double terrace = 10.5;
  for (std::ptrdiff_t r = 0; r < stock.z().rows(); ++r)
    for (std::ptrdiff_t c = 0; c < stock.z().cols(); ++c) {
      const double x = stock.x(c), z = stock.z()(r, c);
      if (x < 20.0 - o.allowance_mm - 2.71) {  // cutter's corner, rounding to cells
        EXPECT_NEAR(z, 0.5, 0.11) << x;
      } else if (x > 20.5) {
        EXPECT_NEAR(z, terrace, 0.11) << x;
      } else if (x > 20.0 - o.allowance_mm) {
        EXPECT_GT(z, 10.0) << x;
      }
    }
  EXPECT_GE(least_margin(stock, design, o.allowance_mm), -1e-6);
}

// ---- laws on random ground ------------------------------------------------------------

struct Job {
  const char* name;
  Cutter cutter;
  double overhang;
};

class RoughingGround : public testing::TestWithParam<std::tuple<Ground, int>> {
 protected:
  static Job job(int k) {
    switch (k) {
      case 0:
        return {"bull", Cutter::bull(3.0, 1.0), NAN};
      case 1:
        return {"flatWithin", Cutter::flat(2.5), 0.0};
      default:
        return {"ball", Cutter::ball(3.0), NAN};
    }
  }
};

TEST_P(RoughingGround, KeepsTheAllowanceTakesTheRestAndEntersGently) {
  const auto [kind, k] = GetParam();
  const Job j = job(k);
  const ModelField design = relief(kind, 40 + static_cast<std::uint64_t>(k));
  RoughingOptions o = small_cutter();
  o.cutter = j.cutter;
  o.overhang_mm = j.overhang;
  if (k == 2) o.stepover_mm = 1.5;
  const StockBox box = box_over(design, highest(design) + 1.5);
  const auto result = rough(design, box, o);
  ASSERT_TRUE(result) << result.error().message;
  const MilledStock stock = milled(box, result->path, o.cutter);

  // Sampling of the design at 0.125 mm only hides gouges; path points 0.1 mm apart likewise.
  EXPECT_GE(least_margin(stock, design, o.allowance_mm), -1e-6);
  EXPECT_EQ(stock.deepest_rapid, 0.0);
  // Heights are on ticks: 1 tick in the shortest leg of half a cell.
  EXPECT_LE(stock.steepest_entry_deg, o.ramp_angle_deg + 0.03);
  EXPECT_TRUE(result->report.side_entries > 0 || k == 1);

  for (std::ptrdiff_t r = 0; r < stock.z().rows(); ++r)
    for (std::ptrdiff_t c = 0; c < stock.z().cols(); ++c) {
      const ModelField& left = result->stock;
      const auto row = std::lround((stock.y(r) - left.y0.value()) / left.spacing.value());
      const auto col = std::lround((stock.x(c) - left.x0.value()) / left.spacing.value());
      if (!left.z_mm.contains(row, col)) continue;  // the outline belongs to the cell within
      // Path points 0.1 mm apart leave ridges on the milled side: 0.05^2 / 2 r.
      EXPECT_GE(static_cast<double>(left.z_mm(row, col)), stock.z()(r, c) - 0.0013)
          << stock.x(c) << " " << stock.y(r);
    }

  // What is left: places on a lattice of 0.5 mm, the cutter dropped on dense points.
  std::set<double> levels;
  double lowest = INFINITY;  // since the last rapid: links at depth stay on their level
  for (const PathMove& m : result->path.moves) {
    const bool rapid = m.kind == PathMove::Kind::rapid;
    if (rapid && std::isfinite(lowest)) levels.insert(lowest);
    lowest = rapid ? INFINITY : std::min(lowest, mm_of_ticks(m.to.z));
  }
  ASSERT_FALSE(levels.empty());
  EXPECT_EQ(static_cast<int>(levels.size()), result->report.levels);
  double before = box.top_mm;
  for (auto level = levels.rbegin(); level != levels.rend(); ++level) {
    EXPECT_LE(before - *level, o.step_down_mm + 2e-4);
    before = *level;
  }
  // A cell is free if the cutter is anywhere in it; a place's cell is within half a diagonal.
  const double slack = o.cell_mm * 1.4143;
  const double R = o.cutter.radius_mm + o.allowance_mm + slack;
  const double corner = o.cutter.corner_radius_mm + o.allowance_mm;
  const auto under = [](double radius, double r, double d) {
    const double out = std::max(0.0, d - (radius - r));
    return r - std::sqrt(std::max(0.0, r * r - out * out));
  };
  const double lattice = 0.5;
  const auto rows = static_cast<std::ptrdiff_t>((box.y1_mm - box.y0_mm) / lattice) + 1;
  Grid<double> floor(rows, rows, INFINITY);
  for (std::ptrdiff_t r = 0; r < rows; ++r)
    for (std::ptrdiff_t c = 0; c < rows; ++c) {
      const double px = box.x0_mm + lattice * static_cast<double>(c);
      const double py = box.y0_mm + lattice * static_cast<double>(r);
      double tip = -INFINITY;
      for (double y = std::max(box.y0_mm, py - lattice * 12.0); y <= py + R; y += 0.25)
        for (double x = std::max(box.x0_mm, px - lattice * 12.0); x <= px + R; x += 0.25) {
          if (x > box.x1_mm || y > box.y1_mm) continue;
          const double d = std::hypot(x - px, y - py);
          if (d <= R) tip = std::max(tip, heightmap::height_at(design, x, y) - under(R, corner, d));
        }
      const auto level = levels.lower_bound(tip + o.allowance_mm - 1e-4);
      if (level != levels.end()) floor(r, c) = *level;
    }
  double most = -INFINITY;
  std::ptrdiff_t judged = 0;
  for (std::ptrdiff_t r = 0; r < stock.z().rows(); ++r)
    for (std::ptrdiff_t c = 0; c < stock.z().cols(); ++c) {
      double bound = INFINITY;
      const auto window = [&](std::ptrdiff_t n) {  // 4 mm around point n of 0.25 mm
        return std::pair{std::max<std::ptrdiff_t>(0, n / 2 - 8), std::min(rows, n / 2 + 9)};
      };
      for (auto [i, i1] = window(r); i < i1; ++i)
        for (auto [q, q1] = window(c); q < q1; ++q) {
          const double d = std::hypot(box.x0_mm + lattice * static_cast<double>(q) - stock.x(c),
                                      box.y0_mm + lattice * static_cast<double>(i) - stock.y(r));
          const double reach = std::max(d, 0.5 * o.stepover_mm) + 2.0 * o.cell_mm;
          if (reach > o.cutter.radius_mm) continue;
          bound = std::min(
              bound, floor(i, q) + under(o.cutter.radius_mm, o.cutter.corner_radius_mm, reach));
        }
      if (std::isinf(bound)) continue;
      ++judged;
      most = std::max(most, stock.z()(r, c) - bound);
    }
  // Over narrow pits a ball nose has no level ground at all.
  EXPECT_TRUE(judged > 100 || (kind == Ground::pits && k == 2)) << judged;
  EXPECT_LE(most, kLeastCut_mm + 1e-3);
}

std::string name_of(const testing::TestParamInfo<std::tuple<Ground, int>>& info) {
  constexpr std::array kCutters{"Bull", "FlatWithin", "Ball"};
  return std::string(testing_support::name(std::get<0>(info.param))) +
         kCutters[static_cast<std::size_t>(std::get<1>(info.param))];
}

INSTANTIATE_TEST_SUITE_P(Kinds, RoughingGround,
                         testing::Combine(testing::Values(Ground::rolling, Ground::spikes,
                                                          Ground::cliffs, Ground::knife_edges,
                                                          Ground::pits),
                                          testing::Values(0, 1, 2)),
                         name_of);

// ---- stock of an earlier operation ------------------------------------------------------

TEST(Roughing, WhatIsDoneIsNotDoneAgain) {
  const ModelField design = relief(Ground::rolling, 7);
  const RoughingOptions o = small_cutter();
  const auto first = rough(design, box_over(design, highest(design) + 3.0), o);
  ASSERT_TRUE(first);
  const auto second = rough(design, first->stock, o);
  ASSERT_TRUE(second) << second.error().message;
  // Little by little: short cuts between pieces are cuts too.
  EXPECT_LT(second->report.cutting_length_mm, 0.05 * first->report.cutting_length_mm);
  EXPECT_LT(second->report.removed_mm3, 0.001 * first->report.removed_mm3);
  // A deeper allowance taken off later finds the same floor.
  RoughingOptions less = o;
  less.allowance_mm = 0.25;
  const auto third = rough(design, first->stock, less);
  ASSERT_TRUE(third);
  EXPECT_FALSE(third->path.moves.empty());
}

TEST(Roughing, OnlyTheBumpIsCut) {
  const ModelField design = flat_field(121, 121, 0.5, 0.0F);
  ModelField stock = flat_field(121, 121, 0.5, 0.5F);
  for (std::ptrdiff_t r = 50; r <= 60; ++r)
    for (std::ptrdiff_t c = 70; c <= 80; ++c) stock.z_mm(r, c) = 4.5F;
  stock.z_mm(3, 3) = NAN;
  const RoughingOptions o = small_cutter();
  const auto result = rough(design, stock, o);
  ASSERT_TRUE(result) << result.error().message;
  EXPECT_EQ(result->report.levels, 2);
  EXPECT_EQ(result->report.ramps, 0U);
  for (const PathMove& m : result->path.moves) {
    EXPECT_LT(std::abs(mm_of_ticks(m.to.x) - 37.5), 3.0 + 3.0 + 4.0);
    EXPECT_LT(std::abs(mm_of_ticks(m.to.y) - 27.5), 3.0 + 3.0 + 4.0);
  }
  MilledStock points(0.0, 0.0, 0.25, 241, 241, [&](double x, double y) {
    const double z = heightmap::height_at(stock, x, y);
    return std::isnan(z) ? -INFINITY : z;
  });
  points.mill(result->path, o.cutter);
  EXPECT_EQ(points.deepest_rapid, 0.0);
  EXPECT_EQ(points.steepest_entry_deg, 0.0);
  for (const double z : points.z().cells()) EXPECT_LE(z, 0.5 + kLeastCut_mm);
}

TEST(Roughing, BlockThatIsTooLowIsSaid) {
  ModelField design = flat_field(41, 41, 0.5, 0.0F);
  design.z_mm(20, 20) = 7.25F;
  std::string said;
  RunContext run;
  run.warn = [&](const std::string& text) { said = text; };
  const auto result = rough(design, box_over(design, 5.0), small_cutter(), run);
  ASSERT_TRUE(result);
  EXPECT_EQ(result->report.lacking_mm, 2.25);
  EXPECT_THAT(said, testing::HasSubstr("2.250 mm"));
}

// ---- parts ----------------------------------------------------------------------------

TEST(LevelRegion, StraightPathsAgreeWithDensePoints) {
  Grid<float> tips(40, 40);
  for (std::size_t i = 0; i < tips.cells().size(); ++i)
    tips.cells()[i] = random_uniform(11, i) < 0.12 ? 1.0F : 0.0F;
  const LevelRegion region(tips, 0.5);
  int free = 0;
  for (std::uint64_t k = 0; k < 4000; ++k) {
    const auto draw = [&](std::uint64_t n) {
      return static_cast<std::int32_t>(40.0 * random_uniform(12, 4 * k + n));
    };
    const Cell a{draw(0), draw(1)}, b{draw(2), draw(3)};
    bool expected = true;
    for (int i = 0; i <= 4000; ++i) {  // a point is free if one of the closed cells it lies in is
      const double t = i / 4000.0, r = a.row + t * (b.row - a.row), c = a.col + t * (b.col - a.col);
      bool any = false;
      for (const double e : {-1e-9, 1e-9})
        for (const double f : {-1e-9, 1e-9})
          any = any || region.free(std::lround(r + e), std::lround(c + f));
      expected = expected && any;
    }
    // A cell that is only touched at a corner may be passed by dense points.
    if (region.free(a, b)) {
      EXPECT_TRUE(expected) << k;
      ++free;
    } else {
      EXPECT_TRUE(!expected || std::hypot(a.row - b.row, a.col - b.col) > 1.0) << k;
    }
    EXPECT_EQ(region.free(a, b), region.free(b, a)) << k;
  }
  EXPECT_GT(free, 100);
}

TEST(LevelRegion, RimsPassEveryCellThatHasABlockedNeighbour) {
  Grid<float> tips(30, 50);
  for (std::size_t i = 0; i < tips.cells().size(); ++i)
    tips.cells()[i] = random_uniform(21, i) < 0.3 ? 1.0F : 0.0F;
  const LevelRegion region(tips, 0.5);
  std::set<std::pair<int, int>> passed;
  for (const auto& rim : region.rims())
    for (std::size_t i = 0; i < rim.size(); ++i) {
      passed.insert({rim[i].row, rim[i].col});
      const Cell next = rim[(i + 1) % rim.size()];
      EXPECT_LE(std::max(std::abs(rim[i].row - next.row), std::abs(rim[i].col - next.col)), 1);
      EXPECT_TRUE(region.free(rim[i], next));
    }
  for (int r = 0; r < 30; ++r)
    for (int c = 0; c < 50; ++c) {
      const bool rim = region.free(r, c) && (!region.free(r + 1, c) || !region.free(r - 1, c) ||
                                             !region.free(r, c + 1) || !region.free(r, c - 1));
      EXPECT_EQ(passed.contains({r, c}), rim) << r << " " << c;
    }
}

TEST(PieceOrder, TakesTheNearestEnd) {
  PieceOrder order(0.0, 0.0, 100.0, 60.0, 7.0);
  std::vector<std::array<double, 4>> pieces;
  for (std::uint64_t k = 0; k < 300; ++k) {
    pieces.push_back({100.0 * random_uniform(3, 4 * k), 60.0 * random_uniform(3, 4 * k + 1),
                      100.0 * random_uniform(3, 4 * k + 2), 60.0 * random_uniform(3, 4 * k + 3)});
    order.add(pieces[k][0], pieces[k][1], pieces[k][2], pieces[k][3]);
  }
  std::vector<bool> taken(pieces.size(), false);
  double x = 0.0, y = 0.0;
  while (order.left() > 0) {
    const PieceOrder::End end = order.take_nearest(x, y);
    double best = INFINITY;
    for (std::size_t k = 0; k < pieces.size(); ++k)
      for (const std::size_t e : {0U, 2U})
        if (!taken[k]) best = std::min(best, std::hypot(pieces[k][e] - x, pieces[k][e + 1] - y));
    const auto& p = pieces[end.piece];
    const std::size_t e = end.last ? 2 : 0;
    EXPECT_FALSE(taken[end.piece]);
    EXPECT_NEAR(std::hypot(p[e] - x, p[e + 1] - y), best, 1e-12);
    taken[end.piece] = true;
    x = p[2 - e], y = p[3 - e];
  }
}

// ---- contract --------------------------------------------------------------------------

TEST(Roughing, SameMovesForAnyNumberOfThreads) {
  const ModelField design = relief(Ground::cliffs, 5);
  const StockBox box = box_over(design, highest(design) + 2.0);
  std::vector<Roughing> results;
  for (const std::size_t threads : {1U, 3U}) {
    const oneapi::tbb::global_control limit(oneapi::tbb::global_control::max_allowed_parallelism,
                                            threads);
    results.push_back(*rough(design, box, small_cutter()));
  }
  ASSERT_EQ(results[0].path.moves.size(), results[1].path.moves.size());
  for (std::size_t i = 0; i < results[0].path.moves.size(); ++i)
    EXPECT_EQ(results[0].path.moves[i].to, results[1].path.moves[i].to) << i;
}

TEST(Roughing, RefusesWhatMakesNoSense) {
  const ModelField design = flat_field(41, 41, 0.5, 0.0F);
  const StockBox box = box_over(design, 5.0);
  const auto with = [&](auto change) {
    RoughingOptions o = small_cutter();
    change(o);
    return rough(design, box, o);
  };
  const auto code = kRoughingOptionOutOfRange;  // CNC_ROUGHING_OPTION_OUT_OF_RANGE
  EXPECT_THAT(with([](auto& o) { o.cutter.radius_mm = 0.0; }), FailsWith(code));
  EXPECT_THAT(with([](auto& o) { o.cutter.corner_radius_mm = 4.0; }), FailsWith(code));
  EXPECT_THAT(with([](auto& o) { o.allowance_mm = -0.1; }), FailsWith(code));
  EXPECT_THAT(with([](auto& o) { o.step_down_mm = 0.0; }), FailsWith(code));
  EXPECT_THAT(with([](auto& o) { o.stepover_mm = 0.0; }), FailsWith(code));
  EXPECT_THAT(with([](auto& o) { o.stepover_mm = 5.5; }), FailsWith(code));
  EXPECT_THAT(with([](auto& o) { o.cell_mm = NAN; }), FailsWith(code));
  EXPECT_THAT(with([](auto& o) { o.overhang_mm = -1.0; }), FailsWith(code));
  EXPECT_THAT(with([](auto& o) { o.ramp_angle_deg = 0.0; }), FailsWith(code));
  EXPECT_THAT(with([](auto& o) { o.feed_mm_min = 0.0; }), FailsWith(code));
  EXPECT_THAT(with([](auto& o) { o.plunge_feed_mm_min = INFINITY; }), FailsWith(code));
  EXPECT_THAT(with([](auto& o) { o.clearance_mm = -1.0; }), FailsWith(code));
  EXPECT_THAT(rough(design, StockBox{0.0, 0.0, 0.0, 9.0, 5.0}, small_cutter()), FailsWith(code));
  EXPECT_THAT(rough(design, StockBox{0.0, 0.0, 1e5, 1e5, 5.0}, small_cutter()), FailsWith(code));
  ModelField hole = design;
  hole.z_mm(4, 7) = NAN;
  EXPECT_THAT(rough(hole, box, small_cutter()), FailsWith(kHeightNotFinite));
  std::stop_source source;
  source.request_stop();
  RunContext run;
  run.stop = source.get_token();
  EXPECT_THAT(rough(design, box, small_cutter(), run), FailsWith(kCancelled));
}

}  // namespace
}  // namespace maquette::cnc
