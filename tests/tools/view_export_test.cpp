// SPDX-License-Identifier: GPL-3.0-or-later

// Claims of tools/view's export and how each is attacked
//   a grid unpacks to within half a step, voids to voids      random heights, one row of nodes that
//                                                             jump, all void, all alike
//   the page has all in itself and ends nowhere before its end    a program and a file's name that
//                                                             hold </script>
//   it weighs no more than it may, and is as fine as fits     rising weights; too little is one
//   error how far the carried surface is from the file's            a roof, whose ridge is off by a
//   closed form what does not fit is named                                a picture larger than its
//   share

#include "tools/view/view_export.hpp"

#include <cmath>
#include <random>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "camera/image_io.hpp"
#include "core/files.hpp"
#include "heightmap/field_io.hpp"
#include "support/matchers.hpp"
#include "tools/view/packed_grid.hpp"
#include "tools/view/single_page.hpp"
#include "tools/view/view_contents.hpp"

namespace maquette::tools {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::Not;
using testing_support::FailsWith;
using testing_support::ScratchFolder;
using testing_support::Succeeds;

constexpr std::array<PageFile, 5> kPage{
    {{"assets/index-a.css", "main { color: red }"},
     {"assets/index-b.js", "const s = '</script>'; // <!-- <script>"},
     {"assets/draco_decoder-c.wasm", "wasm"},
     {"index.html",
      "<!doctype html><html><head><meta charset=\"utf-8\">\n"
      "<script type=\"module\" crossorigin src=\"./assets/index-b.js\"></script>\n"
      "<link rel=\"stylesheet\" crossorigin href=\"./assets/index-a.css\"></head><body><aside>"
      "<a href=\"licences.txt\">licences</a></aside></body></html>"},
     {"licences.txt", "MIT <a@b> & more"}}};

ThinnedField random_field(std::ptrdiff_t rows, std::ptrdiff_t cols, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<float> step(0.0F, 0.3F);
  ThinnedField f;
  f.rows = rows;
  f.cols = cols;
  float z = 20.0F;
  for (std::ptrdiff_t i = 0; i < rows * cols; ++i) {
    z += step(random);
    f.values.push_back(i % 37 == 5 ? NAN : z);
  }
  return f;
}

void expect_same(const ThinnedField& f, double least_step) {
  const PackedGrid grid = packed(f, least_step);
  const auto back =
      unpacked(grid, static_cast<std::size_t>(f.rows), static_cast<std::size_t>(f.cols));
  ASSERT_EQ(back.size(), f.values.size());
  for (std::size_t i = 0; i < back.size(); ++i) {
    ASSERT_EQ(std::isnan(back[i]), std::isnan(f.values[i])) << i;
    // Half a step and a float's rounding near 100.
    if (!std::isnan(back[i])) {
      ASSERT_NEAR(back[i], f.values[i], 0.5 * grid.step + 8e-6) << i;
    }
  }
}

TEST(PackedGrid, UnpacksToWithinHalfAStep) {
  for (const unsigned seed : {1U, 2U, 3U}) {
    expect_same(random_field(31, 47, seed), 0.002);
    expect_same(random_field(2, 300, seed), 1e-9);  // as fine as 16 bits let it be
  }
  ThinnedField jumps = random_field(2, 64, 4);
  for (std::size_t i = 0; i < jumps.values.size(); ++i)
    jumps.values[i] = i % 2 == 0 ? -100.0F : 100.0F;
  expect_same(jumps, 0.002);
  ThinnedField none = random_field(3, 3, 5);
  std::fill(none.values.begin(), none.values.end(), NAN);
  expect_same(none, 0.002);
  std::fill(none.values.begin(), none.values.end(), 7.25F);
  expect_same(none, 0.002);
  EXPECT_EQ(packed(none, 0.002).step, 0.002);
}

TEST(SinglePage, HoldsAllAndAsksForNothing) {
  const std::string html = single_page(kPage, "<p>carried</p>");
  EXPECT_THAT(html, AllOf(HasSubstr("<style>main { color: red }</style>"),
                          HasSubstr("const s = '<\\/script>'; // <\\!-- <script>"),
                          HasSubstr("MIT &lt;a@b> &amp; more"), HasSubstr("default-src 'none'"),
                          HasSubstr("<p>carried</p></body>")));
  EXPECT_THAT(html, AllOf(Not(HasSubstr("assets/")), Not(HasSubstr("href=\"licences")),
                          Not(HasSubstr("src=\""))));
  EXPECT_EQ(single_page({}, "x"), "");
}

/// A roof whose ridge is at a third of 401 x 401 nodes of 0.5 mm.
heightmap::ModelField roof() {
  heightmap::ModelField f{Grid<float>(401, 401), Millimetres{0.5}, {}, {}};
  for (std::ptrdiff_t r = 0; r < 401; ++r)
    for (std::ptrdiff_t c = 0; c < 401; ++c)
      f.z_mm(r, c) = static_cast<float>(10.0 - 0.25 * std::fabs(f.x_mm(c) - 66.5) +
                                        0.01 * std::sin(7.0 * f.y_mm(r)));
  return f;
}

class Export : public testing::Test {
 protected:
  Export() {
    fs::create_directories(folder);
    EXPECT_TRUE(heightmap::write_model_field(roof(), folder / "design.tif"));
    heightmap::ModelField noise = roof();  // what weighs
    std::mt19937 random(6);
    std::normal_distribution<float> of(0.0F, 0.1F);
    for (float& z : noise.z_mm.cells()) z = of(random);
    EXPECT_TRUE(heightmap::write_model_field(noise, folder / "deviation.tif"));
  }
  [[nodiscard]] Result<JobResult> make(double most_mb) const {
    return view_export_job(folder, out, kPage, most_mb);
  }
  [[nodiscard]] json index() const {
    const std::string html = *read_file(out);
    const std::string open = "<script id=\"carried-index\" type=\"application/json\">";
    const std::size_t from = html.find(open) + open.size();
    return json::parse(html.substr(from, html.find("</script>", from) - from));
  }
  ScratchFolder scratch;
  fs::path folder = scratch / "site", out = scratch / "page.html";
};

TEST_F(Export, IsAsFineAsFits) {
  std::vector<std::ptrdiff_t> sides;
  for (const double mb : {0.04, 0.1, 0.3, 3.0}) {
    const auto made = make(mb);
    ASSERT_THAT(made, Succeeds()) << mb;
    EXPECT_LE(static_cast<double>(fs::file_size(out)), 1e6 * mb);
    sides.push_back(json::parse(made->figures_json)["nodes_a_side"]);
  }
  EXPECT_THAT(sides, testing::WhenSorted(testing::ContainerEq(sides)));
  EXPECT_LT(sides.front(), sides.back());
  EXPECT_EQ(sides.back(), 401);
  EXPECT_THAT(make(0.002), FailsWith(kViewExportSmall));
}

TEST_F(Export, SaysHowFarTheCarriedSurfaceIsFromTheFile) {
  ASSERT_THAT(make(3.0), Succeeds());
  // Whole: what rounding leaves, and a float's half digit near 10.
  EXPECT_NEAR(index()["entries"]["grid/design.tif"]["grid"]["most_mm"].get<double>(),
              0.5 * kHeightStep_mm, 1e-5);
  ASSERT_THAT(make(0.06), Succeeds());
  const json about = index()["entries"]["grid/design.tif"]["grid"];
  EXPECT_EQ(about["whole"], false);
  // Between two nodes h apart, a and h - a from the ridge, a chord cuts off 2 s a (h - a) / h; y
  // adds its waves of 0.01 to both, and rounding half a step.
  const double h = about["dx_mm"], a = std::fmod(66.5, h), off = 2.0 * 0.25 * a * (h - a) / h;
  EXPECT_NEAR(about["most_mm"].get<double>(), off, 0.02 + kHeightStep_mm);
  EXPECT_LT(about["rms_mm"].get<double>(), about["most_mm"].get<double>());
}

TEST_F(Export, NamesWhatDoesNotFit) {
  fs::create_directories(folder / "a<b");
  ASSERT_TRUE(write_file(folder / "a<b/scene.toml",
                         "schema = \"maquette.scene/1\"\n"
                         "surface = \"design.tif\"\n"));
  Grid<std::uint8_t> noise(500, 600);  // 300 kB, however it is packed
  std::mt19937 random(7);
  for (std::uint8_t& v : noise.cells()) v = static_cast<std::uint8_t>(random() & 0xff);
  ASSERT_TRUE(camera::write_png(noise, folder / "a<b/picture.png"));
  ASSERT_TRUE(write_file(folder / "stones.json", R"({"stones": []})"));
  const auto made = make(1.0);
  ASSERT_THAT(made, Succeeds());
  EXPECT_THAT(json::parse(made->figures_json)["left_out"], ElementsAre("a<b/picture.png"));
  EXPECT_THAT(index()["left_out"], ElementsAre("a<b/picture.png"));
  EXPECT_TRUE(index()["entries"].contains("files/stones.json"));
  EXPECT_THAT(*read_file(out), Not(HasSubstr("a<b/")));  // a letter that could begin an element
  ASSERT_THAT(make(9.0), Succeeds());
  EXPECT_TRUE(index()["left_out"].empty());
  EXPECT_TRUE(index()["entries"].contains("files/a<b/picture.png"));
  ASSERT_TRUE(write_file(folder / "a<b/picture.png", "no picture"));
  fs::resize_file(folder / "deviation.tif", 2000);
  ASSERT_THAT(make(3.0), Succeeds());
  EXPECT_THAT(index()["damaged"], ElementsAre("a<b/picture.png", "deviation.tif"));
}

TEST_F(Export, RefusesAFolderWithNothingToShow) {
  fs::create_directories(scratch / "empty");
  EXPECT_THAT(view_export_job(scratch / "empty", out, kPage, 10.0), FailsWith(kViewNothing));
  EXPECT_FALSE(fs::exists(out));
}

}  // namespace
}  // namespace maquette::tools
