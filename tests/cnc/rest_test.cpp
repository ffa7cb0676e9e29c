// SPDX-License-Identifier: GPL-3.0-or-later

// What is claimed in cnc/rest.hpp and semi_finish.hpp, and how each claim is attacked:
//
//   what stays .................... groove: closed form; elsewhere a ball put down at random places
//                                   around each node finds nothing lower; ground the ball fits
//                                   everywhere gives none
//   area and volume ............... counted again; groove: integral of the closed form
//   takes it away ................. milled point by point: where the map has something, what the
//                                   smaller ball can reach is gone; elsewhere nothing is touched
//   layers ........................ greatest bite on the way
//   gouge ......................... milled points against the design
//   no rapid through stock ........ milled point by point from what the first ball leaves
//   semi-finish ................... plane and random ground: the allowance stays, in space, and no
//                                   more than the ridges above it
//   surface over squares .......... random squares, random points
//   same moves, errors, cancel

#include "cnc/rest.hpp"

#include <map>
#include <numbers>
#include <stop_token>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <oneapi/tbb/global_control.h>

#include "cnc/cutter_location.hpp"
#include "cnc/semi_finish.hpp"
#include "cnc/stock_grid.hpp"
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

ToolpathSink into(Toolpath& path) {
  return [&path](const Toolpath& piece) -> Result<void> {
    if (path.moves.empty()) {
      path.start = piece.start;
    } else {
      EXPECT_EQ(piece.start, path.moves.back().to);
    }
    path.moves.insert(path.moves.end(), piece.moves.begin(), piece.moves.end());
    return {};
  };
}

/// Sides of slope m meet at y = 10; along x.
ModelField groove(double m, double spacing = 0.25) {
  const auto n = static_cast<std::ptrdiff_t>(20.0 / spacing) + 1;
  ModelField f = flat_field(n, n / 2, spacing, 0.0F);
  for (std::ptrdiff_t r = 0; r < n; ++r)
    for (std::ptrdiff_t c = 0; c < n / 2; ++c)
      f.z_mm(r, c) = static_cast<float>(m * std::abs(f.y_mm(r) - 10.0));
  return f;
}

RestOptions lines_only() {
  RestOptions o;
  o.arcs = false;
  return o;
}

// ---- the map ---------------------------------------------------------------------------

TEST(RestMap, GrooveKeepsWhatTheClosedFormSays) {
  const double m = 1.0, R = 3.0;
  const ModelField design = groove(m);
  const auto map = map_rest(design, {R}, Millimetres{0.05});
  ASSERT_TRUE(map) << map.error().message;
  // The ball in the groove touches both sides at R sin(theta) from the middle; under it stays
  // R / cos(theta) - sqrt(R^2 - t^2) - m |t|.
  const double half = R * std::numbers::sqrt2 / 2.0;
  const double slack = std::pow(0.25 / 16.0, 2) / (2.0 * R * std::pow(0.5, 1.5));
  for (std::ptrdiff_t r = 0; r < design.z_mm.rows(); ++r) {
    const double t = std::abs(design.y_mm(r) - 10.0);
    const double expected =
        t < half ? R * std::numbers::sqrt2 - std::sqrt(R * R - t * t) - m * t : 0.0;
    if (design.y_mm(r) < 4.0 || design.y_mm(r) > 16.0) continue;  // the ball stays on the outline
    for (std::ptrdiff_t c = 16; c < design.z_mm.cols() - 16; ++c) {
      const auto z = static_cast<double>(map->remaining.z_mm(r, c));
      EXPECT_GE(z, expected - 1e-6);
      // Where little stays the search stops early.
      EXPECT_LE(z, std::max(expected + slack + 1e-6, 0.05)) << t;
    }
  }
  EXPECT_NEAR(map->highest_mm, R * (std::numbers::sqrt2 - 1.0), 1e-3);
  double area = 0.0, volume = 0.0;
  for (const float z : map->remaining.z_mm.cells())
    if (z > 0.05F) area += 0.0625, volume += 0.0625 * static_cast<double>(z);
  EXPECT_NEAR(map->area_mm2, area, 1e-9);
  EXPECT_NEAR(map->volume_mm3, volume, 1e-6);
}

TEST(RestMap, NoBallFindsALowerPlace) {
  const ModelField design = testing_support::ground(Ground::rolling, 8, 61, 0.5);
  const double R = 2.5;
  const auto map = map_rest(design, {R}, Millimetres{0.03});
  ASSERT_TRUE(map);
  ASSERT_GT(map->area_mm2, 1.0);
  DropCutter cutter(design, Cutter::ball(R));
  double worst = -INFINITY;
  for (std::uint64_t k = 0; k < 200000; ++k) {
    const auto r = static_cast<std::ptrdiff_t>(61.0 * random_uniform(1, 4 * k));
    const auto c = static_cast<std::ptrdiff_t>(61.0 * random_uniform(1, 4 * k + 1));
    const double away = R * std::sqrt(random_uniform(1, 4 * k + 2));
    const double turn = 6.283185307179586 * random_uniform(1, 4 * k + 3);
    const double px = design.x_mm(c) + away * std::cos(turn);
    const double py = design.y_mm(r) + away * std::sin(turn);
    if (px < design.x_mm(0) || px > design.x_mm(60) || py < design.y_mm(0) || py > design.y_mm(60))
      continue;
    const double here = cutter.drop(px, py).tip_mm + R - std::sqrt(R * R - away * away) -
                        static_cast<double>(design.z_mm(r, c));
    EXPECT_GE(here, -1e-6);
    const auto mapped = static_cast<double>(map->remaining.z_mm(r, c));
    if (mapped > 0.03) worst = std::max(worst, mapped - here);
  }
  // The claim for slopes up to 60 degrees.
  EXPECT_LE(worst, 0.005);

  // Nor does the map: dense places around some nodes, denser around the best of them.
  int judged = 0;
  for (std::ptrdiff_t k = 0; k < 61 * 61 && judged < 30; k += 7) {
    const std::ptrdiff_t r = k / 61, c = k % 61;
    const auto mapped = static_cast<double>(map->remaining.z_mm(r, c));
    if (mapped <= 0.03 || std::min({r, c, 60 - r, 60 - c}) < 6) continue;
    ++judged;
    double least = INFINITY, at_x = design.x_mm(c), at_y = design.y_mm(r);
    for (const double step : {0.25, 0.05, 0.01, 0.002}) {
      const double x = at_x, y = at_y;
      for (int i = -10; i <= 10; ++i)
        for (int j = -10; j <= 10; ++j) {
          const double px = x + step * j, py = y + step * i;
          const double q =
              R * R - std::pow(px - design.x_mm(c), 2) - std::pow(py - design.y_mm(r), 2);
          if (q < 0.0) continue;
          const double here = cutter.drop(px, py).tip_mm + R - std::sqrt(q) -
                              static_cast<double>(design.z_mm(r, c));
          if (here < least) least = here, at_x = px, at_y = py;
        }
    }
    EXPECT_NEAR(mapped, least, 0.005) << r << " " << c;
    EXPECT_GE(mapped, least - 1e-4);
  }
  EXPECT_EQ(judged, 30);
}

TEST(RestMap, NothingStaysWhereTheBallFits) {
  ModelField f = flat_field(61, 61, 0.5, 0.0F);
  for (std::ptrdiff_t r = 0; r < 61; ++r)
    for (std::ptrdiff_t c = 0; c < 61; ++c)  // curvature radius 10 mm and more
      f.z_mm(r, c) =
          static_cast<float>(0.5 * (std::cos(f.x_mm(c) / 2.5) + std::sin(f.y_mm(r) / 2.5)));
  const auto map = map_rest(f, {3.0}, Millimetres{0.05});
  ASSERT_TRUE(map);
  // On the rim a slope that faces outwards keeps something: the axis stays over the outline.
  EXPECT_GT(map->area_mm2, 0.0);
  for (std::ptrdiff_t r = 6; r < 55; ++r)
    for (std::ptrdiff_t c = 6; c < 55; ++c) EXPECT_LE(map->remaining.z_mm(r, c), 0.05F);
}

TEST(Rest, NothingIsCutWhereNothingStays) {
  const ModelField f = flat_field(31, 31, 0.5, 2.0F);
  const auto map = map_rest(f, {3.0});
  ASSERT_TRUE(map);
  EXPECT_EQ(map->area_mm2, 0.0);
  Toolpath path;
  const auto report = rest_finish(f, *map, lines_only(), into(path));
  ASSERT_TRUE(report);
  EXPECT_EQ(report->passes, 0U);
  EXPECT_TRUE(path.moves.empty());
}

// ---- the passes ------------------------------------------------------------------------

class RestGround : public testing::TestWithParam<int> {};

TEST_P(RestGround, TakesWhatTheFirstBallLeftAndNothingElse) {
  ModelField design =
      GetParam() == 0
          ? groove(1.5)
          : testing_support::ground(GetParam() == 1 ? Ground::cliffs : Ground::rolling, 5, 61, 0.5);
  for (float& z : design.z_mm.cells()) z = GetParam() == 1 ? std::min(z, 11.0F) : z;
  const double R = 3.0, small = 1.0;
  const auto map = map_rest(design, {R}, Millimetres{0.05});
  ASSERT_TRUE(map);
  ASSERT_GT(map->area_mm2, 5.0);
  RestOptions o = lines_only();
  o.ball_radius_mm = small;
  o.depth_mm = 1.0;
  Toolpath path;
  const auto report = rest_finish(design, *map, o, into(path));
  ASSERT_TRUE(report) << report.error().message;
  EXPECT_GT(report->links_cut, report->links_flown);
  EXPECT_EQ(report->layers, static_cast<int>(std::ceil(map->highest_mm)));
  EXPECT_LE(report->certified_gouge_mm, o.tolerance_mm);

  ModelField before = map->remaining;
  for (std::size_t i = 0; i < before.z_mm.cells().size(); ++i)
    before.z_mm.cells()[i] += design.z_mm.cells()[i];
  const double step = 0.25;
  const auto count = [&](std::ptrdiff_t n) {
    return static_cast<std::ptrdiff_t>(
               std::floor(static_cast<double>(n - 1) * design.spacing.value() / step + 1e-9)) +
           1;
  };
  MilledStock stock(design.x0.value(), design.y0.value(), step, count(design.z_mm.rows()),
                    count(design.z_mm.cols()),
                    [&](double x, double y) { return heightmap::height_at(before, x, y); });
  stock.mill(path, Cutter::ball(small), 0.1);
  EXPECT_EQ(stock.deepest_rapid, 0.0);

  // What the smaller ball leaves at best, by its own map; ridges of its passes on a slope t:
  // (stepover / cos t)^2 / 8 r / cos t vertically, t up to 57 degrees on the groove.
  const auto best = map_rest(design, {small}, Millimetres{1e-3});
  ASSERT_TRUE(best);
  const double ridge = GetParam() == 0 ? 0.04 : 0.05;
  for (std::ptrdiff_t r = 0; r < design.z_mm.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < design.z_mm.cols(); ++c) {
      const auto i = std::lround((design.y_mm(r) - design.y0.value()) / step);
      const auto j = std::lround((design.x_mm(c) - design.x0.value()) / step);
      const double z = stock.z()(i, j), h = static_cast<double>(design.z_mm(r, c));
      EXPECT_GE(z, h - report->certified_gouge_mm - 1e-6);
      // Beside cliffs a ridge is as steep as the wall: judged on the groove and rolling ground.
      if (GetParam() != 1 && static_cast<double>(map->remaining.z_mm(r, c)) > 0.05) {
        EXPECT_LE(z, h + static_cast<double>(best->remaining.z_mm(r, c)) + ridge)
            << design.x_mm(c) << " " << design.y_mm(r);
      }
    }
  // All of it: rows pass every node within reach of one where something stays.
  std::map<std::int64_t, std::vector<std::pair<double, double>>> cut;  // row: from, to
  ToolPosition at = path.start;
  for (const PathMove& m : path.moves) {
    if (m.kind == PathMove::Kind::line && m.to.y == at.y)
      cut[at.y].push_back(std::minmax(mm_of_ticks(at.x), mm_of_ticks(m.to.x)));
    at = m.to;
  }
  for (std::ptrdiff_t r = 0; r < design.z_mm.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < design.z_mm.cols(); ++c) {
      bool wanted = false;
      const auto n = static_cast<std::ptrdiff_t>((small + o.overlap_mm) / design.spacing.value());
      for (std::ptrdiff_t i = -n; i <= n; ++i)
        for (std::ptrdiff_t j = -n; j <= n; ++j)
          wanted =
              wanted || (i * i + j * j <= n * n && map->remaining.z_mm.contains(r + i, c + j) &&
                         map->remaining.z_mm(r + i, c + j) > 0.05F);
      const auto row = cut.lower_bound(std::llround((design.y_mm(r) - 1e-6) * 1e4));
      if (!wanted || row == cut.end() || mm_of_ticks(row->first) > design.y_mm(r) + 0.2) continue;
      bool passed = false;
      for (const auto& [from, to] : row->second)
        passed = passed || (design.x_mm(c) >= from - 1e-3 && design.x_mm(c) <= to + 1e-3);
      EXPECT_TRUE(passed) << design.x_mm(c) << " " << design.y_mm(r);
    }
  // Only there: every place is within reach of a node where something stays.
  for (const PathMove& m : path.moves) {
    double nearest = INFINITY;
    for (std::ptrdiff_t r = 0; r < design.z_mm.rows(); ++r)
      for (std::ptrdiff_t c = 0; c < design.z_mm.cols(); ++c)
        if (map->remaining.z_mm(r, c) > 0.05F)
          nearest = std::min(nearest, std::hypot(design.x_mm(c) - mm_of_ticks(m.to.x),
                                                 design.y_mm(r) - mm_of_ticks(m.to.y)));
    EXPECT_LE(nearest, small + o.overlap_mm + 2.0 * design.spacing.value() +
                           (4.0 * o.stepover_mm + 2.0 * design.spacing.value()));
    if (testing::Test::HasFailure()) break;
  }
}

std::string name_of(const testing::TestParamInfo<int>& info) {
  constexpr std::array kNames{"groove", "cliffs", "rolling"};
  return kNames[static_cast<std::size_t>(info.param)];
}
INSTANTIATE_TEST_SUITE_P(Grounds, RestGround, testing::Values(0, 1, 2), name_of);

TEST(Rest, SameMovesForAnyNumberOfThreads) {
  const ModelField design = testing_support::ground(Ground::rolling, 5, 61, 0.5);
  std::vector<Toolpath> paths(2);
  for (const std::size_t threads : {1U, 3U}) {
    const oneapi::tbb::global_control limit(oneapi::tbb::global_control::max_allowed_parallelism,
                                            threads);
    const auto map = map_rest(design, {3.0});
    ASSERT_TRUE(map);
    ASSERT_TRUE(rest_finish(design, *map, {}, into(paths[threads / 2])));
  }
  ASSERT_EQ(paths[0].moves.size(), paths[1].moves.size());
  ASSERT_GT(paths[0].moves.size(), 100U);
  for (std::size_t i = 0; i < paths[0].moves.size(); ++i)
    EXPECT_EQ(paths[0].moves[i].to, paths[1].moves[i].to) << i;
}

TEST(Rest, RefusesWhatMakesNoSense) {
  const ModelField design = groove(1.0);
  const auto code = kRestOptionOutOfRange;  // CNC_REST_OPTION_OUT_OF_RANGE
  EXPECT_THAT(map_rest(design, {0.0}), FailsWith(code));
  EXPECT_THAT(map_rest(design, {3.0}, Millimetres{0.0}), FailsWith(code));
  ModelField hole = design;
  hole.z_mm(4, 7) = NAN;
  EXPECT_THAT(map_rest(hole, {3.0}), FailsWith(kHeightNotFinite));
  const auto map = map_rest(design, {3.0});
  ASSERT_TRUE(map);
  const auto with = [&](auto change) {
    RestOptions o;
    change(o);
    Toolpath path;
    return rest_finish(design, *map, o, into(path));
  };
  EXPECT_THAT(with([](auto& o) { o.ball_radius_mm = 0.0; }), FailsWith(code));
  EXPECT_THAT(with([](auto& o) { o.stepover_mm = 0.0; }), FailsWith(code));
  EXPECT_THAT(with([](auto& o) { o.overlap_mm = -1.0; }), FailsWith(code));
  EXPECT_THAT(with([](auto& o) { o.depth_mm = 0.0; }), FailsWith(code));
  EXPECT_THAT(with([](auto& o) { o.tolerance_mm = NAN; }), FailsWith(code));
  EXPECT_THAT(with([](auto& o) { o.feed_mm_min = 0.0; }), FailsWith(code));
  EXPECT_THAT(with([](auto& o) { o.plunge_feed_mm_min = 0.0; }), FailsWith(code));
  EXPECT_THAT(with([](auto& o) { o.clearance_mm = -1.0; }), FailsWith(code));
  std::stop_source source;
  source.request_stop();
  RunContext run;
  run.stop = source.get_token();
  Toolpath path;
  EXPECT_THAT(map_rest(design, {3.0}, Millimetres{0.05}, run), FailsWith(kCancelled));
  EXPECT_THAT(rest_finish(design, *map, {}, into(path), run), FailsWith(kCancelled));
  const auto full = [](const Toolpath&) -> Result<void> { return fail(kCancelled, "full"); };
  EXPECT_THAT(rest_finish(design, *map, {}, full), FailsWith(kCancelled));
}

// ---- semi-finish -----------------------------------------------------------------------

MillOptions semi_options(double diameter, double stepover) {
  MillOptions o;
  o.ball_diameter = Millimetres{diameter};
  o.stepover = Millimetres{stepover};
  o.arcs = false;
  return o;
}

TEST(SemiFinish, PlaneKeepsTheAllowanceAndTheRidges) {
  ModelField design = flat_field(61, 61, 0.5, 0.0F);
  for (std::ptrdiff_t r = 0; r < 61; ++r)
    for (std::ptrdiff_t c = 0; c < 61; ++c)
      design.z_mm(r, c) = static_cast<float>(0.75 * design.y_mm(r));
  Toolpath path;
  const auto report = semi_finish(design, semi_options(6.0, 1.0), Millimetres{0.5}, into(path));
  ASSERT_TRUE(report) << report.error().message;
  MilledStock stock(5.0, 5.0, 0.1, 201, 101, [](double, double y) { return 0.75 * y + 2.0; });
  stock.mill(path, Cutter::ball(3.0), 0.1);
  // cos(theta) = 0.8; rows 1 mm apart in plan are 1.25 mm apart on the plane.
  const double ridge = 3.0 - std::sqrt(9.0 - 0.625 * 0.625);
  double least = INFINITY, most = -INFINITY;
  for (std::ptrdiff_t r = 0; r < 201; ++r)
    for (std::ptrdiff_t c = 0; c < 101; ++c) {
      const double normal = 0.8 * (stock.z()(r, c) - 0.75 * stock.y(r));
      least = std::min(least, normal), most = std::max(most, normal);
    }
  EXPECT_GE(least, 0.5 - report->certified_gouge_mm);
  EXPECT_LE(least, 0.5 + report->certified_excess_mm + 0.001);
  EXPECT_NEAR(most, 0.5 + ridge, 0.01);
  EXPECT_NEAR(report->scallop_flat_mm, 3.0 - std::sqrt(9.0 - 0.25), 1e-12);
}

TEST(SemiFinish, KeepsTheDistanceOnRandomGround) {
  const ModelField design = testing_support::ground(Ground::rolling, 3, 41, 0.5);
  ModelField before = design;
  for (float& z : before.z_mm.cells()) z += 3.0F;
  MillOptions o = semi_options(4.0, 0.5);
  o.stock = &before;
  const double a = 0.4;
  Toolpath path;
  const auto report = semi_finish(design, o, Millimetres{a}, into(path));
  ASSERT_TRUE(report) << report.error().message;
  MilledStock stock(design.x0.value(), design.y0.value(), 0.25, 81, 81,
                    [&](double x, double y) { return heightmap::height_at(before, x, y); });
  stock.mill(path, Cutter::ball(2.0), 0.1);
  EXPECT_EQ(stock.deepest_rapid, 0.0);
  double least = INFINITY;
  for (std::ptrdiff_t r = 0; r < 81; ++r)
    for (std::ptrdiff_t c = 0; c < 81; ++c)
      for (int i = -8; i <= 8; ++i)
        for (int j = -8; j <= 8; ++j) {  // balls of the allowance's radius around the design
          const double q = a * a - 0.0025 * (i * i + j * j);
          const double h =
              heightmap::height_at(design, stock.x(c) + 0.05 * j, stock.y(r) + 0.05 * i);
          if (q >= 0.0 && !std::isnan(h))
            least = std::min(least, stock.z()(r, c) - h - std::sqrt(q));
        }
  EXPECT_GE(least, -report->certified_gouge_mm);
  EXPECT_LE(least, 0.01);
  EXPECT_THAT(semi_finish(design, o, Millimetres{-0.1}, into(path)),
              FailsWith(kMillOptionOutOfRange));
}

TEST(SurfaceOver, IsNowhereBelowTheSquares) {
  ModelField squares = flat_field(30, 40, 0.5, 0.0F);
  for (std::size_t i = 0; i < squares.z_mm.cells().size(); ++i)
    squares.z_mm.cells()[i] =
        random_uniform(4, i) < 0.1 ? NAN : static_cast<float>(random_uniform(5, i));
  const ModelField over = surface_over(squares);
  for (std::uint64_t k = 0; k < 20000; ++k) {
    const double x = 19.5 * random_uniform(6, 2 * k), y = 14.5 * random_uniform(6, 2 * k + 1);
    const float z = squares.z_mm(std::lround(y / 0.5), std::lround(x / 0.5));
    if (std::isnan(z)) continue;
    EXPECT_GE(heightmap::height_at(over, x, y), static_cast<double>(z) - 1e-6);
  }
}

}  // namespace
}  // namespace maquette::cnc
