// SPDX-License-Identifier: GPL-3.0-or-later

// What motion_limits.hpp and motion_time.hpp claim, and how each claim is attacked:
//
//   lines, arcs, helices ......... closed forms from rest to rest
//   corners ...................... closed forms: speed of the arc, jump, reversal, modes
//   no axis beyond its limits .... the planned motion on its rounded path, sampled each cycle
//   time within 3 % .............. an integration in time steps over a finely sampled path, with
//                                  geometry by differences, that shares no code
//   time within 2 % of LinuxCNC .. its planner (2.9.0, f1270d6ed7) run once on the same motions;
//                                  its figures stand here
//   blocks ....................... closed form of a slow reader; zero-length blocks count
//   strategy = reader ............ one path both ways
//   table ........................ sums, by tool and by band

#include "cnc/motion_time.hpp"

#include <filesystem>
#include <numbers>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/files.hpp"
#include "core/random.hpp"
#include "support/folders.hpp"
#include "support/matchers.hpp"

namespace maquette::cnc {
namespace {

using testing::HasSubstr;
using testing_support::FailsWith;
using testing_support::ScratchFolder;
using testing_support::Succeeds;
constexpr double kPi = std::numbers::pi;

/// 200 mm/s, 2 m/s2 in each axis, blocks as fast as they are wanted.
Machine machine(double v = 200.0, double a = 2000.0) {
  Machine m = *find_machine("portal_mill_2500");
  m.max_feed_mm_min = m.rapid_mm_min = {60.0 * v, 60.0 * v, 60.0 * v};
  m.acceleration_mm_s2 = {a, a, a};
  m.blocks_per_s = 1e9;
  return m;
}

Motion line(Vec3 from, Vec3 to, double feed_mm_min = 3000.0) {
  Motion m;
  m.from_mm = from;
  m.to_mm = to;
  m.feed_mm_min = feed_mm_min;
  return m;
}

Motion arc(ArcPlane plane, Vec3 from, Vec3 to, Vec3 centre, double sweep_rad, double feed_mm_min) {
  Motion m = line(from, to, feed_mm_min);
  m.kind = Motion::Kind::arc;
  m.plane = plane;
  m.centre_mm = centre;
  m.sweep_rad = sweep_rad;
  return m;
}

std::vector<Motion> lines(const std::vector<Vec3>& points, double feed_mm_min) {
  std::vector<Motion> out;
  for (std::size_t i = 1; i < points.size(); ++i)
    out.push_back(line(points[i - 1], points[i], feed_mm_min));
  return out;
}

MotionTime time_of(const std::vector<Motion>& motions, const Machine& m, const PathControl& control,
                   const MotionTimer::Watch& watch = {}) {
  MotionTimer timer(m, control, watch);
  for (const Motion& motion : motions) timer.add(motion);
  timer.rest();
  return timer.time();
}

// Seven blocks of a finishing pass whose fourth is used up by the arcs of its corners: LinuxCNC's
// rounding takes a third of it on one side and two on the other.
std::vector<Motion> pass_with_a_used_up_arc() {
  struct Block {
    double x, z, k, i;  // k, i: centre from the start; 0: line
    bool counter_clockwise;
  };
  const Block blocks[] = {{448.406, 53.351, 0, 0, false},
                          {447.281, 53.44, -4.441, -0.915, false},
                          {446.375, 53.626, 0, 0, false},
                          {445.031, 53.807, -12.029, -2.304, false},
                          {444.5, 53.836, -10.543, -0.842, false},
                          {443.375, 53.879, 0, 0, false},
                          {443.0, 53.916, 0, 0, false}};
  std::vector<Motion> motions;
  Vec3 from{449.0, 1500.0, 53.293};
  for (const Block& b : blocks) {
    const Vec3 to{b.x, 1500.0, b.z};
    if (b.k == 0.0) {
      motions.push_back(line(from, to, 5000.0));
    } else {
      const Vec3 centre = from + Vec3{b.i, 0.0, b.k}, p = from - centre, q = to - centre;
      // In G18 angles run from z to x.
      double sweep = std::atan2(q.x, q.z) - std::atan2(p.x, p.z);
      if (sweep > 0.0) sweep -= 2.0 * kPi;
      motions.push_back(arc(ArcPlane::zx, from, to, centre, sweep, 5000.0));
    }
    from = to;
  }
  return motions;
}

TEST(MotionTime, AMoveThatItsCornersUseUpIsNoStandstill) {
  const auto motions = pass_with_a_used_up_arc();
  const Machine m = *find_machine("portal_mill_2500");
  std::vector<PlannedPiece> pieces;
  std::uint32_t ended = 0;
  double length = 0.0;
  for (const double tolerance : {0.0005, 0.001, 0.002}) {
    pieces.clear();
    ended = 0;
    length = 0.0;
    const auto t = time_of(motions, m, {PathControl::Mode::blend, tolerance},
                           [&](const PlannedPiece& p) { pieces.push_back(p); });
    for (std::size_t i = 0; i < pieces.size(); ++i) {
      ended += pieces[i].piece.moves_ended;
      length += pieces[i].piece.length_mm;
      if (i > 0) {
        EXPECT_GT(pieces[i].entry_mm_s, 1.0) << "piece " << i << ", tolerance " << tolerance;
      }
    }
    EXPECT_EQ(ended, motions.size());
    EXPECT_NEAR(length, t.cutting_mm, 0.02 * t.cutting_mm) << "arcs of corners are shorter";
  }
}

// ---- closed forms ----------------------------------------------------------

TEST(MotionTime, OneLineFromRestToRest) {
  // 50 mm/s along x: L / v + v / a.
  EXPECT_NEAR(time_of({line({0, 0, 0}, {100, 0, 0})}, machine(), {}).cutting_s, 2.025, 1e-12);
  // The z axis is slower: along (3, 0, 4) / 5 it allows 20 / 0.8 = 25 mm/s, 500 / 0.8 mm/s2.
  Machine m = machine();
  m.max_feed_mm_min.z = 1200.0;
  m.acceleration_mm_s2.z = 500.0;
  const auto t = time_of({line({0, 0, 0}, {60, 0, 80})}, m, {});
  EXPECT_NEAR(t.cutting_s, 100.0 / 25.0 + 25.0 / 625.0, 1e-12);
  EXPECT_NEAR(t.programmed_s, 2.0, 1e-12);
  // A rapid ignores the feed and uses its own limits: 200 mm/s and 2000 mm/s2 in x and y at once.
  m.rapid_mm_min = {12'000, 12'000, 1200};
  Motion rapid = line({0, 0, 0}, {300, 300, 0}, 0.0);
  rapid.kind = Motion::Kind::rapid;
  const auto r = time_of({rapid}, m, {});
  EXPECT_NEAR(r.rapid_s, 300.0 / 200.0 + 0.1, 1e-12);
  EXPECT_EQ(r.cutting_s, 0.0);
  EXPECT_NEAR(r.rapid_mm, 300.0 * std::sqrt(2.0), 1e-12);
}

TEST(MotionTime, OneArcFromRestToRest) {
  // Radius 2 mm: v = sqrt(sqrt(3)/2 a r), half of the acceleration is left along the path.
  const double r = 2.0, v = std::sqrt(std::sqrt(0.75) * 2000.0 * r), length = 4.0 * kPi * r;
  Motion circle = arc(ArcPlane::zx, {r, 7, 0}, {r, 7, 0}, {0, 7, 0}, -4.0 * kPi, 12'000);
  EXPECT_NEAR(time_of({circle}, machine(), {}).cutting_s, length / v + v / 1000.0, 1e-12);
  // At a low feed the same is left, for it may be raised.
  circle.feed_mm_min = 3000.0;
  EXPECT_NEAR(time_of({circle}, machine(), {}).cutting_s, length / 50.0 + 50.0 / 1000.0, 1e-12);
  // A slower axis outside of the plane does not count, one inside does; then turning takes
  // 10^2 / r of the acceleration.
  Machine m = machine();
  m.max_feed_mm_min.y = m.acceleration_mm_s2.y = 1.0;
  EXPECT_NEAR(time_of({circle}, m, {}).cutting_s, length / 50.0 + 50.0 / 1000.0, 1e-12);
  m.max_feed_mm_min.z = 600.0;
  const double along = 2000.0 * std::sqrt(1.0 - std::pow(50.0 / 2000.0, 2));
  EXPECT_NEAR(time_of({circle}, m, {}).cutting_s, length / 10.0 + 10.0 / along, 1e-12);
  // A helix that rises as fast as it turns, third axis limited to 10 mm/s.
  Machine slow = machine();
  slow.max_feed_mm_min.z = 600.0;
  const Motion helix = arc(ArcPlane::xy, {20, 0, 0}, {20, 0, 40 * kPi}, {0, 0, 0}, 2.0 * kPi, 6000);
  EXPECT_NEAR(time_of({helix}, slow, {}).cutting_s, 40 * kPi / 10.0, 0.02);
}

TEST(MotionTime, CornersBetweenLines) {
  const Machine m = machine();
  // A right angle within P: radius R with R (sqrt 2 - 1) = P, v^2 = sqrt(3)/2 a R.
  const auto along = [&](Vec3 from, Vec3 to, double feed = 6000.0) {
    return move_limits(m, line(from, to, feed));
  };
  const MoveLimits x = along({-10, 0, 0}, {0, 0, 0}), y = along({0, 0, 0}, {0, 10, 0});
  const Corner c = corner(m, {PathControl::Mode::blend, 0.05}, x, y);
  const double radius = 0.05 / (std::sqrt(2.0) - 1.0);
  EXPECT_NEAR(c.radius_mm, radius, 1e-12);
  EXPECT_NEAR(c.speed_mm_s, std::sqrt(std::sqrt(0.75) * 2000.0 * radius), 1e-12);
  EXPECT_NEAR(c.trim_mm, radius, 1e-12);
  EXPECT_NEAR(c.length_mm, radius * kPi / 2.0, 1e-12);
  EXPECT_NEAR(c.along_mm_s2, 1000.0, 1e-9);
  // Short moves: the arc may use up half of each.
  const Corner s = corner(m, {PathControl::Mode::blend, 1.0}, along({-0.2, 0, 0}, {0, 0, 0}), y);
  EXPECT_NEAR(s.trim_mm, 0.1, 1e-12);
  // A jump that one cycle can take: 50 mm/s by 0.001 rad is 50 mm/s2 in 1 ms.
  const MoveLimits a = along({-10, 0, 0}, {0, 0, 0}, 3000.0);
  const Corner k =
      corner(m, {PathControl::Mode::blend, 1e-6}, a, along({0, 0, 0}, {10, 0.01, 0}, 3000.0));
  EXPECT_EQ(k.speed_mm_s, 50.0);
  EXPECT_NEAR(k.lost_share, (50.0 / 0.001 + 2000.0) * 0.001 / 2000.0, 1e-6);
  EXPECT_EQ(k.length_mm, 0.0);
  // Reversal, exact stop, exact path with and without a turn, rapid to cut.
  EXPECT_EQ(
      corner(m, {PathControl::Mode::blend, 1.0}, x, along({0, 0, 0}, {-9, 0.1, 0})).speed_mm_s,
      0.0);
  EXPECT_EQ(
      corner(m, {PathControl::Mode::exact_stop, 1.0}, x, along({0, 0, 0}, {9, 0, 0})).speed_mm_s,
      0.0);
  EXPECT_EQ(
      corner(m, {PathControl::Mode::exact_path, 1.0}, x, along({0, 0, 0}, {9, 0, 0})).speed_mm_s,
      100.0);
  EXPECT_EQ(corner(m, {PathControl::Mode::exact_path, 1.0}, x, y).speed_mm_s, 0.0);
  MoveLimits rapid = x;
  rapid.rapid = true;
  EXPECT_EQ(
      corner(m, {PathControl::Mode::blend, 1.0}, rapid, along({0, 0, 0}, {9, 0, 0})).speed_mm_s,
      0.0);
  // GRBL's junction deviation: v^2 = a d sin(t/2) / (1 - sin(t/2)), t the angle between the moves.
  Machine grbl = m;
  grbl.corner = "point";
  grbl.corner_tolerance_mm = 0.01;
  const Corner g = corner(grbl, {}, x, y);
  EXPECT_NEAR(g.speed_mm_s, std::sqrt(2000.0 * 0.01 * std::sqrt(0.5) / (1.0 - std::sqrt(0.5))),
              1e-9);
  EXPECT_EQ(g.length_mm, 0.0);
}

TEST(MotionTime, JumpsTakeTheirShareOfTheAcceleration) {
  const Machine m = machine();
  // 50 mm/s turned by 0.001 rad within 1 ms: 0.026 of the acceleration, missing to both moves.
  std::vector<double> accelerations;
  const auto watch = [&](const PlannedPiece& p) {
    accelerations.push_back(p.piece.acceleration_mm_s2);
  };
  time_of(lines({{0, 0, 0}, {10, 0, 0}, {20, 0.01, 0}, {30, 0.02, 0}}, 3000.0), m, {}, watch);
  EXPECT_THAT(accelerations, testing::ElementsAre(testing::DoubleNear(1948.0, 0.1),
                                                  testing::DoubleNear(1948.0, 0.1),
                                                  testing::DoubleNear(2000.0, 0.1)));
  // Turned by 0.01 rad the jump may take no more than a tenth: 50 mm/s x 0.1 / 0.26.
  const auto limits = [&](Vec3 from, Vec3 to) { return move_limits(m, line(from, to)); };
  const MoveLimits x = limits({-10, 0, 0}, {0, 0, 0}), turned = limits({0, 0, 0}, {10, 0.1, 0});
  const PathControl tight{PathControl::Mode::blend, 1e-6};
  EXPECT_NEAR(corner(m, tight, x, turned).speed_mm_s, 50.0 * 0.1 / 0.26, 1e-3);
  // Beside an arc it counts twice.
  const MoveLimits bow =
      move_limits(m, arc(ArcPlane::xy, {-50, 50, 0}, {0, 0, 0}, {0, 50, 0}, kPi / 2.0, 3000));
  EXPECT_NEAR(dot(bow.end, {1, 0, 0}), 1.0, 1e-12);
  EXPECT_NEAR(dot(bow.start, {0, -1, 0}), 1.0, 1e-12);
  const Corner soft = corner(m, tight, bow, limits({0, 0, 0}, {10, 0.01, 0}));
  EXPECT_NEAR(soft.lost_share, 0.052, 1e-4);
}

TEST(MotionTime, RapidsAndCutsStopBetweenEachOther) {
  Motion rapid = line({0, 0, 0}, {100, 0, 0}, 0.0);
  rapid.kind = Motion::Kind::rapid;
  const auto t = time_of({rapid, line({100, 0, 0}, {200, 0, 0}), line({200, 0, 0}, {300, 0, 0})},
                         machine(), {});
  EXPECT_NEAR(t.rapid_s, 0.5 + 0.1, 1e-12);
  EXPECT_NEAR(t.cutting_s, 4.0 + 0.025, 1e-12);
  EXPECT_EQ(t.stops, 2U);
  rapid.from_mm = {300, 0, 0};
  rapid.to_mm = {400, 0, 0};
  const auto back = time_of({line({100, 0, 0}, {300, 0, 0}), rapid}, machine(), {});
  EXPECT_NEAR(back.rapid_s, 0.6, 1e-12);
  EXPECT_NEAR(back.cutting_s, 4.025, 1e-12);
}

TEST(MotionTime, EveryMoveStopsInExactStop) {
  std::vector<Motion> moves;
  for (int i = 0; i < 200; ++i) moves.push_back(line({0.5 * i, 0, 0}, {0.5 * (i + 1), 0, 0}));
  const auto t = time_of(moves, machine(), {PathControl::Mode::exact_stop});
  EXPECT_NEAR(t.cutting_s, 200 * 2.0 * std::sqrt(0.5 / 2000.0), 1e-9);
  EXPECT_EQ(t.stops, 200U);
  EXPECT_NEAR(time_of(moves, machine(), {}).cutting_s, 2.025, 1e-9) << "one straight line";
}

TEST(MotionTime, WaitsForBlocks) {
  std::vector<Motion> moves;
  for (int i = 0; i < 1000; ++i) moves.push_back(line({0.1 * i, 0, 0}, {0.1 * (i + 1), 0, 0}));
  Machine m = machine();
  const auto fast = time_of(moves, m, {});
  EXPECT_NEAR(fast.highest_blocks_per_s, 500.0, 1e-6) << "0.1 mm at 50 mm/s";
  EXPECT_NEAR(fast.waiting_s, 0.0, 1e-5);
  m.blocks_per_s = 100.0;
  // The last move cannot begin before the last block is read.
  EXPECT_NEAR(time_of(moves, m, {}).total_s(), 1000 / 100.0 + 0.1 / 50.0, 0.05);
  // Blocks without a way are read too.
  std::vector<Motion> idle;
  for (const Motion& move : moves) {
    idle.push_back(move);
    idle.push_back(line(move.to_mm, move.to_mm));
  }
  const auto t = time_of(idle, m, {});
  EXPECT_NEAR(t.total_s(), 2000 / 100.0, 0.05);
  EXPECT_EQ(t.moves, 2000U);
  EXPECT_NEAR(t.cutting_s, fast.cutting_s, 1e-9);
  // A buffer bridges a burst: one second of rest between bursts of as many blocks as it holds.
  std::vector<Motion> bursts;
  double x = 0.0;
  for (int i = 0; i < 20; ++i) {
    bursts.push_back(line({x, 0, 0}, {x + 50.0, 0, 0}));
    x += 50.0;
    for (int k = 0; k < 40; ++k, x += 0.1) bursts.push_back(line({x, 0, 0}, {x + 0.1, 0, 0}));
  }
  EXPECT_NEAR(time_of(bursts, m, {}).waiting_s, 1 / 100.0, 0.005) << "the first block only";
  // One that is too small does not: 10 blocks wait when the burst begins, 30 are read at 100 a
  // second while 40 moves of 2 ms want them.
  m.look_ahead_blocks = 10;
  const double waiting = time_of(bursts, m, {}).waiting_s;
  EXPECT_NEAR(waiting, 20 * (30 / 100.0 - 40 * 0.002), 20 * 0.05);
}

// ---- laws ------------------------------------------------------------------

/// A line through points, or an arc, as many samples: the machine's way with rounded corners.
struct Way {
  std::vector<Vec3> points;
  std::vector<double> s;
  void add(Vec3 p) {
    const double d = points.empty() ? 0.0 : norm(p - points.back());
    if (!points.empty() && d == 0.0) return;
    s.push_back(points.empty() ? 0.0 : s.back() + d);
    points.push_back(p);
  }
  [[nodiscard]] Vec3 at(double where) const {
    const auto it = std::upper_bound(s.begin(), s.end() - 1, where);
    const auto i = static_cast<std::size_t>(std::max<std::ptrdiff_t>(1, it - s.begin()));
    const double t = (where - s[i - 1]) / (s[i] - s[i - 1]);
    return points[i - 1] + t * (points[i] - points[i - 1]);
  }
};

/// Rounds each corner by an arc of this radius; 0: left as it is.
Way rounded(const std::vector<Vec3>& p, const std::vector<double>& radius, double step) {
  Way way;
  way.add(p.front());
  for (std::size_t i = 1; i + 1 < p.size(); ++i) {
    const Vec3 u = normalized(p[i] - p[i - 1]), w = normalized(p[i + 1] - p[i]);
    const double turn = std::atan2(norm(cross(u, w)), dot(u, w));
    if (radius[i] == 0.0) {
      way.add(p[i]);
      continue;
    }
    const double d = radius[i] * std::tan(0.5 * turn);
    const Vec3 inward = normalized(w - u);
    const Vec3 centre = p[i] + (radius[i] / std::cos(0.5 * turn)) * inward;
    const Vec3 begin = p[i] - d * u;
    const Vec3 e1 = (1.0 / radius[i]) * (begin - centre);
    const int n = 2 + static_cast<int>(radius[i] * turn / step);
    for (int k = 0; k <= n; ++k) {
      const double a = turn * k / n;
      way.add(centre + radius[i] * (std::cos(a) * e1 + std::sin(a) * u));
    }
  }
  way.add(p.back());
  return way;
}

/// Terrain-like passes along x at y = 3: steps of about half a millimetre, rough heights.
std::vector<Vec3> pass(std::uint64_t seed, std::size_t n, double step, double rough) {
  std::vector<Vec3> p{{0, 3, 0}};
  for (std::uint64_t i = 1; i <= n; ++i)
    p.push_back(p.back() + Vec3{step * (0.5 + random_uniform(seed, 2 * i)), 0,
                                rough * step * random_normal(seed + 1, i)});
  return p;
}

/// A walk in all directions with turns of all sizes.
std::vector<Vec3> walk(std::uint64_t seed, std::size_t n, double step) {
  std::vector<Vec3> p{{0, 0, 0}};
  for (std::uint64_t i = 1; i <= n; ++i) {
    const Vec3 d{random_normal(seed, 3 * i), random_normal(seed, 3 * i + 1),
                 random_normal(seed, 3 * i + 2)};
    p.push_back(p.back() + step * (0.2 + random_uniform(seed + 1, i)) * d);
  }
  return p;
}

TEST(MotionTime, NoAxisExceedsItsLimitsOnThePlannedMotion) {
  struct Case {
    std::vector<Vec3> points;
    Vec3 v, a;
    double feed_mm_min, tolerance_mm;
  };
  const std::vector<Case> cases = {
      {pass(1, 400, 0.5, 0.3), {200, 200, 200}, {2000, 2000, 2000}, 3000, 0.002},
      {pass(2, 400, 0.5, 1.0), {60, 60, 20}, {800, 800, 300}, 6000, 0.01},
      {walk(3, 200, 3.0), {100, 60, 30}, {2000, 1200, 500}, 12'000, 0.05},
      {walk(4, 200, 0.3), {100, 60, 30}, {2000, 1200, 500}, 12'000, 0.5},
  };
  for (const Case& c : cases) {
    SCOPED_TRACE(&c - cases.data());
    Machine m = machine();
    m.max_feed_mm_min = 60.0 * c.v;
    m.acceleration_mm_s2 = c.a;
    const PathControl control{PathControl::Mode::blend, c.tolerance_mm};
    const auto motions = lines(c.points, c.feed_mm_min);
    std::vector<double> radius(c.points.size(), 0.0);
    for (std::size_t i = 1; i < motions.size(); ++i)
      radius[i] =
          corner(m, control, move_limits(m, motions[i - 1]), move_limits(m, motions[i])).radius_mm;
    // Chords of 0.2 um: their own corners are below 0.2 % of the acceleration.
    const Way way = rounded(c.points, radius, 2e-4);

    // Where the plan is after each cycle.
    const double dt = m.cycle_s;
    std::vector<Vec3> samples;
    double t = 0.0, start = 0.0, s = 0.0;
    const auto time = time_of(motions, m, control, [&](const PlannedPiece& p) {
      const double a = p.piece.acceleration_mm_s2;
      const double up = (p.top_mm_s - p.entry_mm_s) / a, down = (p.top_mm_s - p.exit_mm_s) / a;
      for (; t < start + p.seconds; t += dt) {
        const double q = t - start, left = p.seconds - q;
        const double here = q < up ? p.entry_mm_s * q + 0.5 * a * q * q
                            : left < down
                                ? p.piece.length_mm - (p.exit_mm_s * left + 0.5 * a * left * left)
                                : 0.5 * (p.entry_mm_s + p.top_mm_s) * up + p.top_mm_s * (q - up);
        samples.push_back(way.at(s + here));
      }
      start += p.seconds;
      s += p.piece.length_mm;
    });
    EXPECT_NEAR(s, way.s.back(), 1e-6 * s + 2e-7 * static_cast<double>(motions.size()))
        << "plan and way are of one length";
    ASSERT_GT(samples.size(), 500U);
    Vec3 fastest{}, hardest{};
    for (std::size_t i = 2; i < samples.size(); ++i) {
      const Vec3 v = (1.0 / dt) * (samples[i] - samples[i - 1]);
      const Vec3 a = (1.0 / (dt * dt)) * (samples[i] - 2.0 * samples[i - 1] + samples[i - 2]);
      for (const auto axis : {&Vec3::x, &Vec3::y, &Vec3::z}) {
        fastest.*axis = std::fmax(fastest.*axis, std::fabs(v.*axis) / (c.v.*axis));
        hardest.*axis = std::fmax(hardest.*axis, std::fabs(a.*axis) / (c.a.*axis));
      }
    }
    // A difference sees the mean over its steps, so the bounds hold but for the chords.
    for (const auto axis : {&Vec3::x, &Vec3::y, &Vec3::z}) {
      EXPECT_LE(fastest.*axis, 1.0 + 1e-6);
      EXPECT_LE(hardest.*axis, 1.005);
    }
    EXPECT_GT(std::max({hardest.x, hardest.y, hardest.z}), 0.8) << "the limits are used";
    EXPECT_GT(time.cutting_s, 1.1 * time.programmed_s) << "acceleration matters on this path";
  }
}

// ---- an integration that shares no code --------------------------------------

/// Rounds corners by angles, samples the way each micrometre, takes direction and curvature
/// from differences, and moves a point along it in steps of a tenth of a millisecond.
double integrated_s(const std::vector<Vec3>& p, double v_axis, double a, double feed_mm_s,
                    double tolerance, double cycle) {
  std::vector<double> radius(p.size(), 0.0), jump(p.size(), 1e9);
  for (std::size_t i = 1; i + 1 < p.size(); ++i) {
    const Vec3 u = normalized(p[i] - p[i - 1]), w = normalized(p[i + 1] - p[i]);
    const double turn = std::atan2(norm(cross(u, w)), dot(u, w));
    const double half = 0.5 * std::min(norm(p[i] - p[i - 1]), norm(p[i + 1] - p[i]));
    if (turn < 1e-9) continue;
    radius[i] =
        std::min(tolerance / (1.0 / std::cos(0.5 * turn) - 1.0), half / std::tan(0.5 * turn));
    const Vec3 d = w - u;
    const double worst = std::max({std::fabs(d.x), std::fabs(d.y), std::fabs(d.z)});
    jump[i] = 0.1 * a * cycle / worst;
    if (std::min(feed_mm_s, jump[i]) >= std::sqrt(std::sqrt(0.75) * a * radius[i])) radius[i] = 0.0;
  }
  const double step = 1e-3;
  const Way way = rounded(p, radius, 0.2 * step);
  const auto n = static_cast<std::size_t>(way.s.back() / step);
  const double ds = way.s.back() / static_cast<double>(n);
  std::vector<double> cap(n + 1), along(n + 1);
  std::vector<Vec3> at(n + 1);
  for (std::size_t i = 0; i <= n; ++i) at[i] = way.at(ds * static_cast<double>(i));
  for (std::size_t i = 0; i <= n; ++i) {
    const std::size_t k = std::clamp<std::size_t>(i, 2, n - 2);
    const Vec3 t = normalized(at[k + 1] - at[k - 1]);
    const double curvature = norm(at[k + 2] - 2.0 * at[k] + at[k - 2]) / (4.0 * ds * ds);
    const double widest = std::max({std::fabs(t.x), std::fabs(t.y), std::fabs(t.z)});
    cap[i] = std::min(feed_mm_s, v_axis / widest);
    along[i] = a / widest;
    // Corners left as they are show as a peak of one sample; they get their own cap below.
    if (curvature > 1e-3 && curvature < 0.05 / ds) {
      cap[i] = std::min(cap[i], std::sqrt(std::sqrt(0.75) * a / curvature));
      const double across = cap[i] * cap[i] * curvature / a;
      along[i] = a * std::sqrt(std::max(0.25, 1.0 - across * across));
    }
  }
  double s = 0.0;
  for (std::size_t i = 1; i + 1 < p.size(); ++i) {  // place of each corner on the rounded way
    const Vec3 u = normalized(p[i] - p[i - 1]), w = normalized(p[i + 1] - p[i]);
    const double turn = std::atan2(norm(cross(u, w)), dot(u, w));
    s += norm(p[i] - p[i - 1]);
    const double lost = radius[i] * (2.0 * std::tan(0.5 * turn) - turn);
    s -= 0.5 * lost;
    if (radius[i] == 0.0) {
      double& here = cap[std::min(n, static_cast<std::size_t>(s / ds + 0.5))];
      here = std::min(here, jump[i]);
    }
    s -= 0.5 * lost;
  }
  // Highest speed from which it can still brake: marched backwards in time.
  std::vector<double> brake(n + 1, 0.0);
  for (std::size_t i = n; i-- > 0;) {
    double v = std::max(brake[i + 1], 1e-3), gone = 0.0;
    while (gone < ds && v < cap[i]) {
      const double dt = std::min(1e-5, (ds - gone) / v + 1e-9);
      gone += v * dt;
      v += along[i] * dt;
    }
    brake[i] = std::min(v, cap[i]);
  }
  const double dt = 1e-4;
  double where = 0.0, v = 0.0, t = 0.0;
  while (where < way.s.back() - 1e-6 && t < 1e4) {
    const double i = where / ds;
    double next = v + along[std::min(n, static_cast<std::size_t>(i))] * dt;
    const double ahead = std::min(i + next * dt / ds, static_cast<double>(n));
    const auto k = static_cast<std::size_t>(ahead);
    const double f = ahead - static_cast<double>(k);
    double allowed = k < n ? (1 - f) * brake[k] + f * brake[k + 1] : 0.0;
    for (std::size_t j = static_cast<std::size_t>(i) + 1; j <= k; ++j)
      allowed = std::min(allowed, brake[j]);
    next = std::clamp(next, 0.01, std::max(0.01, allowed));
    where += 0.5 * (v + next) * dt;
    v = next;
    t += dt;
  }
  return t;
}

TEST(MotionTime, AgreesWithAnIndependentIntegration) {
  struct Case {
    const char* name;
    std::vector<Vec3> points;
    double v, a, feed_mm_min, tolerance_mm;
  };
  std::vector<Vec3> zigzag{{0, 0, 0}};
  for (int i = 1; i < 60; ++i) zigzag.push_back({1.0 * i, i % 2 * 0.7, 0});
  const std::vector<Case> cases = {
      {"gentle pass", pass(11, 120, 0.5, 0.05), 200, 2000, 3000, 0.002},
      {"rough pass", pass(12, 120, 0.5, 0.3), 200, 2000, 3000, 0.002},
      {"rough pass, wide corners", pass(13, 120, 0.5, 0.3), 200, 2000, 6000, 0.01},
      {"slow machine", pass(14, 120, 0.7, 0.2), 30, 300, 3000, 0.005},
      {"zigzag", zigzag, 200, 1500, 9000, 0.03},
  };
  for (const Case& c : cases) {
    const Machine m = machine(c.v, c.a);
    const double ours =
        time_of(lines(c.points, c.feed_mm_min), m, {PathControl::Mode::blend, c.tolerance_mm})
            .cutting_s;
    const double theirs =
        integrated_s(c.points, c.v, c.a, c.feed_mm_min / 60.0, c.tolerance_mm, m.cycle_s);
    EXPECT_NEAR(ours / theirs, 1.0, 0.03) << c.name << ": " << ours << " s, integrated " << theirs;
    EXPECT_GT(
        theirs, 1.05 *
                    [&] {
                      double length = 0.0;
                      for (std::size_t i = 1; i < c.points.size(); ++i)
                        length += norm(c.points[i] - c.points[i - 1]);
                      return length / (c.feed_mm_min / 60.0);
                    }())
        << c.name << ": acceleration matters on this path";
  }
}

// ---- LinuxCNC's own planner ---------------------------------------------------

std::filesystem::path other_programs() {
  return testing_support::data_folder() / "gcode";
}

TEST(MotionTime, AgreesWithLinuxCncOnGeneratedPaths) {
  // tp.c of LinuxCNC 2.9.0 (f1270d6ed7) with its defaults, cycle 1 ms, ran the very same motions.
  struct Case {
    std::vector<Motion> motions;
    Vec3 v, a;
    double tolerance_mm, linuxcnc_s;
  };
  std::vector<Motion> hills;  // arcs in the plane of a pass, as vertices of a mesh leave them
  Vec3 at{0, 0, 0};
  for (std::uint64_t i = 0; i < 300; ++i) {
    const double half = 0.25 + random_uniform(31, 2 * i),
                 high = 0.2 * random_uniform(31, 2 * i + 1);
    const double radius = (half * half + high * high) / (2.0 * high + 1e-3);
    const Vec3 to = at + Vec3{2.0 * half, 0, 0};
    const double below = std::sqrt(radius * radius - half * half);
    hills.push_back(arc(ArcPlane::zx, at, to, at + Vec3{half, 0, -below},
                        2.0 * std::asin(half / radius), 3000));
    hills.push_back(line(to, to + Vec3{1.0, 0, i % 3 == 0 ? 0.05 : 0.0}, 3000));
    at = hills.back().to_mm;
  }
  const Vec3 v{200, 200, 200}, a{2000, 2000, 2000};
  const std::vector<Case> cases = {
      {lines(pass(21, 4000, 0.5, 0.1), 3000), v, a, 0.0005, 65.912},
      {lines(pass(22, 4000, 0.5, 0.3), 3000), v, a, 0.002, 79.242},
      {lines(pass(23, 4000, 0.5, 0.3), 6000), {100, 100, 40}, {1000, 1000, 400}, 0.005, 132.460},
      {lines(walk(24, 1000, 3.0), 12'000), v, a, 0.05, 65.459},
      {hills, v, a, 0.002, 23.271},
  };
  for (const Case& c : cases) {
    Machine m = machine();
    m.max_feed_mm_min = m.rapid_mm_min = 60.0 * c.v;
    m.acceleration_mm_s2 = c.a;
    const auto t = time_of(c.motions, m, {PathControl::Mode::blend, c.tolerance_mm});
    EXPECT_NEAR(t.total_s() / c.linuxcnc_s, 1.0, 0.02)
        << "case " << &c - cases.data() << " " << t.total_s();
  }
}

TEST(MotionTime, AgreesWithLinuxCncOnOtherPeoplesPrograms) {
  struct Case {
    const char* name;
    double linuxcnc_s;
  };
  if (!std::filesystem::exists(other_programs())) GTEST_SKIP() << "set MAQUETTE_DATA";
  for (const Case& c : {Case{"cameo.nc", 11585.253}, Case{"3D_Chips.ngc", 61.251},
                        Case{"arcspiral.ngc", 253.568}, Case{"zigzag_0.002_0.001.ngc", 19.725}}) {
    // LinuxCNC's planner was given the motions with P 0.01, whatever the program says of G64.
    MotionTimer timer(machine(), {PathControl::Mode::blend, 0.01});
    const auto read =
        read_gcode(other_programs() / c.name, [&](std::span<const Motion> motions) -> Result<void> {
          for (Motion m : motions) {
            m.control.reset();
            timer.add(m);
          }
          return {};
        });
    ASSERT_THAT(read, Succeeds());
    timer.rest();
    EXPECT_NEAR(timer.time().total_s() / c.linuxcnc_s, 1.0, 0.02)
        << c.name << " " << timer.time().total_s();
  }
}

// ---- programs, paths, tables ---------------------------------------------------

TEST(MotionTime, APathTakesAsLongAsItsProgram) {
  Toolpath path;
  path.start = {0, 0, 100'000};
  const auto tick = [](double mm) { return std::llround(mm * 1e4); };
  const auto move = [&](PathMove::Kind kind, double x, double y, double z, double feed) {
    PathMove m;
    m.kind = kind;
    m.to = {tick(x), tick(y), tick(z)};
    m.feed_mm_min = feed;
    path.moves.push_back(m);
  };
  move(PathMove::Kind::rapid, 10, 5, 10, 0);
  move(PathMove::Kind::line, 10, 5, 0, 600);
  move(PathMove::Kind::line, 30, 5, 1, 3000);
  path.moves.push_back({PathMove::Kind::arc,
                        ArcPlane::zx,
                        true,
                        {tick(50), tick(5), tick(1)},
                        tick(10),
                        0,
                        tick(-10),
                        3000});
  path.moves.push_back({PathMove::Kind::arc,
                        ArcPlane::xy,
                        false,
                        {tick(50), tick(5), tick(-3)},
                        tick(4),
                        0,
                        0,
                        2000});
  const std::string text =
      "G21 G90 G17\nG0 X0 Y0 Z10\nG0 X10 Y5\nG1 Z0 F600\nX30 Z1 F3000\nG18 G3 X50 Z1 I10 K-10\n"
      "G17 G2 X50 Y5 Z-3 I4 J0 F2000\nM2\n";
  const ScratchFolder folder;
  ASSERT_THAT(write_file(folder / "part.ngc", text), Succeeds());
  const auto program = time_program(folder / "part.ngc", machine(), {});
  ASSERT_THAT(program, Succeeds());
  const MotionTime t = time_path(path, machine(), {});
  EXPECT_NEAR(t.cutting_s, program->cutting_s, 1e-9);
  EXPECT_NEAR(t.rapid_s, program->rapid_s, 1e-9);
  EXPECT_NEAR(t.cutting_mm, program->cutting_mm, 1e-9);
  EXPECT_EQ(t.moves, 5U);
  EXPECT_THAT(time_program(folder / "none.ngc", machine(), {}), FailsWith(kFileNotFound));
}

TEST(MotionTime, TheProgramsOwnPathControlCounts) {
  const ScratchFolder folder;
  const auto seconds = [&](const std::string& control) {
    std::string text = "G21 G90 " + control + "\nG0 X0 Y0 Z0\nF6000\n";
    for (int i = 1; i <= 50; ++i) text += fmt::format("G1 X{} Y{}\n", i, 0.05 * (i % 2));
    EXPECT_THAT(write_file(folder / "part.ngc", text + "M2\n"), Succeeds());
    return time_program(folder / "part.ngc", machine(), {})->cutting_s;
  };
  const double stops = seconds("G61"), fine = seconds("G64 P0.001"), coarse = seconds("G64 P0.1");
  EXPECT_GT(stops, 1.1 * fine);
  EXPECT_GT(fine, 1.1 * coarse);
  EXPECT_EQ(seconds(""), seconds("G64 P0.0005")) << "the caller's, where the program is silent";
}

TEST(MotionTime, TimesAddUp) {
  MotionTime a{1, 2, 3, 4, 5, 6, 7, 8, 0.0, 9}, b{1, 1, 1, 1, 1, 1, 1, 1, 0.5, 3};
  a += b;
  EXPECT_EQ(a.total_s(), 9.0);
  EXPECT_EQ(a.cutting_mm, 6.0);
  EXPECT_EQ(a.moves, 8U);
  EXPECT_EQ(a.shortest_cut_mm, 0.5) << "0 is none";
  EXPECT_EQ(a.highest_blocks_per_s, 9.0);
}

}  // namespace
}  // namespace maquette::cnc
