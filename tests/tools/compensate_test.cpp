// SPDX-License-Identifier: GPL-3.0-or-later

// Programs rewritten for machines with known errors.
//
//   a scale, by hand ................. coordinates to the tenth of a micrometre; words stay
//   arcs and bent guides ............. the rewritten path, displaced again, is the one meant
//   slack ............................ taken up where an axis turns, nowhere else
//   each error of a machine .......... cut in simulation with it: little of it is left
//   a file ........................... what is written is read; what is wrong is said with its line
//   programs that are not flat ....... refused with file and line

#include <cmath>
#include <fstream>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "cnc/cutter_location.hpp"
#include "cnc/gcode_reader.hpp"
#include "cnc/verify.hpp"
#include "core/files.hpp"
#include "diagnosis/compensation.hpp"
#include "diagnosis/detail/forms.hpp"
#include "heightmap/field_io.hpp"
#include "support/matchers.hpp"
#include "support/scan_terrain.hpp"
#include "tools/compensate.hpp"
#include "tools/schema.hpp"

namespace maquette::tools {
namespace {

using testing::HasSubstr;
using testing_support::FailsWith;
using testing_support::ScratchFolder;
using testing_support::Succeeds;

class Compensate : public testing::Test {
 protected:
  ScratchFolder folder;
  std::filesystem::path text(const char* name, const std::string& content) const {
    std::ofstream(folder / name) << content;
    return folder / name;
  }
  std::string rewritten(const std::string& program, const cnc::MachineErrors& errors) {
    const auto done = cnc::compensate(text("in.ngc", program), errors, {}, folder / "out.ngc");
    EXPECT_THAT(done, Succeeds());
    return read_file(folder / "out.ngc").value_or("");
  }
};

TEST_F(Compensate, CallsToWhereTheMachineGoesRight) {
  cnc::MachineErrors e;
  e.exact_at_mm = {100.0, 0.0, 0.0};
  e.scale_um_per_m = {1000.0, 0.0, 0.0};
  EXPECT_EQ(rewritten("(part)\nG21 G90\nT3 M6\nG0 X0 Y0 Z5\nG1 X200 F900 (far)\nN7 S5000 X100 "
                      "Y20\nM30\n",
                      e),
            "(part)\nG21 G90\nT3 M6\nG0 X0 Y0 Z5\nG1 X199.9001 Y0.0000 Z5.0000 F900 (far)\nN7 "
            "S5000 G1 X100.0000 Y20.0000 Z5.0000\nM30\n");
}

TEST_F(Compensate, IsWhatWasMeantOnceDisplacedAgain) {
  cnc::MachineErrors e;
  e.exact_at_mm = {10.0, 10.0, 0.0};
  e.scale_um_per_m = {800.0, -500.0, 300.0};
  e.squareness_xy_urad = 400.0;
  e.squareness_xz_urad = -300.0;
  e.squareness_yz_urad = 700.0;
  e.length_offset_mm = 0.05;
  e.straightness.push_back({0, 2, {0.0, 10.0, 20.0, 40.0}, {0.0, 0.06, -0.02, 0.03}});
  rewritten(
      "G21 G90 G17\nG0 X0 Y0 Z2\nG1 Z1.9 F800\nG1 X40 Y1 Z1\nG2 X20 Y21 I-20 J0\nG18 G3 X0 Z1 I-10 "
      "K5\nM30\n",
      e);
  struct Piece {
    Vec3 a, b;
  };
  const auto pieces = [&](const char* file, const auto& moved) {
    std::vector<Piece> all;
    EXPECT_THAT(cnc::read_gcode(folder / file,
                                [&](std::span<const cnc::Motion> motions) -> Result<void> {
                                  for (const cnc::Motion& m : motions)
                                    if (m.line > 3)  // nothing rewrites where the first starts
                                      cnc::for_each_chord(m, 1e-4, [&](Vec3 a, Vec3 b) {
                                        all.push_back({moved(a), moved(b)});
                                      });
                                  return {};
                                }),
                Succeeds());
    return all;
  };
  const auto meant = pieces("in.ngc", [](Vec3 p) { return p; });
  const auto made = pieces("out.ngc", [&](Vec3 p) { return p + e.at(p); });
  double farthest = 0.0;
  for (std::size_t i = 0; i < meant.size(); i += 5)
    for (const double share : {0.1, 0.3, 0.6, 0.9}) {
      const Vec3 p = meant[i].a + share * (meant[i].b - meant[i].a);
      double nearest = INFINITY;
      for (const Piece& q : made) {
        const Vec3 d = q.b - q.a;
        const double t = std::clamp(dot(p - q.a, d) / std::fmax(1e-12, dot(d, d)), 0.0, 1.0);
        nearest = std::fmin(nearest, norm(p - q.a - t * d));
      }
      farthest = std::fmax(farthest, nearest);
    }
  // The mapping and the chords of arcs 1 um each, the digits.
  EXPECT_LT(farthest, 0.0022);
}

TEST_F(Compensate, TakesSlackUpWhereAnAxisTurns) {
  cnc::MachineErrors e;
  e.backlash_mm = {0.2, 0.0, 0.0};
  EXPECT_EQ(rewritten("G0 X0 Y0 Z0\nG1 X10 F100\nX20\nY1\nX5\nM2\n", e),
            "G0 X0 Y0 Z0\nG1 X10.1000 Y0.0000 Z0.0000 F100\nG1 X20.1000 Y0.0000 Z0.0000\nG1 "
            "X20.1000 Y1.0000 Z0.0000\nG1 X19.9000 Y1.0000 Z0.0000\nG1 X4.9000 Y1.0000 "
            "Z0.0000\nM2\n");
}

TEST_F(Compensate, RefusesWhatIsNotFlat) {
  const cnc::MachineErrors none;
  for (const char* body : {"G91\nG1 X1\n", "G20\nG1 X1\n", "G92 X0\nG1 X1\n", "#1=3\nG1 X#1\n",
                           "o1 repeat [2]\nG1 X2\nG1 X1\no1 endrepeat\n", "G1 X1 M30\n"}) {
    const auto r =
        cnc::compensate(text("in.ngc", std::string("G0 X0 Y0 Z0\nF100\n") + body + "M30\n"), none,
                        {}, folder / "out.ngc");
    EXPECT_THAT(r, FailsWith(cnc::kNotFlat)) << body;
    EXPECT_THAT(r ? "" : r.error().message, HasSubstr("in.ngc:"));
    EXPECT_FALSE(std::filesystem::exists(folder / "out.ngc"));
  }
}

/// A part of 60 mm and a raster over it; diagnoses made by hand.
class MadeGood : public Compensate {
 protected:
  diagnosis::CaseInput input;
  void SetUp() override {
    const auto design = testing_support::rough_part(5, 121, 121, 0.5, 3.0, 1.5);
    input.design = folder / "design.tif";
    ASSERT_THAT(heightmap::write_model_field(design, input.design), Succeeds());
    const cnc::DropCutter cutter(design, cnc::Cutter::ball(3.0));
    std::string program = "G21 G90\nG0 X0 Y0 Z30\n";
    for (int i = 0; i <= 120; ++i)
      for (int k = 0; k <= 120; ++k) {
        const double x = 0.5 * (i % 2 == 0 ? k : 120 - k), y = 0.5 * i;
        program += fmt::format("G1 X{} Y{} Z{:.4f} F3000\n", x, y, cutter.drop(x, y).tip_mm);
      }
    input.programs = {text("part.ngc", program + "M30\n")};
  }
};

TEST_F(MadeGood, EachErrorOfAMachineAndATool) {
  using diagnosis::Cause;
  struct Row {
    const char *effect, *law;
    std::vector<diagnosis::Estimate> parameters;
    double most_left;  // of what it was
  };
  for (const Row& row : {
           Row{"machine.scale_x", "proportional", {{"error_um_per_m", 1500.0, 1.0}}, 0.05},
           Row{"machine.scale_z", "proportional", {{"error_um_per_m", -4000.0, 1.0}}, 0.05},
           Row{"machine.squareness_xy", "shear", {{"angle_urad", 1500.0, 1.0}}, 0.05},
           Row{"machine.squareness_yz", "shear", {{"angle_urad", -8000.0, 1.0}}, 0.15},
           Row{"machine.straightness_x",
               "vertical curve of degree 3",
               {{"vertical_p2_mm", 0.06, 0.01}, {"vertical_p3_mm", -0.04, 0.01}},
               0.05},
           Row{"machine.straightness_y",
               "sideways curve of degree 2",
               {{"sideways_p2_mm", 0.08, 0.01}},
               0.05},
           Row{"machine.backlash_x", "play of about 0.1 mm", {{"width_mm", 0.1, 0.01}}, 0.15},
           // Passes called to different heights make the surface in turn, which simulation has to
           // first order only.
           Row{"machine.backlash_z", "play of about 0.05 mm", {{"width_mm", 0.05, 0.01}}, 0.4},
           // Its ridges between passes are lower than those that were meant.
           Row{"tool.radius_error", "about 0.15 mm, tip held", {{"error_mm", 0.15, 0.01}}, 0.5},
       }) {
    diagnosis::Diagnosis d;
    d.causes.push_back({row.effect, row.law, row.parameters, {}, 1.0, 1e-9, {}, ""});
    const auto design = heightmap::read_model_field(input.design);
    ASSERT_TRUE(design);
    const diagnosis::Scene scene = [&] {
      diagnosis::Scene s;
      s.box.add({0, 0, static_cast<double>(heightmap::height_range(design->z_mm).min)});
      s.box.add({60, 60, static_cast<double>(heightmap::height_range(design->z_mm).max)});
      return s;
    }();
    const auto by = text("by.toml", diagnosis::compensation_toml(d, scene));
    const auto errors = read_compensation(by);
    ASSERT_THAT(errors, Succeeds());
    CompensateJob job;
    job.programs = input.programs;
    job.by = by;
    job.design = input.design;
    ASSERT_THAT(compensate_job(job, folder / "good", {}), Succeeds());
    diagnosis::CaseInput extended = input;
    extended.known = {{row.effect, row.law, {}, {}}};
    for (const auto& p : row.parameters) extended.known[0].parameters.emplace_back(p.name, p.value);
    const auto gain = diagnosis::improvement(extended, {folder / "good/part.ngc"});
    ASSERT_THAT(gain, Succeeds());
    EXPECT_GT(gain->rms_before_mm, 0.0015) << row.effect;
    EXPECT_LT(gain->rms_after_mm, row.most_left * gain->rms_before_mm) << row.effect;
    EXPECT_GT(gain->nodes, 10'000U);
  }
}

TEST_F(MadeGood, OnlyWhatIsSureAndComesBack) {
  diagnosis::Diagnosis d;
  diagnosis::Scene scene;
  scene.box.add({0, 0, 0});
  scene.box.add({60, 60, 10});
  d.causes.push_back({"machine.scale_x",
                      "proportional",
                      {{"error_um_per_m", 100.0, 1.0}},
                      {},
                      0.5,
                      1e-9,
                      {"stock.swelling"},
                      "calliper"});
  d.causes.push_back(
      {"machine.thermal_growth_z", "x", {{"growth_mm", 0.1, 0.01}}, {}, 0.5, 1e-9, {}, ""});
  EXPECT_EQ(diagnosis::compensation_toml(d, scene), "");
  d.causes.push_back({"machine.backlash_z", "x", {{"width_mm", 0.1, 0.01}}, {}, 0.5, 1e-9, {}, ""});
  d.causes.push_back({"machine.backlash_y",
                      "x",
                      {{"width_mm", 0.05, 0.01}},
                      {{diagnosis::detail::kOvercompensatedWidth, 0.05}},
                      0.5,
                      1e-9,
                      {},
                      ""});
  const std::string toml = diagnosis::compensation_toml(d, scene);
  EXPECT_THAT(toml, HasSubstr("# left: machine.backlash_y: the control's own"));
  EXPECT_THAT(toml, HasSubstr("backlash_z_mm = 0.1"));
  EXPECT_THAT(toml, HasSubstr("# left: machine.scale_x: not told from stock.swelling"));
  EXPECT_THAT(toml, HasSubstr("# left: machine.thermal_growth_z"));
  const auto back = read_compensation(text("by.toml", toml));
  ASSERT_THAT(back, Succeeds());
  EXPECT_EQ(back->backlash_mm, (Vec3{0.0, 0.0, 0.1}));
  EXPECT_EQ(back->scale_um_per_m, Vec3{});
  EXPECT_THAT(read_compensation(text("bad.toml",
                                     "schema = \"maquette.compensation/1\"\n"
                                     "[[straightness]]\nalong = \"x\"\nmoves = "
                                     "\"z\"\nposition_mm = [1.0, 0.0]\nerror_mm = "
                                     "[0.0, 0.1]\n")),
              FailsWith(kConfigInvalid));
  // A program is never written over itself; another ball needs what it is to touch.
  CompensateJob job;
  job.programs = input.programs;
  job.by = text("by.toml", toml);
  EXPECT_THAT(compensate_job(job, folder.path(), {}), FailsWith(kConfigInvalid));
  job.by =
      text("ball.toml", "schema = \"maquette.compensation/1\"\n[tool]\nradius_error_mm = 0.05\n");
  EXPECT_THAT(compensate_job(job, folder / "good", {}), FailsWith(kConfigInvalid));
}

}  // namespace
}  // namespace maquette::tools
