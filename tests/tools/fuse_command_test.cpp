// SPDX-License-Identifier: GPL-3.0-or-later

// `maquette fuse` as a user types it
//   limits of reach.*          each broken one ends with exit code 1 and its key, files stay; kept
//                                ones with 0
//   a composite                two bodies, two scales: masks, bands and gain on disk, 1:200 with
//   the
//                                heights of 1:1000
//   a product of another body  refused under same_body by the file itself, whatever the site says
//   residuals                  a map of each source beside the base, not of an enlargement

#include <string>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "assets/synthetic_products.hpp"
#include "core/files.hpp"
#include "heightmap/body.hpp"
#include "support/matchers.hpp"
#include "support/program.hpp"

namespace maquette {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using testing::AllOf;
using testing::HasSubstr;
using testing_support::Outcome;
using testing_support::run_program;
using testing_support::ScratchFolder;
using testing_support::slurp;

class FuseCommand : public testing::Test {
 protected:
  ScratchFolder scratch;
  fs::path out = scratch / "out";

  assets::SyntheticProducts products(const char* body, std::uint64_t seed) {
    assets::SyntheticSite site;
    site.body = *heightmap::body_by_name(body);
    site.half_width = Metres{40.0};
    site.seed = seed;
    site.fine_noise_m = 0.01;
    fs::create_directories(scratch / body);
    auto files = assets::write_synthetic_products(site, scratch / body);
    EXPECT_TRUE(files.has_value());
    return *files;
  }
  static std::string source(const std::string& name, const fs::path& path,
                            const std::string& more = "") {
    return fmt::format("[[source]]\nname = \"{}\"\npath = \"{}\"\nsigma_m = 0.05\n{}", name,
                       path.string(), more);
  }
  Outcome fuse(const std::string& site, const std::string& set = "") {
    EXPECT_TRUE(write_file(scratch / "site.toml", site));
    return run_program(scratch.path(),
                       fmt::format("fuse {} --out {} --quiet {}", (scratch / "site.toml").string(),
                                   out.string(), set));
  }
};

TEST_F(FuseCommand, SaysWhichLimitsOfTheCutterAreNotKept) {
  const std::string site =
      "size_mm = 40.0\nscales = [1000.0]\n" + source("dtm", products("moon", 1).fine_img);
  const auto kept = fuse(site);
  EXPECT_EQ(kept.exit_code, 0) << kept.err;
  const json reach = json::parse(slurp(out / "s1000" / "reach.json"));
  // Nothing may be left standing: broken if there is any place at all.
  const double unreached = reach.at("unreached_percent");
  ASSERT_GT(unreached, 0.0) << "or this site tells nothing";
  const auto broken = [&](const std::string& set, const char* key) {
    const auto o = fuse(site, set);
    EXPECT_EQ(o.exit_code, 1) << set;
    EXPECT_THAT(o.err, AllOf(HasSubstr("error: "), HasSubstr(key)));
    EXPECT_TRUE(fs::exists(out / "s1000" / "design.tif")) << "work is kept";
  };
  broken(fmt::format("--set reach.max_unreached_percent={}", 0.5 * unreached),
         "max_unreached_percent");
  broken("--set reach.max_slope_deg=1", "reach.max_slope_deg");
  broken("--set reach.cutter_length_mm=0.5", "cutter_length_mm");
  broken("--set reach.stock_height_mm=2", "reach.stock_height_mm");
  const auto just_kept =
      fuse(site, fmt::format("--set reach.max_unreached_percent={}", 1.01 * unreached));
  EXPECT_EQ(just_kept.exit_code, 0) << just_kept.err;
}

TEST_F(FuseCommand, PutsDetailOfOneBodyOnReliefOfAnother) {
  const auto moon = products("moon", 1), mars = products("mars", 2);
  const std::string site =
      "size_mm = 60.0\nscales = [1000.0, 200.0]\n[fusion]\ncombine = \"composite\"\n"
      "crossover_m = 6.0\ndetail_latitude_deg = -43.3\ndetail_longitude_deg = 348.8\n" +
      source("lola", moon.fine_img) + source("hirise", mars.fine_img, "body = \"mars\"\n");
  const auto o = fuse(site);
  ASSERT_EQ(o.exit_code, 0) << o.err;
  const json wide = json::parse(slurp(out / "s1000" / "fuse.json")),
             fine = json::parse(slurp(out / "s200" / "fuse.json"));
  EXPECT_EQ(wide.at("combine"), "composite");
  ASSERT_EQ(wide.at("bands").size(), 2U);
  EXPECT_EQ(wide["bands"][0]["sources"], json({"lola"}));
  EXPECT_EQ(wide["bands"][0]["longer_than_m"], 6.0);
  EXPECT_EQ(wide["bands"][1]["sources"], json({"hirise"}));
  EXPECT_EQ(wide["bands"][1]["body"], "mars");
  EXPECT_GT(wide["bands"][1]["gain"].get<double>(), 0.2);
  EXPECT_LT(wide["bands"][1]["gain"].get<double>(), 5.0);
  EXPECT_EQ(wide["bands"][1]["gain"], fine["bands"][1]["gain"]);
  EXPECT_LT(fine.at("low_pass_um").get<double>(), 5.0);
  for (const char* name : {"source.tif", "detail_source.tif", "detail_source.png"})
    for (const char* scale : {"s1000", "s200"}) EXPECT_TRUE(fs::exists(out / scale / name)) << name;
}

TEST_F(FuseCommand, RefusesAProductOfAnotherBodyWhateverTheSiteSays) {
  const auto o =
      fuse("size_mm = 60.0\nscales = [1000.0]\n" + source("lola", products("moon", 1).fine_img) +
           source("hirise", products("mars", 2).fine_img));
  EXPECT_EQ(o.exit_code, 2);
  EXPECT_THAT(o.err, AllOf(HasSubstr("synthetic_mars_dtm.img"), HasSubstr("moon")));
  EXPECT_FALSE(fs::exists(out / "s1000" / "design.tif"));
}

TEST_F(FuseCommand, LeavesAMapOfWhatAlignmentLeft) {
  const auto moon = products("moon", 1);
  const auto o = fuse("size_mm = 60.0\nscales = [1000.0, 200.0]\n" +
                      source("ldem", moon.coarse_lbl) + source("dtm", moon.fine_img));
  ASSERT_EQ(o.exit_code, 0) << o.err;
  const json figures = json::parse(slurp(out / "s1000" / "fuse.json"));
  const json& dtm = figures.at("sources").at(1);
  EXPECT_EQ(dtm.at("residual"), "residual_1.tif");
  EXPECT_NEAR(dtm.at("residual_nmad_m").get<double>(), dtm.at("nmad_after_m").get<double>(),
              0.3 * dtm.at("nmad_after_m").get<double>());
  EXPECT_TRUE(fs::exists(out / "s1000" / "residual_1.tif"));
  EXPECT_TRUE(fs::exists(out / "s1000" / "residual_1.png"));
  EXPECT_FALSE(fs::exists(out / "s200" / "residual_1.tif"));
  EXPECT_FALSE(figures.at("sources").at(0).contains("residual"));
  // The page has it with its scale of colours, beside uncertainty and sources.
  const std::string page = slurp(out / "fuse.html");
  EXPECT_THAT(
      page,
      AllOf(HasSubstr("difference that alignment left"), HasSubstr("colour scale"),
            HasSubstr(fmt::format("{:+.3g} m</text>", dtm.at("residual_colour_m").get<double>())),
            HasSubstr("standard uncertainty"), HasSubstr("most exact source"),
            HasSubstr("artefacts:")));
  EXPECT_THAT(page, testing::Not(HasSubstr("is missing")));
}

}  // namespace
}  // namespace maquette
