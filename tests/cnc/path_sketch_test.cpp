// SPDX-License-Identifier: GPL-3.0-or-later

// What path_sketch.hpp claims, and how each claim is attacked:
//
//   passes thin out to the cell, levels too .... 501 passes a tenth of a cell apart; ten levels
//   a single cut stays ......................... one among a thousand passes, above and beside them
//   all of the path has kept path near ......... random paths of lines, arcs and rapids, walked
//   deviation holds ............................ the same, the way from vertex to vertex compared
//                                                with the segment
//   means of feed and engagement ............... weighted sums against the motions'
//   no more points than asked .................. random noise that cannot be simplified
//   a slow ramp does not vanish ................ a spiral down, a hundredth of a cell a turn

#include "cnc/path_sketch.hpp"

#include <cmath>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "support/motions.hpp"

namespace maquette::cnc {
namespace {

using testing_support::Draws;
using testing_support::motions_of;
using testing_support::place_at;
using testing_support::random_arc;

Sketch sketch(const std::vector<Motion>& motions, const SketchOptions& options,
              double removed = 1.0) {
  PathSketch s(options);
  for (const Motion& m : motions) s.add(m, removed);
  return s.finish();
}

double distance(Vec3 p, Vec3 a, Vec3 b) {
  const Vec3 d = b - a;
  const double dd = dot(d, d);
  const double t = dd > 0.0 ? std::clamp(dot(p - a, d) / dd, 0.0, 1.0) : 0.0;
  return norm(p - a - t * d);
}

double cut_length(const Sketch& s) {
  double length = 0.0;
  for (const SketchRun& run : s.runs)
    for (std::size_t i = 1; i < run.points.size(); ++i)
      length += run.rapid ? 0.0 : norm(run.points[i].at_mm - run.points[i - 1].at_mm);
  return length;
}

TEST(PathSketch, PassesThinOutButASingleCutStays) {
  std::string text = "G0 X0 Y0 Z0\nF100\n";
  for (int i = 0; i <= 500; ++i)
    text += fmt::format("G1 Y{:.1f}\nX{}\n", 0.1 * i, i % 2 == 0 ? 100 : 0);
  text += "G0 Z20\nX50 Y80\nG1 Z1\nX70 Y90\nG0 Z20\nX20 Y20\nG1 Z10\nX60\nG0 Z20";
  const Sketch s = sketch(motions_of(text + "\nM2\n"), {.cell_mm = 1.0});
  // 50 or 51 passes of 100 mm, their ends, and the two cuts.
  EXPECT_GT(cut_length(s), 5000.0);
  EXPECT_LT(cut_length(s), 5700.0);
  EXPECT_LT(s.points, 1500U);
  bool beside = false, above = false;
  for (const SketchRun& run : s.runs)
    for (const SketchPoint& p : run.points) {
      beside = beside || (!run.rapid && norm(p.at_mm - Vec3{70, 90, 1}) < 1e-9);
      above = above || (!run.rapid && norm(p.at_mm - Vec3{60, 20, 10}) < 1e-9);
    }
  EXPECT_TRUE(beside && above);
}

TEST(PathSketch, LevelsStay) {
  std::string text = "G0 X0 Y0 Z0\nF100\n";
  for (int level = 0; level < 10; ++level)
    text += fmt::format("G1 Z{}\nX50\nY3\nX0\nY0\n", -5 * level);
  const Sketch s = sketch(motions_of(text + "M2\n"), {.cell_mm = 1.0});
  EXPECT_NEAR(cut_length(s), 10 * 106.0 + 45.0, 20.0) << "plunges pass what is there";
}

TEST(PathSketch, ASlowRampDoesNotVanish) {
  std::string text = "G0 X0 Y0 Z0\nF100\n";
  for (int turn = 0; turn < 1000; ++turn) text += fmt::format("G17 G3 I10 Z{:.2f}\n", -0.01 * turn);
  const Sketch s = sketch(motions_of(text + "M2\n"), {.cell_mm = 1.0});
  double lowest = 0.0;
  for (const SketchRun& run : s.runs)
    for (const SketchPoint& p : run.points) lowest = std::fmin(lowest, p.at_mm.z);
  EXPECT_LT(lowest, -9.0);
  EXPECT_GT(cut_length(s), 8 * 62.8);
  EXPECT_LT(cut_length(s), 25 * 62.8);
}

class PathSketchRandom : public testing::TestWithParam<std::uint64_t> {
 protected:
  /// Lines, arcs and rapids of the size of a cell and much larger ones; always connected.
  static std::vector<Motion> path(std::uint64_t seed, int count) {
    Draws draw(seed);
    std::vector<Motion> all;
    Vec3 at{};
    for (int i = 0; i < count; ++i) {
      Motion m;
      if (draw.pick(3) == 0) {
        m = random_arc(draw, at, draw(0.2, 8.0), 0.0, draw(-2.0, 2.0));
      } else {
        m.kind = draw.pick(6) == 0 ? Motion::Kind::rapid : Motion::Kind::line;
        m.from_mm = at;
        const double size = draw.pick(4) == 0 ? 20.0 : 1.0;
        m.to_mm = at + Vec3{draw(-size, size), draw(-size, size), 0.1 * draw(-size, size)};
        if (norm(m.to_mm) > 40.0) m.to_mm = Vec3{draw(-5.0, 5.0), draw(-5.0, 5.0), 0.0};
      }
      m.feed_mm_min = 100.0 * (1 + draw.pick(5));
      all.push_back(m);
      at = m.to_mm;
    }
    return all;
  }
};

TEST_P(PathSketchRandom, IsNearThePathAndThePathIsNearIt) {
  const auto motions = path(GetParam(), 400);
  for (const std::size_t most : {100000UL, 700UL}) {
    const SketchOptions options{.cell_mm = 2.0, .most_points = most};
    const Sketch s = sketch(motions, options);
    EXPECT_LE(s.points, most);
    EXPECT_EQ(s.left_out_mm, 0.0);
    std::vector<Vec3> cuts, rapids;  // places of the path
    for (const Motion& m : motions)
      for (int k = 0; k <= 100; ++k)
        (m.kind == Motion::Kind::rapid ? rapids : cuts).push_back(place_at(m, 0.01 * k));
    // Vertices on the path: as near as a place of these is.
    for (const SketchRun& run : s.runs) {
      const auto& places = run.rapid ? rapids : cuts;
      for (const SketchPoint& p : run.points) {
        double nearest = INFINITY;
        for (const Vec3& q : places) nearest = std::fmin(nearest, norm(q - p.at_mm));
        EXPECT_LT(nearest, 0.3) << "places are up to 0.5 mm apart";
      }
    }
    for (const bool rapid : {false, true})
      for (std::size_t i = 0; i < (rapid ? rapids : cuts).size(); i += 7) {
        const Vec3 q = (rapid ? rapids : cuts)[i];
        double nearest = INFINITY;
        for (const SketchRun& run : s.runs)
          for (std::size_t k = 1; k < run.points.size() && run.rapid == rapid; ++k)
            nearest = std::fmin(nearest, distance(q, run.points[k - 1].at_mm, run.points[k].at_mm));
        ASSERT_LE(nearest, 1.74 * options.cell_mm + s.deviation_mm);
      }
  }
}
INSTANTIATE_TEST_SUITE_P(Seeds, PathSketchRandom, testing::Values(1, 2, 3));

// A path that is new everywhere, so all of it is kept: each segment against what it stands for.
TEST(PathSketch, DeviationHoldsAndMeansAreWeighted) {
  Draws draw(5);
  std::vector<Motion> motions;
  Vec3 at{};
  double feed_length = 0.0, volume = 0.0, length = 0.0;
  PathSketch s({.cell_mm = 2.0, .most_points = 200, .longest_mm = 50.0});
  for (int i = 0; i < 2000; ++i) {
    Motion m;
    m.kind = Motion::Kind::line;
    m.from_mm = at;
    at = {at.x + 0.5, 5.0 * std::sin(0.05 * at.x) + draw(-0.1, 0.1), std::cos(0.1 * at.x)};
    m.to_mm = at;
    m.feed_mm_min = 100.0 + i;
    const double removed = draw(0.0, 1.0);
    s.add(m, removed);
    feed_length += norm(m.to_mm - m.from_mm) * m.feed_mm_min;
    length += norm(m.to_mm - m.from_mm);
    volume += removed;
    motions.push_back(m);
  }
  const Sketch result = s.finish();
  ASSERT_EQ(result.runs.size(), 1U);
  EXPECT_LE(result.points, 200U);
  EXPECT_GT(result.deviation_mm, 0.1) << "it had to give";
  const auto& points = result.runs[0].points;
  double worst = 0.0, feed_sum = 0.0, volume_sum = 0.0;
  std::size_t m = 0;
  for (std::size_t k = 1; k < points.size(); ++k) {
    double way = 0.0;
    for (; m < motions.size() && motions[m].to_mm.x <= points[k].at_mm.x + 1e-9; ++m) {
      worst = std::fmax(worst, distance(motions[m].to_mm, points[k - 1].at_mm, points[k].at_mm));
      way += norm(motions[m].to_mm - motions[m].from_mm);
    }
    feed_sum += way * points[k].feed_mm_min;
    volume_sum += way * points[k].engagement_mm2;
  }
  EXPECT_EQ(m, motions.size());
  EXPECT_LE(worst, result.deviation_mm);
  EXPECT_GT(worst, 0.2 * result.deviation_mm) << "the claim is not empty";
  EXPECT_NEAR(feed_sum, feed_length, 1e-6 * feed_length);
  EXPECT_NEAR(volume_sum, volume, 1e-6 * volume);
  EXPECT_NEAR(length, 2000 * 0.6, 400.0);
}

TEST(PathSketch, NoMorePointsThanAsked) {
  // Cuts of a cell's length all over: nothing to simplify.
  Draws draw(6);
  PathSketch s({.cell_mm = 1.0, .most_points = 500});
  for (int i = 0; i < 5000; ++i) {
    Motion m;
    m.kind = Motion::Kind::line;
    m.from_mm = {draw(0, 200), draw(0, 200), 0.0};
    m.to_mm = m.from_mm + Vec3{draw(-1, 1), draw(-1, 1), 0.0};
    m.feed_mm_min = 100.0;
    s.add(m);
  }
  const Sketch result = s.finish();
  EXPECT_LE(result.points, 500U);
  EXPECT_GT(result.points, 400U);
  EXPECT_GT(result.left_out_mm, 0.0) << "and it says so";
  EXPECT_EQ(sketch({}, {}).points, 0U);
}

}  // namespace
}  // namespace maquette::cnc
