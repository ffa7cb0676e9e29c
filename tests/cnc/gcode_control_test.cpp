// SPDX-License-Identifier: GPL-3.0-or-later

// What gcode_reader.hpp and gcode_control.hpp claim of lines that run more than once:
//
//   O words do what LinuxCNC says .......... programs whose ends are known by hand; the same
//                                            programs through LinuxCNC itself: rs274_test
//   M98 and M99 ............................ counts and nesting by hand
//   locals are local ....................... what a subprogram leaves behind
//   every error has line and column ........ a table
//   nothing runs for ever .................. endless loops, endless recursion
//   no input breaks it ..................... lines of good programs shuffled, cut and doubled

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "cnc/gcode_reader.hpp"
#include "cnc/verify.hpp"
#include "core/files.hpp"
#include "core/random.hpp"
#include "support/matchers.hpp"

namespace maquette::cnc {
namespace {

using maquette::testing_support::FailsWith;
using maquette::testing_support::ScratchFolder;
using maquette::testing_support::Succeeds;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::StartsWith;

constexpr const char* kStart = "G21 G90\nG0 X0 Y0 Z0\nF100\n";

Result<std::vector<Motion>> motions_of(std::string_view text) {
  std::vector<Motion> motions;
  MAQUETTE_TRY_VOID(read_gcode_text(text, "part.ngc", [&](std::span<const Motion> batch) {
    motions.insert(motions.end(), batch.begin(), batch.end());
    return Result<void>{};
  }));
  return motions;
}

/// x of the ends of all motions.
std::vector<double> xs(std::string_view lines) {
  const auto motions = motions_of(fmt::format("{}{}\nM2\n", kStart, lines));
  EXPECT_THAT(motions, Succeeds()) << lines;
  std::vector<double> x;
  if (motions)
    for (const Motion& m : *motions) x.push_back(m.to_mm.x);
  return x;
}

TEST(GcodeControl, CallsSubprogramsWithArguments) {
  EXPECT_THAT(xs("o100 sub\nG1 X[#1+#2]\no100 endsub\no100 call [1] [2]\nO100 CALL [5][6] (yes)"),
              ElementsAre(3, 11));
  EXPECT_THAT(xs("o<slot> sub\nG1 X#1\no< Slot > endsub\no<SLOT> call [4]"), ElementsAre(4));
  EXPECT_THAT(xs("o7 sub\nG1 X1\no7 return\nX2\no7 endsub\n#5=7\no#5 call\nG1 X9"),
              ElementsAre(1, 9));
  EXPECT_THAT(xs("N10 o7 sub\nN20 G1 X3\nN30 o7 endsub\nN40 o[3+4] call"), ElementsAre(3));
  // One calls another; a missing argument is 0.
  EXPECT_THAT(xs("o1 sub\nG1 X[#1+#2]\no1 endsub\no2 sub\no1 call [#1]\no1 call [#1] [1]\n"
                 "o2 endsub\no2 call [5]"),
              ElementsAre(5, 6));
}

TEST(GcodeControl, LocalsAreLocal) {
  EXPECT_THAT(xs("#1=7 #31=1 #<a>=2 #<_b>=3\n"
                 "o1 sub\n#1=8 #31=9 #<a>=10 #<_b>=11\nG1 X[#1+#31+#<a>+#<_b>]\no1 endsub [5]\n"
                 "o1 call [99]\nG1 X[#1+#31+#<a>+#<_b>]\nX#<_value>"),
              ElementsAre(38, 7 + 9 + 2 + 11, 5));
}

TEST(GcodeControl, BranchesAndLoops) {
  const std::string branches =
      "o1 sub\no2 if [#1 lt 0]\nG1 X-1\no2 elseif [#1 eq 0]\nG1 X0.5\no2 elseif [#1 eq 1]\n"
      "G1 X1\no2 else\nG1 X2\no2 endif\nX9\no1 endsub\n";
  EXPECT_THAT(xs(branches + "o1 call [-5]\no1 call [0]\no1 call [1]\no1 call [7]"),
              ElementsAre(-1, 9, 0.5, 9, 1, 9, 2, 9));
  EXPECT_THAT(xs("#1=0\no1 while [#1 lt 3]\n#1=[#1+1]\nG1 X#1\no1 endwhile"), ElementsAre(1, 2, 3));
  EXPECT_THAT(xs("#1=0\no1 do\n#1=[#1+1]\nG1 X#1\no1 while [#1 lt 3]\nX8"),
              ElementsAre(1, 2, 3, 8));
  EXPECT_THAT(xs("#1=0\no1 repeat [2]\no2 repeat [3]\n#1=[#1+1]\nG1 X#1\no2 endrepeat\nX-#1\n"
                 "o1 endrepeat"),
              ElementsAre(1, 2, 3, -3, 4, 5, 6, -6));
  EXPECT_THAT(xs("o1 repeat [0]\nG1 X5\no1 endrepeat\nG1 X1"), ElementsAre(1));
  EXPECT_THAT(xs("#1=0\no1 while [1]\n#1=[#1+1]\no2 if [#1 eq 2]\no1 continue\no2 endif\n"
                 "o3 if [#1 eq 4]\no1 break\no3 endif\nG1 X#1\no1 endwhile\nX7"),
              ElementsAre(1, 3, 7));
  EXPECT_THAT(xs("#1=0\no1 repeat [2]\n#2=0\no4 repeat [9]\n#2=[#2+1]\no5 if [#2 eq 2]\no4 break\n"
                 "o5 endif\nG1 X[#2+10*#1]\no4 endrepeat\n#1=[#1+1]\no1 endrepeat"),
              ElementsAre(1, 11));
  // A return out of loops in a loop.
  EXPECT_THAT(xs("o1 sub\no2 while [1]\no3 repeat [5]\nG1 X#1\no1 return\no3 endrepeat\n"
                 "o2 endwhile\no1 endsub\no1 call [1]\no1 call [2]"),
              ElementsAre(1, 2));
}

TEST(GcodeControl, FanucSubprograms) {
  // After M30, read only when called; old and new counts; one calls another; twice the same.
  const std::string text =
      "%\nO0001 (main)\nG21 G90\nG0 X0. Y0. Z0.\nF100.\nM98 P1000\nG1 X5.\nM98 P1000 L2\n"
      "M98 P00021000\nG90 G1 X0. M98 P2000\nM30\nO1000 (step)\nG91 G1 X1.\nG90 M99\n"
      "O2000\nM98 P1000\nX[50]\nM99\n%\n";
  const auto motions = motions_of(text);
  ASSERT_THAT(motions, Succeeds());
  std::vector<double> x;
  for (const Motion& m : *motions) x.push_back(m.to_mm.x);
  EXPECT_THAT(x, ElementsAre(1, 5, 6, 7, 8, 9, 0, 1, 50));
  EXPECT_EQ(motions->front().line, 13U) << "where the words stand";
  // The same from a file, found behind more than one buffer of other lines.
  const ScratchFolder folder;
  std::string lines;
  for (int i = 0; i < 200000; ++i) lines += fmt::format("N{} G1 X{} Y0.125 (filler)\n", i, i % 7);
  const std::size_t end = text.find("M30");
  ASSERT_THAT(write_file(folder / "part.nc", text.substr(0, end) + lines + text.substr(end)),
              Succeeds());
  std::uint64_t count = 0;
  const auto summary = read_gcode(folder / "part.nc", [&](std::span<const Motion> batch) {
    count += batch.size();
    return Result<void>{};
  });
  ASSERT_THAT(summary, Succeeds());
  EXPECT_EQ(count, 200009U);
}

TEST(GcodeControl, AProgramMayEndInASubprogram) {
  const auto motions =
      motions_of(fmt::format("{}o1 sub\nG1 X1\nM2\nX2\no1 endsub\no1 call\nX3 nonsense\n", kStart));
  ASSERT_THAT(motions, Succeeds());
  EXPECT_EQ(motions->size(), 1U);
}

struct BadProgram {
  const char* lines;  // from line 4
  ErrorCode code;
  int line, column;
  const char* says;
};
class GcodeControlErrors : public testing::TestWithParam<BadProgram> {};

TEST_P(GcodeControlErrors, NameFileLineAndColumn) {
  const BadProgram& bad = GetParam();
  const auto r = motions_of(fmt::format("{}{}\nM2\n", kStart, bad.lines));
  ASSERT_THAT(r, FailsWith(bad.code)) << bad.lines;
  EXPECT_THAT(r.error().message, StartsWith(fmt::format("part.ngc:{}:{}: ", bad.line, bad.column)))
      << bad.lines;
  EXPECT_THAT(r.error().message, HasSubstr(bad.says)) << bad.lines;
  EXPECT_THAT(r.error().message, HasSubstr("expected")) << bad.lines;
}
INSTANTIATE_TEST_SUITE_P(
    Table, GcodeControlErrors,
    testing::Values(
        BadProgram{"o1 sub\nG1 X1", kGcodeTruncated, 7, 1, "o1 endsub (it begins in line 4)"},
        BadProgram{"o1 endsub", kGcodeSyntax, 4, 1, "without its beginning"},
        BadProgram{"o1 if [1]\no2 endif\no1 endif", kGcodeSyntax, 5, 1, "o1 endif first"},
        BadProgram{" o1 sub\n  o2 while [1]\no1 endsub", kGcodeSyntax, 6, 1, "o2 endwhile first"},
        BadProgram{"o1 if [1]\no2 sub\no2 endsub\no1 endif", kGcodeSyntax, 5, 1, "inside"},
        BadProgram{"o1 sub\no2 else\no1 endsub", kGcodeSyntax, 5, 1, "branch"},
        BadProgram{"o1 if [1]\no1 break\no1 endif", kGcodeSyntax, 5, 1, "loop"},
        BadProgram{"o1 fly", kGcodeSyntax, 4, 1, "says nothing known"},
        BadProgram{"o", kGcodeSyntax, 4, 1, "says nothing known"},
        BadProgram{"o9 call", kGcodeUnsupported, 4, 1, "o9"},
        BadProgram{"o1 if [1\nG1 X1\no1 endif", kGcodeSyntax, 4, 9, "']'"},
        BadProgram{"o1 if\nG1 X1\no1 endif", kGcodeSyntax, 4, 6, "condition"},
        BadProgram{"o1 while [1] 2\nG1 X1\no1 endwhile", kGcodeSyntax, 4, 14, "'2'"},
        BadProgram{"o1 sub\nG1 X!\no1 endsub\no1 call", kGcodeSyntax, 5, 5, "'!'"},
        BadProgram{"o1 sub\no1 call\no1 endsub\no1 call", kGcodeUnsupported, 5, 1, "10 deep"},
        BadProgram{"o1 while [1]\n#1=5\no1 endwhile", kGcodeUnsupported, 5, 1, "does not end"},
        BadProgram{"o1 if [1]\no1 return\no1 endif", kGcodeSyntax, 5, 1, "return"},
        BadProgram{"M98 P5", kGcodeUnsupported, 4, 1, "O5"},
        BadProgram{"M98 P5\nM30\nO5\nG1 X1", kGcodeUnsupported, 4, 1, "M99"},
        BadProgram{"M98 P5\nM30\nO5\nM98 P5\nM99", kGcodeUnsupported, 7, 1, "10 deep"},
        BadProgram{"M98 P5 L0.5", kGcodeSyntax, 4, 8, "count"},
        BadProgram{"G1 X1\nM99", kGcodeUnsupported, 5, 1, "M99"},
        BadProgram{"O1 G1 X1", kGcodeSyntax, 4, 1, "says nothing known"},
        BadProgram{"o1 call [1] X5", kGcodeSyntax, 4, 13, "'X'"}),
    [](const auto& test) { return fmt::format("Program{}", test.index); });

TEST(GcodeControl, TruncatedInsideOfASubprogramIsNoticed) {
  const std::string whole = fmt::format("{}o1 sub\nG1 X1\no1 endsub\no1 call", kStart);
  for (std::size_t bytes = whole.find("o1") + 1; bytes < whole.size(); ++bytes) {
    const auto r = motions_of(whole.substr(0, bytes));
    const bool after = bytes > whole.find("endsub") + 6 && whole[bytes - 1] == '\n';
    if (after)
      EXPECT_THAT(r, Succeeds()) << bytes;
    else
      EXPECT_FALSE(r) << whole.substr(0, bytes);
  }
}

TEST(GcodeControl, ReadingALoopCanBeStopped) {
  std::stop_source stop;
  RunContext run;
  run.stop = stop.get_token();
  std::uint64_t count = 0;
  const auto r = read_gcode_text(
      fmt::format("{}o1 while [1]\nG1 X1\nX2\no1 endwhile\nM2\n", kStart), "part.ngc",
      [&](std::span<const Motion> batch) {
        count += batch.size();
        if (count > 100000) stop.request_stop();
        return Result<void>{};
      },
      run);
  EXPECT_THAT(r, FailsWith(kCancelled));
}

class GcodeControlMutation : public testing::TestWithParam<int> {};
TEST_P(GcodeControlMutation, GivesAResultOrAnErrorWithAPlace) {
  const auto seed = static_cast<std::uint64_t>(GetParam());
  const std::vector<std::string> good{"O1 sub\n",
                                      "G1 X#1\n",
                                      "o2 if [#1 lt 3]\n",
                                      "X9\n",
                                      "o2 else\n",
                                      "Y[#1]\n",
                                      "o2 endif\n",
                                      "o1 endsub\n",
                                      "#7=0\n",
                                      "o3 while [#7 lt 4]\n",
                                      "#7=[#7+1]\n",
                                      "o1 call [#7]\n",
                                      "o4 repeat [2]\n",
                                      "o3 continue\n",
                                      "o4 endrepeat\n",
                                      "o3 endwhile\n",
                                      "o5 do\n",
                                      "o5 break\n",
                                      "o5 while [1]\n",
                                      "M98 P8 L2\n",
                                      "M30\n",
                                      "O8\n",
                                      "G91 X1 G90\n",
                                      "M99\n"};
  std::uint64_t draw = 0;
  int failures = 0;
  for (int round = 0; round < 1500; ++round) {
    std::vector<std::string> lines = good;
    const auto edits = random_bits(seed, draw++) % 5;
    for (std::uint64_t e = 0; e < edits; ++e) {
      const std::size_t a = random_bits(seed, draw++) % lines.size();
      const std::size_t b = random_bits(seed, draw++) % lines.size();
      const auto kind = random_bits(seed, draw++) % 4;
      if (kind == 0)
        std::swap(lines[a], lines[b]);
      else if (kind == 1)
        lines[a] = lines[b];
      else if (kind == 2 && !lines[a].empty())
        lines[a].erase(random_bits(seed, draw++) % lines[a].size(), 1);
      else
        lines[a].clear();
    }
    std::string text = kStart;
    for (const std::string& l : lines) text += l;
    std::uint64_t count = 0;
    const auto r = read_gcode_text(text, "part.ngc", [&](std::span<const Motion> batch) {
      count += batch.size();
      if (count > 20000) return Result<void>{fail(kCancelled, "part.ngc:0:0: enough")};
      return Result<void>{};
    });
    if (r) continue;
    ++failures;
    EXPECT_THAT(r.error().message, testing::MatchesRegex("part.ngc:[0-9]+:[0-9]+: (.|\n)*"));
  }
  EXPECT_GT(failures, 300);
  EXPECT_LT(failures, 1500);
}
INSTANTIATE_TEST_SUITE_P(Seed, GcodeControlMutation, testing::Values(1, 2),
                         testing::PrintToStringParamName());

}  // namespace
}  // namespace maquette::cnc
