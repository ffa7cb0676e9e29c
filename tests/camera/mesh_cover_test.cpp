// SPDX-License-Identifier: GPL-3.0-or-later

// camera/mesh_cover.hpp:
//   a picture ............... linear between pixels' centres by hand; repeated, ended and mirrored
//                             against pictures that are as large as what is asked for
//   a place in it ........... on planes that map linearly: the map itself
//   rendered ................ a covered square in two poses and sizes is the square with an albedo
//                             map; materials by triangle are those of two meshes
//   bad input ............... one error that says what

#include "camera/mesh_cover.hpp"

#include <cmath>
#include <random>

#include <gtest/gtest.h>

#include "camera/render.hpp"
#include "support/matchers.hpp"

namespace maquette::camera {
namespace {

using testing_support::FailsSaying;
using testing_support::Succeeds;
using Beyond = MeshPicture::Beyond;

std::array<Grid<float>, 3> random_factors(std::ptrdiff_t rows, std::ptrdiff_t cols) {
  std::mt19937 random(7);
  std::uniform_real_distribution<float> any(0.1F, 1.0F);
  std::array<Grid<float>, 3> factor;
  for (auto& f : factor) {
    f = Grid<float>(rows, cols);
    for (float& v : f.cells()) v = any(random);
  }
  return factor;
}

TEST(MeshPicture, IsLinearBetweenPixelCentres) {
  MeshPicture picture;
  for (auto& f : picture.factor) f = Grid<float>(2, 2);
  picture.factor[1](0, 0) = 1.0F;
  picture.factor[1](0, 1) = 2.0F;
  picture.factor[1](1, 0) = 4.0F;
  picture.factor[1](1, 1) = 8.0F;
  EXPECT_DOUBLE_EQ(picture.at(0.25, 0.25)[1], 1.0);
  EXPECT_DOUBLE_EQ(picture.at(0.75, 0.25)[1], 2.0);
  EXPECT_DOUBLE_EQ(picture.at(0.25, 0.75)[1], 4.0);
  EXPECT_DOUBLE_EQ(picture.at(0.5, 0.5)[1], 3.75);
  EXPECT_DOUBLE_EQ(picture.at(0.625, 0.25)[1], 1.75);
  EXPECT_DOUBLE_EQ(picture.at(0.5, 0.5)[0], 0.0);
}

TEST(MeshPicture, RepeatsEndsOrIsMirroredBeyondItsEdges) {
  constexpr std::ptrdiff_t kRows = 3, kCols = 4;
  for (const Beyond beyond : {Beyond::repeats, Beyond::edge, Beyond::mirrored}) {
    const MeshPicture picture{random_factors(kRows, kCols), {beyond, beyond}};
    // The same five times over in both directions, written out.
    const auto source = [&](std::ptrdiff_t i, std::ptrdiff_t n) {
      const std::ptrdiff_t tile = i / n - 2, in = i % n;  // tile 0 is the picture itself
      if (beyond == Beyond::edge) return tile < 0 ? 0 : tile > 0 ? n - 1 : in;
      return beyond == Beyond::mirrored && tile % 2 != 0 ? n - 1 - in : in;
    };
    MeshPicture large;
    for (std::size_t b = 0; b < 3; ++b) {
      large.factor[b] = Grid<float>(5 * kRows, 5 * kCols);
      for (std::ptrdiff_t r = 0; r < 5 * kRows; ++r)
        for (std::ptrdiff_t c = 0; c < 5 * kCols; ++c)
          large.factor[b](r, c) = picture.factor[b](source(r, kRows), source(c, kCols));
    }
    for (double u = -1.8; u < 2.8; u += 0.13)
      for (double v = -1.8; v < 2.8; v += 0.17) {
        const Bands a = picture.at(u, v), b = large.at((u + 2.0) / 5.0, (v + 2.0) / 5.0);
        for (std::size_t k = 0; k < 3; ++k) EXPECT_NEAR(a[k], b[k], 1e-9) << u << ' ' << v;
      }
  }
}

/// A square of 40 mm about the origin, its picture upright as seen from above.
TriMesh square() {
  return {{{-20, -20, 0}, {20, -20, 0}, {20, 20, 0}, {-20, 20, 0}}, {{0, 1, 2}, {0, 2, 3}}};
}
MeshCover cover_of_square(Material material, std::shared_ptr<const MeshPicture> picture) {
  return {{std::move(material)},
          {std::move(picture)},
          {0, 0},
          {{{{0, 1}, {1, 1}, {1, 0}}}, {{{0, 1}, {1, 0}, {0, 0}}}}};
}

TEST(MeshCover, PlacesAreLinearOverTriangles) {
  // A triangle in space whose picture lies as x + 2 y - z, 3 x - y.
  const auto u = [](Vec3 p) { return p.x + 2.0 * p.y - p.z; };
  const auto v = [](Vec3 p) { return 3.0 * p.x - p.y; };
  const TriMesh mesh{{{1, 2, 3}, {4, -1, 2}, {0, 3, 5}}, {{0, 1, 2}}};
  MeshCover cover;
  cover.at_corner.resize(1);
  for (std::size_t k = 0; k < 3; ++k)
    cover.at_corner[0][k] = {static_cast<float>(u(mesh.vertices_mm[k])),
                             static_cast<float>(v(mesh.vertices_mm[k]))};
  for (const auto& w : {Vec3{1, 0, 0}, Vec3{0.2, 0.3, 0.5}, Vec3{0.6, 0.1, 0.3}}) {
    const Vec3 p =
        w.x * mesh.vertices_mm[0] + w.y * mesh.vertices_mm[1] + w.z * mesh.vertices_mm[2];
    const auto at = place_in_picture(cover, mesh, 0, p);
    EXPECT_NEAR(at[0], u(p), 1e-12);
    EXPECT_NEAR(at[1], v(p), 1e-12);
  }
}

// An albedo map lies on the model frame from above, by code of its own: the two pictures are one.
TEST(MeshCover, ACoveredSquareIsTheOneWithAnAlbedoMap) {
  const TriMesh mesh = square();
  const auto factor = random_factors(8, 8);
  auto picture = std::make_shared<MeshPicture>();
  picture->factor = factor;
  picture->beyond = {Beyond::edge, Beyond::edge};
  const Material paint{"paint", OrenNayar{{0.8, 0.8, 0.8}, 20.0}, {}};
  const auto cover = std::make_shared<MeshCover>(cover_of_square(paint, picture));
  const CameraModel camera{48, 36, 100.0, 10.0};
  const Lamp lamp{{-200, 100, 300}, {0, 0, 0}, 0.0, 90.0};
  for (const double scale : {1.0, 1.75}) {
    const Vec3 at{3.0, -2.0, 5.0};
    SceneObject covered{&mesh, Material{}, {Quaternion{}, at}};
    covered.scale = scale;
    covered.cover = cover;
    auto map = std::make_shared<AlbedoMap>();
    map->min_x_mm = at.x - 20.0 * scale, map->max_x_mm = at.x + 20.0 * scale;
    map->min_y_mm = at.y - 20.0 * scale, map->max_y_mm = at.y + 20.0 * scale;
    for (std::size_t b = 0; b < 3; ++b) {
      map->factor[b] = Grid<float>(8, 8);
      for (std::ptrdiff_t r = 0; r < 8; ++r)
        for (std::ptrdiff_t c = 0; c < 8; ++c) map->factor[b](r, c) = factor[b](7 - r, c);
    }
    SceneObject mapped = covered;
    mapped.cover = nullptr;
    mapped.material = paint;
    mapped.material.map = map;
    const auto pose = look_at({30, -40, 100}, {0, 0, 0});
    const auto a = render({covered}, camera, pose, lamp), b = render({mapped}, camera, pose, lamp);
    ASSERT_THAT(a, Succeeds());
    ASSERT_THAT(b, Succeeds());
    ASSERT_EQ(a->bands.size(), 3U);
    double largest = 0.0;
    for (std::size_t k = 0; k < 3; ++k)
      for (std::size_t i = 0; i < a->bands[k].cells().size(); ++i) {
        EXPECT_NEAR(a->bands[k].cells()[i], b->bands[k].cells()[i], 1e-6F);
        largest = std::fmax(largest, static_cast<double>(b->bands[k].cells()[i]));
      }
    EXPECT_GT(largest, 0.1);
  }
}

TEST(MeshCover, MaterialsByTriangleAreThoseOfTwoMeshes) {
  const TriMesh whole = square();
  TriMesh first = whole, second = whole;
  first.triangles.pop_back();
  second.triangles.erase(second.triangles.begin());
  const Material dark{"dark", Lambert{{0.1, 0.1, 0.1}}, {}};
  const Material foil{"foil", Ggx{{1.35, 0.97, 0.62}, {7.5, 6.4, 5.3}, {1, 1, 1}, 0.3}, {}};
  auto cover = std::make_shared<MeshCover>(cover_of_square(dark, nullptr));
  cover->materials.push_back(foil);
  cover->pictures.push_back(nullptr);
  cover->material_of[1] = 1;
  SceneObject covered{&whole, Material{}};
  covered.cover = cover;
  const CameraModel camera{48, 36, 100.0, 10.0};
  const Lamp lamp{{-100, 100, 300}, {0, 0, 0}, 0.0, 90.0};
  Lighting lighting{{lamp}, {0.2, 0.1, 0.1}, {}};  // what foil gathers by its facets
  const auto pose = look_at({30, -40, 100}, {0, 0, 0});
  const auto picture_of = [&](const std::vector<SceneObject>& objects) {
    auto scene = PreparedScene::build(objects);
    EXPECT_THAT(scene, Succeeds());
    return scene->render(camera, pose, lighting);
  };
  const auto a = picture_of({covered}), b = picture_of({{&first, dark}, {&second, foil}});
  ASSERT_THAT(a, Succeeds());
  ASSERT_THAT(b, Succeeds());
  for (std::size_t k = 0; k < 3; ++k) EXPECT_EQ(a->bands[k], b->bands[k]);
}

TEST(MeshCover, SaysWhatIsWrong) {
  const TriMesh mesh = square();
  auto picture = std::make_shared<MeshPicture>();
  picture->factor = random_factors(2, 2);
  const MeshCover good = cover_of_square({}, picture);
  EXPECT_THAT(check_cover(good, mesh), Succeeds());
  MeshCover bad = good;
  bad.material_of.pop_back();
  EXPECT_THAT(check_cover(bad, mesh), FailsSaying(kMaterialOutOfRange, "a mesh of 2 triangles"));
  bad = good;
  bad.material_of[1] = 1;
  EXPECT_THAT(check_cover(bad, mesh),
              FailsSaying(kMaterialOutOfRange, "triangle 1: material 1 of 1"));
  bad = good;
  bad.at_corner[1][2][0] = NAN;
  EXPECT_THAT(check_cover(bad, mesh),
              FailsSaying(kMaterialOutOfRange, "triangle 1 of material material: it has"));
  bad = good;
  auto uneven = std::make_shared<MeshPicture>(*picture);
  uneven->factor[2] = Grid<float>(1, 2, 0.5F);
  bad.pictures[0] = uneven;
  EXPECT_THAT(check_cover(bad, mesh), FailsSaying(kMaterialOutOfRange, "bands of different sizes"));
  bad = good;
  bad.materials[0].law = Ggx{{1, 1, 1}, {0, 0, 0}, {1, 1, 1}, 7.0};
  EXPECT_THAT(check_cover(bad, mesh), FailsSaying(kMaterialOutOfRange, "material"));
}

}  // namespace
}  // namespace maquette::camera
