// SPDX-License-Identifier: GPL-3.0-or-later

// What is claimed in cnc/mesh_cutter.hpp, triangle_tree.hpp and triangle_bound.hpp, and how each
// claim is attacked:
//
//   any mesh ..................... soups of triangles of any size and facing, needles, upright and
//                                  degenerate ones, closed bodies with overhangs: brute force over
//                                  all triangles
//   same as the grid's ........... a triangulated field through both
//   ground and stones ............ the mesh of both in one
//   positions on features ........ vertices, edges, the outline
//   history does not matter ...... same bits from a fresh cutter
//   memory ....................... bytes() a triangle
//
// Meshes come from a seed that is part of the test's name.

#include "cnc/mesh_cutter.hpp"

#include <array>
#include <bit>
#include <cmath>
#include <numbers>
#include <string>

#include <gtest/gtest.h>

#include "cnc/slow_contact.hpp"
#include "core/random.hpp"
#include "support/field_mesh.hpp"
#include "support/terrain.hpp"

namespace maquette::cnc {
namespace {

using heightmap::ModelField;
using testing_support::Ground;
using testing_support::mesh_of;

double slow_drop(const TriMesh& mesh, const Cutter& tool, double x, double y) {
  const Slow slow(tool);
  double best = -INFINITY;
  for (const auto& t : mesh.triangles)
    best = std::max(
        best, slow(mesh.vertices_mm[t[0]], mesh.vertices_mm[t[1]], mesh.vertices_mm[t[2]], x, y));
  return best;
}

/// Lumpy closed body about a centre, sunk so that it hangs over what lies beside it.
TriMesh stone(Vec3 centre, double radius, std::uint64_t seed) {
  constexpr std::uint32_t kRings = 7, kSides = 11;
  TriMesh mesh;
  const auto point = [&](double polar, double turn, std::uint64_t i) {
    const double r = radius * (0.8 + 0.4 * random_uniform(seed, i));
    return centre + Vec3{r * std::sin(polar) * std::cos(turn), r * std::sin(polar) * std::sin(turn),
                         0.7 * r * std::cos(polar)};
  };
  mesh.vertices_mm.push_back(point(0.0, 0.0, 0));
  for (std::uint32_t i = 1; i < kRings; ++i)
    for (std::uint32_t j = 0; j < kSides; ++j)
      mesh.vertices_mm.push_back(point(std::numbers::pi * i / kRings,
                                       2.0 * std::numbers::pi * (j + 0.3 * i) / kSides,
                                       i * kSides + j));
  mesh.vertices_mm.push_back(point(std::numbers::pi, 0.0, 1));
  const auto at = [&](std::uint32_t i, std::uint32_t j) {
    return i == 0        ? 0U
           : i == kRings ? 1U + (kRings - 1) * kSides
                         : 1U + (i - 1) * kSides + j % kSides;
  };
  for (std::uint32_t i = 0; i < kRings; ++i)
    for (std::uint32_t j = 0; j < kSides; ++j) {
      if (i > 0) mesh.triangles.push_back({at(i, j), at(i + 1, j), at(i, j + 1)});
      if (i + 1 < kRings) mesh.triangles.push_back({at(i, j + 1), at(i + 1, j), at(i + 1, j + 1)});
    }
  return mesh;
}

TriMesh some_stones(const ModelField& ground, std::uint64_t seed, int count) {
  TriMesh stones;
  const double span = ground.x_mm(ground.z_mm.cols() - 1) - ground.x0.value();
  for (int i = 0; i < count; ++i) {
    const auto u = [&](std::uint64_t k) {
      return random_uniform(seed, 100 * static_cast<std::uint64_t>(i) + k);
    };
    const double x = ground.x0.value() + span * u(1), y = ground.y0.value() + span * u(2);
    const double z = heightmap::height_at(ground, x, y);
    append(stones, stone({x, y, z + u(3)}, 0.5 + 2.0 * u(4), seed + static_cast<std::uint64_t>(i)));
  }
  return stones;
}

const std::array kTools{Cutter::ball(3.0), Cutter::bull(2.0, 0.5), Cutter::bull(3.0, 2.7),
                        Cutter::flat(1.5)};

/// Near the rim of a flat end or of an upright corner 1e-12 mm of the radius decides.
void expect_exact(double fast, const TriMesh& mesh, const Cutter& tool, double x, double y) {
  const double truth = slow_drop(mesh, tool, x, y);
  if (std::isinf(truth) && std::isinf(fast)) return;
  if (std::abs(fast - truth) <= 1e-9) return;
  Cutter less = tool, more = tool;
  (less.radius_mm -= 1e-12, more.radius_mm += 1e-12);
  if (tool.is_ball()) (less.corner_radius_mm -= 1e-12, more.corner_radius_mm += 1e-12);
  EXPECT_GE(fast, slow_drop(mesh, less, x, y) - 1e-9) << "at " << x << ", " << y;
  EXPECT_LE(fast, slow_drop(mesh, more, x, y) + 1e-9) << "at " << x << ", " << y;
}

class MeshCutterTest : public testing::TestWithParam<int> {
 protected:
  const std::uint64_t seed = static_cast<std::uint64_t>(GetParam());
  [[nodiscard]] double u(std::uint64_t i) const { return random_uniform(seed + 4242, i); }
};

// ---- closed forms ------------------------------------------------------------------------

TEST(MeshCutter, StandsOnTheUpperOfTwoPlates) {
  TriMesh mesh;
  for (const double z : {2.0, 7.0}) {
    const auto first = static_cast<std::uint32_t>(mesh.vertices_mm.size());
    for (const auto& [x, y] : {std::pair{-50.0, -50.0}, {50.0, -50.0}, {50.0, 50.0}, {-50.0, 50.0}})
      mesh.vertices_mm.push_back({x, y, z});
    mesh.triangles.push_back({first, first + 1, first + 2});
    mesh.triangles.push_back({first, first + 3, first + 2});  // faces down: no matter
  }
  for (const Cutter& tool : kTools) {
    const MeshCutter cutter(mesh, tool);
    EXPECT_EQ(cutter.drop(1.0, 2.5).tip_mm, 7.0);
    EXPECT_EQ(cutter.drop(0.0, 0.0).tip_mm, 7.0);  // on the seam
    EXPECT_EQ(cutter.drop(60.0, 0.0).tip_mm, -INFINITY);
    EXPECT_EQ(cutter.drop(NAN, 0.0).tip_mm, -INFINITY);
  }
}

TEST(MeshCutter, AnUprightWallIsTouchedAtItsUpperEdge) {
  TriMesh wall;
  wall.vertices_mm = {{0, 0, 0}, {30, 10, 0}, {30, 10, 12}, {0, 0, 9}};
  wall.triangles = {{0, 1, 2}, {0, 2, 3}};
  const MeshCutter cutter(wall, Cutter::ball(3.0));
  const double length = std::hypot(30.0, 10.0), m = 3.0 / length;
  for (const double h : {-2.5, 0.0, 1.0, 2.9}) {  // beside the middle of the wall
    const double x = 15.0 - h * 10.0 / length, y = 5.0 + h * 30.0 / length;
    EXPECT_NEAR(cutter.drop(x, y).tip_mm, 10.5 + std::sqrt((9.0 - h * h) * (1.0 + m * m)) - 3.0,
                1e-12);
  }
}

// ---- against brute force -----------------------------------------------------------------

// Triangles of all sizes, needles and flat ones, upright and degenerate ones.
TEST_P(MeshCutterTest, EqualsBruteForceOnATriangleSoup) {
  TriMesh soup;
  for (std::uint64_t t = 0; t < 300; ++t) {
    const auto v = [&](std::uint64_t k) { return 2.0 * random_uniform(seed, 32 * t + k) - 1.0; };
    const double size = std::pow(10.0, 1.5 * v(0)), tall = std::pow(10.0, v(1));
    const Vec3 centre{15.0 * v(2), 15.0 * v(3), 3.0 * v(4)};
    std::array<Vec3, 3> corner;
    for (std::uint64_t c = 0; c < 3; ++c)
      corner[c] = centre + size * Vec3{v(5 + c), v(8 + c), tall * v(11 + c)};
    if (t % 10 == 7) corner[1] = corner[0] + 1e-4 * (corner[1] - corner[0]);  // needle
    if (t % 10 == 8) corner[2].x = corner[1].x = corner[0].x;                 // upright
    if (t % 30 == 9) corner[2] = corner[1];
    if (t % 30 == 19) corner[1] = {corner[0].x, corner[0].y, corner[0].z + 1.0};
    const auto first = static_cast<std::uint32_t>(soup.vertices_mm.size());
    for (const Vec3& c : corner) soup.vertices_mm.push_back(c);
    soup.triangles.push_back({first, first + 1, first + 2});
  }
  for (const Cutter& tool : kTools) {
    const MeshCutter cutter(soup, tool);
    for (std::uint64_t i = 0; i < 60; ++i) {
      const double x = 40.0 * u(2 * i) - 20.0, y = 40.0 * u(2 * i + 1) - 20.0;
      expect_exact(cutter.drop(x, y).tip_mm, soup, tool, x, y);
    }
  }
}

TEST_P(MeshCutterTest, EqualsBruteForceOnGroundWithStones) {
  const Ground kind = testing_support::kGrounds[seed % testing_support::kGrounds.size()];
  const ModelField ground = testing_support::ground(kind, seed, 30, 0.5);
  TriMesh stones = some_stones(ground, seed, 5), both = mesh_of(ground);
  append(both, stones);
  for (const Cutter& tool : kTools) {
    const MeshCutter cutter(both, tool);
    const GroundAndStones apart(ground, stones, tool);
    for (std::uint64_t i = 0; i < 40; ++i) {
      double x = ground.x0.value() + 18.0 * u(2 * i) - 1.5;
      double y = ground.y0.value() + 18.0 * u(2 * i + 1) - 1.5;
      if (i % 4 == 1) x = ground.x_mm(static_cast<std::ptrdiff_t>(29.0 * u(i)));
      if (i % 4 == 2) (x = ground.x0.value(), y = std::round(2.0 * y) / 2.0 + 0.25);
      if (i % 4 == 3) {  // over a vertex of a stone
        const auto v =
            static_cast<std::size_t>(u(i) * static_cast<double>(stones.vertices_mm.size()));
        (x = stones.vertices_mm[v].x, y = stones.vertices_mm[v].y);
      }
      const double fast = cutter.drop(x, y).tip_mm;
      expect_exact(fast, both, tool, x, y);
      if (std::isfinite(fast)) {
        EXPECT_NEAR(apart.drop(x, y).tip_mm, fast, 1e-9) << "at " << x << ", " << y;
      }
    }
  }
}

TEST_P(MeshCutterTest, AgreesWithTheGridsCutter) {
  const Ground kind = testing_support::kGrounds[seed % testing_support::kGrounds.size()];
  const ModelField ground = testing_support::ground(kind, seed, 60, 0.5);
  const TriMesh mesh = mesh_of(ground);
  for (Cutter tool : kTools) {
    tool.holder = {{5.0, 10.0, 2.0, 2.0}, {15.0, 6.0, 4.0, 7.0}};
    const MeshCutter by_mesh(mesh, tool);
    const DropCutter by_grid(ground, tool);
    for (std::uint64_t i = 0; i < 300; ++i) {
      const double x = ground.x0.value() + 34.0 * u(2 * i) - 2.0;
      const double y = ground.y0.value() + 34.0 * u(2 * i + 1) - 2.0;
      const double a = by_mesh.drop(x, y).tip_mm, b = by_grid.drop(x, y).tip_mm;
      if (a != b) {
        ASSERT_NEAR(a, b, 1e-9) << "at " << x << ", " << y;
      }
      const double c = by_mesh.drop_holder(x, y).tip_mm, d = by_grid.drop_holder(x, y).tip_mm;
      if (c != d) {
        ASSERT_NEAR(c, d, 1e-9) << "at " << x << ", " << y;
      }
    }
  }
}

TEST_P(MeshCutterTest, ContactLiesOnTheCutter) {
  const ModelField ground = testing_support::ground(Ground::rough, seed, 40, 0.5);
  const TriMesh mesh = mesh_of(ground);
  for (const Cutter& tool : kTools) {
    const MeshCutter cutter(mesh, tool);
    for (std::uint64_t i = 0; i < 100; ++i) {
      const double x = ground.x0.value() + 19.5 * u(2 * i),
                   y = ground.y0.value() + 19.5 * u(2 * i + 1);
      const CutterContact c = cutter.drop(x, y);
      const double r = std::hypot(c.dx_mm, c.dy_mm);
      ASSERT_LE(r, tool.radius_mm * (1.0 + 1e-15));
      const double h =
          heightmap::height_at(ground, std::clamp(x + c.dx_mm, ground.x0.value(), ground.x_mm(39)),
                               std::clamp(y + c.dy_mm, ground.y0.value(), ground.y_mm(39)));
      ASSERT_NEAR(h, c.tip_mm + Slow(tool).rise(std::min(r, tool.radius_mm)), 1e-9);
    }
  }
}

TEST_P(MeshCutterTest, DoesNotDependOnWhatWasAskedBefore) {
  const ModelField ground = testing_support::ground(Ground::rolling, seed, 50, 0.5);
  TriMesh mesh = mesh_of(ground);
  append(mesh, some_stones(ground, seed, 4));
  const MeshCutter used(mesh, kTools[0]);
  for (std::uint64_t i = 0; i < 100; ++i) (void)used.drop(20.0 * u(i), 20.0 * u(i + 7));
  const MeshCutter fresh(mesh, kTools[0]);
  for (std::uint64_t i = 100; i > 0; --i) {
    const double x = 20.0 * u(5 * i), y = 20.0 * u(3 * i);
    EXPECT_EQ(std::bit_cast<std::uint64_t>(used.drop(x, y).tip_mm),
              std::bit_cast<std::uint64_t>(fresh.drop(x, y).tip_mm));
  }
}

INSTANTIATE_TEST_SUITE_P(Seed, MeshCutterTest, testing::Range(1, 8));

TEST(MeshCutter, TakesSevenBytesATriangle) {
  const TriMesh mesh = mesh_of(testing_support::ground(Ground::rolling, 1, 257, 0.5));
  EXPECT_LT(static_cast<double>(MeshCutter(mesh, kTools[0]).bytes()),
            7.0 * static_cast<double>(mesh.triangles.size()));
}

}  // namespace
}  // namespace maquette::cnc
