// SPDX-License-Identifier: GPL-3.0-or-later

// What a user gets for malformed input: one clear error that names file, place and
// what was expected, the documented exit code, and nothing half-written. Exit codes
// 0, 1, 2 and 3 are reached here; 4 is our bug and has no input of its own.

#include <array>
#include <fstream>
#include <numbers>
#include <sstream>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "assets/synthetic_products.hpp"
#include "cnc/undercoat.hpp"
#include "heightmap/field_io.hpp"
#include "meshing/mesh_io.hpp"
#include "meshing/stones.hpp"
#include "support/folders.hpp"
#include "support/matchers.hpp"
#include "support/placed_stones.hpp"
#include "support/program.hpp"

namespace maquette {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using testing::AllOf;
using testing::HasSubstr;
using testing::Not;
using testing_support::Outcome;
using testing_support::run_program;
using testing_support::ScratchFolder;
using testing_support::slurp;

class CommandLine : public testing::Test {
 protected:
  ScratchFolder scratch;
  fs::path out = scratch / "out";

  Outcome run(const std::string& arguments, const std::string& before = "") {
    return run_program(scratch.path(), arguments, before);
  }
  fs::path file(const std::string& name, const std::string& content) {
    EXPECT_TRUE(write_file(scratch / name, content));
    return scratch / name;
  }
  /// A hill of 20 mm x 20 mm.
  fs::path design(float void_at = 0.0F) {
    heightmap::ModelField field{Grid<float>(41, 41), Millimetres{0.5}, {}, {}};
    for (std::ptrdiff_t r = 0; r < 41; ++r)
      for (std::ptrdiff_t c = 0; c < 41; ++c)
        field.z_mm(r, c) = static_cast<float>(std::sin(0.1 * static_cast<double>(r + c)));
    field.z_mm(7, 9) += void_at;  // NaN makes a void
    EXPECT_TRUE(heightmap::write_model_field(field, scratch / "design.tif"));
    return scratch / "design.tif";
  }
  /// A bowl of 30 mm x 30 mm with a groove narrower than most balls and a knob with steep sides.
  fs::path bowl() {
    heightmap::ModelField field{Grid<float>(61, 61), Millimetres{0.5}, {}, {}};
    for (std::ptrdiff_t r = 0; r < 61; ++r)
      for (std::ptrdiff_t c = 0; c < 61; ++c) {
        const double x = 0.5 * static_cast<double>(c) - 15.0,
                     y = 0.5 * static_cast<double>(r) - 15.0;
        double z = 0.02 * (x * x + y * y) - (std::fabs(x) < 1.0 ? 1.5 : 0.0);
        if (std::hypot(x - 6.0, y) < 3.0) z += 4.0;
        field.z_mm(r, c) = static_cast<float>(z);
      }
    EXPECT_TRUE(heightmap::write_model_field(field, scratch / "bowl.tif"));
    return scratch / "bowl.tif";
  }
  /// Highest and lowest of a minus b, at the nodes of b.
  static std::pair<double, double> differences(const fs::path& a, const fs::path& b) {
    const auto fa = heightmap::read_model_field(a), fb = heightmap::read_model_field(b);
    EXPECT_TRUE(fa && fb) << a << b;
    double highest = -INFINITY, lowest = INFINITY;
    for (std::ptrdiff_t r = 0; r < fb->z_mm.rows(); ++r)
      for (std::ptrdiff_t c = 0; c < fb->z_mm.cols(); ++c) {
        const double d = heightmap::height_at(*fa, fb->x_mm(c), fb->y_mm(r)) -
                         static_cast<double>(fb->z_mm(r, c));
        highest = std::max(highest, d);
        lowest = std::min(lowest, d);
      }
    return {highest, lowest};
  }
  /// Products of a small synthetic site, and a site file that uses them.
  assets::SyntheticProducts products() {
    assets::SyntheticSite site;
    site.body = *heightmap::body_by_name("moon");
    site.half_width = Metres{25.0};
    auto files = assets::write_synthetic_products(site, scratch.path());
    EXPECT_TRUE(files.has_value());
    return *files;
  }
  fs::path site_file(const fs::path& source, const std::string& more = "") {
    return file("site.toml", more + fmt::format("size_mm = 20.0\nscales = [1000.0]\n[[source]]\n"
                                                "name = \"dtm\"\npath = \"{}\"\n",
                                                source.string()));
  }
  /// Bad input: exit code 2, one error, nothing but the lock in the result folder.
  void expect_refused(const Outcome& o, const testing::Matcher<std::string>& message,
                      int exit_code = 2) {
    EXPECT_EQ(o.exit_code, exit_code) << o.err;
    EXPECT_THAT(o.err, message);
    EXPECT_THAT(o.err, HasSubstr("error: "));
    if (!fs::exists(out)) return;
    for (const auto& e : fs::recursive_directory_iterator(out))
      EXPECT_TRUE(e.is_directory() || e.path().filename() == "lock") << e.path() << " is left";
  }
};

TEST_F(CommandLine, TypingErrorInTheSiteFile) {
  const auto site = file("site.toml", "size_mm = 200.0\n[mill]\nstepovr_mm = 0.5\n");
  expect_refused(run("run " + site.string() + " --out " + out.string()),
                 AllOf(HasSubstr("site.toml:3"), HasSubstr("mill.stepover_mm")));
}

TEST_F(CommandLine, SiteFileThatIsNoToml) {
  const auto site = file("site.toml", "size_mm == 200.0\n");
  expect_refused(run("run " + site.string() + " --out " + out.string()), HasSubstr("site.toml:1:"));
}

TEST_F(CommandLine, SiteFileThatIsNotThere) {
  expect_refused(run("run nowhere.toml --out " + out.string()), HasSubstr("nowhere.toml"));
}

TEST_F(CommandLine, TruncatedImage) {
  const auto p = products();
  fs::resize_file(p.fine_img, fs::file_size(p.fine_img) / 2);
  expect_refused(run("run " + site_file(p.fine_img).string() + " --out " + out.string()),
                 AllOf(HasSubstr(p.fine_img.filename().string()), HasSubstr("bytes")));
}

TEST_F(CommandLine, LabelWithoutItsImage) {
  const auto p = products();
  fs::remove(p.coarse_img);
  expect_refused(run("run " + site_file(p.coarse_lbl).string() + " --out " + out.string()),
                 HasSubstr(p.coarse_img.filename().string()));
}

TEST_F(CommandLine, SourceOfAnotherBody) {
  const auto p = products();
  expect_refused(
      run("run " + site_file(p.fine_img, "body = \"mars\"\n").string() + " --out " + out.string()),
      AllOf(HasSubstr("mars"), HasSubstr("moon")));
}

TEST_F(CommandLine, SourceThatDoesNotReachTheSite) {
  const auto p = products();
  expect_refused(run("run " + site_file(p.fine_img, "centre_longitude_deg = 10.0\n").string() +
                     " --out " + out.string()),
                 HasSubstr(p.fine_img.filename().string()));
}

TEST_F(CommandLine, ModelSurfaceAsASource) {
  expect_refused(run("run " + site_file(design()).string() + " --out " + out.string()),
                 HasSubstr("design.tif"));
}

TEST_F(CommandLine, EnvironmentVariableThatIsNotSet) {
  const auto site = site_file("${MAQUETTE_NO_SUCH_VARIABLE}");
  expect_refused(run("run " + site.string() + " --out " + out.string()),
                 HasSubstr("MAQUETTE_NO_SUCH_VARIABLE"));
}

TEST_F(CommandLine, VoidInTheDesign) {
  const auto holed = design(NAN);
  expect_refused(run("mill " + holed.string() + " --out " + (scratch / "part.ngc").string()),
                 HasSubstr("row"));
  EXPECT_FALSE(fs::exists(scratch / "part.ngc"));
  expect_refused(run("mesh " + holed.string() + " --out " + (scratch / "s.ply").string()),
                 HasSubstr("row"));
}

TEST_F(CommandLine, RasterOfNothingButVoids) {
  heightmap::ModelField field{Grid<float>(8, 8, NAN), Millimetres{0.5}, {}, {}};
  ASSERT_TRUE(heightmap::write_model_field(field, scratch / "void.tif"));
  expect_refused(run("mill " + (scratch / "void.tif").string() + " --out x.ngc"),
                 HasSubstr("void.tif"));
}

TEST_F(CommandLine, SolidsThatCannotBe) {
  const auto d = design().string();
  const auto to = " --out " + out.string();
  expect_refused(run("mesh " + d + " --base-thickness-mm 0" + to), HasSubstr("base-thickness"));
  expect_refused(run("bands " + d + " --base-thickness-mm 0" + to), HasSubstr("base-thickness"));
  expect_refused(run("bands " + d + " --max-width-mm 0.6" + to),
                 AllOf(HasSubstr("0.6"), HasSubstr("two cells")));
  expect_refused(run("bands " + d + " --max-length-mm 0" + to), HasSubstr("two cells"));
  expect_refused(run("bands " + d + " --max-width-mm nan" + to), HasSubstr("two cells"));
  const auto holed = design(NAN).string();
  for (const char* verb :
       {"bands ", "bands --max-length-mm 9 ", "export --format step ", "export --format stl "})
    expect_refused(run(verb + holed + to), AllOf(HasSubstr("row 7"), HasSubstr("column 9")));
}

TEST_F(CommandLine, PlanetRasterAsADesign) {
  const auto p = products();
  fs::copy(p.fine_img, scratch / "planet.tif");
  expect_refused(run("mill " + (scratch / "planet.tif").string() + " --out x.ngc"),
                 HasSubstr("planet.tif"));
}

TEST_F(CommandLine, OptionsOutOfRange) {
  const auto d = design().string();
  expect_refused(run("mill " + d + " --stepover-mm 0 --out x.ngc"), HasSubstr("stepover"));
  expect_refused(run("mill " + d + " --stated-stepover-mm 0.5 --out x.ngc"),
                 HasSubstr("excess_limit"));
  expect_refused(run("mill " + d + " --diameter-mm -6 --out x.ngc"), HasSubstr("diameter"));
  expect_refused(run("mill " + d + " --post fanucc --out x.ngc"), HasSubstr("fanucc"));
  expect_refused(run("mill " + d + " --machine nonesuch --out x.ngc"), HasSubstr("nonesuch"));
  expect_refused(run("export " + d + " --format stll --out " + out.string()), HasSubstr("stll"));
  expect_refused(run("run x.toml --shard 4/3"), HasSubstr("4/3"));
  expect_refused(run("nonesuch"), HasSubstr("--help"));
  expect_refused(run("mill " + d + " --nonesuch"), HasSubstr("nonesuch"));
}

/// Every strategy is reached, and what it writes is a program that cuts nothing it must not.
TEST_F(CommandLine, EveryStrategyMills) {
  const fs::path bowl = this->bowl();
  meshing::PlacedStone stone;
  stone.number = 1;
  stone.scale_mm = 4.0;
  stone.model_from_stone.translation_mm = {5.0, 8.0, 2.5};
  ASSERT_TRUE(meshing::write_stone_plan(std::vector{stone}, scratch / "stones.json"));
  const auto mill = [&](const std::string& strategy, const std::string& more = "") {
    const fs::path program = scratch / (strategy + ".ngc");
    const auto o =
        run(fmt::format("mill {} --json --quiet --strategy {} --machine portal_mill_2500 "
                        "--out {} {}",
                        bowl.string(), strategy, program.string(), more));
    EXPECT_EQ(o.exit_code, 0) << strategy << ": " << o.err;
    EXPECT_TRUE(fs::exists(program)) << strategy;
    const json figures = o.exit_code == 0 ? json::parse(o.out) : json::object();
    if (figures.contains("proven_gouge_mm")) {
      EXPECT_LE(figures["proven_gouge_mm"].get<double>(), 0.0101) << strategy;
    }
    return figures;
  };
  EXPECT_GT(mill("rough").value("removed_cm3", 0.0), 0.1);
  const std::string roughed = "--stock " + (scratch / "rough.stock.tif").string();
  EXPECT_GT(mill("semi-finish", roughed).value("passes", 0), 10);
  const std::string semi = "--stock " + (scratch / "semi-finish.stock.tif").string();
  EXPECT_EQ(mill("raster", semi).value("passes", 0), 61);
  EXPECT_GT(mill("waterline", semi).value("levels", 0), 3);
  EXPECT_GT(mill("geodesic", semi).value("curves", 0), 20);
  EXPECT_GT(
      mill("rest", "--stock " + (scratch / "raster.stock.tif").string()).value("area_mm2", 0.0),
      20.0);
  // Each leaves less than the one before, and none less than the design.
  for (const auto& [later, before] :
       {std::pair{"semi-finish", "rough"}, std::pair{"raster", "semi-finish"},
        std::pair{"waterline", "semi-finish"}, std::pair{"geodesic", "semi-finish"},
        std::pair{"rest", "raster"}}) {
    const fs::path left = scratch / (std::string(later) + ".stock.tif");
    const auto [more, less] = differences(left, scratch / (std::string(before) + ".stock.tif"));
    EXPECT_LE(more, 1e-4) << later;
    EXPECT_LT(less, std::string(later) == "rest" ? -0.3 : -0.15) << later;
    EXPECT_GE(differences(left, bowl).second, -0.0101) << later;
  }
  EXPECT_LT(differences(scratch / "raster.stock.tif", bowl).first, 3.0) << "beside the knob";
  const std::string stones = "--stones " + (scratch / "stones.json").string();
  EXPECT_GT(mill("seats", stones).value("volume_mm3", 0.0), 5.0);
  EXPECT_EQ(mill("outlines", stones + " --mark-depth-mm 0.005").value("passes", 0), 1);
  mill("probe", "--work-offset 55");
  const std::string touches = slurp(scratch / "probe.ngc");
  EXPECT_THAT(touches, AllOf(HasSubstr("G38.2"), HasSubstr("G10 L2 P2"), HasSubstr("G55")));
  EXPECT_THAT(touches, Not(HasSubstr("M3\n"))) << "the probe must not turn";
}

const char* const kFourOperations =
    "[[operation]]\nstrategy = \"rough\"\ndiameter_mm = 8.0\nstepover_mm = 4.0\nstep_down_mm = "
    "2.0\n[[operation]]\nstrategy = \"semi-finish\"\ntool = 5\ndiameter_mm = 5.0\n"
    "[[operation]]\nstrategy = \"raster\"\nname = \"finish\"\n[[operation]]\nstrategy = "
    "\"rest\"\ndiameter_mm = 2.0\n";

/// One program, four tools: each operation cuts what the one before has left, and all controls are
/// told the same.
TEST_F(CommandLine, OneProgramOfSeveralOperations) {
  const std::string d = bowl().string();
  const auto operations = file("operations.toml", kFourOperations).string();
  for (const auto& [post, more] :
       {std::pair{"linuxcnc", ""}, std::pair{"fanuc", ""}, std::pair{"heidenhain", ""},
        std::pair{"haas", ""}, std::pair{"grbl", ""}, std::pair{"linuxcnc", " --max-lines 900"}}) {
    const fs::path folder = scratch / (std::string(post) + (*more == '\0' ? "" : "_split"));
    fs::create_directories(folder);
    const auto o = run(fmt::format(
        "mill {} --json --quiet --operations {} --machine portal_mill_2500 --out {} --post {}{}", d,
        operations, (folder / "part.ngc").string(), post, more));
    ASSERT_EQ(o.exit_code, 0) << post << ": " << o.err;
    const json figures = json::parse(o.out);
    ASSERT_EQ(figures["operations"].size(), 4U);
    ASSERT_EQ(figures["machining_time"].size(), 4U);
    double minutes = 0.0;
    for (const json& row : figures["machining_time"]) minutes += row["total_min"].get<double>();
    EXPECT_NEAR(figures["total_time_min"].get<double>(), minutes, 1e-9);
    for (std::size_t k = 1; k < 4; ++k) {
      EXPECT_LE(figures["operations"][k]["proven_gouge_mm"].get<double>(), 0.0051) << post << k;
      EXPECT_GT(figures["machining_time"][k]["length_m"].get<double>(), 0.05) << post << k;
    }
    EXPECT_EQ(figures["machining_time"][2]["operation"], "finish");
    EXPECT_EQ(figures["machining_time"][1]["tool"], 5);
    std::string programs;
    for (int k = 1; k < 40; ++k) {
      const fs::path part = folder / (k == 1 ? "part.ngc" : fmt::format("part_{}.ngc", k));
      if (fs::exists(part)) programs += part.string() + " ";
    }
    EXPECT_EQ(programs.find("part_3") != std::string::npos, *more != '\0') << programs;
    const auto v = run(fmt::format(
        "verify {} --json --quiet --design {} --out {} --tools {} --machine portal_mill_2500 "
        "--max-gouge-mm 0.0055 --cell-mm 0.125",
        programs, d, (folder / "verify").string(), (folder / "part.tools.toml").string()));
    EXPECT_EQ(v.exit_code, 0) << post << ": " << v.err;
    const json c = json::parse(slurp(folder / "verify/certificate.json"));
    EXPECT_EQ(c["rapid_collisions"], 0) << post;
    double verified = 0.0;
    for (const json& row : c["machining_time"]) verified += row["total_min"].get<double>();
    EXPECT_NEAR(verified, minutes, 1e-3 * minutes) << post;  // dwells
    // What is left, found twice: at the design's nodes after each operation, in one go here.
    const auto [more_left, less_left] =
        differences(folder / "verify/as_milled.tif", folder / "part.rest.stock.tif");
    EXPECT_LT(more_left, 2e-3) << post;
    EXPECT_GT(less_left, -2e-3) << post;
    EXPECT_TRUE(fs::exists(folder / "part.finish.scallop.tif"));
    for (const auto& e : fs::directory_iterator(folder))
      EXPECT_NE(e.path().filename().string()[0], '.') << e.path() << " is left";
  }
  const std::string text = slurp(scratch / "linuxcnc/part.ngc");
  std::size_t at = 0;
  for (const char* change : {"T2 M6", "T5 M6", "T1 M6", "T3 M6", "M30"}) {
    const std::size_t next = text.find(change, at);
    ASSERT_NE(next, std::string::npos) << change;
    EXPECT_EQ(text.find(change, next + 1), std::string::npos) << change << " comes twice";
    at = next;
  }
}

TEST_F(CommandLine, OperationsOfOneToolChangeNothing) {
  const auto operations = file("operations.toml",
                               "[[operation]]\nstrategy = \"semi-finish\"\n[[operation]]\nstrategy "
                               "= \"raster\"\ntolerance_mm = 0.02\n");
  const auto o = run(fmt::format("mill {} --quiet --operations {} --out {}", design().string(),
                                 operations.string(), (scratch / "part.ngc").string()));
  ASSERT_EQ(o.exit_code, 0) << o.err;
  const std::string text = slurp(scratch / "part.ngc");
  EXPECT_EQ(text.find("M6"), text.rfind("M6"));
  EXPECT_THAT(text, AllOf(HasSubstr("G64 P0.001 Q0"), HasSubstr("G64 P0.002 Q0")));
}

TEST_F(CommandLine, OperationsSayWhatIsWrong) {
  const auto d = design().string();
  const std::string to = " --out " + (scratch / "x.ngc").string();
  const auto with = [&](const std::string& text, const std::string& more = "") {
    const auto f = file("operations.toml", text).string();
    return run("mill " + d + " --operations " + f + to + " " + more);
  };
  const std::string raster = "[[operation]]\nstrategy = \"raster\"\n";
  expect_refused(with(""), HasSubstr("no [[operation]]"));
  expect_refused(with("[[operation]]\nstrategy = \"probe\"\n"),
                 AllOf(HasSubstr("operations.toml:2"), HasSubstr("semi-finish")));
  expect_refused(with("[[operation]]\n"), HasSubstr("strategy"));
  expect_refused(with(raster + raster),
                 AllOf(HasSubstr("operation 2 (raster)"), HasSubstr("this name")));
  expect_refused(with(raster + "name = \"a/b\"\n"), HasSubstr("part of a file's name"));
  expect_refused(with(raster + "[[operation]]\nstrategy = \"waterline\"\ndiameter_mm = 4.0\n"),
                 AllOf(HasSubstr("operation 2 (waterline)"), HasSubstr("ball nose 4 mm here"),
                       HasSubstr("its own number")));
  expect_refused(with(raster + "corner_radius_mm = 1.0\n"), HasSubstr("milled with a ball"));
  expect_refused(with(raster + "stepover_mm = -1.0\n"), HasSubstr("operations.toml:3"));
  expect_refused(with(raster + "excess_limit_mm = 0.02\nstated_stepover_mm = 0.4\n"),
                 AllOf(HasSubstr("stated_stepover is 0.4 mm"), HasSubstr("0.5 mm")));
  expect_refused(with(raster + "stated_stepover_mm = 0.6\n"), HasSubstr("excess_limit too"));
  expect_refused(with("[[operation]]\nstrategy = \"rough\"\nexcess_limit_mm = 0.02\n"),
                 AllOf(HasSubstr("operation 1 (rough)"), HasSubstr("of raster passes")));
  expect_refused(with(raster, "--strategy rough"), HasSubstr("--strategy does not go"));
  expect_refused(with(raster, "--diameter-mm 4"), HasSubstr("--diameter-mm does not go"));
  const auto tools =
      file("tools.toml", "[[tool]]\nnumber = 7\nshape = \"flat\"\ndiameter_mm = 6.0\n");
  expect_refused(with(raster, "--tools " + tools.string()), HasSubstr("it has 7"));
  expect_refused(with(raster + "tool = 7\n", "--tools " + tools.string()), HasSubstr("no ball"));
  expect_refused(with(raster + "[[operation]]\nstrategy = \"rest\"\ndiameter_mm = 6.0\n"),
                 AllOf(HasSubstr("operation rest"), HasSubstr("smaller")));
  expect_refused(run("mill " + d + " --operations nowhere.toml" + to), HasSubstr("nowhere.toml"));
  for (const auto& e : fs::directory_iterator(scratch.path()))
    EXPECT_EQ(e.path().extension(), e.path().stem() == "design" ? ".tif" : ".toml") << "is left";
}

/// A bore within the outline is meant, one operation among others; against the bare design it is a
/// gouge.
TEST_F(CommandLine, BoresWithinThePartAreCertified) {
  const heightmap::ModelField level{Grid<float>(61, 61, 5.0F), Millimetres{0.5}, Millimetres{0.0},
                                    Millimetres{0.0}};
  const fs::path d = scratch / "level.tif";
  ASSERT_THAT(heightmap::write_model_field(level, d), testing_support::Succeeds());
  const auto spheres = file("spheres.toml",
                            "sphere_radius_mm = 6.0\nhole_radius_mm = 4.0\n[[sphere]]\nat_mm = "
                            "[15.1, 14.8, 5.0]\n");
  const auto operations = file("bores.toml",
                               "[[operation]]\nstrategy = \"raster\"\n[[operation]]\nstrategy = "
                               "\"sphere-seats\"\n");
  const fs::path part = scratch / "bored.ngc";
  const auto milled =
      run(fmt::format("mill {} --quiet --operations {} --spheres {} --out {}", d.string(),
                      operations.string(), spheres.string(), part.string()));
  ASSERT_EQ(milled.exit_code, 0) << milled.err;
  const auto against = [&](const char* what) {
    return run(fmt::format("verify {} --quiet --design {} --tools {} --max-gouge-mm 0.02 --out {}",
                           part.string(), (scratch / what).string(),
                           (scratch / "bored.tools.toml").string(), (scratch / "bored").string()));
  };
  EXPECT_EQ(against("bored.machined.tif").exit_code, 0) << against("bored.machined.tif").err;
  EXPECT_EQ(against("level.tif").exit_code, 1);
}

/// Seats are bored, spheres that lie a little beside their plan are touched, and the touches
/// become datums.
TEST_F(CommandLine, ReferenceSpheresBecomeDatums) {
  const std::string d = design().string();  // 20 mm x 20 mm, heights -1 .. 1
  const auto spheres = file("spheres.toml",
                            "sphere_radius_mm = 10.0\nhole_radius_mm = 6.0\n[[sphere]]\nname = "
                            "\"west\"\nat_mm = [-40.0, 10.0, 2.0]\n[[sphere]]\nat_mm = [60.0, "
                            "10.0, 4.0]\n[[sphere]]\nname = \"north \\\"N\\\"\"\nat_mm = "
                            "[10.0, 60.0, -3.0]\n")
                           .string();
  const auto mill = [&](const std::string& strategy, const std::string& more) {
    return run(fmt::format("mill {} --json --quiet --strategy {} --spheres {} --out {} {}", d,
                           strategy, spheres, (scratch / (strategy + ".ngc")).string(), more));
  };
  const auto bored = mill("sphere-seats", "");
  ASSERT_EQ(bored.exit_code, 0) << bored.err;
  // 10^2 = 6^2 + 8^2: the centre is 8 above the rim, the floor 10.5 below the centre.
  const json seats = json::parse(bored.out);
  EXPECT_EQ(seats["spheres"][0]["centre_mm"], json({-40.0, 10.0, 10.0}));
  EXPECT_EQ(seats["passes"], 3);
  EXPECT_NEAR(seats["lowest_tip_mm"].get<double>(), -3.0 + 8.0 - 10.5, 1e-9);
  const auto touched = mill("probe-spheres", "--diameter-mm 3");
  ASSERT_EQ(touched.exit_code, 0) << touched.err;
  const std::string text = slurp(scratch / "probe-spheres.ngc");
  EXPECT_THAT(text, AllOf(HasSubstr("G38.2"), HasSubstr("(PROBEOPEN probe-spheres.contacts.txt)"),
                          Not(HasSubstr("M3\n"))));

  // What the machine would have found of spheres 0.3, -0.2, 0.1 mm off: where each probing move
  // of the program meets its sphere.
  const Vec3 off{0.3, -0.2, 0.1};
  const double reach = 10.0 + 1.5;
  std::string contacts;
  for (const auto& row : seats["spheres"]) {
    const Vec3 plan{row["centre_mm"][0], row["centre_mm"][1], row["centre_mm"][2]};
    const auto meets = [&](std::size_t axis, double side) {
      std::array<double, 3> p{plan.x, plan.y, plan.z};
      const std::array<double, 3> c{plan.x + off.x, plan.y + off.y, plan.z + off.z};
      double aside2 = 0.0;
      for (std::size_t k = 0; k < 3; ++k)
        if (k != axis) aside2 += (p[k] - c[k]) * (p[k] - c[k]);
      p[axis] = c[axis] + side * std::sqrt(reach * reach - aside2);
      for (int k = 0; k < 2; ++k)
        contacts += fmt::format("{:.6f} {:.6f} {:.6f} 0 0 0 0 0 0\n", p[0], p[1], p[2] - 1.5);
    };
    meets(2, 1.0);
    for (const std::size_t axis : {0U, 1U})
      for (const double side : {-1.0, 1.0}) meets(axis, side);
  }
  const auto measured = file("touch.txt", contacts).string();
  const auto found = [&](const std::string& more) {
    return run(fmt::format("spheres {} --json --quiet --spheres {} --out {} {}", measured, spheres,
                           (scratch / "datums.toml").string(), more));
  };
  const auto o = found("--probe-diameter-mm 3");
  ASSERT_EQ(o.exit_code, 0) << o.err;
  const json figures = json::parse(o.out);
  for (std::size_t k = 0; k < 3; ++k) {
    EXPECT_NEAR(figures["spheres"][k]["off_plan_mm"][0].get<double>(), off.x, 1e-5);
    EXPECT_NEAR(figures["spheres"][k]["off_plan_mm"][2].get<double>(), off.z, 1e-5);
  }
  EXPECT_THAT(slurp(scratch / "datums.toml"),
              AllOf(HasSubstr("kind = \"sphere\"\nname = \"west\"\nat_mm = [-39.70000, 9.80000, "
                              "10.10000]\nradius_mm = 10.0"),
                    HasSubstr("\"sphere 2\""), HasSubstr("\"north \\\"N\\\"\"")));
  // The case file takes them: the next thing it lacks is the scan.
  const auto c = file("case.toml",
                      "design = \"design.tif\"\ndatums = \"datums.toml\"\n"
                      "[[scan]]\npoints = \"none.ply\"\n");
  expect_refused(run("deviate " + c.string() + " --out " + out.string()), HasSubstr("none.ply"));
  file("datums.toml", "[[datum]]\nkind = \"cube\"\n");
  expect_refused(run("deviate " + c.string() + " --out " + out.string()),
                 AllOf(HasSubstr("datums.toml:2"), HasSubstr("sphere")));

  fs::remove(scratch / "datums.toml");
  expect_refused(found("--probe-diameter-mm 4"), HasSubstr("sphere 1: a touch is"));
  EXPECT_FALSE(fs::exists(scratch / "datums.toml"));
  const std::string to = " --out " + (scratch / "x.ngc").string();
  expect_refused(run("mill " + d + " --strategy sphere-seats" + to), HasSubstr("--spheres"));
  expect_refused(mill("probe-spheres", "--post grbl"), HasSubstr("cannot write contacts"));
  const auto with = [&](const std::string& strategy, const std::string& spheres_text) {
    const auto f = file("bad.toml", spheres_text).string();
    return run("mill " + d + " --strategy " + strategy + " --spheres " + f + to);
  };
  expect_refused(with("sphere-seats", "[[sphere]]\nat_mm = [10.0, 10.0, 0.5]\n"),
                 AllOf(HasSubstr("sphere 1"), HasSubstr("the design is")));
  expect_refused(with("sphere-seats", "[[sphere]]\nat_mm = [10.0, 10.0, 20.0]\n"),
                 HasSubstr("the rim needs it from 19.950"));
  expect_refused(with("probe-spheres", "[[sphere]]\nat_mm = [-8.0, 10.0, -9.0]\n"),
                 HasSubstr("the probe beside the sphere's equator"));
  expect_refused(with("sphere-seats",
                      "hole_radius_mm = 12.0\n[[sphere]]\nat_mm = [-40.0, 0.0, "
                      "0.0]\n"),
                 HasSubstr("falls through"));
  expect_refused(with("sphere-seats", "[[sphere]]\n"), HasSubstr("at_mm"));
  expect_refused(with("sphere-seats", ""), HasSubstr("no [[sphere]]"));
  EXPECT_FALSE(fs::exists(scratch / "x.ngc"));
}

TEST_F(CommandLine, StrategiesSayWhatTheyLack) {
  const auto d = design().string();
  const std::string to = " --out " + (scratch / "x.ngc").string();
  expect_refused(run("mill " + d + " --strategy seats" + to), HasSubstr("stones.json"));
  expect_refused(run("mill " + d + " --strategy rest --diameter-mm 6" + to), HasSubstr("smaller"));
  expect_refused(run("mill " + d + " --strategy raster --corner-mm 1" + to), HasSubstr("ball"));
  expect_refused(run("mill " + d + " --strategy probe --post fanuc" + to), HasSubstr("G38.2"));
  expect_refused(run("mill " + d + " --strategy spiral" + to), HasSubstr("geodesic"));
  for (const auto& e : fs::directory_iterator(scratch.path()))
    EXPECT_EQ(e.path().filename(), "design.tif") << "is left";
}

TEST_F(CommandLine, WorkBeyondTheMachinesTravel) {
  std::string small =
      slurp(testing_support::source_folder() / "assets/machines/portal_mill_2500.toml");
  small.replace(small.find("[2500.0, 2500.0"), 15, "[2500.0, 15.0");  // the hill has 20
  const auto machine = file("small.toml", small).string();
  for (const char* strategy : {"raster", "rough", "semi-finish", "geodesic", "probe"})
    expect_refused(run(fmt::format("mill {} --strategy {} --machine {} --out {}", design().string(),
                                   strategy, machine, (scratch / "x.ngc").string())),
                   AllOf(HasSubstr("travel in y"), HasSubstr("15.0000 mm")));
  EXPECT_FALSE(fs::exists(scratch / "x.ngc"));
  EXPECT_FALSE(fs::exists(scratch / "x.ngc.rejected"));
}

TEST_F(CommandLine, GcodeWithAnError) {
  const auto program = file("part.ngc", "G21 G90\nG1 X1 Y1 Z1 F100\nG1 X2 Q&7\nM2\n");
  const auto outcome = run("verify " + program.string() + " --design " + design().string() +
                           " --out " + out.string());
  expect_refused(outcome, HasSubstr("part.ngc:3:"));
}

/// Feeds come from the chip, within the machine; what is asked for holds or is refused.
TEST_F(CommandLine, FeedsFollowMaterialAndMachine) {
  const std::string d = design().string();
  const auto mill = [&](const std::string& options, const std::string& as = "--json") {
    return run(fmt::format("mill {} {} --quiet --out {} {}", d, as, (scratch / "f.ngc").string(),
                           options));
  };
  const std::string portal = "--machine portal_mill_2500 ";
  const auto soft = mill(portal + "--material polyurethane_450 --allowance-mm 0.3");
  ASSERT_EQ(soft.exit_code, 0) << soft.err;
  const auto hard = mill(portal + "--material aluminium_6061 --allowance-mm 0.3");
  ASSERT_EQ(hard.exit_code, 0) << hard.err;
  const json s = json::parse(soft.out), h = json::parse(hard.out);
  // Each axis has 12000; the hill rises by less than 1 in 5 along x.
  EXPECT_LE(s["feeds"]["highest_mm_min"], 12000.0 * std::hypot(1.0, 0.2) + 1.0);
  EXPECT_LT(h["feeds"]["highest_mm_min"], s["feeds"]["highest_mm_min"]);
  EXPECT_LT(s["total_time_min"], h["total_time_min"]);
  EXPECT_LE(h["spindle_rpm"], 24000.0);
  const auto deep = mill(portal + "--material aluminium_6061 --allowance-mm 2.5");
  ASSERT_EQ(deep.exit_code, 0) << deep.err;
  EXPECT_LT(json::parse(deep.out)["feeds"]["highest_mm_min"], h["feeds"]["highest_mm_min"])
      << "deeper in the stock, less feed";
  const auto asked = mill(portal + "--material aluminium_6061 --feed-mm-per-min 777");
  ASSERT_EQ(asked.exit_code, 0) << asked.err;
  EXPECT_THAT(slurp(scratch / "f.ngc"), HasSubstr("F777\n"));
  fs::remove(scratch / "f.ngc");
  fs::remove(scratch / "f.scallop.tif");
  expect_refused(mill(portal + "--feed-mm-per-min 12001", ""), HasSubstr("allows 0.01 to 12000"));
  expect_refused(mill(portal + "--spindle-rpm 30000", ""), HasSubstr("turns 3000 to 24000"));
  expect_refused(mill(portal + "--material chees", ""), HasSubstr("chees"));
  expect_refused(mill("--material softwood", ""), HasSubstr("--machine"));
  EXPECT_FALSE(fs::exists(scratch / "f.ngc"));
}

/// What the issue calls bad input of programs: each its error, with its place, and nothing written.
TEST_F(CommandLine, GcodeThatCannotBeTrusted) {
  const std::string d = design().string();
  const std::string head = "G21 G90 G17\nG0 X5 Y5 Z10\n";
  const auto refused = [&](const std::string& lines, const std::string& code,
                           const std::string& says, const std::string& options = "") {
    const auto program = file("bad.ngc", head + lines);
    const auto o = run(fmt::format("--json --quiet verify {} --design {} --out {} {}",
                                   program.string(), d, out.string(), options));
    EXPECT_EQ(o.exit_code, 2) << lines << o.err;
    const json j = json::parse(o.out);
    EXPECT_EQ(j["error"]["code"], code) << lines;
    EXPECT_THAT(j["error"]["message"].get<std::string>(), HasSubstr(says)) << lines;
    EXPECT_FALSE(fs::exists(out / "certificate.json"));
    EXPECT_FALSE(fs::exists(out / "as_milled.tif"));
  };
  refused("G1 X6 Z0\nM2\n", "CNC_GCODE_NO_FEED", "bad.ngc:3:");
  refused("F500 G41 D1\nM2\n", "CNC_GCODE_UNSUPPORTED", "bad.ngc:3:6");
  refused("F500 G1 @3\nM2\n", "CNC_GCODE_SYNTAX", "bad.ngc:3:9");
  refused("F500 G2 X7 Y5 I5 J0\nM2\n", "CNC_GCODE_ARC", "bad.ngc:3:");
  refused("F500 G1 Z0\nG1 X", "CNC_GCODE_TRUNCATED", "bad.ngc:4:5");
  const auto tools =
      file("tools.toml",
           "[[tool]]\nnumber = 1\nshape = \"ball\"\ndiameter_mm = 6.0\n"
           "flute_length_mm = 20.0\nstick_out_mm = 45.0\n[[tool.holder]]\n"
           "height_mm = 560.0\nlower_diameter_mm = 30.0\nupper_diameter_mm = 60.0\n");
  const std::string table = "--machine portal_mill_2500 --tools " + tools.string();
  refused("T7 M6\nF500 G1 Z0\nM2\n", "CNC_TOOL_NOT_IN_TABLE", "bad.ngc:4: cuts with tool 7", table);
  refused("T1 M6\nF500 G1 Z0\nM2\n", "CNC_TOOL_TOO_LONG", "605.0000 mm long", table);
  // The same table and the same errors when programs are made.
  const auto mill = run(fmt::format("mill {} {} --out {}", d, table, (scratch / "x.ngc").string()));
  expect_refused(mill, HasSubstr("605.0000 mm long"));
  expect_refused(
      run(fmt::format("mill {} {} --tool 3 --out {}", d, table, (scratch / "x.ngc").string())),
      HasSubstr("has no tool 3; it has 1"));
  EXPECT_FALSE(fs::exists(scratch / "x.ngc"));
}

TEST_F(CommandLine, ToolTableWithMistakes) {
  const auto program = file("part.ngc", "G21 G90\nG0 X5 Y5 Z10\nT1 M6\nG1 Z0 F500\nM2\n");
  const auto refused = [&](const std::string& table, const testing::Matcher<std::string>& says) {
    const auto tools = file("tools.toml", table);
    expect_refused(run(fmt::format("verify {} --design {} --out {} --tools {}", program.string(),
                                   design().string(), out.string(), tools.string())),
                   says);
  };
  const std::string ball = "[[tool]]\nnumber = 1\nshape = \"ball\"\ndiameter_mm = 6.0\n";
  refused("", HasSubstr("no [[tool]]"));
  refused("[[tool]]\nnumber = 1\nshape = \"bal\"\n",
          AllOf(HasSubstr("tools.toml:3"), HasSubstr("\"ball\""), HasSubstr("diameter_mm")));
  refused(ball + ball, HasSubstr("tool 1 is there twice"));
  refused(ball + "corner_radius_mm = 1.0\n", HasSubstr("bull noses only"));
  refused(ball + "stick_out_mm = 40.0\n", HasSubstr("flute_length_mm"));
  refused("[[tool]]\nnumber = 2\nshape = \"bull\"\ndiameter_mm = 6.0\n", HasSubstr("bull nose"));
}

/// A program with two tools, a holder and a stone: T words decide what cuts, and what hits is said.
TEST_F(CommandLine, VerifyHonoursToolsHoldersAndStones) {
  heightmap::ModelField flat{Grid<float>(41, 41, 0.0F), Millimetres{0.5}, {}, {}};
  const fs::path d = scratch / "flat.tif";
  ASSERT_TRUE(heightmap::write_model_field(flat, d));
  const auto program = file("two.ngc",
                            "G21 G90 G64 P0.01\nG0 X2 Y4 Z8\nT1 M6\nG1 Z0.5 F600\nX18\nG0 Z8\n"
                            "T2 M6\nG0 X2 Y14\nG1 Z0.5 F300\nX18\nG0 Z8\nM2\n");
  const auto tools = file("tools.toml",
                          "[[tool]]\nnumber = 1\nshape = \"flat\"\ndiameter_mm = 4.0\n"
                          "[[tool]]\nnumber = 2\nshape = \"ball\"\ndiameter_mm = 2.0\n"
                          "flute_length_mm = 0.2\nstick_out_mm = 0.3\n[[tool.holder]]\n"
                          "height_mm = 30.0\nlower_diameter_mm = 20.0\nupper_diameter_mm = 20.0\n");
  meshing::PlacedStone stone;
  stone.number = 1;
  stone.scale_mm = 3.0;
  stone.model_from_stone.translation_mm = {10.0, 14.0, 0.5};
  ASSERT_TRUE(meshing::write_stone_plan(std::vector{stone}, scratch / "stones.json"));
  const auto o =
      run(fmt::format("verify {} --design {} --json --quiet --out {} --machine portal_mill_2500 "
                      "--tools {} --stones "
                      "{} --cell-mm 0.25",
                      program.string(), d.string(), out.string(), tools.string(),
                      (scratch / "stones.json").string()));
  EXPECT_EQ(o.exit_code, 1) << o.err;
  EXPECT_THAT(o.err, AllOf(HasSubstr("holder or shank meets material"),
                           HasSubstr("the cutter meets stones in 1 moves, first at x "),
                           HasSubstr("holder or shank meets stones in "), HasSubstr("two.ngc:10")));
  const json c = json::parse(slurp(out / "certificate.json"));
  EXPECT_GT(c["holder_collisions"], 0);
  EXPECT_EQ(c["stone_collisions"], 1) << "the pass over it";
  EXPECT_EQ(c["first_stone_collisions"][0]["line"], 10);
  // The holder of 20 mm is there as soon as its ball is down beside the stone.
  EXPECT_GE(c["stone_holder_collisions"], 2);
  EXPECT_EQ(c["first_stone_holder_collisions"][0]["line"], 9);
  ASSERT_EQ(c["machining_time"].size(), 2U);
  EXPECT_EQ(c["machining_time"][1]["program"], "two.ngc");
  EXPECT_EQ(c["machining_time"][1]["tool"], 2);
  // 16 mm and the way down from 8 at 300 mm/min; the machine's acceleration adds some.
  EXPECT_NEAR(c["machining_time"][1]["cutting_min"], 23.5 / 300.0, 0.003);
  EXPECT_GT(c["machining_time"][1]["cutting_min"], 23.5 / 300.0);
  EXPECT_GT(c["machining_time"][0]["rapid_min"], 0.0);
}

/// A flat cutter, a shank and a holder beside a stone that stands: with place and line, or not at
/// all.
TEST_F(CommandLine, NothingMayMeetStandingStones) {
  heightmap::ModelField flat{Grid<float>(81, 81, 0.0F), Millimetres{0.5}, {}, {}};
  const fs::path d = scratch / "flat.tif";
  ASSERT_TRUE(heightmap::write_model_field(flat, d));
  meshing::PlacedStone stone;  // about (20, 20), radius 5 mm at most
  stone.number = 1;
  stone.scale_mm = 5.0;
  stone.model_from_stone.translation_mm = {20.0, 20.0, 0.0};
  ASSERT_TRUE(meshing::write_stone_plan(std::vector{stone}, scratch / "stones.json"));
  const std::string stones = (scratch / "stones.json").string();
  const auto tools = file("tools.toml",
                          "[[tool]]\nnumber = 1\nshape = \"flat\"\ndiameter_mm = 4.0\n[[tool]]\n"
                          "number = 2\nshape = \"ball\"\ndiameter_mm = 4.0\nflute_length_mm = "
                          "0.6\nstick_out_mm = 0.8\n[[tool.holder]]\nheight_mm = 30.0\n"
                          "lower_diameter_mm = 16.0\nupper_diameter_mm = 16.0\n");
  const auto verify = [&](const std::string& moves) {
    const auto program = file("p.ngc", "G21 G90 G64 P0.01\n" + moves + "M2\n");
    const auto o = run(fmt::format(
        "verify {} --design {} --json --quiet --out {} --tools {} --stones {} --cell-mm 0.25",
        program.string(), d.string(), out.string(), tools.string(), stones));
    return std::pair{o, json::parse(slurp(out / "certificate.json"))};
  };
  // T1 goes through the stone in line 5, and beside it in line 8.
  const auto [hit, c] = verify(
      "T1 M6\nG0 X5 Y20 Z9\nG1 Z0.5 F500\nX35\nG0 Z9\nG0 X5 Y30\nG1 Z0.5 F500\nX35\nG0 Z9\n");
  EXPECT_EQ(hit.exit_code, 1);
  EXPECT_THAT(hit.err,
              AllOf(HasSubstr("the cutter meets stones in 1 moves"), HasSubstr("p.ngc:5")));
  EXPECT_EQ(c["stone_collisions"], 1);
  EXPECT_EQ(c["stone_holder_collisions"], 0);
  // T2's ball passes 8 mm beside the middle, its holder of radius 8 mm 3 mm above the ground does
  // not.
  const auto [near, n] = verify("T2 M6\nG0 X5 Y27 Z29\nG1 Z0 F500\nX35\nG0 Z29\n");
  EXPECT_EQ(near.exit_code, 1);
  EXPECT_THAT(near.err, HasSubstr("holder or shank meets stones in 1 moves, first at x 35.000 y "
                                  "27.000 z 0.000 by"));
  EXPECT_EQ(n["stone_collisions"], 0);
  ASSERT_EQ(n["first_stone_holder_collisions"].size(), 1U);
  EXPECT_EQ(n["first_stone_holder_collisions"][0]["line"], 5);
  const auto [clear, k] = verify("T2 M6\nG0 X5 Y34 Z29\nG1 Z0 F500\nX35\nG0 Z29\n");
  EXPECT_EQ(k["stone_collisions"], 0);
  EXPECT_EQ(k["stone_holder_collisions"], 0);

  const auto mill = [&](const std::string& more) {
    return run(fmt::format("mill {} --quiet --out {} {}", d.string(),
                           (scratch / "part.ngc").string(), more));
  };
  const auto rejected = mill("--standing-stones " + stones);
  EXPECT_EQ(rejected.exit_code, 1);
  EXPECT_THAT(rejected.err, AllOf(HasSubstr("the cutter meets stones in"), HasSubstr("part.ngc:"),
                                  HasSubstr("part.ngc.rejected")));
  EXPECT_FALSE(fs::exists(scratch / "part.ngc"));
  EXPECT_TRUE(fs::exists(scratch / "part.ngc.rejected"));
  EXPECT_EQ(mill("").exit_code, 0);
}

TEST_F(CommandLine, GcodeThatIsCutOff) {
  const auto program = file("part.ngc", "G21 G90\nG1 X1 Y1 Z-1 F100\nG1 X2");
  expect_refused(run("verify " + program.string() + " --design " + design().string() + " --out " +
                     out.string()),
                 HasSubstr("part.ngc:3"));
}

TEST_F(CommandLine, StoneLargerThanTheSite) {
  const auto site = file("site.toml",
                         "size_mm = 20.0\n[stones]\nmin_diameter_m = 500.0\nmax_diameter_m = "
                         "900.0\n");
  const auto o = run("run " + site.string() + " --quiet --out " + out.string());
  EXPECT_EQ(o.exit_code, 2) << o.err;
  EXPECT_THAT(o.err, HasSubstr("stone"));
  EXPECT_FALSE(fs::exists(out / "s1000/stones.json"));
}

TEST_F(CommandLine, StonesOfYourOwn) {
  const std::string box =
      "v 0 0 0\nv 4 0 0\nv 4 3 0\nv 0 3 0\nv 0 0 2\nv 4 0 2\nv 4 3 2\nv 0 3 2\n"
      "f 4 3 2 1\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\n";
  file("whole.obj", box + "f 4 1 5 8\n");
  file("open.obj", box);
  const std::string d = design().string();
  const auto lay = [&](const std::string& stone) {
    const auto site = file("site.toml",
                           "size_mm = 20.0\nscales = [1000.0]\n[stones]\ncount = 0\n"
                           "[[stone]]\nunit = \"cm\"\n" +
                               stone);
    return run("stones " + site.string() + " --quiet --design " + d + " --scale 1000 --out " +
               out.string());
  };
  expect_refused(lay("file = \"open.obj\"\n"),
                 AllOf(HasSubstr("open.obj: is not closed: 1 hole"), HasSubstr("mesh editor")));
  expect_refused(lay("file = \"none.obj\"\n"), HasSubstr("none.obj"));
  expect_refused(lay("file = \"whole.obj\"\nplaces_m = [1.0]\n"), HasSubstr("places_m has 1"));
  const auto o = lay("file = \"whole.obj\"\nscale = 100.0\ncount = 0\nplaces_m = [1.0, -2.0]\n");
  ASSERT_EQ(o.exit_code, 0) << o.err;
  const json plan = json::parse(slurp(out / "stones.json"));
  EXPECT_EQ(plan["bodies"][0]["source"], "whole.obj");
  EXPECT_EQ(plan["bodies"][0]["mm_per_unit"], 10.0);
  EXPECT_EQ(plan["stones"][0]["shape"]["body"], "whole");
  EXPECT_TRUE(fs::exists(out / "stone_bodies/whole.ply"));
  const auto stones = meshing::read_stone_plan(out / "stones.json");
  ASSERT_TRUE(stones.has_value());
  ASSERT_EQ(stones->size(), 1U);
  // 40 mm at 1:100 are 4 m, and 4 mm at 1:1000: a box of 4 x 3 x 2 has the area of that circle.
  EXPECT_NEAR((*stones)[0].scale_mm, std::sqrt(4.0 * 12.0 / std::numbers::pi), 1e-9);
  EXPECT_NEAR((*stones)[0].model_from_stone.translation_mm.x, 11.0, 1e-9);
  EXPECT_NEAR((*stones)[0].model_from_stone.translation_mm.y, 8.0, 1e-9);
}

TEST_F(CommandLine, DamagedPointCloud) {
  design();
  file("scan.ply",
       "ply\nformat binary_little_endian 1.0\nelement vertex 1000000\n"
       "property float x\nproperty float y\nproperty float z\nend_header\nabc");
  const auto c = file("case.toml", "design = \"design.tif\"\n[[scan]]\npoints = \"scan.ply\"\n");
  expect_refused(run("deviate " + c.string() + " --out " + out.string()), HasSubstr("scan.ply"));
}

TEST_F(CommandLine, CaseWithoutMeasurement) {
  design();
  const auto c = file("case.toml", "design = \"design.tif\"\n");
  expect_refused(run("deviate " + c.string() + " --out " + out.string()), HasSubstr("[[scan]]"));
}

TEST_F(CommandLine, FolderThatCannotBeWritten) {
  const auto site = file("site.toml", "size_mm = 20.0\n");
  expect_refused(run("run " + site.string() + " --out /proc/maquette"), HasSubstr("/proc/maquette"),
                 3);
  expect_refused(run("mill " + design().string() + " --out /proc/x.ngc"), HasSubstr("/proc/x.ngc"),
                 3);
}

TEST_F(CommandLine, DiskThatIsFull) {
  // A file system of 64 kB in a name space of our own; the kernel may forbid that.
  const fs::path tiny = scratch / "tiny";
  fs::create_directories(tiny);
  const std::string mount = fmt::format("mount -t tmpfs -o size=64k none '{}'", tiny.string());
  if (std::system(("unshare -r -m sh -c \"" + mount + "\" 2>/dev/null").c_str()) != 0)
    GTEST_SKIP() << "no small file system can be mounted here (unshare -r -m)";
  const auto d = design();
  std::ofstream(scratch / "full.sh")
      << mount << "\n'" << testing_support::maquette_program().string() << "' --quiet export '"
      << d.string() << "' --format ply --out '" << tiny.string() << "'\ncode=$?\nls -A '"
      << tiny.string() << "' | wc -l > '" << (scratch / "left").string() << "'\nexit $code\n";
  const int status =
      std::system(fmt::format("unshare -r -m sh '{}' 2>'{}' >/dev/null",
                              (scratch / "full.sh").string(), (scratch / "err").string())
                      .c_str());
  EXPECT_EQ(WEXITSTATUS(status), 3);
  EXPECT_THAT(slurp(scratch / "err"), HasSubstr("disk is full"));
  EXPECT_EQ(slurp(scratch / "left"), "0\n") << "a partial file is left";
}

TEST_F(CommandLine, InitNeverOverwrites) {
  const fs::path site = scratch / "mine.toml";
  ASSERT_EQ(run("init --out " + site.string()).exit_code, 0);
  const std::string text = slurp(site);
  EXPECT_THAT(text, AllOf(HasSubstr("size_mm = 200"), HasSubstr("# ")));
  std::ofstream(site, std::ios::app) << "# mine\n";
  const auto again = run("init --out " + site.string());
  EXPECT_EQ(again.exit_code, 2);
  EXPECT_THAT(again.err, HasSubstr("exists"));
  EXPECT_EQ(slurp(site), text + "# mine\n");
}

TEST_F(CommandLine, AToleranceThatIsNotMetIsExitCodeOne) {
  const auto d = design();
  ASSERT_EQ(run("mill " + d.string() + " --out " + (scratch / "part.ngc").string()).exit_code, 0);
  const std::string verify = "verify " + (scratch / "part.ngc").string() + " --design " +
                             d.string() + " --out " + out.string() + " --max-gouge-mm ";
  EXPECT_EQ(run(verify + "0.02").exit_code, 0);
  const auto strict = run(verify + "0");
  EXPECT_EQ(strict.exit_code, 1);
  EXPECT_THAT(strict.err, HasSubstr("above the limit"));
  EXPECT_TRUE(fs::exists(out / "certificate.json")) << "the figures are wanted all the same";
}

TEST_F(CommandLine, BackplotOfAnyProgram) {
  const auto program = file("part.ngc", "G21 G90\nG0 X0 Y0 Z5\nG1 Z-1 F100\nX20 Y9\nG0 Z5\nM2\n");
  const std::string backplot = "backplot " + program.string() + " --out ";
  for (const char* name : {"a.svg", "a.png", "a.html"}) {
    const auto o = run(backplot + (scratch / name).string());
    EXPECT_EQ(o.exit_code, 0) << o.err;
    EXPECT_GT(slurp(scratch / name).size(), 2000U) << name;
  }
  EXPECT_THAT(slurp(scratch / "a.svg"), HasSubstr("feed, mm/min"));
  const auto cut = run(backplot + (scratch / "b.svg").string() + " --colour engagement --design " +
                       design().string());
  EXPECT_EQ(cut.exit_code, 0) << cut.err;
  EXPECT_THAT(slurp(scratch / "b.svg"), HasSubstr("engagement, mm³"));
  expect_refused(run(backplot + (scratch / "c.svg").string() + " --colour engagement"),
                 HasSubstr("--design"));
  expect_refused(run(backplot + (scratch / "c.pdf").string()), HasSubstr(".svg, .png or .html"));
  const auto bad = file("bad.ngc", "G21 G90\nG1 X\nM2\n");
  expect_refused(run("backplot " + bad.string() + " --out " + (scratch / "c.svg").string()),
                 HasSubstr("bad.ngc:2:"));
  EXPECT_FALSE(fs::exists(scratch / "c.svg"));
}

TEST_F(CommandLine, ErrorsAreJsonForPrograms) {
  const auto o = run("--json mill nowhere.tif --out x.ngc");
  EXPECT_EQ(o.exit_code, 2);
  const json j = json::parse(o.out);
  EXPECT_EQ(j["error"]["code"], "CORE_FILE_NOT_FOUND");
  EXPECT_EQ(j["exit_code"], 2);
}

TEST_F(CommandLine, ErrorsHaveStableCodes) {
  const auto code = [&](const std::string& arguments, const std::string& before = "") {
    return json::parse(run("--json --quiet " + arguments, before).out)["error"]["code"]
        .get<std::string>();
  };
  const auto d = design().string();
  EXPECT_EQ(code("init --out " + d), "TOOLS_FILE_EXISTS");
  EXPECT_EQ(code("export " + d + " --format stll"), "TOOLS_UNKNOWN_FORMAT");
  EXPECT_EQ(code("mill " + d + " --machine nonesuch"), "CNC_UNKNOWN_MACHINE");
  EXPECT_EQ(code("scan " + d + " --scanner nonesuch"), "TOOLS_UNKNOWN_NAME");
  EXPECT_EQ(code("run x.toml --shard 1/2 --merge"), "TOOLS_USAGE");
  // A limit on the size of files stands for the full disk where none can be mounted.
  EXPECT_EQ(
      code("export " + d + " --format ply --out " + out.string(), "trap '' XFSZ; ulimit -f 8;"),
      "CORE_DISK_FULL");
  for (const auto& e : fs::directory_iterator(out)) ADD_FAILURE() << e.path() << " is left";
}

TEST_F(CommandLine, ResultsAreOneJsonDocument) {
  const auto o =
      run("export " + design().string() + " --json --quiet --format stl,obj --out " + out.string());
  ASSERT_EQ(o.exit_code, 0) << o.err;
  EXPECT_EQ(json::parse(o.out).size(), 2U);
  EXPECT_EQ(o.err, "");
}

TEST_F(CommandLine, BandsKeepOffStones) {
  std::vector<meshing::PlacedStone> stones(2);
  for (std::size_t i = 0; i < 2; ++i) {
    stones[i].number = 4 + static_cast<int>(i);
    stones[i].scale_mm = i == 0 ? 3.0 : 12.0;
    stones[i].model_from_stone.translation_mm = {i == 0 ? 10.0 : 5.0, 10.0, -0.6};
  }
  const fs::path plan = scratch / "stones.json";
  ASSERT_TRUE(meshing::write_stone_plan(std::span(stones).first(1), plan));
  const std::string verb = "bands " + design().string() + " --stones " + plan.string() + " --out " +
                           out.string() + " --quiet ";
  const auto joints = [&] { return json::parse(slurp(out / "bands.json"))["joints"]; };
  for (const char* how : {"--count 2", "--max-width-mm 13", "--axis x --count 2"}) {
    SCOPED_TRACE(how);
    const auto o = run(verb + how);
    ASSERT_EQ(o.exit_code, 0) << o.err;
    ASSERT_EQ(joints().size(), 1U);
    const double at = joints()[0]["at_mm"];
    const Box3 box = meshing::stone_mesh(stones[0]).bounds();
    const bool x = std::string(how).starts_with("--axis x");
    EXPECT_TRUE(at < (x ? box.min.x : box.min.y) - 1.0 || at > (x ? box.max.x : box.max.y) + 1.0);
    const Box3 band = meshing::read_mesh(out / "band_02.ply")->bounds();
    EXPECT_EQ(x ? band.min.x : band.min.y, at);
    EXPECT_TRUE(fs::exists(out / "exploded.png"));
    EXPECT_NE(slurp(out / "exploded.svg").find("band 2"), std::string::npos);
  }
  // The template has the same joints.
  const fs::path parts = scratch / "parts";
  ASSERT_EQ(run("stone-parts " + plan.string() + " --design " + design().string() + " --bands " +
                (out / "bands.json").string() + " --quiet --out " + parts.string())
                .exit_code,
            0);
  EXPECT_NE(slurp(parts / "placing.dxf").find("JOINT"), std::string::npos);
  const auto other = run("stone-parts " + plan.string() + " --design " + design().string() +
                         " --bands " + plan.string() + " --quiet --out " + parts.string());
  EXPECT_EQ(other.exit_code, 2);
  EXPECT_THAT(other.err, HasSubstr("maquette.bands/1"));

  // Carried: the band with the stone is larger than the plain one, in tiles as in strips.
  const auto volume = [&](const std::string& name) {
    return json::parse(slurp(out / (name + ".certificate.json")))["volume_mm3"].get<double>();
  };
  ASSERT_EQ(run(verb + "--count 2").exit_code, 0);
  const double plain = volume("band_01") + volume("band_02");
  ASSERT_EQ(run(verb + "--count 2 --with-stones").exit_code, 0);
  EXPECT_GT(volume("band_01") + volume("band_02"), plain + 1.0);
  ASSERT_EQ(run(verb + "--max-width-mm 15 --max-length-mm 15 --with-stones").exit_code, 0);
  const json tiles = json::parse(slurp(out / "tiles.json"));
  EXPECT_GT(tiles["volume_mm3"].get<double>(), plain + 1.0);
  std::size_t carried = 0;
  for (const json& t : tiles["tiles"]) carried += t["stones"].size();
  EXPECT_EQ(carried, 1U);
  // Whatever is below is of one piece with the stones on it, too.
  ASSERT_EQ(run(verb + "--count 2 --with-stones --base-thickness-mm 12 --hollow-mm 1 --rib-mm 1 "
                       "--pocket-mm 9 --label N --letter-mm 2")
                .exit_code,
            0);
  for (const char* name : {"band_01", "band_02"}) {
    const json said = json::parse(slurp(out / (std::string(name) + ".certificate.json")));
    EXPECT_EQ(said["passed"], true);
    EXPECT_TRUE(said.contains("hollow") && said.contains("engraved") && said.contains("stones"));
  }

  // A stone wider than any place that the joint may have.
  ASSERT_TRUE(meshing::write_stone_plan(stones, plan));
  const auto met = run("bands " + design().string() + " --stones " + plan.string() + " --out " +
                       out.string() + " --count 2");
  ASSERT_EQ(met.exit_code, 0);
  EXPECT_THAT(met.err, AllOf(HasSubstr("joint 1 at y ="), HasSubstr("passes through stone 5")));
  EXPECT_THAT(joints()[0]["through_stones"], testing::ElementsAre(5));
}

TEST_F(CommandLine, TilesAddUpToTheWholeAndStandInTheirOwnFrame) {
  const std::string d = design().string();
  ASSERT_EQ(run("mesh " + d + " --quiet --out " + (scratch / "whole.ply").string()).exit_code, 0);
  const json whole = json::parse(slurp(scratch / "whole.certificate.json"));
  ASSERT_EQ(run("bands " + d + " --quiet --max-width-mm 9 --max-length-mm 7 --own-frame --out " +
                (scratch / "tiles").string())
                .exit_code,
            0);
  const json tiles = json::parse(slurp(scratch / "tiles/tiles.json"));
  EXPECT_GE(tiles["tiles"].size(), 4U);
  const double volume = whole["volume_mm3"];
  EXPECT_NEAR(tiles["volume_mm3"], volume, 1e-9 * volume);
  for (const json& t : tiles["tiles"]) {
    const auto mesh = meshing::read_mesh(scratch / "tiles" / t["file"].get<std::string>());
    ASSERT_TRUE(mesh.has_value());
    const Box3 box = mesh->bounds();
    EXPECT_EQ(box.min, (Vec3{0.0, 0.0, 0.0}));
    EXPECT_DOUBLE_EQ(box.max.x, t["x_mm"][1].get<double>() - t["x_mm"][0].get<double>());
    EXPECT_DOUBLE_EQ(box.max.y, t["y_mm"][1].get<double>() - t["y_mm"][0].get<double>());
  }
  EXPECT_NE(slurp(scratch / "tiles/tiles.svg").find("<rect"), std::string::npos);
}

TEST_F(CommandLine, StepFilesAreWholeOrBandByBand) {
  const std::string d = design().string();
  const auto certificate = [&](const std::string& name) {
    return json::parse(slurp(out / (name + ".step.certificate.json")));
  };
  ASSERT_EQ(run("export " + d + " --quiet --format step --out " + out.string()).exit_code, 0);
  const json whole = certificate("design");
  EXPECT_EQ(whole["nodes_compared"], 41 * 41);
  EXPECT_LE(whole["max_error_mm"], 0.02);
  ASSERT_EQ(run("export " + d +
                " --quiet --format step --step-band-mm 11 --step-schema ap214 "
                "--step-tolerance-mm 0.001 --out " +
                out.string())
                .exit_code,
            0);
  double volume = 0.0;
  for (const char* name : {"design_band_01", "design_band_02"}) {
    EXPECT_EQ(certificate(name)["nodes_compared"], 21 * 41) << "the joint's nodes are in both";
    EXPECT_LE(certificate(name)["max_error_mm"], 0.001);
    EXPECT_THAT(slurp(out / (std::string(name) + ".step")).substr(0, 600),
                HasSubstr("AUTOMOTIVE_DESIGN"));
    volume += certificate(name)["volume_mm3"].get<double>();
  }
  // Tolerance times area is the most that the volumes may differ by.
  EXPECT_NEAR(volume, whole["volume_mm3"], 0.021 * 400);
  // Where `bands` has put the joint, and of an earlier run nothing is taken for a band of this one.
  meshing::PlacedStone stone;
  stone.number = 5;
  stone.scale_mm = 3.0;
  stone.model_from_stone.translation_mm = {9.0, 10.0, 0.0};
  ASSERT_TRUE(meshing::write_stone_plan(std::vector{stone}, scratch / "stones.json"));
  ASSERT_EQ(run("bands " + d + " --quiet --count 2 --stones " + (scratch / "stones.json").string() +
                " --out " + (scratch / "bands").string())
                .exit_code,
            0);
  const fs::path layout = scratch / "bands" / "bands.json";
  const int line = json::parse(slurp(layout))["joints"][0]["line"];
  ASSERT_NE(line, 20);
  const std::string step = "export " + d + " --quiet --format step --out " + out.string();
  ASSERT_EQ(run(step + " --bands " + layout.string()).exit_code, 0);
  EXPECT_EQ(certificate("design_band_01")["nodes_compared"], (line + 1) * 41);
  EXPECT_EQ(certificate("design_band_02")["nodes_compared"], (41 - line) * 41);
  EXPECT_EQ(run(step + " --step-band-mm 11 --bands " + layout.string()).exit_code, 2);
  const auto one = run(step);
  ASSERT_EQ(one.exit_code, 0);
  EXPECT_FALSE(fs::exists(out / "design_band_02.step"));
  EXPECT_TRUE(fs::exists(out / "earlier_1" / "design_band_02.step"));
  const auto mesh =
      run("export " + (scratch / "none.ply").string() + " --format step --out " + out.string());
  EXPECT_EQ(mesh.exit_code, 2);
  EXPECT_THAT(mesh.err, AllOf(HasSubstr("none.ply"), HasSubstr("height field")));
}

TEST_F(CommandLine, StonesGoToTheWorkshop) {
  const std::string d = design().string();
  std::vector<meshing::PlacedStone> stones(3);
  for (std::size_t i = 0; i < 3; ++i) {
    stones[i].number = static_cast<int>(i) + 1;
    stones[i].shape.seed = i == 1 ? 8 : 7;
    stones[i].scale_mm = 3.0;
    const double x = 4.0 + 5.0 * static_cast<double>(i);
    stones[i].model_from_stone = {rotation_about({0.6, 0.0, 0.8}, 0.4 * static_cast<double>(i)),
                                  {x, 9.0, std::sin(0.2 * (x + 9.0)) + 0.8}};
    stones[i].embedded_depth_mm = 0.3;
  }
  ASSERT_TRUE(meshing::write_stone_plan(stones, scratch / "stones.json"));
  const std::string verb = "stone-parts " + (scratch / "stones.json").string() + " --design " + d +
                           " --out " + out.string() + " ";
  const auto o = run(verb + "--quiet --clearance-mm 0.05 --build-mm 8 8 8 --joints-mm 11");
  ASSERT_EQ(o.exit_code, 0) << o.err;
  const json made = json::parse(slurp(out / "stone_parts.json"));
  EXPECT_EQ(made["distinct_parts"], 2);
  EXPECT_EQ(made["parts"][0]["stones"].size() + made["parts"][1]["stones"].size(), 3U);
  EXPECT_GE(made["builds"], 1);
  for (const json& f : made["files"]) {
    const fs::path path = out / f["file"].get<std::string>();
    EXPECT_EQ(sha256_file(path).value(), f["sha256"]) << path;
    EXPECT_EQ(fs::file_size(path), f["bytes"]);
  }
  // Parts: what STL holds is as large as the list says, and closed.
  for (const json& p : made["parts"]) {
    const auto mesh = meshing::read_mesh(out / "parts" / (p["part"].get<std::string>() + ".stl"));
    ASSERT_TRUE(mesh.has_value());
    const Box3 box = mesh->bounds();
    EXPECT_NEAR(norm(box.min), 0.0, 1e-6);
    EXPECT_NEAR(box.max.x, p["size_mm"][0].get<double>(), 1e-5);
    EXPECT_GT(p["clearance_mm"][0], 0.04);
  }
  // The list gives each rotation back: the long axis above its heading, across the tilted axis.
  std::istringstream table(slurp(out / "placing.csv"));
  std::string line;
  std::getline(table, line);
  for (const auto& stone : stones) {
    ASSERT_TRUE(std::getline(table, line));
    std::vector<double> v;
    std::istringstream row(line);
    for (std::string cell; std::getline(row, cell, ',');) v.push_back(std::atof(cell.c_str()));
    ASSERT_EQ(v.size(), 11U);
    EXPECT_EQ(v[0], stone.number);
    constexpr double kRad = std::numbers::pi / 180;
    const Vec3 up{std::sin(v[8] * kRad) * std::cos(v[9] * kRad),
                  std::sin(v[8] * kRad) * std::sin(v[9] * kRad), std::cos(v[8] * kRad)};
    const double c = std::cos(v[7] * kRad), s = std::sin(v[7] * kRad);
    const Vec3 along = normalized(Vec3{c, s, -(up.x * c + up.y * s) / up.z});
    const Quaternion q = stone.model_from_stone.rotation;
    // Angles are given to 0.01 degrees.
    EXPECT_NEAR(norm(rotate(q, {0, 0, 1}) - up), 0.0, 3e-4);
    EXPECT_NEAR(norm(rotate(q, {1, 0, 0}) - along), 0.0, 5e-4);
    EXPECT_NEAR(v[6], meshing::stone_mesh(stone).bounds().min.z, 1e-3);
  }
  EXPECT_EQ(run(verb + "--quiet --wall-mm 2.9").exit_code, 1) << "walls that the parts lack";
  const auto too_small = run(verb + "--build-mm 2 8 8");
  EXPECT_EQ(too_small.exit_code, 2);
  EXPECT_THAT(too_small.err, AllOf(HasSubstr("stones.json"), HasSubstr("build volume")));
  const auto nothing = run(verb + "--clearance-mm 1.5");
  EXPECT_EQ(nothing.exit_code, 2);
  EXPECT_THAT(nothing.err, AllOf(HasSubstr("part S00"), HasSubstr("clearance of 1.5 mm")));
}

TEST_F(CommandLine, DowelsHoldTilesTogether) {
  const std::string d = design().string();
  const std::string verb = "bands " + d + " --max-width-mm 11 --out " + out.string() + " ";
  ASSERT_EQ(run(verb + "--quiet --dowel-mm 1.5 --dowel-depth-mm 2 --dowel-wall-mm 0.5").exit_code,
            0);
  const json tiles = json::parse(slurp(out / "tiles.json"));
  ASSERT_EQ(tiles["tiles"].size(), 2U);
  ASSERT_EQ(tiles["dowels"]["places"].size(), 2U);
  EXPECT_NEAR(tiles["dowels"]["pin_length_mm"].get<double>(), 3.8, 1e-12);
  EXPECT_GT(fs::file_size(out / "pins.3mf"), 500U);
  ASSERT_EQ(run("mesh " + d + " --quiet --out " + (scratch / "whole.ply").string()).exit_code, 0);
  const double whole = json::parse(slurp(scratch / "whole.certificate.json"))["volume_mm3"];
  EXPECT_NEAR(
      tiles["volume_mm3"].get<double>() + 4.0 * tiles["dowels"]["hole_volume_mm3"].get<double>(),
      whole, 1e-9 * whole);
  EXPECT_THAT(slurp(out / "tiles.svg"), HasSubstr("<line"));
  fs::remove_all(out);
  expect_refused(run(verb + "--dowel-mm 8"), AllOf(HasSubstr("design.tif"), HasSubstr("base of")));
}

TEST_F(CommandLine, ACoatedSolidHasItsUndercoatBesideIt) {
  const std::string d = design().string();
  ASSERT_EQ(run("mesh " + d + " --quiet --out " + (scratch / "whole.ply").string()).exit_code, 0);
  ASSERT_EQ(run("mesh " + d + " --quiet --coating-mm 0.2 --out " + (scratch / "bare.ply").string())
                .exit_code,
            0);
  EXPECT_TRUE(fs::exists(scratch / "bare.undercoat.tif"));
  // Lower by the coat along the normal everywhere, so by no less than the coat; the base
  // follows the lowest node.
  const auto top = [](const fs::path& path) { return meshing::read_mesh(path)->bounds().max.z; };
  EXPECT_LE(top(scratch / "bare.ply"), top(scratch / "whole.ply") - 0.2 + 1e-5);
  expect_refused(run("mesh " + d + " --coating-mm 100 --out " + (scratch / "x.ply").string()),
                 HasSubstr("coat of 100 mm"));
}

TEST_F(CommandLine, ASolidIsFilletedAndMoved) {
  const std::string verb = "mesh " + bowl().string() + " --quiet --out ";
  ASSERT_EQ(
      run(verb + (scratch / "part.ply").string() + " --fillet-mm 3 --offset-mm -0.5").exit_code, 0);
  // Each from what the one before left.
  const auto fillet = heightmap::read_model_field(scratch / "part.fillet.tif").value();
  const auto moved = heightmap::read_model_field(scratch / "part.offset.tif").value();
  const auto design = heightmap::read_model_field(scratch / "bowl.tif").value();
  bool raised = false;
  for (std::size_t i = 0; i < design.z_mm.cells().size(); ++i) {
    ASSERT_GE(fillet.z_mm.cells()[i], design.z_mm.cells()[i]);
    ASSERT_LE(moved.z_mm.cells()[i], fillet.z_mm.cells()[i] - 0.499F);
    raised = raised || fillet.z_mm.cells()[i] > design.z_mm.cells()[i] + 0.02F;
  }
  EXPECT_TRUE(raised);
  const auto top = meshing::read_mesh(scratch / "part.ply")->bounds().max.z;
  EXPECT_EQ(top, static_cast<double>(heightmap::height_range(moved.z_mm).max));
  // With a stone: what is changed is both together, and the solid has no stones of its own.
  const std::vector stones{
      testing_support::placed_rock(3, design, design.x_mm(20), design.y_mm(20), 4.0)};
  ASSERT_TRUE(meshing::write_stone_plan(stones, scratch / "stones.json"));
  ASSERT_EQ(run(verb + (scratch / "stony.ply").string() + " --fillet-mm 2 --stones " +
                (scratch / "stones.json").string())
                .exit_code,
            0);
  const auto relief = heightmap::read_model_field(scratch / "stony.relief.tif").value();
  const auto round = heightmap::read_model_field(scratch / "stony.fillet.tif").value();
  EXPECT_EQ(relief.z_mm, meshing::with_stones(design, stones).z_mm);
  bool beside = false;
  for (std::size_t i = 0; i < relief.z_mm.cells().size(); ++i) {
    ASSERT_GE(round.z_mm.cells()[i], relief.z_mm.cells()[i]);
    beside = beside || (round.z_mm.cells()[i] > fillet.z_mm.cells()[i] + 0.02F &&
                        relief.z_mm.cells()[i] == design.z_mm.cells()[i]);
  }
  EXPECT_TRUE(beside) << "no round at the stone's foot";
  EXPECT_EQ(json::parse(slurp(scratch / "stony.certificate.json"))["proof"], "graph of a height");
  // A coat goes over both, too.
  ASSERT_EQ(run(verb + (scratch / "bare.ply").string() + " --coating-mm 0.5 --stones " +
                (scratch / "stones.json").string())
                .exit_code,
            0);
  EXPECT_EQ(heightmap::read_model_field(scratch / "bare.undercoat.tif").value().z_mm,
            cnc::undercoat(meshing::with_stones(design, stones), Millimetres{0.5})->surface.z_mm);
  out = scratch / "x.ply";
  expect_refused(run(verb + out.string() + " --offset-mm 60"), HasSubstr("offset of 60 mm"));
}

TEST_F(CommandLine, AHollowSolidHasItsLabel) {
  const std::string verb = "mesh " + design().string() + " --quiet --base-thickness-mm 12 --out ";
  ASSERT_EQ(
      run(verb + (scratch / "part.ply").string() +
          " --hollow-mm 1.5 --rib-mm 1 --pocket-mm 8 --label 'N 1' --letter-mm 3 --label-side "
          "west")
          .exit_code,
      0);
  const json said = json::parse(slurp(scratch / "part.certificate.json"));
  EXPECT_EQ(said["passed"], true);
  EXPECT_EQ(said["hollow"]["pockets"], json({2, 2}));
  EXPECT_EQ(said["engraved"][0]["what"], "\"N 1\"");
  // West and east at 0 and 20 mm: pockets begin behind wall and groove.
  const std::string file = (scratch / "x.ply").string();
  out = file;
  expect_refused(run(verb + file + " --hollow-mm 1.5 --label 'far too long for that wall'"),
                 AllOf(HasSubstr("design.tif"), HasSubstr("the southern wall 20 mm")));
  expect_refused(run(verb + file + " --label '#1'"), HasSubstr("cannot be engraved: #"));
  expect_refused(run(verb + file + " --hollow-mm 12"), HasSubstr("between the side walls"));
  expect_refused(run(verb + file + " --letter-mm 3"), HasSubstr("--letter-mm"));
  expect_refused(run(verb + file + " --label ''"), HasSubstr("--label: an empty text"));
}

TEST_F(CommandLine, BandsAreHollowAndNumbered) {
  const std::string verb = "bands " + design().string() + " --max-width-mm 11 --out " +
                           out.string() + " --quiet --base-thickness-mm 14 ";
  ASSERT_EQ(run(verb + "--hollow-mm 1 --rib-mm 1 --pocket-mm 9 --label N --letter-mm 2").exit_code,
            0);
  double volume = 0.0, base = NAN;
  for (const std::string band : {"band_01", "band_02"}) {
    const json said = json::parse(slurp(out / (band + ".certificate.json")));
    EXPECT_EQ(said["passed"], true);
    EXPECT_EQ(said["engraved"][0]["what"], band == "band_01" ? "\"N 1\"" : "\"N 2\"");
    volume += said["volume_mm3"].get<double>() + said["hollow"]["removed_mm3"].get<double>() +
              said["engraved"][0]["removed_mm3"].get<double>();
    const Box3 box = meshing::read_mesh(out / (band + ".ply"))->bounds();
    if (std::isnan(base)) base = box.min.z;
    EXPECT_EQ(box.min.z, base) << band;
  }
  ASSERT_EQ(run("mesh " + design().string() + " --quiet --base-thickness-mm 14 --out " +
                (scratch / "whole.ply").string())
                .exit_code,
            0);
  const double whole = json::parse(slurp(scratch / "whole.certificate.json"))["volume_mm3"];
  EXPECT_NEAR(volume, whole, 1e-9 * whole);
}

TEST_F(CommandLine, TilesAreHollowNumberedAndHeldByDowelsAndMagnets) {
  const std::string verb = "bands " + design().string() + " --max-width-mm 11 --out " +
                           out.string() + " --quiet --base-thickness-mm 8 ";
  const std::string holes =
      "--dowel-mm 1.2 --dowel-depth-mm 1.5 --dowel-wall-mm 0.4 --dowel-spacing-mm 8 "
      "--magnet-mm 1.5 --magnet-depth-mm 0.8 --magnet-wall-mm 0.4 ";
  ASSERT_EQ(
      run(verb + holes +
          "--hollow-mm 0.8 --rib-mm 0.8 --pocket-mm 9 --label N --letter-mm 2 --label-side east")
          .exit_code,
      0);
  const json tiles = json::parse(slurp(out / "tiles.json"));
  ASSERT_EQ(tiles["tiles"].size(), 2U);
  double volume = tiles["volume_mm3"];
  for (const json& t : tiles["tiles"]) {
    EXPECT_EQ(t["engraved"][0]["what"], fmt::format("\"N {}\"", t["number"].get<int>()));
    volume +=
        t["hollow"]["removed_mm3"].get<double>() + t["engraved"][0]["removed_mm3"].get<double>();
    const std::string file = t["file"];
    const json said =
        json::parse(slurp(out / (file.substr(0, file.size() - 4) + ".certificate.json")));
    EXPECT_EQ(said["passed"], true);
    EXPECT_EQ(said["hollow"], t["hollow"]);
  }
  for (const char* kind : {"dowels", "magnets"}) {
    ASSERT_GE(tiles[kind]["places"].size(), 1U) << kind;
    volume += 2.0 * static_cast<double>(tiles[kind]["places"].size()) *
              tiles[kind]["hole_volume_mm3"].get<double>();
  }
  EXPECT_EQ(tiles["magnets"]["north_pole_outwards"], json({"east", "north"}));
  ASSERT_EQ(run("mesh " + design().string() + " --quiet --base-thickness-mm 8 --out " +
                (scratch / "whole.ply").string())
                .exit_code,
            0);
  const double whole = json::parse(slurp(scratch / "whole.certificate.json"))["volume_mm3"];
  EXPECT_NEAR(volume, whole, 1e-9 * whole);
  // Magnets alone hold, too.
  fs::remove_all(out);
  ASSERT_EQ(run(verb + "--magnet-mm 1.5 --magnet-depth-mm 0.8 --magnet-wall-mm 0.4").exit_code, 0);
  EXPECT_EQ(json::parse(slurp(out / "tiles.json"))["magnets"]["places"].size(), 2U);
  fs::remove_all(out);
  expect_refused(run(verb + holes + "--hollow-mm 7.5"),
                 AllOf(HasSubstr("tile 1"), HasSubstr("between the side walls")));
  expect_refused(run(verb + "--magnet-depth-mm 2"), HasSubstr("--magnet-mm"));
}

TEST_F(CommandLine, ASiteSaysHowItsSolidsAreShaped) {
  const std::string verb =
      "run '" + testing_support::source_folder().string() +
      "/assets/sites/default.toml' --quiet --set size_mm=40 --set stones.count=3 "
      "--set bands.max_width_mm=21 --set bands.avoid_stones=false --set solid.hollow_mm=1.5 "
      "--set solid.rib_mm=1 "
      "--set solid.pocket_mm=12 --set solid.letter_mm=2 --set bands.dowel_mm=2 "
      "--set bands.dowel_depth_mm=2 --set bands.dowel_wall_mm=1 --set bands.dowel_spacing_mm=12 "
      "--set bands.magnet_mm=3 --set bands.magnet_depth_mm=1.2 --set bands.magnet_wall_mm=1 "
      "--stage products --stage fuse --stage stones --stage mesh --stage bands --out '" +
      out.string() + "' ";
  ASSERT_EQ(run(verb + "--set 'solid.label=\"S {scale}\"'").exit_code, 0);
  for (const std::string scale : {"1000", "200"}) {
    const fs::path here = out / ("s" + scale);
    const json whole = json::parse(slurp(here / "surface.certificate.json"));
    EXPECT_EQ(whole["passed"], true);
    EXPECT_EQ(whole["engraved"][0]["what"], "\"S 1:" + scale + "\"");
    EXPECT_GT(whole["hollow"]["removed_mm3"], 0.0);
    EXPECT_FALSE(whole.contains("dowels")) << "joints are the bands'";
    double volume = 0.0;
    for (const std::string band : {"1", "2"}) {
      const json said = json::parse(slurp(here / ("bands/band_0" + band + ".certificate.json")));
      EXPECT_EQ(said["passed"], true);
      EXPECT_EQ(said["engraved"][0]["what"], "\"S 1:" + scale + " " + band + "\"");
      EXPECT_TRUE(fs::exists(here / "bands/pins.3mf"));
      volume += said["volume_mm3"].get<double>() + said["hollow"]["removed_mm3"].get<double>() +
                said["engraved"][0]["removed_mm3"].get<double>();
      for (const char* kind : {"dowels", "magnets"}) {
        EXPECT_GE(said[kind]["places"].size(), 2U);
        volume += static_cast<double>(said[kind]["places"].size()) *
                  said[kind]["hole_volume_mm3"].get<double>();
      }
    }
    ASSERT_EQ(run("mesh " + (here / "design.tif").string() + " --quiet --out " +
                  (scratch / "whole.ply").string())
                  .exit_code,
              0);
    const double plain = json::parse(slurp(scratch / "whole.certificate.json"))["volume_mm3"];
    EXPECT_NEAR(volume, plain, 1e-9 * plain);
  }
  // Said before anything is made.
  const Outcome letters = run(verb + "--set 'solid.label=\"#1\"'");
  EXPECT_EQ(letters.exit_code, 2);
  EXPECT_THAT(letters.err, AllOf(HasSubstr("solid.label"), HasSubstr("cannot be engraved: #")));
}

TEST_F(CommandLine, LimitsOfWhatTheCutterReachesAreKeptOrNamed) {
  const std::string surface =
      "run '" + testing_support::source_folder().string() +
      "/assets/sites/default.toml' --quiet --set size_mm=40 --stage products "
      "--stage fuse --stage reach --out '" +
      out.string() + "' ";
  EXPECT_EQ(run(surface).exit_code, 0) << "no limit is set";
  const json figures = json::parse(slurp(out / "s1000/reach.json"));
  const double steepest = figures["steepest_deg"], relief = figures["relief_mm"];
  ASSERT_GT(steepest, 1.0);
  for (const char* file : {"reach.tif", "slope.tif", "reach.png", "slope.png"})
    EXPECT_TRUE(fs::exists(out / "s1000" / file)) << file;
  const auto with = [&](const std::string& key, double value) {
    return run(surface + fmt::format("--set reach.{}={}", key, value));
  };
  EXPECT_EQ(with("max_slope_deg", 89.0).exit_code, 0);
  const Outcome steep = with("max_slope_deg", 0.2 * steepest);
  EXPECT_EQ(steep.exit_code, 1);
  EXPECT_THAT(steep.err, AllOf(HasSubstr("s1000.reach"), HasSubstr("reach.max_slope_deg")));
  const Outcome shorter = with("cutter_length_mm", 0.5 * relief);
  EXPECT_EQ(shorter.exit_code, 1);
  EXPECT_THAT(shorter.err, HasSubstr("reach.cutter_length_mm"));
  const Outcome low = with("stock_height_mm", 10.0 + 0.5 * relief);
  EXPECT_EQ(low.exit_code, 1);
  EXPECT_THAT(low.err, HasSubstr("reach.stock_height_mm"));
}

TEST_F(CommandLine, EveryVerbHasHelpWithAnExample) {
  for (const char* verb :
       {"init",        "run",        "fuse",          "stones",    "mesh",     "bands",
        "stone-parts", "mill",       "spheres",       "verify",    "backplot", "export",
        "render",      "compare",    "scan",          "clean",     "merge",    "deviate",
        "diagnose",    "compensate", "detectability", "info",      "doctor",   "lod",
        "view",        "expose",     "stack",         "calibrate", "match"}) {
    const auto o = run(std::string(verb) + " --help");
    EXPECT_EQ(o.exit_code, 0) << verb;
    EXPECT_THAT(o.out, HasSubstr("Example: maquette " + std::string(verb)));
  }
}

TEST_F(CommandLine, InfoAndDoctorAnswer) {
  const auto info = run("info --json " + design().string());
  ASSERT_EQ(info.exit_code, 0) << info.err;
  EXPECT_EQ(json::parse(info.out)["nodes"], json({41, 41}));
  std::ofstream(scratch / "a.pts") << "2\n1 2 3\n4 5 6\n1\n0 0 0\n";  // metres
  const auto cloud = run("info --json " + (scratch / "a.pts").string());
  ASSERT_EQ(cloud.exit_code, 0) << cloud.err;
  EXPECT_EQ(json::parse(cloud.out)["points"], 3);
  EXPECT_EQ(json::parse(cloud.out)["max_mm"], json({4000.0, 5000.0, 6000.0}));
  EXPECT_EQ(json::parse(cloud.out)["stations"].size(), 2U);
  EXPECT_EQ(run("doctor --out " + out.string()).exit_code, 0);
}

}  // namespace
}  // namespace maquette
