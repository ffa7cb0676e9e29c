// SPDX-License-Identifier: GPL-3.0-or-later

// camera/render.hpp beside another renderer, POV-Ray (tools/setup --peers; skipped without it):
// terrain and stones under a point lamp, in linear light. Outside the edges of shadows, where a
// pixel is what two samplings of it make of it, pictures differ by less than 1/255 of white in the
// mean; measured figures are in docs/camera.md. And photographs made of POV-Ray's pictures, from a
// start with a wrong white balance, exposure, lamp and pose: matched, those held out differ by at
// most 3/255.

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "camera/compare.hpp"
#include "camera/match_photographs.hpp"
#include "support/field_mesh.hpp"
#include "support/matchers.hpp"
#include "support/povray.hpp"
#include "support/simple_solids.hpp"
#include "support/terrain.hpp"

namespace maquette::camera {
namespace {

using namespace testing_support;

struct View {
  const char* name;
  Vec3 camera_mm, lamp_mm;
  double exposure_scale;  ///< nothing saturates
};

void PrintTo(const View& v, std::ostream* out) {
  *out << v.name;
}

constexpr Vec3 kMiddle{37, 41, 5};
constexpr std::array kAlbedo{0.3, 0.5, 0.15};  // terrain, stones

/// Terrain and two stones, here and there.
class Both {
 public:
  Both() : objects_(3) {
    const std::array<const TriMesh*, 3> meshes{nullptr, &stone_, &other_};
    objects_[0].field = &field_;
    for (std::size_t k = 0; k < 3; ++k) {
      objects_[k].mesh = meshes[k];
      objects_[k].material = {"matt", Lambert{{kAlbedo[k], kAlbedo[k], kAlbedo[k]}}, {}};
    }
  }
  [[nodiscard]] static CameraModel camera() { return {320, 240, 20.0, 40.0}; }
  [[nodiscard]] static RigidTransform pose(const View& v) { return look_at(v.camera_mm, kMiddle); }
  [[nodiscard]] static Lighting lighting(Vec3 lamp_mm) {
    return {{Lamp{.position_mm = lamp_mm, .target_mm = kMiddle, .beam_deg = 170.0}}, {}, {}};
  }
  [[nodiscard]] const std::vector<SceneObject>& objects() const { return objects_; }
  /// By POV-Ray, nothing cut off.
  [[nodiscard]] std::optional<Grid<float>> theirs(const std::string& command, const View& v) const {
    const ScratchFolder scratch;
    auto picture =
        render_with_povray(command,
                           {{{&terrain_, kAlbedo[0]}, {&stone_, kAlbedo[1]}, {&other_, kAlbedo[2]}},
                            camera(),
                            pose(v),
                            v.lamp_mm,
                            kMiddle,
                            v.exposure_scale},
                           4, scratch.path());
    if (!picture)
      ADD_FAILURE() << std::ifstream(scratch / "said.txt").rdbuf();
    else
      EXPECT_LT(*std::max_element(picture->cells().begin(), picture->cells().end()), 1.0F)
          << "POV-Ray's picture is cut off there";
    return picture;
  }

 private:
  heightmap::ModelField field_ = ground(Ground::rolling, 5, 161, 0.5);
  TriMesh terrain_ = mesh_of(field_);
  TriMesh stone_ = sphere_solid({30, 45, 9}, 5.0, 24), other_ = sphere_solid({52, 28, 8}, 3.0, 16);
  std::vector<SceneObject> objects_;
};

class BesidePovray : public testing::TestWithParam<View> {};

TEST_P(BesidePovray, LinearLightIsTheSameOutsideTheEdgesOfShadows) {
  const auto command = povray();
  if (!command) GTEST_SKIP() << "no POV-Ray: tools/setup --peers";
  const Both both;
  RenderOptions options;
  options.samples_per_pixel = 16;
  options.exposure_scale = GetParam().exposure_scale;
  const auto ours = render(both.objects(), Both::camera(), Both::pose(GetParam()),
                           Both::lighting(GetParam().lamp_mm).lamps[0], options);
  ASSERT_THAT(ours, Succeeds());
  const auto theirs = both.theirs(*command, GetParam());
  ASSERT_TRUE(theirs);
  const auto c = compare_images({{"Y"}, {*theirs}}, with_masks(*ours));
  ASSERT_THAT(c, Succeeds());
  ASSERT_TRUE(c->rest && c->shadow_edges);
  double mean = 0.0;
  for (const float v : theirs->cells()) mean += static_cast<double>(v);
  mean *= 255.0 / static_cast<double>(theirs->cells().size());
  fmt::print(
      "{}: outside shadow edges {:.3f}/255 in the mean, bias {:+.4f}, RMSE {:.3f}, of {:.0f} "
      "({} pixels); at the edges {:.2f} ({} pixels)\n",
      GetParam().name, c->rest->mean_abs_diff_255, c->rest->bias_255, c->rest->rmse_255, mean,
      c->rest->pixels, c->shadow_edges->mean_abs_diff_255, c->shadow_edges->pixels);
  EXPECT_GT(c->rest->pixels, 30000U);
  EXPECT_LT(c->rest->mean_abs_diff_255, 0.5);
  EXPECT_LT(std::abs(c->rest->bias_255), 0.02);
}

/// POV-Ray's picture as a photograph of 8 bits whose white balance is off.
LoadedImage photograph(const Grid<float>& light, const Bands& balance) {
  LoadedImage image{{"R", "G", "B"}, {}, true, 255.0};
  for (const double gain : balance) {
    Grid<float>& to = image.channels.emplace_back(light.rows(), light.cols());
    for (std::size_t i = 0; i < light.cells().size(); ++i)
      to.cells()[i] =
          static_cast<float>(srgb8(gain * static_cast<double>(light.cells()[i])) / 255.0);
  }
  return image;
}

TEST(MatchedToPovray, HoldsForPhotographsThatHadNoPart) {
  const auto command = povray();
  if (!command) GTEST_SKIP() << "no POV-Ray: tools/setup --peers";
  const Both both;
  const Vec3 lamp{-180, 70, 290};
  const Bands balance{0.7, 1.0, 1.35};
  const std::array views{View{"searched in", {37, -60, 120}, lamp, 1.15},
                         View{"from the west", {-60, 20, 90}, lamp, 1.15},
                         View{"from the north", {60, 130, 100}, lamp, 1.15}};
  std::vector<LoadedImage> photos;
  for (const View& v : views) {
    const auto light = both.theirs(*command, v);
    ASSERT_TRUE(light);
    photos.push_back(photograph(*light, balance));
  }
  const auto scene = PreparedScene::build(both.objects());
  ASSERT_THAT(scene, Succeeds());
  // Exposure 8 % off, the lamp 16 mm, the camera 1.5 mm and 4 mrad.
  const MatchPhoto photo{
      views[0].name, linear_light(photos[0]), Both::camera(),
      Both::pose(views[0]) *
          RigidTransform{rotation_about(normalized(Vec3{1, -1, 2}), 4e-3), {1.0, -0.8, 0.8}},
      1.25};
  const Lighting start = Both::lighting(lamp + Vec3{10, -8, 10});
  MatchOptions options;
  options.search = {.exposure = true, .white_balance = true, .lamp_position = true, .pose = true};
  options.finest_px = 160;  // quick
  const auto m = match_photographs(*scene, {photo}, start, {1, 1, 1}, options);
  ASSERT_THAT(m, Succeeds());
  for (const MatchedNumber& n : m->numbers)
    fmt::print("{:<32}{:>12.5f} -> {:>12.5f} +- {:.5f}\n", n.name, n.start, n.value, n.sigma);
  const auto near = [&](const std::string& name, double truth) {
    for (const MatchedNumber& n : m->numbers)
      if (n.name == name) {
        EXPECT_NEAR(n.value, truth, 4.0 * n.sigma) << name;
        return;
      }
    ADD_FAILURE() << name;
  };
  near("exposure", 0.92);
  near("white_balance.red", balance[0]);
  near("white_balance.blue", balance[2]);
  near("lamp.x_mm", lamp.x);
  near("lamp.y_mm", lamp.y);
  near("lamp.z_mm", lamp.z);
  const auto beside = [&](std::size_t k, const Lighting& light, const Bands& white,
                          double exposure) {
    RenderOptions o;
    o.samples_per_pixel = 16;
    o.exposure_scale = exposure;
    o.white_balance = white;
    const auto image = scene->render(Both::camera(), Both::pose(views[k]), light, o);
    EXPECT_THAT(image, Succeeds());
    const auto c = compare_images(photos[k], with_masks(*image));
    EXPECT_THAT(c, Succeeds());
    return c->mean_abs_diff_255;
  };
  for (const std::size_t k : {std::size_t{1}, std::size_t{2}}) {
    const double wrong_balance = beside(k, Both::lighting(lamp), {1, 1, 1}, 1.15),
                 before = beside(k, start, {1, 1, 1}, 1.25),
                 after = beside(k, m->state.lighting, m->state.white_balance,
                                m->state.exposure_scale[0]);
    fmt::print(
        "held out, {}: white balance alone {:.2f}/255, start {:.2f}/255, matched {:.2f}/255\n",
        views[k].name, wrong_balance, before, after);
    EXPECT_GT(before, 13.0);
    EXPECT_LT(after, 3.0);
  }
}

INSTANTIATE_TEST_SUITE_P(
    Views, BesidePovray,
    testing::Values(View{"high lamp", {37, -60, 120}, {-200, 60, 300}, 1.7},
                    View{"low lamp", {37, -60, 120}, {-300, 60, 60}, 1.8},
                    View{"oblique view, lamp behind", {-80, 20, 50}, {300, 250, 300}, 1.8}),
    [](const auto& of) { return "View" + std::to_string(of.index); });

}  // namespace
}  // namespace maquette::camera
