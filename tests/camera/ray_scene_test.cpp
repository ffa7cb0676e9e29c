// SPDX-License-Identifier: GPL-3.0-or-later

// What is claimed in camera/ray_scene.hpp of terrain with walls, and of rays together:
//
//   first hit, terrain and walls ..... a level field with a base is a box: closed form, from all
//                                      sides, from inside, from far away
//   blocked .......................... the same box between two places
//   walls under rough ground ......... rays that must enter through the upper face or a wall: none
//                                      goes through
//   one shape in many sizes .......... what meshes of their own give, but at silhouettes
//   rays together = rays alone ....... terrain, walls and instanced stones, bit for bit

#include "camera/ray_scene.hpp"

#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include <gtest/gtest.h>

#include "core/random.hpp"
#include "support/simple_solids.hpp"

namespace maquette::camera {
namespace {

using testing_support::sphere_solid;

struct Draws {
  std::uint64_t seed, count = 0;
  double uniform(double lo, double hi) { return lo + (hi - lo) * random_uniform(seed, count++); }
  Vec3 direction() {
    const double z = uniform(-1.0, 1.0), phi = uniform(0.0, 2.0 * std::numbers::pi);
    const double r = std::sqrt(1.0 - z * z);
    return normalized(Vec3{r * std::cos(phi), r * std::sin(phi), z});
  }
  Vec3 in(const Box3& box) {
    return {uniform(box.min.x, box.max.x), uniform(box.min.y, box.max.y),
            uniform(box.min.z, box.max.z)};
  }
};

heightmap::ModelField level_field(float height) {
  return {Grid<float>(61, 81, height), Millimetres{0.5}, Millimetres{-7.0}, Millimetres{3.0}};
}
const Box3 kBox{{-7.0, 3.0, -5.0}, {33.0, 33.0, 10.0}};  // of a level field 10 high, base -5

/// Distances at which a line enters and leaves the box; how near to an edge of it.
struct Passage {
  double enter = -INFINITY, leave = INFINITY, clearance = INFINITY;
};
Passage through_box(Vec3 o, Vec3 d) {
  const std::array<double, 3> from{o.x, o.y, o.z}, way{d.x, d.y, d.z},
      low{kBox.min.x, kBox.min.y, kBox.min.z}, high{kBox.max.x, kBox.max.y, kBox.max.z};
  std::array<double, 3> in, out;
  Passage p;
  for (std::size_t k = 0; k < 3; ++k) {
    const double a = (low[k] - from[k]) / way[k], b = (high[k] - from[k]) / way[k];
    in[k] = std::min(a, b);
    out[k] = std::max(a, b);
    p.enter = std::max(p.enter, in[k]);
    p.leave = std::min(p.leave, out[k]);
  }
  p.clearance = std::abs(p.leave - p.enter);
  for (std::size_t k = 0; k < 3; ++k) {
    if (in[k] != p.enter) p.clearance = std::min(p.clearance, std::abs(in[k] - p.enter));
    if (out[k] != p.leave) p.clearance = std::min(p.clearance, std::abs(out[k] - p.leave));
  }
  return p;
}

Result<RayScene> block_of(const heightmap::ModelField& field) {
  RayObject block;
  block.field = &field;
  block.base_mm = -5.0;
  return RayScene::build({block});
}

TEST(RayScene, ALevelFieldWithABaseIsABox) {
  const auto f = level_field(10.0F);
  const auto scene = block_of(f);
  ASSERT_TRUE(scene);
  Draws draw{1};
  Box3 around = kBox;
  around.min = around.min - Vec3{20.0, 20.0, 20.0};
  around.max = around.max + Vec3{20.0, 20.0, 20.0};
  int hits = 0, misses = 0, stops = 0;
  for (int i = 0; i < 200'000; ++i) {
    Vec3 o = draw.in(around), d = draw.direction();
    if (i % 4 == 0) d = normalized(Vec3{d.x, d.y, 0.02 * d.z});
    if (i % 5 == 0) o = o - draw.uniform(0.0, 2000.0) * d;
    const Passage p = through_box(o, d);
    if (p.clearance < 0.05 || std::abs(p.enter) < 0.05 || std::abs(p.leave) < 0.05) continue;
    const bool met = p.enter <= p.leave && p.leave > 0.0;
    const double at = p.enter > 0.0 ? p.enter : p.leave;
    const auto hit = scene->first_hit(o, d);
    ASSERT_EQ(hit.has_value(), met) << "ray " << i;
    if (hit) {
      ++hits;
      ASSERT_NEAR(hit->distance_mm, at, 1e-3) << "ray " << i;
      ASSERT_EQ(hit->front, p.enter > 0.0) << "ray " << i;
    }
    misses += met ? 0 : 1;
    const double far = draw.uniform(0.1, 80.0);
    if (std::abs(far - at) < 0.05) continue;
    ASSERT_EQ(scene->blocked({o, {}, o + far * d}), met && at < far) << "ray " << i;
    stops += met && at < far ? 1 : 0;
  }
  EXPECT_GT(hits, 30'000);
  EXPECT_GT(misses, 30'000);
  EXPECT_GT(stops, 20'000);
}

heightmap::ModelField rough_field() {
  auto f = level_field(0.0F);
  for (std::ptrdiff_t r = 0; r < f.z_mm.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < f.z_mm.cols(); ++c)
      f.z_mm(r, c) = static_cast<float>(6.0 + 3.0 * std::sin(0.2 * static_cast<double>(c)) *
                                                  std::cos(0.15 * static_cast<double>(r)));
  return f;
}

TEST(RayScene, NothingComesIntoABlockUnseen) {
  const auto f = rough_field();
  const auto scene = block_of(f);
  ASSERT_TRUE(scene);
  Draws draw{2};
  // From outside the outline, above or below, to places under the lowest ground.
  const Box3 deep{{-6.9, 3.1, -4.9}, {32.9, 32.9, 2.9}};
  int walls = 0;
  for (int i = 0; i < 100'000; ++i) {
    const Vec3 to = draw.in(deep);
    const Vec3 d = draw.direction();
    const Vec3 from = to - 100.0 * d;
    const auto hit = scene->first_hit(from, d);
    ASSERT_TRUE(hit.has_value()) << "ray " << i;
    ASSERT_LT(hit->distance_mm, 100.0) << "ray " << i;
    ASSERT_TRUE(hit->front) << "ray " << i;
    ASSERT_TRUE(scene->blocked({from, {}, to})) << "ray " << i;
    // And out again.
    const auto out = scene->first_hit(to, d);
    ASSERT_TRUE(out.has_value() && !out->front) << "ray " << i;
    walls += hit->normal.z == 0.0 ? 1 : 0;
  }
  EXPECT_GT(walls, 20'000);
}

TEST(RayScene, AShapeInSeveralSizesIsWhatItsMeshesAre) {
  const TriMesh ball = sphere_solid({0.3, 0.1, 0.2}, 1.0, 24);
  std::vector<RayObject> shared, plain;
  std::vector<TriMesh> meshes;
  meshes.reserve(8);
  Draws draws{17};
  for (int k = 0; k < 8; ++k) {
    const double size = draws.uniform(0.5, 9.0);
    const RigidTransform pose{rotation_about(draws.direction(), draws.uniform(0.0, 3.0)),
                              draws.in({{-40, -40, 0}, {40, 40, 20}})};
    shared.push_back({.mesh = &ball, .model_from_mesh = pose, .scale = size});
    meshes.push_back(ball);
    for (Vec3& v : meshes.back().vertices_mm) v = pose.point(size * v);
    plain.push_back({.mesh = &meshes.back()});
  }
  const auto of_shape = RayScene::build(shared), of_meshes = RayScene::build(plain);
  ASSERT_TRUE(of_shape && of_meshes);
  const Box3 a = of_shape->bounds(), b = of_meshes->bounds();
  // Corners of a turned box are not those of the turned ball.
  EXPECT_LE(a.min.x, b.min.x + 1e-9);
  EXPECT_GE(a.max.z, b.max.z - 1e-9);
  int hits = 0, apart = 0, shadows = 0, shadows_apart = 0;
  for (int i = 0; i < 20000; ++i) {
    const Vec3 eye = draws.in({{-90, -90, 60}, {90, 90, 90}});
    const Vec3 at = draws.in({{-45, -45, -5}, {45, 45, 25}});
    const Vec3 way = normalized(at - eye);
    const auto one = of_shape->first_hit(eye, way), other = of_meshes->first_hit(eye, way);
    if (one.has_value() != other.has_value()) {
      ++apart;  // silhouettes: within float steps
      continue;
    }
    if (!one) continue;
    ++hits;
    if (one->object != other->object || one->triangle != other->triangle) {
      ++apart;
      continue;
    }
    ASSERT_NEAR(one->distance_mm, other->distance_mm, 10 * of_meshes->offset_mm()) << i;
    ASSERT_NEAR(norm(one->normal - other->normal), 0.0, 1e-9) << i;
    const bool dark = of_shape->blocked({one->point_mm, one->normal, {-300, 100, 80}});
    const bool dark_there = of_meshes->blocked({other->point_mm, other->normal, {-300, 100, 80}});
    shadows += dark ? 1 : 0;
    shadows_apart += dark != dark_there ? 1 : 0;
  }
  EXPECT_GT(hits, 2000);
  EXPECT_LT(apart, 10) << "of 20000 rays";
  EXPECT_GT(shadows, 500);
  EXPECT_LT(shadows_apart, 10);
  EXPECT_TRUE(
      of_shape->inside(shared[3].model_from_mesh.point(shared[3].scale * Vec3{0.3, 0.1, 0.2})));
}

TEST(RayScene, RaysTogetherAnswerAsAlone) {
  const auto f = rough_field();
  const TriMesh stone = sphere_solid({}, 1.5, 12),
                boulder = sphere_solid({40.0, 10.0, 5.0}, 4.0, 20);
  RayObject block;
  block.field = &f;
  block.base_mm = -5.0;
  RayObject alone;
  alone.mesh = &boulder;
  std::vector<RayObject> objects{block, alone};
  Draws draw{3};
  for (int i = 0; i < 40; ++i) {
    RayObject o;
    o.mesh = &stone;
    o.model_from_mesh = {rotation_about({0.0, 0.0, 1.0}, draw.uniform(0.0, 6.0)),
                         {draw.uniform(-5.0, 31.0), draw.uniform(5.0, 31.0), 7.0}};
    objects.push_back(o);
  }
  const auto scene = RayScene::build(objects);
  ASSERT_TRUE(scene);
  std::array<int, 3> of{};
  for (int i = 0; i < 4000; ++i) {
    const Vec3 eye{draw.uniform(-60.0, 90.0), draw.uniform(-60.0, 90.0), draw.uniform(-20.0, 60.0)};
    const Vec3 lamp{draw.uniform(-60.0, 90.0), draw.uniform(-60.0, 90.0), draw.uniform(8.0, 60.0)};
    const Vec3 way = normalized(draw.in(kBox)-eye);
    std::vector<RayScene::Ray> rays;
    for (int k = 0; k < 1 + i % 37; ++k)
      rays.push_back({eye, normalized(way + 0.02 * draw.direction())});
    std::vector<std::optional<RayHit>> hits(rays.size());
    scene->first_hits(rays, hits);
    std::vector<RayScene::ShadowRay> shadows;
    for (std::size_t k = 0; k < rays.size(); ++k) {
      const auto one = scene->first_hit(rays[k].origin_mm, rays[k].direction);
      ASSERT_EQ(one.has_value(), hits[k].has_value());
      if (!one) continue;
      ASSERT_EQ(one->distance_mm, hits[k]->distance_mm);
      ASSERT_EQ(one->normal, hits[k]->normal);
      ASSERT_EQ(one->object, hits[k]->object);
      ASSERT_EQ(one->triangle, hits[k]->triangle);
      ASSERT_EQ(one->front, hits[k]->front);
      ++of[std::min<std::size_t>(one->object, 2)];
      shadows.push_back({one->point_mm, one->normal, lamp});
    }
    std::array<bool, 64> dark{};
    scene->blocked(shadows, {dark.data(), shadows.size()});
    for (std::size_t k = 0; k < shadows.size(); ++k) ASSERT_EQ(scene->blocked(shadows[k]), dark[k]);
  }
  for (const int n : of) EXPECT_GT(n, 500);
}

}  // namespace
}  // namespace maquette::camera
