// SPDX-License-Identifier: GPL-3.0-or-later

// What program.hpp and posts.hpp claim, and how each claim is attacked:
//
//   a program is head, moves, end .......... whole texts by hand
//   numbers are as short as they can be .... values by hand
//   lines fit the control .................. long comments, names, far coordinates
//   parts are whole programs ............... each below its limits, the path goes on where it
//                                            was left, nothing is lost; more parts than open files
//   whole or not at all .................... writers that die, folders that are not there
//   options are checked .................... a table of bad ones
//   arcs suit the control .................. flat ones, helices, radii apart by rounding

#include "cnc/program.hpp"

#include <fstream>
#include <sstream>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>

#include "cnc/gcode_reader.hpp"
#include "core/files.hpp"
#include "support/matchers.hpp"

namespace maquette::cnc {
namespace {

using testing::HasSubstr;
using testing::Not;
using testing_support::FailsWith;
using testing_support::ScratchFolder;
using testing_support::Succeeds;

constexpr std::array kAllPosts{"linuxcnc", "grbl", "fanuc", "heidenhain", "haas"};

PathMove rapid(std::int64_t x, std::int64_t y, std::int64_t z) {
  PathMove m;
  m.kind = PathMove::Kind::rapid;
  m.to = {x, y, z};
  return m;
}
PathMove line(std::int64_t x, std::int64_t y, std::int64_t z, double feed = 3000.0) {
  PathMove m;
  m.to = {x, y, z};
  m.feed_mm_min = feed;
  return m;
}
PathMove arc(ArcPlane plane, bool ccw, ToolPosition to, std::array<std::int64_t, 3> centre,
             double feed = 3000.0) {
  PathMove m;
  m.kind = PathMove::Kind::arc;
  m.plane = plane;
  m.counter_clockwise = ccw;
  m.to = to;
  m.i = centre[0];
  m.j = centre[1];
  m.k = centre[2];
  m.feed_mm_min = feed;
  return m;
}

ProgramOptions options_for(const std::string& post) {
  ProgramOptions o;
  o.post = post;
  o.safe_z = Millimetres{20.0};
  return o;
}

struct Written {
  std::vector<std::string> files;  // their text
  ProgramReport report;
};
Result<Written> write(const ScratchFolder& folder, const ProgramOptions& o,
                      const std::vector<PathMove>& moves) {
  MAQUETTE_TRY(auto writer, ProgramWriter::create(folder / "part.ngc", o));
  writer.tool(Tool{}, 18000.0);
  MAQUETTE_TRY_VOID(writer.add(moves));
  Written w;
  MAQUETTE_TRY(w.report, writer.commit());
  for (const auto& file : w.report.files) {
    MAQUETTE_TRY(auto text, read_file(file));
    w.files.push_back(std::move(text));
  }
  return w;
}
std::string only_text(const ProgramOptions& o, const std::vector<PathMove>& moves) {
  const ScratchFolder folder;
  const auto written = write(folder, o, moves);
  EXPECT_THAT(written, Succeeds());
  return written && written->files.size() == 1 ? written->files[0] : "";
}
std::vector<std::string> lines_of(const std::string& text) {
  std::vector<std::string> lines;
  std::istringstream in(text);
  for (std::string line; std::getline(in, line);) lines.push_back(line);
  return lines;
}

// ---- text ------------------------------------------------------------------------------

TEST(Program, IsHeadMovesAndEnd) {
  ProgramOptions o = options_for("linuxcnc");
  o.name = "band 1";
  o.comments = {"mind (the) dog; please"};
  o.blending = Millimetres{0.0005};
  o.work_offset = 592;
  o.coolant = true;
  EXPECT_EQ(only_text(o, {rapid(0, 0, 100000), line(0, 0, -12345, 600.0), line(5000, 0, -12345),
                          line(5000, 0, -12345),  // no block
                          arc(ArcPlane::zx, false, {105000, 0, -12345}, {50000, 0, 0}),
                          arc(ArcPlane::xy, true, {205000, 0, -2345}, {50000, 0, 0}, 2999.999),
                          rapid(0, 0, 300000)}),
            "(band 1)\n"
            "(for LinuxCNC 2.9, unit mm, z is the tip of the cutter)\n"
            "(mind [the] dog_ please)\n"
            "G21 G90 G17 G94 G40 G49 G80\n"
            "G59.2\n"
            "(T1 ball nose 6 mm)\n"
            "T1 M6\n"
            "G43 H1\n"
            "S18000 M3\n"
            "M8\n"
            "G64 P0.0005 Q0\n"
            "G0Z20\n"
            "X0Y0\n"
            "Z10\n"
            "G1Z-1.2345F600\n"
            "X0.5F3000\n"
            "G18G2X10.5I5\n"
            "G17G3X20.5Z-0.2345I5\n"
            "G0X0Z30\n"
            "M9\n"
            "M5\n"
            "M30\n");
}

// A cut with all axes after each rapid, then increments; nothing adds up: thirds of the last
// decimal, rounded one by one, would be off by 100 of them at the end.
TEST(Program, SaysHowFarCutsGo) {
  ProgramOptions o = options_for("linuxcnc");
  o.relative = true;
  EXPECT_THAT(only_text(o, {rapid(0, 0, 100000), line(0, 0, -12345, 600.0), line(5000, 0, -12345),
                            arc(ArcPlane::zx, false, {105000, 0, -12345}, {50000, 0, 0}),
                            line(105001, -3, -12345), rapid(0, 0, 300000), line(0, 0, 100)}),
              HasSubstr("Z10\nG1X0Y0Z-1.2345F600\n"
                        "G91X.5F3000\n"
                        "G18G2X10I5\n"
                        "G1X.0001Y-.0003\n"
                        "G90G0X0Y0Z30\n"
                        "G1X0Y0Z0.01\n"));
  o.post = "fanuc";
  std::vector<PathMove> path{rapid(0, 0, 100000)};
  for (int i = 0; i < 1000; ++i) path.push_back(line(333 * i, 0, 0));
  const ScratchFolder folder;
  auto writer = ProgramWriter::create(folder / "part.nc", o);
  ASSERT_THAT(writer, Succeeds());
  writer->tool({}, 0.0);
  ASSERT_THAT(writer->add(path), Succeeds());
  const auto report = writer->commit();
  ASSERT_THAT(report, Succeeds());
  double farthest = 0.0;
  ASSERT_THAT(read_gcode(report->files[0],
                         [&](std::span<const Motion> batch) {
                           for (const Motion& m : batch) farthest = std::max(farthest, m.to_mm.x);
                           return Result<void>{};
                         }),
              Succeeds());
  EXPECT_NEAR(farthest, 33.267, 1e-9);  // 999 x 333 ticks, rounded once
  const std::string text = *read_file(report->files[0]);
  // Over the start, the first cut and after every hundred that follow one.
  EXPECT_EQ(std::count(text.begin(), text.end(), 'Y'), 11);
  for (const char* post : {"grbl", "heidenhain"}) {
    o.post = post;
    EXPECT_THAT(ProgramWriter::create(folder / "part", o), FailsWith(kProgramOptionOutOfRange));
  }
}

TEST(Program, SpeaksHeidenhain) {
  ProgramOptions o = options_for("heidenhain");
  o.name = "band 1";
  o.blending = Millimetres{0.005};
  EXPECT_EQ(only_text(o, {rapid(0, 0, 100000), line(0, 0, -12345, 600.0), line(5000, 0, -12345),
                          arc(ArcPlane::zx, false, {105000, 0, -12345}, {50000, 0, 0})}),
            "0 BEGIN PGM band_1 MM\n"
            "1 ; for Heidenhain TNC 640 / iTNC 530, conversational, unit mm, z is the tip of the "
            "cutter\n"
            "2 CYCL DEF 247 DATUM SETTING ~\n"
            "  Q339=+1 ;DATUM NUMBER\n"
            "3 ; T1 ball nose 6 mm\n"
            "4 TOOL CALL 1 Z S18000\n"
            "5 M3\n"
            "6 CYCL DEF 32.0 TOLERANCE\n"
            "7 CYCL DEF 32.1 T0.005\n"
            "8 L Z+20 R0 FMAX\n"
            "9 L X+0 Y+0 FMAX\n"
            "10 L Z+10 FMAX\n"
            "11 L Z-1.2345 F600\n"
            "12 L X+0.5 F3000\n"
            "13 CC Z-1.2345 X+5.5\n"
            "14 C Z-1.2345 X+10.5 DR-\n"
            "15 L Z+20 FMAX\n"
            "16 CYCL DEF 32.0 TOLERANCE\n"
            "17 CYCL DEF 32.1\n"
            "18 M5\n"
            "19 M30\n"
            "20 END PGM band_1 MM\n");
}

TEST(Program, FanucAndHaasGetPointsThreeDecimalsAndStraightRapids) {
  for (const std::string post : {"fanuc", "haas"}) {
    ProgramOptions o = options_for(post);
    o.number = 42;
    const std::string text =
        only_text(o, {rapid(0, 0, 100000), line(0, 0, -12345, 600.0), line(50000, 4, -12345),
                      line(50004, 4, -12345), rapid(0, 100000, 150000)});
    EXPECT_THAT(text,
                HasSubstr(post == "fanuc" ? "%\nO0042(maquette)\n" : "%\nO00042(maquette)\n"));
    EXPECT_THAT(text, HasSubstr("G43 H1 Z20.\nG0Z10.\nG1Z-1.235F600.\nX5.F3000.\n"
                                "G0Z20.\nX0.Y10.\nZ15.\n"));
    EXPECT_THAT(text, HasSubstr("M30\n%\n"));
  }
}

TEST(Program, WritesNumbersShortAndWhole) {
  for (const auto& [ticks, text] :
       std::vector<std::pair<std::int64_t, std::string>>{{1, "0.0001"},
                                                         {-1, "-0.0001"},
                                                         {10, "0.001"},
                                                         {-30, "-0.003"},
                                                         {125000, "12.5"},
                                                         {20000001, "2000.0001"},
                                                         {1000000, "100"},
                                                         {990100, "99.01"},
                                                         {999999999, "99999.9999"},
                                                         {-1000000000, "-100000"},
                                                         {1234567, "123.4567"}})
    EXPECT_THAT(only_text(options_for("linuxcnc"), {rapid(5, 5, 100000), rapid(5, 5, 200000),
                                                    line(ticks, 5, 200000, 33.25)}),
                HasSubstr(fmt::format("G1X{}F33.25\n", text)));
}

TEST(Program, LinesFitTheControl) {
  for (const std::string post : kAllPosts) {
    ProgramOptions o = options_for(post);
    o.line_numbers = true;
    o.name = std::string(300, 'n');
    o.comments = {std::string(1000, 'w'), "words " + std::string(200, 'w') + " and words"};
    const std::string text = only_text(
        o, {rapid(-999999999, -999999999, -999999999), line(-899999999, -799999999, 0, 999999.99),
            arc(ArcPlane::yz, true, {-899999999, -500000001, 1}, {0, 149999999, 1}, 888888.88)});
    std::size_t longest = 0;
    for (const std::string& l : lines_of(text)) longest = std::max(longest, l.size());
    EXPECT_LE(longest, post_by_name(post)->longest_line) << text;
    EXPECT_GT(longest, 60U);
  }
}

TEST(Program, NumbersLinesWhereTheControlHasThem) {
  ProgramOptions o = options_for("linuxcnc");
  o.line_numbers = true;
  EXPECT_THAT(only_text(o, {rapid(0, 0, 0)}), HasSubstr("N10 G0Z20\nN11 X0Y0\nN12 Z0\n"));
  o.post = "grbl";
  EXPECT_THAT(only_text(o, {rapid(0, 0, 0)}), Not(HasSubstr("N1")));
}

TEST(Program, ChangesTools) {
  const ScratchFolder folder;
  for (const std::string post : kAllPosts) {
    auto writer = ProgramWriter::create(folder / "part.ngc", options_for(post));
    ASSERT_THAT(writer, Succeeds());
    writer->tool({.number = 3, .name = "flat 12 mm"}, 9000.0);
    const std::vector<PathMove> moves{rapid(0, 0, 100000), line(10000, 0, -10000)};
    ASSERT_THAT(writer->add(moves), Succeeds());
    writer->comment("now the finish");
    writer->tool({.number = 4, .name = "ball 6 mm"}, 18000.0);
    writer->go_to({0, 0, -20000}, 500.0);
    const auto report = writer->commit();
    ASSERT_THAT(report, Succeeds());
    const std::string text = *read_file(folder / "part.ngc");
    const auto place = [&](std::string_view what) {
      const std::size_t at = text.find(what);
      EXPECT_NE(at, std::string::npos) << what << " in\n" << text;
      return at;
    };
    // In this order: cut, up, stop, change, start, over, down fast, down slowly.
    if (post == "linuxcnc") {
      EXPECT_THAT(text, HasSubstr("G1X1Z-1F3000\n(now the finish)\nG0Z20\nM5\n(T4 ball 6 mm)\n"
                                  "G17 T4 M6\nG43 H4\nS18000 M3\nG61\nG0Z20\nX0Y0\nZ-1\n"
                                  "G1Z-2F500\nG0Z20\nM5\nM30\n"));
    }
    EXPECT_LT(place("T3"), place("T4"));
    EXPECT_LT(place("M5"), place(post == "heidenhain" ? "TOOL CALL 4" : "T4 M"));
    EXPECT_EQ(report->cutting_moves, 1U);
  }
}

// ---- arcs ------------------------------------------------------------------------------

TEST(Program, FlatArcsAreLinesAndUnknownOnesChords) {
  // Sagitta 0.25 ticks, then 1 tick, over 0.2 mm.
  const auto flat = arc(ArcPlane::xy, true, {2000, 0, 0}, {1000, 2000000, 0});
  const auto bent = arc(ArcPlane::xy, true, {2000, 0, 0}, {1000, 500000, 0});
  EXPECT_THAT(only_text(options_for("linuxcnc"), {rapid(0, 0, 0), flat}), Not(HasSubstr("G3")));
  EXPECT_THAT(only_text(options_for("linuxcnc"), {rapid(0, 0, 0), bent}), HasSubstr("G3"));
  // Half a unit is more where the unit is coarser.
  EXPECT_THAT(only_text(options_for("fanuc"), {rapid(0, 0, 0), bent}), Not(HasSubstr("G3")));
  // A helix in the language without one: chords no farther from it than was asked for.
  ProgramOptions o = options_for("heidenhain");
  o.arc_chords = Millimetres{0.01};
  const ScratchFolder folder;
  const auto written = write(
      folder, o, {rapid(0, 0, 0), arc(ArcPlane::xy, false, {100000, 0, -30000}, {50000, 0, 0})});
  ASSERT_THAT(written, Succeeds());
  EXPECT_EQ(written->report.arcs_as_chords, 1U);
  EXPECT_THAT(written->files[0], Not(HasSubstr("DR")));
  EXPECT_THAT(written->files[0], HasSubstr("L X+10 Y+0 Z-3"));
  // Half a turn of 5 mm radius: pi sqrt(5 / (8 0.01)) = 24.8.
  EXPECT_EQ(std::count(written->files[0].begin(), written->files[0].end(), 'Z'), 25 + 4);
}

// ---- parts -----------------------------------------------------------------------------

std::vector<PathMove> long_path(int n) {
  std::vector<PathMove> moves{rapid(0, 0, 300000)};
  for (int i = 1; i <= n; ++i) moves.push_back(line(1000 * i, 7 * i, -10000 - 31 * (i % 100)));
  return moves;
}

TEST(Program, PartsStayBelowTheirLimitsAndLoseNothing) {
  for (const std::string post : kAllPosts) {
    for (const bool by_bytes : {false, true}) {
      const ScratchFolder folder;
      ProgramOptions o = options_for(post);
      (by_bytes ? o.max_bytes : o.max_lines) = by_bytes ? 20000 : 500;
      const std::vector<PathMove> moves = long_path(5000);
      const auto written = write(folder, o, moves);
      ASSERT_THAT(written, Succeeds());
      ASSERT_GE(written->files.size(), 5U);
      EXPECT_EQ(written->report.files[1].filename(), "part_2.ngc");
      std::size_t cuts = 0, bytes = 0, blocks = 0;
      for (const std::string& text : written->files) {
        const auto lines = lines_of(text);
        bytes += text.size();
        blocks += lines.size();
        if (by_bytes)
          EXPECT_LE(text.size(), 20000U);
        else
          EXPECT_LE(lines.size(), 500U);
        // Not wastefully small either, but for the last.
        if (&text != &written->files.back()) {
          if (by_bytes)
            EXPECT_GE(text.size(), 17000U);
          else
            EXPECT_GE(lines.size(), 470U);
        }
        EXPECT_THAT(text, HasSubstr(post == "heidenhain" ? "TOOL CALL 1" : "T1"));
        EXPECT_THAT(text, HasSubstr("S18000"));
        EXPECT_THAT(text, HasSubstr("M30"));
        for (const std::string& l : lines) cuts += l.find('X') != std::string::npos;
      }
      EXPECT_EQ(bytes, written->report.bytes);
      EXPECT_EQ(blocks, written->report.blocks);
      EXPECT_GE(cuts, moves.size());
    }
  }
}

TEST(Program, PartsGoOnWhereThePathWasLeft) {
  const ScratchFolder folder;
  ProgramOptions o = options_for("linuxcnc");
  o.max_lines = 200;
  const auto written = write(folder, o, long_path(400));
  ASSERT_THAT(written, Succeeds());
  ASSERT_GE(written->files.size(), 3U);
  const auto first = lines_of(written->files[0]);
  // ... X17.1Y.. / G0Z20 / M5 / (goes on in part 2) / M30
  ASSERT_EQ(first[first.size() - 4], "G0Z20");
  const std::string& last = first[first.size() - 5];
  const std::size_t y = last.find('Y'), z = last.find('Z');
  const std::string at = last.substr(0, z);
  const double height = std::stod(last.substr(z + 1));
  EXPECT_THAT(written->files[1], HasSubstr(fmt::format("(part 2)\n")));
  EXPECT_THAT(written->files[1],
              HasSubstr(fmt::format("G0Z20\n{}\nZ{}\nG1Z{}F600\n", at,
                                    fmt::format("{:.4f}", height + 1.0).substr(0, 7), height)))
      << last << y;
}

TEST(Program, WritesMorePartsThanFilesMayBeOpen) {
  const ScratchFolder folder;
  rlimit before{};
  ASSERT_EQ(::getrlimit(RLIMIT_NOFILE, &before), 0);
  const rlimit few{32, before.rlim_max};
  ASSERT_EQ(::setrlimit(RLIMIT_NOFILE, &few), 0);
  ProgramOptions o = options_for("linuxcnc");
  o.max_lines = 200;
  const auto written = write(folder, o, long_path(15000));
  ::setrlimit(RLIMIT_NOFILE, &before);
  ASSERT_THAT(written, Succeeds());
  EXPECT_GT(written->files.size(), 64U);
}

// ---- files and options -----------------------------------------------------------------

TEST(Program, IsWrittenWholeOrNotAtAll) {
  const ScratchFolder folder;
  {
    auto writer = ProgramWriter::create(folder / "part.ngc", [] {
      ProgramOptions o = options_for("linuxcnc");
      o.max_lines = 200;
      return o;
    }());
    ASSERT_THAT(writer, Succeeds());
    writer->tool(Tool{}, 18000.0);
    ASSERT_THAT(writer->add(long_path(1000)), Succeeds());
  }
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
  EXPECT_THAT(ProgramWriter::create(folder / "none/part.ngc", options_for("linuxcnc")),
              FailsWith(kFileNotWritable));
}

TEST(Program, ChecksItsOptions) {
  const ScratchFolder folder;
  const auto with = [&](auto change) {
    ProgramOptions o = options_for("linuxcnc");
    change(o);
    return ProgramWriter::create(folder / "part.ngc", o);
  };
  EXPECT_THAT(with([](auto& o) { o.post = "abacus"; }), FailsWith(kUnknownPost));
  const std::vector<std::function<void(ProgramOptions&)>> bad = {
      [](auto& o) { o.work_offset = 53; },
      [](auto& o) { o.work_offset = 594; },
      [](auto& o) { o.post = "grbl", o.work_offset = 591; },
      [](auto& o) { o.number = 0; },
      [](auto& o) { o.number = 8000; },
      [](auto& o) { o.blending = Millimetres{-0.1}; },
      [](auto& o) { o.blending = Millimetres{NAN}; },
      [](auto& o) { o.arc_chords = Millimetres{0.0}; },
      [](auto& o) { o.safe_z = Millimetres{NAN}; },
      [](auto& o) { o.entry_feed = FeedRate{0.0}; },
      [](auto& o) { o.max_lines = 199; },
      [](auto& o) { o.max_bytes = 16383; }};
  for (const auto& change : bad)
    EXPECT_THAT(with(change), FailsWith(kProgramOptionOutOfRange)) << &change - bad.data();
  // A head that fills the file leaves no room for the path.
  ProgramOptions o = options_for("linuxcnc");
  o.max_lines = 200;
  o.comments.assign(180, "line");
  EXPECT_THAT(write(folder, o, long_path(10)), FailsWith(kProgramOptionOutOfRange));
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
}

}  // namespace
}  // namespace maquette::cnc
