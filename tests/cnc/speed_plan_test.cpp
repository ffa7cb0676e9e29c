// SPDX-License-Identifier: GPL-3.0-or-later

// What speed_plan.hpp claims, and how each claim is attacked:
//
//   one piece from rest to rest ....... closed forms of trapeze, triangle, and both with jerk
//   the plan is that of the whole ..... two passes over everything at once, 300 000 pieces
//   limits are kept ................... speeds at ends, tops, change over length, look-ahead
//   look-ahead ........................ brute force: stop within the next n, for each piece
//   jerk .............................. sampled speed: first and second difference
//   everything comes out once ......... lengths and moves summed
//   memory is bounded ................. a path that never meets a limit still comes out

#include "cnc/speed_plan.hpp"

#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/random.hpp"

namespace maquette::cnc {
namespace {

std::vector<PlannedPiece> planned(const std::vector<SpeedPiece>& pieces,
                                  std::size_t look_ahead = 0) {
  std::vector<PlannedPiece> out;
  SpeedPlan plan(look_ahead, [&](const PlannedPiece& p) { out.push_back(p); });
  for (const SpeedPiece& p : pieces) plan.add(p);
  plan.rest();
  return out;
}

double seconds(const std::vector<PlannedPiece>& plan) {
  double sum = 0.0;
  for (const PlannedPiece& p : plan) sum += p.seconds;
  return sum;
}

std::vector<SpeedPiece> random_pieces(std::uint64_t seed, std::size_t n, double jerk = 0.0) {
  std::vector<SpeedPiece> pieces;
  for (std::uint64_t i = 0; i < n; ++i) {
    const auto u = [&](std::uint64_t k) { return random_uniform(seed, 8 * i + k); };
    const double v = u(0) < 0.7 ? 50.0 : 5.0 + 100.0 * u(1);
    pieces.push_back({std::exp(-6.0 + 7.0 * u(2)), v, 200.0 + 1500.0 * u(3), jerk,
                      u(4) < 0.2 ? 40.0 * u(5) : 1e9, 1});
  }
  return pieces;
}

TEST(SpeedPlan, OnePieceIsATrapezeOrATriangle) {
  // 100 mm at 50 mm/s with 1000 mm/s2: L / v + v / a.
  auto p = planned({{100.0, 50.0, 1000.0}});
  ASSERT_EQ(p.size(), 1U);
  EXPECT_NEAR(p[0].seconds, 2.05, 1e-12);
  EXPECT_EQ(p[0].top_mm_s, 50.0);
  // 0.9 mm: 2 sqrt(L / a), top sqrt(a L).
  p = planned({{0.9, 50.0, 1000.0}});
  EXPECT_NEAR(p[0].seconds, 0.06, 1e-12);
  EXPECT_NEAR(p[0].top_mm_s, 30.0, 1e-12);
}

TEST(SpeedPlan, OnePieceWithJerkIsAnSCurve) {
  // a reached: dv = 50 > a^2 / j = 25; each ramp v / a + a / j.
  auto p = planned({{100.0, 50.0, 500.0, 10000.0}});
  EXPECT_NEAR(seconds(p), 2.0 + 0.1 + 0.05, 1e-9);
  // a not reached: dv = 50 < 100; ramps of 2 sqrt(dv / j) = 0.2 s, each over dv / 2 times that.
  p = planned({{100.0, 50.0, 1000.0, 5000.0}});
  EXPECT_NEAR(seconds(p), 2 * 0.2 + (100.0 - 2 * 5.0) / 50.0, 1e-9);
  // Too short for its speed: four phases of one length t with j t^3 = L / 2.
  p = planned({{1.0, 1e6, 1e6, 5000.0}});
  EXPECT_NEAR(seconds(p), 4.0 * std::cbrt(0.5 / 5000.0), 1e-9);
  EXPECT_NEAR(p[0].top_mm_s, 5000.0 * std::pow(0.5 / 5000.0, 2.0 / 3.0), 1e-9);
}

TEST(SpeedPlan, IsThatOfTheWholePathAtOnce) {
  const auto pieces = random_pieces(1, 300'000);
  const std::size_t n = pieces.size();
  std::vector<double> v2(n + 1, 0.0);  // squares of the speeds at the ends
  for (std::size_t k = 1; k < n; ++k)
    v2[k] = std::pow(
        std::min({pieces[k].speed_mm_s, pieces[k - 1].speed_mm_s, pieces[k].entry_mm_s}), 2);
  for (std::size_t k = n; k-- > 0;)
    v2[k] = std::min(v2[k], v2[k + 1] + 2.0 * pieces[k].acceleration_mm_s2 * pieces[k].length_mm);
  for (std::size_t k = 0; k < n; ++k)
    v2[k + 1] =
        std::min(v2[k + 1], v2[k] + 2.0 * pieces[k].acceleration_mm_s2 * pieces[k].length_mm);
  const auto plan = planned(pieces);
  ASSERT_EQ(plan.size(), n);
  double slower = 0.0;
  for (std::size_t k = 0; k < n; ++k) {
    ASSERT_NEAR(plan[k].entry_mm_s, std::sqrt(v2[k]), 1e-9) << k;
    ASSERT_NEAR(plan[k].exit_mm_s, std::sqrt(v2[k + 1]), 1e-9) << k;
    slower += plan[k].top_mm_s < pieces[k].speed_mm_s - 1e-6 ? 1.0 : 0.0;
  }
  EXPECT_GT(slower / static_cast<double>(n), 0.1) << "acceleration matters on this path";
}

TEST(SpeedPlan, KeepsItsLimitsAndTheTimeIsThatOfItsSpeeds) {
  for (const double jerk : {0.0, 30'000.0}) {
    const auto plan = planned(random_pieces(2, 20'000, jerk));
    double v = 0.0, moves = 0.0;
    for (const PlannedPiece& p : plan) {
      const double a = p.piece.acceleration_mm_s2, length = p.piece.length_mm;
      ASSERT_EQ(p.entry_mm_s, v);
      v = p.exit_mm_s;
      moves += p.piece.moves_ended;
      ASSERT_LE(p.entry_mm_s, p.piece.entry_mm_s + 1e-9);
      ASSERT_LE(p.top_mm_s, p.piece.speed_mm_s + 1e-9);
      ASSERT_GE(p.top_mm_s + 1e-9, std::max(p.entry_mm_s, p.exit_mm_s));
      // Ramps at a, the rest at the top: length and time must agree with each other.
      const double up = p.top_mm_s - p.entry_mm_s, down = p.top_mm_s - p.exit_mm_s;
      const auto ramp = [&](double dv) {
        if (jerk == 0.0) return dv / a;
        return dv > a * a / jerk ? dv / a + a / jerk : 2.0 * std::sqrt(std::max(dv, 0.0) / jerk);
      };
      const double ramps = 0.5 * (p.top_mm_s + p.entry_mm_s) * ramp(up) +
                           0.5 * (p.top_mm_s + p.exit_mm_s) * ramp(down);
      ASSERT_LE(ramps, length * (1 + 1e-6) + 1e-9);
      ASSERT_NEAR(p.seconds, ramp(up) + ramp(down) + (length - ramps) / p.top_mm_s,
                  1e-7 * p.seconds + 1e-12);
    }
    EXPECT_EQ(v, 0.0);
    EXPECT_EQ(moves, 20'000.0);
  }
}

TEST(SpeedPlan, CanStopWithinItsLookAhead) {
  const std::size_t ahead = 7;
  const auto pieces = random_pieces(3, 30'000);
  const auto plan = planned(pieces, ahead), whole = planned(pieces);
  std::vector<double> v2(pieces.size() + 1, 0.0);
  const auto gain = [&](std::size_t k) {
    return 2.0 * pieces[k].acceleration_mm_s2 * pieces[k].length_mm;
  };
  for (std::size_t k = pieces.size(); k-- > 1;) {
    v2[k] = std::pow(
        std::min({pieces[k].speed_mm_s, pieces[k - 1].speed_mm_s, pieces[k].entry_mm_s}), 2);
    double room = 0.0;
    for (std::size_t j = k; j < std::min(k + ahead, pieces.size()); ++j) room += gain(j);
    v2[k] = std::min({v2[k], v2[k + 1] + gain(k), room});
  }
  for (std::size_t k = 0; k + 1 < pieces.size(); ++k)
    v2[k + 1] = std::min(v2[k + 1], v2[k] + gain(k));
  bool slower = false;
  for (std::size_t k = 0; k < pieces.size(); ++k) {
    double room = 0.0;
    for (std::size_t j = k; j < std::min(k + ahead, pieces.size()); ++j)
      room += 2.0 * pieces[j].acceleration_mm_s2 * pieces[j].length_mm;
    ASSERT_LE(std::pow(plan[k].entry_mm_s, 2), room + 1e-9) << k;
    ASSERT_LE(plan[k].entry_mm_s, whole[k].entry_mm_s + 1e-9) << k;
    ASSERT_NEAR(plan[k].entry_mm_s, std::sqrt(v2[k]), 1e-9) << k;
    slower |= plan[k].entry_mm_s < whole[k].entry_mm_s - 1.0;
  }
  EXPECT_TRUE(slower) << "the look-ahead matters on this path";
  EXPECT_NEAR(seconds(planned(pieces, 100'000)), seconds(whole), 1e-9);
  // A steady run of n equal pieces: v^2 = 2 a n L.
  const std::vector<SpeedPiece> steady(400, {0.01, 1000.0, 500.0, 0.0, 1e9, 1});
  EXPECT_NEAR(planned(steady, 10)[200].entry_mm_s, std::sqrt(2 * 500.0 * 10 * 0.01), 1e-9);
}

/// Speed at time t of a ramp from v0 to v1 that takes all of `T` seconds.
double s_curve(double v0, double v1, double t, double a, double j) {
  const double dv = std::fabs(v1 - v0), sign = v1 > v0 ? 1.0 : -1.0;
  const double tj = dv > a * a / j ? a / j : std::sqrt(dv / j), top = j * tj;
  const double total = dv > a * a / j ? dv / a + a / j : 2.0 * tj;
  if (t >= total) return v1;
  double dvt = 0.0;
  if (t < tj)
    dvt = 0.5 * j * t * t;
  else if (t < total - tj)
    dvt = 0.5 * j * tj * tj + top * (t - tj);
  else
    dvt = dv - 0.5 * j * (total - t) * (total - t);
  return v0 + sign * dvt;
}

TEST(SpeedPlan, SampledSpeedsKeepAccelerationAndJerk) {
  const double jerk = 20'000.0, dt = 1e-4;
  std::vector<SpeedPiece> pieces = random_pieces(4, 3000, jerk);
  for (SpeedPiece& p : pieces) p.acceleration_mm_s2 = 800.0;
  const auto plan = planned(pieces);
  EXPECT_LT(plan.size(), pieces.size()) << "pieces of one speed became one";
  std::vector<double> v;
  double at = 0.0, start = 0.0, length = 0.0;  // of the next sample, of the piece
  for (const PlannedPiece& p : plan) {
    const auto ramp = [&](double dv) {
      return dv > 32.0 ? dv / 800.0 + 0.04 : 2.0 * std::sqrt(std::max(dv, 0.0) / jerk);
    };
    const double up = ramp(p.top_mm_s - p.entry_mm_s), down = ramp(p.top_mm_s - p.exit_mm_s);
    for (; at < start + p.seconds; at += dt) {
      const double t = at - start;
      v.push_back(t < up ? s_curve(p.entry_mm_s, p.top_mm_s, t, 800.0, jerk)
                  : t < p.seconds - down
                      ? p.top_mm_s
                      : s_curve(p.top_mm_s, p.exit_mm_s, t - (p.seconds - down), 800.0, jerk));
      length += v.back() * dt;
    }
    start += p.seconds;
  }
  double expected = 0.0;
  for (const SpeedPiece& p : pieces) expected += p.length_mm;
  EXPECT_NEAR(length, expected, 1e-4 * expected);
  // A difference over one step sees the mean of the derivative, so its bound holds exactly,
  // but for rounding and the 1e-12 to which lengths are met.
  for (std::size_t i = 2; i < v.size(); ++i) {
    ASSERT_LE(std::fabs(v[i] - v[i - 1]) / dt, 800.0 * (1 + 1e-6)) << i;
    ASSERT_LE(std::fabs(v[i] - 2 * v[i - 1] + v[i - 2]) / (dt * dt), jerk * (1 + 1e-3)) << i;
  }
}

TEST(SpeedPlan, JerkCostsTimeButNotMuchOnALongRun) {
  auto pieces = random_pieces(5, 5000);
  const double without = seconds(planned(pieces));
  for (SpeedPiece& p : pieces) p.jerk_mm_s3 = 1e9;
  EXPECT_GE(seconds(planned(pieces)), without - 1e-9);
  // Pieces of nearly one speed run at the lowest of them.
  for (const PlannedPiece& p :
       planned({{50, 50, 900, 1e4}, {50, 49.5, 900, 1e4, 1e9}, {50, 50, 900, 1e4, 49.4}}))
    EXPECT_EQ(p.top_mm_s, 49.4);
  // Many short pieces of one speed are one run: v / a + a / j at either end.
  const std::vector<SpeedPiece> steady(1000, {0.5, 50.0, 1000.0, 20'000.0, 1e9, 1});
  EXPECT_NEAR(seconds(planned(steady)), 10.0 + 2.0 * std::sqrt(50.0 / 20'000.0), 1e-6);
}

TEST(SpeedPlan, APathThatNeverMeetsALimitComesOutAnyway) {
  double length = 0.0, most = 0.0;
  std::uint64_t moves = 0, given = 0;
  SpeedPlan plan(0, [&](const PlannedPiece& p) {
    length += p.piece.length_mm;
    moves += p.piece.moves_ended;
  });
  for (int i = 0; i < 1'000'000; ++i) {
    plan.add({0.001, 1e9, 1.0, 0.0, 1e9, 1});
    most = std::max(most, static_cast<double>(++given - moves));
  }
  plan.rest();
  EXPECT_NEAR(length, 1000.0, 1e-6);
  EXPECT_EQ(moves, 1'000'000U);
  EXPECT_LE(most, 1 << 19) << "pieces held back";
}

}  // namespace
}  // namespace maquette::cnc
