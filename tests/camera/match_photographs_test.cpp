// SPDX-License-Identifier: GPL-3.0-or-later

// camera/match_photographs.hpp. Photographs come from the renderer of tests/challenge, which shares
// no code with the camera room:
//   what is hidden is found ......... exposures, white balance, lamp, poses within four sigma
//   held out ........................ white balance 13/255 wrong, then at most 3/255
//   sigma ........................... scatter of twelve draws of noise against what is stated
//   what makes up for each other .... refused by name: brightness and exposure, a sun's distance
//   other errors .................... sizes, grey, nothing to search, another scene

#include "camera/match_photographs.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "camera/compare.hpp"
#include "camera/srgb.hpp"
#include "challenge/photo_render.hpp"
#include "challenge/photo_sensor.hpp"
#include "core/random.hpp"
#include "support/matchers.hpp"

namespace maquette::camera {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing_support::FailsWith;
using testing_support::Succeeds;

constexpr double kAlbedo = 0.4, kExposure = 1.8, kFocalPx = 680.0;
constexpr Vec3 kMiddle{80, 80, 20}, kLamp{-250, 200, 330};

/// The part, here and there.
struct World {
  heightmap::ModelField field;
  challenge::Relief relief;
  std::optional<PreparedScene> scene;

  World() : World(terrain()) {}
  explicit World(const challenge::Field& f) : relief(f, challenge::Relief::Between::triangles) {
    field = {Grid<float>(f.n, f.n), Millimetres{f.step}, {}, {}};
    for (int r = 0; r < f.n; ++r)
      for (int c = 0; c < f.n; ++c) field.z_mm(r, c) = static_cast<float>(f.at(r, c));
    SceneObject ground;
    ground.field = &field;
    ground.material = {"matt", Lambert{{kAlbedo, kAlbedo, kAlbedo}}, {}};
    auto built = PreparedScene::build({ground});
    EXPECT_THAT(built, Succeeds());
    scene.emplace(std::move(*built));
  }
  static challenge::Field terrain() {
    challenge::Draw d{std::mt19937_64(11)};
    return challenge::draw_terrain(d);
  }
};
const World& world() {
  static const World w;
  return w;
}

Lighting lighting(Vec3 lamp = kLamp) {
  Lamp l{.position_mm = lamp, .target_mm = kMiddle, .beam_deg = 120.0};
  return {{l}, {}, {}};
}

struct Truth {
  Vec3 lamp = kLamp;
  Bands white_balance{1, 1, 1};
  double exposure = 1.0;
  double ambient = 0.0;
};

/// A photograph by the other renderer, its camera as it really stood.
MatchPhoto shoot(const std::string& name, Vec3 from, const Truth& truth, int width,
                 std::uint64_t seed, bool noise = true) {
  challenge::PhotoCamera camera;
  camera.place = from;
  camera.turn = challenge::looking(from, kMiddle, 0.1);
  camera.width = width, camera.height = width * 3 / 4;
  camera.focal_px = kFocalPx * width / 256.0;
  challenge::PhotoLamp lamp;
  lamp.place = truth.lamp, lamp.target = kMiddle;
  lamp.reference = norm(truth.lamp - kMiddle);
  lamp.scale = kExposure * truth.exposure;
  lamp.beam_half = 1.04;
  challenge::PhotoScene scene;
  scene.relief = &world().relief;
  scene.paint.albedo = kAlbedo;
  if (truth.ambient > 0.0) {
    scene.ambient.fill(truth.ambient);
    scene.openness = challenge::openness_of(world().relief, {}, 4.0, 64, 1);
  }
  challenge::Picture picture = challenge::render(scene, camera, lamp, {}, 0, 1, seed);
  challenge::Sensor sensor;
  sensor.full_well_e = 5000;
  sensor.gain = truth.white_balance;
  if (noise) challenge::expose(sensor, picture, seed, 0);
  MatchPhoto p;
  p.name = name;
  for (std::size_t b = 0; b < 3; ++b) {
    Grid<float>& band = p.light.emplace_back(camera.height, camera.width);
    std::copy(picture[b].v.begin(), picture[b].v.end(), band.cells().begin());
    if (!noise)
      for (float& v : band.cells()) v *= static_cast<float>(truth.white_balance[b]);
  }
  p.camera = {camera.width, camera.height, 10.0, 0.01 * camera.focal_px};
  p.model_from_camera = {camera.turn, from};
  p.exposure_scale = kExposure;
  return p;
}

/// Pushes a pose by mm and rad in its own frame.
void push(MatchPhoto& p, Vec3 mm, Vec3 axis, double rad) {
  p.model_from_camera =
      p.model_from_camera * RigidTransform{rotation_about(normalized(axis), rad), mm};
}

MatchOptions search_for(const MatchSearch& search) {
  MatchOptions o;
  o.search = search;
  o.render.samples_per_pixel = 16;
  return o;
}

const MatchedNumber& number(const PhotographMatch& m, const std::string& name) {
  for (const MatchedNumber& n : m.numbers)
    if (n.name == name) return n;
  static const MatchedNumber none;
  ADD_FAILURE() << name << " was not searched";
  return none;
}

void print(const PhotographMatch& m) {
  for (const MatchedNumber& n : m.numbers)
    fmt::print("{:<32}{:>12.5f} -> {:>12.5f} +- {:.5f}\n", n.name, n.start, n.value, n.sigma);
  fmt::print("{} steps, {} values worth {:.0f} independent ones, {:.2f}/255 left\n", m.steps,
             m.pixels, m.independent_pixels, m.rms_255);
}

TEST(MatchPhotographs, FindsWhatAnotherRendererHides) {
  const Vec3 lamp = kLamp + Vec3{9, -7, 12};
  const Bands balance{0.8, 1.0, 1.2};
  std::vector<MatchPhoto> photos{shoot("south.exr", {90, -260, 380}, {lamp, balance, 0.93}, 256, 1),
                                 shoot("east.exr", {420, 60, 330}, {lamp, balance, 1.08}, 256, 2)};
  const auto real = photos;
  push(photos[0], {1.2, -0.8, 1.5}, {1, 2, -1}, 4e-3);
  push(photos[1], {-1.0, 0.7, -2.0}, {0, -1, 1}, 5e-3);
  const auto m = match_photographs(
      *world().scene, photos, lighting(), {1, 1, 1},
      search_for(
          {.exposure_each = true, .white_balance = true, .lamp_position = true, .pose = true}));
  ASSERT_THAT(m, Succeeds());
  print(*m);
  const auto near = [&](const std::string& name, double truth) {
    const MatchedNumber& n = number(*m, name);
    EXPECT_NEAR(n.value, truth, 4.0 * n.sigma) << name;
  };
  near("south.exr: exposure", 0.93);
  near("east.exr: exposure", 1.08);
  near("white_balance.red", 0.8);
  near("white_balance.blue", 1.2);
  near("lamp.x_mm", lamp.x);
  near("lamp.y_mm", lamp.y);
  near("lamp.z_mm", lamp.z);
  for (std::size_t p = 0; p < 2; ++p) {
    const RigidTransform way = photos[p].model_from_camera.inverse() * real[p].model_from_camera;
    near(real[p].name + ": right_mm", way.translation_mm.x);
    near(real[p].name + ": up_mm", way.translation_mm.y);
    near(real[p].name + ": back_mm", way.translation_mm.z);
    near(real[p].name + ": about_right_mrad", 2e3 * way.rotation.x);
    near(real[p].name + ": about_up_mrad", 2e3 * way.rotation.y);
    near(real[p].name + ": about_back_mrad", 2e3 * way.rotation.z);
  }
}

/// x/255 between a photograph and its rendering, both as 8 bits.
double difference_255(const MatchPhoto& p, const MatchState& state, double exposure) {
  RenderOptions o;
  o.samples_per_pixel = 16;
  o.exposure_scale = exposure;
  o.white_balance = state.white_balance;
  const auto image = world().scene->render(p.camera, p.model_from_camera, state.lighting, o);
  EXPECT_THAT(image, Succeeds());
  LoadedImage real{{"R", "G", "B"}, {}, true, 255.0}, rendered;
  for (const Grid<float>& band : p.light) {
    Grid<float>& to = real.channels.emplace_back(band.rows(), band.cols());
    for (std::size_t i = 0; i < band.cells().size(); ++i)
      to.cells()[i] = static_cast<float>(srgb8(static_cast<double>(band.cells()[i])) / 255.0);
  }
  if (image->bands.size() == 1)
    rendered = {{"Y"}, {image->bands[0]}};
  else
    rendered = {{"R", "G", "B"}, image->bands};
  rendered.names.emplace_back("Z");
  rendered.channels.push_back(image->depth_mm);
  const auto c = compare_images(real, rendered);
  EXPECT_THAT(c, Succeeds());
  return c->mean_abs_diff_255;
}

TEST(MatchPhotographs, HoldsForAPhotographThatHadNoPart) {
  const Truth truth{kLamp + Vec3{12, 8, -6}, {0.72, 1.0, 1.33}, 0.95};
  std::vector<MatchPhoto> photos{shoot("south.exr", {90, -260, 380}, truth, 256, 3)};
  const MatchPhoto held_out = shoot("east.exr", {420, 60, 330}, truth, 256, 4);
  MatchState start{{}, {1, 1, 1}, lighting(), {}};
  const double before = difference_255(held_out, start, kExposure);
  const auto m = match_photographs(
      *world().scene, photos, lighting(), {1, 1, 1},
      search_for({.exposure = true, .white_balance = true, .lamp_position = true}));
  ASSERT_THAT(m, Succeeds());
  print(*m);
  const double after = difference_255(held_out, m->state, m->state.exposure_scale[0]);
  fmt::print("held out: {:.2f}/255 before, {:.2f}/255 after\n", before, after);
  EXPECT_GT(before, 13.0);
  EXPECT_LT(after, 3.0);
}

TEST(MatchPhotographs, ErrorsScatterAsStated) {
  const MatchPhoto clean = shoot("photo.exr", {90, -260, 380}, {}, 96, 5, false);
  double square = 0.0;
  std::size_t count = 0;
  std::vector<double> first;
  for (std::uint64_t draw = 0; draw < 12; ++draw) {
    MatchPhoto p = clean;
    std::uint64_t counter = 0;
    for (Grid<float>& band : p.light)
      for (float& v : band.cells())
        v += static_cast<float>(0.02 * random_normal(100 + draw, counter++));
    push(p, {0.5, -0.5, 1.0}, {1, 1, 0}, 2e-3);
    const auto m =
        match_photographs(*world().scene, {p}, lighting(kLamp + Vec3{3, 3, -3}), {1, 1, 1},
                          search_for({.exposure = true, .lamp_position = true, .pose = true}));
    ASSERT_THAT(m, Succeeds());
    const RigidTransform way = p.model_from_camera.inverse() * clean.model_from_camera;
    const std::array truth{1.0,
                           kLamp.x,
                           kLamp.y,
                           kLamp.z,
                           way.translation_mm.x,
                           way.translation_mm.y,
                           way.translation_mm.z,
                           2e3 * way.rotation.x,
                           2e3 * way.rotation.y,
                           2e3 * way.rotation.z};
    const std::array names{"exposure",
                           "lamp.x_mm",
                           "lamp.y_mm",
                           "lamp.z_mm",
                           "photo.exr: right_mm",
                           "photo.exr: up_mm",
                           "photo.exr: back_mm",
                           "photo.exr: about_right_mrad",
                           "photo.exr: about_up_mrad",
                           "photo.exr: about_back_mrad"};
    for (std::size_t k = 0; k < truth.size(); ++k) {
      const MatchedNumber& n = number(*m, names[k]);
      const double z = (n.value - truth[k]) / n.sigma;
      square += z * z, ++count;
    }
  }
  const double ratio = std::sqrt(square / static_cast<double>(count));
  fmt::print("errors over stated: {:.3f} ({} numbers)\n", ratio, count);
  EXPECT_GT(ratio, 0.8);
  EXPECT_LT(ratio, 1.3);
}

TEST(MatchPhotographs, RefusesWhatMakesUpForEachOther) {
  const auto match = [&](const Lighting& light, const MatchSearch& search) {
    const Truth truth{.ambient = light.ambient[0]};
    return match_photographs(*world().scene, {shoot("photo.exr", {90, -260, 380}, truth, 128, 6)},
                             light, {1, 1, 1}, search_for(search));
  };
  const auto brightness = match(lighting(), {.exposure = true, .lamp_brightness = true});
  ASSERT_THAT(brightness, FailsWith(kMatchOpen));
  EXPECT_THAT(brightness.error().message,
              AllOf(HasSubstr("exposure"), HasSubstr("lamp.brightness")));
  Lighting sun = lighting();
  sun.lamps[0].sun_diameter_deg = 0.0;
  const auto distance = match(sun, {.exposure = true, .lamp_position = true});
  ASSERT_THAT(distance, FailsWith(kMatchOpen));
  EXPECT_THAT(distance.error().message, HasSubstr("lamp.x_mm"));
  // Light of the room that is known says which of the two it is.
  Lighting room = lighting();
  room.ambient = {0.1, 0.1, 0.1};
  EXPECT_THAT(match(room, {.exposure = true, .lamp_brightness = true}), Succeeds());
}

TEST(MatchPhotographs, SaysWhatIsWrong) {
  const MatchPhoto good = shoot("photo.exr", {90, -260, 380}, {}, 128, 7);
  const auto match = [&](const MatchPhoto& p, const MatchSearch& search) {
    return match_photographs(*world().scene, {p}, lighting(), {1, 1, 1}, search_for(search));
  };
  const auto fails = [&](const MatchPhoto& p, const MatchSearch& search, const char* says) {
    const auto m = match(p, search);
    ASSERT_THAT(m, FailsWith(kMatchPhotograph));
    EXPECT_THAT(m.error().message, HasSubstr(says));
  };
  fails(good, {}, "nothing to search for");
  MatchPhoto p = good;
  p.camera.width_px = 100;
  fails(p, {.exposure = true}, "its camera 100");
  p = good;
  p.light.resize(1);
  fails(p, {.white_balance = true}, "grey");
  p = good;
  for (Grid<float>& band : p.light) std::fill(band.cells().begin(), band.cells().end(), 1.0F);
  fails(p, {.exposure = true}, "saturated");
  p = good;
  p.exposure_scale = 0.0;
  fails(p, {.exposure = true}, "exposure scale");
  // Another scene: noise, and the picture upside down.
  p = good;
  for (Grid<float>& band : p.light) std::reverse(band.cells().begin(), band.cells().end());
  EXPECT_THAT(match(p, {.exposure = true}), FailsWith(kMatchNotConverged));
}

}  // namespace
}  // namespace maquette::camera
