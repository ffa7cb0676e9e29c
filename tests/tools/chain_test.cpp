// SPDX-License-Identifier: GPL-3.0-or-later

// The whole chain as a user runs it, on a small site (40 mm, both scales):
//   every documented file is there ....... and the manifest's figures hold their bounds
//   clean scans, five seeds .............. nothing significant; a bump is found
//   second run does nothing .............. every unit reused
//   changed parameter .................... only what depends on it
//   threads do not matter ................ output hashes compared, 1 and 3
//   killed and run again ................. same hashes
//   shards and merge ..................... same hashes
//   joints and stones .................... apart in every file of the bands; what meets is named
//   stones' parts ........................ there, in manifest and report; off by a key
//   settled stones ....................... through solid and files: one pose at both scales,
//                                          apart, an exact union
//   real data ............................ both sites of assets/sites, where the data is there

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <map>
#include <set>
#include <thread>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>
#include <nlohmann/json.hpp>

#include "core/files.hpp"
#include "heightmap/field_io.hpp"
#include "heightmap/height_field.hpp"
#include "meshing/mesh_io.hpp"
#include "meshing/stones.hpp"
#include "scan/cloud.hpp"
#include "support/folders.hpp"
#include "support/matchers.hpp"
#include "support/program.hpp"

namespace maquette {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using testing_support::Outcome;
using testing_support::run_program;
using testing_support::ScratchFolder;
using testing_support::slurp;

/// The default site, small enough for a test: 3 stations would add nothing.
constexpr const char* kSmall =
    " --quiet --set size_mm=40 --set bands.max_width_mm=15 --set stones.count=5 "
    "--set stones.max_diameter_m=3 --set scanner.max_points=60000 --set camera.samples_per_pixel=1 "
    "--set export.lod_triangles=2000 --set mill.work_offset_per_band=true "
    "--set 'export.formats=[\"stl\", \"glb\", \"step\"]' ";

const std::string kSite =
    "run " + testing_support::source_folder().string() + "/assets/sites/default.toml";

std::map<std::string, std::string> hashes(const fs::path& out) {
  std::map<std::string, std::string> all;
  const json manifest = json::parse(slurp(out / "manifest.json"));
  for (const json& stage : manifest["stages"])
    for (const json& o : stage["outputs"]) all[o["path"]] = o["sha256"];
  return all;
}

/// Names of the files that differ, "" where none does: a failure names them, not all hashes.
std::string differing(const fs::path& a, const fs::path& b) {
  const auto of_a = hashes(a), of_b = hashes(b);
  std::string names;
  for (const auto& [name, hash] : of_a)
    if (!of_b.contains(name) || of_b.at(name) != hash) names += name + " ";
  return names + (of_a.size() == of_b.size() ? "" : "(other files)");
}

/// One run that all tests compare with.
class Chain : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    scratch_ = new ScratchFolder;
    outcome_ = new Outcome(
        run_program(scratch_->path(), kSite + kSmall + "--out " + (*scratch_ / "out").string()));
  }
  static void TearDownTestSuite() {
    delete outcome_;
    delete scratch_;
  }
  void SetUp() override { ASSERT_EQ(outcome_->exit_code, 0) << outcome_->err; }
  static fs::path out() { return *scratch_ / "out"; }
  static const ScratchFolder& scratch() { return *scratch_; }
  static ScratchFolder* scratch_;
  static Outcome* outcome_;
};
ScratchFolder* Chain::scratch_ = nullptr;
Outcome* Chain::outcome_ = nullptr;

TEST_F(Chain, LeavesEveryDocumentedFile) {
  for (const char* file : {"manifest.json", "report.html", "products/synthetic_moon_dtm.img"})
    EXPECT_TRUE(fs::exists(out() / file)) << file;
  for (const char* scale : {"s1000", "s200"})
    for (const char* file : {"design.tif",
                             "sigma.tif",
                             "source.tif",
                             "hillshade.png",
                             "reach.tif",
                             "reach.png",
                             "slope.tif",
                             "slope.png",
                             "reach.json",
                             "stones.json",
                             "stones.csv",
                             "surface.tif",
                             "surface.ply",
                             "surface.certificate.json",
                             "bands/bands.json",
                             "bands/exploded.svg",
                             "bands/exploded.png",
                             "bands/band_01.ply",
                             "bands/band_03.raster.ngc",
                             "rough.ngc",
                             "rough.stock.tif",
                             "bands/band_03.raster.scallop.tif",
                             "certificate.json",
                             "backplot/band_01.raster.feed.svg",
                             "backplot/band_03.raster.engagement.png",
                             "backplot/paths.json",
                             "backplot/rough.engagement.svg",
                             "as_milled.tif",
                             "export/surface.stl",
                             "export/surface.glb",
                             "export/surface_lod1.glb",
                             "export/surface_band_03.step",
                             "export/surface_band_03.step.certificate.json",
                             "picture.exr",
                             "picture.png",
                             "scene.toml",
                             "stones_far.png",
                             "stones_close.png",
                             "stones_close.toml",
                             "stone_parts/stone_parts.json",
                             "stone_parts/build_01.3mf",
                             "stone_parts/placing.csv",
                             "stone_parts/placing.pdf",
                             "stone_parts/placing.dxf",
                             "stone_parts/parts/S001.3mf",
                             "stone_parts/parts/S001.stl",
                             "stone_parts/parts/S001.certificate.json",
                             "scan_01.ply",
                             "scan_02.ply",
                             "case.toml",
                             "summary.json",
                             "deviation.tif",
                             "deviation.ply",
                             "report.html"})
      EXPECT_TRUE(fs::exists(out() / scale / file)) << scale << "/" << file;
}

// Where the program was built with its page, the report links it with the run's data inside.
TEST_F(Chain, TheReportLinksAPageOfTheRun) {
  const bool there = fs::exists(out() / "view.html");
  EXPECT_EQ(slurp(out() / "report.html").find("href='view.html'") != std::string::npos, there);
  if (!there) {
    const ScratchFolder other;
    const Outcome tried =
        run_program(other.path(),
                    fmt::format("view '{}' --export '{}'", out().string(), (other / "p").string()));
    ASSERT_NE(tried.exit_code, 0) << "the program has a page, and the run none";
    GTEST_SKIP() << "built without the page: tools/setup --web";
  }
  const std::string page = slurp(out() / "view.html");
  EXPECT_LE(page.size(), 10'000'000U);
  for (const char* raster : {"s1000/design.tif", "s200/as_milled.tif", "s200/deviation.tif"})
    EXPECT_NE(page.find(fmt::format("\"grid/{}\"", raster)), std::string::npos) << raster;
}

// Files against files: means over 5 x 5 nodes of 1:200 are the nodes of 1:1000, in heights of the
// model above one datum.
TEST_F(Chain, TheFinerScaleIsAnEnlargement) {
  const auto wide = heightmap::read_model_field(out() / "s1000/design.tif");
  const auto fine = heightmap::read_model_field(out() / "s200/design.tif");
  ASSERT_THAT(wide, testing_support::Succeeds());
  ASSERT_THAT(fine, testing_support::Succeeds());
  const auto figures = [](const fs::path& at) { return json::parse(slurp(at / "fuse.json")); };
  const double lower_mm = (figures(out() / "s200")["lowest_m"].get<double>() -
                           figures(out() / "s1000")["lowest_m"].get<double>()) *
                          1000.0 / 200.0;
  const std::ptrdiff_t first = wide->z_mm.rows() / 2 - fine->z_mm.rows() / 10;
  double off_mm = 0.0;
  for (std::ptrdiff_t r = 1; 5 * r + 2 < fine->z_mm.rows(); ++r)
    for (std::ptrdiff_t c = 1; 5 * c + 2 < fine->z_mm.cols(); ++c) {
      double mean = lower_mm;
      for (std::ptrdiff_t i = -2; i <= 2; ++i)
        for (std::ptrdiff_t j = -2; j <= 2; ++j)
          mean += static_cast<double>(fine->z_mm(5 * r + i, 5 * c + j)) / 25.0;
      const double aim = 5.0 * static_cast<double>(wide->z_mm(first + r, first + c));
      off_mm = std::max(off_mm, std::abs(mean - aim));
    }
  EXPECT_LT(off_mm, 0.005);
  EXPECT_LT(figures(out() / "s200")["low_pass_um"].get<double>(), 5.0);
  EXPECT_EQ(figures(out() / "s1000").count("low_pass_um"), 0U);
}

// Files against files: each stone of the section is one of the whole site, in the same pose to
// 0.01 mm of the smaller model; every vertex is compared.
TEST_F(Chain, TheSameStonesLieAtBothScales) {
  const auto wide = meshing::read_stone_plan(out() / "s1000/stones.json");
  const auto fine = meshing::read_stone_plan(out() / "s200/stones.json");
  ASSERT_TRUE(wide && fine);
  ASSERT_EQ(wide->size(), 5U);
  ASSERT_EQ(fine->size(), 3U);  // inner_share 0.5, rounded up
  const auto lowest_m = [](const fs::path& at) {
    return json::parse(slurp(at / "fuse.json"))["lowest_m"].get<double>();
  };
  const double lower_mm = lowest_m(out() / "s200") - lowest_m(out() / "s1000");  // at 1:1000
  for (const meshing::PlacedStone& s : *fine) {
    const auto same = std::find_if(wide->begin(), wide->end(),
                                   [&](const auto& w) { return w.number == s.number; });
    ASSERT_NE(same, wide->end()) << s.number;
    EXPECT_TRUE(meshing::same_shape(*same, s));
    const auto at_1000 = meshing::stone_mesh(*same).vertices_mm,
               at_200 = meshing::stone_mesh(s).vertices_mm;
    double off_mm = 0.0;
    for (std::size_t i = 0; i < at_1000.size(); ++i) {
      // Both parts are 40 mm wide about the site's middle.
      const Vec3 brought = 0.2 * (at_200[i] - Vec3{20, 20, 0}) + Vec3{20, 20, lower_mm};
      off_mm = std::fmax(off_mm, norm(brought - at_1000[i]));
    }
    EXPECT_LT(off_mm, 0.01) << s.number;
  }
}

// What makes and mills the bands goes by bands.json, whose joints keep off the stones.
TEST_F(Chain, NoJointPassesThroughAStone) {
  for (const char* scale : {"s1000", "s200"}) {
    SCOPED_TRACE(scale);
    const json layout = json::parse(slurp(out() / scale / "bands/bands.json"));
    const auto stones = meshing::read_stone_plan(out() / scale / "stones.json").value();
    ASSERT_FALSE(stones.empty());
    // Three stones of 8 to 15 mm on 40 mm leave a joint of the section no place; it is named.
    if (std::string(scale) == "s1000") {
      EXPECT_TRUE(layout["warnings"].empty());
    }
    for (const json& joint : layout["joints"])
      for (const auto& s : stones) {
        const Box3 box = meshing::stone_mesh(s).bounds();
        const double y = joint["at_mm"];
        const double beside = std::fmax(box.min.y - y, y - box.max.y);
        const auto names = [&](const char* how) {
          const auto numbers = joint[how].get<std::vector<int>>();
          return std::find(numbers.begin(), numbers.end(), s.number) != numbers.end();
        };
        EXPECT_EQ(names("through_stones"), beside <= 0.0) << s.number;
        EXPECT_EQ(names("near_stones"), beside > 0.0 && beside <= 1.0) << s.number;
      }
    for (const json& band : layout["bands"]) {
      EXPECT_LE(band["width_mm"], 15.0 + 1e-9);
      const std::string name = fmt::format("band_{:02}", band["number"].get<int>());
      const auto mesh = meshing::read_mesh(out() / scale / "bands" / (name + ".ply"));
      ASSERT_TRUE(mesh.has_value());
      EXPECT_EQ(mesh->bounds().min.y, band["from_mm"]);
      EXPECT_EQ(mesh->bounds().max.y, band["to_mm"]);
      EXPECT_TRUE(fs::exists(out() / scale / "bands" / (name + ".raster.ngc"))) << name;
      EXPECT_TRUE(fs::exists(out() / scale / "export" / ("surface_" + name + ".step"))) << name;
    }
  }
}

TEST_F(Chain, StonesGoToTheWorkshopUnlessToldOtherwise) {
  const json manifest = json::parse(slurp(out() / "manifest.json"));
  std::set<std::string> with;
  for (const json& stage : manifest["stages"]) with.insert(stage["name"]);
  EXPECT_TRUE(with.contains("s1000.stone-parts"));
  EXPECT_TRUE(with.contains("s200.stone-parts"));
  const json made = json::parse(slurp(out() / "s1000/stone_parts/stone_parts.json"));
  EXPECT_EQ(made["stones"], 5);
  const std::string report = slurp(out() / "report.html");
  for (const char* said : {"Stones for the workshop", "s200/stone_parts/placing.pdf",
                           "bands, moved apart", "where most of them lie"})
    EXPECT_NE(report.find(said), std::string::npos) << said;
  const ScratchFolder other;
  const Outcome off = run_program(
      other.path(), kSite + kSmall + "--set stone_parts.make=false --stage stone-parts --out " +
                        (other / "out").string());
  EXPECT_EQ(off.exit_code, 2);
  EXPECT_THAT(off.err, testing::HasSubstr("stages are"));
}

// Stones so many that no line is free: the run goes on and says which joint meets which stone.
TEST_F(Chain, AJointThatMeetsAStoneIsNamed) {
  const fs::path copy = scratch() / "met";
  fs::copy(out(), copy, fs::copy_options::recursive);
  const Outcome outcome = run_program(
      scratch().path(),
      kSite + kSmall + "--set bands.stone_clearance_mm=30 --stage joints --out " + copy.string());
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  const json layout = json::parse(slurp(copy / "s1000/bands/bands.json"));
  ASSERT_FALSE(layout["warnings"].empty());
  for (const json& warning : layout["warnings"])
    EXPECT_THAT(warning.get<std::string>(),
                testing::AllOf(testing::HasSubstr("joint"), testing::HasSubstr("stone")));
  // None is kept off all the same: only the clearance is what cannot be had.
  for (const json& joint : layout["joints"]) {
    EXPECT_TRUE(joint["through_stones"].empty());
    EXPECT_FALSE(joint["near_stones"].empty());
  }
  const Outcome even = run_program(
      scratch().path(),
      kSite + kSmall + "--set bands.avoid_stones=false --stage joints --out " + copy.string());
  ASSERT_EQ(even.exit_code, 0) << even.err;
  const json bands = json::parse(slurp(copy / "s1000/bands/bands.json"))["bands"];
  ASSERT_EQ(bands.size(), 3U);
  EXPECT_EQ(bands[0]["width_mm"], 13.0);
  EXPECT_EQ(bands[1]["width_mm"], 13.5);
}

TEST_F(Chain, EachBandHasItsWorkOffset) {
  for (const auto& [program, offset] :
       {std::pair{"rough.ngc", "\nG54\n"}, std::pair{"bands/band_01.raster.ngc", "\nG54\n"},
        std::pair{"bands/band_03.raster.ngc", "\nG56\n"}})
    EXPECT_THAT(slurp(out() / "s1000" / program), testing::HasSubstr(offset)) << program;
}

// Nothing was hidden in the scans of the simulated cut: neither stones nor what the ball cannot
// reach are causes.
TEST_F(Chain, NothingIsFoundWrongWithItsOwnScans) {
  for (const std::string scale : {"s1000", "s200"}) {
    const fs::path to = scratch() / ("diagnosis_" + scale);
    const Outcome o =
        run_program(scratch().path(), "diagnose --quiet " + (out() / scale / "case.toml").string() +
                                          " --out " + to.string());
    ASSERT_EQ(o.exit_code, 0) << o.err;
    const json report = json::parse(slurp(to / "diagnosis.json"));
    EXPECT_EQ(report["verdict"], "consistent") << scale;
    // Points so few that no two share the smallest square: their noise is told all the same.
    const auto rms = report["gain"]["rms_before"].get<double>();
    EXPECT_LT(report["gain"]["rms_expected_from_noise"], 1.5 * rms) << scale;
    EXPECT_GT(report["gain"]["rms_expected_from_noise"], 0.7 * rms) << scale;
  }
}

// The ball leaves up to 0.4 mm in pits and creases; that is expected, and noise is noise. Findings
// are 1 % by chance a scan, these seeds have none. A bump that nobody expected is found.
TEST_F(Chain, CleanScansHaveNoSignificantPatch) {
  const fs::path here = out() / "s1000";
  EXPECT_TRUE(json::parse(slurp(here / "summary.json"))["findings"].empty());
  EXPECT_TRUE(json::parse(slurp(out() / "s200" / "summary.json"))["findings"].empty());
  const fs::path to = scratch() / "clean";
  fs::create_directories(to);
  const auto run = [&](const std::string& arguments) {
    const Outcome o = run_program(scratch().path(), arguments + " --quiet");
    EXPECT_EQ(o.exit_code, 0) << o.err;
  };
  const std::string scanner = (to / "ray.toml").string();
  run("scan --write-scanner " + scanner);
  std::string text = slurp(scanner);
  const auto at = text.find("footprint_rays = 7");
  ASSERT_NE(at, std::string::npos);
  ASSERT_TRUE(write_file(scanner, text.replace(at, 18, "footprint_rays = 1")));
  std::string entry = slurp(here / "case.toml");
  entry = entry.substr(0, entry.find("[[scan]]"));
  for (std::size_t i = 0; (i = entry.find("= \"", i)) != std::string::npos; i += 3)
    if (entry.compare(i + 3, 8, "maquette") != 0) entry.insert(i + 3, here.string() + "/");
  entry.replace(entry.find("gcode"), entry.find('\n', entry.find("gcode")) - entry.find("gcode"),
                "");
  for (int seed = 1; seed <= 5; ++seed) {
    const fs::path points = to / fmt::format("{}.ply", seed);
    const bool bump = seed == 5;
    double raised_mm = 0.0;  // mean over all points
    run(fmt::format(
        "scan {} --stones {} --scanner {} --seed {} --max-points 100000 --station-mm 20 "
        "-500 700 --out {}",
        (here / "as_milled.tif").string(), (here / "stones.json").string(), scanner, seed,
        points.string()));
    if (bump) {
      auto cloud = scan::read_cloud(points);
      ASSERT_TRUE(cloud.has_value());
      for (Vec3& p : cloud->points_mm) {
        if (!(std::hypot(p.x - 28.0, p.y - 12.0) < 5.0)) continue;
        p.z += 0.2;
        raised_mm += 0.2 / static_cast<double>(cloud->points_mm.size());
      }
      ASSERT_TRUE(scan::write_cloud(*cloud, points));
    }
    const fs::path with = to / "case.toml";
    ASSERT_TRUE(
        write_file(with, fmt::format("{}[[scan]]\npoints = \"{}\"\n", entry, points.string())));
    run("deviate " + with.string() + " --out " + (to / "out").string());
    const json summary = json::parse(slurp(to / "out" / "summary.json"));
    EXPECT_EQ(summary["findings"].empty(), !bump) << seed << summary["findings"].dump(1);
    // The bump has no part in the best fit, which hides none of it.
    EXPECT_NEAR(summary["expected"]["mean_mm"].get<double>(), raised_mm, 0.005) << seed;
    for (const json& s : summary["stones"]) EXPECT_NE(s["state"], "missing") << seed << s.dump();
    if (!bump || summary["findings"].empty()) continue;
    const json f = summary["findings"][0];
    EXPECT_NEAR(f["x_mm"].get<double>(), 28.0, 1.5);
    EXPECT_NEAR(f["height_mm"].get<double>(), 0.2, 3.0 * f["sigma_height_mm"].get<double>());
  }
}

TEST_F(Chain, HoldsItsBounds) {
  const json manifest = json::parse(slurp(out() / "manifest.json"));
  for (const json& stage : manifest["stages"]) {
    const std::string name = stage["name"];
    const json& f = stage["figures"];
    if (name.ends_with(".mesh")) {
      EXPECT_TRUE(f["passed"]) << name;
      EXPECT_TRUE(f["closed"] && f["manifold"] && f["oriented_outward"]) << name;
    }
    if (name.ends_with(".verify")) {
      // The bound: no gouge above 20 um, seen and unseen together.
      EXPECT_LE(f["max_gouge_mm"].get<double>() + f["bound_mm"].get<double>(), 0.02) << name;
      EXPECT_LE(f["max_gouge_against_mesh_mm"].get<double>(), 0.02) << name;
      EXPECT_EQ(f["rapid_collisions"], 0) << name;
    }
    if (name.ends_with(".deviate")) {
      // Scallop (0.0104 mm), range noise and what the ball cannot reach; a frame error or
      // a slip by half a pixel would be many times this.
      EXPECT_LT(std::fabs(f["median_mm"].get<double>()), 0.1) << name;
      EXPECT_GT(f["coverage"].get<double>(), 0.2) << name;
    }
  }
}

TEST_F(Chain, DoesNothingTwice) {
  const auto before = hashes(out());
  const Outcome again =
      run_program(scratch().path(), kSite + kSmall + "--json --out " + out().string());
  ASSERT_EQ(again.exit_code, 0) << again.err;
  for (const json& unit : json::parse(again.out)["units"])
    EXPECT_TRUE(unit["reused"]) << unit["name"];
  EXPECT_EQ(hashes(out()), before);
}

TEST_F(Chain, RedoesWhatDependsOnAParameter) {
  const fs::path copy = scratch() / "changed";
  fs::copy(out(), copy, fs::copy_options::recursive);
  const Outcome outcome =
      run_program(scratch().path(),
                  kSite + kSmall + "--json --set lamp.elevation_deg=45 --out " + copy.string());
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  for (const json& unit : json::parse(outcome.out)["units"]) {
    const std::string name = unit["name"];
    EXPECT_EQ(unit["reused"].get<bool>(), name.find(".render") == std::string::npos) << name;
  }
}

TEST_F(Chain, DoesNotDependOnThreads) {
  const fs::path other = scratch() / "threads";
  const Outcome outcome =
      run_program(scratch().path(), kSite + kSmall + "--threads 3 --out " + other.string());
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  const fs::path one = scratch() / "one";
  const Outcome single =
      run_program(scratch().path(), kSite + kSmall + "--threads 1 --out " + one.string());
  ASSERT_EQ(single.exit_code, 0) << single.err;
  EXPECT_EQ(differing(one, other), "");
  EXPECT_EQ(differing(out(), other), "");
}

TEST_F(Chain, GoesOnAfterAKill) {
  const fs::path killed = scratch() / "killed";
  int kills = 0;
  for (const int after_ms : {300, 900, 1800, 3000}) {
    const pid_t child = ::fork();
    if (child == 0) {
      ::setpgid(0, 0);
      const std::string command =
          fmt::format("exec '{}' {} {} --out '{}' >/dev/null 2>&1",
                      testing_support::maquette_program().string(), kSite, kSmall, killed.string());
      ::execl("/bin/sh", "sh", "-c", command.c_str(), nullptr);
      ::_exit(127);
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(after_ms));
    ::kill(child, SIGKILL);
    int status = 0;
    ::waitpid(child, &status, 0);
    kills += WIFSIGNALED(status) ? 1 : 0;
  }
  EXPECT_GT(kills, 0) << "every run ended before it was killed: nothing was tested";
  const Outcome outcome =
      run_program(scratch().path(), kSite + kSmall + "--out " + killed.string());
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  EXPECT_EQ(differing(killed, out()), "");
  for (const auto& entry : fs::recursive_directory_iterator(killed))
    EXPECT_EQ(entry.path().string().find(".partial-"), std::string::npos) << entry.path();
}

TEST_F(Chain, ShardsAndMergeAreTheSame) {
  const fs::path sharded = scratch() / "sharded";
  const std::string out_option = "--out " + sharded.string();
  const auto step = [&](const std::string& options) {
    const Outcome o = run_program(scratch().path(), kSite + kSmall + options + " " + out_option);
    EXPECT_EQ(o.exit_code, 0) << options << ": " << o.err;
  };
  for (const char* stage : {"products", "fuse", "stones", "mesh"})
    step(std::string("--stage ") + stage);
  for (const char* stage : {"bands", "rough", "mill"})
    for (const char* shard : {"2/3", "3/3", "1/3"})
      step(fmt::format("--stage {} --shard {}", stage, shard));
  step("--merge");
  EXPECT_EQ(differing(sharded, out()), "");
}

/// Four tools in three bands: each operation cuts what the former left, one certificate for all.
TEST_F(Chain, OperationsOfASite) {
  const fs::path site = scratch() / "four.toml", four = scratch() / "four";
  std::ofstream(site) << slurp(testing_support::source_folder() / "assets/sites/default.toml")
                      << "\n[[operation]]\nstrategy = \"rough\"\n[[operation]]\nstrategy = "
                         "\"semi-finish\"\ntool = 5\ndiameter_mm = 8.0\n[[operation]]\nstrategy = "
                         "\"raster\"\nname = \"finish\"\n[[operation]]\nstrategy = \"rest\"\n"
                         "diameter_mm = 2.0\n";
  const std::string kStages =
      "--stage products --stage fuse --stage stones --stage mesh --stage mill --stage verify ";
  const Outcome o = run_program(scratch().path(), "run " + site.string() + kSmall + kStages +
                                                      "--set scales=[200] --out " + four.string());
  ASSERT_EQ(o.exit_code, 0) << o.err;
  for (const char* file :
       {"rough.ngc", "rough.stock.tif", "bands/band_03.semi-finish.ngc", "semi-finish.stock.tif",
        "bands/band_02.finish.ngc", "finish.stock.tif", "bands/band_01.rest.ngc"})
    EXPECT_TRUE(fs::exists(four / "s200" / file)) << file;
  EXPECT_FALSE(fs::exists(four / "s200/rest.stock.tif")) << "as_milled.tif is that";
  const json c = json::parse(slurp(four / "s200/certificate.json"));
  EXPECT_LE(c["max_gouge_mm"].get<double>() + c["bound_mm"].get<double>(), 0.02);
  EXPECT_EQ(c["rapid_collisions"], 0);
  std::map<int, int> rows;
  for (const json& row : c["machining_time"]) ++rows[row["tool"].get<int>()];
  EXPECT_EQ(rows[2], 1);
  EXPECT_EQ(rows[5], 3);
  EXPECT_EQ(rows[1], 3);
  // The rest of a smaller ball can only take off: against the run without it.
  const json plain = json::parse(slurp(out() / "s200/certificate.json"));
  EXPECT_LT(c["mean_excess_mm"].get<double>(), plain["mean_excess_mm"].get<double>());
  std::set<std::string> operations;
  const json scene = json::parse(slurp(four / "s200/backplot/paths.json"));
  for (const json& p : scene["programs"]) operations.insert(p["operation"].get<std::string>());
  EXPECT_TRUE(operations.contains("rough") && operations.contains("semi-finish") &&
              operations.contains("finish"));
  const auto wrong = [&](const std::string& text, const std::string& says) {
    std::ofstream(scratch() / "wrong.toml") << text;
    const Outcome refused =
        run_program(scratch().path(), "run " + (scratch() / "wrong.toml").string() + " --out " +
                                          (scratch() / "wrong").string());
    EXPECT_EQ(refused.exit_code, 2);
    EXPECT_THAT(refused.err, testing::HasSubstr(says));
  };
  wrong("[[operation]]\nstrategy = \"probe\"\n", "semi-finish");
  wrong("[[operation]]\nstrategy = \"sphere-seats\"\n", "needs spheres.file");
  wrong("[spheres]\nfile = \"nowhere.toml\"\n", "nowhere.toml");
  wrong(
      "[[operation]]\nstrategy = \"raster\"\n[[operation]]\nstrategy = \"semi-finish\"\n"
      "diameter_mm = 8.0\n",
      "give each cutter its own number");
}

/// Seats, marks and bores are cut into what the finish has left, and certified with it; a cut that
/// is none of them still counts.
TEST_F(Chain, SeatsMarksAndSpheresOfASite) {
  const fs::path site = scratch() / "seats.toml", made = scratch() / "seats";
  std::ofstream(scratch() / "spheres.toml")
      << "sphere_radius_mm = 6.0\nhole_radius_mm = 4.0\n[[sphere]]\nname = \"a\"\nat_mm = [-20.0, "
         "-20.0, 0.0]\n[[sphere]]\nname = \"b\"\nat_mm = [60.0, -20.0, 0.0]\n";
  std::ofstream(site) << slurp(testing_support::source_folder() / "assets/sites/default.toml")
                      << "\n[spheres]\nfile = \"spheres.toml\"\n"
                         "[[operation]]\nstrategy = \"rough\"\n[[operation]]\nstrategy = "
                         "\"raster\"\n[[operation]]\nstrategy = \"seats\"\ngap_mm = 0.8\nbed_mm "
                         "= 0.3\n[[operation]]\nstrategy = \"outlines\"\nmark_depth_mm = 0.2\n";
  const std::string stages =
      "--stage products --stage fuse --stage stones --stage mesh --stage machined --stage mill "
      "--stage touch --stage verify ";
  const Outcome o = run_program(scratch().path(), "run " + site.string() + kSmall + stages +
                                                      "--set scales=[200] --out " + made.string());
  ASSERT_EQ(o.exit_code, 0) << o.err;
  const fs::path at = made / "s200";
  for (const char* file : {"machined.tif", "bands/band_02.seats.ngc", "seats.stock.tif",
                           "bands/band_01.outlines.ngc", "sphere-seats.ngc", "touch.ngc"})
    EXPECT_TRUE(fs::exists(at / file)) << file;
  // A ball of 1 mm that only touches in some band: no spindle turns as fast as the material asks.
  std::string outlines;
  for (const auto& file : fs::directory_iterator(at / "bands"))
    if (file.path().string().ends_with(".outlines.ngc")) outlines += slurp(file.path());
  EXPECT_THAT(outlines,
              testing::AllOf(testing::HasSubstr("spindle: the fastest of portal_mill_2500"),
                             testing::HasSubstr("S24000")));
  const json c = json::parse(slurp(at / "certificate.json"));
  EXPECT_LE(c["max_gouge_mm"].get<double>() + c["bound_mm"].get<double>(), 0.02);
  EXPECT_LE(c["max_gouge_against_mesh_mm"].get<double>(), 0.02);
  EXPECT_EQ(c["rapid_collisions"], 0);
  std::map<int, int> rows;
  for (const json& row : c["machining_time"]) ++rows[row["tool"].get<int>()];
  EXPECT_GT(rows[3], 0) << "seats";
  EXPECT_GT(rows[4], 0) << "outlines";
  EXPECT_EQ(rows[5], 1) << "bores";

  // The floors are there: 0.3 mm below each stone's lowest point, and no lower.
  const auto design = heightmap::read_model_field(at / "design.tif");
  const auto meant = heightmap::read_model_field(at / "machined.tif");
  const auto cut = heightmap::read_model_field(at / "as_milled.tif");
  const auto stones = meshing::read_stone_plan(at / "stones.json");
  ASSERT_TRUE(design && meant && cut && stones);
  std::size_t seated = 0;
  for (const meshing::PlacedStone& stone : *stones) {
    Vec3 lowest{0.0, 0.0, INFINITY};
    for (const Vec3& v : meshing::stone_mesh(stone).vertices_mm)
      if (v.z < lowest.z) lowest = v;
    if (heightmap::height_at(*design, lowest.x, lowest.y) < lowest.z) continue;
    const double floor = lowest.z - 0.3;
    EXPECT_NEAR(heightmap::height_at(*meant, lowest.x, lowest.y), floor, 1e-3);
    // A ball of 3 mm, 0.2 mm between its passes: ridges of 3 um; below, what a program may.
    EXPECT_NEAR(heightmap::height_at(*cut, lowest.x, lowest.y), floor, 0.02);
    ++seated;
  }
  EXPECT_GE(seated, 3U);

  // Certified against the design itself, the same cut is far too deep.
  const Outcome plain = run_program(
      scratch().path(),
      fmt::format("verify {} --design {} --ball-diameter-mm 3 --max-gouge-mm 0.02 --out {}",
                  (at / "bands/band_02.seats.ngc").string(), (at / "design.tif").string(),
                  (scratch() / "against_design").string()));
  EXPECT_EQ(plain.exit_code, 1) << plain.err;
}

/// Programs for a machine with known errors and a part that lies elsewhere: what the machine makes
/// of them is certified; the same programs on a machine without fail.
TEST_F(Chain, ProgramsForTheMachineAndWhereThePartLies) {
  std::ofstream(scratch() / "by.toml")
      << "schema = \"maquette.compensation/1\"\n[machine]\nscale_x_um_per_m = 900.0\n"
         "backlash_x_mm = 0.04\n[tool]\nlength_offset_mm = 0.05\n";
  std::ofstream(scratch() / "lies.toml")
      << "schema = \"maquette.corrections/1\"\n[surface]\ntranslation_mm = [0.21, -0.08, -0.06]\n";
  const fs::path made = scratch() / "adjusted", at = made / "s200";
  const std::string adjust =
      fmt::format("--compensate {} --corrections {} ", (scratch() / "by.toml").string(),
                  (scratch() / "lies.toml").string());
  const Outcome o =
      run_program(scratch().path(),
                  kSite + kSmall + adjust +
                      "--stage products --stage fuse --stage stones --stage mesh --stage mill "
                      "--stage verify --set scales=[200] --out " +
                      made.string());
  ASSERT_EQ(o.exit_code, 0) << o.err;
  const json c = json::parse(slurp(at / "certificate.json"));
  EXPECT_LE(c["max_gouge_mm"].get<double>() + c["bound_mm"].get<double>(), 0.0075);
  EXPECT_EQ(c["adjusted"]["corrections"]["file"], "lies.toml");
  EXPECT_GT(c["adjusted"]["largest_change_mm"].get<double>(), 0.2);
  EXPECT_LE(c["adjusted"]["meant"]["max_gouge_mm"].get<double>(), 0.005);
  const std::string band = (at / "bands/band_01.raster.ngc").string(),
                    verify = fmt::format("verify {} --design {} --max-gouge-mm 0.02 --out {} ",
                                         band, (at / "design.tif").string(), (made / "v").string());
  EXPECT_EQ(run_program(scratch().path(), verify + adjust).exit_code, 0);
  EXPECT_EQ(run_program(scratch().path(), verify).exit_code, 1);
  const Outcome both =
      run_program(scratch().path(), kSite + kSmall + adjust + "--set mill.relative=true --out " +
                                        (made / "never").string());
  EXPECT_EQ(both.exit_code, 2);
  EXPECT_THAT(both.err, testing::HasSubstr("mill.relative"));
}

TEST_F(Chain, RefusesAFolderThatIsInUse) {
  const fs::path lock = out() / ".maquette" / "lock";
  const Outcome outcome =
      run_program(scratch().path(), kSite + kSmall + "--out " + out().string(),
                  fmt::format("exec 9<'{}'; flock -n 9 || exit 99; ", lock.string()));
  EXPECT_EQ(outcome.exit_code, 3);
  EXPECT_THAT(outcome.err, testing::HasSubstr("another maquette run"));
}

TEST(SettledStones, GoThroughTheChain) {
  const ScratchFolder scratch;
  const fs::path folder = scratch / "out";
  const Outcome o = run_program(
      scratch.path(), kSite + kSmall +
                          "--set stones.rest=settled --set stones.angularity=0.9 --stage products "
                          "--stage fuse --stage stones --stage mesh --stage export --out " +
                          folder.string());
  ASSERT_EQ(o.exit_code, 0) << o.err;
  std::map<int, meshing::PlacedStone> wide;
  for (const char* scale : {"s1000", "s200"}) {
    SCOPED_TRACE(scale);
    const json said = json::parse(slurp(folder / scale / "surface.certificate.json"));
    EXPECT_EQ(said["passed"], true);
    EXPECT_EQ(said["self_intersection_checked"], true);
    EXPECT_LE(said["max_union_error_mm"], 0.02);
    const json stl = json::parse(slurp(folder / scale / "export/surface.stl.certificate.json"));
    EXPECT_EQ(stl["passed"], true);
    const auto stones = meshing::read_stone_plan(folder / scale / "stones.json").value();
    std::vector<std::pair<Vec3, double>> balls;
    for (const auto& s : stones) {
      double radius = 0.0;
      const Vec3 at = s.model_from_stone.translation_mm;
      for (const Vec3& v : meshing::stone_mesh(s).vertices_mm)
        radius = std::fmax(radius, norm(v - at));
      for (const auto& [other, r] : balls)
        EXPECT_GT(std::hypot(at.x - other.x, at.y - other.y), radius + r) << s.number;
      balls.emplace_back(at, radius);
      if (wide.contains(s.number)) {
        const auto& w = wide.at(s.number);
        EXPECT_NEAR(s.scale_mm, 5.0 * w.scale_mm, 1e-9);
        EXPECT_EQ(s.model_from_stone.rotation, w.model_from_stone.rotation);
        // Both surfaces have the site's centre in their middle.
        const Vec3 a = w.model_from_stone.translation_mm;
        EXPECT_NEAR(at.x - 20.0, 5.0 * (a.x - 20.0), 1e-6);
        EXPECT_NEAR(at.y - 20.0, 5.0 * (a.y - 20.0), 1e-6);
      } else {
        wide.emplace(s.number, s);
      }
    }
    EXPECT_GE(stones.size(), 3U);  // half of five, rounded up, are on the section
  }
  EXPECT_EQ(wide.size(), 5U);
}

/// The real products are not part of the project.
class RealSites : public testing::TestWithParam<const char*> {};

TEST_P(RealSites, RunThroughTheWholeChain) {
  const fs::path data = testing_support::data_folder();
  if (!fs::exists(data / "mars"))
    GTEST_SKIP() << "no real data in " << data << "; set MAQUETTE_DATA to its folder";
  const ScratchFolder scratch;
  // Small pieces of the sites: the chain, not the size, is what is tested here.
  const Outcome outcome = run_program(
      scratch.path(),
      fmt::format("run '{}/assets/sites/{}.toml' --quiet --set size_mm=60 --set stones.count=3 "
                  "--set stones.min_diameter_m=1 --set stones.max_diameter_m=2 --set "
                  "scanner.max_points=60000 --out '{}'",
                  testing_support::source_folder().string(), GetParam(),
                  (scratch / "out").string()),
      fmt::format("MAQUETTE_DATA='{}'", data.string()));
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  EXPECT_TRUE(fs::exists(scratch / "out/report.html"));
}

INSTANTIATE_TEST_SUITE_P(Site, RealSites, testing::Values("gale", "shoemaker"),
                         [](const auto& param) { return std::string(param.param); });

}  // namespace
}  // namespace maquette
