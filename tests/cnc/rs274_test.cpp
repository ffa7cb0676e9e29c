// SPDX-License-Identifier: GPL-3.0-or-later

// LinuxCNC's interpreter against ours, on our programs and on those of others. Both must
// understand the same; and rs274 must have nothing to say about what the linuxcnc post writes.
// Skips, and says so, where tools/setup --peers has not been run.
//
//   the post's programs .................... random paths of all kinds of moves; tool changes,
//                                            parts, offsets, blending, line numbers, comments
//   what mill writes ....................... a finishing program of real passes, arcs and all
//   a whole program of yours ............... MAQUETTE_PROGRAMS=a.ngc:b.ngc, every block of them
//   words, arcs, expressions, O words ...... small programs in which the two could differ
//   programs of others ..................... ../shared/data/gcode or MAQUETTE_DATA, if there

#include <fstream>
#include <numbers>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "cnc/gcode_reader.hpp"
#include "cnc/mill.hpp"
#include "cnc/program.hpp"
#include "core/files.hpp"
#include "random_path.hpp"
#include "rs274_peer.hpp"
#include "support/folders.hpp"
#include "support/matchers.hpp"
#include "support/terrain.hpp"

namespace maquette::cnc {
namespace {

using maquette::testing_support::ScratchFolder;
using maquette::testing_support::Succeeds;
using testing_support::CanonMotion;
using testing_support::CanonProgram;
using testing_support::random_path;

Result<std::vector<Motion>> motions_of(const std::filesystem::path& file) {
  std::vector<Motion> motions;
  MAQUETTE_TRY_VOID(read_gcode(file, [&](std::span<const Motion> batch) {
    motions.insert(motions.end(), batch.begin(), batch.end());
    return Result<void>{};
  }));
  return motions;
}

class Rs274 : public testing::Test {
 protected:
  void SetUp() override {
    const auto folder = testing_support::linuxcnc_folder();
    if (!folder) GTEST_SKIP() << "rs274 is not here; tools/setup --peers gets it";
    linuxcnc_ = *folder;
  }
  [[nodiscard]] CanonProgram interpret(const std::filesystem::path& program) const {
    return testing_support::run_rs274(linuxcnc_, program, folder_.path());
  }

  /// Every cut: where from, where to, how, how fast, with what. Rapids show in where from.
  /// @param decimal_mm  of rs274's output: 0.0001 of the program's unit
  void expect_same(const std::filesystem::path& program, double decimal_mm,
                   bool tools = true) const {
    const auto ours = motions_of(program);
    ASSERT_THAT(ours, Succeeds());
    const CanonProgram theirs = interpret(program);
    EXPECT_EQ(theirs.exit_code, 0);
    EXPECT_EQ(theirs.messages, "");
    EXPECT_TRUE(theirs.ended);
    const double close = 0.51 * decimal_mm;
    std::size_t t = 0, compared = 0;
    bool first = true;
    for (const Motion& m : *ours) {
      if (m.kind == Motion::Kind::rapid) continue;
      while (t < theirs.motions.size() && theirs.motions[t].kind == CanonMotion::Kind::traverse)
        ++t;
      ASSERT_LT(t, theirs.motions.size()) << "line " << m.line;
      const CanonMotion& c = theirs.motions[t++];
      const auto near = [&](Vec3 a, Vec3 b) {
        return std::abs(a.x - b.x) <= close && std::abs(a.y - b.y) <= close &&
               std::abs(a.z - b.z) <= close;
      };
      // Where the very first cut starts, a control that was never homed does not know.
      if (!first) {
        ASSERT_TRUE(near(m.from_mm, c.from_mm)) << "line " << m.line;
      }
      first = false;
      ASSERT_TRUE(near(m.to_mm, c.to_mm))
          << "line " << m.line << ": " << m.to_mm.x << " against " << c.to_mm.x;
      ASSERT_EQ(m.probe, c.kind == CanonMotion::Kind::probe) << "line " << m.line;
      ASSERT_EQ(m.kind == Motion::Kind::arc, c.kind == CanonMotion::Kind::arc) << "line " << m.line;
      ASSERT_NEAR(m.feed_mm_min, c.feed_mm_min, decimal_mm) << "line " << m.line;
      if (tools) {
        ASSERT_EQ(m.tool, c.tool) << "line " << m.line;
      }
      if (m.kind == Motion::Kind::arc) {
        ASSERT_EQ(static_cast<int>(m.plane), c.plane) << "line " << m.line;
        const double u = c.plane == 0   ? m.centre_mm.x
                         : c.plane == 1 ? m.centre_mm.z
                                        : m.centre_mm.y;
        const double v = c.plane == 0   ? m.centre_mm.y
                         : c.plane == 1 ? m.centre_mm.x
                                        : m.centre_mm.z;
        // A centre by radius near half a turn is as uncertain as rounding makes it.
        ASSERT_NEAR(u, c.centre_mm[0], close) << "line " << m.line;
        ASSERT_NEAR(v, c.centre_mm[1], close) << "line " << m.line;
        ASSERT_EQ(m.sweep_rad > 0.0, c.rotation > 0) << "line " << m.line;
        const double turns = std::ceil(std::abs(m.sweep_rad) / (2.0 * std::numbers::pi) - 1e-9);
        ASSERT_EQ(static_cast<int>(turns), std::abs(c.rotation)) << "line " << m.line;
      }
      ++compared;
    }
    while (t < theirs.motions.size()) {
      ASSERT_EQ(theirs.motions[t].kind, CanonMotion::Kind::traverse) << "they cut more";
      ++t;
    }
    EXPECT_GT(compared, 0U);
  }

  std::filesystem::path linuxcnc_;
  ScratchFolder folder_;
};

TEST_F(Rs274, HasNothingToSayAboutThePostsPrograms) {
  for (const int seed : {1, 2, 3, 4}) {
    ProgramOptions o;
    o.safe_z = Millimetres{40.0};
    o.line_numbers = seed % 2 == 0;
    o.coolant = seed % 2 == 0;
    o.blending = Millimetres{seed < 3 ? 0.002 : 0.0};
    o.comments = {"MSG, this (is) a; comment %", std::string(400, 'w')};
    o.max_lines = seed == 4 ? 2000 : 0;
    o.relative = seed % 2 == 1;
    auto writer = ProgramWriter::create(folder_ / "part.ngc", o);
    ASSERT_THAT(writer, Succeeds());
    const auto path = random_path(static_cast<std::uint64_t>(seed), 5000);
    for (const int tool : {7, 12}) {
      writer->tool({.number = tool, .name = "ball; (6 mm)"}, 12000.0);
      ASSERT_THAT(writer->add(path.moves), Succeeds());
    }
    const auto report = writer->commit();
    ASSERT_THAT(report, Succeeds());
    for (const auto& file : report->files) {
      expect_same(file, 1e-4);
      if (HasFailure()) return;
    }
  }
}

// The size of a band's program: every block.
TEST_F(Rs274, ReadsAWholeBand) {
  for (const bool relative : {false, true}) {
    ProgramOptions o;
    o.relative = relative;
    o.safe_z = Millimetres{40.0};
    o.blending = Millimetres{0.002};
    auto writer = ProgramWriter::create(folder_ / "band.ngc", o);
    ASSERT_THAT(writer, Succeeds());
    writer->tool({}, 18000.0);
    const auto path = random_path(9, 200000);
    ASSERT_THAT(writer->add(path.moves), Succeeds());
    ASSERT_THAT(writer->commit(), Succeeds());
    expect_same(folder_ / "band.ngc", 1e-4);
  }
}

TEST_F(Rs274, ReadsWhatMillWrites) {
  const auto design =
      maquette::testing_support::ground(maquette::testing_support::Ground::rolling, 2, 121, 0.5);
  for (const auto& [zigzag, relative] :
       {std::pair{true, false}, {false, false}, {true, true}, {false, true}}) {
    MillOptions options;
    options.zigzag = zigzag;
    options.relative = relative;
    ASSERT_THAT(mill(design, options, folder_ / "part.ngc"), Succeeds());
    expect_same(folder_ / "part.ngc", 1e-4);
  }
}

TEST_F(Rs274, ReadsTheProgramsGiven) {
  const char* given = std::getenv("MAQUETTE_PROGRAMS");
  if (given == nullptr) GTEST_SKIP() << "MAQUETTE_PROGRAMS names none (a.ngc:b.ngc)";
  std::istringstream list(given);
  for (std::string program; std::getline(list, program, ':');) {
    ASSERT_TRUE(std::filesystem::exists(program)) << program;
    expect_same(program, 1e-4);
  }
}

TEST_F(Rs274, UnderstandsWhatWeUnderstand) {
  const std::vector<std::pair<std::string, double>> programs = {
      {"G17 G3 X5 Y5 I0 J5\nG2 X0 Y0 R5\nG3 X5 Y5 R-5\nG3 I5\nG3 X5 Y5 Z2 I-5 P3\n", 1e-4},
      {"G18 G2 X5 Z5 I0 K5\nG3 X0 Z0 I-5 K0\nG2 X5 Z5 Y3 R5\nG2 K7\n", 1e-4},
      {"G19 G3 Y5 Z5 K5\nG2 Y0 Z0 R5\nG2 X4 Y5 Z5 R-5\n", 1e-4},
      {"G90.1 G17 G3 X5 Y5 I0 J5\nG91.1 G2 X0 Y0 I-5 J0\n", 1e-4},
      {"G20\nG1 X.5 Y-.25 F10\nG3 X1 Y.25 R.5\nG91 G1 X.1\nG90 G1 Z-.125\n", 25.4e-4},
      {"G91 G1 X1 Y2\nX1 Y2 Z-1\nG90 X0\nG91 G3 X1 Y1 I0 J1\n", 1e-4},
      {"#1=5 #2=[#1*2]\nG1 X#1 Y[#2/3] Z-[#1**2/100]\nX[sin[30]+atan[1]/[2]] Y[10 MOD 3]\n"
       "X[fix[-2.5]] Y[fup[2.1]] Z[round[-0.6]]\nX[abs[-1]+sqrt[2]] Y[exp[1]] Z[ln[2]]\n"
       "X[1 GT 0] Y[2 XOR 0] Z[1 AND 0]\n#<a_b>=3 #<_g>=4\nX#<a_b> Y[#<_g>-1]\n"
       "X[-7 MOD 3] Y[2**3**2/100] Z[8/4/2]\nX[1+2*3 EQ 7]\n",
       1e-4},
      {"o1 sub\nG1 X[#1+#2]\no2 if [#1 lt 3]\nY1\no2 elseif [#1 lt 6]\nY2\no2 else\nY3\n"
       "o2 endif\no1 endsub\no1 call [1] [2]\no1 call [4]\no1 call [8] [1]\n",
       1e-4},
      {"#1=0\no1 while [#1 lt 5]\n#1=[#1+1]\no3 if [#1 eq 2]\no1 continue\no3 endif\n"
       "o4 if [#1 eq 4]\no1 break\no4 endif\nG1 X#1\no1 endwhile\nX9\n",
       1e-4},
      {"#1=0\no1 do\n#1=[#1+1]\nG1 X#1\no1 while [#1 lt 3]\n#2=0\no2 repeat [3]\n#2=[#2+1]\nY#2\n"
       "o2 endrepeat\no3 repeat [0]\nX77\no3 endrepeat\n",
       1e-4},
      {"#1=7 #<a>=2 #<_other>=3 #31=1\no1 sub\n#1=8 #<a>=10 #<_other>=11 #31=9\n"
       "G1 X[#1+#<a>+#<_other>+#31]\no1 endsub [5]\no1 call "
       "[99]\nX[#1+#<a>+#<_other>+#31]\nX#<_value>\n",
       1e-4},
      {"o1 sub\no2 while [1]\no3 repeat [5]\nG1 X#1\no1 return\no3 endrepeat\no2 endwhile\n"
       "o1 endsub\no1 call [1]\no1 call [2]\n",
       1e-4},
      {"o<Slot> sub\nG1 X#1\no<slot> endsub\no<SLOT> call [4]\n#5=7\no7 sub\nY3\no7 endsub\n"
       "o#5 call\n",
       1e-4},
      {"G1 x 1 2 . 5 (a) y - 3.  ; x7\nN5 Z1 F2 0\n", 1e-4},
      {"G1 X1 G91\nX1 G90 Y4\nF50 Z3\n", 1e-4},
      {"G38.2 Z-10 F50\nG10 L20 P1 Z-10\nG0 Z5\nG1 X5\n", 1e-4},
  };
  for (const auto& [lines, decimal] : programs) {
    const std::string text = fmt::format(
        "G21 G90 G17 G94 G40 G49 G80 G54\nG64 P0.01\nT1 M6\nG0 X0 Y0 Z0\nF100\n{}M2\n", lines);
    std::ofstream(folder_ / "small.ngc") << text;
    expect_same(folder_ / "small.ngc", decimal);
    if (HasFailure()) {
      ADD_FAILURE() << text;
      return;
    }
  }
}

// Where we refuse an arc or a word, so does LinuxCNC, and what it refuses of the modal kind, we do.
TEST_F(Rs274, RefusesWhatWeRefuse) {
  for (const std::string lines :
       {"G1 X", "G1 X[1/0]", "G1 X[1", "G2 X5", "G2 X10 R1", "G2 X0 Y0 R5", "G3 X10.2 Y10 J10",
        "G1 X1 X2", "G0 G1 X1", "G1 X#<never>", "G1 XY1", "F0\nG1 X1", "G80\nX1", "G1 X1.2.3",
        "G1 Xsqrt[-1]", "o9 call"}) {
    std::ofstream(folder_ / "bad.ngc")
        << fmt::format("G21 G90 G17\nG0 X0 Y0 Z0\nF100\n{}\nM2\n", lines);
    EXPECT_FALSE(motions_of(folder_ / "bad.ngc")) << lines;
    const CanonProgram theirs = interpret(folder_ / "bad.ngc");
    EXPECT_TRUE(theirs.exit_code != 0 || !theirs.messages.empty() || !theirs.ended) << lines;
  }
}

TEST_F(Rs274, AgreesOnTheProgramsOfOthers) {
  const std::filesystem::path root = maquette::testing_support::data_folder();
  // Inches where the file says so.
  const std::vector<std::pair<const char*, double>> files{{"cameo.nc", 1e-4},
                                                          {"3D_Chips.ngc", 1e-4},
                                                          {"arcspiral.ngc", 25.4e-4},
                                                          {"zigzag_0.002_0.001.ngc", 25.4e-4}};
  int read = 0;
  for (const auto& [name, decimal] : files) {
    if (!std::filesystem::exists(root / "gcode" / name)) continue;
    expect_same(root / "gcode" / name, decimal, false);
    if (HasFailure()) {
      ADD_FAILURE() << name;
      return;
    }
    ++read;
  }
  if (read == 0) GTEST_SKIP() << "no programs in " << root / "gcode";
}

}  // namespace
}  // namespace maquette::cnc
