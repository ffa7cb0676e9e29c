// SPDX-License-Identifier: GPL-3.0-or-later

// A model that was extended acts on cut and scan as the causes it names: what is simulated with it
// and diagnosed gives the causes back, and with them in the model nothing is left to find.

#include <cmath>
#include <fstream>
#include <sstream>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "heightmap/field_io.hpp"
#include "scan/cloud.hpp"
#include "support/matchers.hpp"
#include "support/program.hpp"
#include "support/scan_terrain.hpp"
#include "tools/extended.hpp"
#include "tools/scene_file.hpp"

namespace maquette::tools {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using testing::HasSubstr;
using testing_support::Outcome;
using testing_support::run_program;
using testing_support::ScratchFolder;
using testing_support::slurp;
using testing_support::Succeeds;

constexpr double kScale_um_per_m = 4000.0, kBias_mm = 0.25;

class ExtendedModels : public testing::Test {
 protected:
  ScratchFolder scratch;
  Outcome run(const std::string& arguments) {
    return run_program(scratch.path(), arguments, "cd '" + scratch.path().string() + "' &&");
  }
  void text(const char* name, const std::string& content) const {
    std::ofstream(scratch / name) << content;
  }
  static std::string causes() {
    return fmt::format(
        "[[cause]]\neffect = \"machine.scale_x\"\nlaw = \"proportional\"\nnames = "
        "[\"error_um_per_m\"]\nvalues = [{}]\n"
        "[[cause]]\neffect = \"scanner.range_bias\"\nlaw = \"constant\"\nnames = "
        "[\"bias_mm\"]\nvalues = [{}]\n",
        kScale_um_per_m, kBias_mm);
  }
  /// The case of two scans, or one that measures nothing yet.
  static std::string part(const std::string& a = "a.ply", const std::string& b = "b.ply") {
    return fmt::format(
        "schema = \"maquette.case/1\"\ndesign = \"design.tif\"\ngcode = \"part.ngc\"\n"
        "[[scan]]\npoints = \"{}\"\nscanner_position_mm = [30.0, -500.0, 600.0]\n"
        "[[scan]]\npoints = \"{}\"\nscanner_position_mm = [600.0, 200.0, 500.0]\n",
        a, b);
  }
  void SetUp() override {
    ASSERT_TRUE(heightmap::write_model_field(
        testing_support::rough_part(5, 121, 121, 0.5, 1.5, 1.3), scratch / "design.tif"));
    const Outcome mill = run("mill design.tif --no-arcs --out part.ngc --quiet");
    ASSERT_EQ(mill.exit_code, 0) << mill.err;
    text("extended.toml", part() + causes());
    text("fine.toml",
         "kind = \"phase_shift\"\nlines_per_turn = 40000.0\n[range]\nresolution_mm = 0.0\n"
         "sigma_mm = 0.03\nnoise_exponent = 0.0\n[beam]\nfootprint_rays = 1\n");
  }
};

TEST_F(ExtendedModels, ActOnCutAndScanAsDiagnosed) {
  const Outcome cut =
      run("verify part.ngc --design design.tif --cell-mm 0.25 --extended extended.toml --out cut "
          "--quiet");
  ASSERT_EQ(cut.exit_code, 0) << cut.err;
  const json certificate = json::parse(slurp(scratch / "cut/certificate.json"));
  EXPECT_EQ(certificate["as_built"]["causes"], json({"machine.scale_x", "scanner.range_bias"}));
  // The program with its x stretched in the text cuts what the model says: within what is of
  // second order in a shift of 0.09 mm on slopes that bend by 1/3 mm, and the grids.
  std::string stretched;
  for (std::istringstream in(slurp(scratch / "part.ngc")); !in.eof();) {
    std::string line;
    std::getline(in, line);
    const auto at = line[0] == '(' ? std::string::npos : line.find('X');
    if (at != std::string::npos) {
      std::size_t end = 0;
      const double x = std::stod(line.substr(at + 1), &end);
      line.replace(at + 1, end, fmt::format("{:.5f}", x + 1e-6 * kScale_um_per_m * (x - 30.0)));
    }
    stretched += line + "\n";
  }
  text("stretched.ngc", stretched);
  const Outcome other =
      run("verify stretched.ngc --design design.tif --cell-mm 0.25 --out other --quiet");
  ASSERT_EQ(other.exit_code, 0) << other.err;
  const auto milled = heightmap::read_model_field(scratch / "cut/as_milled.tif");
  const auto built = heightmap::read_model_field(scratch / "cut/as_built.tif");
  const auto truth = heightmap::read_model_field(scratch / "other/as_milled.tif");
  ASSERT_TRUE(truth && milled && built);
  double squares = 0.0, moved = 0.0;
  for (double y = 3.0; y < 57.0; y += 0.5)
    for (double x = 3.0; x < 57.0; x += 0.5) {
      const double here = heightmap::height_at(*truth, x, y);
      const double off = heightmap::height_at(*built, x, y) - here;
      const double whole = heightmap::height_at(*milled, x, y) - here;
      squares += off * off;
      moved += whole * whole;
    }
  EXPECT_LT(std::sqrt(squares), 0.1 * std::sqrt(moved));
  EXPECT_GT(std::sqrt(moved) / 109.0, 0.003);

  // Scanned with it, then diagnosed from nothing: both causes, at their size.
  const Outcome a =
      run("scan cut/as_milled.tif --extended extended.toml --scanner fine.toml --out a.ply --quiet "
          "--station-mm 30 -500 600 --max-points 60000");
  ASSERT_EQ(a.exit_code, 0) << a.err;
  // The second station is the case's second scan; for these causes either will do.
  const Outcome b =
      run("scan cut/as_milled.tif --extended extended.toml --scanner fine.toml --out b.ply --quiet "
          "--station-mm 600 200 500 --max-points 60000 --seed 2");
  ASSERT_EQ(b.exit_code, 0) << b.err;
  // Without causes the same scan is shorter by the bias along each beam; the part is stretched.
  ASSERT_EQ(run("scan cut/as_built.tif --scanner fine.toml --out plain.ply --quiet --station-mm 30 "
                "-500 600 --max-points 60000")
                .exit_code,
            0);
  const auto with = scan::read_cloud(scratch / "a.ply");
  const auto plain = scan::read_cloud(scratch / "plain.ply");
  ASSERT_TRUE(with && plain);
  const Vec3 station{30.0, -500.0, 600.0};
  double mean = 0.0;
  for (const Vec3& p : with->points_mm) mean += norm(p - station);
  mean /= static_cast<double>(with->points_mm.size());
  for (const Vec3& p : plain->points_mm)
    mean -= norm(p - station) / static_cast<double>(plain->points_mm.size());
  // as_built is on coarser nodes than as_milled: some points less at the rim, ridges blunted.
  EXPECT_NEAR(mean, kBias_mm, 0.02);

  text("case.toml", part());
  const Outcome found = run("diagnose case.toml --out found --no-controls --quiet");
  ASSERT_EQ(found.exit_code, 0) << found.err;
  const json d = json::parse(slurp(scratch / "found/diagnosis.json"));
  ASSERT_EQ(d["causes"].size(), 2U) << d.dump(1).substr(0, 3000);
  for (const json& cause : d["causes"]) {
    const bool scale = cause["effect"] == "machine.scale_x";
    EXPECT_TRUE(scale || cause["effect"] == "scanner.range_bias") << cause["effect"];
    const json& p = cause["parameters"][scale ? "error_um_per_m" : "bias_mm"];
    // One seed: 4 standard errors, and 5 % of size for what is of second order.
    const double size = scale ? kScale_um_per_m : kBias_mm;
    EXPECT_NEAR(p["value"].get<double>(), size, 4.0 * p["sigma"].get<double>() + 0.05 * size);
  }

  // With what was found, and with what was hidden, nothing is left.
  for (const char* model : {"found/extended.toml", "extended.toml"}) {
    const Outcome again = run(fmt::format("diagnose {} --out again --no-controls --quiet", model));
    ASSERT_EQ(again.exit_code, 0) << again.err;
    const json j = json::parse(slurp(scratch / "again/diagnosis.json"));
    EXPECT_EQ(j["verdict"], "consistent") << model << j["causes"].dump(1).substr(0, 2000);
  }
}

TEST_F(ExtendedModels, AreRefusedWithAReason) {
  text("wrong.toml", part() + "[[cause]]\neffect = \"machine.gremlins\"\n");
  for (const char* verb : {"verify part.ngc --design design.tif --cell-mm 0.25 --out w",
                           "scan design.tif --max-points 1000 --out w.ply"}) {
    const Outcome o = run(std::string(verb) + " --extended wrong.toml");
    EXPECT_EQ(o.exit_code, 2) << verb;
    EXPECT_THAT(o.err, HasSubstr("machine.gremlins"));
    EXPECT_THAT(o.err, HasSubstr("wrong.toml"));
  }
  // Of a mesh nobody knows what cut a vertex.
  ASSERT_EQ(run("mesh design.tif --out part.ply --quiet").exit_code, 0);
  const Outcome mesh = run("scan part.ply --extended extended.toml --out w.ply");
  EXPECT_EQ(mesh.exit_code, 2);
  EXPECT_THAT(mesh.err, HasSubstr(".tif"));
  // A limit that the program keeps and the part as built does not.
  const Outcome limit =
      run("verify part.ngc --design design.tif --cell-mm 0.25 --out w --extended extended.toml "
          "--max-gouge-mm 0.02");
  EXPECT_EQ(limit.exit_code, 1);
  EXPECT_THAT(limit.err, HasSubstr("as built"));
}

TEST_F(ExtendedModels, AreKeysOfASite) {
  ASSERT_EQ(run("init --out site.toml").exit_code, 0);
  const std::string common =
      " --set size_mm=40 --set scales=[1000] --set scanner.max_points=20000 "
      "--set verify.cell_mm=0.25 --set rough.enabled=false --set stones.count=0 --quiet ";
  std::string site = slurp(scratch / "site.toml");
  const Outcome o = run("run site.toml --out out" + common +
                        "--set verify.max_gouge_mm=5 --set verify.extended=extended.toml");
  ASSERT_EQ(o.exit_code, 0) << o.err;
  EXPECT_TRUE(fs::exists(scratch / "out/s1000/as_built.tif"));
  const json manifest = json::parse(slurp(scratch / "out/manifest.json"));
  EXPECT_THAT(manifest.dump(), HasSubstr("as_built"));
}

TEST(CaseFile, SaysWhichPassMadeAPlace) {
  const ScratchFolder scratch;
  const auto of = [&](const std::string& tool, const std::string& causes) {
    std::ofstream(scratch / "case.toml") << "schema = \"maquette.case/1\"\ndesign = \"d.tif\"\n" +
                                                tool + "[[scan]]\npoints = \"a.ply\"\n" + causes;
    const auto c = read_case(scratch / "case.toml");
    EXPECT_THAT(c, Succeeds());
    return c ? diagnosis_input(**c, 1).contact : diagnosis::MadeBy::unknown;
  };
  const std::string cause = "[[cause]]\neffect = \"stock.warp\"\n",
                    by_tip = cause + "contact = \"tip\"\n";
  EXPECT_EQ(of("", ""), diagnosis::MadeBy::unknown);
  EXPECT_EQ(of("", cause), diagnosis::MadeBy::ball) << "the model was made so";
  EXPECT_EQ(of("", cause + by_tip), diagnosis::MadeBy::tip);
  EXPECT_EQ(of("[tool]\ncontact = \"tip\"\n", ""), diagnosis::MadeBy::tip);
  EXPECT_EQ(of("[tool]\ncontact = \"ball\"\n", by_tip), diagnosis::MadeBy::ball);
}

}  // namespace
}  // namespace maquette::tools
