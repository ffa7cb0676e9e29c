// SPDX-License-Identifier: GPL-3.0-or-later

// camera/render.hpp, camera/ray_scene.hpp:
//   radiance 1.0 = white, facing ..... one picture, straight down
//   irradiance and depth of a plane .. closed form at every pixel, three laws
//   the beam is a cone ............... lit circle of known radius
//   no acne .......................... tilted fine mesh far from the origin, low lamp
//   terminator of a sphere ........... sign of n . l within a facet's angle
//   penumbra ......................... visible share of a disc behind a straight edge
//   lit ............................... each lamp's own bit: two lamps together as each alone,
//   points
//                                      and lenses
//   where pixels look ................ look_at laws, a marker's place in the picture
//   depth and shadow of terrain ...... brute force over all triangles, random hills
//   moving everything changes nothing  the same scene 200 m away
//   same bits for any thread count ... rays through mesh vertices, soft lamp

#include "camera/render.hpp"

#include <numbers>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include "camera/ray_scene.hpp"
#include "support/matchers.hpp"
#include "support/simple_solids.hpp"

namespace maquette::camera {
namespace {

using testing_support::box_solid;
using testing_support::Hills;
using testing_support::sphere_solid;
using testing_support::Succeeds;
using testing_support::terrain_solid;

constexpr double kPi = std::numbers::pi;

CameraModel small_camera(int width, int height, double focal_mm) {
  return {width, height, 100.0, focal_mm};
}
Bands grey(double albedo) {
  return {albedo, albedo, albedo};
}
Material white() {
  return {"white", Lambert{grey(1.0)}};
}
enum class Reflectance { lambert, lommel_seeliger, lunar_lambert };
Law law_of(Reflectance which, double albedo, double l) {
  if (which == Reflectance::lommel_seeliger) return LommelSeeliger{grey(albedo)};
  if (which == Reflectance::lunar_lambert) return LunarLambert{grey(albedo), l};
  return Lambert{grey(albedo)};
}
/// Where pixel (row, col) looks, by the header's words and not by the code.
Vec3 pixel_way(const CameraModel& camera, const RigidTransform& pose, std::ptrdiff_t row,
               std::ptrdiff_t col) {
  const double pitch = camera.pixel_pitch_um / 1000.0;
  const Vec3 in_camera{(static_cast<double>(col) + 0.5 - camera.width_px / 2.0) * pitch,
                       (camera.height_px / 2.0 - static_cast<double>(row) - 0.5) * pitch,
                       -camera.focal_length_mm};
  return normalized(rotate(pose.rotation, in_camera));
}

TEST(Render, GivesOneForWhiteThatFacesTheLampAtItsTarget) {
  const TriMesh slab = box_solid({-100, -100, -10}, {100, 100, 0});
  const Lamp lamp{{0, 0, 1000}, {0, 0, 0}, 0.0, 56.0};
  const auto image = render({{&slab, white()}}, small_camera(9, 9, 100),
                            look_at({0, 0, 500}, {0, 0, 0}), lamp, {1});
  ASSERT_THAT(image, Succeeds());
  EXPECT_NEAR(image->bands[0](4, 4), 1.0, 1e-6);
  EXPECT_NEAR(image->depth_mm(4, 4), 500.0, 1e-4);
}

class RenderPlane : public testing::TestWithParam<Reflectance> {};

TEST_P(RenderPlane, HasTheIrradianceAndDepthOfTheClosedForm) {
  const TriMesh slab = box_solid({-400, -400, -10}, {400, 400, 0});
  const Lamp lamp{{-300, 120, 400}, {20, -10, 0}, 0.0, 120.0};
  const CameraModel camera = small_camera(48, 32, 8.0);
  const auto pose = look_at({150, -250, 260}, {10, 20, 0});
  const Material material{"plane", law_of(GetParam(), 0.42, 0.3)};
  const RenderOptions options{1, 1, 1.7, 1};
  const auto image = render({{&slab, material}}, camera, pose, lamp, options);
  ASSERT_THAT(image, Succeeds());
  const Vec3 to_target = lamp.target_mm - lamp.position_mm;
  int seen = 0;
  for (std::ptrdiff_t r = 0; r < 32; ++r)
    for (std::ptrdiff_t c = 0; c < 48; ++c) {
      const Vec3 way = pixel_way(camera, pose, r, c);
      const double t = -pose.translation_mm.z / way.z;
      const Vec3 p = pose.translation_mm + t * way;
      if (std::abs(p.x) > 399 || std::abs(p.y) > 399) continue;
      ++seen;
      const Vec3 l = lamp.position_mm - p;
      const double mu0 = l.z / norm(l), mu = -way.z, ls = 2 * mu0 / (mu0 + mu);
      const double law = GetParam() == Reflectance::lambert           ? mu0
                         : GetParam() == Reflectance::lommel_seeliger ? ls
                                                                      : 0.3 * ls + 0.7 * mu0;
      const double expected = 1.7 * 0.42 * law * dot(to_target, to_target) / dot(l, l);
      // Float image: 6e-8; what is promised is 0.1 %.
      EXPECT_NEAR(image->bands[0](r, c) / expected, 1.0, 1e-6) << r << ' ' << c;
      EXPECT_NEAR(image->depth_mm(r, c), t, 1e-4);
      EXPECT_EQ(image->lit(r, c), 1);
    }
  EXPECT_GT(seen, 1000);
}
INSTANTIATE_TEST_SUITE_P(Laws, RenderPlane,
                         testing::Values(Reflectance::lambert, Reflectance::lommel_seeliger,
                                         Reflectance::lunar_lambert));

TEST(Render, ManySamplesAverageToTheSamePlane) {
  const TriMesh slab = box_solid({-400, -400, -10}, {400, 400, 0});
  const Lamp lamp{{-300, 120, 400}, {20, -10, 0}, 6.0, 120.0};
  const CameraModel camera = small_camera(24, 16, 8.0);
  const auto pose = look_at({150, -250, 360}, {10, 20, 0});
  const auto sharp = render({{&slab, white()}}, camera, pose, lamp, {1, 1, 1.0, 1});
  const auto many = render({{&slab, white()}}, camera, pose, lamp, {16, 4, 1.0, 9});
  ASSERT_THAT(sharp, Succeeds());
  ASSERT_THAT(many, Succeeds());
  double a = 0, b = 0;
  for (std::size_t i = 0; i < sharp->bands[0].cells().size(); ++i)
    a += sharp->bands[0].cells()[i], b += many->bands[0].cells()[i];
  EXPECT_NEAR(b / a, 1.0, 1e-3);  // the promised 0.1 %
}

TEST(Render, CutsTheBeamToACone) {
  const TriMesh slab = box_solid({-500, -500, -10}, {500, 500, 0});
  const Lamp lamp{{0, 0, 300}, {0, 0, 0}, 0.0, 56.0};
  const CameraModel camera = small_camera(101, 101, 10.0);
  const auto pose = look_at({0, 0, 400}, {0, 0, 0});
  const auto image = render({{&slab, white()}}, camera, pose, lamp, {1});
  ASSERT_THAT(image, Succeeds());
  const double radius = 300 * std::tan(28 * kPi / 180);
  for (std::ptrdiff_t r = 0; r < 101; ++r)
    for (std::ptrdiff_t c = 0; c < 101; ++c) {
      const Vec3 way = pixel_way(camera, pose, r, c);
      const Vec3 p = pose.translation_mm + (-400 / way.z) * way;
      const double d = std::hypot(p.x, p.y);
      if (std::abs(d - radius) < 1e-3) continue;
      EXPECT_EQ(image->bands[0](r, c) > 0, d < radius) << d;
      EXPECT_EQ(image->lit(r, c), d < radius ? 1 : 0);
    }
}

TEST(Render, HasNoAcneOnAFlatFineMesh) {
  // Flat but tilted, 0.5 mm triangles, 2 m from the frame's origin, lamp 1.5 degrees
  // above the plane: float steps of the coordinates must not shade it.
  TriMesh plate = terrain_solid(401, 0.5, -60,
                                [](double x, double y) { return 0.1 * x - 0.07 * y + 1.0 / 3.0; });
  const Vec3 shift{2011.3, -1777.7, 333.1};
  for (Vec3& v : plate.vertices_mm) v += shift;
  const Vec3 normal = normalized(Vec3{-0.1, 0.07, 1});
  const Vec3 middle = shift + Vec3{100, 100, 0.1 * 100 - 0.07 * 100 + 1.0 / 3.0};
  const Vec3 along = normalized(cross(Vec3{0.3, 1, 0}, normal));
  const double low = 1.5 * kPi / 180;
  const Lamp lamp{middle + 3000 * (std::cos(low) * along + std::sin(low) * normal), middle, 0, 56};
  const auto image = render({{&plate, white()}}, small_camera(160, 120, 30.0),
                            look_at(middle + Vec3{30, -200, 250}, middle), lamp, {4});
  ASSERT_THAT(image, Succeeds());
  for (std::ptrdiff_t r = 0; r < 120; ++r)
    for (std::ptrdiff_t c = 0; c < 160; ++c) {
      if (std::isinf(image->depth_mm(r, c))) continue;
      ASSERT_EQ(image->lit(r, c), 1) << r << ' ' << c;
    }
  EXPECT_FALSE(std::isinf(image->depth_mm(60, 80)));
}

TEST(Render, PutsTheTerminatorWhereNormalAndLightAreSquare) {
  constexpr std::uint32_t kBands = 400;
  const TriMesh ball = sphere_solid({5, -3, 40}, 50, kBands);
  const Lamp lamp{{-2000, 300, 700}, {5, -3, 40}, 0, 56};
  const CameraModel camera = small_camera(120, 120, 40.0);
  const auto pose = look_at({5, -400, 90}, {5, -3, 40});
  const auto image = render({{&ball, white()}}, camera, pose, lamp, {1});
  ASSERT_THAT(image, Succeeds());
  int lit = 0, dark = 0;
  for (std::ptrdiff_t r = 0; r < 120; ++r)
    for (std::ptrdiff_t c = 0; c < 120; ++c) {
      if (std::isinf(image->depth_mm(r, c))) continue;
      const Vec3 p = pose.translation_mm +
                     static_cast<double>(image->depth_mm(r, c)) * pixel_way(camera, pose, r, c);
      const Vec3 n = normalized(p - Vec3{5, -3, 40});
      const double facing = dot(n, normalized(lamp.position_mm - p));
      // A facet's normal is off by up to its angle (times root 2 for its diagonal),
      // and the next facet may shade it by as much.
      if (std::abs(facing) < 2 * std::numbers::sqrt2 * kPi / kBands) continue;
      EXPECT_EQ(image->lit(r, c), facing > 0 ? 1 : 0) << facing;
      ++(facing > 0 ? lit : dark);
    }
  EXPECT_GT(lit, 1000);
  EXPECT_GT(dark, 1000);
}

TEST(Render, HasThePenumbraOfADiscBehindAStraightEdge) {
  const TriMesh slab = box_solid({-500, -500, -10}, {500, 500, 0});
  constexpr double kEdge = 100, kHeight = 1000, kRadius = 40;
  const TriMesh screen = box_solid({-400, -400, kEdge}, {0, 400, kEdge + 1e-3});
  const Lamp lamp{{0, 0, kHeight}, {0, 0, 0}, 2 * kRadius, 90};
  const CameraModel camera = small_camera(96, 8, 400.0);
  const auto pose = look_at({300, 0, 60}, {0, 0, 0}, {0, 1, 0});
  const auto image =
      render({{&slab, white()}, {&screen, white()}}, camera, pose, lamp, {1, 1024, 1.0, 3});
  ASSERT_THAT(image, Succeeds());
  int partial = 0;
  for (std::ptrdiff_t r = 0; r < 8; ++r)
    for (std::ptrdiff_t c = 0; c < 96; ++c) {
      const Vec3 way = pixel_way(camera, pose, r, c);
      const Vec3 p = pose.translation_mm + (-60 / way.z) * way;
      // The edge, seen from p, cuts the lens at this x; light comes from beyond it.
      const double cut = std::clamp(p.x * (1 - kHeight / kEdge) / kRadius, -1.0, 1.0);
      const double share = 0.5 - (std::asin(cut) + cut * std::sqrt(1 - cut * cut)) / kPi;
      const double d2 = p.x * p.x + p.y * p.y + kHeight * kHeight;
      const double full = kHeight / std::sqrt(d2) * kHeight * kHeight / d2;
      // 1024 points in 32 x 32 cells: only those along the cut are uncertain, some 40
      // of them, standard error sqrt(40) / 2 / 1024 = 0.003; distance and angle change
      // over the lens by (40/1000)^2 = 0.002. Five standard errors and that.
      EXPECT_NEAR(image->bands[0](r, c) / full, share, 0.017) << p.x;
      if (std::abs(cut) < 0.9) ++partial;
    }
  EXPECT_GT(partial, 100);
}

TEST(LookAt, PointsTheCameraAtItsTarget) {
  for (std::uint64_t seed = 1; seed <= 30; ++seed) {
    const auto u = [&](std::uint64_t i) { return 2 * random_uniform(seed, i) - 1; };
    const Vec3 at{u(0), u(1), u(2)}, to{u(3), u(4), u(5)};
    const auto pose = look_at(at, to);
    const Vec3 ahead = pose.direction({0, 0, -1}), right = pose.direction({1, 0, 0});
    EXPECT_NEAR(norm(ahead - normalized(to - at)), 0, 1e-14);
    EXPECT_NEAR(right.z, 0, 1e-14);             // level
    EXPECT_GT(pose.direction({0, 1, 0}).z, 0);  // up is up
    EXPECT_NEAR(norm(right), 1, 1e-14);
    EXPECT_EQ(pose.translation_mm, at);
  }
  // straight down: north is up, east is right
  const auto down = look_at({1, 2, 3}, {1, 2, 0});
  EXPECT_NEAR(norm(down.direction({0, 1, 0}) - Vec3{0, 1, 0}), 0, 1e-15);
  EXPECT_NEAR(norm(down.direction({1, 0, 0}) - Vec3{1, 0, 0}), 0, 1e-15);
}

TEST(Render, PutsNorthUpAndEastRight) {
  const TriMesh slab = box_solid({-100, -100, -10}, {100, 100, 0});
  const TriMesh marker = box_solid({19, 9, 0}, {21, 11, 5});
  const auto image = render({{&slab, {"dark", Lambert{grey(0.1)}}}, {&marker, white()}},
                            small_camera(80, 60, 10.0), look_at({0, 0, 105}, {0, 0, 0}),
                            {{0, 0, 1000}, {0, 0, 0}, 0, 56}, {1});
  ASSERT_THAT(image, Succeeds());
  // top of the marker 100 mm below: 1 mm is one pixel
  for (std::ptrdiff_t r = 0; r < 60; ++r)
    for (std::ptrdiff_t c = 0; c < 80; ++c)
      EXPECT_EQ(image->bands[0](r, c) > 0.5F, (c == 59 || c == 60) && (r == 19 || r == 20))
          << r << ' ' << c;
}

// ---- random terrain ---------------------------------------------------------

struct SlowHit {
  double t = INFINITY;
  std::size_t triangle = 0;
  double margin = INFINITY;  ///< how near the ray passes an edge of what it hits or just misses
};

/// Moeller and Trumbore over every triangle in double.
SlowHit slow_hit(const TriMesh& mesh, Vec3 o, Vec3 d, double nearest = 1e-9) {
  SlowHit hit;
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    const auto& tri = mesh.triangles[i];
    const Vec3 a = mesh.vertices_mm[tri[0]];
    const Vec3 e1 = mesh.vertices_mm[tri[1]] - a, e2 = mesh.vertices_mm[tri[2]] - a;
    const Vec3 h = cross(d, e2);
    const double det = dot(e1, h);
    if (det == 0) continue;
    const Vec3 s = o - a;
    const double u = dot(s, h) / det;
    const Vec3 q = cross(s, e1);
    const double v = dot(d, q) / det, t = dot(e2, q) / det;
    if (t <= nearest) continue;
    const double inside = std::min({u, v, 1 - u - v});
    if (inside > -1e-3) hit.margin = std::min(hit.margin, std::abs(inside));
    if (inside >= 0 && t < hit.t) hit.t = t, hit.triangle = i;
  }
  return hit;
}

class RenderHills : public testing::TestWithParam<std::uint64_t> {
 protected:
  const Hills hills{GetParam(), 100, 9};
  const TriMesh ground = terrain_solid(24, 100.0 / 23, -40, hills);
  const CameraModel camera = small_camera(40, 30, 4.0);
  const RigidTransform pose = look_at({40, -60, 75}, {50, 50, 0});
  const Lamp lamp{{-150, 20, 70}, {50, 50, 0}, 0, 90};
};

TEST_P(RenderHills, AgreesWithBruteForce) {
  const auto image = render({{&ground, white()}}, camera, pose, lamp, {1});
  ASSERT_THAT(image, Succeeds());
  int compared = 0;
  for (std::ptrdiff_t r = 0; r < 30; ++r)
    for (std::ptrdiff_t c = 0; c < 40; ++c) {
      const Vec3 way = pixel_way(camera, pose, r, c);
      const SlowHit hit = slow_hit(ground, pose.translation_mm, way);
      // A ray within a thousandth of a triangle of some edge may go either way at a
      // silhouette; everything else is certain.
      if (std::isinf(hit.t)) {
        if (hit.margin > 1e-3) {
          EXPECT_TRUE(std::isinf(image->depth_mm(r, c)));
        }
        continue;
      }
      if (hit.margin > 1e-5) {
        ASSERT_NEAR(image->depth_mm(r, c), hit.t, 1e-3) << r << ' ' << c;
      }
      const Vec3 p = pose.translation_mm + hit.t * way;
      const auto& tri = ground.triangles[hit.triangle];
      const Vec3 a = ground.vertices_mm[tri[0]];
      const Vec3 n =
          normalized(cross(ground.vertices_mm[tri[1]] - a, ground.vertices_mm[tri[2]] - a));
      const Vec3 l = lamp.position_mm - p;
      const double mu0 = dot(n, l) / norm(l);
      if (std::abs(mu0) < 1e-3) continue;
      const SlowHit shade = slow_hit(ground, p + 1e-6 * n, (1 / norm(l)) * l);
      if (shade.margin < 1e-3 || hit.margin < 1e-3) continue;
      const bool lit = mu0 > 0 && !(shade.t < norm(l));
      ASSERT_EQ(image->lit(r, c), lit ? 1 : 0) << r << ' ' << c << " mu0 " << mu0;
      ASSERT_EQ(image->bands[0](r, c) > 0, lit);
      ++compared;
    }
  EXPECT_GT(compared, 500);
}

TEST_P(RenderHills, IsTheSameFarFromTheOrigin) {
  const Vec3 shift{200'000.0, -150'000.0, 30'000.0};
  TriMesh far = ground;
  for (Vec3& v : far.vertices_mm) v += shift;
  Lamp far_lamp = lamp;
  far_lamp.position_mm += shift;
  far_lamp.target_mm += shift;
  RigidTransform far_pose = pose;
  far_pose.translation_mm += shift;
  const auto here = render({{&ground, white()}}, camera, pose, lamp, {1});
  const auto there = render({{&far, white()}}, camera, far_pose, far_lamp, {1});
  ASSERT_THAT(here, Succeeds());
  ASSERT_THAT(there, Succeeds());
  int different = 0;
  for (std::size_t i = 0; i < here->bands[0].cells().size(); ++i) {
    if (here->lit.cells()[i] != there->lit.cells()[i]) {
      ++different;
      continue;
    }
    EXPECT_NEAR(here->bands[0].cells()[i], there->bands[0].cells()[i], 1e-5);
    if (std::isfinite(here->depth_mm.cells()[i])) {
      EXPECT_NEAR(here->depth_mm.cells()[i], there->depth_mm.cells()[i], 1e-4);
    }
  }
  EXPECT_LE(different, 1);  // a ray along a shadow's border
}

TEST_P(RenderHills, SaysOfEachLampWhereItsLightArrives) {
  Lamp first = lamp, second = lamp;
  second.position_mm = {lamp.target_mm.x + 150.0, lamp.target_mm.y - 200.0, 120.0};
  const auto scene = PreparedScene::build({{&ground, white()}});
  ASSERT_THAT(scene, Succeeds());
  for (const double lens : {0.0, 5.0}) {
    first.lens_diameter_mm = second.lens_diameter_mm = lens;
    const auto lit = [&](const std::vector<Lamp>& lamps) {
      return scene->render(camera, pose, {lamps, {}, {}}, {1})->lit;
    };
    const auto a = lit({first}), b = lit({second}), both = lit({first, second});
    std::array<int, 4> seen{};
    for (std::size_t i = 0; i < both.cells().size(); ++i) {
      EXPECT_EQ(both.cells()[i], a.cells()[i] + 2 * b.cells()[i]);
      ++seen.at(both.cells()[i]);
    }
    EXPECT_GT(seen[1] + seen[2], 20) << "nothing is lit by one alone";
    EXPECT_GT(seen[3], 20);
  }
}

TEST_P(RenderHills, GivesTheSameBitsForAnyNumberOfThreads) {
  // Straight down on the nodes: pixel centres meet mesh vertices exactly, where six
  // triangles are equally near.
  const TriMesh flat = terrain_solid(25, 4, -40, [](double, double) { return 0.0; });
  const TriMesh step = box_solid({20, 20, -5}, {40, 60, 0});  // its top lies in the plane
  Lamp soft = lamp;
  soft.lens_diameter_mm = 20;
  const auto down = look_at({48, 48, 100}, {48, 48, 0});
  std::vector<Image> flats, terrains;
  for (const std::size_t threads : {1U, 2U, 3U, 8U}) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    auto a = render({{&flat, white()}, {&step, {"dark", Lambert{grey(0.1)}}}},
                    small_camera(25, 25, 2.5), down, soft, {4, 4, 1.0, GetParam()});
    auto b = render({{&ground, white()}}, camera, pose, soft, {4, 4, 1.0, GetParam()});
    ASSERT_THAT(a, Succeeds());
    ASSERT_THAT(b, Succeeds());
    flats.push_back(*std::move(a));
    terrains.push_back(*std::move(b));
  }
  for (const auto* images : {&flats, &terrains})
    for (const Image& image : *images) {
      EXPECT_EQ(image.bands, images->front().bands);
      EXPECT_EQ(image.depth_mm, images->front().depth_mm);
      EXPECT_EQ(image.lit, images->front().lit);
    }
  const auto other = render({{&ground, white()}}, camera, pose, soft, {4, 4, 1.0, 77});
  ASSERT_THAT(other, Succeeds());
  EXPECT_NE(other->bands, terrains.front().bands) << "the seed does nothing";
}
INSTANTIATE_TEST_SUITE_P(Seeds, RenderHills, testing::Values(1, 2, 3, 4));

TEST(RayScene, GivesTheLowestNumberOfEquallyNearTriangles) {
  const TriMesh flat = terrain_solid(9, 4, -40, [](double, double) { return 0.0; });
  TriMesh backwards = flat;
  std::reverse(backwards.triangles.begin(), backwards.triangles.end());
  const auto scene = RayScene::build({{&flat}, {&backwards}});
  ASSERT_THAT(scene, Succeeds());
  // On the diagonal of cell (3, 3): two triangles of each mesh.
  const auto hit = scene->first_hit({14, 14, 50}, {0, 0, -1});
  ASSERT_TRUE(hit);
  EXPECT_EQ(hit->object, 0U);
  EXPECT_EQ(hit->triangle, 2U * (3 * 8 + 3));
  EXPECT_DOUBLE_EQ(hit->distance_mm, 50.0);
  EXPECT_TRUE(hit->front);
  const auto only_backwards = RayScene::build({{&backwards}});
  ASSERT_THAT(only_backwards, Succeeds());
  const auto last = only_backwards->first_hit({14, 14, 50}, {0, 0, -1});
  ASSERT_TRUE(last);
  EXPECT_EQ(last->triangle, flat.triangles.size() - 1 - (2 * (3 * 8 + 3) + 1));
}

TEST(RayScene, GivesTheLowestOfManyCoincidentTriangles) {
  // More than fit one leaf of the tree, all alike: only the number tells them apart.
  TriMesh pile = box_solid({-1, -1, -1}, {1, 1, 0});
  pile.triangles.assign(5000, pile.triangles[2]);
  const auto scene = RayScene::build({{&pile}, {&pile}});
  ASSERT_THAT(scene, Succeeds());
  const auto hit = scene->first_hit({0.3, -0.2, 5}, {0, 0, -1});
  ASSERT_TRUE(hit);
  EXPECT_EQ(hit->object, 0U);
  EXPECT_EQ(hit->triangle, 0U);
}

TEST(RayScene, KnowsInsideFromOutside) {
  const TriMesh ball = sphere_solid({10, 20, 30}, 5, 40);
  const auto scene = RayScene::build({{&ball}});
  ASSERT_THAT(scene, Succeeds());
  for (std::uint64_t i = 0; i < 500; ++i) {
    const auto u = [i](std::uint64_t k) { return 14 * random_uniform(3, 3 * i + k) - 7; };
    const Vec3 from_centre{u(0), u(1), u(2)};
    const double r = norm(from_centre);
    if (std::abs(r - 5) < 0.05) continue;  // facets lie up to 5 (1 - cos(pi/80)) inside
    EXPECT_EQ(scene->inside(Vec3{10, 20, 30} + from_centre), r < 5) << r;
  }
}

}  // namespace
}  // namespace maquette::camera
