// SPDX-License-Identifier: GPL-3.0-or-later

// What heidenhain_reader.hpp claims, and how each claim is attacked (what our post writes is
// read back in round_trip_test):
//
//   blocks mean what the manual says ....... small programs, positions by hand
//   arcs: CC C, CR, CP, planes ............. centres and sweeps by hand
//   every error has line and column ........ table of bad blocks with the place expected
//   truncated programs are noticed ......... a program cut at every byte

#include <numbers>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "cnc/gcode_reader.hpp"
#include "cnc/verify.hpp"
#include "support/matchers.hpp"

namespace maquette::cnc {
namespace {

using maquette::testing_support::FailsWith;
using maquette::testing_support::Succeeds;
using testing::HasSubstr;
using testing::StartsWith;

struct Read {
  std::vector<Motion> motions;
  ProgramSummary summary;
};
Result<Read> read(std::string_view text) {
  Read read;
  MAQUETTE_TRY(read.summary, read_gcode_text(text, "part.h", [&](std::span<const Motion> batch) {
                 read.motions.insert(read.motions.end(), batch.begin(), batch.end());
                 return Result<void>{};
               }));
  return read;
}
/// Three blocks before; the first of `blocks` is line 4.
std::string program(std::string_view blocks) {
  return fmt::format(
      "0 BEGIN PGM TEST MM\n1 TOOL CALL 5 Z S2000 F500\n2 L X+0 Y+0 Z+0 R0 FMAX M3\n"
      "{}\n99 END PGM TEST MM\n",
      blocks);
}
Motion last(std::string_view blocks) {
  const auto r = read(program(blocks));
  EXPECT_THAT(r, Succeeds()) << blocks;
  return r && !r->motions.empty() ? r->motions.back() : Motion{};
}

TEST(Heidenhain, ReadsLines) {
  const auto r = read(
      "0  BEGIN PGM part-1 MM\r\n1  BLK FORM 0.1 Z X+0 Y+0 Z-20\r\n2  BLK FORM 0.2 X+100 Y+100 "
      "Z+0\r\n"
      "* - heading\n3 TOOL DEF 5 L+0 R+3 ; comment\n4 TOOL CALL 5 Z S2000 DL+0.1\n"
      "5 CYCL DEF 247 DATUM SETTING ~\n   Q339=+1 ;DATUM NUMBER\n6 CYCL DEF 32.0 TOLERANCE\n"
      "7 CYCL DEF 32.1 T0.01\n8 CYCL DEF 32.2 HSC-MODE:0\n9 L Z+100 R0 FMAX M3\n"
      "10 L X-1.5 Y+2 FMAX M8\n11 L Z-.25 F500\n12 L IX+2\nL Y+3 Z+1 F1000 M9\n13 L X+9 FMAX\n"
      "14 L X+10\n15 CYCL DEF 9.0 DWELL TIME\n16 CYCL DEF 9.1 DWELL 1.5\n17 M5\n18 STOP M0\n"
      "19 L M140 MB MAX\n20 M30\n21 END PGM part-1 MM\n");
  ASSERT_THAT(r, Succeeds());
  ASSERT_EQ(r->motions.size(), 5U);
  EXPECT_EQ(r->motions[0].from_mm, (Vec3{-1.5, 2, 100}));
  EXPECT_EQ(r->motions[0].to_mm, (Vec3{-1.5, 2, -0.25}));
  EXPECT_EQ(r->motions[0].feed_mm_min, 500.0);
  EXPECT_EQ(r->motions[0].line, 14U);
  EXPECT_EQ(r->motions[1].to_mm, (Vec3{0.5, 2, -0.25}));
  EXPECT_EQ(r->motions[2].to_mm, (Vec3{0.5, 3, 1}));
  EXPECT_EQ(r->motions[3].kind, Motion::Kind::rapid);
  EXPECT_EQ(r->motions[4].feed_mm_min, 1000.0) << "FMAX is for one block";
  EXPECT_EQ(r->motions[4].tool, 5);
  EXPECT_EQ(r->summary.dwell_s, 1.5);
  EXPECT_EQ(r->summary.tool_changes, 1U);
  EXPECT_TRUE(r->summary.ended);
}

TEST(Heidenhain, ReadsTheToleranceOfTheContour) {
  const auto r = read(program(
      "3 L X+1 Y+0 Z+0 F100\n4 CYCL DEF 32.0 TOLERANCE\n5 CYCL DEF 32.1 T0.02\n6 CYCL DEF 32.2 "
      "HSC-MODE:1 TA0.5\n7 L X+2\n8 CYCL DEF 32.0 TOLERANCE\n9 CYCL DEF 32.1\n10 L X+3"));
  ASSERT_THAT(r, Succeeds());
  const auto& m = r->motions;
  ASSERT_GE(m.size(), 3U);
  EXPECT_FALSE(m[m.size() - 3].control);
  ASSERT_TRUE(m[m.size() - 2].control);
  EXPECT_EQ(m[m.size() - 2].control->mode, PathControl::Mode::blend);
  EXPECT_EQ(m[m.size() - 2].control->tolerance_mm, 0.02);
  EXPECT_TRUE(m[m.size() - 2].control->stated);
  EXPECT_FALSE(m.back().control) << "as the machine is set again";
}

TEST(Heidenhain, ReadsInches) {
  const auto r = read("BEGIN PGM A INCH\nL X+1 Y+0 Z+0 FMAX\nL X+2 F10\nEND PGM A INCH\n");
  ASSERT_THAT(r, Succeeds());
  EXPECT_EQ(r->motions[0].to_mm, (Vec3{50.8, 0, 0}));
  EXPECT_DOUBLE_EQ(r->motions[0].feed_mm_min, 254.0);
}

TEST(Heidenhain, ForgetsWhereTheMachineFrameTakesIt) {
  const auto r = read(program("L X+1\nL Z+0 FMAX M91\nL X+5 FMAX\nL Z+3 FMAX\nL X+6 FMAX"));
  ASSERT_THAT(r, Succeeds());
  ASSERT_EQ(r->motions.size(), 2U);
  EXPECT_EQ(r->motions[1].from_mm, (Vec3{5, 0, 3}));
}

TEST(Heidenhain, ReadsArcs) {
  constexpr double kPi = std::numbers::pi;
  struct Case {
    const char* blocks;
    ArcPlane plane;
    Vec3 centre, to;
    double sweep;
  };
  const std::vector<Case> cases = {
      {"CC X+0 Y+5\nC X+5 Y+5 DR+", ArcPlane::xy, {0, 5, 0}, {5, 5, 0}, kPi / 2},
      {"CC X+0 Y+5\nC X+5 Y+5 DR- F100", ArcPlane::xy, {0, 5, 0}, {5, 5, 0}, -1.5 * kPi},
      {"CC IX+5 IY+0\nC X+0 Y+0 DR-", ArcPlane::xy, {5, 0, 0}, {0, 0, 0}, -2 * kPi},
      {"CC Z+5 X+0\nC X+5 Z+5 DR-", ArcPlane::zx, {0, 0, 5}, {5, 0, 5}, -kPi / 2},
      {"CC Y+0 Z+5\nC Y+5 Z+5 DR+", ArcPlane::yz, {0, 0, 5}, {0, 5, 5}, kPi / 2},
      {"CR X+5 Y+5 R+5 DR+", ArcPlane::xy, {0, 5, 0}, {5, 5, 0}, kPi / 2},
      {"CR X+5 Y+5 R-5 DR+", ArcPlane::xy, {5, 0, 0}, {5, 5, 0}, 1.5 * kPi},
      {"CR IX+5 IY+5 R+5 DR-", ArcPlane::xy, {5, 0, 0}, {5, 5, 0}, -kPi / 2},
      {"CC X+5 Y+0\nCP PA+0 DR+", ArcPlane::xy, {5, 0, 0}, {10, 0, 0}, kPi},
      {"CC X+5 Y+0\nCP IPA-720 IZ-3 DR-", ArcPlane::xy, {5, 0, 0}, {0, 0, -3}, -4 * kPi},
  };
  for (const Case& c : cases) {
    const Motion m = last(c.blocks);
    EXPECT_EQ(m.kind, Motion::Kind::arc) << c.blocks;
    EXPECT_EQ(m.plane, c.plane) << c.blocks;
    EXPECT_LT(norm(m.centre_mm - c.centre), 1e-9) << c.blocks;
    EXPECT_LT(norm(m.to_mm - c.to), 1e-9) << c.blocks;
    EXPECT_NEAR(m.sweep_rad, c.sweep, 1e-9) << c.blocks;
  }
}

struct BadBlock {
  const char* blocks;
  ErrorCode code;
  int line, column;
  const char* says;
};
class HeidenhainErrors : public testing::TestWithParam<BadBlock> {};
TEST_P(HeidenhainErrors, NameFileLineAndColumn) {
  const BadBlock& bad = GetParam();
  const auto r = read(program(bad.blocks));
  ASSERT_THAT(r, FailsWith(bad.code)) << bad.blocks;
  EXPECT_THAT(r.error().message, StartsWith(fmt::format("part.h:{}:{}: ", bad.line, bad.column)))
      << bad.blocks;
  EXPECT_THAT(r.error().message, HasSubstr(bad.says)) << bad.blocks;
  EXPECT_THAT(r.error().message, HasSubstr("expected")) << bad.blocks;
}
INSTANTIATE_TEST_SUITE_P(
    Table, HeidenhainErrors,
    testing::Values(BadBlock{"3 L X+", kGcodeSyntax, 4, 7, "end"},
                    BadBlock{"3 L X1.2.3", kGcodeSyntax, 4, 9, "'.'"},
                    BadBlock{"3 L ?", kGcodeSyntax, 4, 5, "'?'"},
                    BadBlock{"3 ?", kGcodeSyntax, 4, 3, "'?'"},
                    BadBlock{"3 L X+1 RL", kGcodeUnsupported, 4, 9, "RL"},
                    BadBlock{"3 L A+1", kGcodeUnsupported, 4, 5, "found A"},
                    BadBlock{"3 RND R5", kGcodeUnsupported, 4, 3, "RND"},
                    BadBlock{"3 CALL LBL 1", kGcodeUnsupported, 4, 3, "CALL"},
                    BadBlock{"3 L X+Q1", kGcodeSyntax, 4, 7, "'Q'"},
                    BadBlock{"3 CYCL DEF 200 DRILLING", kGcodeUnsupported, 4, 12, "cycle 200"},
                    BadBlock{"3 CYCL DEF 32.1 HSC", kGcodeSyntax, 4, 17, "'H'"},
                    BadBlock{"3 TOOL CALL", kGcodeSyntax, 4, 12, "tool"},
                    BadBlock{"3 TOOL CALL 5 X S100", kGcodeUnsupported, 4, 15, "tool axis X"},
                    BadBlock{"3 L X+1 M97", kGcodeUnsupported, 4, 9, "M97"},
                    BadBlock{"3 C X+1 Y+1 DR+", kGcodeSyntax, 4, 3, "centre"},
                    BadBlock{"3 CC X+1\n4 C X+2 Y+0 DR+", kGcodeSyntax, 4, 3, "two of"},
                    BadBlock{"3 CC X+1 Y+0\n4 C X+2 Y+0", kGcodeSyntax, 5, 3, "direction"},
                    BadBlock{"3 CC X+1 Y+0\n4 C X+2.017 Y+0 DR+", kGcodeArc, 5, 3, "radius"},
                    BadBlock{"3 CR X+10 Y+0 R+4.9 DR+", kGcodeArc, 4, 3, "radius"},
                    BadBlock{"3 CC X+1 Y+0\n4 C X+2 Y+0 DR+ FMAX", kGcodeSyntax, 5, 3, "FMAX"},
                    BadBlock{"3 CC X+1 Y+0\n4 CP IPA+90 DR-", kGcodeSyntax, 5, 3, "against"},
                    BadBlock{"3 L X+2000000", kGcodeSyntax, 4, 3, "1 km"},
                    BadBlock{"3 L X+1 F0", kGcodeNoFeed, 4, 3, "feed"},
                    BadBlock{"3 L X+1 F100 M91", kGcodeUnsupported, 4, 3, "machine"}),
    [](const auto& test) { return fmt::format("Block{}", test.index); });

TEST(HeidenhainErrors, TheHead) {
  EXPECT_THAT(read("0 BEGIN PGM A\nEND PGM A\n"), FailsWith(kGcodeSyntax));
  EXPECT_THAT(read("0 BEGIN PGM A MM\n1 L X+1 F100\n2 END PGM A MM\n"), FailsWith(kGcodeSyntax));
}

TEST(HeidenhainErrors, TruncationIsNoticedAtEveryByte) {
  const std::string whole = program("3 L X+10.25 F100\n4 CC X+10.25 Y+5\n5 C X+15.25 Y+5 DR+");
  for (std::size_t bytes = 17; bytes < whole.find("99 END") + 6; ++bytes)
    EXPECT_FALSE(read(whole.substr(0, bytes))) << whole.substr(0, bytes);
}

}  // namespace
}  // namespace maquette::cnc
