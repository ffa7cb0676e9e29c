// SPDX-License-Identifier: GPL-3.0-or-later

// camera/render.hpp beside another renderer, POV-Ray (tools/setup --peers; skipped without it):
// terrain and stones under a point lamp, in linear light. Outside the edges of shadows, where a
// pixel is what two samplings of it make of it, pictures differ by less than 1/255 of white in the
// mean; measured figures are in docs/camera.md.

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "camera/compare.hpp"
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

class BesidePovray : public testing::TestWithParam<View> {};

TEST_P(BesidePovray, LinearLightIsTheSameOutsideTheEdgesOfShadows) {
  const auto command = povray();
  if (!command) GTEST_SKIP() << "no POV-Ray: tools/setup --peers";
  const heightmap::ModelField field = ground(Ground::rolling, 5, 161, 0.5);
  const TriMesh terrain = mesh_of(field);
  const TriMesh stone = sphere_solid({30, 45, 9}, 5.0, 24),
                other = sphere_solid({52, 28, 8}, 3.0, 16);
  const Vec3 middle{37, 41, 5};
  const auto material = [](double albedo) {
    return Material{"matt", Lambert{{albedo, albedo, albedo}}, {}};
  };
  const CameraModel camera{320, 240, 20.0, 40.0};
  const RigidTransform pose = look_at(GetParam().camera_mm, middle);
  const Lamp lamp{.position_mm = GetParam().lamp_mm, .target_mm = middle, .beam_deg = 170.0};
  std::vector<SceneObject> objects(3);
  objects[0].field = &field, objects[0].material = material(0.3);
  objects[1].mesh = &stone, objects[1].material = material(0.5);
  objects[2].mesh = &other, objects[2].material = material(0.15);
  RenderOptions options;
  options.samples_per_pixel = 16;
  options.exposure_scale = GetParam().exposure_scale;
  const auto ours = render(objects, camera, pose, lamp, options);
  ASSERT_THAT(ours, Succeeds());

  const ScratchFolder scratch;
  const auto theirs = render_with_povray(*command,
                                         {{{&terrain, 0.3}, {&stone, 0.5}, {&other, 0.15}},
                                          camera,
                                          pose,
                                          lamp.position_mm,
                                          middle,
                                          GetParam().exposure_scale},
                                         4, scratch.path());
  ASSERT_TRUE(theirs) << std::ifstream(scratch / "said.txt").rdbuf();

  Grid<float> lit(ours->lit.rows(), ours->lit.cols());
  std::copy(ours->lit.cells().begin(), ours->lit.cells().end(), lit.cells().begin());
  const LoadedImage a{{"Y"}, {*theirs}},
      b{{"Y", "Z", "lit"}, {ours->bands[0], ours->depth_mm, lit}};
  const auto c = compare_images(a, b);
  ASSERT_THAT(c, Succeeds());
  ASSERT_TRUE(c->rest && c->shadow_edges);
  double mean = 0.0, most = 0.0;
  for (const float v : theirs->cells())
    mean += static_cast<double>(v), most = std::max(most, static_cast<double>(v));
  ASSERT_LT(most, 1.0) << "POV-Ray's picture is cut off there";
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

INSTANTIATE_TEST_SUITE_P(
    Views, BesidePovray,
    testing::Values(View{"high lamp", {37, -60, 120}, {-200, 60, 300}, 1.7},
                    View{"low lamp", {37, -60, 120}, {-300, 60, 60}, 1.8},
                    View{"oblique view, lamp behind", {-80, 20, 50}, {300, 250, 300}, 1.8}),
    [](const auto& of) { return "View" + std::to_string(of.index); });

}  // namespace
}  // namespace maquette::camera
