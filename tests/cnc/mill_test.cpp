// SPDX-License-Identifier: GPL-3.0-or-later

// What is claimed in cnc/mill.hpp, pass_sampler.hpp, path_filter.hpp, gcode_writer.hpp and
// posts.hpp, and how each claim is attacked:
//
//   bounds between samples ....... dense exact cutter locations on kind and harsh ground
//   certified_gouge .............. every move of the written text, read back by a ten-line
//                                  parser, against the exact cutter location at fine steps
//   <= tolerance ................. on every ground, walls included
//   deviation above .............. the same, on ground without walls
//   every sample is checked ...... random jagged lines through the filter
//   raster ....................... rows, ends, stepover, bands, zig-zag and one way
//   no rapid below clearance ..... read back
//   words and numbers ............ modal words dropped, shortest decimals, post differences
//   figures of the report ........ counted again from the text
//   same bytes ................... 1 and 3 threads
//   errors ....................... one case per code; nothing is left on disk

#include "cnc/mill.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>
#include <sstream>
#include <stop_token>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <oneapi/tbb/global_control.h>

#include "cnc/cutter_location.hpp"
#include "cnc/gcode_writer.hpp"
#include "cnc/pass_sampler.hpp"
#include "cnc/path_filter.hpp"
#include "core/files.hpp"
#include "core/random.hpp"
#include "core/vec.hpp"
#include "support/matchers.hpp"
#include "support/terrain.hpp"

namespace maquette::cnc {
namespace {

using heightmap::ModelField;
using testing::HasSubstr;
using testing::Not;
using testing_support::FailsWith;
using testing_support::flat_field;
using testing_support::Ground;
using testing_support::ScratchFolder;

// ---- reading back --------------------------------------------------------------------

struct Move {
  int motion;
  Vec3 from, to;
  double feed;
};

/// Only what our own writer uses: G0/G1 with X Y Z F, all modal.
std::vector<Move> moves_of(const std::string& program) {
  std::vector<Move> moves;
  std::istringstream lines(program);
  std::string line;
  int motion = -1;
  Vec3 at{NAN, NAN, NAN};
  double feed = 0.0;
  while (std::getline(lines, line)) {
    if (line.empty() || line[0] == '(' || line[0] == 'T' || line[0] == 'M' || line[0] == 'S')
      continue;
    if (line.rfind("G2", 0) == 0 || line.rfind("G64", 0) == 0 || line.rfind("G43", 0) == 0)
      continue;
    const Vec3 from = at;
    for (std::size_t i = 0; i < line.size();) {
      const char letter = line[i++];
      double value = NAN;
      const auto [end, error] = std::from_chars(line.data() + i, line.data() + line.size(), value);
      EXPECT_EQ(error, std::errc{}) << line;
      i = static_cast<std::size_t>(end - line.data());
      switch (letter) {
        case 'G':
          motion = static_cast<int>(value);
          break;
        case 'X':
          at.x = value;
          break;
        case 'Y':
          at.y = value;
          break;
        case 'Z':
          at.z = value;
          break;
        case 'F':
          feed = value;
          break;
        default:
          ADD_FAILURE() << "word " << letter << " in " << line;
      }
    }
    moves.push_back({motion, from, at, feed});
  }
  return moves;
}

struct Program {
  MillReport report;
  std::string text;
  std::vector<Move> moves;
  [[nodiscard]] std::vector<Move> cuts() const {
    std::vector<Move> found;
    for (const Move& m : moves)
      if (m.motion == 1) found.push_back(m);
    return found;
  }
};

Program milled(const ModelField& field, const MillOptions& options) {
  const ScratchFolder folder;
  const auto report = mill(field, options, folder / "part.ngc");
  if (!report) {
    ADD_FAILURE() << report.error().code.name << ": " << report.error().message;
    return {};
  }
  std::string text = *read_file(folder / "part.ngc");
  auto moves = moves_of(text);
  return {*report, std::move(text), std::move(moves)};
}

struct Deviation {
  double deepest = -INFINITY, highest = -INFINITY;
};

/// Written moves against the exact cutter location, every `step_mm` and at both ends.
Deviation deviation(const Program& program, const ModelField& field, double radius,
                    double step_mm) {
  DropCutter cutter(field, Cutter::ball(radius));
  Deviation d;
  for (const Move& m : program.cuts()) {
    const double length = std::hypot(m.to.x - m.from.x, m.to.y - m.from.y);
    if (length == 0.0) continue;  // plunge
    const int n = static_cast<int>(std::ceil(length / step_mm));
    for (int k = 0; k <= n; ++k) {
      const double t = static_cast<double>(k) / n;
      const Vec3 p = m.from + t * (m.to - m.from);
      const double below = cutter.drop(p.x, p.y).tip_mm - p.z;
      d.deepest = std::max(d.deepest, below);
      d.highest = std::max(d.highest, -below);
    }
  }
  return d;
}

// ---- closed forms ------------------------------------------------------------------------

TEST(Mill, CutsFlatGroundWithOneMoveAPass) {
  const Program p = milled(flat_field(5, 21, 0.5, 2.5F), {});
  const auto cuts = p.cuts();
  ASSERT_EQ(p.report.passes, 5U);
  ASSERT_EQ(cuts.size(), 1U + 5U + 4U);  // plunge, passes, links
  for (const Move& m : cuts) EXPECT_EQ(m.to.z, 2.5);
  EXPECT_EQ(cuts[0].from.z, 7.5);
  EXPECT_EQ(cuts[0].feed, 600.0);
  EXPECT_EQ(cuts[1].feed, 3000.0);
  EXPECT_NEAR(p.report.path_length_mm, 5.0 + 5 * 10.0 + 4 * 0.5, 1e-9);
  EXPECT_NEAR(p.report.cutting_time_min, 5.0 / 600.0 + 52.0 / 3000.0, 1e-12);
  EXPECT_LE(p.report.certified_gouge_mm, 1e-8);
  EXPECT_NEAR(p.report.scallop_flat_mm, 3.0 - std::sqrt(9.0 - 0.0625), 1e-12);
}

TEST(Mill, FollowsATiltedPlaneAtItsRaise) {
  ModelField plane = flat_field(21, 41, 0.5, 0.0F);
  for (std::ptrdiff_t r = 0; r < 21; ++r)
    for (std::ptrdiff_t c = 0; c < 41; ++c)
      plane.z_mm(r, c) = static_cast<float>(0.5 * plane.x_mm(c));
  const Program p = milled(plane, {});
  const double raise = 3.0 * (std::sqrt(1.25) - 1.0);
  for (const Move& m : p.cuts()) {
    // Near the lower end the ball still touches the plane; near the upper one it leaves it.
    if (m.to.x > 20.0 - 3.0) continue;
    EXPECT_NEAR(m.to.z, 0.5 * m.to.x + raise, 0.0101);
  }
}

TEST(Mill, PassesStartAndEndOnTheOutlineAStepoverApart) {
  ModelField field = testing_support::ground(Ground::rolling, 3, 30, 0.5);
  MillOptions o;
  o.stepover = Millimetres{0.4};
  const Program p = milled(field, o);
  std::vector<double> rows;
  for (const Move& m : p.cuts())
    if (m.from.y == m.to.y && m.from.x != m.to.x && (rows.empty() || rows.back() != m.to.y))
      rows.push_back(m.to.y);
  ASSERT_EQ(rows.size(), p.report.passes);
  EXPECT_EQ(rows.front(), 1.25);
  EXPECT_EQ(rows.back(), 1.25 + 14.5);
  for (std::size_t i = 1; i < rows.size(); ++i) {
    EXPECT_LE(rows[i] - rows[i - 1], 0.4 + 1e-9);
    if (i + 1 < rows.size()) {
      EXPECT_NEAR(rows[i] - rows[i - 1], 0.4, 1.1e-4);
    }
  }
  double left = INFINITY, right = -INFINITY;
  for (const Move& m : p.cuts()) {
    left = std::min(left, m.to.x);
    right = std::max(right, m.to.x);
  }
  EXPECT_EQ(left, -3.0);
  EXPECT_EQ(right, -3.0 + 14.5);
}

TEST(Mill, ABandKeepsToItsRows) {
  const ModelField field = testing_support::ground(Ground::rolling, 5, 30, 0.5);
  MillOptions o;
  o.first_y_mm = 4.3;
  o.last_y_mm = 9.05;
  const Program p = milled(field, o);
  double low = INFINITY, high = -INFINITY;
  for (const Move& m : p.cuts()) {
    low = std::min(low, m.to.y);
    high = std::max(high, m.to.y);
  }
  EXPECT_EQ(low, 4.3);
  EXPECT_EQ(high, 9.05);
  EXPECT_EQ(p.report.passes, 11U);
  o.last_y_mm = 4.3;
  EXPECT_EQ(milled(field, o).report.passes, 1U);
}

TEST(Mill, OneWayAlwaysCutsEastwardsAndReturnsAboveTheClearancePlane) {
  const ModelField field = testing_support::ground(Ground::rough, 5, 20, 0.5);
  MillOptions o;
  o.zigzag = false;
  const Program p = milled(field, o);
  for (const Move& m : p.cuts()) {
    EXPECT_GE(m.to.x, m.from.x);
    EXPECT_EQ(m.to.y, m.from.y);
  }
  EXPECT_LE(deviation(p, field, 3.0, 0.01).deepest, p.report.certified_gouge_mm);
}

TEST(Mill, NoRapidBelowTheClearancePlane) {
  for (const bool zigzag : {false, true}) {
    const ModelField field = testing_support::ground(Ground::spikes, 2, 20, 0.5);
    const double top = static_cast<double>(heightmap::height_range(field.z_mm).max);
    MillOptions o;
    o.zigzag = zigzag;
    const Program p = milled(field, o);
    int rapids = 0;
    for (const Move& m : p.moves) {
      if (m.motion != 0) continue;
      ++rapids;
      EXPECT_GE(m.to.z, top + 5.0);
      if (m.from.z < top) {
        EXPECT_EQ(m.from.x, m.to.x);
        EXPECT_EQ(m.from.y, m.to.y);
      }
    }
    EXPECT_GE(rapids, 3);
    EXPECT_EQ(p.moves.back().motion, 0);
  }
}

// ---- bounds under attack -------------------------------------------------------------------

class PathOnTerrain : public testing::TestWithParam<std::tuple<Ground, int>> {
 protected:
  const Ground kind = std::get<0>(GetParam());
  const std::uint64_t seed = static_cast<std::uint64_t>(std::get<1>(GetParam()));
  const ModelField ground =
      testing_support::ground(kind, seed, 24, std::vector{0.5, 0.37, 1.0}[seed % 3]);
  const double radius = std::vector{3.0, 1.5}[seed % 2];
  [[nodiscard]] bool walls() const {
    return kind != Ground::flat && kind != Ground::rolling && kind != Ground::rough;
  }
};

TEST_P(PathOnTerrain, StaysInsideTheBoundsBetweenSamples) {
  DropCutter cutter(ground, Cutter::ball(radius));
  const SteepnessTiles tiles(ground, {radius});
  const double side = ground.spacing.value() * 23.0;
  const auto ticks = [](double mm) { return static_cast<std::int64_t>(std::floor(mm * 1e4)); };
  for (const Axis axis : {Axis::x, Axis::y})
    for (const double share : {0.0, 0.31, 0.5, 1.0}) {
      const double along0 = axis == Axis::x ? ground.x0.value() : ground.y0.value();
      const double across0 = axis == Axis::x ? ground.y0.value() : ground.x0.value();
      const std::int64_t across = ticks(across0 + share * side);
      std::vector<PathSample> samples;
      sample_line(cutter, tiles, ground, {radius}, axis, ticks(along0) + 1, ticks(along0 + side),
                  across, {}, samples);
      ASSERT_EQ(samples.front().tick, ticks(along0) + 1);
      ASSERT_EQ(samples.back().tick, ticks(along0 + side));
      for (std::size_t i = 0; i + 1 < samples.size(); ++i) {
        const PathSample &a = samples[i], &b = samples[i + 1];
        ASSERT_LT(a.tick, b.tick);
        EXPECT_LE(a.gouge_mm, 0.003 + 1e-12);
        const double ta = mm_of_ticks(a.tick), tb = mm_of_ticks(b.tick);
        for (int k = 0; k <= 10; ++k) {
          const double t = ta + (tb - ta) * k / 10.0;
          const double tip = axis == Axis::x ? cutter.drop(t, mm_of_ticks(across)).tip_mm
                                             : cutter.drop(mm_of_ticks(across), t).tip_mm;
          const double path = a.tip_mm + (b.tip_mm - a.tip_mm) * k / 10.0;
          ASSERT_LE(tip - path, a.gouge_mm + 1e-9) << "at " << t;
          ASSERT_LE(path - tip, a.dip_mm + std::max(a.lift_mm, b.lift_mm) + 1e-9) << "at " << t;
        }
      }
    }
}

TEST_P(PathOnTerrain, WrittenProgramNeverGougesDeeperThanCertified) {
  MillOptions o;
  o.ball_diameter = Millimetres{2.0 * radius};
  o.stepover = Millimetres{1.1};
  o.tolerance = Millimetres{std::vector{0.01, 0.003, 0.05}[seed % 3]};
  const Program p = milled(ground, o);
  const Deviation d = deviation(p, ground, radius, 0.01);
  EXPECT_LE(d.deepest, p.report.certified_gouge_mm);
  EXPECT_LE(p.report.certified_gouge_mm, o.tolerance.value());
  if (!walls()) {
    EXPECT_LE(d.highest, o.tolerance.value());
  }
  if (kind == Ground::rough) {  // the bound is not idle: most of it is used
    EXPECT_GE(d.deepest, 0.5 * p.report.certified_gouge_mm);
  }
  double low = INFINITY, high = -INFINITY;
  for (const Move& m : p.cuts()) {
    low = std::min(low, m.to.z);
    high = std::max(high, m.to.z);
  }
  EXPECT_EQ(low, p.report.lowest_tip_mm);
  EXPECT_EQ(high, p.report.highest_tip_mm);
}

INSTANTIATE_TEST_SUITE_P(Seeds, PathOnTerrain,
                         testing::Combine(testing::ValuesIn(testing_support::kGrounds),
                                          testing::Range(1, 5)),
                         [](const auto& param) {
                           return std::string(testing_support::name(std::get<0>(param.param))) +
                                  "_seed" + std::to_string(std::get<1>(param.param));
                         });

class FilterOnJaggedLines : public testing::TestWithParam<int> {};

TEST_P(FilterOnJaggedLines, KeepsEverySampleInsideItsBand) {
  const auto seed = static_cast<std::uint64_t>(GetParam());
  std::vector<PathSample> samples;
  std::int64_t tick = -70000;
  double z = 0.0;
  for (std::uint64_t i = 0; i < 3000; ++i) {
    tick += 16 + static_cast<std::int64_t>(3000.0 * random_uniform(seed, 3 * i));
    z += (i % 50 < 25 ? 0.004 : 0.2) * random_normal(seed, 3 * i + 1);
    samples.push_back({tick, z, 0.0, 0.003 * random_uniform(seed, 7 * i), 0.002});
  }
  std::vector<PathVertex> vertices;
  const double gouge = filter_path(samples, 0.01, vertices);
  EXPECT_LE(gouge, 0.01);
  EXPECT_LT(vertices.size(), samples.size());
  ASSERT_EQ(vertices.front().along, samples.front().tick);
  ASSERT_EQ(vertices.back().along, samples.back().tick);
  EXPECT_NEAR(mm_of_ticks(vertices.back().z), samples.back().tip_mm, 0.5001e-4);
  std::size_t v = 0;
  for (std::size_t i = 0; i < samples.size(); ++i) {
    while (vertices[v + 1].along < samples[i].tick) ++v;
    const double t = static_cast<double>(samples[i].tick - vertices[v].along) /
                     static_cast<double>(vertices[v + 1].along - vertices[v].along);
    const double path =
        mm_of_ticks(vertices[v].z) + t * mm_of_ticks(vertices[v + 1].z - vertices[v].z);
    const double beside = std::max(samples[i].gouge_mm, i > 0 ? samples[i - 1].gouge_mm : 0.0);
    ASSERT_LE(samples[i].tip_mm - path + beside, gouge + 1e-12);
    ASSERT_LE(path - samples[i].tip_mm, 0.008 + 1e-12);
  }
}
INSTANTIATE_TEST_SUITE_P(Seeds, FilterOnJaggedLines, testing::Range(1, 21));

// ---- text ------------------------------------------------------------------------------

TEST(GcodeWriter, WritesShortestDecimals) {
  const auto decimal = [](std::int64_t ticks) {
    std::string text;
    append_decimal(text, ticks);
    return text;
  };
  EXPECT_EQ(decimal(0), "0");
  EXPECT_EQ(decimal(125000), "12.5");
  EXPECT_EQ(decimal(-30), "-0.003");
  EXPECT_EQ(decimal(70000), "7");
  EXPECT_EQ(decimal(-1), "-0.0001");
  EXPECT_EQ(decimal(20000001), "2000.0001");
  EXPECT_EQ(decimal(1000000), "100");
}

TEST(GcodeWriter, DropsWordsThatSayNothingNew) {
  GcodeWriter out;
  out.rapid({0, 0, 50000});
  out.cut({0, 0, 10000}, 600.0);
  out.cut({0, 0, 10000}, 600.0);  // no block
  out.cut({5000, 0, 10000}, 3000.5);
  out.cut({10000, 0, 10001}, 3000.5);
  out.rapid({10000, 0, 50000});
  EXPECT_EQ(out.text(), "G0X0Y0Z5\nG1Z1F600\nX0.5F3000.5\nX1Z1.0001\nG0Z5\n");
  EXPECT_EQ(out.blocks(), 5U);
}

TEST(Mill, CommentsCannotBeBrokenOutOf) {
  MillOptions o;
  o.program_name = "a) G0 Z-100 (\nM3 ; %";
  const Program p = milled(flat_field(3, 3, 0.5, 1.0F), o);
  EXPECT_EQ(p.text.substr(0, p.text.find('\n')), "(a] G0 Z-100 [_M3 _ _)");
}

TEST(Mill, PostsDifferInWhatTheControlKnows) {
  MillOptions o;
  const ModelField field = flat_field(3, 3, 0.5, 1.0F);
  const std::string linuxcnc = milled(field, o).text;
  for (const char* word : {"G21 G90 G17 G94 G40 G49 G80 G54", "G64 P0.00050 Q0", "T1 M6", "G43 H1",
                           "S18000 M3", "M5\nM30\n"})
    EXPECT_THAT(linuxcnc, HasSubstr(word));
  o.post = "grbl";
  o.work_offset = 57;
  const std::string grbl = milled(field, o).text;
  EXPECT_THAT(grbl, HasSubstr("G80 G57\n"));
  for (const char* word : {"G64", "M6", "G43"}) EXPECT_THAT(grbl, Not(HasSubstr(word)));
}

TEST(Mill, ReportCountsWhatWasWritten) {
  const ModelField field = testing_support::ground(Ground::rough, 8, 40, 0.5);
  const Program p = milled(field, {});
  EXPECT_EQ(p.report.bytes, p.text.size());
  EXPECT_EQ(p.report.blocks,
            static_cast<std::uint64_t>(std::count(p.text.begin(), p.text.end(), '\n')));
  double length = 0.0, time = 0.0;
  for (const Move& m : p.cuts()) {
    length += norm(m.to - m.from);
    time += norm(m.to - m.from) / m.feed;
  }
  EXPECT_NEAR(p.report.path_length_mm, length, 1e-9 * length);
  EXPECT_NEAR(p.report.cutting_time_min, time, 1e-9 * time);
  EXPECT_EQ(p.report.passes, 40U);
  EXPECT_GT(p.report.points_sampled, 40U * 40U);
}

TEST(Mill, SameBytesForAnyNumberOfThreads) {
  const ModelField field = testing_support::ground(Ground::rough, 21, 160, 0.5);
  std::vector<std::string> texts;
  for (const std::size_t threads : {1U, 3U}) {
    const oneapi::tbb::global_control limit(oneapi::tbb::global_control::max_allowed_parallelism,
                                            threads);
    texts.push_back(milled(field, {}).text);
  }
  EXPECT_TRUE(texts[0] == texts[1]);
}

// ---- errors ------------------------------------------------------------------------------

class MillErrors : public testing::Test {
 protected:
  ScratchFolder folder;
  MillOptions o;
  ModelField field = flat_field(9, 11, 0.5, 1.0F);
  [[nodiscard]] Result<MillReport> result() { return mill(field, o, folder / "part.ngc"); }
  void TearDown() override {
    EXPECT_TRUE(std::filesystem::is_empty(folder.path())) << "something was left behind";
  }
};

constexpr double kBad[] = {0.0, -1.0, NAN, INFINITY};

TEST_F(MillErrors, Tool) {
  for (const double v : kBad) {
    o.ball_diameter = Millimetres{v};
    EXPECT_THAT(result(), FailsWith(kToolNotPositive));
  }
}
TEST_F(MillErrors, Stepover) {
  for (const double v : {0.0, -1.0, double{NAN}, double{INFINITY}, 6.001}) {
    o.stepover = Millimetres{v};
    EXPECT_THAT(result(), FailsWith(kStepoverOutOfRange));
  }
}
TEST_F(MillErrors, Tolerance) {
  for (const double v : {0.0, -1.0, double{NAN}, double{INFINITY}, 0.0009, 1.1}) {
    o.tolerance = Millimetres{v};
    EXPECT_THAT(result(), FailsWith(kToleranceOutOfRange));
  }
}
TEST_F(MillErrors, Feeds) {
  for (const double v : kBad) {
    o = {};
    o.feed = FeedRate{v};
    EXPECT_THAT(result(), FailsWith(kFeedOutOfRange));
    o = {};
    o.plunge_feed = FeedRate{v};
    EXPECT_THAT(result(), FailsWith(kFeedOutOfRange));
    o = {};
    o.spindle_rpm = v;
    EXPECT_THAT(result(), FailsWith(kFeedOutOfRange));
  }
}
TEST_F(MillErrors, OtherOptions) {
  o.clearance = Millimetres{-1.0};
  EXPECT_THAT(result(), FailsWith(kMillOptionOutOfRange));
  o = {};
  o.work_offset = 60;
  EXPECT_THAT(result(), FailsWith(kMillOptionOutOfRange));
  o = {};
  o.first_y_mm = 3.0;
  o.last_y_mm = 2.0;
  EXPECT_THAT(result(), FailsWith(kMillOptionOutOfRange));
  o.last_y_mm = 4.1;  // the field ends at 4
  EXPECT_THAT(result(), FailsWith(kMillOptionOutOfRange));
}
TEST_F(MillErrors, VoidNamesItsPlace) {
  for (const float v : {NAN, INFINITY}) {
    field.z_mm(3, 7) = v;
    const auto r = result();
    EXPECT_THAT(r, FailsWith(kHeightNotFinite));
    EXPECT_THAT(r.error().message, HasSubstr("row 3, column 7"));
  }
}
TEST_F(MillErrors, PostIsUnknownAndTheKnownOnesAreNamed) {
  o.post = "heidenhain";
  const auto r = result();
  EXPECT_THAT(r, FailsWith(kUnknownPost));
  EXPECT_THAT(r.error().message, HasSubstr("linuxcnc, grbl"));
}
TEST_F(MillErrors, TravelIsCheckedInEachAxis) {
  o.travel_x = Millimetres{4.99};
  EXPECT_THAT(result(), FailsWith(kBeyondTravel));
  o = {};
  o.travel_y = Millimetres{3.99};
  EXPECT_THAT(result(), FailsWith(kBeyondTravel));
  o = {};
  o.travel_z = Millimetres{4.99};
  EXPECT_THAT(result(), FailsWith(kBeyondTravel));
  o = {};
  o.travel_x = Millimetres{5.0};
  o.travel_y = Millimetres{4.0};
  o.travel_z = Millimetres{5.0};
  EXPECT_THAT(result(), testing_support::Succeeds());
  std::filesystem::remove(folder / "part.ngc");
}
TEST_F(MillErrors, Cancelled) {
  std::stop_source stop;
  stop.request_stop();
  RunContext run;
  run.stop = stop.get_token();
  EXPECT_THAT(mill(field, o, folder / "part.ngc", run), FailsWith(kCancelled));
}
TEST_F(MillErrors, FolderIsMissing) {
  EXPECT_THAT(mill(field, o, folder / "nowhere/part.ngc"), FailsWith(kFileNotWritable));
}

}  // namespace
}  // namespace maquette::cnc
