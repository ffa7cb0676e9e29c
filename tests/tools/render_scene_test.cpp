// SPDX-License-Identifier: GPL-3.0-or-later

// tools/scene_file.hpp, scene_parts.hpp, trajectory_file.hpp, render_job:
//   the picture holds what it says ..... channels, closed-form values at a pixel, metadata that
//                                        make the same picture again, bit for bit
//   a lamp by its name ................ its picture against its curve and Planck's law; each value
//                                        of it changed; what 1.0 is, by its flux
//   filters ........................... narrow ones have Planck's law's values
//   a trajectory ...................... numbered pictures; a second run keeps them, a changed scene
//                                        makes them anew; each is the single picture of its pose
//   a list of poses ................... numbered pictures without times, each that of its pose;
//   rate a scanned surface ................. an open mesh is seen as the field of the same nodes;
//   under
//                                       it is under ground
//   a mesh as its file paints it ...... as the same with materials of the scene; these take the
//                                       place of the file's by name; a series begins anew with
//                                       another picture
//   bad input ......................... one error that names what is wrong, no picture left behind

#include "tools/trajectory_file.hpp"

#include <array>
#include <cmath>
#include <cstring>
#include <fstream>
#include <numbers>

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "camera/image_io.hpp"
#include "camera/spectrum.hpp"
#include "core/files.hpp"
#include "heightmap/field_io.hpp"
#include "meshing/mesh_io.hpp"
#include "meshing/painted_mesh.hpp"
#include "meshing/stones.hpp"
#include "support/matchers.hpp"
#include "tools/jobs.hpp"
#include "tools/scene_cover.hpp"
#include "tools/scene_loading.hpp"

namespace maquette::tools {
namespace {

using testing_support::FailsSaying;
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

/// A sheet of 30 mm in two halves over the plane, its left half with a picture.
class PaintedObject : public RenderScene {
 protected:
  void SetUp() override {
    RenderScene::SetUp();
    std::ofstream(folder / "sheet.obj")
        << "mtllib sheet.mtl\nv -15 -15 0\nv 0 -15 0\nv 15 -15 0\nv -15 15 0\nv 0 15 0\nv 15 15 0\n"
           "vt 0.5 0.5\nusemtl mark\nf 1/1 2/1 5/1 4/1\nusemtl foil\nf 2 3 6 5\n";
    std::ofstream(folder / "sheet.mtl")
        << "newmtl mark\nKd 0.8 0.4 0.2\nmap_Kd mark.png\nnewmtl foil\nKd 0.64 0.25 0.09\nPm 1\n"
           "Pr 0.5\n";
    paint(188);
  }
  void paint(std::uint8_t level) const {
    Grid<camera::Rgb8> pixel(2, 2, camera::Rgb8{level, 255, 128});
    ASSERT_THAT(camera::write_png(pixel, folder / "mark.png"), Succeeds());
  }
  static std::string sheet(const std::string& mesh, const std::string& more) {
    return "[[object]]\nmesh = \"" + mesh + "\"\nposition_mm = [25, 25, 3]\n" + more;
  }
  [[nodiscard]] camera::LoadedImage picture(const std::string& text, const std::string& name) {
    const auto done = render(text, folder / name);
    EXPECT_THAT(done, Succeeds());
    auto image = camera::read_image(folder / name);
    EXPECT_THAT(image, Succeeds());
    return std::move(*image);
  }
  void expect_same(const camera::LoadedImage& a, const camera::LoadedImage& b) const {
    for (const char* name : {"R", "G", "B"}) {
      const auto &x = channel(a, name), &y = channel(b, name);
      for (std::size_t i = 0; i < x.cells().size(); ++i)
        ASSERT_NEAR(x.cells()[i], y.cells()[i], 2e-6F) << name << ' ' << i;
    }
  }
  // The same by materials of the scene: 188 and 128 are 0.5029 and 0.2159 of light (IEC
  // 61966-2-1); a metal of index n gives ((n - 1) / (n + 1))^2 back: 9, 3 and 13 / 7.
  std::string by_hand = [] {
    const auto linear = [](double v) { return std::pow((v / 255.0 + 0.055) / 1.055, 2.4); };
    return fmt::format(
        "[[material]]\nname = \"left\"\nalbedo = [{}, 0.4, {}]\n[[material]]\nname = \"right\"\n"
        "law = \"ggx\"\nn = [9, 3, {}]\nk = [0]\nalpha = 0.25\n",
        0.8 * linear(188.0), 0.2 * linear(128.0), 13.0 / 7.0);
  }();
  void write_halves() const {
    std::ofstream(folder / "left.obj")
        << "v -15 -15 0\nv 0 -15 0\nv 0 15 0\nv -15 15 0\nf 1 2 3 4\n";
    std::ofstream(folder / "right.obj")
        << "v 0 -15 0\nv 15 -15 0\nv 15 15 0\nv 0 15 0\nf 1 2 3 4\n";
  }
};

TEST_F(PaintedObject, IsTheSameWithMaterialsOfTheScene) {
  write_halves();
  const auto painted = picture(scene(sheet("sheet.obj", "")), "a.exr");
  const auto halves = picture(scene(by_hand + sheet("left.obj", "material = \"left\"\n") +
                                    sheet("right.obj", "material = \"right\"\n")),
                              "b.exr");
  expect_same(painted, halves);
}

TEST_F(PaintedObject, AMaterialOfTheSceneTakesThePlaceOfTheFilesUnderItsPicture) {
  write_halves();
  const std::string foil =
      "[[material]]\nname = \"foil\"\nalbedo = [0.3, 0.2, 0.1]\n[[material]]\nname = \"mark\"\n"
      "law = \"lommel_seeliger\"\nalbedo = [0.2, 0.1, 0.1]\n";
  const auto painted = picture(scene(foil + sheet("sheet.obj", "")), "a.exr");
  const auto linear = [](double v) { return std::pow((v / 255.0 + 0.055) / 1.055, 2.4); };
  const std::string left = fmt::format(
      "[[material]]\nname = \"left\"\nlaw = \"lommel_seeliger\"\nalbedo = [{}, 0.1, {}]\n",
      0.2 * linear(188.0), 0.1 * linear(128.0));
  const auto halves = picture(scene(foil + left + sheet("left.obj", "material = \"left\"\n") +
                                    sheet("right.obj", "material = \"foil\"\n")),
                              "b.exr");
  expect_same(painted, halves);
}

TEST_F(PaintedObject, MaterialsShareAPictureThatEndsAlike) {
  std::ofstream(folder / "sheet.mtl")
      << "newmtl mark\nmap_Kd mark.png\nnewmtl foil\nmap_Kd -clamp on "
         "mark.png\nnewmtl same\nKd 0.5 0.5 0.5\nmap_Kd mark.png\n"
         "newmtl plain\n";
  std::ofstream(folder / "all.obj") << "mtllib sheet.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\n"
                                       "usemtl mark\nf 1/1 2/1 3/1\nusemtl foil\nf 1/1 2/1 3/1\n";
  const auto all = load_covered_mesh(folder / "all.obj", {}, {});
  ASSERT_THAT(all, Succeeds());
  const auto& pictures = all->cover->pictures;
  ASSERT_EQ(pictures.size(), 4U);
  EXPECT_EQ(pictures[0], pictures[2]);
  EXPECT_NE(pictures[0], pictures[1]);
  EXPECT_EQ(pictures[1]->beyond[0], camera::MeshPicture::Beyond::edge);
  EXPECT_EQ(pictures[3], nullptr);
}

TEST_F(PaintedObject, ASeriesBeginsAnewWithAnotherPicture) {
  const std::string series =
      scene(sheet("sheet.obj", "") +
            "[[pose]]\nposition_mm = [25, 20, 102]\ntarget_mm = [25, 25, 2]\n[[pose]]\n"
            "position_mm = [25, 30, 102]\ntarget_mm = [25, 25, 2]\n");
  ASSERT_THAT(render(series, folder / "s.exr"), Succeeds());
  const auto before = read_file(folder / "s_0001.exr");
  ASSERT_THAT(before, Succeeds());
  ASSERT_THAT(render(series, folder / "s.exr"), Succeeds());
  EXPECT_EQ(*read_file(folder / "s_0001.exr"), *before);
  paint(20);
  ASSERT_THAT(render(series, folder / "s.exr"), Succeeds());
  EXPECT_NE(*read_file(folder / "s_0001.exr"), *before);
}

TEST_F(PaintedObject, SaysWhatIsMissing) {
  const fs::path out = folder / "a.exr";
  fs::remove(folder / "mark.png");
  EXPECT_THAT(render(scene(sheet("sheet.obj", "")), out),
              FailsSaying(kFileNotFound, "mark.png: no such file"));
  fs::remove(folder / "sheet.mtl");
  EXPECT_THAT(
      render(scene(sheet("sheet.obj", "") + "[[material]]\nname = \"foil\"\n"), out),
      FailsSaying(meshing::kNoPaint, "what its materials 'mark' look like is said nowhere"));
  EXPECT_THAT(render(scene(sheet("tip.obj", "")), out),
              FailsSaying(meshing::kNoPaint, "tip.obj: has no materials of its own; name one"));
  EXPECT_FALSE(fs::exists(out));
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

TEST_F(RenderScene, StonesOfOneShapeHaveOneMesh) {
  std::vector<meshing::PlacedStone> stones(4);
  for (std::size_t i = 0; i < 4; ++i) {
    stones[i].number = static_cast<int>(i) + 1;
    stones[i].scale_mm = 3.0 + 1.5 * static_cast<double>(i);
    stones[i].model_from_stone = {rotation_about({0, 0, 1}, 0.7 * static_cast<double>(i)),
                                  {10.0 + 10.0 * static_cast<double>(i), 25, 2}};
  }
  stones[3].shape.seed += 1;  // one has a shape of its own
  ASSERT_THAT(meshing::write_stone_plan(stones, folder / "stones.json"), Succeeds());
  std::ofstream(folder / "scene.toml") << scene("stones = \"stones.json\"\n");
  const auto file = read_scene(folder / "scene.toml");
  ASSERT_THAT(file, Succeeds());
  const auto loaded = load_scene(**file, {});
  ASSERT_THAT(loaded, Succeeds());
  EXPECT_EQ((*loaded)->meshes.size(), 2U);
  ASSERT_EQ((*loaded)->objects.size(), 5U);
  for (std::size_t i = 0; i < 4; ++i) {
    const camera::SceneObject& o = (*loaded)->objects[i + 1];
    const TriMesh baked = meshing::stone_mesh(stones[i]);
    ASSERT_EQ(o.mesh->vertices_mm.size(), baked.vertices_mm.size());
    for (std::size_t k = 0; k < baked.vertices_mm.size(); ++k)
      ASSERT_LT(
          norm(o.model_from_mesh.point(o.scale * o.mesh->vertices_mm[k]) - baked.vertices_mm[k]),
          1e-12)
          << i;
  }
  EXPECT_EQ((*loaded)->objects[1].mesh, (*loaded)->objects[3].mesh);
}

TEST_F(RenderScene, IsGreyWhereNothingHasAColour) {
  ASSERT_THAT(render(scene("geometry = false\n"), folder / "grey.exr"), Succeeds());
  const auto image = camera::read_image(folder / "grey.exr");
  ASSERT_THAT(image, Succeeds());
  EXPECT_EQ(image->channels.size(), 3U);  // Y, Z, lit
  EXPECT_NEAR(channel(*image, "Y")(12, 16), 0.3 * 0.8, 2e-3);
}

/// Of the D5 as shipped: exp(-ln 2 (angle / 28)^4), by the degree.
double fresnel_flood(double angle_deg, double half_deg = 28.0) {
  return std::exp(-std::numbers::ln2 * std::pow(angle_deg / half_deg, 4));
}
/// Mean of Planck's law over a band, by Simpson's rule: independent of the filters' quadrature.
double planck_mean(double from_nm, double to_nm, double kelvin) {
  double sum = 0.0;
  for (int i = 0; i <= 100; ++i)
    sum += (i == 0 || i == 100 ? 1
            : i % 2 == 1       ? 4
                               : 2) *
           camera::planck(from_nm + (to_nm - from_nm) * i / 100.0, kelvin);
  return sum / 300.0;
}

TEST_F(RenderScene, TakesALampByItsName) {
  // 40 mm above the middle, so that the plane sees it to 40 degrees off its axis; a point, since
  // the lens is wider than that.
  const std::string lamp =
      "lamp_preset = \"arri_d5\"\nlamp_position_mm = [25, 25, 42]\nlamp_diameter_mm = 0\n";
  std::string text = scene(lamp);
  for (const char* line : {"lamp_position_mm = [-200, 25, 302]\n", "lamp_beam_deg = 90\n"})
    text.erase(text.find(line), std::strlen(line));
  const fs::path out = folder / "d5.exr";
  ASSERT_THAT(render(text, out), Succeeds());
  const auto image = camera::read_image(out);
  ASSERT_THAT(image, Succeeds());
  const double red = planck_mean(580, 680, 6000) / planck_mean(490, 580, 6000);
  const double blue = planck_mean(400, 490, 6000) / planck_mean(490, 580, 6000);
  int steep = 0;
  for (std::ptrdiff_t r = 0; r < 24; ++r)
    for (std::ptrdiff_t c = 0; c < 32; ++c) {
      const double x = static_cast<double>(channel(*image, "position.X")(r, c)) - 25;
      const double y = static_cast<double>(channel(*image, "position.Y")(r, c)) - 25;
      const double cosine = 40 / std::sqrt(1600 + x * x + y * y);
      const double angle = std::acos(cosine) * 180 / std::numbers::pi;
      // Falloff, incidence, and lines of a degree in the table: 4e-4 of the axis at most.
      const double expected = 0.3 * std::pow(cosine, 3) * fresnel_flood(angle);
      ASSERT_NEAR(channel(*image, "G")(r, c), expected, 0.3 * 1e-3) << angle;
      ASSERT_NEAR(channel(*image, "R")(r, c), red * expected, 0.3 * 1e-3) << angle;
      ASSERT_NEAR(channel(*image, "B")(r, c), blue * expected, 0.3 * 1e-3) << angle;
      steep += angle > 24 ? 1 : 0;
    }
  EXPECT_GT(steep, 20);
}

TEST_F(RenderScene, LetsEachValueOfALampBeChanged) {
  const std::string d5 = "lamp_preset = \"arri_d5\"\n";
  const auto load = [&](const std::string& more) {
    std::string text = scene(more);
    const std::string beam = "lamp_beam_deg = 90\n";
    text.erase(text.find(beam), beam.size());
    std::ofstream(folder / "scene.toml") << text;
    const auto scene_file = read_scene(folder / "scene.toml");
    EXPECT_THAT(scene_file, Succeeds());
    auto loaded = load_scene(**scene_file, {});
    EXPECT_THAT(loaded, Succeeds());
    return std::move(*loaded);
  };
  const auto whole = load(d5);
  const camera::Lamp& lamp = whole->lighting.lamps.front();
  EXPECT_EQ(lamp.lens_diameter_mm, 130.0);
  ASSERT_NE(lamp.intensity, nullptr);
  EXPECT_NEAR(lamp.intensity->at(28, 0), 0.5, 1e-5);
  EXPECT_EQ(lamp.intensity->at(49, 0), 0.0);
  EXPECT_EQ(lamp.beam_deg, 98.0) << "the light ends with the table";
  EXPECT_LT(lamp.colour[0], 0.95);

  EXPECT_EQ(load(d5 + "lamp_diameter_mm = 20\n")->lighting.lamps[0].lens_diameter_mm, 20.0);
  EXPECT_EQ(load(d5 + "lamp_kelvin = 0\n")->lighting.lamps[0].colour,
            (camera::Bands{1.0, 1.0, 1.0}));
  EXPECT_GT(load(d5 + "lamp_kelvin = 3200\n")->lighting.lamps[0].colour[0], 1.2);
  const auto spot = load(d5 + "lamp_beam_deg = 14\n");
  EXPECT_NEAR(spot->lighting.lamps[0].intensity->at(7, 0), 0.5, 1e-5) << "focused";
  EXPECT_NEAR(spot->lighting.lamps[0].beam_deg, 98.0 / 4, 1e-12);
  std::ofstream(folder / "own.csv") << "angle_deg,intensity\n0,10\n30,5\n";
  const auto own = load(d5 + "lamp_intensity = \"own.csv\"\n");
  EXPECT_EQ(own->lighting.lamps[0].intensity->at(30, 0), 5.0);
  EXPECT_EQ(own->lighting.lamps[0].beam_deg, 60.0);
  const auto cut = load(d5 + "lamp_intensity = \"own.csv\"\nlamp_beam_deg = 40\n");
  EXPECT_EQ(cut->lighting.lamps[0].beam_deg, 40.0);
  EXPECT_EQ(cut->lighting.lamps[0].intensity->at(30, 0), 5.0);
  const auto plain = load("");
  EXPECT_EQ(plain->lighting.lamps[0].beam_deg, 56.0);
  EXPECT_EQ(plain->lighting.lamps[0].lens_diameter_mm, 0.0);
  EXPECT_EQ(plain->lighting.lamps[0].intensity, nullptr);
  EXPECT_EQ(plain->white_radiance, camera::Bands{});
  const auto second = load(
      "[[lamp]]\npreset = \"arri_d5\"\nposition_mm = [0, 0, 900]\n"
      "target_mm = [0, 0, 0]\nkelvin = 0\n");
  EXPECT_EQ(second->lighting.lamps.at(1).lens_diameter_mm, 130.0);
  EXPECT_EQ(second->lighting.lamps.at(1).colour[2], 1.0);

  // 575 W, 85 lm/W, 35 % of it through the lens: candela on the axis by Simpson's rule over the
  // curve, lux at the target's distance of 375 mm.
  double solid = 0.0;
  for (int i = 0; i <= 490; ++i) {
    const double angle = 0.1 * i, weight = i == 0 || i == 490 ? 1 : i % 2 == 1 ? 4 : 2;
    solid += weight * fresnel_flood(angle) * std::sin(angle * std::numbers::pi / 180);
  }
  solid *= 2 * std::numbers::pi * (0.1 * std::numbers::pi / 180) / 3;
  const double lux = 575 * 85 * 0.35 / solid / (0.225 * 0.225 + 0.3 * 0.3);
  const auto said = load(d5 + fmt::format("lamp_illuminance_lux = {}\n", lux));
  EXPECT_GT(said->white_radiance[1], 0.0);
  for (std::size_t b = 0; b < 3; ++b)
    EXPECT_NEAR(whole->white_radiance[b] / said->white_radiance[b], 1.0, 2e-3) << b;
  EXPECT_EQ(load(d5 + "lamp_illuminance_lux = 0\n")->white_radiance, camera::Bands{});
}

TEST_F(RenderScene, SeesALampsColourThroughFilters) {
  // Two narrow bands beside each other and a broad one: Planck's law says what is in them.
  std::ofstream(folder / "filters.csv") << "wavelength_nm,r,g,b\n449,0,0,0\n450,0,0,1\n451,0,0,0\n"
                                           "549,0,0,0\n550,0,1,0\n551,0,0,0\n649,0,0,0\n"
                                           "650,1,0,0\n651,0,0,0\n";
  const fs::path out = folder / "a.exr";
  ASSERT_THAT(render(scene("lamp_kelvin = 3200\nfilters = \"filters.csv\"\n"), out), Succeeds());
  const auto image = camera::read_image(out);
  ASSERT_THAT(image, Succeeds());
  const auto at = [&](const char* name) {
    return static_cast<double>(channel(*image, name)(12, 16));
  };
  EXPECT_NEAR(at("R") / at("G"), camera::planck(650, 3200) / camera::planck(550, 3200), 1e-3);
  EXPECT_NEAR(at("B") / at("G"), camera::planck(450, 3200) / camera::planck(550, 3200), 1e-3);
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

TEST_F(RenderScene, TakesAListOfPoses) {
  const std::string poses =
      "[[pose]]\nposition_mm = [25, 20, 102]\ntarget_mm = [25, 25, 2]\n"
      "[[pose]]\nposition_mm = [25, 25, 62]\nquaternion_wxyz = [1, 0, 0, 0]\n";
  const fs::path out = folder / "seen.exr";
  const auto first = render(scene(poses), out);
  ASSERT_THAT(first, Succeeds());
  EXPECT_EQ(first->outputs.size(), 4U);
  EXPECT_FALSE(fs::exists(out));
  const auto figures = nlohmann::json::parse(first->figures_json);
  EXPECT_EQ(figures["pictures"], 2);
  EXPECT_GT(figures["pictures_per_s"], 0.0);
  EXPECT_NE(first->note.find("pictures/s"), std::string::npos) << first->note;
  const auto second = camera::read_image(folder / "seen_0002.exr");
  ASSERT_THAT(second, Succeeds());
  EXPECT_NEAR(channel(*second, "Z")(12, 16), 60 * std::sqrt(1 + 2 * 0.005 * 0.005), 1e-3);
  // The first one is the single picture of its pose.
  ASSERT_THAT(render(scene(), folder / "one.exr"), Succeeds());
  const auto listed = camera::read_image(folder / "seen_0001.exr"),
             alone = camera::read_image(folder / "one.exr");
  ASSERT_THAT(listed, Succeeds());
  ASSERT_THAT(alone, Succeeds());
  EXPECT_EQ(channel(*listed, "Y"), channel(*alone, "Y"));
  const auto again = render(scene(poses), out);
  ASSERT_THAT(again, Succeeds());
  EXPECT_EQ(nlohmann::json::parse(again->figures_json)["kept"], 2);

  std::ofstream(folder / "way.csv") << "time_s,x_mm,y_mm,z_mm,qw,qx,qy,qz\n0,25,25,102,1,0,0,0\n";
  EXPECT_THAT(render(scene("trajectory = \"way.csv\"\n" + poses), out), FailsWith(kConfigInvalid));
  EXPECT_THAT(render(scene("[[pose]]\nposition_mm = [25, 25, 62]\n"
                           "quaternion_wxyz = [1, 1, 0, 0]\n"),
                     out),
              FailsWith(kConfigInvalid));
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
  refuses("[[object]]\nmesh = \"tip.obj\"\n", meshing::kNoPaint, "material");
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
  refuses("lamp_preset = \"arri_d6\"\n", kConfigInvalid, "arri_d5");
  refuses("filters = \"none.csv\"\nlamp_kelvin = 6000\n", kFileNotFound, "none.csv");
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

// What `merge` writes is open: a sheet without walls and underside.
TEST_F(RenderScene, TakesASurfaceAsScanned) {
  heightmap::ModelField field{Grid<float>(51, 51), Millimetres{1}, Millimetres{0}, Millimetres{0}};
  TriMesh sheet;
  for (std::ptrdiff_t r = 0; r < 51; ++r)
    for (std::ptrdiff_t c = 0; c < 51; ++c) {
      field.z_mm(r, c) = static_cast<float>(2 + std::sin(0.3 * static_cast<double>(c)) *
                                                    std::cos(0.2 * static_cast<double>(r)));
      sheet.vertices_mm.push_back(
          {field.x_mm(c), field.y_mm(r), static_cast<double>(field.z_mm(r, c))});
    }
  for (std::uint32_t r = 0; r < 50; ++r)
    for (std::uint32_t c = 0; c < 50; ++c) {
      const std::uint32_t a = 51 * r + c, b = a + 1, d = a + 51, e = d + 1;
      // The diagonals of a height field, of which there are two kinds.
      sheet.triangles.push_back({a, b, e});
      sheet.triangles.push_back({a, e, d});
    }
  ASSERT_THAT(heightmap::write_model_field(field, folder / "design.tif"), Succeeds());
  ASSERT_THAT(meshing::write_ply(sheet, folder / "merged.ply"), Succeeds());
  const auto as_scanned = [&](std::string text) {
    text.replace(text.find("design.tif"), std::strlen("design.tif"), "merged.ply");
    return text;
  };
  ASSERT_THAT(render(scene(), folder / "field.exr"), Succeeds());
  ASSERT_THAT(render(as_scanned(scene()), folder / "scan.exr"), Succeeds());
  const auto from_field = camera::read_image(folder / "field.exr"),
             from_scan = camera::read_image(folder / "scan.exr");
  ASSERT_THAT(from_field, Succeeds());
  ASSERT_THAT(from_scan, Succeeds());
  double apart = 0.0, light = 0.0;
  for (std::ptrdiff_t r = 0; r < 24; ++r)
    for (std::ptrdiff_t c = 0; c < 32; ++c) {
      // Quads are cut along one diagonal or the other: half the mixed derivative of 0.06 / mm.
      EXPECT_NEAR(channel(*from_scan, "Z")(r, c), channel(*from_field, "Z")(r, c), 0.03);
      apart += std::abs(static_cast<double>(channel(*from_scan, "Y")(r, c)) -
                        static_cast<double>(channel(*from_field, "Y")(r, c)));
      light += static_cast<double>(channel(*from_field, "Y")(r, c));
    }
  EXPECT_LT(apart, 0.02 * light);

  const auto from_below = [](std::string text) {
    text.replace(text.find("[25, 20, 102]"), std::strlen("[25, 20, 102]"), "[25, 20, -5]");
    return text;
  };
  EXPECT_THAT(render(as_scanned(from_below(scene())), folder / "below.exr"),
              FailsWith(camera::kUnderGround));
  // Beside the sheet and lower than it nothing is over the camera: a scan has no ground there.
  EXPECT_THAT(render(as_scanned(scene("[[pose]]\nposition_mm = [-30, 25, -5]\n"
                                      "target_mm = [0, 25, 2]\n")),
                     folder / "beside.exr"),
              Succeeds());
  std::string dug = scene();
  dug.replace(dug.find("[-200, 25, 302]"), std::strlen("[-200, 25, 302]"), "[25, 25, -300]");
  EXPECT_THAT(render(as_scanned(dug), folder / "dug.exr"), FailsWith(camera::kLampInSurface));
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
