// SPDX-License-Identifier: GPL-3.0-or-later

// What feeds.hpp claims, and how each claim is attacked:
//
//   engaged diameter, thinning ... closed forms; a tooth turned in small steps against the ball
//   chip load .................... table points, between, below, above, deep cuts
//   feed per tooth ............... closed form; chip of the feed is the chip load; caps
//   spindle ...................... closed form, both ends of the machine, the error; slower than
//   asked for feeds of a path .............. laws on a random path: axes, plunge, chip,
//   acceleration naming the reached speed ..... the run takes as long as before few changes
//   .................. feeds kept within a tenth materials .................... all are found, read
//   and plausible; mistakes are named

#include "cnc/feeds.hpp"

#include <numbers>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "cnc/motion_time.hpp"
#include "core/files.hpp"
#include "core/random.hpp"
#include "support/matchers.hpp"

namespace maquette::cnc {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing_support::FailsWith;
using testing_support::ScratchFolder;
using testing_support::Succeeds;
constexpr double kPi = std::numbers::pi;

Material board() {
  return *find_material("polyurethane_650");
}
Machine portal() {
  return *find_machine("portal_mill_2500");
}

TEST(Feeds, EngagedDiameter) {
  // Ball of 6 mm at 0.6 mm: 2 sqrt(0.6 * 5.4) = 3.6; at and beyond its radius the whole.
  EXPECT_NEAR(engaged_diameter_mm(Cutter::ball(3.0), 0.6), 3.6, 1e-12);
  EXPECT_NEAR(engaged_diameter_mm(Cutter::ball(3.0), 3.0), 6.0, 1e-12);
  EXPECT_NEAR(engaged_diameter_mm(Cutter::ball(3.0), 9.0), 6.0, 1e-12);
  EXPECT_NEAR(engaged_diameter_mm(Cutter::flat(5.0), 0.1), 10.0, 1e-12);
  EXPECT_NEAR(engaged_diameter_mm(Cutter::bull(5.0, 1.0), 0.2), 8.0 + 1.2, 1e-12);
}

TEST(Feeds, ChipThinningIsThatOfATurningTooth) {
  EXPECT_EQ(chip_thinning(Cutter::flat(5.0), {10.0, 2.0}), 1.0) << "slot";
  EXPECT_EQ(chip_thinning(Cutter::flat(5.0), {5.0, 2.0}), 1.0) << "half";
  // ae / D = 0.1: sin(acos(0.8)) = 0.6.
  EXPECT_NEAR(chip_thinning(Cutter::flat(5.0), {1.0, 2.0}), 0.6, 1e-12);
  // Ball at ap = 0.6 = R / 5, full width: sin(acos(0.8)) = 0.6 too.
  EXPECT_NEAR(chip_thinning(Cutter::ball(3.0), {9.0, 0.6}), 0.6, 1e-12);
  EXPECT_NEAR(chip_thinning(Cutter::ball(3.0), {0.36, 0.6}), 0.36, 1e-12) << "both";
  EXPECT_EQ(chip_thinning(Cutter::ball(3.0), {1.0, 0.0}), 0.0);
  EXPECT_EQ(chip_thinning(Cutter::ball(3.0), {0.0, 1.0}), 0.0);

  // A tooth of a ball turned through its cut in small steps: the chip is the part of the
  // advance along the surface's normal, at each height below ap.
  for (const auto& [ae, ap] : {std::pair{0.5, 0.3}, {1.0, 1.0}, {0.2, 2.9}, {4.0, 0.8}}) {
    const double r = 3.0, f = 0.01, top = 2.0 * std::sqrt(ap * (2.0 * r - ap));
    double thickest = 0.0;
    for (int i = 0; i <= 2000; ++i) {
      const double phi = 0.5 * kPi * i / 2000.0;
      if (0.5 * top * (1.0 - std::cos(phi)) > ae) break;
      for (int k = 1; k <= 200; ++k) {
        const double z = ap * k / 200.0, radius = std::sqrt(z * (2.0 * r - z));
        const Vec3 normal = (1.0 / r) * Vec3{radius * std::sin(phi), radius * std::cos(phi), z - r};
        thickest = std::fmax(thickest, dot(normal, {f, 0, 0}));
      }
    }
    // The last step of the turn may be missed: 2000 of them to a quarter turn.
    EXPECT_NEAR(chip_thinning(Cutter::ball(r), {ae, ap}), thickest / f, 1e-3) << ae << " " << ap;
  }
}

TEST(Feeds, ChipLoadFollowsTheTable) {
  const Material m = board();
  ASSERT_EQ(m.cutter_diameter_mm[0], 3.175);
  EXPECT_EQ(chip_load_mm(m, Cutter::ball(3.175), 1.0), m.chip_load_mm[1]);
  EXPECT_NEAR(chip_load_mm(m, Cutter::ball(0.5 * (3.175 + 6.35) / 2.0), 1.0),
              0.5 * (m.chip_load_mm[0] + m.chip_load_mm[1]), 1e-12);
  EXPECT_NEAR(chip_load_mm(m, Cutter::ball(0.5), 0.5), m.chip_load_mm[0] / 3.175, 1e-12);
  EXPECT_EQ(chip_load_mm(m, Cutter::flat(20.0), 5.0), m.chip_load_mm.back());
  EXPECT_EQ(chip_load_mm(m, Cutter::flat(6.35), 0.0), m.chip_load_mm.back());
  // 25 % less at two diameters, 50 % at three, never more than 75 %.
  const double full = m.chip_load_mm.back();
  EXPECT_NEAR(chip_load_mm(m, Cutter::flat(6.35), 25.4), 0.75 * full, 1e-12);
  EXPECT_NEAR(chip_load_mm(m, Cutter::flat(6.35), 38.1), 0.50 * full, 1e-12);
  EXPECT_NEAR(chip_load_mm(m, Cutter::flat(6.35), 500.0), 0.25 * full, 1e-12);
}

TEST(Feeds, TheFeedPerToothGivesTheChipLoad) {
  const Material m = board();
  const double loose = 1e9;
  for (std::uint64_t i = 0; i < 1000; ++i) {
    const double radius = 0.5 + 8.0 * random_uniform(1, 4 * i);
    const Cutter c = Cutter::bull(radius, radius * random_uniform(1, 4 * i + 1));
    const Engagement e{2.5 * radius * random_uniform(1, 4 * i + 2),
                       1.5 * radius * random_uniform(1, 4 * i + 3)};
    const double f = feed_per_tooth_mm(m, c, e, loose), h = chip_load_mm(m, c, e.depth_mm);
    const double thinning = chip_thinning(c, e);
    EXPECT_NEAR(f, thinning > 0.25 ? h / thinning : 4.0 * h, 1e-12);
    EXPECT_LE(f * thinning, h * (1 + 1e-12));
    // Cusps: f^2 / 8 r.
    const double tight = feed_per_tooth_mm(m, c, e, 1e-4);
    EXPECT_LE(tight * tight / (8.0 * c.corner_radius_mm), 1e-4 * (1 + 1e-12));
  }
  EXPECT_EQ(feed_per_tooth_mm(m, Cutter::flat(3.0), {}, loose),
            4.0 * chip_load_mm(m, Cutter::flat(3.0), 0.0))
      << "in air";
}

TEST(Feeds, SpindleTurnsAsFastAsMaterialAndMachineAllow) {
  Machine machine = portal();
  Tool tool;
  tool.cutter = Cutter::flat(10.0);
  Material m = board();
  m.max_surface_speed_m_min = 628.5;  // 10 003 rpm at 20 mm
  EXPECT_EQ(spindle_speed(machine, m, tool, 5.0)->rpm, 10'000.0);
  tool.cutter = Cutter::ball(3.0);  // at 0.6 mm the ball is 3.6 mm wide: 55 000 rpm
  const auto capped = spindle_speed(machine, m, tool, 0.6);
  ASSERT_THAT(capped, Succeeds());
  EXPECT_EQ(capped->rpm, machine.max_spindle_rpm);
  EXPECT_NEAR(capped->surface_speed_m_min, 24'000.0 * 3.6e-3 * std::numbers::pi, 1e-9);
  EXPECT_FALSE(capped->below_material) << capped->surface_speed_m_min;
  tool.cutter = Cutter::flat(10.0);
  machine.min_spindle_rpm = 12'000.0;
  const auto fast = spindle_speed(machine, m, tool, 5.0);
  ASSERT_THAT(fast, FailsWith(kSpindleOutOfRange));
  EXPECT_THAT(fast.error().message, AllOf(HasSubstr("10003 rpm"), HasSubstr("slower than 12000")));
}

TEST(Feeds, ABallThatOnlyTouchesTurnsAsFastAsTheMachineCan) {
  const Machine machine = portal();
  const Material m = board();
  Tool tool;
  tool.teeth = 2;
  tool.cutter = Cutter::ball(0.5);
  // 0.02 mm deep the ball is 2 sqrt(0.02 * 0.98) = 0.28 mm wide.
  const double wide = 0.28e-3 * std::numbers::pi, depth = 0.02;
  ASSERT_GT(m.min_surface_speed_m_min / wide, machine.max_spindle_rpm) << "else nothing is shown";
  const auto speed = spindle_speed(machine, m, tool, depth);
  ASSERT_THAT(speed, Succeeds());
  EXPECT_EQ(speed->rpm, machine.max_spindle_rpm);
  EXPECT_NEAR(speed->surface_speed_m_min, machine.max_spindle_rpm * wide, 1e-9);
  EXPECT_TRUE(speed->below_material);
  // The feed is that of the chip at the speed that it has.
  Toolpath path;
  path.start = {0, 0, 50'000};
  const auto put = [&](PathMove::Kind kind, std::int64_t x, std::int64_t z) {
    PathMove move;
    move.kind = kind;
    move.to = {x, 0, z};
    move.feed_mm_min = 1.0;
    path.moves.push_back(move);
  };
  put(PathMove::Kind::line, 0, 0);
  put(PathMove::Kind::line, 5'000'000, 0);
  const Engagement engagement{1.0, depth};
  const auto report = set_feeds(path, machine, m, tool, {&engagement, 1});
  ASSERT_THAT(report, Succeeds());
  EXPECT_EQ(report->spindle_rpm, machine.max_spindle_rpm);
  const double by_chip =
      machine.max_spindle_rpm * 2 * feed_per_tooth_mm(m, tool.cutter, engagement, 0.005);
  ASSERT_LT(by_chip, machine.max_feed_mm_min.x);
  EXPECT_LE(path.moves[1].feed_mm_min, by_chip * (1 + 1e-12));
  EXPECT_GE(path.moves[1].feed_mm_min, 0.99 * by_chip);
}

/// Down, rough passes with an arc now and then, up.
Toolpath random_path(std::uint64_t seed, int n) {
  Toolpath path;
  path.start = {0, 0, 200'000};
  const auto put = [&](PathMove::Kind kind, std::int64_t x, std::int64_t y, std::int64_t z) {
    PathMove m;
    m.kind = kind;
    m.to = {x, y, z};
    m.feed_mm_min = 1.0;
    path.moves.push_back(m);
  };
  put(PathMove::Kind::rapid, 0, 0, 50'000);
  put(PathMove::Kind::line, 0, 0, 0);
  std::int64_t x = 0, z = 0;
  for (int i = 0; i < n; ++i) {
    const auto k = static_cast<std::uint64_t>(i);
    x += 2000 + static_cast<std::int64_t>(8000 * random_uniform(seed, 2 * k));
    if (i % 7 == 3) {  // a hill of half a turn, radius 1 mm: steepest at its ends, and a bowl
      PathMove m;
      m.kind = PathMove::Kind::arc;
      m.plane = ArcPlane::zx;
      m.counter_clockwise = i % 2 == 0;
      m.i = 10'000;
      put(PathMove::Kind::line, x, 0, z);
      x += 20'000;
      m.to = {x, 0, z};
      path.moves.push_back(m);
      continue;
    }
    z += static_cast<std::int64_t>(5000 * random_normal(seed + 1, k));
    put(PathMove::Kind::line, x, 0, z);
    if (i % 50 == 49) put(PathMove::Kind::line, x, 0, z);  // a block without a way
  }
  put(PathMove::Kind::rapid, x, 0, 200'000);
  return path;
}

TEST(Feeds, KeepEveryLimitOnARandomPath) {
  Machine machine = portal();
  machine.max_feed_mm_min = {9000.0, 6000.0, 2500.0};
  machine.max_plunge_mm_min = 1500.0;
  machine.max_spindle_rpm = 5000.0;
  const Material m = board();
  Tool tool;
  tool.teeth = 2;
  Toolpath path = random_path(5, 3000);
  std::vector<Engagement> engagement;
  for (std::uint64_t i = 0; i < path.moves.size(); ++i)
    engagement.push_back({3.0 * random_uniform(9, 2 * i), 1.5 * random_uniform(9, 2 * i + 1)});
  const FeedOptions options{0.005, {PathControl::Mode::blend, 0.002}};
  const auto report = set_feeds(path, machine, m, tool, engagement, options);
  ASSERT_THAT(report, Succeeds());

  double before = 0.0;
  std::uint64_t changes = 0, moves = 0;
  ToolPosition from = path.start;
  for (std::size_t i = 0; i < path.moves.size(); ++i) {
    const PathMove& move = path.moves[i];
    const ToolPosition begin = from;
    from = move.to;
    if (move.kind == PathMove::Kind::rapid) continue;
    ++moves;
    const double f = move.feed_mm_min;
    ASSERT_GT(f, 0.0);
    ASSERT_GE(f, report->lowest_mm_min);
    ASSERT_LE(f, report->highest_mm_min);
    changes += f != before;
    before = f;
    const double chip =
        report->spindle_rpm * 2 * feed_per_tooth_mm(m, tool.cutter, engagement[i], 0.005);
    ASSERT_LE(f, chip * (1 + 1e-12)) << i;
    if (begin == move.to) continue;
    // Directions by chords of a hundredth.
    Motion motion = motion_of(begin, move);
    Vec3 last = motion.from_mm;
    for_each_chord(motion, 1e-4, [&](Vec3, Vec3 to) {
      const Vec3 u = normalized(to - last);
      last = to;
      ASSERT_LE(f * std::fabs(u.x), 9000.0 * 1.001) << i;
      ASSERT_LE(f * std::fabs(u.z), 2500.0 * 1.001) << i;
      // 0.01 for the chord's own angle.
      ASSERT_LE(f * (-u.z - 0.01), std::fmin(1500.0, m.plunge_share * chip)) << i;
    });
  }
  EXPECT_EQ(report->changes, changes);
  EXPECT_EQ(report->moves, moves);
  EXPECT_EQ(report->by_chip + report->by_axes + report->by_plunge + report->by_acceleration, moves);
  EXPECT_GT(report->by_chip, 10U);
  EXPECT_GT(report->by_axes, 10U);
  EXPECT_GT(report->by_plunge, 10U);
  EXPECT_GT(report->by_acceleration, 100U);
  // The same path again: nothing is left to lower by more than rounding.
  Toolpath fixed = path;
  ASSERT_THAT(set_feeds(fixed, machine, m, tool, engagement, options), Succeeds());
  for (std::size_t i = 0; i < path.moves.size(); ++i)
    EXPECT_EQ(fixed.moves[i].feed_mm_min, path.moves[i].feed_mm_min) << "a function of the path";
}

TEST(Feeds, AnArcThatTurnsOverIsSteepestInItsMiddle) {
  // Half a turn of radius 40 mm about (0, 0, 0), from its top over +x to its bottom: level at both
  // ends.
  Toolpath path;
  path.start = {0, 0, 400'000};
  PathMove m;
  m.kind = PathMove::Kind::arc;
  m.plane = ArcPlane::zx;
  m.counter_clockwise = true;  // from z to x
  m.to = {0, 0, -400'000};
  m.k = -400'000;
  path.moves = {m};
  Machine machine = portal();
  machine.max_plunge_mm_min = 700.0;
  const Engagement e{3.0, 1.0};
  ASSERT_THAT(set_feeds(path, machine, board(), {}, std::span(&e, 1)), Succeeds());
  EXPECT_EQ(path.moves[0].feed_mm_min, 700.0);
  path.start.z = -400'000;  // the same half turn upwards
  path.moves[0].to.z = 400'000;
  path.moves[0].k = 400'000;
  path.moves[0].counter_clockwise = false;
  ASSERT_THAT(set_feeds(path, machine, board(), {}, std::span(&e, 1)), Succeeds());
  EXPECT_GT(path.moves[0].feed_mm_min, 2000.0);
}

TEST(Feeds, NamingTheReachedSpeedCostsNoTime) {
  const Machine machine = portal();
  Tool tool;
  Toolpath path = random_path(6, 2000);
  const PathControl control{PathControl::Mode::blend, 0.002};
  const Engagement e{0.5, 0.5};
  // Without acceleration in the way there is nothing to name.
  Machine strong = machine;
  strong.acceleration_mm_s2 = {1e6, 1e6, 1e6};
  ASSERT_THAT(set_feeds(path, strong, board(), tool, std::span(&e, 1), {0.005, control}),
              Succeeds());
  const MotionTime plain = time_path(path, machine, control);
  const auto report = set_feeds(path, machine, board(), tool, std::span(&e, 1), {0.005, control});
  ASSERT_THAT(report, Succeeds());
  EXPECT_GT(report->by_acceleration, report->moves / 10);
  const MotionTime named = time_path(path, machine, control);
  // Feeds are at least what is reached; kept ones may lose up to a tenth where cruising.
  EXPECT_NEAR(named.cutting_s / plain.cutting_s, 1.0, 0.02);
  EXPECT_GT(plain.cutting_s / plain.programmed_s, 3.0);
  // A factor of two at most where it is named, and what is lost within a move.
  EXPECT_LT(named.cutting_s / named.programmed_s, 2.2) << "feeds that are nearly kept";
  EXPECT_LT(report->changes, 0.6 * static_cast<double>(report->moves)) << "feeds are kept";
}

TEST(Feeds, MaterialsAreFoundAndPlausible) {
  EXPECT_THAT(material_names(), testing::ElementsAre("aluminium_6061", "hardwood", "machinable_wax",
                                                     "polyurethane_1000", "polyurethane_450",
                                                     "polyurethane_650", "softwood"));
  for (const std::string& name : material_names()) {
    SCOPED_TRACE(name);
    const auto m = find_material(name);
    ASSERT_THAT(m, Succeeds());
    EXPECT_EQ(m->name, name);
    EXPECT_TRUE(std::is_sorted(m->chip_load_mm.begin(), m->chip_load_mm.end()));
    for (std::size_t i = 0; i < m->chip_load_mm.size(); ++i) {
      EXPECT_GT(m->chip_load_mm[i], 0.005 * m->cutter_diameter_mm[i]);
      EXPECT_LT(m->chip_load_mm[i], 0.06 * m->cutter_diameter_mm[i]);
    }
  }
  const double soft = find_material("polyurethane_450")->chip_load_mm[1];
  const double hard = find_material("polyurethane_1000")->chip_load_mm[1];
  EXPECT_GT(soft, board().chip_load_mm[1]);
  EXPECT_GT(board().chip_load_mm[1], hard);
}

TEST(Feeds, MistakesInMaterialsAreNamed) {
  const std::string text(built_in_data("materials", "softwood"));
  const auto message = [&](const std::string& what, const std::string& by) {
    std::string t = text;
    const std::size_t at = t.find(what);
    EXPECT_NE(at, std::string::npos) << what;
    const auto m = parse_material(t.replace(at, what.size(), by), "wood.toml");
    EXPECT_THAT(m, FailsWith(kDataFile));
    return m ? "" : m.error().message;
  };
  EXPECT_THAT(message("plunge_share", "plunge_shore"), HasSubstr("did you mean 'plunge_share'?"));
  EXPECT_THAT(message("0.48]", "0.48, 0.5]"), HasSubstr("4 diameters, but 5 chip loads"));
  EXPECT_THAT(message("9.525, 12.7", "12.7, 9.525"), HasSubstr("9.525 follows 12.7"));
  EXPECT_THAT(message("min_surface_speed_m_min = 60.0", "min_surface_speed_m_min = 6000.0"),
              HasSubstr("is above max_surface_speed_m_min"));
  EXPECT_THAT(find_material("softwod"), FailsWith(kUnknownMaterial));
  EXPECT_THAT(find_material("softwod").error().message, HasSubstr("did you mean 'softwood'?"));
  const ScratchFolder folder;
  ASSERT_THAT(write_file(folder / "wood.toml", text), Succeeds());
  EXPECT_THAT(find_material((folder / "wood.toml").string()), Succeeds());
  EXPECT_THAT(find_material((folder / "none.toml").string()), FailsWith(kFileNotFound));
}

}  // namespace
}  // namespace maquette::cnc
