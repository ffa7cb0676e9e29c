// SPDX-License-Identifier: GPL-3.0-or-later

// camera/detail/thin_lens.hpp and pictures by rays through it:
//   rays ............. meet at the point in focus; the opening's area and shape by counting
//   what is in focus .. the pinhole's picture
//   circles .......... a bright square out of focus, before and behind: light kept, spread as the
//                      formula says; blades as depth_of_field lays them
//   an edge .......... before and behind the focus: the closed form of a half plane's share of the
//                      opening
//   behind an edge ... what a pinhole cannot see is seen past it
//   focus 0 .......... what the middle sees
//   refusals

#include "camera/detail/thin_lens.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "camera/stack.hpp"
#include "core/random.hpp"
#include "support/matchers.hpp"
#include "support/shots.hpp"
#include "support/simple_solids.hpp"

namespace maquette::camera {
namespace {

using testing_support::box_solid;
using testing_support::FailsWith;
using testing_support::second_moment_of_opening;
using testing_support::Succeeds;

constexpr double kPi = std::numbers::pi;
constexpr double kFocalMm = 50.0, kFNumber = 2.0, kFocusMm = 1000.0;
const double kLevel = std::sqrt(0.5);
constexpr double kPitchUm = 5.0;

Material grey(const char* name, double albedo) {
  return {name, Lambert{{albedo, albedo, albedo}}};
}

/// Looks down from kFocusMm above z = 0, north up.
RigidTransform from_above() {
  return look_at({0, 0, kFocusMm}, {0, 0, 0});
}

CameraModel camera_of(int width, int height, LensOpening lens) {
  return {width, height, kPitchUm, kFocalMm, NAN, NAN, 1.0, 0.0, lens};
}

/// Parallel light from the east, so that what is seen past an edge that ends eastwards is not in
/// its shadow: level ground is kLevel times as bright as it is white.
Lighting eastern_sun() {
  Lamp sun;
  sun.sun_diameter_deg = 0.0;
  sun.position_mm = {1, 0, 1};
  sun.target_mm = {0, 0, 0};
  return {{sun}, {}, {}};
}

Image picture(const std::vector<SceneObject>& objects, const CameraModel& camera, int samples) {
  const auto scene = PreparedScene::build(objects);
  EXPECT_THAT(scene, Succeeds());
  RenderOptions options;
  options.samples_per_pixel = samples;
  auto image = scene->render(camera, from_above(), eastern_sun(), options);
  EXPECT_THAT(image, Succeeds());
  return std::move(*image);
}

/// Radius of a circle of confusion in pixels; negative before the focus.
double radius_px(double z_mm) {
  return 0.5e3 * circle_of_confusion_mm(kFocalMm, kFNumber, kFocusMm, z_mm) / kPitchUm;
}

/// What of a picture's light says how far it is spread about its middle, and which way a triangle
/// of it points.
struct Moments {
  double sum = 0.0, second = 0.0;
  std::array<double, 2> third{};
};
Moments moments_of(const Grid<float>& band) {
  Moments m;
  for (std::ptrdiff_t r = 0; r < band.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < band.cols(); ++c) {
      const double v = static_cast<double>(band(r, c));
      const double x = static_cast<double>(c) - 0.5 * static_cast<double>(band.cols() - 1),
                   y = static_cast<double>(r) - 0.5 * static_cast<double>(band.rows() - 1);
      m.sum += v, m.second += v * (x * x + y * y);
      m.third[0] += v * (x * x * x - 3.0 * x * y * y);
      m.third[1] += v * (3.0 * x * x * y - y * y * y);
    }
  return m;
}

TEST(ThinLens, RaysMeetAtThePointInFocus) {
  const auto pose = look_at({30, -40, 700}, {5, 10, 0});
  const Vec3 ahead = pose.direction({0, 0, -1});
  const detail::ThinLens lens(camera_of(64, 48, {2.0, 600.0, 5, 20.0}), pose, 600.0);
  const Vec3 way = normalized(pose.direction({0.1, -0.07, -1.0}));
  const Vec3 in_focus = pose.translation_mm + 600.0 / dot(way, ahead) * way;
  for (std::uint64_t i = 0; i < 100; ++i) {
    const auto ray =
        lens.through(concentric_disc(random_uniform(1, 2 * i), random_uniform(1, 2 * i + 1)), way);
    const Vec3 off = in_focus - ray.origin_mm;
    EXPECT_NEAR(norm(cross(off, ray.direction)), 0.0, 1e-10);
    EXPECT_NEAR(dot(ray.origin_mm - pose.translation_mm, ahead), 0.0, 1e-12);
  }
}

TEST(ThinLens, HasTheAreaOfTheDiscForAnyNumberOfBlades) {
  constexpr int kSide = 400;
  for (const int blades : {0, 3, 5, 8}) {
    const detail::ThinLens lens(camera_of(64, 48, {2.0, 0.0, blades, 17.0}), {}, INFINITY);
    // Points of equal shares of the disc are of equal shares of the opening: its second moment is
    // that of an even polygon of this area, R^2 / 2 of a disc.
    double square = 0.0, farthest = 0.0;
    for (int i = 0; i < kSide; ++i)
      for (int j = 0; j < kSide; ++j) {
        const Vec3 p = lens.place(concentric_disc((i + 0.5) / kSide, (j + 0.5) / kSide));
        square += dot(p, p);
        farthest = std::fmax(farthest, norm(p));
      }
    const double radius = 0.5 * kFocalMm / 2.0;
    double corner = radius;
    if (blades > 0) {
      const double wedge = kPi / blades;
      corner = radius * std::sqrt(kPi / (blades * std::tan(wedge))) / std::cos(wedge);
    }
    // A raster of 400 x 400 points.
    EXPECT_NEAR(square / (kSide * kSide) / second_moment_of_opening(radius, blades), 1.0, 1e-3)
        << blades;
    EXPECT_NEAR(farthest / corner, 1.0, 5e-3) << blades;
  }
}

TEST(Render, ThroughALensLeavesWhatIsInFocusSharp) {
  const TriMesh white = box_solid({-200, -200, -5}, {0, 200, 0}),
                dark = box_solid({0, -200, -5}, {200, 200, 0});
  const std::vector<SceneObject> scene{{&white, grey("white", 0.8)}, {&dark, grey("dark", 0.2)}};
  const Image lens = picture(scene, camera_of(40, 20, {kFNumber, kFocusMm}), 16);
  for (std::ptrdiff_t r = 0; r < 20; ++r)
    for (std::ptrdiff_t c = 0; c < 40; ++c)
      EXPECT_NEAR(lens.bands[0](r, c), kLevel * (c < 20 ? 0.8 : 0.2), 1e-6) << r << ' ' << c;
}

class Circles : public testing::TestWithParam<std::tuple<double, int>> {};

/// A square of 1 x 1 mm at another height than the focus, on black: its picture is that of the
/// opening, spread by the square itself.
TEST_P(Circles, SpreadASquareOverTheOpeningsPicture) {
  const auto [height, blades] = GetParam();
  const double z = kFocusMm - height, half = 0.5;
  const TriMesh square = box_solid({-half, -half, height - 0.01}, {half, half, height});
  constexpr int kSize = 121;
  const Image image = picture({{&square, grey("square", 1.0)}},
                              camera_of(kSize, kSize, {kFNumber, kFocusMm, blades, 10.0}), 256);
  const double px_per_mm = kFocalMm / (1e-3 * kPitchUm) / z, radius = std::abs(radius_px(z));
  const Moments found = moments_of(image.bands[0]);
  const double side = 2.0 * half * px_per_mm;
  const double expected = second_moment_of_opening(radius, blades) + side * side / 6.0 + 1.0 / 6.0;
  // 256 points of the opening a pixel, thousands of pixels.
  EXPECT_NEAR(found.sum / (kLevel * side * side), 1.0, 0.01);
  EXPECT_NEAR(found.second / found.sum / expected, 1.0, 0.01);
  if (blades != 3) return;
  // As the effect on the pinhole's picture turns it.
  Image sharp = picture({{&square, grey("square", 1.0)}}, camera_of(kSize, kSize, {}), 16);
  Frame frame;
  frame.bands = std::move(sharp.bands);
  frame.depth_mm = Grid<float>(kSize, kSize, static_cast<float>(z));
  Shot shot;
  shot.intrinsics = intrinsics_of(kSize, kSize, kPitchUm, kFocalMm);
  shot.pixel_pitch_um = kPitchUm, shot.focal_length_mm = kFocalMm, shot.f_number = kFNumber;
  ASSERT_THAT(apply(DepthOfField{kFocusMm, blades, 10.0}, shot, frame), Succeeds());
  const auto effects = moments_of(frame.bands[0]).third;
  const double size = std::hypot(effects[0], effects[1]);
  // The effect's edges are a pixel soft.
  EXPECT_NEAR(found.third[0] / size, effects[0] / size, 0.05);
  EXPECT_NEAR(found.third[1] / size, effects[1] / size, 0.05);
}
INSTANTIATE_TEST_SUITE_P(BeforeAndBehind, Circles,
                         testing::Combine(testing::Values(60.0, -90.0), testing::Values(0, 3, 6)));

/// Share of a disc of radius 1 on one side of a line at distance x from its middle.
double share_beyond(double x) {
  x = std::clamp(x, -1.0, 1.0);
  return (std::acos(x) - x * std::sqrt(1.0 - x * x)) / kPi;
}

TEST(Render, ThroughALensBlursAnEdgeByItsShareOfTheOpening) {
  struct Case {
    double near, far;  ///< heights of the upper half plane and of what lies behind it
  };
  for (const auto& [near, far] : {Case{60.0, 0.0}, {0.0, -90.0}, {60.0, -90.0}}) {
    // The upper one ends at x = 0, the lower one goes on under it.
    const TriMesh upper = box_solid({-300, -100, near - 0.01}, {0, 100, near}),
                  lower = box_solid({-300, -100, far - 0.01}, {300, 100, far});
    const Image image = picture({{&upper, grey("upper", 0.8)}, {&lower, grey("lower", 0.3)}},
                                camera_of(121, 5, {kFNumber, kFocusMm}), 1024);
    const double radius = radius_px(kFocusMm - near);
    for (std::ptrdiff_t c = 0; c < 121; ++c) {
      // The edge's picture from a point of the lens lies at radius * that point: where the share of
      // the lens beyond the pixel ends. Of pixels within the edge's width the mean over the pixel.
      double expected = 0.0;
      constexpr int kParts = 32;
      for (int i = 0; i < kParts; ++i) {
        const double x = static_cast<double>(c) - 60.5 + (i + 0.5) / kParts;
        const double of_upper =
            near == 0.0 ? (x < 0.0 ? 1.0 : 0.0) : share_beyond(x / std::abs(radius));
        expected += kLevel * (0.3 + 0.5 * of_upper) / kParts;
      }
      // 1024 stratified points: an edge passes through at most 64 of their cells, 0.5 of brightness
      // at a quarter of a cell each; five times that.
      EXPECT_NEAR(image.bands[0](2, c), expected, 5.0 * 0.5 * 0.25 * std::sqrt(64.0) / 1024.0)
          << near << ' ' << far << " column " << c;
    }
  }
}

TEST(Render, ThroughALensSeesPastAnEdge) {
  // A white square right behind the edge of a plate that hides it from the lens' middle.
  const TriMesh plate = box_solid({-300, -100, 99.99}, {0, 100, 100}),
                hidden = box_solid({-4, -4, -0.01}, {-0.3, 4, 0});
  const std::vector<SceneObject> scene{{&plate, grey("plate", 0.0)}, {&hidden, grey("white", 1.0)}};
  const auto brightest = [&](LensOpening lens) {
    const Image image = picture(scene, camera_of(41, 21, lens), 64);
    return *std::max_element(image.bands[0].cells().begin(), image.bands[0].cells().end());
  };
  EXPECT_EQ(brightest({}), 0.0F);
  EXPECT_GT(brightest({kFNumber, kFocusMm}), 0.05F);
}

TEST(Render, ThroughALensIsFocusedOnWhatTheMiddleSees) {
  const TriMesh white = box_solid({-200, -200, 35}, {0, 200, 40}),
                dark = box_solid({0, -200, 35}, {200, 200, 40});
  const auto at = [&](double focus) {
    return picture({{&white, grey("white", 0.8)}, {&dark, grey("dark", 0.2)}},
                   camera_of(24, 16, {kFNumber, focus}), 4);
  };
  const Image middle = at(0.0), given = at(960.0), elsewhere = at(kFocusMm);
  double apart = 0.0;
  for (std::size_t i = 0; i < middle.bands[0].cells().size(); ++i) {
    const double here = static_cast<double>(middle.bands[0].cells()[i]);
    EXPECT_NEAR(here, given.bands[0].cells()[i], 1e-6);
    apart = std::fmax(apart, std::abs(here - static_cast<double>(elsewhere.bands[0].cells()[i])));
  }
  EXPECT_GT(apart, 0.1);  // an edge out of focus is not the edge in focus
}

TEST(Render, ThroughALensRefusesWhatNoLensIs) {
  const TriMesh slab = box_solid({-200, -200, -5}, {200, 200, 0});
  const auto scene = PreparedScene::build({{&slab, grey("slab", 0.5)}});
  ASSERT_THAT(scene, Succeeds());
  const auto with = [&](LensOpening lens, RigidTransform pose) {
    return scene->render(camera_of(8, 8, lens), pose, eastern_sun());
  };
  EXPECT_THAT(with({2.0, 40.0}, from_above()), FailsWith(kCameraOutOfRange));
  EXPECT_THAT(with({-1.0, 500.0}, from_above()), FailsWith(kCameraOutOfRange));
  EXPECT_THAT(with({2.0, 500.0, 2}, from_above()), FailsWith(kCameraOutOfRange));
  // Level, ten millimetres over the slab, with a lens of 25 mm.
  const auto low = look_at({0, 0, 10}, {100, 0, 10});
  EXPECT_THAT(with({}, low), Succeeds());
  EXPECT_THAT(with({2.0, 500.0}, low), FailsWith(kUnderGround));
}

}  // namespace
}  // namespace maquette::camera
