// SPDX-License-Identifier: GPL-3.0-or-later

// What gcode_reader.hpp claims, and how each claim is attacked:
//
//   words mean what RS-274 says ............ small programs, positions by hand
//   units, distance modes, offsets ......... the same place told in several ways
//   arcs: I J K, R, planes, turns, helix ... points of the circle by hand; chords measured
//   parameters and expressions ............. table of formulas against arithmetic
//   every error has line and column ........ table of bad lines with the place expected
//   truncated files are noticed ............ a program cut at every byte
//   no input breaks it ..................... bytes of a good program changed at random
//   tools, homing, probing ................. numbers and places by hand
//   any chunking gives the same ............ a file longer than the buffer
//   real programs are read ................. files of LinuxCNC and CAMotics, if present

#include "cnc/gcode_reader.hpp"

#include <cmath>
#include <cstdlib>
#include <numbers>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "cnc/verify.hpp"
#include "core/random.hpp"
#include "support/folders.hpp"
#include "support/matchers.hpp"

namespace maquette::cnc {
namespace {

using testing::HasSubstr;
using testing::StartsWith;
using testing_support::FailsWith;
using testing_support::ScratchFolder;
using testing_support::Succeeds;

struct Read {
  std::vector<Motion> motions;
  ProgramSummary summary;
};

Result<Read> read(std::string_view text) {
  Read read;
  auto summary = read_gcode_text(text, "part.ngc", [&](std::span<const Motion> batch) {
    read.motions.insert(read.motions.end(), batch.begin(), batch.end());
    return Result<void>{};
  });
  if (!summary) return tl::unexpected<Error>(summary.error());
  read.summary = *summary;
  return read;
}

/// End of the last motion; coordinates that are sums are equal to rounding only.
Vec3 end_of(std::string_view text) {
  const auto result = read(text);
  EXPECT_THAT(result, Succeeds()) << text;
  if (!result || result->motions.empty()) return {NAN, NAN, NAN};
  return result->motions.back().to_mm;
}

MATCHER_P3(IsAt, x, y, z, "") {
  *result_listener << fmt::format("({}, {}, {})", arg.x, arg.y, arg.z);
  return std::abs(arg.x - x) < 1e-9 && std::abs(arg.y - y) < 1e-9 && std::abs(arg.z - z) < 1e-9;
}

constexpr const char* kStart = "G21 G90 G17\nG0 X0 Y0 Z0\nF100\n";
std::string after_start(std::string_view lines) {
  return fmt::format("{}{}\nM2\n", kStart, lines);
}

// ---- words -----------------------------------------------------------------

TEST(GcodeReader, ReadsARapidAndACut) {
  const auto r = read("G21\nG0 X1 Y2 Z3\nG0 X4\nG1 Z-0.5 F250\nX5 Y-6\nM2\n");
  ASSERT_THAT(r, Succeeds());
  // The first G0 starts at an unknown place and gives no motion.
  ASSERT_EQ(r->motions.size(), 3U);
  EXPECT_EQ(r->motions[0].kind, Motion::Kind::rapid);
  EXPECT_EQ(r->motions[0].from_mm, (Vec3{1, 2, 3}));
  EXPECT_EQ(r->motions[0].to_mm, (Vec3{4, 2, 3}));
  EXPECT_EQ(r->motions[1].kind, Motion::Kind::line);
  EXPECT_EQ(r->motions[1].feed_mm_min, 250.0);
  EXPECT_EQ(r->motions[2].to_mm, (Vec3{5, -6, -0.5}));
  EXPECT_EQ(r->motions[2].line, 5U);
  EXPECT_EQ(r->summary.blocks, 6U);
  EXPECT_EQ(r->summary.motions, 3U);
  EXPECT_TRUE(r->summary.ended);
}

TEST(GcodeReader, TakesAnyCaseBlanksCommentsLineNumbersAndCrLf) {
  EXPECT_EQ(end_of("%\r\ng21 G90\r\nn10 g0x0y0z0 (say (x9)\r\n"
                   "N20 G 1 X 1 2 . 5 y\t-3. Z+.25 f 1 0 0 ; x99\r\n m2\r\n%\r\n"),
            (Vec3{12.5, -3.0, 0.25}));
}

TEST(GcodeReader, SkipsDeletedBlocksAndCountsThem) {
  const auto r = read(after_start("G1 X1\n/G1 X2\n / G1 X3 nonsense"));
  ASSERT_THAT(r, Succeeds());
  EXPECT_EQ(r->motions.size(), 1U);
  EXPECT_EQ(r->summary.skipped_blocks, 2U);
}

TEST(GcodeReader, TellsTheSamePlaceInSeveralWays) {
  const Vec3 place{25.4, -12.7, 2.54};
  const std::vector<std::string> ways = {
      "G20 G1 X1 Y-.5 Z.1",
      "G1 X25.4 Y-12.7 Z2.54",
      "G91 G1 X20 Y-10 Z2\nX5.4 Y-2.7 Z0.54",
      "G92 X10 Y10 Z10\nG1 X35.4 Y-2.7 Z12.54",
      "G92 X10\nG92.1\nG1 X25.4 Y-12.7 Z2.54",
      "G92 X10\nG92.2\nG92.3\nG1 X35.4 Y-12.7 Z2.54",
      "G43 H3\nG1 X25.4 Y-12.7 Z2.54\nG43.1 Z-7\nG49",
      "G54 G64 P0.01 G40 G94 G61.1\nG1 X25.4 Y-12.7 Z2.54",
      "G1 X[20+5.4] Y-[12.7] Z#7\n#7=2.54 #<depth> = 2.54\nZ#7\nZ#< De Pth >"};
  for (const std::string& way : ways)
    EXPECT_THAT(end_of(after_start(way)), IsAt(place.x, place.y, place.z)) << way;
}

TEST(GcodeReader, FeedFollowsTheUnits) {
  const auto r = read(after_start("G20 G1 X1 F10\nG21 X2\nF33.5 X3"));
  ASSERT_THAT(r, Succeeds());
  EXPECT_DOUBLE_EQ(r->motions[0].feed_mm_min, 254.0);
  EXPECT_DOUBLE_EQ(r->motions[1].feed_mm_min, 254.0);
  EXPECT_DOUBLE_EQ(r->motions[2].feed_mm_min, 33.5);
}

TEST(GcodeReader, CountsDwellAndToolChangesAndStopsAtTheEnd) {
  const auto r = read(after_start("T1 M6 S1000 M3\nG4 P1.5\nG1 X1\nM30\nG1 X2 nonsense"));
  ASSERT_THAT(r, Succeeds());
  EXPECT_EQ(r->summary.dwell_s, 1.5);
  EXPECT_EQ(r->summary.tool_changes, 1U);
  EXPECT_EQ(r->motions.size(), 1U);
}

TEST(GcodeReader, ForgetsAnAxisMovedInTheMachineFrame) {
  const auto r = read(after_start("G1 X1\nG53 G0 Z0\nG0 X5\nG0 Z3\nG0 X6"));
  ASSERT_THAT(r, Succeeds());
  // G53, X5 (z unknown) and Z3 (from an unknown z) give no motion; the last one does.
  ASSERT_EQ(r->motions.size(), 2U);
  EXPECT_EQ(r->motions[1].from_mm, (Vec3{5, 0, 3}));
}

TEST(GcodeReader, GoesHomeByWayOfAPlace) {
  const auto r = read(after_start("G1 X1 Y1\nG91 G28 Z0\nG90 G0 X5 Y5\nZ3\nX6\nG28 Y9 Z9\nG28"));
  ASSERT_THAT(r, Succeeds());
  // No motion: in place, then from an unknown z. Then X6 and the way to Y9 Z9.
  ASSERT_EQ(r->motions.size(), 3U);
  EXPECT_EQ(r->motions[1].from_mm, (Vec3{5, 5, 3}));
  EXPECT_EQ(r->motions[2].to_mm, (Vec3{6, 9, 9}));
  EXPECT_EQ(r->motions[2].kind, Motion::Kind::rapid);
}

TEST(GcodeReader, ProbesAndSetsTheFrame) {
  const auto r = read(after_start("G1 X1 Y1\nG38.2 Z-10 F50\nG10 L20 P1 Z2\nG91 G0 Z3\nG90 X4"));
  ASSERT_THAT(r, Succeeds());
  ASSERT_EQ(r->motions.size(), 4U);
  EXPECT_TRUE(r->motions[1].probe);
  EXPECT_EQ(r->motions[1].to_mm, (Vec3{1, 1, -10}));
  EXPECT_FALSE(r->motions[2].probe);
  EXPECT_EQ(r->motions[2].from_mm, (Vec3{1, 1, 2})) << "the touched point is z = 2 now";
  EXPECT_EQ(r->motions[3].to_mm, (Vec3{4, 1, 5}));
  // Where it has stopped is not known.
  EXPECT_THAT(read(after_start("G38.2 Z-10 F50\nG92 Z0")), FailsWith(kGcodeUnsupported));
  EXPECT_THAT(read(after_start("G38.2 Z-10 F50\nX5")), FailsWith(kGcodeSyntax));
  // Another system's data change nothing.
  EXPECT_EQ(end_of(after_start("G10 L20 P2 X7\nG10 L1 P1 R3\nG91 G1 X1")), (Vec3{1, 0, 0}));
}

TEST(GcodeReader, ToldTools) {
  const auto tools = [](std::string_view lines) {
    const auto r = read(after_start(lines));
    EXPECT_THAT(r, Succeeds()) << lines;
    std::vector<int> told;
    if (r)
      for (const Motion& m : r->motions) told.push_back(m.tool);
    return told;
  };
  EXPECT_THAT(tools("G1 X1"), testing::ElementsAre(0));
  EXPECT_THAT(tools("T5 M6\nG1 X1\nT7\nX2\nM6\nX3"), testing::ElementsAre(5, 5, 7));
  EXPECT_THAT(tools("T5\nG1 X1\nT7\nX2"), testing::ElementsAre(5, 7)) << "changed by hand";
  EXPECT_THAT(tools("T5\nG1 X1\nT7 M0\nX2\nT8\nX3"), testing::ElementsAre(5, 7, 7));
  EXPECT_THAT(tools("M61 Q9\nG1 X1"), testing::ElementsAre(9));
}

TEST(GcodeReader, OtherControlsFramesAndSmoothing) {
  const std::string lines =
      "%\nO0042(PART)\nG21\nG0 G17 G40 G49 G80 G90 G94\nG54.1 P2\nT1 M6\nG5.1 Q1\nG187 P3 E0.01\n"
      "G8 P1\nG0 X1. Y2.\nG43 H1 Z3.\nG1 Z-1. F100.\nG91 G28 Z0.\nG90\nM30\n%\n";
  EXPECT_EQ(end_of(lines), (Vec3{1, 2, -1}));
  EXPECT_THAT(read("G54.1 P1\nG0 X0 Y0 Z0\nX1\nG54.1 P2\nM2\n"), FailsWith(kGcodeUnsupported));
}

TEST(GcodeReader, AiContourControlBlendsAsTheBuilderSays) {
  std::vector<Motion> motions;
  const auto r = read_gcode_text("G21 G90\nG1 X0 Y0 Z0 F100\nX1\nG5.1 Q1\nX2\nG5.1 Q0\nX3\nM2\n",
                                 "a", [&](std::span<const Motion> some) -> Result<void> {
                                   motions.insert(motions.end(), some.begin(), some.end());
                                   return {};
                                 });
  ASSERT_THAT(r, Succeeds());
  const auto& m = motions;
  ASSERT_GE(m.size(), 3U);
  EXPECT_FALSE(m[m.size() - 3].control);
  ASSERT_TRUE(m[m.size() - 2].control);
  EXPECT_EQ(m[m.size() - 2].control->mode, PathControl::Mode::blend);
  EXPECT_FALSE(m[m.size() - 2].control->stated);
  EXPECT_FALSE(m.back().control);
}

TEST(GcodeReader, EvaluatesExpressions) {
  const std::vector<std::pair<std::string, double>> formulas = {
      {"[1+2*3]", 7},
      {"[[1+2]*3]", 9},
      {"[2**3**2]", 64},
      {"[7 mod 3]", 1},
      {"[-7 MOD 3]", 2},
      {"[8/4/2]", 1},
      {"sin[30]", 0.5},
      {"COS[60]", 0.5},
      {"tan[45]", 1},
      {"asin[0.5]", 30},
      {"acos[0.5]", 60},
      {"atan[1]/[-1]", 135},
      {"sqrt[2.25]", 1.5},
      {"abs[-4]", 4},
      {"round[2.5]", 3},
      {"fix[-2.5]", -3},
      {"fup[2.1]", 3},
      {"exp[0]", 1},
      {"ln[exp[2]]", 2},
      {"-sqrt[4]", -2},
      {"[1 gt 2 or 2 ge 2]", 1},
      {"[3 eq 3 and 2 lt 1]", 0},
      {"[1 xor 1]", 0},
      {"[5 ne 4]", 1},
      {"[1 le 0]", 0},
      {"#[2+3]", 55},
      {"##6", 55},
      {"0000012.5000000000000000000000", 12.5},
      {"0.1", 0.1},
      {"123456789.123456789", 123456789.123456789}};
  for (const auto& [formula, value] : formulas) {
    const Vec3 at = end_of(after_start(fmt::format("#5=55 #6=5\nG1 X[{}/ 1000 ]", formula)));
    EXPECT_NEAR(at.x, value / 1000.0, 1e-12 * std::fmax(1.0, std::abs(value))) << formula;
  }
}

TEST(GcodeReader, RoundsNumbersCorrectly) {
  for (std::uint64_t i = 0; i < 2000; ++i) {
    const double x = (random_uniform(11, i) - 0.5) * 4000.0;
    for (const std::string& text :
         {fmt::format("{:.4f}", x), fmt::format("{:.6f}", x), fmt::format("{:.25f}", x)})
      EXPECT_EQ(end_of(after_start(fmt::format("G1 X{}", text))).x,
                std::strtod(text.c_str(), nullptr))
          << text;
  }
}

TEST(GcodeReader, AssignmentsTakeEffectAtTheEndOfTheLine) {
  EXPECT_EQ(end_of(after_start("#3=7\nG1 X#3 #3=9 Y#3")), (Vec3{7, 7, 0}));
  EXPECT_EQ(end_of(after_start("#3=7\n#3=9\nG1 X#3")), (Vec3{9, 0, 0}));
}

// ---- arcs ------------------------------------------------------------------

Motion arc_of(std::string_view lines) {
  const auto r = read(after_start(lines));
  EXPECT_THAT(r, Succeeds()) << lines;
  if (!r || r->motions.empty()) return {};
  EXPECT_EQ(r->motions.back().kind, Motion::Kind::arc);
  return r->motions.back();
}

constexpr double kPi = std::numbers::pi;

TEST(GcodeArc, CentreAndSweepInEveryPlane) {
  struct Case {
    const char* lines;
    Vec3 centre;
    double sweep;
  };
  const std::vector<Case> cases = {
      {"G17 G3 X5 Y5 I0 J5", {0, 5, 0}, kPi / 2},
      {"G17 G2 X5 Y5 I0 J5", {0, 5, 0}, -1.5 * kPi},
      {"G17 G3 X5 Y5 R5", {0, 5, 0}, kPi / 2},
      {"G17 G3 X5 Y5 R-5", {5, 0, 0}, 1.5 * kPi},
      {"G17 G2 X5 Y5 R5", {5, 0, 0}, -kPi / 2},
      {"G17 G2 X5 Y5 R-5", {0, 5, 0}, -1.5 * kPi},
      {"G17 G3 I5", {5, 0, 0}, 2 * kPi},
      {"G17 G3 X0 Y0 I5 P3", {5, 0, 0}, 6 * kPi},
      {"G17 G90.1 G3 X5 Y5 I0 J5", {0, 5, 0}, kPi / 2},
      // (z, x, y) is right-handed: counter-clockwise goes from +z to +x, seen from +y. The
      // start lies on the -z side of the centre.
      {"G18 G2 X5 Z5 I0 K5", {0, 0, 5}, -kPi / 2},
      {"G18 G3 X5 Z5 I0 K5", {0, 0, 5}, 1.5 * kPi},
      {"G18 G3 X-5 Z5 K5", {0, 0, 5}, kPi / 2},
      {"G19 G3 Y5 Z5 K5", {0, 0, 5}, kPi / 2},
      {"G19 G2 Y5 Z5 J5", {0, 5, 0}, -kPi / 2},
  };
  for (const Case& c : cases) {
    const Motion m = arc_of(c.lines);
    EXPECT_THAT(m.centre_mm, IsAt(c.centre.x, c.centre.y, c.centre.z)) << c.lines;
    EXPECT_NEAR(m.sweep_rad, c.sweep, 1e-12) << c.lines;
  }
}

// Chords begin and end where the arc does, their ends lie on it, and no point of a chord
// is farther from the arc than asked; half as many chords would be.
TEST(GcodeArc, ChordsStayWithinTheDeviation) {
  for (const char* lines : {"G3 X5 Y5 Z3 I0 J5", "G18 G2 X-5 Z5 K5", "G2 X0 Y0 I30 Z-4 P2"}) {
    const Motion m = arc_of(lines);
    const double radius = norm(m.from_mm - m.centre_mm);
    constexpr double kDeviation_mm = 0.0005;
    Vec3 at = m.from_mm;
    double length = 0.0, worst = 0.0;
    for_each_chord(m, kDeviation_mm, [&](Vec3 from, Vec3 to) {
      EXPECT_EQ(from, at);
      for (const double t : {0.25, 0.5, 0.75, 1.0}) {
        Vec3 arm = from + t * (to - from) - m.centre_mm;
        (m.plane == ArcPlane::xy ? arm.z : m.plane == ArcPlane::zx ? arm.y : arm.x) = 0.0;
        worst = std::fmax(worst, std::abs(norm(arm) - radius));
        if (t == 1.0) {
          EXPECT_NEAR(norm(arm), radius, 1e-9) << lines;
        }
      }
      length += norm(to - from);
      at = to;
    });
    EXPECT_EQ(at, m.to_mm);
    EXPECT_LE(worst, kDeviation_mm) << lines;
    EXPECT_GT(worst, 0.25 * kDeviation_mm) << lines << ": more chords than needed";
    EXPECT_NEAR(length, length_mm(m), 1e-4 * length) << lines;
  }
}

TEST(GcodeArc, AcceptsASpiralWithinTheToleranceAndNoMore) {
  EXPECT_THAT(read(after_start("G3 X10.0049 Y10 J10")), Succeeds());
  EXPECT_THAT(read(after_start("G3 X10.0151 Y10 J10")), FailsWith(kGcodeArc));
  EXPECT_THAT(read(after_start("G3 X1000.9 Y1000 J1000")), Succeeds()) << "0.1 % of the radius";
  EXPECT_THAT(read(after_start("G3 X1001.1 Y1000 J1000")), FailsWith(kGcodeArc));
}

// ---- errors ----------------------------------------------------------------

struct BadLine {
  const char* line;
  ErrorCode code;
  int column;
  const char* says;
};
class GcodeErrors : public testing::TestWithParam<BadLine> {};

TEST_P(GcodeErrors, NameFileLineAndColumn) {
  const BadLine& bad = GetParam();
  const auto r = read(after_start(bad.line));
  ASSERT_THAT(r, FailsWith(bad.code)) << bad.line;
  const std::string_view lines = bad.line;
  const auto line = 4 + std::count(lines.begin(), lines.end(), '\n');
  EXPECT_THAT(r.error().message, StartsWith(fmt::format("part.ngc:{}:{}: ", line, bad.column)))
      << bad.line;
  EXPECT_THAT(r.error().message, HasSubstr(bad.says)) << bad.line;
  EXPECT_THAT(r.error().message, HasSubstr("expected")) << bad.line;
}

INSTANTIATE_TEST_SUITE_P(
    Table, GcodeErrors,
    testing::Values(
        BadLine{"G1 X1 !", kGcodeSyntax, 7, "'!'"}, BadLine{"G1 X", kGcodeSyntax, 5, "end"},
        BadLine{"G1 X-", kGcodeSyntax, 6, "end"}, BadLine{"G1 XY1", kGcodeSyntax, 5, "'Y'"},
        BadLine{"G1 X1.2.3", kGcodeSyntax, 8, "'.'"}, BadLine{"G1 X1 X2", kGcodeSyntax, 7, "X"},
        BadLine{"G1 (open X1", kGcodeSyntax, 4, "comment"},
        BadLine{"G1 X[1+", kGcodeSyntax, 8, "end"}, BadLine{"G1 X[1", kGcodeSyntax, 7, "']'"},
        BadLine{"G1 X[1/0]", kGcodeSyntax, 5, "finite"},
        BadLine{"G1 Xsqrt[-1]", kGcodeSyntax, 5, "SQRT"},
        BadLine{"G1 X#<never>", kGcodeSyntax, 5, "#<never>"},
        BadLine{"G1 X#0", kGcodeSyntax, 6, "parameter number"},
        BadLine{"#1 5", kGcodeSyntax, 5, "'='"}, BadLine{"G1.55 X1", kGcodeSyntax, 1, "G1.55"},
        BadLine{"G0 G1 X1", kGcodeSyntax, 4, "G1"},
        BadLine{"G1 X1 I5", kGcodeSyntax, 7, "without an arc"},
        BadLine{"G80\nX1", kGcodeSyntax, 1, "without a motion"},
        BadLine{"G4", kGcodeSyntax, 1, "dwell"}, BadLine{"G2 X5", kGcodeSyntax, 1, "centre"},
        BadLine{"G1 X2000000", kGcodeSyntax, 4, "1 km"}, BadLine{"G1 X1e3", kGcodeSyntax, 6, "E"},
        BadLine{"G1 X1 F-5", kGcodeSyntax, 7, "feed"},
        BadLine{"G3 X5 Y5 J5 P0.5", kGcodeSyntax, 13, "turns"},
        BadLine{"G53 G1 X1", kGcodeUnsupported, 8, "machine"},
        BadLine{"X1 G93", kGcodeUnsupported, 4, "G93"},
        BadLine{"G41 D1", kGcodeUnsupported, 1, "G41"},
        BadLine{"G81 X1 Z-1 R1", kGcodeUnsupported, 1, "G81"},
        BadLine{"G38.2", kGcodeSyntax, 1, "probing"},
        BadLine{"G10 L3 P1 X0", kGcodeUnsupported, 5, "G10 L3"},
        BadLine{"G10 L20 P10 X0", kGcodeSyntax, 9, "coordinate system"},
        BadLine{"G154", kGcodeSyntax, 1, "G154"}, BadLine{"T1.5", kGcodeSyntax, 1, "tool"},
        BadLine{"M61", kGcodeSyntax, 1, "tool"}, BadLine{"G1 X1 L2", kGcodeSyntax, 7, "L"},
        BadLine{"G55", kGcodeUnsupported, 1, "G55"}, BadLine{"M98", kGcodeSyntax, 1, "M98"},
        BadLine{"G1 A5", kGcodeUnsupported, 4, "axis word A"},
        BadLine{"X1 o100 sub", kGcodeSyntax, 4, "O word"},
        BadLine{"G1 X#5420", kGcodeUnsupported, 5, "#5420"},
        BadLine{"G2 X1 Y1 I5 J5", kGcodeArc, 1, "radius"},
        BadLine{"G2 X10 R1", kGcodeArc, 8, "radius"}, BadLine{"G2 X0 R1", kGcodeArc, 7, "ends"},
        BadLine{"F0\nG1 X1", kGcodeNoFeed, 1, "feed"}),
    [](const auto& test) { return fmt::format("Line{}", test.index); });

TEST(GcodeErrors, CutBeforeAPlaceIsKnown) {
  const auto r = read("G21\nF100\nG1 X5\nM2\n");
  ASSERT_THAT(r, FailsWith(kGcodeSyntax));
  EXPECT_THAT(r.error().message, StartsWith("part.ngc:3:4: found a cut before Y"));
}

TEST(GcodeErrors, NoFeedAtAll) {
  const auto r = read("G0 X0 Y0 Z0\nX1 G1\nM2\n");
  ASSERT_THAT(r, FailsWith(kGcodeNoFeed));
  EXPECT_THAT(r.error().message, StartsWith("part.ngc:2:4: "));
}

TEST(GcodeErrors, DeepNestingIsAnErrorAndNoCrash) {
  for (const std::string& open : {std::string("["), std::string("#["), std::string("sin["),
                                  std::string("#"), std::string("-["), std::string("2**[")}) {
    std::string value;
    for (int i = 0; i < 5000; ++i) value += open;
    EXPECT_THAT(read(after_start(fmt::format("G1 X[{}", value))), FailsWith(kGcodeSyntax)) << open;
  }
}

TEST(GcodeErrors, ALineWithoutEndIsRefused) {
  const auto r = read(fmt::format("G1 X{}\nM2\n", std::string(kLongestLine, '0')));
  ASSERT_THAT(r, FailsWith(kGcodeSyntax));
  EXPECT_THAT(r.error().message, HasSubstr("bytes"));
}

TEST(GcodeErrors, FilesThatAreNotThereOrAreFolders) {
  const ScratchFolder folder;
  const MotionSink none = [](std::span<const Motion>) { return Result<void>{}; };
  EXPECT_THAT(read_gcode(folder / "none.ngc", none), FailsWith(kFileNotFound));
  EXPECT_THAT(read_gcode(folder.path(), none), FailsWith(kFileNotReadable));
}

TEST(GcodeErrors, ASinkMayEndTheReading) {
  const auto r = read_gcode_text(after_start("G1 X1"), "part.ngc", [](std::span<const Motion>) {
    return Result<void>{fail(kCancelled, "enough")};
  });
  EXPECT_THAT(r, FailsWith(kCancelled));
}

// Wherever the file is cut, it is noticed; the one exception is a cut right after a line
// end, which leaves a complete program without M2 and is told by `ended`.
TEST(GcodeTruncated, IsNoticedAtEveryByte) {
  const std::string whole = after_start("G1 X0 Y1.25 (tail)\nG3 X5 Y6.25 I0 J5 F20.");
  const std::size_t end = whole.find("M2") + 2;
  for (std::size_t bytes = 1; bytes < end; ++bytes) {
    const auto r = read(whole.substr(0, bytes));
    if (whole[bytes - 1] == '\n') {
      ASSERT_THAT(r, Succeeds());
      EXPECT_FALSE(r->summary.ended);
    } else {
      EXPECT_THAT(r, FailsWith(kGcodeTruncated)) << whole.substr(0, bytes);
    }
  }
  const auto r = read(whole.substr(0, whole.find(".25") + 1));
  ASSERT_THAT(r, FailsWith(kGcodeTruncated));
  EXPECT_THAT(r.error().message, StartsWith("part.ngc:4:10: "));
}

TEST(GcodeTruncated, AnOpeningPercentAsksForAnEnd) {
  EXPECT_THAT(read("%\nG21\n"), FailsWith(kGcodeTruncated));
  EXPECT_THAT(read("%\nG21\n%"), Succeeds());
  EXPECT_THAT(read("G21\n%"), Succeeds());
}

// ---- no input breaks it ----------------------------------------------------

class GcodeMutation : public testing::TestWithParam<int> {};

TEST_P(GcodeMutation, GivesAResultOrAnErrorWithAPlace) {
  const auto seed = static_cast<std::uint64_t>(GetParam());
  const std::string good =
      "%\nN10 G21 G90 G17 (start)\n#1=2.5 #<top> = [#1 * 2]\nG0 X0 Y0 Z#<top>\n"
      "G1 Z-1 F100 S1000 M3\nX10.25 Y-3.5\nG2 X20 Y0 R12\nG3 X30 I5 Z-2\nG91 G1 X-1\n"
      "G90 X[atan[1]/[1] + sqrt[#1]] Y-sin[30]\nG20 G1 X.5\nG92 X1\nG4 P0.5\nM2\n%\n";
  ASSERT_THAT(read(good), Succeeds());
  constexpr std::string_view kAlphabet = "GXYZFRIJM#<>[]=.-+*/0123456789 \n\t%();\x00\xff";
  std::uint64_t draw = 0;
  int failures = 0;
  for (int round = 0; round < 3000; ++round) {
    std::string text = good;
    const auto edits = 1 + random_bits(seed, draw++) % 6;
    for (std::uint64_t e = 0; e < edits; ++e) {
      const std::size_t at = random_bits(seed, draw++) % text.size();
      const char c = kAlphabet[random_bits(seed, draw++) % kAlphabet.size()];
      switch (random_bits(seed, draw++) % 4) {
        case 0:
          text[at] = c;
          break;
        case 1:
          text = fmt::format("{}{}{}", text.substr(0, at), c, text.substr(at));
          break;
        case 2:
          text.erase(at, 1 + random_bits(seed, draw++) % 5);
          break;
        default:
          text = fmt::format("{}{}{}", text.substr(0, at),
                             text.substr(at, random_bits(seed, draw++) % 40), text.substr(at));
      }
      if (text.empty()) text.push_back('%');
    }
    const auto r = read(text);
    if (!r) {
      ++failures;
      EXPECT_THAT(r.error().message, testing::MatchesRegex("part.ngc:[0-9]+:[0-9]+: (.|\n)*"));
      continue;
    }
    for (const Motion& m : r->motions) {
      EXPECT_TRUE(std::isfinite(norm(m.from_mm) + norm(m.to_mm) + m.sweep_rad)) << text;
      EXPECT_TRUE(m.kind == Motion::Kind::rapid || m.feed_mm_min > 0.0) << text;
    }
  }
  EXPECT_GT(failures, 300) << "the edits should hurt";
  EXPECT_LT(failures, 2950) << "some edits should be harmless";
}
INSTANTIATE_TEST_SUITE_P(Seed, GcodeMutation, testing::Values(1, 2, 3),
                         testing::PrintToStringParamName());

// ---- files -----------------------------------------------------------------

TEST(GcodeFile, LongerThanTheBufferReadsLikeText) {
  const ScratchFolder folder;
  std::string text = "%\nG21 G90\nG0 X0 Y0 Z5\nG1 F1000\n";
  for (std::uint64_t i = 0; text.size() < (std::size_t{9} << 20); ++i)
    text += fmt::format("X{:.3f} Y{:.4f} (c{})\n", random_uniform(5, 2 * i) * 100.0,
                        random_uniform(5, 2 * i + 1) * 100.0, std::string(i % 50, '-'));
  text += "M2\n%\n";
  ASSERT_THAT(write_file(folder / "long.ngc", text), Succeeds());
  const auto expected = read(text);
  ASSERT_THAT(expected, Succeeds());
  std::size_t at = 0;
  bool same = true;
  const auto summary = read_gcode(folder / "long.ngc", [&](std::span<const Motion> batch) {
    for (const Motion& m : batch) {
      const Motion& e = expected->motions[at++];
      same = same && m.from_mm == e.from_mm && m.to_mm == e.to_mm && m.line == e.line;
    }
    return Result<void>{};
  });
  ASSERT_THAT(summary, Succeeds());
  EXPECT_EQ(at, expected->motions.size());
  EXPECT_TRUE(same);
}

std::filesystem::path real_program(std::string_view name) {
  return testing_support::data_folder() / "gcode" / name;
}

struct RealProgram {
  const char* name;
  std::uint64_t
      motions;  // lines with axis words, counted by a script, less those from an unknown place
  double low_x, high_x;  // mm
};
class RealGcode : public testing::TestWithParam<RealProgram> {};

TEST_P(RealGcode, IsReadWhole) {
  const auto path = real_program(GetParam().name);
  if (!std::filesystem::exists(path)) GTEST_SKIP() << path << " is not here";
  Box3 box;
  const auto summary = read_gcode(path, [&](std::span<const Motion> batch) {
    for (const Motion& m : batch) {
      box.add(m.from_mm);
      box.add(m.to_mm);
    }
    return Result<void>{};
  });
  ASSERT_THAT(summary, Succeeds());
  EXPECT_TRUE(summary->ended);
  EXPECT_EQ(summary->motions, GetParam().motions);
  EXPECT_NEAR(box.min.x, GetParam().low_x, 1e-9);
  EXPECT_NEAR(box.max.x, GetParam().high_x, 1e-9);
}
INSTANTIATE_TEST_SUITE_P(Files, RealGcode,
                         testing::Values(RealProgram{"cameo.nc", 35280, -75.0, 75.0},
                                         RealProgram{"3D_Chips.ngc", 4682, -52.0, 53.0},
                                         RealProgram{"arcspiral.ngc", 1003, -49.476406, 47.8390966},
                                         RealProgram{"zigzag_0.002_0.001.ngc", 2001, 0.0, 101.6}),
                         [](const auto& test) { return fmt::format("File{}", test.index); });

}  // namespace
}  // namespace maquette::cnc
