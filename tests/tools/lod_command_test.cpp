// SPDX-License-Identifier: GPL-3.0-or-later

// maquette lod as a user starts it: bits that do not do are refused with those that would, and with
// a word where there are none; pictures of sides that engines do not take; a folder that is there
// is gone on with or made again, a file in its place one error; skirts and albedo reach lod.json.

#include <cmath>
#include <filesystem>
#include <fstream>
#include <regex>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "heightmap/field_io.hpp"
#include "support/matchers.hpp"
#include "support/program.hpp"

namespace maquette::tools {
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

class LodCommand : public testing::Test {
 protected:
  LodCommand() {
    heightmap::ModelField field{Grid<float>(41, 57), Millimetres{0.5}, {}, {}};
    for (std::ptrdiff_t r = 0; r < 41; ++r)
      for (std::ptrdiff_t c = 0; c < 57; ++c)
        field.z_mm(r, c) = static_cast<float>(std::sin(0.3 * static_cast<double>(r + 2 * c)));
    EXPECT_TRUE(heightmap::write_model_field(field, scratch / "design.tif"));
  }
  Outcome lod(const std::string& arguments) {
    return run_program(scratch.path(),
                       fmt::format("lod '{}' --tile-quads 16 --out '{}' {}",
                                   (scratch / "design.tif").string(), out().string(), arguments));
  }
  void expect_refused(const std::string& arguments, const std::string& code,
                      const std::string& words) {
    const Outcome o = lod(arguments + " --json");
    EXPECT_EQ(o.exit_code, 2) << arguments;
    EXPECT_THAT(o.out, HasSubstr(code)) << arguments;
    EXPECT_THAT(o.err, HasSubstr(words)) << arguments;
    EXPECT_FALSE(fs::exists(out())) << arguments;
  }
  [[nodiscard]] fs::path out() const { return scratch / "lod"; }
  [[nodiscard]] json figures() const { return json::parse(slurp(out() / "lod.json")); }
  ScratchFolder scratch;
};

TEST_F(LodCommand, NamesTheBitsThatWouldDo) {
  const std::string coarse = "EXPORT_QUANTISATION_TOO_COARSE";
  const Outcome o = lod("--bits 10 --max-error-mm 0.001");
  EXPECT_EQ(o.exit_code, 2);
  std::smatch bits;
  ASSERT_TRUE(std::regex_search(o.err, bits, std::regex("([0-9]+) bits would do"))) << o.err;
  // 28 mm in steps of 2 um: 14000.
  EXPECT_EQ(bits[1], "14");
  expect_refused("--bits 13 --max-error-mm 0.001", coarse, "14 bits would do");
  EXPECT_EQ(lod("--bits 14 --max-error-mm 0.001").exit_code, 0);
  EXPECT_LE(figures()["levels"][0]["max_vertical_error_mm"].get<double>(), 0.001);
}

TEST_F(LodCommand, SaysThatNoBitsDo) {
  const std::string coarse = "EXPORT_QUANTISATION_TOO_COARSE";
  // 28 mm in steps of 2e-5 mm: 1.4 million, 21 bits; of 2e-6 mm 24 bits.
  expect_refused("--max-error-mm 1e-5", coarse, "21 bits would do");
  EXPECT_THAT(lod("--max-error-mm 1e-5").err, Not(HasSubstr("of which")));
  expect_refused("--max-error-mm 1e-6", coarse, "24 bits would do, of which there are 22");
  expect_refused("--bits 22 --max-error-mm 1e-6", coarse,
                 "24 bits would do, of which there are 22");
  expect_refused("--bits 24", "EXPORT_OPTION_OUT_OF_RANGE", "8 to 22");
  expect_refused("--max-error-mm 0", "EXPORT_OPTION_OUT_OF_RANGE", "more than 0");
  expect_refused("--max-error-mm -1", "EXPORT_OPTION_OUT_OF_RANGE", "more than 0");
}

TEST_F(LodCommand, RefusesPicturesThatEnginesDoNotTake) {
  const std::string range = "EXPORT_OPTION_OUT_OF_RANGE";
  expect_refused("--textures 8192", range, "16 to 4096");
  expect_refused("--textures 8", range, "16 to 4096");
  expect_refused("--textures -64", range, "16 to 4096");
  expect_refused("--textures 64 --no-normals", range, "pictures without normals");
  EXPECT_EQ(lod("--textures many").exit_code, 2);
}

TEST_F(LodCommand, RefusesAnAlbedoThatDoesNotLieOnTheSurface) {
  expect_refused("--textures 64 --albedo nowhere.png", "EXPORT_ALBEDO_UNUSABLE", "nowhere.png");
  std::ofstream(scratch / "text.png") << "no picture";
  expect_refused(fmt::format("--textures 64 --albedo '{}'", (scratch / "text.png").string()),
                 "EXPORT_ALBEDO_UNUSABLE", "text.png");
  const Outcome alone = lod("--albedo nowhere.png");
  EXPECT_EQ(alone.exit_code, 2);
  EXPECT_THAT(alone.err, AllOf(HasSubstr("--albedo"), HasSubstr("--textures")));
  // Heights between 0.1 and 0.9 would do as reflectances; the field's own are beyond that.
  expect_refused(fmt::format("--textures 64 --albedo '{}'", (scratch / "design.tif").string()),
                 "EXPORT_ALBEDO_UNUSABLE", "0 to 1 expected");
}

TEST_F(LodCommand, TakesAnAlbedoAndSkirts) {
  // Wider than the site, half as bright as can be.
  heightmap::ModelField grey{Grid<float>(41, 57, 0.5F), Millimetres{0.5}, {}, {}};
  ASSERT_TRUE(heightmap::write_model_field(grey, scratch / "grey.tif"));
  const Outcome o =
      lod(fmt::format("--textures 64 --skirts --albedo '{}'", (scratch / "grey.tif").string()));
  EXPECT_EQ(o.exit_code, 0) << o.err;
  EXPECT_EQ(figures()["albedo"], true);
  EXPECT_GT(figures()["levels"][0]["skirt_mm"].get<double>(), 0.0);
  EXPECT_EQ(lod("").exit_code, 0);
  EXPECT_EQ(figures()["albedo"], false);
  EXPECT_EQ(figures()["levels"][0]["skirt_mm"], 0.0);
}

TEST_F(LodCommand, GoesOnWithWhatIsThere) {
  const std::string there = "tiles were there";
  EXPECT_THAT(lod("").err, Not(HasSubstr(there)));
  const std::string first = slurp(out() / "tiles/0/0/0.glb");
  std::ofstream(out() / "notes.txt") << "mine";
  const json again = json::parse(lod("--json").out);
  EXPECT_THAT(again.dump(), HasSubstr("\"kept_tiles\":17"));
  EXPECT_EQ(slurp(out() / "tiles/0/0/0.glb"), first);
  const json other = json::parse(lod("--json --bits 20").out);
  EXPECT_THAT(other.dump(), HasSubstr("\"kept_tiles\":0"));
  EXPECT_NE(slurp(out() / "tiles/0/0/0.glb"), first);
  EXPECT_EQ(slurp(out() / "notes.txt"), "mine");
}

TEST_F(LodCommand, SaysThatAFileIsInTheWay) {
  std::ofstream(out()) << "mine";
  const Outcome o = lod("--json");
  EXPECT_EQ(o.exit_code, 3);
  EXPECT_THAT(o.out, HasSubstr("CORE_FILE_NOT_WRITABLE"));
  EXPECT_THAT(o.err, HasSubstr(out().string()));
  EXPECT_EQ(slurp(out()), "mine");
}

TEST_F(LodCommand, RefusesWhatIsNoSurface) {
  const auto of = [&](const std::string& design) {
    return run_program(scratch.path(),
                       fmt::format("lod '{}' --out '{}' --json", design, out().string()));
  };
  EXPECT_EQ(of((scratch / "nowhere.tif").string()).exit_code, 2);
  std::ofstream(scratch / "text.tif") << "no raster";
  EXPECT_EQ(of((scratch / "text.tif").string()).exit_code, 2);
  EXPECT_FALSE(fs::exists(out()));
}

}  // namespace
}  // namespace maquette::tools
