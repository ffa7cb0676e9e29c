// SPDX-License-Identifier: GPL-3.0-or-later

// What is claimed in cnc/fit_moves.hpp, and how it is attacked:
//
//   gouge and excess ......... thousands of random runs of samples with random bounds between
//                              them; every written line and arc evaluated by angle, at and between
//                              samples
//   between samples .......... the curve is as wrong as its bounds allow, at every place
//   vertex: one exact arc .... samples of a circle; of a sphere's pass; of a plane: one move
//   radii, slopes ............ of every arc: within limits, on the resolution, less than half a
//                              turn, both ends on the same half of the circle
//   ends ..................... both at the samples' height, rounded up; lines that meet do so
//   reverse .................. the same path, the other way round; twice is the identity
//   machine coordinates ...... G18 and G19, both directions, by evaluating the arcs in space

#include "cnc/fit_moves.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/check.hpp"
#include "core/random.hpp"

namespace maquette::cnc {
namespace {

using Shape = FittedMove::Shape;

constexpr double kStep = 0.001;

double along_mm(std::int64_t place) {
  return kStep * static_cast<double>(place);
}

struct Centre {
  double t = 0.0, z = 0.0, radius = 0.0;
};
/// By angles, not by the formula under test: the chord seen from the centre has half its length
/// over the radius as the sine of half the sweep.
Centre centre_of(const FittedMove& from, const FittedMove& m) {
  const double t0 = along_mm(from.place), z0 = mm_of_ticks(from.z);
  const double dt = along_mm(m.place) - t0, dz = mm_of_ticks(m.z) - z0;
  const double r = mm_of_ticks(m.radius), half_sweep = std::asin(0.5 * std::hypot(dt, dz) / r);
  // From the start, the centre lies at this angle from the chord, below it or above.
  const double away = 0.5 * std::numbers::pi - half_sweep;
  const double angle = std::atan2(dz, dt) + ((m.shape == Shape::over) == (dt > 0.0) ? -away : away);
  return {t0 + r * std::cos(angle), z0 + r * std::sin(angle), r};
}

/// Height of a move at t.
double height(const FittedMove& from, const FittedMove& m, double t) {
  const double t0 = along_mm(from.place), z0 = mm_of_ticks(from.z);
  if (m.shape == Shape::line) {
    const double q = (t - t0) / (along_mm(m.place) - t0);
    return z0 + q * (mm_of_ticks(m.z) - z0);
  }
  const Centre c = centre_of(from, m);
  const double angle = std::acos(std::clamp((t - c.t) / c.radius, -1.0, 1.0));
  return c.z + (m.shape == Shape::over ? c.radius : -c.radius) * std::sin(angle);
}

void expect_arc_limits(const FittedMove& from, const FittedMove& m, const FitLimits& limits) {
  const double t = along_mm(m.place - from.place), z = mm_of_ticks(m.z - from.z);
  const double r = mm_of_ticks(m.radius);
  EXPECT_GE(r, limits.least_radius_mm);
  EXPECT_LE(r, limits.greatest_radius_mm);
  EXPECT_LE(std::hypot(t, z), 1.95 * r);
  EXPECT_EQ(m.radius % kResolution, 0);
  const Centre c = centre_of(from, m);
  EXPECT_EQ(m.shape == Shape::over, mm_of_ticks(from.z) > c.z);
  EXPECT_EQ(m.shape == Shape::over, mm_of_ticks(m.z) > c.z) << "both ends on the same half";
}

/// Samples, and how far the curve may be off between them.
struct Curve {
  std::vector<PathSample> samples;
  [[nodiscard]] double chord(std::size_t k, double q) const {
    return samples[k].tip_mm + q * (samples[k + 1].tip_mm - samples[k].tip_mm);
  }
  [[nodiscard]] double highest(std::size_t k, double q) const {
    return chord(k, q) + samples[k].gouge_mm;
  }
  [[nodiscard]] double lowest(std::size_t k, double q) const {
    return chord(k, q) - samples[k].dip_mm;
  }
};

struct Worst {
  double below = 0.0, above = 0.0;
};
/// At ninths of the intervals between samples, and where moves end between samples.
Worst worst_of(const Curve& run, const std::vector<FittedMove>& moves) {
  Worst w;
  std::size_t m = 1;
  for (std::size_t k = 0; k + 1 < run.samples.size(); ++k) {
    const double from = along_mm(run.samples[k].place),
                 length = along_mm(run.samples[k + 1].place) - from;
    std::vector<double> shares;
    for (int i = 0; i <= 8; ++i) shares.push_back(i / 8.0);
    for (std::size_t v = m; v < moves.size() && moves[v].place < run.samples[k + 1].place; ++v)
      shares.push_back(std::max(0.0, (along_mm(moves[v].place) - from) / length));
    std::sort(shares.begin(), shares.end());
    for (const double q : shares) {
      const double t = from + q * length;
      while (q > 0.0 ? along_mm(moves[m].place) < t - 1e-12
                     : moves[m].place <= run.samples[k].place)
        ++m;
      const double path = height(moves[m - 1], moves[m], t);
      w.below = std::max(w.below, run.highest(k, q) - path);
      w.above = std::max(w.above, path - run.lowest(k, q));
    }
  }
  return w;
}

/// Pieces of circles, lines and noise, as surfaces make them.
Curve random_run(std::uint64_t seed) {
  Curve run;
  std::int64_t place = -70000;
  double z = 0.0, slope = 0.0;
  std::uint64_t n = 0;
  const auto next = [&] { return random_uniform(seed, n++); };
  for (int piece = 0; piece < 12; ++piece) {
    const double kind = next(), bend = (next() - 0.6) * 1.0;
    const double noise = kind < 0.2 ? 0.004 : kind < 0.4 ? 0.0005 : 0.0;
    if (next() < 0.3) slope = 1.5 * (next() - 0.5);
    if (next() < 0.05) z += 2.0 * next();  // a wall
    for (int i = 0; i < 25; ++i) {
      PathSample s;
      s.place = place;
      s.tip_mm = z + noise * (next() - 0.5);
      s.gouge_mm = 0.0018 * next();
      s.dip_mm = next() < 0.02 ? 0.03 * next() : 0.002 * next();
      run.samples.push_back(s);
      const std::int64_t step = 2 + static_cast<std::int64_t>(150.0 * next());
      place += step;
      slope += bend * along_mm(step);
      z += slope * along_mm(step);
    }
  }
  run.samples.back().gouge_mm = run.samples.back().dip_mm = 0.0;
  return run;
}

class RandomRuns : public testing::TestWithParam<int> {};

TEST_P(RandomRuns, StayInsideTheBoundsThatAreReported) {
  std::size_t arcs = 0, lines = 0;
  for (std::uint64_t i = 0; i < 150; ++i) {
    const std::uint64_t seed = 1000 * static_cast<std::uint64_t>(GetParam()) + i;
    const Curve run = random_run(seed);
    FitLimits limits;
    if (i % 3 == 1) limits = {0.0035, 0.004};
    if (i % 5 == 2) limits.greatest_radius_mm = 8.0;
    if (i % 7 == 3) limits.arcs = false;
    std::vector<FittedMove> moves;
    const FitBounds bounds = fit_moves(run.samples, kStep, limits, moves);
    ASSERT_LE(bounds.gouge_mm, limits.gouge_mm + 1e-12) << seed;
    ASSERT_EQ(moves.front().place, run.samples.front().place);
    ASSERT_EQ(moves.back().place, run.samples.back().place);
    for (const std::size_t end : {std::size_t{0}, run.samples.size() - 1}) {
      const double z = mm_of_ticks(end == 0 ? moves.front().z : moves.back().z);
      ASSERT_GE(z, run.samples[end].tip_mm - 2e-9);
      ASSERT_LE(z, run.samples[end].tip_mm + 0.001);
    }
    for (std::size_t m = 1; m < moves.size(); ++m) {
      ASSERT_GT(moves[m].place, moves[m - 1].place);
      ASSERT_EQ(moves[m].z % kResolution, 0);
      if (moves[m].shape == Shape::line) {
        ++lines;
      } else {
        ++arcs;
        ASSERT_TRUE(limits.arcs);
        expect_arc_limits(moves[m - 1], moves[m], limits);
      }
    }
    const Worst worst = worst_of(run, moves);
    ASSERT_LE(worst.below, bounds.gouge_mm + 1e-12) << seed;
    ASSERT_LE(worst.above, bounds.excess_mm + 1e-12) << seed;
    // Only where a dip alone is deeper than the limit may the excess be.
    double deepest_dip = 0.0;
    for (const PathSample& s : run.samples) deepest_dip = std::max(deepest_dip, s.dip_mm);
    ASSERT_LE(bounds.excess_mm, std::max(limits.excess_mm, deepest_dip + 0.0021)) << seed;

    std::vector<FittedMove> turned = moves;
    reverse_moves(turned);
    ASSERT_EQ(turned.size(), moves.size());
    for (std::size_t m = 1; m < turned.size(); ++m) {
      const FittedMove &a = moves[moves.size() - 1 - m], &b = moves[moves.size() - m];
      ASSERT_EQ(turned[m].place, a.place);
      ASSERT_EQ(turned[m].shape, b.shape);
      const double t = along_mm(a.place) + 0.37 * along_mm(b.place - a.place);
      ASSERT_NEAR(height(turned[m - 1], turned[m], t), height(a, b, t), 1e-9);
    }
    reverse_moves(turned);
    for (std::size_t m = 0; m < moves.size(); ++m) {
      ASSERT_EQ(turned[m].radius, moves[m].radius);
    }
  }
  EXPECT_GT(arcs, 1000U);
  EXPECT_GT(lines, 1000U);
}
INSTANTIATE_TEST_SUITE_P(Seeds, RandomRuns, testing::Range(1, 11));

Curve sampled(double from, double to, double step, double (*f)(double)) {
  Curve run;
  for (double t = from; t < to + 0.5 * step; t += step)
    run.samples.push_back(
        {std::llround(t / kStep), f(along_mm(std::llround(t / kStep))), 0.0, 0.0005, 0.0005});
  return run;
}

TEST(FitMoves, ACircleIsOneArcAndALineOneLine) {
  std::vector<FittedMove> moves;
  // A single vertex at (0.3, -0.2), ball of 3 mm: tip = vertex + sqrt(9 - u^2) - 3.
  const Curve vertex = sampled(-1.9, 2.4, 0.05, [](double t) {
    return -0.2 + std::sqrt(9.0 - (t - 0.3) * (t - 0.3)) - 3.0;
  });
  (void)fit_moves(vertex.samples, kStep, {}, moves);
  ASSERT_EQ(moves.size(), 2U);
  EXPECT_EQ(moves[1].shape, Shape::over);
  EXPECT_NEAR(centre_of(moves[0], moves[1]).t, 0.3, 0.02);
  EXPECT_NEAR(centre_of(moves[0], moves[1]).z, -3.2, 0.02);

  const Curve bowl =
      sampled(-3.0, 4.0, 0.05, [](double t) { return 20.0 - std::sqrt(400.0 - t * t); });
  (void)fit_moves(bowl.samples, kStep, {}, moves);
  ASSERT_EQ(moves.size(), 2U);
  EXPECT_EQ(moves[1].shape, Shape::under);

  const Curve slope = sampled(-30.0, 40.0, 0.125, [](double t) { return 1.25 * t; });
  (void)fit_moves(slope.samples, kStep, {}, moves);
  ASSERT_EQ(moves.size(), 2U);
  EXPECT_EQ(moves[1].shape, Shape::line);
}

TEST(FitMoves, ASteepCircleIsCutIntoArcsThatDoNotTurnOver) {
  const Curve run =
      sampled(-2.98, 2.98, 0.005, [](double t) { return std::sqrt(9.0 - t * t) - 3.0; });
  std::vector<FittedMove> moves;
  const FitBounds bounds = fit_moves(run.samples, kStep, {}, moves);
  EXPECT_LE(bounds.gouge_mm, FitLimits{}.gouge_mm);
  const Worst worst = worst_of(run, moves);
  EXPECT_LE(worst.below, bounds.gouge_mm);
  EXPECT_LE(worst.above, bounds.excess_mm);
  EXPECT_GE(moves.size(), 3U);
}

TEST(FitMoves, TwoSamplesAreOneLine) {
  std::vector<FittedMove> moves;
  const std::vector<PathSample> samples{{5, 1.0002, 0.0, 0.001, 0.0}, {9, 1.0, 0.0, 0.0, 0.0}};
  const FitBounds bounds = fit_moves(samples, kStep, {}, moves);
  ASSERT_EQ(moves.size(), 2U);
  EXPECT_EQ(moves[0].z, 10010);  // up
  EXPECT_EQ(moves[1].z, 10000);
  EXPECT_LE(bounds.gouge_mm, 0.001 + 1e-8);
  EXPECT_THROW((void)fit_moves({samples[0]}, kStep, {}, moves), CheckFailed);
}

TEST(FitMoves, ArcsInSpaceLieOnTheFittedOnes) {
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    const Curve run = random_run(seed);
    for (const LatticeLine& line : {LatticeLine{500, 700, 10, 0}, LatticeLine{500, 700, -10, 0},
                                    LatticeLine{500, 700, 0, 10}, LatticeLine{500, 700, 0, -10}})
      for (const bool turned : {false, true}) {
        std::vector<FittedMove> moves;
        (void)fit_moves(run.samples, kStep, {}, moves);
        if (turned) reverse_moves(moves);
        Toolpath path;
        append_fitted(path, line, moves, 1000.0);
        ASSERT_EQ(path.moves.size() + 1, moves.size());
        for (std::size_t m = 1; m < moves.size(); ++m) {
          const PathMove& move = path.moves[m - 1];
          const FittedMove& from = moves[m - 1];
          ASSERT_EQ(move.to.x, line.x + moves[m].place * line.dx);
          ASSERT_EQ(move.to.y, line.y + moves[m].place * line.dy);
          ASSERT_EQ(move.kind == PathMove::Kind::arc, moves[m].shape != Shape::line);
          if (move.kind != PathMove::Kind::arc) continue;
          const bool along_x = line.dy == 0;
          ASSERT_EQ(move.plane, along_x ? ArcPlane::zx : ArcPlane::yz);
          // First and second axis of the plane: Z X, or Y Z.
          const double h0 =
              mm_of_ticks(along_x ? line.x + from.place * line.dx : line.y + from.place * line.dy);
          const double h1 = mm_of_ticks(along_x ? move.to.x : move.to.y);
          const double z0 = mm_of_ticks(from.z), z1 = mm_of_ticks(move.to.z);
          // The middle of the arc lies to the right of the chord where the arc turns left, as
          // seen in the plane's axes, by r - sqrt(r^2 - chord^2 / 4).
          const double r = mm_of_ticks(move.radius), chord = std::hypot(h1 - h0, z1 - z0);
          const double sagitta = r - std::sqrt(r * r - 0.25 * chord * chord);
          const double u = along_x ? z1 - z0 : h1 - h0, v = along_x ? h1 - h0 : z1 - z0;
          const double right = (move.counter_clockwise ? sagitta : -sagitta) / chord;
          const double off_u = right * v, off_v = -right * u;
          const double h = 0.5 * (h0 + h1) + (along_x ? off_v : off_u);
          const double z = 0.5 * (z0 + z1) + (along_x ? off_u : off_v);
          const double t =
              (h - mm_of_ticks(along_x ? line.x : line.y)) * (line.dx + line.dy > 0 ? 1.0 : -1.0);
          ASSERT_NEAR(z, height(from, moves[m], t), 1e-9);
        }
      }
  }
}

}  // namespace
}  // namespace maquette::cnc
