// SPDX-License-Identifier: GPL-3.0-or-later

// tools/scene_file.hpp, scene_parts.hpp, trajectory_file.hpp, render_job:
//   the picture holds what it says ..... channels, closed-form values at a pixel, metadata that
//                                        make the same picture again, bit for bit
//   a trajectory ...................... numbered pictures; a second run keeps them, a changed scene
//                                        makes them anew; each is the single picture of its pose
//   bad input ......................... one error that names what is wrong, no picture left behind

#include "tools/trajectory_file.hpp"

#include <array>
#include <fstream>
#include <numbers>

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "camera/image_io.hpp"
#include "core/files.hpp"
#include "heightmap/field_io.hpp"
#include "meshing/stones.hpp"
#include "support/matchers.hpp"
#include "tools/jobs.hpp"

namespace maquette::tools {
namespace {

using testing_support::FailsWith;
using testing_support::Succeeds;

class RenderScene : public testing::Test {
 protected:
  testing_support::ScratchFolder folder;

  void SetUp() override {
    // A plane at z = 2 mm, 50 x 50 mm.
    heightmap::ModelField field{Grid<float>(101, 101, 2.0F), Millimetres{0.5}, Millimetres{0},
                                Millimetres{0}};
    ASSERT_THAT(heightmap::write_model_field(field, folder / "design.tif"), Succeeds());
    // A tetrahedron of 4 mm, standing on its base.
    std::ofstream(folder / "tip.obj") << "v -2 -2 0\nv 2 -2 0\nv 0 2 0\nv 0 0 4\n"
                                         "f 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n";
  }
  [[nodiscard]] std::string scene(const std::string& more = "") const {
    return "schema = \"maquette.scene/1\"\nsurface = \"design.tif\"\nresolution_px = [32, 24]\n"
           "pixel_pitch_um = 100\nfocal_length_mm = 10\ncamera_position_mm = [25, 20, 102]\n"
           "camera_target_mm = [25, 25, 2]\nlamp_position_mm = [-200, 25, 302]\n"
           "lamp_target_mm = [25, 25, 2]\nlamp_beam_deg = 90\nsamples_per_pixel = 1\n" +
           more;
  }
  [[nodiscard]] Result<JobResult> render(const std::string& text, const fs::path& out) const {
    std::ofstream(folder / "scene.toml") << text;
    return render_job(folder / "scene.toml", out, {});
  }
  static const Grid<float>& channel(const camera::LoadedImage& image, const std::string& name) {
    for (std::size_t i = 0; i < image.names.size(); ++i)
      if (image.names[i] == name) return image.channels[i];
    throw std::runtime_error("no channel " + name);
  }
};

TEST_F(RenderScene, HoldsLightAndGeometry) {
  const fs::path out = folder / "a.exr";
  ASSERT_THAT(
      render(scene("surface_material = \"red\"\n[[material]]\nname = \"red\"\nlaw = \"lambert\"\n"
                   "albedo = [0.8, 0.4, 0.2]\n[[material]]\nname = \"dark\"\nalbedo = [0.1]\n"
                   "[[object]]\nmesh = \"tip.obj\"\nmaterial = \"dark\"\n"
                   "position_mm = [15, 32, 2]\n[[object]]\nmesh = \"tip.obj\"\n"
                   "material = \"dark\"\nposition_mm = [35, 32, 2]\n"),
             out),
      Succeeds());
  const auto image = camera::read_image(out);
  ASSERT_THAT(image, Succeeds());
  // The middle pixel's corner looks at (25, 25, 2); its centre within half a pixel of it.
  const double x = static_cast<double>(channel(*image, "position.X")(12, 16));
  const double y = static_cast<double>(channel(*image, "position.Y")(12, 16));
  EXPECT_NEAR(x, 25.5, 0.1);
  EXPECT_NEAR(y, 24.5, 0.1);
  EXPECT_NEAR(channel(*image, "position.Z")(12, 16), 2.0, 1e-5);
  const Vec3 lamp{-200 - x, 25 - y, 300}, eye{25 - x, 20 - y, 100};
  const double mu0 = lamp.z / norm(lamp);
  const double falloff = (225.0 * 225.0 + 300.0 * 300.0) / dot(lamp, lamp);
  const double degree = 180.0 / std::numbers::pi;
  EXPECT_NEAR(channel(*image, "R")(12, 16), 0.8 * mu0 * falloff, 1e-5);
  EXPECT_NEAR(channel(*image, "G")(12, 16), 0.4 * mu0 * falloff, 1e-5);
  EXPECT_NEAR(channel(*image, "B")(12, 16), 0.2 * mu0 * falloff, 1e-5);
  EXPECT_NEAR(channel(*image, "Z")(12, 16), norm(eye), 1e-3);
  EXPECT_NEAR(channel(*image, "angle.incidence")(12, 16), degree * std::acos(mu0), 1e-3);
  EXPECT_NEAR(channel(*image, "angle.emission")(12, 16), degree * std::acos(eye.z / norm(eye)),
              1e-3);
  EXPECT_NEAR(channel(*image, "angle.phase")(12, 16),
              degree * std::acos(dot(lamp, eye) / norm(lamp) / norm(eye)), 1e-3);
  EXPECT_EQ(channel(*image, "normal.Z")(12, 16), 1.0F);
  EXPECT_EQ(channel(*image, "lit")(12, 16), 1.0F);
  int parts[4] = {0, 0, 0, 0};
  for (const float part : channel(*image, "part").cells()) ++parts[static_cast<int>(part)];
  EXPECT_GT(parts[1], 300);  // the ground
  EXPECT_GT(parts[2], 2);    // both places of the one mesh
  EXPECT_GT(parts[3], 2);
}

// A part that lies 8 mm aside and 3 mm higher carries its stones with it.
TEST_F(RenderScene, StonesLieWhereThePartLies) {
  meshing::PlacedStone stone;
  stone.number = 1;
  stone.scale_mm = 6.0;
  stone.model_from_stone.translation_mm = {17, 25, 2};
  ASSERT_THAT(meshing::write_stone_plan(std::array{stone}, folder / "stones.json"), Succeeds());
  std::ofstream(folder / "lies.toml") << "schema = \"maquette.corrections/1\"\n[surface]\n"
                                         "translation_mm = [8, 0, 3]\n";
  const fs::path out = folder / "a.exr";
  ASSERT_THAT(render(scene("stones = \"stones.json\"\ncorrections = \"lies.toml\"\n"), out),
              Succeeds());
  const auto image = camera::read_image(out);
  ASSERT_THAT(image, Succeeds());
  double sum = 0.0, n = 0.0;
  for (std::ptrdiff_t r = 0; r < 24; ++r)
    for (std::ptrdiff_t c = 0; c < 32; ++c) {
      const auto z = static_cast<double>(channel(*image, "position.Z")(r, c));
      if (channel(*image, "part")(r, c) != 2.0F) {
        EXPECT_NEAR(z, 5.0, 1e-4) << "the ground";
        continue;
      }
      EXPECT_GT(z, 5.0 - 1e-4);
      sum += static_cast<double>(channel(*image, "position.X")(r, c));
      ++n;
    }
  ASSERT_GT(n, 10.0);               // 6 mm wide, 1 mm a pixel
  EXPECT_NEAR(sum / n, 25.0, 1.0);  // rocks are not quite round
}

TEST_F(RenderScene, IsGreyWhereNothingHasAColour) {
  ASSERT_THAT(render(scene("geometry = false\n"), folder / "grey.exr"), Succeeds());
  const auto image = camera::read_image(folder / "grey.exr");
  ASSERT_THAT(image, Succeeds());
  EXPECT_EQ(image->channels.size(), 3U);  // Y, Z, lit
  EXPECT_NEAR(channel(*image, "Y")(12, 16), 0.3 * 0.8, 2e-3);
}

TEST_F(RenderScene, GoesAlongATrajectoryAndGoesOn) {
  std::ofstream(folder / "way.csv") << "time_s,x_mm,y_mm,z_mm,qw,qx,qy,qz\n0,25,25,102,1,0,0,0\n"
                                       "0.5,25,25,82,1,0,0,0\n1,25,25,62,1,0,0,0\n";
  const std::string text = scene("trajectory = \"way.csv\"\nlamp_diameter_mm = 20\n");
  const fs::path out = folder / "down.exr";
  auto first = render(text, out);
  ASSERT_THAT(first, Succeeds());
  EXPECT_EQ(first->outputs.size(), 6U);
  const auto bytes = [&](int i) { return *read_file(folder / fmt::format("down_{:04}.exr", i)); };
  const std::string two = bytes(2);
  fs::remove(folder / "down_0002.exr");  // as if the run had been stopped
  const auto stamp = fs::last_write_time(folder / "down_0001.exr");
  auto second = render(text, out);
  ASSERT_THAT(second, Succeeds());
  EXPECT_EQ(nlohmann::json::parse(second->figures_json)["kept"], 2);
  EXPECT_EQ(fs::last_write_time(folder / "down_0001.exr"), stamp);
  EXPECT_EQ(bytes(2), two);
  const std::string three = bytes(3);
  auto changed = render(text + "albedo = 0.5\n", out);
  ASSERT_THAT(changed, Succeeds());
  EXPECT_EQ(nlohmann::json::parse(changed->figures_json)["kept"], 0);
  EXPECT_NE(bytes(3), three);
  // Depth at the middle: 100, 80, 60 mm above the plane, along the ray of the pixel's centre.
  for (int i = 1; i <= 3; ++i) {
    const auto image = camera::read_image(folder / fmt::format("down_{:04}.exr", i));
    const double height = 120.0 - 20.0 * i;
    EXPECT_NEAR(channel(*image, "Z")(12, 16), height * std::sqrt(1 + 2 * 0.005 * 0.005), 1e-3);
  }
}

TEST_F(RenderScene, RefusesWhatMakesNoSense) {
  const fs::path out = folder / "bad.exr";
  const auto refuses = [&](const std::string& more, ErrorCode code, const std::string& says) {
    const auto result = render(scene(more), out);
    EXPECT_THAT(result, FailsWith(code)) << more;
    if (!result) {
      EXPECT_NE(result.error().message.find(says), std::string::npos) << result.error().message;
    }
    EXPECT_FALSE(fs::exists(out));
  };
  refuses("surface_material = \"gold\"\n", kConfigInvalid, "gold");
  refuses("[[object]]\nmesh = \"tip.obj\"\n", kConfigInvalid, "material");  // mesh without material
  refuses("[[object]]\nmesh = \"tip.obj\"\nmaterial = \"x\"\n", kConfigInvalid, "\"x\"");
  refuses("[[object]]\nmesh = \"none.obj\"\nmaterial = \"x\"\n[[material]]\nname = \"x\"\n",
          kFileNotFound, "none.obj");
  refuses(
      "surface_material = \"x\"\n[[material]]\nname = \"x\"\nalbedo_map = \"none.png\"\n"
      "map_rectangle_mm = [0, 0, 1, 1]\n",
      kFileNotFound, "none.png");
  refuses("surface_material = \"x\"\n[[material]]\nname = \"x\"\nalbedo = [1, 2]\n", kConfigInvalid,
          "albedo");
  refuses("surface_material = \"x\"\n[[material]]\nname = \"x\"\nlaw = \"table\"\n", kConfigInvalid,
          "table");
  refuses("lamp_intensity = \"none.ies\"\n", kFileNotFound, "none.ies");
  refuses("ambient = [1, 2]\n", kConfigInvalid, "ambient");
  refuses("trajectory = \"none.csv\"\n", kFileNotFound, "none.csv");
}

TEST_F(RenderScene, RefusesACameraUnderGroundOnItsWay) {
  std::ofstream(folder / "way.csv") << "time_s,x_mm,y_mm,z_mm,qw,qx,qy,qz\n0,25,25,102,1,0,0,0\n"
                                       "1,25,25,1,1,0,0,0\n";
  const auto result = render(scene("trajectory = \"way.csv\"\n"), folder / "down.exr");
  ASSERT_THAT(result, FailsWith(camera::kUnderGround));
  EXPECT_NE(result.error().message.find("picture 2"), std::string::npos) << result.error().message;
}

TEST(Trajectory, IsRefusedWithItsLine) {
  const testing_support::ScratchFolder folder;
  const fs::path path = folder / "trajectory.csv";
  const std::string head = "time_s,x_mm,y_mm,z_mm,qw,qx,qy,qz\n";
  const auto says = [&](const std::string& text, const std::string& what) {
    std::ofstream(path) << text;
    const auto poses = read_trajectory(path);
    ASSERT_THAT(poses, FailsWith(kTrajectoryFile));
    EXPECT_NE(poses.error().message.find(what), std::string::npos) << poses.error().message;
  };
  says("t,x\n", "line 1");
  says(head, "no pose");
  says(head + "0,1,2,3,1,0,0\n", "line 2");
  says(head + "0,1,2,nan,1,0,0,0\n", "column 4");
  says(head + "0,1,2,3,1,0,0,0\n0,1,2,3,1,0,0,0\n", "line 3");
  says(head + "0,1,2,3,1,1,0,0\n", "length");
}

}  // namespace
}  // namespace maquette::tools
