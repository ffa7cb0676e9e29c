// SPDX-License-Identifier: GPL-3.0-or-later

// A picture rendered here and by POV-Ray (tools/setup --peers; without it that is said and only
// ours is timed) from the same triangles: terrain of 400 x 400 quads, 100 stones, one point lamp,
// 1064 x 708 pixels, with one place a pixel and with sixteen. CPU seconds of both, the scene's
// part apart (POV-Ray's: of a picture of 48 pixels), and how far the two pictures lie apart in
// linear light.
//
//   povray_bench

#include <fstream>
#include <optional>
#include <sstream>
#include <string>
#include <vector>

#include <fmt/format.h>

#include "camera/compare.hpp"
#include "camera/render.hpp"
#include "core/random.hpp"
#include "support/bench_times.hpp"
#include "support/field_mesh.hpp"
#include "support/matchers.hpp"
#include "support/povray.hpp"
#include "support/shapes.hpp"
#include "support/terrain.hpp"

namespace maquette {
namespace {

using namespace testing_support;

constexpr double kGround = 0.3, kStone = 0.5;  // albedo
constexpr Vec3 kMiddle{100.0, 100.0, 5.0}, kEye{100.0, -90.0, 160.0}, kLamp{-350.0, 180.0, 320.0};
constexpr double kExposure = 1.6;  // nothing saturates
constexpr camera::CameraModel kCamera{1064, 708, 8.45, 8.6};

class Scene {
 public:
  Scene() {
    for (std::uint64_t i = 0; i < 100; ++i) {
      const double x = 10.0 + 180.0 * random_uniform(9, 3 * i),
                   y = 10.0 + 180.0 * random_uniform(9, 3 * i + 1);
      const RigidTransform pose{
          rotation_about({0.0, 0.0, 1.0}, 6.28 * random_uniform(9, 3 * i + 2)),
          {x, y, heightmap::height_at(field_, x, y)}};
      TriMesh stone = random_rock(i % 10, {}, 1.0 + 0.25 * static_cast<double>(i % 10), 2);
      for (Vec3& v : stone.vertices_mm) v = pose.point(v);
      stones_.push_back(std::move(stone));
    }
    camera::SceneObject object;
    object.field = &field_;
    object.material = matt(kGround);
    objects_.push_back(object);
    object.field = nullptr;
    object.material = matt(kStone);
    for (const TriMesh& stone : stones_) {
      object.mesh = &stone;
      objects_.push_back(object);
    }
  }
  /// Ours, with what it takes.
  [[nodiscard]] std::optional<camera::Image> ours(int samples, Times& build, Times& render) const {
    const Times start = now();
    const auto scene = camera::PreparedScene::build(objects_);
    const Times built = now();
    if (!scene) return std::nullopt;
    const camera::Lamp lamp{.position_mm = kLamp, .target_mm = kMiddle, .beam_deg = 170.0};
    auto image = scene->render(kCamera, camera::look_at(kEye, kMiddle), {{lamp}, {}, {}},
                               {.samples_per_pixel = samples, .exposure_scale = kExposure});
    const Times end = now();
    build = {built.wall - start.wall, built.cpu - start.cpu};
    render = {end.wall - built.wall, end.cpu - built.cpu};
    if (!image) return std::nullopt;
    return std::move(*image);
  }
  [[nodiscard]] PovrayScene theirs() const {
    PovrayScene s{
        {{&terrain_, kGround}}, kCamera, camera::look_at(kEye, kMiddle), kLamp, kMiddle, kExposure};
    for (const TriMesh& stone : stones_) s.objects.push_back({&stone, kStone});
    return s;
  }

 private:
  static camera::Material matt(double albedo) {
    return {"matt", camera::Lambert{{albedo, albedo, albedo}}, {}};
  }
  heightmap::ModelField field_ = ground(Ground::rolling, 5, 401, 0.5);
  TriMesh terrain_ = mesh_of(field_);
  std::vector<TriMesh> stones_;
  std::vector<camera::SceneObject> objects_;
};

/// Theirs with side x side places a pixel, with what it takes. Nothing, and why, if it failed.
std::optional<Grid<float>> rendered_there(const std::string& command, const PovrayScene& scene,
                                          int side, double& cpu_s) {
  const ScratchFolder scratch;
  const double before = cpu_seconds(RUSAGE_CHILDREN);
  auto picture = render_with_povray(command, scene, side, scratch.path());
  cpu_s = cpu_seconds(RUSAGE_CHILDREN) - before;
  if (!picture) {
    std::stringstream said;
    said << std::ifstream(scratch / "said.txt").rdbuf();
    fmt::print("  POV-Ray failed: {}\n", said.str());
  }
  return picture;
}

int run() {
  const auto command = povray();
  if (!command) fmt::print("POV-Ray is not here (tools/setup --peers): not compared\n");
  const Scene scene;
  bool worked = true;
  double reading = 0.0;
  if (command) {
    // A picture of few pixels is almost nothing but the scene.
    PovrayScene few = scene.theirs();
    few.camera.width_px = 8, few.camera.height_px = 6;
    if (!rendered_there(*command, few, 1, reading)) return 1;
  }
  for (const int side : {1, 4}) {
    Times build, render;
    const auto image = scene.ours(side * side, build, render);
    if (!image) {
      fmt::print("not rendered\n");
      return 1;
    }
    fmt::print("{0} x {1} pixels, {2} x {2} places each\n", kCamera.width_px, kCamera.height_px,
               side);
    fmt::print("  ours     {:>8.2f} CPU s: scene {:.2f}, tracing {:.2f}\n", build.cpu + render.cpu,
               build.cpu, render.cpu);
    if (!command) continue;
    double took = 0.0;
    const auto theirs = rendered_there(*command, scene.theirs(), side, took);
    if (!theirs) return 1;
    fmt::print("  POV-Ray  {:>8.2f} CPU s: scene {:.2f}, tracing and writing {:.2f}\n", took,
               reading, took - reading);
    std::size_t cut_off = 0;
    for (const float v : theirs->cells()) cut_off += v >= 1.0F ? 1U : 0U;
    const auto c = camera::compare_images({{"Y"}, {*theirs}}, camera::with_masks(*image));
    if (!c || !c->rest || !c->shadow_edges) {
      fmt::print("  not compared\n");
      worked = false;
      continue;
    }
    fmt::print(
        "  apart    {:.3f}/255 in the mean outside shadow edges ({} pixels), bias {:+.4f}, "
        "RMSE {:.3f};\n           {:.2f}/255 at the edges ({} pixels); {} pixels of POV-Ray's are "
        "cut off\n",
        c->rest->mean_abs_diff_255, c->rest->pixels, c->rest->bias_255, c->rest->rmse_255,
        c->shadow_edges->mean_abs_diff_255, c->shadow_edges->pixels, cut_off);
    // The test beside POV-Ray holds 0.5; here facets are as small as pixels.
    worked = worked && c->rest->mean_abs_diff_255 < 1.0;
  }
  return worked ? 0 : 1;
}

}  // namespace
}  // namespace maquette

int main() {
  return maquette::run();
}
