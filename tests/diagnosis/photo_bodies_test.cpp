// SPDX-License-Identifier: GPL-3.0-or-later
// Which pixels bodies have a part in: places on level ground under a camera that looks straight
// down, beside a plate's shadow by similar triangles.
#include "diagnosis/detail/photo_bodies.hpp"

#include <cmath>
#include <fstream>

#include <gtest/gtest.h>

#include "core/files.hpp"
#include "support/matchers.hpp"
#include "support/scan_terrain.hpp"

namespace maquette::diagnosis::detail {
namespace {

using testing_support::FailsWith;
using testing_support::Succeeds;

constexpr double kHigh_mm = 20.0;  // of the plate
constexpr double kCamera_mm = 400.0, kLamp_mm = 1000.0, kLampAside_mm = 800.0;
constexpr double kMiddle_mm = 100.0;

/// A square of 10 mm in z = 0 about the origin.
void write_plate(const std::filesystem::path& path) {
  std::ofstream(path) << "v -5 -5 0\nv 5 -5 0\nv 5 5 0\nv -5 5 0\nf 1 2 3\nf 1 3 4\n";
}

struct Picture {
  testing_support::ScratchFolder folder;
  heightmap::ModelField ground{Grid<float>(101, 101, 0.0F), Millimetres{2.0}, Millimetres{0.0},
                               Millimetres{0.0}};
  PhotoScene scene;
  std::vector<Body> bodies;

  explicit Picture(double lamp_diameter_mm) {
    PhotoInput p;
    p.width_px = p.height_px = 401;
    p.principal_u_px = p.principal_v_px = 200.5;
    p.pixel_pitch_um = 10.0;
    p.focal_length_mm = 10.0;  // 0.4 mm of the ground a pixel
    p.camera_position_mm = {kMiddle_mm, kMiddle_mm, kCamera_mm};
    p.lamp_position_mm = {kMiddle_mm - kLampAside_mm, kMiddle_mm, kLamp_mm};
    p.lamp_target_mm = {kMiddle_mm - kLampAside_mm, kMiddle_mm, 0.0};  // its disc is level
    p.lamp_diameter_mm = lamp_diameter_mm;
    scene.photos = {p};
    write_plate(folder / "plate.obj");
    bodies.push_back({folder / "plate.obj", {Quaternion{}, {kMiddle_mm, kMiddle_mm, kHigh_mm}}});
  }
  [[nodiscard]] Result<BodyPixels> find(std::ptrdiff_t margin_px = 0) const {
    return pixels_of_bodies(scene, ground, nullptr, bodies, margin_px, {});
  }
};

/// Does the pixel of a place on the ground, so far from the middle, count as a body's?
bool at(const BodyPixels& found, double x_mm, double y_mm) {
  constexpr double kPixel_mm = kCamera_mm / 1000.0;
  const auto c = static_cast<std::ptrdiff_t>(std::floor(200.5 + x_mm / kPixel_mm)),
             r = static_cast<std::ptrdiff_t>(std::floor(200.5 - y_mm / kPixel_mm));
  return found.left_out[0](r, c) != 0;
}

// The plate's shadow: each of its points away from the lamp's foot by h / (H - h) of its distance
// from it.
constexpr double kStretch = kHigh_mm / (kLamp_mm - kHigh_mm);
constexpr double kFar_mm = 5.0 + kStretch * (kLampAside_mm + 5.0);
constexpr double kSide_mm = 5.0 + kStretch * 5.0;
constexpr double kClear_mm = 0.5;  // more than half of a pixel's diagonal

TEST(PhotoBodies, APlateAndItsShadowBySimilarTriangles) {
  const Picture p(0.0);
  const auto found = p.find();
  ASSERT_THAT(found, Succeeds());
  // Seen before the ground: 10 mm at 380 mm from the camera.
  const double seen = 5.0 * kCamera_mm / (kCamera_mm - kHigh_mm);
  EXPECT_NEAR(static_cast<double>(found->pixels.at(0)), std::pow(2.0 * seen / 0.4, 2),
              4.0 * 2.0 * seen / 0.4);  // a pixel of its rim
  EXPECT_TRUE(at(*found, -seen + kClear_mm, 0.0));
  EXPECT_FALSE(at(*found, -seen - kClear_mm, 0.0));
  EXPECT_TRUE(at(*found, kFar_mm - kClear_mm, 0.0));
  EXPECT_FALSE(at(*found, kFar_mm + kClear_mm, 0.0));
  EXPECT_TRUE(at(*found, 15.0, kSide_mm - kClear_mm));
  EXPECT_FALSE(at(*found, 15.0, kSide_mm + kClear_mm));
}

// A disc of diameter D: to both sides of the shadow's edge half a penumbra, D h / (H - h) / 2.
TEST(PhotoBodies, ThePenumbraOfAWideLampHasNoSayEither) {
  constexpr double kDiameter_mm = 200.0;
  const Picture p(kDiameter_mm);
  const auto found = p.find();
  ASSERT_THAT(found, Succeeds());
  const double half = 0.5 * kDiameter_mm * kStretch;
  ASSERT_GT(half, 4.0 * kClear_mm);
  EXPECT_TRUE(at(*found, kFar_mm + half - kClear_mm, 0.0));
  EXPECT_FALSE(at(*found, kFar_mm + half + kClear_mm, 0.0));
  EXPECT_TRUE(at(*found, 15.0, kSide_mm + half - kClear_mm));
  EXPECT_FALSE(at(*found, 15.0, kSide_mm + half + kClear_mm));
}

TEST(PhotoBodies, TheMarginIsOfPixels) {
  const Picture p(0.0);
  const auto found = p.find(10);
  ASSERT_THAT(found, Succeeds());
  EXPECT_TRUE(at(*found, kFar_mm + 4.0 - kClear_mm, 0.0));
  EXPECT_FALSE(at(*found, kFar_mm + 4.0 + kClear_mm, 0.0));
}

TEST(PhotoBodies, AMeshMayStandTwiceTurnedAndScaled) {
  Picture p(0.0);
  p.bodies.push_back({p.folder / "plate.obj",
                      {rotation_about({0.0, 0.0, 1.0}, 0.25 * 3.14159265358979),
                       {kMiddle_mm - 40.0, kMiddle_mm, 0.1}},
                      0.5});
  p.bodies.push_back({p.folder / "plate.obj", {Quaternion{}, {kMiddle_mm, 900.0, 0.0}}});
  const auto found = p.find();
  ASSERT_THAT(found, Succeeds());
  const double corner = 2.5 * std::sqrt(2.0);
  EXPECT_TRUE(at(*found, -40.0 + corner - kClear_mm, 0.0));
  EXPECT_FALSE(at(*found, -40.0 + corner + kClear_mm, 0.0));
  EXPECT_FALSE(at(*found, -40.0 + 2.5 - 0.2, 2.5 - 0.2));
  EXPECT_GT(found->pixels.at(1), 100U);
  EXPECT_EQ(found->pixels.at(2), 0U);  // beyond the picture
}

TEST(PhotoBodies, AMeshThatIsNotThereIsNamed) {
  Picture p(0.0);
  p.bodies[0].mesh = p.folder / "lander.ply";
  EXPECT_THAT(p.find(), FailsWith(kFileNotFound));
}

}  // namespace
}  // namespace maquette::diagnosis::detail
