// SPDX-License-Identifier: GPL-3.0-or-later

// Programs written for a machine, and for a part, that are not as planned (tools/adjustment.hpp,
// cnc/machine_run.hpp).
//
//   the machine's path ............ closed forms: play, scale, a bent guide, a part that stands
//                                   elsewhere; a program rewritten and run is the one that was
//                                   meant
//   compensation.toml ............. planted errors: the part is worse before than after, by the
//                                   machine's path and by diagnosis' own simulation of causes
//   corrections.toml, this ........ a part clamped aside and turned: cut against the design where
//   it
//                                   lies, made from the relief's formula, plain against corrected
//   corrections.toml, next ........ a zero that is off: what it adds brings the path back
//   axes .......................... a frame's x, y, z as the machine has them, in and out
//   what is written ............... the head and the certificate name the file and the largest
//   change what cannot be ................ G91, Heidenhain, probing, both files with axes: each its
//   error

#include <cmath>
#include <fstream>
#include <map>
#include <numbers>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "cnc/machine_run.hpp"
#include "cnc/verify.hpp"
#include "core/files.hpp"
#include "core/random.hpp"
#include "diagnosis/compensation.hpp"
#include "heightmap/field_io.hpp"
#include "support/matchers.hpp"
#include "tools/adjustment.hpp"
#include "tools/corrections_file.hpp"
#include "tools/jobs.hpp"
#include "tools/milling.hpp"
#include "tools/operations.hpp"
#include "tools/schema.hpp"

namespace maquette::tools {
namespace {

namespace fs = std::filesystem;
using heightmap::ModelField;
using testing::HasSubstr;
using testing_support::FailsWith;
using testing_support::ScratchFolder;
using testing_support::Succeeds;

scan::AxisFit axis(Vec3 direction, double scale) {
  scan::AxisFit fit;
  fit.direction = direction;
  fit.scale = scale;
  return fit;
}

constexpr double kSide_mm = 40.0;

/// Hills that a ball of 6 mm reaches everywhere: at their sharpest the radius is 3.4 mm.
double relief(double x, double y) {
  return 8.0 + 1.2 * std::sin(0.25 * x + 0.1 * y) + 0.9 * std::sin(0.31 * y - 0.12 * x + 1.0);
}

ModelField field_of(const std::function<double(double, double)>& height) {
  ModelField f{Grid<float>(161, 161), Millimetres{0.25}, Millimetres{0.0}, Millimetres{0.0}};
  for (std::ptrdiff_t r = 0; r < 161; ++r)
    for (std::ptrdiff_t c = 0; c < 161; ++c)
      f.z_mm(r, c) = static_cast<float>(height(f.x_mm(c), f.y_mm(r)));
  return f;
}

std::vector<cnc::Motion> motions_of(const fs::path& program) {
  std::vector<cnc::Motion> all;
  EXPECT_THAT(cnc::read_gcode(program,
                              [&](std::span<const cnc::Motion> some) -> Result<void> {
                                all.insert(all.end(), some.begin(), some.end());
                                return {};
                              }),
              Succeeds());
  return all;
}

cnc::Motion line(Vec3 from, Vec3 to) {
  cnc::Motion m;
  m.from_mm = from;
  m.to_mm = to;
  m.feed_mm_min = 100.0;
  return m;
}

TEST(MachineRun, PlayIsTakenUpBeforeAnAxisMoves) {
  cnc::MachineErrors e;
  e.backlash_mm = {0.2, 0.0, 0.0};
  cnc::MachineRun run(e, {}, 3.0);
  std::vector<cnc::Motion> made;
  run.add(line({0, 0, 0}, {10, 0, 0}), made);
  ASSERT_EQ(made.size(), 1U);
  EXPECT_NEAR(made[0].from_mm.x, -0.1, 1e-12);
  EXPECT_NEAR(made[0].to_mm.x, 9.9, 1e-12);
  // Back by 0.1: all of it is slack, the tip rests; by 0.1 more: the rest of the slack, then 0.
  made.clear();
  run.add(line({10, 0, 0}, {9.9, 0, 0}), made);
  EXPECT_TRUE(made.empty());
  run.add(line({9.9, 0, 0}, {5, 5, 0}), made);
  ASSERT_EQ(made.size(), 2U);  // y goes while x rests
  EXPECT_NEAR(made[0].to_mm.x, 9.9, 1e-12);
  EXPECT_NEAR(made[0].to_mm.y, 5.0 * 0.1 / 4.9, 1e-12);
  EXPECT_NEAR(made[1].to_mm.x, 5.1, 1e-12);
  EXPECT_NEAR(run.largest_mm(), 0.1, 1e-12);
}

TEST(MachineRun, GuidesScalesAndWhereThePartStands) {
  cnc::MachineErrors e;
  e.exact_at_mm = {10.0, 0.0, 0.0};
  e.scale_um_per_m = {1000.0, 0.0, 0.0};
  e.squareness_zx_urad = 500.0;
  e.length_offset_mm = 0.05;
  e.straightness.push_back({0, 1, {0.0, 10.0, 20.0}, {0.0, 0.04, 0.0}});
  e.machine_from_part = {{}, {1.0, 2.0, 3.0}};
  cnc::MachineRun run(e, {}, 3.0);
  std::vector<cnc::Motion> made;
  run.add(line({0, 0, 0}, {20, 0, 0}), made);
  ASSERT_EQ(made.size(), 2U) << "a bend at the table's stop";
  EXPECT_NEAR(made[0].from_mm.x, -0.01 - 1.0, 1e-12);
  EXPECT_NEAR(made[0].to_mm.x, 9.0, 1e-12);
  EXPECT_NEAR(made[0].to_mm.y, 0.04 - 2.0, 1e-12);
  EXPECT_NEAR(made[1].to_mm.z, 0.05 + 0.005 - 3.0, 1e-12);
  // A part turned by a quarter about z, and the middle of a ball over a tilted one.
  e = {};
  e.machine_from_part.rotation = rotation_about({0, 0, 1}, 0.5 * std::numbers::pi);
  cnc::MachineRun turned(e, {}, 3.0);
  made.clear();
  turned.add(line({0, 0, 0}, {0, 7, 0}), made);
  EXPECT_NEAR(made.at(0).to_mm.x, 7.0, 1e-12);
  EXPECT_NEAR(made.at(0).to_mm.y, 0.0, 1e-12);
  e.machine_from_part.rotation = rotation_about({1, 0, 0}, 0.01);
  cnc::MachineRun tilted(e, {}, 3.0);
  made.clear();
  tilted.add(line({0, 0, 0}, {0, 0, -1}), made);
  // The middle, 3 mm above the tip, is turned back about x: by -0.01.
  EXPECT_NEAR(made.at(0).from_mm.y, 3.0 * std::sin(0.01), 1e-12);
  EXPECT_NEAR(made.at(0).from_mm.z, 3.0 * std::cos(0.01) - 3.0, 1e-12);
}

class Adjusted : public testing::Test {
 protected:
  ScratchFolder folder;
  ModelField design = field_of(relief);
  MillJob job;

  void SetUp() override {
    job = default_job("raster");
    job.design = folder / "design.tif";
    ASSERT_THAT(heightmap::write_model_field(design, job.design), Succeeds());
    job.leave_stock = false;
    job.lead_radius = Millimetres{0.0};
  }
  fs::path text(const char* name, const std::string& content) const {
    std::ofstream(folder / name) << content;
    return folder / name;
  }
  /// Plain, and under <name> with what the files say.
  fs::path milled(const std::string& name, const AdjustmentFiles& files,
                  nlohmann::json* figures = nullptr) {
    MillJob one = job;
    auto adjust = read_adjustment(files);
    EXPECT_THAT(adjust, Succeeds());
    one.adjust = *adjust;
    const auto made = mill_job(one, folder / name, {});
    EXPECT_THAT(made, Succeeds());
    if (!made) return {};
    EXPECT_EQ(made->unmet, "");
    EXPECT_EQ(made->outputs.front(), folder / name);
    if (figures != nullptr) *figures = nlohmann::json::parse(made->figures_json);
    return made->outputs.front();
  }
  struct Off {
    double gouge_mm, rms_mm;
  };
  /// Against a surface, away from the outline, where passes end.
  static Off off(const fs::path& program, const ModelField& surface,
                 const std::optional<cnc::MachineErrors>& errors) {
    cnc::VerifyOptions options;
    options.cell = Millimetres{0.25};
    options.errors = errors;
    const auto v = cnc::verify(std::span(&program, 1), surface, options);
    EXPECT_THAT(v, Succeeds());
    Off o{0.0, 0.0};
    double n = 0.0;
    if (v)
      for (std::ptrdiff_t r = 20; r < 141; ++r)
        for (std::ptrdiff_t c = 20; c < 141; ++c) {
          const double d = static_cast<double>(v->as_milled.z_mm(r, c)) -
                           static_cast<double>(surface.z_mm(r, c));
          o.gouge_mm = std::max(o.gouge_mm, -d);
          o.rms_mm += d * d;
          n += 1.0;
        }
    o.rms_mm = std::sqrt(o.rms_mm / n);
    return o;
  }
  /// Farthest that the path of `program`, each end taken through `where`, is from the meant path.
  static double apart_mm(const fs::path& program, const fs::path& meant,
                         const std::function<Vec3(Vec3)>& where) {
    std::vector<std::pair<Vec3, Vec3>> pieces;
    for (const cnc::Motion& m : motions_of(meant))
      cnc::for_each_chord(m, 1e-4, [&](Vec3 a, Vec3 b) { pieces.emplace_back(a, b); });
    double farthest = 0.0;
    std::size_t near = 0;  // both go the same way
    for (const cnc::Motion& m : motions_of(program)) {
      const Vec3 p = where(m.to_mm);
      double least = INFINITY;
      std::size_t best = near;
      for (std::size_t i = near >= 100 ? near - 100 : 0; i < std::min(pieces.size(), near + 400);
           ++i) {
        const auto& [a, b] = pieces[i];
        const Vec3 d = b - a;
        const double t = std::clamp(dot(p - a, d) / std::fmax(1e-12, dot(d, d)), 0.0, 1.0);
        if (const double away = norm(p - a - t * d); away < least) {
          least = away;
          best = i;
        }
      }
      near = best;
      farthest = std::max(farthest, least);
    }
    return farthest;
  }
};

constexpr const char* kCompensation =
    "schema = \"maquette.compensation/1\"\nexact_at_mm = [5.0, 5.0, 8.0]\n[machine]\n"
    "scale_x_um_per_m = 1500.0\nscale_z_um_per_m = -4000.0\nsquareness_xy_urad = 900.0\n"
    "backlash_y_mm = 0.03\n[tool]\nlength_offset_mm = 0.04\n[[straightness]]\nalong = \"x\"\n"
    "moves = \"z\"\nposition_mm = [0.0, 13.0, 40.0]\nerror_mm = [0.02, -0.03, 0.03]\n";

TEST_F(Adjusted, CompensatedProgramsCutTheDesignOnTheMachineTheyAreFor) {
  AdjustmentFiles files;
  files.compensation = text("compensation.toml", kCompensation);
  const auto errors = read_adjustment(files);
  ASSERT_THAT(errors, Succeeds());
  nlohmann::json figures;
  const fs::path plain = milled("plain.ngc", {}), called = milled("called.ngc", files, &figures),
                 meant = folder / "called.meant.ngc";
  EXPECT_EQ(read_file(plain).value_or(""), read_file(meant).value_or("-")) << "meant is untouched";

  const Off before = off(plain, design, (*errors)->errors),
            after = off(called, design, (*errors)->errors), ideal = off(plain, design, {});
  // The length alone is 40 um, the rest about as much. What is left is the ridges between passes.
  EXPECT_GT(before.rms_mm, 0.03);
  EXPECT_LT(after.rms_mm, ideal.rms_mm + 0.001);
  EXPECT_GT(before.rms_mm, 4.0 * after.rms_mm);
  EXPECT_LT(after.gouge_mm, 0.007);
  EXPECT_LE(figures["adjusted"]["proven_gouge_mm"].get<double>(), 0.007);
  EXPECT_LE(figures["proven_gouge_mm"].get<double>(), 0.005);

  const std::string head = read_file(called).value_or("").substr(0, 1000);
  const double most = figures["adjusted"]["largest_change_mm"];
  EXPECT_THAT(head, HasSubstr("(compensated by compensation.toml sha256 " +
                              (*errors)->compensation->sha256.substr(0, 16)));
  EXPECT_THAT(head, HasSubstr(fmt::format("(called at most {:8.4f} mm beside", most)));
  EXPECT_GT(most, 0.06);
  EXPECT_LT(most, 0.2);

  // The certificate is of the part that the machine makes, and of what was meant.
  VerifyJob verify;
  verify.programs = {called};
  verify.design = job.design;
  verify.options.cell = Millimetres{0.25};
  verify.max_gouge = Millimetres{0.007};
  verify.adjust = *errors;
  const auto good = verify_job(verify, folder / "good", {});
  ASSERT_THAT(good, Succeeds());
  EXPECT_EQ(good->unmet, "");
  const auto certificate =
      nlohmann::json::parse(read_file(folder / "good/certificate.json").value());
  const auto& adjusted = certificate["adjusted"];
  EXPECT_EQ(adjusted["compensation"]["file"], "compensation.toml");
  EXPECT_EQ(adjusted["compensation"]["sha256"], (*errors)->compensation->sha256);
  EXPECT_NEAR(adjusted["largest_change_mm"].get<double>(), most, 0.02);  // play lags on both sides
  EXPECT_EQ(adjusted["meant"]["programs"][0], "called.meant.ngc");
  EXPECT_LE(
      adjusted["meant"]["max_gouge_mm"].get<double>() + adjusted["meant"]["bound_mm"].get<double>(),
      0.005);
  // Plain programs on that machine, and these on a right one, are found.
  verify.programs = {plain};
  const auto bad = verify_job(verify, folder / "bad", {});
  ASSERT_THAT(bad, Succeeds());
  EXPECT_THAT(bad->unmet, HasSubstr("gouge of up to"));
  verify.programs = {called};
  verify.adjust.reset();
  const auto wrong = verify_job(verify, folder / "wrong", {});
  ASSERT_THAT(wrong, Succeeds());
  EXPECT_THAT(wrong->unmet, HasSubstr("gouge of up to"));
}

// Not by the machine's path: by the causes of diagnosis, which know nothing of it.
TEST_F(Adjusted, DiagnosisCutsTheSameGain) {
  struct Row {
    const char *effect, *law, *toml;
    std::pair<std::string, double> parameter;
  };
  const Vec3 centre{0.5 * kSide_mm, 0.5 * kSide_mm, 0.0};
  for (const Row& row : {Row{"machine.scale_x",
                             "proportional",
                             "[machine]\nscale_x_um_per_m = 8000.0\n",
                             {"error_um_per_m", 8000.0}},
                         Row{"machine.squareness_xy",
                             "shear",
                             "[machine]\nsquareness_xy_urad = -8000.0\n",
                             {"angle_urad", -8000.0}}}) {
    AdjustmentFiles files;
    files.compensation =
        text("by.toml", fmt::format("schema = \"maquette.compensation/1\"\nexact_at_mm = [{}, {}, "
                                    "0.0]\n{}",
                                    centre.x, centre.y, row.toml));
    const fs::path called = milled("called.ngc", files);
    diagnosis::CaseInput extended;
    extended.design = job.design;
    extended.programs = {folder / "called.meant.ngc"};
    extended.known = {{row.effect, row.law, {row.parameter}, {}}};
    const auto gain = diagnosis::improvement(extended, {called});
    ASSERT_THAT(gain, Succeeds());
    // What is left, 0.8 um, is rewriting within 1 um and chords of arcs, whatever the error.
    EXPECT_GT(gain->rms_before_mm, 0.01) << row.effect;
    EXPECT_LT(gain->rms_after_mm, 0.1 * gain->rms_before_mm) << row.effect;
  }
}

TEST_F(Adjusted, APartThatLiesElsewhereIsCutWhereItLies) {
  Corrections c;
  const Quaternion q =
      rotation_about({0, 0, 1}, 0.008) * rotation_about(normalized(Vec3{1.0, -0.5, 0.0}), 0.004);
  c.actual_from_planned = {q, {0.35, -0.22, 0.18}};
  AdjustmentFiles files;
  files.corrections = text("corrections.toml", corrections_text(c));
  const fs::path plain = milled("plain.ngc", {}), called = milled("called.ngc", files);
  // The relief where it lies, from its formula: the height at (x, y) is that of the point of the
  // design that is brought there.
  const RigidTransform back = c.actual_from_planned.inverse();
  const ModelField lies = field_of([&](double x, double y) {
    double z = relief(x, y);
    for (int i = 0; i < 30; ++i) {
      const Vec3 p = back.point({x, y, z});
      z += relief(p.x, p.y) - p.z;
    }
    return z;
  });
  const Off before = off(plain, lies, {}), after = off(called, lies, {});
  EXPECT_GT(before.rms_mm, 0.15);
  EXPECT_GT(before.gouge_mm, 0.2);
  // Of the ridges as of the plain program on the design. Facets between nodes differ from the
  // relief by h^2 k / 8 = 2 um, and lie elsewhere now.
  EXPECT_LT(after.rms_mm, off(plain, design, {}).rms_mm + 0.002);
  EXPECT_LT(after.gouge_mm, 0.011);
  const auto adjust = read_adjustment(files);
  ASSERT_THAT(adjust, Succeeds());
  EXPECT_LT(off(called, design, (*adjust)->errors).gouge_mm, 0.007);
  EXPECT_GT(off(plain, design, (*adjust)->errors).gouge_mm, 0.2);
  EXPECT_THAT(read_file(called).value_or(""), HasSubstr("(part stands as in corrections.toml"));
}

TEST_F(Adjusted, ForTheNextPartTheMachinesOwnDisplacementBringsThePathBack) {
  Corrections c;
  c.actual_from_planned = {rotation_about({0, 0, 1}, -0.003), {-0.3, 0.12, 0.09}};
  AdjustmentFiles files;
  files.corrections = text("corrections.toml", corrections_text(c));
  files.corrections_for = "next";
  nlohmann::json figures;
  const fs::path called = milled("called.ngc", files, &figures),
                 meant = folder / "called.meant.ngc";
  const RigidTransform& machine = c.actual_from_planned;
  const auto displaced = [&](Vec3 p) { return machine.point(p); };
  // Rewriting 1 um, chords of arcs 1 um, four digits.
  EXPECT_LT(apart_mm(called, meant, displaced), 0.0022);
  EXPECT_GT(apart_mm(meant, meant, displaced), 0.3);
  EXPECT_EQ(figures["adjusted"]["corrections"]["for"], "next");
  EXPECT_THAT(read_file(called).value_or(""), HasSubstr("(next part, displaced as by"));
}

TEST_F(Adjusted, AxesThatWereMeasuredAreTheMachines) {
  Corrections c;
  const Vec3 x = normalized(Vec3{1.0, 0.0011, -0.0007}), y = normalized(Vec3{-0.0006, 1.0, 0.0009}),
             z = normalized(Vec3{0.0013, -0.0004, 1.0});
  const double sx = 1.0012, sy = 0.9991, sz = 1.002;
  c.axes = {{"x", axis(x, sx)},
            {"camera rail", axis({0, 1, 0}, 1.3)},
            {"y", axis(y, sy)},
            {"z", axis(z, sz)}};
  AdjustmentFiles files;
  files.corrections = text("corrections.toml", corrections_text(c));
  nlohmann::json figures;
  const fs::path called = milled("called.ngc", files, &figures),
                 meant = folder / "called.meant.ngc";
  const auto machine = [&](Vec3 p) { return sx * p.x * x + sy * p.y * y + sz * p.z * z; };
  EXPECT_LT(apart_mm(called, meant, machine), 0.0022);
  EXPECT_GT(apart_mm(meant, meant, machine), 0.03);
  EXPECT_EQ(figures["adjusted"]["corrections"]["axes_left"][0], "camera rail");
}

TEST_F(Adjusted, EachControlsProgramAndSeveralOperationsReadBackThrough) {
  AdjustmentFiles files;
  files.compensation = text("compensation.toml", kCompensation);
  const auto adjust = read_adjustment(files);
  ASSERT_THAT(adjust, Succeeds());
  for (const char* post : {"linuxcnc", "grbl", "fanuc", "haas"}) {
    job.program.post = post;
    job.program.line_numbers = true;
    const fs::path called = milled("called.ngc", files);
    EXPECT_LT(off(called, design, (*adjust)->errors).gouge_mm, 0.007) << post;
  }
  job.program.post = "linuxcnc";
  MillJob rough = default_job("rough");
  rough.design = job.design;
  rough.adjust = job.adjust = *adjust;
  rough.adjust->errors.tool = job.adjust->errors.tool = job.tool.number;
  const MillJob jobs[] = {rough, job};
  const auto whole = mill_operations_job(jobs, folder / "whole.ngc", {});
  ASSERT_THAT(whole, Succeeds());
  EXPECT_EQ(whole->unmet, "");
  EXPECT_TRUE(fs::exists(folder / "whole.meant.ngc"));
  cnc::VerifyOptions options;
  options.tools = tools_of(jobs);
  options.cell = Millimetres{0.25};
  options.errors = job.adjust->errors;
  const fs::path program = folder / "whole.ngc";
  const auto v = cnc::verify(std::span(&program, 1), design, options);
  ASSERT_THAT(v, Succeeds());
  EXPECT_LE(v->certificate.max_gouge_mm + v->certificate.bound_mm, 0.0075);
  EXPECT_EQ(v->certificate.rapid_collisions, 0U);
}

TEST_F(Adjusted, ABallOfAnotherRadius) {
  AdjustmentFiles files;
  files.compensation = text(
      "compensation.toml", "schema = \"maquette.compensation/1\"\n[tool]\nradius_error_mm = 0.1\n");
  const auto adjust = read_adjustment(files);
  ASSERT_THAT(adjust, Succeeds());
  const fs::path plain = milled("plain.ngc", {}), called = milled("called.ngc", files);
  const Off before = off(plain, design, (*adjust)->errors),
            after = off(called, design, (*adjust)->errors);
  EXPECT_GT(before.gouge_mm, 0.004);
  EXPECT_LT(after.gouge_mm, 0.007);
  EXPECT_GT(before.gouge_mm, after.gouge_mm);
}

TEST_F(Adjusted, SaysWhatCannotBe) {
  AdjustmentFiles files;
  files.compensation = text("compensation.toml", kCompensation);
  const auto adjust = read_adjustment(files);
  ASSERT_THAT(adjust, Succeeds());
  const auto refused = [&](MillJob one, const char* says) {
    one.adjust = *adjust;
    const auto made = mill_job(one, folder / "never.ngc", {});
    ASSERT_THAT(made, FailsWith(kConfigInvalid));
    EXPECT_THAT(made.error().message, HasSubstr(says));
    EXPECT_FALSE(fs::exists(folder / "never.ngc"));
  };
  MillJob one = job;
  one.program.relative = true;
  refused(one, "G90");
  one = job;
  one.program.post = "heidenhain";
  refused(one, "heidenhain");
  one = default_job("probe");
  one.design = job.design;
  refused(one, "touches");
  Corrections c;
  c.axes = {{"x", axis({1, 0, 0}, 1.001)}};
  files.corrections = text("corrections.toml", corrections_text(c));
  EXPECT_THAT(read_adjustment(files), FailsWith(kConfigInvalid));
  files.compensation.clear();
  EXPECT_THAT(read_adjustment(files), Succeeds());
  c.axes = {{"z", axis({1, 0, 0}, 1.0)}};
  files.corrections = text("corrections.toml", corrections_text(c));
  EXPECT_THAT(read_adjustment(files), FailsWith(kConfigInvalid));
  c.axes.clear();
  c.actual_from_planned.rotation = rotation_about({1, 0, 0}, 0.1);
  files.corrections = text("corrections.toml", corrections_text(c));
  EXPECT_THAT(read_adjustment(files), FailsWith(kConfigInvalid));
  EXPECT_THAT(read_adjustment({folder / "nowhere.toml", {}, "this"}), FailsWith(kFileNotFound));
}

}  // namespace
}  // namespace maquette::tools
