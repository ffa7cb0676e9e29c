// SPDX-License-Identifier: GPL-3.0-or-later

// tools/jobs_sheet.hpp and the scenes of assets/scenes:
//   shrinking ......................... mean light, not mean numbers: a chequerboard in either kind
//   of
//                                       file, sides that do not divide; one value stays that value
//   where pictures stand .............. row by row, in their order, rows as high as their highest
//   captions .......................... under their picture, inside its width however long
//   bad input ......................... a file that is not there
//   scenes that come with the program . are read; their meshes are closed; a descent goes down

#include "tools/jobs_sheet.hpp"

#include <cmath>
#include <map>
#include <utility>

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "camera/image_io.hpp"
#include "core/files.hpp"
#include "meshing/mesh_io.hpp"
#include "support/folders.hpp"
#include "support/matchers.hpp"
#include "tools/jobs.hpp"
#include "tools/scene_file.hpp"
#include "tools/trajectory_file.hpp"

namespace maquette::tools {
namespace {

using testing_support::FailsWith;
using testing_support::ScratchFolder;
using testing_support::Succeeds;

class Sheet : public testing::Test {
 protected:
  ScratchFolder folder;

  /// What the sheet of these holds, 0 to 255.
  Grid<camera::Rgb8> made(const SheetJob& job) {
    const auto result = sheet_job(job, folder / "sheet.png", {});
    EXPECT_THAT(result, Succeeds());
    const auto image = camera::read_image(folder / "sheet.png");
    EXPECT_THAT(image, Succeeds());
    const auto& c = image->channels;
    EXPECT_EQ(c.size(), 3U);
    Grid<camera::Rgb8> sheet(c[0].rows(), c[0].cols());
    for (std::size_t i = 0; i < sheet.cells().size(); ++i)
      for (std::size_t b = 0; b < 3; ++b)
        sheet.cells()[i][b] = static_cast<std::uint8_t>(std::lround(255.0F * c[b].cells()[i]));
    return sheet;
  }
  fs::path exr(const std::string& name, const Grid<float>& light) {
    EXPECT_THAT(camera::write_exr({{"Y", &light}}, folder / name), Succeeds());
    return folder / name;
  }
  static constexpr std::ptrdiff_t kGap = 2;     ///< of pictures up to 80 pixels wide
  static constexpr std::ptrdiff_t kStrip = 18;  ///< of captions under such
};

TEST_F(Sheet, ShrinksLight) {
  Grid<float> chequered(64, 96);
  Grid<std::uint8_t> as_png(64, 96);
  for (std::ptrdiff_t r = 0; r < 64; ++r)
    for (std::ptrdiff_t c = 0; c < 96; ++c) {
      chequered(r, c) = static_cast<float>((r + c) % 2);
      as_png(r, c) = (r + c) % 2 == 0 ? 0 : 255;
    }
  ASSERT_THAT(camera::write_png(as_png, folder / "b.png"), Succeeds());
  const auto sheet = made({{exr("a.exr", chequered), folder / "b.png"}, {"", ""}, 2, 48});
  const std::uint8_t half = camera::srgb8(0.5);  // 188: 128 would be the mean of the numbers
  EXPECT_EQ(half, 188);
  for (std::ptrdiff_t r = 0; r < 32; ++r)
    for (std::ptrdiff_t c = 0; c < 48; ++c) {
      ASSERT_EQ(sheet(kGap + r, kGap + c), (camera::Rgb8{half, half, half})) << r << ' ' << c;
      ASSERT_EQ(sheet(kGap + r, kGap + 48 + kGap + c), (camera::Rgb8{half, half, half}));
    }
}

TEST_F(Sheet, KeepsTheMeanWhereSidesDoNotDivide) {
  // A ramp of light: what a pixel covers has the ramp's value in its middle.
  Grid<float> ramp(30, 100);
  for (std::ptrdiff_t r = 0; r < 30; ++r)
    for (std::ptrdiff_t c = 0; c < 100; ++c)
      ramp(r, c) = static_cast<float>((static_cast<double>(c) + 0.5) / 200.0);
  const auto sheet = made({{exr("a.exr", ramp)}, {""}, 0, 37, 2.0});
  for (std::ptrdiff_t c = 1; c < 36; ++c)
    // Whole steps of the ramp instead of a line: a sixteenth of a step at most; then rounding.
    EXPECT_NEAR(sheet(kGap + 5, kGap + c)[0], camera::srgb8((static_cast<double>(c) + 0.5) / 37.0),
                1.0)
        << c;
  const auto even = made({{exr("b.exr", Grid<float>(7, 5, 0.25F))}, {""}, 0, 64});
  for (std::ptrdiff_t r = 0; r < 90; ++r)
    for (std::ptrdiff_t c = 0; c < 64; ++c)
      ASSERT_EQ(even(kGap + r, kGap + c)[1], camera::srgb8(0.25)) << "also larger than it was";
}

TEST_F(Sheet, PutsPicturesRowByRow) {
  SheetJob job;
  job.columns = 3, job.width_px = 40;
  for (int i = 0; i < 5; ++i) {
    // The second one is twice as high as the others.
    job.pictures.push_back(
        exr(fmt::format("p{}.exr", i),
            Grid<float>(i == 1 ? 80 : 40, 40, 0.1F * static_cast<float>(i + 1))));
    job.captions.emplace_back();
  }
  const auto sheet = made(job);
  EXPECT_EQ(sheet.cols(), kGap + 3 * (40 + kGap));
  EXPECT_EQ(sheet.rows(), kGap + 80 + kStrip + kGap + 40 + kStrip + kGap);
  for (int i = 0; i < 5; ++i) {
    const std::ptrdiff_t top = i < 3 ? kGap : kGap + 80 + kStrip + kGap;
    const std::ptrdiff_t left = kGap + (i % 3) * (40 + kGap);
    EXPECT_EQ(sheet(top, left)[0], camera::srgb8(0.1 * (i + 1))) << i;
    EXPECT_EQ(sheet(top + 39, left + 39)[0], camera::srgb8(0.1 * (i + 1))) << i;
    EXPECT_EQ(sheet(top, left - 1)[0], 255) << i;
  }
  EXPECT_EQ(sheet(kGap + 79, kGap + 40 + kGap)[0], camera::srgb8(0.2));
  EXPECT_EQ(sheet(kGap + 60, kGap + 5)[0], 255) << "paper under a lower one";
  const auto again = sheet_job(job, folder / "sheet.png", {});
  ASSERT_THAT(again, Succeeds());
  EXPECT_EQ(nlohmann::json::parse(again->figures_json)["pictures"], 5);
}

TEST_F(Sheet, WritesCaptionsUnderTheirPictures) {
  const auto grey = exr("grey.exr", Grid<float>(40, 80, 0.5F));
  const auto dark = [](const Grid<camera::Rgb8>& sheet, std::ptrdiff_t left, std::ptrdiff_t right) {
    int n = 0;
    for (std::ptrdiff_t r = kGap + 40; r < kGap + 40 + kStrip; ++r)
      for (std::ptrdiff_t c = left; c < right; ++c) n += sheet(r, c)[0] < 200 ? 1 : 0;
    return n;
  };
  const auto sheet = made({{grey, grey, grey},
                           {"", "t = 2.5 s", "a caption that is far wider than its picture"},
                           3,
                           80});
  EXPECT_EQ(dark(sheet, kGap, kGap + 80), 0);
  EXPECT_GT(dark(sheet, kGap + 82, kGap + 162), 20);
  EXPECT_GT(dark(sheet, kGap + 164, kGap + 244), 5);
  EXPECT_EQ(dark(sheet, kGap + 162, kGap + 164), 0);
  EXPECT_EQ(dark(sheet, kGap + 244, sheet.cols()), 0);
  EXPECT_GT(dark(made({{grey}, {}, 0, 80}), kGap, kGap + 80), 5) << "its name";
}

TEST_F(Sheet, IsRefusedWithoutAPicture) {
  EXPECT_THAT(sheet_job({{folder / "none.png"}}, folder / "sheet.png", {}),
              FailsWith(kFileNotFound));
  EXPECT_FALSE(fs::exists(folder / "sheet.png"));
}

TEST(ShippedScenes, AreReadAndWhole) {
  const fs::path scenes = testing_support::source_folder() / "assets/scenes";
  int read = 0, meshes = 0;
  for (const auto& entry : fs::directory_iterator(scenes)) {
    if (entry.path().extension() != ".toml") continue;
    SCOPED_TRACE(entry.path().string());
    const auto scene = read_scene(entry.path());
    ASSERT_THAT(scene, Succeeds());
    ++read;
    EXPECT_EQ((*scene)->surface.filename(), "design.tif");
    for (const SceneMesh& object : (*scene)->parts.objects) {
      const auto mesh = meshing::read_mesh(object.mesh);
      ASSERT_THAT(mesh, Succeeds());
      // Each edge once in either direction.
      std::map<std::pair<std::uint32_t, std::uint32_t>, int> edges;
      for (const auto& t : mesh->triangles)
        for (std::size_t k = 0; k < 3; ++k) ++edges[{t[k], t[(k + 1) % 3]}];
      for (const auto& [edge, n] : edges) {
        const auto back = edges.find({edge.second, edge.first});
        ASSERT_TRUE(back != edges.end() && back->second == n) << object.mesh;
      }
      ++meshes;
    }
    if ((*scene)->trajectory.empty()) continue;
    const auto way = read_trajectory((*scene)->trajectory);
    ASSERT_THAT(way, Succeeds());
    EXPECT_EQ(way->size(), 60U);
    for (std::size_t i = 1; i < way->size(); ++i)
      EXPECT_LT((*way)[i].model_from_camera.translation_mm.z,
                (*way)[i - 1].model_from_camera.translation_mm.z);
  }
  EXPECT_GE(read, 5);
  EXPECT_GE(meshes, 3);
}

}  // namespace
}  // namespace maquette::tools
