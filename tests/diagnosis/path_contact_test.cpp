// SPDX-License-Identifier: GPL-3.0-or-later

// What is claimed in diagnosis/path_contact.hpp, and how:
//
//   height and normal ... against the least of dense samples of the path (shares no code)
//   tip, time, length ... of a straight program by hand
//   play ................ sign of the last motion of each axis, by hand
//   flat of a valley .... lost motion of one pass by dense samples
//   lag ................. circle: half the square of the lag over the radius, inwards; between the
//                         corners of a polygon; of one pass by dense samples
//   long lost motion .... of a bent pass by dense samples
//   lag and lost motion . by samples of 1 um
//   known displacements . what asking at each state gives
//   sections ............ tool changes start new ones

#include "diagnosis/path_contact.hpp"

#include "diagnosis/effect.hpp"
#include "diagnosis/surface.hpp"

#include <array>
#include <cmath>
#include <fstream>
#include <numbers>

#include <fmt/format.h>
#include <gtest/gtest.h>

#include "core/random.hpp"
#include "support/matchers.hpp"

namespace maquette::diagnosis {
namespace {

using testing_support::ScratchFolder;

CutPath path_of(const ScratchFolder& scratch, const std::string& text, double radius = 3.0) {
  const auto file = scratch / "part.ngc";
  std::ofstream(file) << text;
  const std::vector<std::filesystem::path> files{file};
  auto path = CutPath::read(files, radius, {});
  EXPECT_TRUE(path.has_value());
  return std::move(*path);
}

/// Of a case whose part does not matter.
Scene scene_of(const CutPath& path, double radius) {
  heightmap::ModelField flat;
  flat.z_mm = Grid<float>(2, 2, 0.0F);
  return diagnosis::scene_of(flat, &path, radius);
}

/// A place of the pass along y = 0.
Observation on_the_pass(const CutPath& path, double x) {
  const auto contact = path.at(x, 0.0);
  EXPECT_TRUE(contact.has_value());
  Observation o;
  static_cast<CutState&>(o) = *contact;
  o.place = {x, 0.0, contact->height_mm};
  o.normal = o.along = contact->normal;
  o.pass = path.pass();
  return o;
}

/// Nodes along a wave of 14 mm.
std::vector<Vec3> wave() {
  std::vector<Vec3> nodes;
  for (int i = 0; i <= 84; ++i) {
    const double x = 0.5 * i;
    nodes.push_back({x, 0.0, 1.2 * std::cos(2.0 * std::numbers::pi * x / 14.0)});
  }
  return nodes;
}

std::string feed_to(const Vec3& p) {
  return fmt::format("G1 X{:.3f} Z{:.6f}\n", p.x, p.z);
}

/// One pass over the nodes.
CutPath path_over(const ScratchFolder& scratch, const std::vector<Vec3>& nodes, double radius_mm) {
  std::string text = fmt::format("G21 F1000\nG0 X0 Y0 Z{:.6f}\n", nodes.front().z);
  for (const Vec3& p : nodes) text += feed_to(p);
  return path_of(scratch, text + "M30\n", radius_mm);
}

/// Samples 1 um apart along the lines between nodes, without the first node.
std::vector<Vec3> sampled(const std::vector<Vec3>& nodes) {
  std::vector<Vec3> tips;
  for (std::size_t i = 1; i < nodes.size(); ++i) {
    const Vec3 way = nodes[i] - nodes[i - 1];
    const int steps = static_cast<int>(std::ceil(norm(way) / 0.001));
    for (int k = 1; k <= steps; ++k)
      tips.push_back(nodes[i - 1] + (static_cast<double>(k) / steps) * way);
  }
  return tips;
}

/// Underside at x of balls at these tips along y = 0.
double lowest_mm(const std::vector<Vec3>& tips, double x, double radius) {
  double least = INFINITY;
  for (const Vec3& t : tips)
    if (const double d = x - t.x; std::abs(d) < radius)
      least = std::fmin(least, t.z + radius - std::sqrt(radius * radius - d * d));
  return least;
}

class CutPathSeeded : public testing::TestWithParam<int> {};
INSTANTIATE_TEST_SUITE_P(Seed, CutPathSeeded, testing::Range(1, 5));

TEST_P(CutPathSeeded, IsTheLeastOfDenseSamples) {
  const auto seed = static_cast<std::uint64_t>(GetParam());
  const ScratchFolder scratch;
  std::vector<Vec3> places;
  std::string text = "G21 G90 G94\nF1000\nG0 X0 Y0 Z9\n";
  places.push_back({0, 0, 9});
  for (int i = 0; i < 60; ++i) {
    const auto u = [&](int k) {
      return random_uniform(seed, static_cast<std::uint64_t>(4 * i + k));
    };
    places.push_back({20.0 * u(0), 20.0 * u(1), 4.0 * u(2)});
    text += fmt::format("G1 X{:.9f} Y{:.9f} Z{:.9f}\n", places.back().x, places.back().y,
                        places.back().z);
  }
  const CutPath path = path_of(scratch, text + "M30\n");
  for (int q = 0; q < 60; ++q) {
    const double x = 20.0 * random_uniform(seed + 99, static_cast<std::uint64_t>(2 * q));
    const double y = 20.0 * random_uniform(seed + 99, static_cast<std::uint64_t>(2 * q + 1));
    double least = INFINITY;
    Vec3 normal;
    for (std::size_t i = 1; i < places.size(); ++i)
      for (int k = 0; k <= 4000; ++k) {
        const Vec3 t = places[i - 1] + (k / 4000.0) * (places[i] - places[i - 1]);
        const double q2 = 9.0 - (x - t.x) * (x - t.x) - (y - t.y) * (y - t.y);
        if (q2 <= 0.0) continue;
        const double z = t.z + 3.0 - std::sqrt(q2);
        if (z >= least) continue;
        least = z;
        normal = (1.0 / 3.0) * (t + Vec3{0, 0, 3.0} - Vec3{x, y, z});
      }
    const auto contact = path.at(x, y);
    ASSERT_EQ(contact.has_value(), std::isfinite(least));
    if (!contact) continue;
    // Samples are 0.007 mm apart at most; near the rim heights change fast.
    EXPECT_LE(contact->height_mm, least + 1e-7) << "written with 9 decimals";
    EXPECT_NEAR(contact->height_mm, least, 2e-5 / std::fmax(0.02, normal.z));
    EXPECT_NEAR(norm(contact->normal), 1.0, 1e-9);
    EXPECT_NEAR(norm(contact->tip + Vec3{0, 0, 3.0} - Vec3{x, y, contact->height_mm}), 3.0, 1e-9);
  }
}

TEST(CutPath, CountsTimeLengthAndSections) {
  const ScratchFolder scratch;
  const CutPath path = path_of(scratch,
                               "G21 G90\nT1 M6\nG0 X0 Y0 Z0\nG1 X100 F1000\nG0 Z10\nT2 M6\nG0 X0 "
                               "Y50\nG1 Z0 F100\nG1 X100 F500\nM30\n");
  const double first = 0.1, up = 0.001, over = std::hypot(100.0, 50.0) / 10'000.0, down = 0.1,
               last = 0.2;
  EXPECT_NEAR(path.duration_min(), first + up + over + down + last, 1e-9);
  const auto a = path.at(25.0, 1.0);
  ASSERT_TRUE(a.has_value());
  EXPECT_NEAR(a->path_share, 0.025 / path.duration_min(), 1e-9);
  EXPECT_NEAR(a->path_mm, 25.0, 1e-9);
  const auto b = path.at(50.0, 50.0);
  ASSERT_TRUE(b.has_value());
  EXPECT_NEAR(b->path_share, 1.0 - 0.1 / path.duration_min(), 1e-9);
  EXPECT_NEAR(b->path_mm, 1000.0 * (first + down + 0.1), 1e-3) << "at the faster of two feeds";
  EXPECT_NEAR(b->cut_share, 160.0 / 210.0, 1e-9);
  EXPECT_NEAR(path.cut_mm(), 1000.0 * (first + down + last), 1e-6);
  ASSERT_EQ(path.section_starts().size(), 1U);
  EXPECT_FALSE(path.at(50.0, 25.0).has_value());
}

TEST(CutPath, BeginsABandWhereItGoesElsewhere) {
  const ScratchFolder scratch;
  const auto pass = [](double y) {
    return fmt::format("G0 X0 Y{0}\nG1 Z0 F1000\nG1 X50 Y{0}\nG0 Z10\n", y);
  };
  // One way, a lift after each pass: 20 passes from y = 20 mm, then 20 from 0.
  std::string one_way = "G21 G90\nG0 Z10\n";
  for (const double start : {20.0, 0.0})
    for (int k = 0; k < 20; ++k) one_way += pass(start + 0.5 * k);
  const auto of_one_way = path_of(scratch, one_way + "M30\n").section_starts();
  ASSERT_EQ(of_one_way.size(), 1U);
  EXPECT_NEAR(of_one_way[0], 0.5, 0.01);
  // A zigzag lifts between its bands alone, wherever the next one is.
  std::string zigzag = "G21 G90\nG0 Z10\n";
  for (const double start : {0.0, 5.0, 10.0}) {
    zigzag += fmt::format("G0 X0 Y{}\nG1 Z0 F1000\n", start);
    for (int k = 0; k < 10; ++k)
      zigzag += fmt::format("G1 Y{}\nG1 X{}\n", start + 0.5 * k, k % 2 == 0 ? 50 : 0);
    zigzag += "G0 Z10\n";
  }
  const auto of_zigzag = path_of(scratch, zigzag + "M30\n").section_starts();
  ASSERT_EQ(of_zigzag.size(), 2U);
  EXPECT_NEAR(of_zigzag[0], 1.0 / 3.0, 0.01);
  EXPECT_NEAR(of_zigzag[1], 2.0 / 3.0, 0.01);
}

TEST(CutPath, FollowsThePlay) {
  const ScratchFolder scratch;
  const CutPath path =
      path_of(scratch, "G21 G90 F1000\nG0 X0 Y0 Z0\nG1 X50 Z5\nG1 Y20 Z5.0\nG1 X0 Z0\nM30\n");
  const auto there = path.at(25.0, 0.0), across = path.at(50.0, 10.0), back = path.at(25.0, 20.0);
  ASSERT_TRUE(there && across && back);
  for (const double width_mm : {0.02, 0.1, 0.4}) {
    // The mean over the cut is taken off, so differences count.
    const Trail slack = path.slack(width_mm);
    const Vec3 a = slack(*there).at, b = slack(*across).at, c = slack(*back).at;
    EXPECT_NEAR(b.x - a.x, 0.0, 1e-6) << "x stands: the slack stays where it was";
    EXPECT_NEAR(b.y - a.y, 1.0, 1e-6) << "y has not moved before";
    EXPECT_NEAR(c.x - a.x, -2.0, 1e-6);
    EXPECT_NEAR(c.y - b.y, 0.0, 1e-6);
    EXPECT_NEAR(c.z - a.z, -2.0, 1e-6);
  }
  // On the way through the slack after a turn.
  const auto turned = path.at(50.0 - 0.3, 20.0);
  ASSERT_TRUE(turned);
  const double way = 50.0 - turned->tip.x;
  ASSERT_LT(way, 0.9);
  const Trail wide = path.slack(1.0);
  EXPECT_NEAR(wide(*turned).at.x - wide(*across).at.x, -2.0 * way, 1e-5);
  EXPECT_NEAR(wide(*turned).per_mm.x, 2.0 * turned->feed.x, 1e-5);
}

class Valley : public testing::TestWithParam<double> {};
INSTANTIATE_TEST_SUITE_P(Width_mm, Valley, testing::Values(40.0, 24.0, 16.0));

TEST_P(Valley, IsFlattenedByLostMotion) {
  // One pass through z = x^2 / w. Its tip stands still in z on the way through the slack, and the
  // ball makes a flat of up to 0.1 mm there. Where the flat ends the ball rests on its corner.
  const ScratchFolder scratch;
  constexpr double kWidth_mm = 0.1, kRadius_mm = 3.0;
  const double wide = GetParam();
  const auto z = [wide](double x) { return x * x / wide; };
  std::string text = fmt::format("G21 F1000\nG0 X-12 Y0 Z{:.6f}\n", z(12.0));
  for (int i = -48; i <= 48; ++i)
    text += fmt::format("G1 X{:.3f} Z{:.6f}\n", 0.25 * i, z(0.25 * i));
  const CutPath path = path_of(scratch, text + "M30\n", kRadius_mm);
  const Scene scene = scene_of(path, kRadius_mm);
  const Form play = find_effect("machine.backlash_z")->forms(scene).at(2);
  // The same by samples: down to the middle, then up.
  const auto lowest = [&](double at, bool slack) {
    double least = INFINITY, real = z(-12.0) + 0.5 * kWidth_mm;
    for (double x = -12.0; x <= 12.0; x += 0.002) {
      real = std::clamp(real, z(x) - 0.5 * kWidth_mm, z(x) + 0.5 * kWidth_mm);
      const double d = at - x;
      if (std::abs(d) < kRadius_mm)
        least = std::fmin(
            least, (slack ? real : z(x)) + kRadius_mm - std::sqrt(kRadius_mm * kRadius_mm - d * d));
    }
    return least;
  };
  const auto moved = [&](double x) {
    const Observation o = on_the_pass(path, x);
    return 0.5 * kWidth_mm * play.columns[0].value(o) / o.normal.z;
  };
  // Moves are swept in halves, 0.125 mm here: a corner in the middle of one is cut off by a quarter
  // of its length times the turn, 3 to 5 um. A straight pass through the displaced tip would be off
  // by 7 um and more.
  const double turn = 2.0 * std::sqrt(kWidth_mm / wide), cut_off = 0.25 * 0.125 * turn + 0.0002;
  const double shift = moved(-8.0) - (lowest(-8.0, true) - lowest(-8.0, false));  // of the mean
  for (double x = -6.0; x < 6.0; x += 0.1)
    EXPECT_NEAR(moved(x) - shift, lowest(x, true) - lowest(x, false), cut_off) << "x = " << x;
}

TEST(CutPath, ALagRoundsOffWhereLostMotionTurnsOver) {
  // Through z = x^2 / 40 and back up, by samples of 1 um: which side of the slack z stands on, and
  // that lagged; or the sides of the lagged height. Compared where the command is, e later.
  const ScratchFolder scratch;
  constexpr double kWidth_mm = 0.1, kLag_mm = 1.5, kStep_mm = 0.001;
  const auto z = [](double x) { return x * x / 40.0; };
  std::string text = "G21 F1000\nG0 X-12 Y0 Z3.6\n";
  for (int i = -48; i <= 48; ++i)
    text += fmt::format("G1 X{:.3f} Z{:.9f}\n", 0.25 * i, z(0.25 * i));
  const CutPath path = path_of(scratch, text + "M30\n", 3.0);
  const Trail alone = path.slack(kWidth_mm);
  for (const bool lag_first : {false, true}) {
    std::vector<double> x_at, way, side, both;
    double lagged = z(-12.0), of_lagged = 0.0, now = 0.0, at = 0.0, later = 0.0;
    for (double x = -12.0; x < 12.0; x += kStep_mm) {
      const double rise = z(x + kStep_mm) - z(x), step = std::hypot(kStep_mm, rise);
      at += step;
      now = std::clamp(now + 2.0 * rise / kWidth_mm, -1.0, 1.0);
      const double before = lagged;
      lagged += step / kLag_mm * (z(x + kStep_mm) - lagged);
      of_lagged = std::clamp(of_lagged + 2.0 * (lagged - before) / kWidth_mm, -1.0, 1.0);
      later += step / kLag_mm * (now - later);
      x_at.push_back(x + kStep_mm);
      way.push_back(at);
      side.push_back(now);
      both.push_back(lag_first ? of_lagged : later);
    }
    const Trail change = path.slack_with_lag(2, kWidth_mm, kLag_mm, lag_first);
    double most = 0.0;
    for (double x = -8.0; x < 8.0; x += 0.0937) {
      const auto contact = path.at(x, 0.0);
      ASSERT_TRUE(contact);
      const auto here = std::upper_bound(x_at.begin(), x_at.end(), contact->tip.x) - x_at.begin();
      const auto there =
          std::upper_bound(way.begin(), way.end(), way[static_cast<std::size_t>(here)] + kLag_mm) -
          way.begin();
      const double is =
          both[static_cast<std::size_t>(there)] - side[static_cast<std::size_t>(here)];
      most = std::fmax(most, std::abs(is));
      // Between places of the program, 0.25 mm apart, the lagged side is taken for a line; the
      // side itself turns over within 2 mm.
      EXPECT_NEAR(change(*contact).at.z, is, 0.03) << "x = " << x << ", lag first " << lag_first;
    }
    // A lagged parabola is the same parabola, e later and lower: it turns at the same place.
    if (lag_first)
      EXPECT_LT(most, 0.02);
    else
      EXPECT_GT(most, 0.2) << "there is something to see";
  }
}

TEST(CutPath, LagsInwardsInABend) {
  const ScratchFolder scratch;
  const CutPath path = path_of(
      scratch, "G21 G90 G17 F1000\nG0 X40 Y0 Z0\nG3 X40 Y0 I-40 J0\nG3 X40 Y0 I-40 J0\nM30\n", 1.0);
  const auto contact = path.at(0.0, 40.0);
  ASSERT_TRUE(contact.has_value());
  for (const double e : {0.3, 1.0, 2.6}) {
    // A first-order lag of a circle of radius r is a circle of radius r / sqrt(1 + (e / r)^2).
    const double radius = 40.0 / std::sqrt(1.0 + e * e / 1600.0);
    const Vec3 lag = path.lag(e)(*contact).at;
    EXPECT_NEAR(lag.y, radius - 40.0, 0.02 * (40.0 - radius) + 2e-3);
    EXPECT_LT(lag.y, 0.0);
  }
}

TEST(CutPath, LagsLessWhereItGoesSlowly) {
  // Two turns at the main feed, then a smaller circle at half of it: there the lag, a time, is half
  // as long.
  const ScratchFolder scratch;
  const CutPath path = path_of(scratch,
                               "G21 G90 G17 F2000\nG0 X40 Y0 Z0\nG3 X40 Y0 I-40 J0\nG3 X40 Y0 "
                               "I-40 J0\nF1000\nG1 X20 Y0\nG3 X20 Y0 I-20 J0\nM30\n",
                               1.0);
  constexpr double kLag_mm = 1.6;
  const auto inwards = [&](double radius) {
    const auto contact = path.at(0.0, radius);
    return contact ? path.lag(kLag_mm)(*contact).at.y : NAN;
  };
  const auto circle = [](double radius, double e) {
    return radius / std::sqrt(1.0 + e * e / (radius * radius)) - radius;
  };
  EXPECT_NEAR(inwards(40.0), circle(40.0, kLag_mm), 2e-3);
  EXPECT_NEAR(inwards(20.0), circle(20.0, 0.5 * kLag_mm), 2e-3);
}

TEST(CutPath, CountsWhereItStops) {
  // A zigzag turns twice at each end; a lift is one stop, however it goes down again. A wall that a
  // pass climbs is none.
  const ScratchFolder scratch;
  const CutPath path = path_of(scratch,
                               "G21 G90 F1000\nG0 X0 Y0 Z5\nG1 Z0\nG1 X20\nG1 X20.5 Z9\nG1 "
                               "X40\nG1 Y1\nG1 X0\nG0 Z20\nG0 Y2\nG1 Z9\nG1 X40\nM30\n",
                               1.0);
  const auto stops = [&](double x, double y) {
    const auto contact = path.at(x, y);
    return contact ? contact->stops : 999U;
  };
  const auto first = stops(10.0, 0.0);
  EXPECT_EQ(stops(30.0, 0.0), first);
  EXPECT_EQ(stops(30.0, 1.0), first + 2);
  EXPECT_EQ(stops(30.0, 2.0), first + 3);
}

TEST(CutPath, ALagIsRoundWhereTheCommandIsStraight) {
  // A polygon of 63 chords of 1 mm: lagged by more it is a circle to 1 um, the command goes in and
  // out by 12 um.
  constexpr int kCorners = 63;
  constexpr double kRadius_mm = 10.0, kHalf = std::numbers::pi / kCorners;
  std::string text = "G21 G90 F1000\nG0 X10 Y0 Z0\n";
  for (int i = 1; i <= 3 * kCorners; ++i)
    text += fmt::format("G1 X{:.6f} Y{:.6f}\n", kRadius_mm * std::cos(2.0 * kHalf * i),
                        kRadius_mm * std::sin(2.0 * kHalf * i));
  const ScratchFolder scratch;
  const CutPath path = path_of(scratch, text + "M30\n", 1.0);
  for (const double e : {1.2, 2.4}) {
    const Trail lag = path.lag(e);
    // The first harmonic of chords, as of all that is interpolated between samples, lagged.
    const double radius = kRadius_mm * std::pow(std::sin(kHalf) / kHalf, 2) /
                          std::sqrt(1.0 + e * e / (kRadius_mm * kRadius_mm));
    for (const double share : {0.02, 0.25, 0.5, 0.75, 0.98}) {
      const Vec3 a{kRadius_mm * std::cos(40.0 * kHalf), kRadius_mm * std::sin(40.0 * kHalf), 0.0},
          b{kRadius_mm * std::cos(42.0 * kHalf), kRadius_mm * std::sin(42.0 * kHalf), 0.0};
      const Vec3 at = a + share * (b - a);
      const auto contact = path.at(at.x, at.y);
      ASSERT_TRUE(contact.has_value());
      const Vec3 tip = at + lag(*contact).at;
      EXPECT_NEAR(std::hypot(tip.x, tip.y), radius, 1e-3) << e << " at " << share;
    }
  }
}

TEST(CutPath, AWaveIsFlattenedByALag) {
  // One pass over a wave. In its pits a ball of 3 mm meets the flatter pass elsewhere.
  const ScratchFolder scratch;
  constexpr double kLag_mm = 1.8, kRadius_mm = 3.0;
  const auto nodes = wave();
  const CutPath path = path_over(scratch, nodes, kRadius_mm);
  const Form form =
      find_effect("machine.servo_lag")->forms(scene_of(path, kRadius_mm)).at(2).of_size(kLag_mm);
  const auto cut = form.columns[0].cut;
  // The same by samples along the way.
  const auto command = sampled(nodes);
  std::vector<Vec3> lagged;
  Vec3 tip = nodes.front(), last = tip;
  for (const Vec3& c : command) {
    tip += (norm(c - last) / kLag_mm) * (c - tip);
    lagged.push_back(tip);
    last = c;
  }
  // And by displacements that are known before.
  const auto pass = path.pass();
  const auto off = [&](const CutState& s) { return cut({}, s, {}).tip_mm; };
  std::vector<std::array<float, 3>> known(pass->states());
  for (std::size_t i = 0; i < known.size(); ++i) {
    const Vec3 d = off(pass->state(i));
    known[i] = {static_cast<float>(d.x), static_cast<float>(d.y), static_cast<float>(d.z)};
  }
  double most = 0.0;
  for (double x = 14.0; x < 28.0; x += 0.23) {
    const Observation o = on_the_pass(path, x);
    const double rise =
        recut_mm(o, kRadius_mm, [&](const CutState& s, Vec3 n) { return cut(o, s, n); }) /
        o.normal.z;
    // Half a millimetre lower.
    EXPECT_NEAR(pass->height_mm(o, x, 0.0, kRadius_mm, known, {0.0, 0.0, -0.5}),
                pass->height_mm(o, x, 0.0, kRadius_mm, off) - 0.5, 1e-6)
        << "x = " << x << ", floats";
    const double truth = lowest_mm(lagged, x, kRadius_mm) - lowest_mm(command, x, kRadius_mm);
    most = std::fmax(most, std::abs(truth));
    // Half moves of 0.25 mm leave out 1 um of a bend; samples of 1 um the same of the lag.
    EXPECT_NEAR(rise, truth, 0.004) << "x = " << x;
  }
  EXPECT_GT(most, 0.2) << "there is something to see";
}

TEST(CutPath, APassThatSlidesAlongItselfKeepsItsBends) {
  // There and back over a wave, with lost motion of 0.4 mm: a straight pass would leave out half
  // the square of 0.2 mm times the wave's curvature, and be met elsewhere: up to 0.03 mm.
  const ScratchFolder scratch;
  constexpr double kWidth_mm = 0.4, kRadius_mm = 3.0, kBack_mm = 10.0;
  const auto nodes = wave();
  std::string text = fmt::format("G21 F1000\nG0 X0 Y0 Z{:.6f}\n", nodes.front().z);
  for (const Vec3& p : nodes) text += feed_to(p);
  text += fmt::format("G1 Y{}\n", kBack_mm);
  for (auto p = nodes.rbegin(); p != nodes.rend(); ++p) text += feed_to(*p);
  const CutPath path = path_of(scratch, text + "M30\n", kRadius_mm);
  const Form play = find_effect("machine.backlash_x")->forms(scene_of(path, kRadius_mm)).at(4);
  const Trail side = path.slack(kWidth_mm);
  const auto command = sampled(nodes);
  double most = 0.0;
  for (double x = 14.0; x < 28.0; x += 0.23) {
    const Observation o = on_the_pass(path, x);
    const double off = -0.5 * kWidth_mm * side(o).at.x;
    most = std::fmax(most, std::abs(off));
    const double rise = 0.5 * kWidth_mm * play.columns[0].value(o) / o.normal.z;
    // Where the straight pass is met and from there by the slope; samples of 1 um.
    EXPECT_NEAR(rise, lowest_mm(command, x - off, kRadius_mm) - lowest_mm(command, x, kRadius_mm),
                1e-5)
        << "x = " << x;
  }
  EXPECT_GT(most, 0.15) << "there is something to see";
}

TEST(CutPath, APassThatIsMovedFarAlongItselfKeepsItsBends) {
  // By 1 mm, as by lost steps: going straight on from each place the pass would be met up to a
  // tenth of a millimetre too deep or too high.
  const ScratchFolder scratch;
  constexpr double kOff_mm = 1.0, kRadius_mm = 3.0;
  const auto nodes = wave();
  const CutPath path = path_over(scratch, nodes, kRadius_mm);
  const auto command = sampled(nodes);
  const CutChange aside{{kOff_mm, 0.0, 0.0}};
  double straight_is_off = 0.0;
  for (double x = 14.0; x < 28.0; x += 0.23) {
    const Observation o = on_the_pass(path, x);
    const double rise =
        recut_mm(o, kRadius_mm, [&](const CutState&, Vec3) { return aside; }) / o.normal.z;
    const double truth =
        lowest_mm(command, x - kOff_mm, kRadius_mm) - lowest_mm(command, x, kRadius_mm);
    // Secants stop within 0.01 mm of where they lead: second order of that is below a micrometre.
    EXPECT_NEAR(rise, truth, 1e-3) << "x = " << x;
    straight_is_off = std::fmax(
        straight_is_off, std::abs(rise_mm({o, o.normal}, kRadius_mm, aside, {0, 0, 1}) - truth));
  }
  EXPECT_GT(straight_is_off, 0.05) << "there is something to see";
}

TEST(CutPath, ABeamMeetsDisplacedPassesBesideTheirPlaces) {
  // Zigzag passes 1 mm apart up and down a slope, off by a tenth along it to either side: every
  // other one then makes most of the surface, which an oblique beam meets beside the place.
  const ScratchFolder scratch;
  constexpr double kRadius_mm = 3.0, kSlope = 0.5, kOff_mm = 0.1;
  std::string text = "G21 G90 F1000\nG0 X0 Y0 Z0\n";
  for (int k = 0; k < 12; ++k) {
    const double to = k % 2 == 0 ? 40.0 : 0.0, from = 40.0 - to;
    text += fmt::format("G1 X{0} Y{1} Z{2}\nG1 X{3} Y{1} Z{4}\n", from, k, kSlope * from, to,
                        kSlope * to);
  }
  const CutPath path = path_of(scratch, text + "M30\n", kRadius_mm);
  // Balls of a straight pass touch their envelope across it: in its section a circle, upright
  // stretched by the slope.
  const double stretch = std::hypot(1.0, kSlope);
  const auto height = [&](double x, double y, double off) {
    double low = INFINITY;
    for (int k = 0; k < 12; ++k)
      if (const double d = y - k; std::abs(d) < kRadius_mm)
        low = std::fmin(low, kSlope * (x - (k % 2 == 0 ? off : -off)) + kRadius_mm -
                                 stretch * std::sqrt(kRadius_mm * kRadius_mm - d * d));
    return low;
  };
  for (const Vec3 beam : {Vec3{0.0, 0.0, -1.0}, normalized(Vec3{0.3, 0.9, -1.0}),
                          normalized(Vec3{-0.2, -0.7, -1.0})}) {
    double most = 0.0, upright = 0.0;
    for (double y = 3.0; y < 8.0; y += 0.0317) {
      std::vector<Rival> rivals;
      const double x = 20.0 + 0.3 * y;
      const auto contact = path.at(x, y, &rivals);
      ASSERT_TRUE(contact.has_value());
      Observation o;
      static_cast<CutState&>(o) = *contact;
      o.place = {x, y, contact->height_mm};
      o.normal = o.along = contact->normal;
      o.rivals = std::make_shared<std::vector<Rival>>(rivals);
      ASSERT_NEAR(o.place.z, height(x, y, 0.0), 1e-9);
      const auto change = [&](const CutState& s, Vec3) {
        return CutChange{{s.feed.x > 0.0 ? kOff_mm : -kOff_mm, 0.0, 0.0}};
      };
      upright = recut_mm(o, kRadius_mm, change);
      o.has_station = true;
      o.beam = beam;
      // Back along the beam to the displaced surface, by halves.
      double below = -0.3, above = 0.3;
      for (int k = 0; k < 60; ++k) {
        const double middle = 0.5 * (below + above);
        const Vec3 q = o.place - middle * beam;
        (q.z < height(q.x, q.y, kOff_mm) ? below : above) = middle;
      }
      const double seen = recut_mm(o, kRadius_mm, change);
      EXPECT_NEAR(seen, -below * dot(beam, o.normal), 1e-9) << "y = " << y;
      most = std::fmax(most, std::abs(seen - upright));
      // What moves all alike is looked up over the place.
      const auto alike = [](const CutState&, Vec3) { return CutChange{{0.05, -0.08, 0.1}}; };
      const double together = recut_mm(o, kRadius_mm, alike);
      o.has_station = false;
      EXPECT_EQ(together, recut_mm(o, kRadius_mm, alike)) << "y = " << y;
    }
    if (beam.z > -0.99) {
      EXPECT_GT(most, 0.01) << "there is something to see";
    }
  }
}

}  // namespace
}  // namespace maquette::diagnosis
