// SPDX-License-Identifier: GPL-3.0-or-later

// camera/render.hpp, what it refuses:
//   each error code .................. options just outside their range, one by one
//   under ground ..................... inside, below the base, on the surface; a deck
//                                      overhead is no ground
//   lamp in the surface .............. its centre, and only the rim of its lens
//   stops when asked ................. before and during the work; progress never falls

#include <atomic>
#include <cmath>
#include <mutex>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "camera/effects/frame.hpp"
#include "camera/render.hpp"
#include "support/matchers.hpp"
#include "support/simple_solids.hpp"

namespace maquette::camera {
namespace {

using testing_support::box_solid;
using testing_support::FailsWith;
using testing_support::Succeeds;

struct Table {
  TriMesh slab = box_solid({0, 0, -20}, {200, 200, 0});
  std::vector<SceneObject> objects{{&slab, {}}};
  CameraModel camera{16, 12, 100.0, 10.0};
  RigidTransform pose = look_at({100, -50, 100}, {100, 100, 0});
  Lamp lamp{{-300, 100, 200}, {100, 100, 0}, 0.0, 56.0};
  RenderOptions options{1};

  Table() = default;
  Table(const Table&) = delete;
  Table& operator=(const Table&) = delete;
  [[nodiscard]] Result<Image> picture() const {
    return render(objects, camera, pose, lamp, options);
  }
};

class RenderRefuses : public testing::Test, protected Table {};

TEST_F(RenderRefuses, NothingWhenAllIsRight) {
  EXPECT_THAT(picture(), Succeeds());
}

TEST_F(RenderRefuses, AnEmptyScene) {
  objects.clear();
  EXPECT_THAT(picture(), FailsWith(kEmptyScene));
  objects = {{nullptr, {}}};
  EXPECT_THAT(picture(), FailsWith(kEmptyScene));
  const TriMesh nothing;
  objects = {{&nothing, {}}};
  EXPECT_THAT(picture(), FailsWith(kEmptyScene));
  objects.push_back({&slab, {}});
  EXPECT_THAT(picture(), Succeeds());
}

TEST_F(RenderRefuses, APoseThatIsNone) {
  pose.translation_mm.y = NAN;
  EXPECT_THAT(picture(), FailsWith(kPoseNotFinite));
  pose = look_at({1, 2, 3}, {1, 2, 3});
  EXPECT_THAT(picture(), FailsWith(kPoseNotFinite));
  pose = {{1, 1, 0, 0}, {100, 100, 100}};
  EXPECT_THAT(picture(), FailsWith(kPoseNotFinite));
}

TEST_F(RenderRefuses, OptionsOutOfRange) {
  const auto refused = [](auto&& change) {
    Table fresh;
    change(fresh);
    const auto result = fresh.picture();
    return !result && result.error().code == kCameraOutOfRange && !result.error().message.empty();
  };
  EXPECT_TRUE(refused([](auto& t) { t.camera.width_px = 0; }));
  EXPECT_TRUE(refused([](auto& t) { t.camera.height_px = -3; }));
  EXPECT_TRUE(refused([](auto& t) { t.camera.width_px = t.camera.height_px = 40000; }));
  EXPECT_TRUE(refused([](auto& t) { t.camera.pixel_pitch_um = 0; }));
  EXPECT_TRUE(refused([](auto& t) { t.camera.focal_length_mm = NAN; }));
  EXPECT_TRUE(refused([](auto& t) { t.lamp.position_mm.x = INFINITY; }));
  EXPECT_TRUE(refused([](auto& t) { t.lamp.position_mm = t.lamp.target_mm; }));
  EXPECT_TRUE(refused([](auto& t) { t.lamp.lens_diameter_mm = -1; }));
  EXPECT_TRUE(refused([](auto& t) { t.lamp.beam_deg = 0; }));
  EXPECT_TRUE(refused([](auto& t) { t.lamp.beam_deg = 361; }));
  EXPECT_TRUE(refused([](auto& t) { t.options.samples_per_pixel = 0; }));
  EXPECT_TRUE(refused([](auto& t) { t.options.samples_per_pixel = 5; }));
  EXPECT_TRUE(refused([](auto& t) { t.options.lamp_samples = 0; }));
  EXPECT_TRUE(refused([](auto& t) { t.options.exposure_scale = -1; }));
}

// What camera files are refused for is no camera of a scene either.
TEST_F(RenderRefuses, AnAbsurdCameraMatrix) {
  const auto says = [](auto&& change, const char* what) {
    Table fresh;
    change(fresh.camera);
    const auto result = fresh.picture();
    ASSERT_THAT(result, FailsWith(kIntrinsics)) << what;
    EXPECT_NE(result.error().message.find(what), std::string::npos) << result.error().message;
  };
  // 16 pixels of 0.01 um behind 100 m: 9e-8 degrees.
  says([](auto& c) { c.pixel_pitch_um = 0.01, c.focal_length_mm = 1e5; }, "field of view");
  says([](auto& c) { c.pixel_pitch_um = 1000, c.focal_length_mm = 0.1; }, "field of view");
  says([](auto& c) { c.aspect = 11; }, "oblong");
  says([](auto& c) { c.aspect = 0.05; }, "oblong");
  says([](auto& c) { c.skew_px = 101; }, "skew");
  says([](auto& c) { c.principal_x_px = 40; }, "principal point");
  says([](auto& c) { c.principal_y_px = -20; }, "principal point");
}

TEST_F(RenderRefuses, AMaterialItsLawDoesNotKnow) {
  objects[0].material.law = Lambert{{NAN, 0.3, 0.3}};
  EXPECT_THAT(picture(), FailsWith(kMaterialOutOfRange));
  objects[0].material.law = LunarLambert{{0.1, 0.1, 0.1}, 1.5};
  EXPECT_THAT(picture(), FailsWith(kMaterialOutOfRange));
}

TEST_F(RenderRefuses, ACameraUnderGround) {
  pose = look_at({100, 100, -5}, {100, 150, 0});  // inside
  EXPECT_THAT(picture(), FailsWith(kUnderGround));
  pose = look_at({100, 100, -50}, {100, 150, 0});  // below the base
  EXPECT_THAT(picture(), FailsWith(kUnderGround));
  pose = look_at({100, 100, 0}, {100, 150, 0});  // on the surface
  EXPECT_THAT(picture(), FailsWith(kUnderGround));
  pose = look_at({-10, 100, -50}, {100, 150, 0});  // beside the model, lower than it
  EXPECT_THAT(picture(), Succeeds());
}

TEST_F(RenderRefuses, NoCameraUnderADeck) {
  const TriMesh deck = box_solid({50, 50, 80}, {150, 150, 90});
  objects.push_back({&deck, {}});
  pose = look_at({100, 100, 40}, {100, 150, 0});
  EXPECT_THAT(picture(), Succeeds());
  pose = look_at({100, 100, 85}, {100, 150, 0});
  EXPECT_THAT(picture(), FailsWith(kUnderGround));
}

TEST_F(RenderRefuses, ALampInTheSurface) {
  lamp.position_mm = {50, 50, -10};
  EXPECT_THAT(picture(), FailsWith(kLampInSurface));
  lamp.position_mm = {-30, 100, -10};  // beside the slab, upright lens of 40 mm radius
  lamp.target_mm = {-30, 200, -10};
  EXPECT_THAT(picture(), Succeeds());
  lamp.lens_diameter_mm = 80;
  EXPECT_THAT(picture(), FailsWith(kLampInSurface));
}

TEST_F(RenderRefuses, ToGoOnWhenStopped) {
  std::stop_source stop;
  RunContext run;
  run.stop = stop.get_token();
  stop.request_stop();
  EXPECT_THAT(render(objects, camera, pose, lamp, options, run), FailsWith(kCancelled));
}

TEST_F(RenderRefuses, ToGoOnWhenStoppedHalfWay) {
  camera.width_px = camera.height_px = 512;
  std::stop_source stop;
  std::mutex guard;
  double last = 0.0;
  RunContext run;
  run.stop = stop.get_token();
  run.progress = [&](double share) {
    const std::scoped_lock lock(guard);
    last = std::max(last, share);
    if (share > 0.4) stop.request_stop();
  };
  EXPECT_THAT(render(objects, camera, pose, lamp, options, run), FailsWith(kCancelled));
  EXPECT_LT(last, 0.9);
}

TEST_F(RenderRefuses, NotToTellItsProgress) {
  std::mutex guard;
  double largest = 0.0;
  RunContext run;
  run.progress = [&](double share) {
    const std::scoped_lock lock(guard);
    EXPECT_TRUE(share >= 0 && share <= 1);
    largest = std::max(largest, share);
  };
  EXPECT_THAT(render(objects, camera, pose, lamp, options, run), Succeeds());
  EXPECT_EQ(largest, 1.0);
}

}  // namespace
}  // namespace maquette::camera
