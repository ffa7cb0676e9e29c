// SPDX-License-Identifier: GPL-3.0-or-later

// A certificate is worth what it says of a program that is wrong. Programs of ours are spoilt in
// their files, as a slip of hand or a worn probe would do it, and `maquette verify` has to find
// out:
//
//   the program as it is ............... accepted (nothing below would mean anything otherwise)
//   one pass 30 um too deep ............ exit code 1; depth, place, and a line of that pass
//   the whole program 30 um too deep ... the same, all over the part
//   30 um sideways ..................... found as what it cuts
//   5 um at 100 places ................. all hundred listed, with place, depth and line, none else
//   the second of two programs ......... named
//   the cutter's side in a wall ........ by a rapid, a lead and a link, 50 um deep: each with line
//   and
//                                        place; 50 um beside it nothing
//   the shank in a wall ................ the same of a shank that is wider than its ball

#include <functional>
#include <map>
#include <regex>
#include <set>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "cnc/cutter_location.hpp"
#include "core/files.hpp"
#include "core/random.hpp"
#include "heightmap/field_io.hpp"
#include "support/matchers.hpp"
#include "support/program.hpp"
#include "support/terrain.hpp"

namespace maquette {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using testing::HasSubstr;
using testing_support::Ground;
using testing_support::Outcome;
using testing_support::run_program;
using testing_support::ScratchFolder;
using testing_support::slurp;

struct Line {
  std::string text;
  bool link = false;      // has a Y word: from one pass to the next
  bool straight = false;  // G0 or G1 holds
};

std::vector<Line> lines_of(const std::string& program) {
  std::vector<Line> lines;
  const std::regex motion("G0*([0-3])(?![0-9.])");
  bool straight = true;
  for (std::size_t at = 0; at < program.size();) {
    const std::size_t end = program.find('\n', at);
    Line line{program.substr(at, end - at)};
    at = end + 1;
    if (line.text.find('(') == std::string::npos) {
      if (std::smatch word; std::regex_search(line.text, word, motion))
        straight = word[1] == "0" || word[1] == "1";
      line.link = line.text.find('Y') != std::string::npos;
    }
    line.straight = straight;
    lines.push_back(std::move(line));
  }
  return lines;
}

/// The word's number changed by `by_mm`, where the line has it.
std::string moved(const std::string& line, char letter, double by_mm) {
  if (line.find('(') != std::string::npos) return line;
  const std::size_t at = line.find(letter);
  if (at == std::string::npos) return line;
  std::size_t end = at + 1;
  while (end < line.size() && (std::isdigit(line[end]) || line[end] == '.' || line[end] == '-'))
    ++end;
  const double value = std::stod(line.substr(at + 1, end - at - 1));
  return line.substr(0, at + 1) + fmt::format("{:.4f}", value + by_mm) + line.substr(end);
}

std::string joined(const std::vector<Line>& lines) {
  std::string text;
  for (const Line& line : lines) text += line.text + "\n";
  return text;
}

class Contradiction : public testing::Test {
 protected:
  static constexpr std::ptrdiff_t kNodes = 161;  // 80 x 80 mm
  ScratchFolder scratch;
  fs::path design = scratch / "design.tif", program = scratch / "part.ngc";
  heightmap::ModelField surface = testing_support::ground(Ground::rolling, 3, kNodes, 0.5);

  void SetUp() override {
    ASSERT_TRUE(heightmap::write_model_field(surface, design));
    mill("0.01");
  }
  void mill(const std::string& tolerance) {
    const Outcome o =
        run_program(scratch.path(), fmt::format("--quiet mill {} --tolerance-mm {} --out {}",
                                                design.string(), tolerance, program.string()));
    ASSERT_EQ(o.exit_code, 0) << o.err;
  }
  fs::path write(const std::string& name, const std::string& text) {
    EXPECT_TRUE(write_file(scratch / name, text));
    return scratch / name;
  }
  struct Verdict {
    int exit_code = 0;
    std::string said;
    json certificate;
  };
  Verdict verify(const std::string& programs, const std::string& limit = "0.02") {
    const fs::path out = scratch / "verify";
    const Outcome o = run_program(
        scratch.path(), fmt::format("--quiet verify {} --design {} --out {} --max-gouge-mm {}",
                                    programs, design.string(), out.string(), limit));
    return {o.exit_code, o.err, json::parse(slurp(out / "certificate.json"))};
  }
};

TEST_F(Contradiction, TheProgramAsItIsPasses) {
  const Verdict v = verify(program.string());
  EXPECT_EQ(v.exit_code, 0) << v.said;
  EXPECT_LE(v.certificate["max_gouge_mm"], 0.005);
  EXPECT_TRUE(v.certificate["path"]["gouges"].empty());
}

TEST_F(Contradiction, OnePass30MicrometresTooDeepIsFound) {
  std::vector<Line> lines = lines_of(slurp(program));
  // Pass 80 of 161: from after its link on to the next link; at both ends a straight move, so that
  // no arc is torn.
  std::size_t first = 0;
  int passes = 0;
  for (std::size_t i = 1; i < lines.size(); ++i) {
    if (lines[i].link || !lines[i - 1].link) continue;
    if (++passes == 80) first = i;
  }
  ASSERT_GT(first, 0U);
  std::size_t last = first;
  while (!lines[last + 1].link) ++last;
  while (!lines[first].straight) ++first;
  while (!lines[last + 1].straight) --last;
  ASSERT_GT(last, first + 10);
  for (std::size_t i = first; i <= last; ++i) {
    ASSERT_NE(lines[i].text.find('Z'), std::string::npos) << lines[i].text;
    lines[i].text = moved(lines[i].text, 'Z', -0.03);
  }
  const Verdict v = verify(write("deep.ngc", joined(lines)).string());
  EXPECT_EQ(v.exit_code, 1);
  const double found = v.certificate["max_gouge_mm"];
  // 30 um below a path that may itself be up to 5 um low, and was somewhere within 1 um of it.
  EXPECT_GE(found, 0.030);
  EXPECT_LE(found, 0.035 + 1e-6);
  EXPECT_LE(found + v.certificate["bound_mm"].get<double>(), 0.0355);
  const json& gouges = v.certificate["path"]["gouges"];
  ASSERT_FALSE(gouges.empty());
  double y = NAN;
  for (std::size_t i = first; !(y == y); --i) {
    const std::size_t at = lines[i].text.find('Y');
    if (at != std::string::npos && lines[i].text.find('(') == std::string::npos)
      y = std::stod(lines[i].text.substr(at + 1));
  }
  for (const json& gouge : gouges) {
    // Lines count from 1; the next line leaves the low pass and is cut low as well.
    EXPECT_GE(gouge["line"], first + 1) << gouge;
    EXPECT_LE(gouge["line"], last + 2) << gouge;
    EXPECT_NEAR(gouge["y_mm"], y, 3.0) << "where the ball touches, not beyond its radius";
  }
  EXPECT_THAT(v.said, HasSubstr("above the limit"));
  EXPECT_THAT(v.said, HasSubstr(fmt::format("deep.ngc:{}", gouges[0]["line"].get<int>())));
}

TEST_F(Contradiction, AProgram30MicrometresTooDeepIsFound) {
  std::vector<Line> lines = lines_of(slurp(program));
  for (Line& line : lines) line.text = moved(line.text, 'Z', -0.03);
  const Verdict v = verify(write("deep.ngc", joined(lines)).string());
  EXPECT_EQ(v.exit_code, 1);
  EXPECT_GE(v.certificate["max_gouge_mm"], 0.030);
  EXPECT_LE(v.certificate["max_gouge_mm"], 0.035 + 1e-6);
  // Everywhere: of 16 squares of the part each has its gouges.
  std::set<std::pair<int, int>> squares;
  for (const json& gouge : v.certificate["worst_gouges"])
    EXPECT_GT(gouge["depth_mm"].get<double>(), 0.029) << "at cells, 0.1 mm apart";
  for (const json& gouge : v.certificate["path"]["gouges"])
    squares.emplace(static_cast<int>((gouge["x_mm"].get<double>() + 3.0) / 20.01),
                    static_cast<int>((gouge["y_mm"].get<double>() - 1.25) / 20.01));
  EXPECT_EQ(squares.size(), 16U);
  // The rest are ridges higher than that, and hollows the ball does not reach.
  EXPECT_GT(v.certificate["gouged_area_mm2"], 0.4 * 80.0 * 80.0);
}

TEST_F(Contradiction, AProgram30MicrometresAsideIsFound) {
  for (const char axis : {'X', 'Y'}) {
    std::vector<Line> lines = lines_of(slurp(program));
    for (Line& line : lines) line.text = moved(line.text, axis, 0.03);
    const Verdict v = verify(write("aside.ngc", joined(lines)).string(), "0.01");
    EXPECT_EQ(v.exit_code, 1) << axis;
    EXPECT_GT(v.certificate["max_gouge_mm"], 0.01) << axis;
  }
}

TEST_F(Contradiction, HundredGougesOf5MicrometresAreAllFound) {
  mill("0.002");
  ASSERT_EQ(verify(program.string(), "0.0045").exit_code, 0);
  const std::vector<Line> lines = lines_of(slurp(program));
  std::vector<std::size_t> retracts;  // a plunge goes where the cutter is up anyway
  for (std::size_t i = 0; i < lines.size(); ++i)
    if (lines[i].text.find("G0Z") == 0) retracts.push_back(i);
  ASSERT_FALSE(retracts.empty());
  const double up = std::stod(lines[retracts.back()].text.substr(3));

  cnc::DropCutter cutter(surface, cnc::BallNose{3.0});
  struct Planted {
    double x = 0.0, y = 0.0;
    std::size_t line = 0;
  };
  std::vector<Planted> planted;
  std::string text;
  for (std::size_t i = 0; i <= retracts.back(); ++i) text += lines[i].text + "\n";
  std::size_t count = retracts.back() + 1;
  for (int i = 0; i < 10; ++i)
    for (int j = 0; j < 10; ++j) {
      const auto k = static_cast<std::uint64_t>(10 * i + j);
      const double x = std::round(1e3 * (1.0 + 7.8 * i + random_uniform(5, 2 * k))) * 1e-3,
                   y = std::round(1e3 * (5.25 + 7.8 * j + random_uniform(5, 2 * k + 1))) * 1e-3;
      const auto contact = cutter.drop(x, y);
      text += fmt::format("X{:.3f}Y{:.3f}\nG1Z{:.6f}\nG0Z{}\n", x, y, contact.tip_mm - 0.005, up);
      planted.push_back({x + contact.dx_mm, y + contact.dy_mm, count + 2});
      count += 3;
    }
  for (std::size_t i = retracts.back() + 1; i < lines.size(); ++i) text += lines[i].text + "\n";

  const Verdict v = verify(write("holes.ngc", text).string(), "0.0045");
  EXPECT_EQ(v.exit_code, 1);
  EXPECT_NEAR(v.certificate["max_gouge_mm"], 0.005, 1e-6);
  const json& gouges = v.certificate["path"]["gouges"];
  EXPECT_EQ(gouges.size(), 100U);
  std::map<std::size_t, json> by_line;
  for (const json& gouge : gouges) by_line[gouge["line"]] = gouge;
  for (const Planted& p : planted) {
    // The way up is as deep as the way down; the first of equals is kept.
    ASSERT_TRUE(by_line.contains(p.line)) << "x " << p.x << " y " << p.y << " line " << p.line;
    const json& gouge = by_line[p.line];
    EXPECT_NEAR(gouge["x_mm"], p.x, 1e-6);
    EXPECT_NEAR(gouge["y_mm"], p.y, 1e-6);
    EXPECT_NEAR(gouge["depth_mm"], 0.005, 1e-6);
  }
}

TEST_F(Contradiction, TheGuiltyOneOfTwoProgramsIsNamed) {
  std::vector<Line> lines = lines_of(slurp(program));
  for (Line& line : lines) line.text = moved(line.text, 'Z', -0.03);
  const fs::path deep = write("deep.ngc", joined(lines));
  const Verdict v = verify(program.string() + " " + deep.string());
  EXPECT_EQ(v.exit_code, 1);
  for (const json& gouge : v.certificate["path"]["gouges"]) EXPECT_EQ(gouge["program"], 1);
  EXPECT_THAT(v.said, HasSubstr("deep.ngc:"));
}

/// A step of 12 mm, 0.5 mm from foot to edge, in a finished part; down beside it there is room.
class SideCuts : public Contradiction {
 protected:
  static constexpr double kFoot_mm = 40.0, kRise_mm = 12.0, kRun_mm = 0.5, kTip_mm = 2.0;
  std::size_t planted_line = 0;

  void SetUp() override {
    for (std::ptrdiff_t r = 0; r < kNodes; ++r)
      for (std::ptrdiff_t c = 0; c < kNodes; ++c)
        surface.z_mm(r, c) = surface.x_mm(c) > kFoot_mm ? static_cast<float>(kRise_mm) : 0.0F;
    Contradiction::SetUp();
  }
  /// Where the axis of a ball of 6 mm stands when it touches the wall over its foot.
  [[nodiscard]] static double touching_mm() {
    const double lean = kRun_mm / kRise_mm;
    return kFoot_mm + lean * (kTip_mm + 3.0) - 3.0 * std::hypot(1.0, lean);
  }
  /// The program, and before its end these lines, which begin at the safe height.
  fs::path with(const std::string& name, const std::string& lines) {
    std::vector<Line> all = lines_of(slurp(program));
    std::size_t last = 0;
    for (std::size_t i = 0; i < all.size(); ++i)
      if (all[i].text.find("G0Z") == 0) last = i;
    std::string text;
    for (std::size_t i = 0; i <= last; ++i) text += all[i].text + "\n";
    planted_line = last + 2;
    text += lines;
    for (std::size_t i = last + 1; i < all.size(); ++i) text += all[i].text + "\n";
    return write(name, text);
  }
  [[nodiscard]] std::set<std::size_t> lines_of_gouges(const Verdict& v) const {
    std::set<std::size_t> lines;
    for (const json& gouge : v.certificate["path"]["gouges"])
      lines.insert(gouge["line"].get<std::size_t>());
    return lines;
  }
};

TEST_F(SideCuts, ByARapidALeadOrALinkAreFound) {
  ASSERT_EQ(verify(program.string()).exit_code, 0);
  struct Slip {
    const char* name;
    /// Lines, the guilty one the `at`-th, by where the axis stands near the wall.
    std::function<std::string(double x)> lines;
    std::size_t at;
    bool rapid;
    double y_from, y_to;  ///< where it touches
  };
  const double up = kRise_mm + 6.0;
  const Slip slips[] = {
      {"rapid past the wall",
       [&](double x) {
         return fmt::format("G0X{0:.4f}Y10\nZ{1}\nX{2:.4f}Y30\nX20\nZ{3}\n", x - 1.0, kTip_mm, x,
                            up);
       },
       3, true, 30.0, 30.0},
      {"lead in by a quarter circle",
       [&](double x) {  // ends along the wall, at its nearest
         return fmt::format("G0X{0:.4f}Y50\nZ{1}\nG17G3X{2:.4f}Y52I0J2F1000\nG1X{0:.4f}\nG0Z{3}\n",
                            x - 2.0, kTip_mm, x, up);
       },
       3, false, 52.0, 52.0},
      {"link that swings out",
       [&](double x) {
         return fmt::format("G0X30Y60\nZ{0}\nG1X{1:.4f}Y62F1000\nX30Y64\nG0Z{2}\n", kTip_mm, x, up);
       },
       3, false, 62.0, 62.0},
  };
  for (const Slip& slip : slips)
    for (const double deep : {0.05, -0.05}) {
      const Verdict v = verify(with("slip.ngc", slip.lines(touching_mm() + deep)).string());
      SCOPED_TRACE(fmt::format("{}, {} mm into the wall: {}", slip.name, deep, v.said));
      if (deep < 0.0) {
        EXPECT_EQ(v.exit_code, 0);
        EXPECT_EQ(v.certificate["rapid_collisions"], 0);
        continue;
      }
      EXPECT_EQ(v.exit_code, 1);
      const std::size_t guilty = planted_line + slip.at - 1;
      if (slip.rapid) {
        EXPECT_GE(v.certificate["rapid_collisions"], 1);
        EXPECT_EQ(v.certificate["first_rapid_collisions"][0]["line"], guilty);
        EXPECT_THAT(v.said, HasSubstr("rapid moves touch material, first at x"));
      }
      // Far below where the ball may go beside the wall, though it enters by 50 um only.
      EXPECT_GT(v.certificate["max_gouge_mm"].get<double>(), 0.1);
      // The next move begins in the wall too.
      const auto lines = lines_of_gouges(v);
      EXPECT_FALSE(lines.empty());
      for (const std::size_t line : lines)
        EXPECT_TRUE(line == guilty || line == guilty + 1) << line << " not " << guilty;
      for (const json& gouge : v.certificate["path"]["gouges"]) {
        EXPECT_NEAR(gouge["x_mm"].get<double>(), kFoot_mm + 0.25, 0.3);
        EXPECT_GE(gouge["y_mm"].get<double>(), slip.y_from - 1.5);
        EXPECT_LE(gouge["y_mm"].get<double>(), slip.y_to + 1.5);
      }
    }
}

TEST_F(SideCuts, ByTheShankAreFound) {
  // The part is finished by tool 1; then tool 2, 8 mm of flutes under a shank of 8 mm, goes along
  // the wall: the shank meets it before the ball would.
  const fs::path tools = write("tools.toml",
                               "[[tool]]\nnumber = 1\nshape = \"ball\"\ndiameter_mm = 6.0\n"
                               "[[tool]]\nnumber = 2\nshape = \"ball\"\ndiameter_mm = 6.0\n"
                               "flute_length_mm = 8.0\nshank_diameter_mm = 8.0\n"
                               "stick_out_mm = 60.0\n");
  const auto judged = [&](const fs::path& one) {
    return verify(fmt::format("{} --tools {}", one.string(), tools.string()));
  };
  const double edge = kFoot_mm + kRun_mm;
  for (const double deep : {0.1, -0.1}) {
    // The tip 1 mm over the floor, the shank from 9 mm on: 3 mm of the wall beside it. Ridges and
    // the fillet at the foot are lower than that.
    const double high = 9.0, x = kFoot_mm + kRun_mm * high / kRise_mm - 4.0 + deep;
    ASSERT_LT(x, edge - 3.5) << "the ball itself is clear";
    const Verdict v = judged(
        with("shank.ngc", fmt::format("T2M6\nG0X30Y20\nZ1\nG1X{:.4f}F1000\nY30\nX30\nG0Z20\n", x)));
    SCOPED_TRACE(fmt::format("{} mm into the wall: {}", deep, v.said));
    EXPECT_TRUE(v.certificate["path"]["gouges"].empty());
    if (deep < 0.0) {
      EXPECT_EQ(v.exit_code, 0);
      EXPECT_EQ(v.certificate["holder_collisions"], 0);
    } else {
      EXPECT_EQ(v.exit_code, 1);
      EXPECT_EQ(v.certificate["holder_collisions"], 3) << "in, along, out";
      EXPECT_EQ(v.certificate["first_holder_collisions"][0]["line"], planted_line + 3);
      EXPECT_THAT(v.said, HasSubstr("holder or shank meets material in 3 moves"));
    }
  }
}

}  // namespace
}  // namespace maquette
