// SPDX-License-Identifier: GPL-3.0-or-later
// What meshing/solid.hpp claims of volume_solid, and how each claim is attacked:
//
//   closed, outward, 2-manifold, no degenerate or cutting triangles
//                              ... CGAL's certificate over seeds: terrain from level to
//                                  rough, one to five lumpy stones, touching or not
//   terrain is exact ......... certificate's error; nodes away from stones to the bit
//   it is the union .......... volume by closed form (half a ball on a plane); random
//                              points inside stones lie inside the solid (winding)
//   stones are where they are  vertices far above ground are on the stone's triangles
//   pockets are filled ....... a bowl upside down; an arch keeps its window (genus)
//   same for any threads ..... compared with ==
//   every documented error ... one case per code and cause

#include "meshing/solid.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <oneapi/tbb/global_control.h>
#include <oneapi/tbb/task_arena.h>

#include "meshing/mesh_checks.hpp"
#include "support/matchers.hpp"
#include "support/shapes.hpp"

namespace maquette::meshing {
namespace {

using heightmap::ModelField;
using testing_support::FailsWith;
using testing_support::random_rock;
using testing_support::random_terrain;
using testing_support::Succeeds;
using testing_support::unit_sphere;

constexpr SolidOptions kDeep{.base_z = Millimetres{-30}};

ModelField level(std::ptrdiff_t rows, std::ptrdiff_t cols, double spacing) {
  return {Grid<float>(rows, cols, 0.0F), Millimetres{spacing}, Millimetres{0}, Millimetres{0}};
}

TriMesh ball(Vec3 centre, double radius, int subdivisions = 5) {
  TriMesh m = unit_sphere(subdivisions);
  for (Vec3& v : m.vertices_mm) v = centre + radius * v;
  return m;
}

/// Winding number of a closed mesh round a point (van Oosterom and Strackee 1983).
double winding(const TriMesh& m, Vec3 p) {
  double angle = 0.0;
  for (const auto& t : m.triangles) {
    const Vec3 a = m.vertices_mm[t[0]] - p, b = m.vertices_mm[t[1]] - p,
               c = m.vertices_mm[t[2]] - p;
    angle +=
        2.0 * std::atan2(dot(a, cross(b, c)), norm(a) * norm(b) * norm(c) + dot(a, b) * norm(c) +
                                                  dot(b, c) * norm(a) + dot(c, a) * norm(b));
  }
  return angle / (4.0 * std::numbers::pi);
}

TEST(VolumeSolid, WithoutStonesIsTheGridSolid) {
  const ModelField field = random_terrain(5, 30, 40, 0.5, 0.2, 0.05);
  const auto grid = grid_solid(field, kDeep);
  const auto volume = volume_solid(field, {}, kDeep);
  ASSERT_THAT(grid, Succeeds());
  ASSERT_THAT(volume, Succeeds());
  EXPECT_TRUE(grid->vertices_mm == volume->vertices_mm);
  EXPECT_TRUE(grid->triangles == volume->triangles);
}

TEST(VolumeSolid, ABuriedStoneChangesNothing) {
  const ModelField field = level(81, 81, 0.5);
  const std::vector<TriMesh> stones{ball({20, 20, -10}, 4)};
  const auto solid = volume_solid(field, stones, kDeep);
  ASSERT_THAT(solid, Succeeds());
  EXPECT_TRUE(solid->vertices_mm == grid_solid(field, kDeep)->vertices_mm);
}

TEST(VolumeSolid, HalfABallOnAPlaneHasItsVolume) {
  const ModelField field = level(121, 121, 0.5);
  const std::vector<TriMesh> stones{ball({30.1, 29.7, 0.03}, 10)};
  double before = 1e300;
  for (const double voxel : {1.0, 0.5, 0.25}) {
    SolidOptions options = kDeep;
    options.voxel = Millimetres{voxel};
    const auto solid = volume_solid(field, stones, options);
    ASSERT_THAT(solid, Succeeds());
    const auto c = check_mesh(*solid, &field);
    ASSERT_THAT(c, Succeeds());
    EXPECT_TRUE(c->passed()) << to_json(*c);
    EXPECT_EQ(c->euler_number, 2);
    const double cap = 2.0 / 3.0 * std::numbers::pi * 1000.0 + std::numbers::pi * 100.0 * 0.03;
    // The fillet adds about 0.2 (1.5 voxel)^2 along the crevice of 63 mm, chords of the
    // stone take away 2 pi R^2 voxel^2 / (6 R): both quadratic in the voxel.
    const double off = std::abs(c->volume_mm3 - 60.0 * 60.0 * 30.0 - cap);
    EXPECT_LT(off, 60.0 * voxel * voxel);
    EXPECT_LT(off, before);
    before = off;
  }
}

TEST(VolumeSolid, StoneVerticesLieOnTheStone) {
  const ModelField field = level(81, 81, 0.5);
  const std::vector<TriMesh> stones{ball({20.2, 19.9, 1.0}, 6)};
  const auto solid = volume_solid(field, stones, kDeep);
  ASSERT_THAT(solid, Succeeds());
  int on_stone = 0;
  for (const Vec3& v : solid->vertices_mm) {
    if (v.z < 1.5) continue;
    ++on_stone;
    // Facets of edge 0.27 mm at most fall short by edge^2 / (6 R) = 2.0e-3 mm.
    EXPECT_NEAR(norm(v - Vec3{20.2, 19.9, 1.0}), 6.0, 2.0e-3);
  }
  EXPECT_GT(on_stone, 500);
}

TEST(VolumeSolid, FillsNoMoreThanTheStones) {
  const ModelField field = random_terrain(3, 81, 81, 0.5, 0.1);
  const double z = heightmap::height_at(field, 20, 20);
  const std::vector<TriMesh> stones{random_rock(3, {20, 20, z + 1.0}, 6, 3)};
  const auto solid = volume_solid(field, stones, kDeep);
  ASSERT_THAT(solid, Succeeds());
  for (std::uint64_t i = 0; i < 300; ++i) {
    const Vec3 p{12 + 16 * random_uniform(9, 3 * i), 12 + 16 * random_uniform(9, 3 * i + 1),
                 z - 4 + 12 * random_uniform(9, 3 * i + 2)};
    // A shell of a voxel round either surface is left out: fillet and chords.
    bool near = std::abs(p.z - heightmap::height_at(field, p.x, p.y)) < 0.75;
    for (const Vec3& v : stones[0].vertices_mm) near = near || norm(v - p) < 0.9;
    if (near) continue;
    const bool expected =
        p.z < heightmap::height_at(field, p.x, p.y) || winding(stones[0], p) > 0.5;
    EXPECT_NEAR(winding(*solid, p), expected ? 1.0 : 0.0, 1e-6) << p.x << " " << p.y << " " << p.z;
  }
}

/// Turns a closed profile (radius, height; counter-clockwise) about a vertical axis.
TriMesh turned(const std::vector<std::array<double, 2>>& profile, Vec3 axis) {
  constexpr std::uint32_t kSteps = 96;
  const auto n = static_cast<std::uint32_t>(profile.size());
  TriMesh m;
  for (std::uint32_t i = 0; i < kSteps; ++i)
    for (std::uint32_t j = 0; j < n; ++j) {
      const double u = 2 * std::numbers::pi * i / kSteps;
      m.vertices_mm.push_back(
          axis + Vec3{profile[j][0] * std::cos(u), profile[j][0] * std::sin(u), profile[j][1]});
      const std::uint32_t a = i * n + j, b = (i + 1) % kSteps * n + j;
      const std::uint32_t c = (i + 1) % kSteps * n + (j + 1) % n, d = i * n + (j + 1) % n;
      m.triangles.push_back({a, b, c});
      m.triangles.push_back({a, c, d});
    }
  return m;
}

TEST(VolumeSolid, FillsAPocketUnderAStone) {
  // A bowl upside down, with a hole of 0.02 mm at the crown that no voxel sees.
  std::vector<std::array<double, 2>> profile;
  for (int i = 0; i <= 30; ++i) {
    const double t = 0.999 * 0.5 * std::numbers::pi * i / 30;
    profile.push_back({8 * std::cos(t), 8 * std::sin(t) - 1.0});
  }
  for (int i = 30; i >= 0; --i) {
    const double t = 0.999 * 0.5 * std::numbers::pi * i / 30;
    profile.push_back({5 * std::cos(t), 5 * std::sin(t) - 1.0});
  }
  const std::vector<TriMesh> stones{turned(profile, {20, 20, 0})};
  const ModelField field = level(81, 81, 0.5);
  const auto solid = volume_solid(field, stones, kDeep);
  ASSERT_THAT(solid, Succeeds());
  const auto c = check_mesh(*solid, &field);
  ASSERT_THAT(c, Succeeds());
  EXPECT_TRUE(c->passed()) << to_json(*c);
  EXPECT_EQ(c->shells, 1U);
  EXPECT_EQ(c->euler_number, 2);
  // Cap of height 7 of a ball of radius 8; fillet and chords as for the half ball.
  const double cap = std::numbers::pi * 49.0 * (8.0 - 7.0 / 3.0);
  EXPECT_NEAR(c->volume_mm3, 40.0 * 40.0 * 30.0 + cap, 15.0);
}

TEST(VolumeSolid, KeepsTheWindowOfAnArch) {
  std::vector<std::array<double, 2>> profile;
  for (int i = 0; i < 32; ++i) {
    const double t = 2 * std::numbers::pi * i / 32;
    profile.push_back({6 + 2 * std::cos(t), 2 * std::sin(t)});
  }
  std::vector<TriMesh> stones{turned(profile, {0, 0, 0})};
  for (Vec3& v : stones[0].vertices_mm) v = Vec3{20, 20, 0.3} + Vec3{v.x, -v.z, v.y};  // upright
  const ModelField field = random_terrain(4, 81, 81, 0.5, 0.05);
  const auto solid = volume_solid(field, stones, kDeep);
  ASSERT_THAT(solid, Succeeds());
  const auto c = check_mesh(*solid, &field);
  ASSERT_THAT(c, Succeeds());
  EXPECT_TRUE(c->passed()) << to_json(*c);
  EXPECT_EQ(c->shells, 1U);
  EXPECT_EQ(c->euler_number, 0) << "one handle";
}

TEST(VolumeSolid, SaysWhichStoneIsNoSolid) {
  const ModelField field = level(81, 81, 0.5);
  std::vector<TriMesh> stones{ball({10, 10, 0}, 3), ball({30, 30, 0}, 3)};
  TriMesh whole = stones[1];
  stones[1].triangles.pop_back();
  const auto open = volume_solid(field, stones, kDeep);
  ASSERT_THAT(open, FailsWith(kNotASolid));
  EXPECT_THAT(open.error().message, testing::HasSubstr("stone 2 of 2"));
  stones[1] = whole;
  for (auto& t : stones[1].triangles) std::swap(t[0], t[1]);
  EXPECT_THAT(volume_solid(field, stones, kDeep), FailsWith(kNotASolid));
  stones[1] = ball({30, 30, 20}, 3);
  EXPECT_THAT(volume_solid(field, stones, kDeep), FailsWith(kNotASolid)) << "hangs in the air";
  stones[1] = ball({39, 30, 0}, 3);
  EXPECT_THAT(volume_solid(field, stones, kDeep), FailsWith(kNotASolid)) << "crosses the outline";
  stones[1] = TriMesh{};
  EXPECT_THAT(volume_solid(field, stones, kDeep), FailsWith(kNotASolid)) << "empty";
}

TEST(VolumeSolid, RefusesVoxelsThatDoNotFitAndNamesOneThatDoes) {
  const ModelField field = level(81, 81, 0.5);
  const std::vector<TriMesh> stones{ball({20, 20, 0}, 5)};
  SolidOptions options = kDeep;
  options.memory_limit_gib = 0.05;
  options.voxel = Millimetres{0.01};
  const auto refused = volume_solid(field, stones, options);
  ASSERT_THAT(refused, FailsWith(kVoxelTooSmall));
  const std::string& text = refused.error().message;
  const auto at = text.find("a voxel of", text.find("; "));
  ASSERT_NE(at, std::string::npos) << text;
  options.voxel = Millimetres{std::stod(text.substr(at + 10))};
  EXPECT_GT(options.voxel.value(), 0.01);
  EXPECT_THAT(volume_solid(field, stones, options), Succeeds());
}

TEST(VolumeSolid, ShareSomeErrorsWithTheGrid) {
  ModelField field = level(81, 81, 0.5);
  const std::vector<TriMesh> stones{ball({20, 20, 0}, 5)};
  EXPECT_THAT(volume_solid(field, stones, {.base_z = Millimetres{-0.5}}), FailsWith(kBaseTooThin));
  std::stop_source stop;
  stop.request_stop();
  RunContext run;
  run.stop = stop.get_token();
  EXPECT_THAT(volume_solid(field, stones, kDeep, run), FailsWith(kCancelled));
  field.z_mm(1, 1) = NAN;
  EXPECT_THAT(volume_solid(field, stones, kDeep), FailsWith(kSurfaceHasVoids));
}

class VolumeSolidOnTerrain : public testing::TestWithParam<std::uint64_t> {
 protected:
  VolumeSolidOnTerrain() {
    const std::uint64_t seed = GetParam();
    const std::uint64_t count = 1 + seed % 5;
    for (std::uint64_t i = 0; i < count; ++i) {
      const auto draw = [&](std::uint64_t n) { return random_uniform(seed + 77, 10 * i + n); };
      const double radius = 1.5 + 3.5 * draw(0);
      const double x = 12 + 26 * draw(1);
      const double y = 12 + 21 * draw(2);
      // From sunk to the crown to lying on the ground with a wedge of air all round.
      const double z = heightmap::height_at(field, x, y) + radius * (1.1 * draw(3) - 0.6);
      stones.push_back(random_rock(100 * seed + i, {x, y, z}, radius, 4));
    }
  }
  const double steepness = 0.02 + 0.03 * static_cast<double>(GetParam() % 6);
  const ModelField field =
      random_terrain(GetParam(), 91, 101, 0.5, steepness, GetParam() % 3 == 0 ? 0.05 : 0.0);
  std::vector<TriMesh> stones;
};

TEST_P(VolumeSolidOnTerrain, IsASoundSolidWithExactTerrain) {
  const auto solid = volume_solid(field, stones, kDeep);
  ASSERT_THAT(solid, Succeeds());
  const auto c = check_mesh(*solid, &field);
  ASSERT_THAT(c, Succeeds());
  EXPECT_TRUE(c->passed()) << to_json(*c);
  EXPECT_TRUE(c->self_intersection_checked);
  EXPECT_EQ(c->shells, 1U);
  // Vertices above the terrain are stones' or seam's; none is under it by more than the
  // seam's contouring: half a voxel at the steepest.
  EXPECT_LT(c->max_vertical_error_mm, 0.3) << to_json(*c);
  EXPECT_LT(c->rms_vertical_error_mm, 0.02) << to_json(*c);
  EXPECT_GT(c->vertices_above_surface, 20U);

  // To the nearest vertex of a stone, whose facets are smaller than 1 mm.
  std::vector<double> to_stone(solid->vertices_mm.size(), INFINITY);
  std::size_t exact = 0;
  for (std::size_t n = 0; n < to_stone.size(); ++n) {
    const Vec3 v = solid->vertices_mm[n];
    if (v.z == -30.0) continue;
    for (const TriMesh& s : stones)
      for (const Vec3& w : s.vertices_mm) to_stone[n] = std::fmin(to_stone[n], norm(w - v));
    if (to_stone[n] <= 2.0) continue;
    ++exact;
    ASSERT_NEAR(v.z, heightmap::height_at(field, v.x, v.y), 1e-12);
  }
  // Five voxels and two spacings off, triangles are the field's own.
  for (const auto& [i, j, k] : solid->triangles) {
    const Vec3 &p0 = solid->vertices_mm[i], &p1 = solid->vertices_mm[j],
               &p2 = solid->vertices_mm[k];
    if (std::fmin(p0.z, std::fmin(p1.z, p2.z)) == -30.0) continue;
    if (std::fmin(to_stone[i], std::fmin(to_stone[j], to_stone[k])) <= 3.5) continue;
    const Vec3 p = (1.0 / 3.0) * (p0 + p1 + p2);
    ASSERT_NEAR(p.z, heightmap::height_at(field, p.x, p.y), 1e-12);
  }
  EXPECT_GT(exact, 4000U);
}

class VolumeSolidInThreads : public VolumeSolidOnTerrain {};

TEST_P(VolumeSolidInThreads, IsTheSameForAnyNumberOfThreads) {
  // Four workers even where there are fewer cores.
  const tbb::global_control four(tbb::global_control::max_allowed_parallelism, 4);
  const auto with_threads = [this](int threads) {
    tbb::task_arena arena(threads);
    return arena.execute([this] { return volume_solid(field, stones, kDeep); });
  };
  const auto many = with_threads(4);
  const auto single = with_threads(1);
  ASSERT_THAT(many, Succeeds());
  ASSERT_THAT(single, Succeeds());
  EXPECT_TRUE(many->vertices_mm == single->vertices_mm);
  EXPECT_TRUE(many->triangles == single->triangles);
}

INSTANTIATE_TEST_SUITE_P(Seeds, VolumeSolidOnTerrain, testing::Range<std::uint64_t>(1, 25));
INSTANTIATE_TEST_SUITE_P(Seeds, VolumeSolidInThreads, testing::Values(6, 12, 18, 24));

}  // namespace
}  // namespace maquette::meshing
