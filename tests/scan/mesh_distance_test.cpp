// SPDX-License-Identifier: GPL-3.0-or-later

// What is claimed in scan/mesh_distance.hpp, and how each claim is attacked:
//
//   exact ......... every triangle by triangle_distance2, 8 rocks; a box in closed form
//   sign .......... winding number of rocks, points on both sides of edges and corners of a box
//   reach, border . by hand on an open square
//   hint .......... any triangle gives the same answer

#include "scan/mesh_distance.hpp"
#include "core/triangle_distance.hpp"

#include <cmath>
#include <numbers>

#include <gtest/gtest.h>

#include "assets/rocks.hpp"
#include "core/random.hpp"
#include "scan/surface_distance.hpp"
#include "support/simple_solids.hpp"

namespace maquette::scan {
namespace {

double winding(const TriMesh& mesh, Vec3 p) {
  double angle = 0.0;
  for (const auto& t : mesh.triangles) {
    const Vec3 a = mesh.vertices_mm[t[0]] - p, b = mesh.vertices_mm[t[1]] - p,
               c = mesh.vertices_mm[t[2]] - p;
    const double la = norm(a), lb = norm(b), lc = norm(c);
    angle += 2.0 * std::atan2(dot(a, cross(b, c)),
                              la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb);
  }
  return angle / (4.0 * std::numbers::pi);
}

class MeshDistanceSeeded : public testing::TestWithParam<int> {};
INSTANTIATE_TEST_SUITE_P(Seed, MeshDistanceSeeded, testing::Range(1, 9));

TEST_P(MeshDistanceSeeded, EqualsEveryTriangleTried) {
  const auto seed = static_cast<std::uint64_t>(GetParam());
  assets::RockShape shape;
  shape.seed = seed;
  shape.roughness = 0.08;
  shape.subdivisions = 3;
  TriMesh rock = assets::make_rock(shape);
  for (Vec3& v : rock.vertices_mm) v = 40.0 * v + Vec3{1000.0, -500.0, 20.0};
  const MeshDistance distance(rock);
  for (std::uint64_t i = 0; i < 400; ++i) {
    const Vec3 p = Vec3{1000.0, -500.0, 20.0} + 30.0 * Vec3{random_normal(seed, 3 * i),
                                                            random_normal(seed, 3 * i + 1),
                                                            random_normal(seed, 3 * i + 2)};
    double least = INFINITY;
    for (const auto& t : rock.triangles)
      least = std::fmin(least, triangle_distance2(p, rock.vertices_mm[t[0]], rock.vertices_mm[t[1]],
                                                  rock.vertices_mm[t[2]]));
    const auto found = distance.nearest(p, 1000.0);
    ASSERT_TRUE(found);
    EXPECT_NEAR(std::abs(found->distance_mm), std::sqrt(least), 1e-9);
    EXPECT_EQ(found->distance_mm<0.0, winding(rock, p)> 0.5) << i;
    EXPECT_FALSE(found->border);
    const auto hinted = distance.nearest(
        p, 1000.0, static_cast<std::uint32_t>(random_bits(seed, i) % rock.triangles.size()));
    EXPECT_EQ(std::abs(found->distance_mm), std::abs(hinted->distance_mm));
  }
}

TEST(MeshDistance, KnowsInsideAtEdgesAndCornersOfABox) {
  const TriMesh box = testing_support::box_solid({0, 0, 0}, {10, 20, 30});
  const MeshDistance distance(box);
  for (const double d : {-0.5, 0.25, 3.0})
    for (const double e : {-0.5, 0.25, 3.0})
      for (const double f : {-0.5, 0.25, 3.0}) {
        const auto n = distance.nearest({10.0 + d, 20.0 + e, 30.0 + f}, 100.0);
        ASSERT_TRUE(n);
        const double out = std::hypot(std::fmax(d, 0.0), std::fmax(e, 0.0), std::fmax(f, 0.0));
        EXPECT_NEAR(n->distance_mm, out > 0.0 ? out : std::fmax(d, std::fmax(e, f)), 1e-12);
      }
}

TEST(MeshDistance, StopsAtReachAndTellsTheBorder) {
  TriMesh square;
  square.vertices_mm = {{0, 0, 0}, {10, 0, 0}, {10, 10, 0}, {0, 10, 0}};
  square.triangles = {{0, 1, 2}, {0, 2, 3}, {1, 1, 2}};  // the last has no area
  const MeshDistance distance(square);
  EXPECT_FALSE(distance.nearest({5, 5, 2.001}, 2.0));
  EXPECT_DOUBLE_EQ(distance.nearest({5, 5, 2.0}, 2.0)->distance_mm, 2.0);
  EXPECT_DOUBLE_EQ(distance.nearest({5, 5, -1.0}, 2.0)->distance_mm, -1.0);
  EXPECT_FALSE(distance.nearest({5, 5, 1.0}, 2.0)->border) << "on the diagonal, which two share";
  EXPECT_TRUE(distance.nearest({11, 5, 1.0}, 2.0)->border);
  EXPECT_TRUE(distance.nearest({11, 11, 1.0}, 2.0)->border);
  const std::vector<Vec3> points{{5, 4, 1}, {11, 5, 1}, {5, 5, 9}};
  const auto all = signed_distances_mm(points, {{}, {0.0, 0.0, 0.5}}, distance, 2.0);
  EXPECT_EQ(all[0], 1.5F);
  EXPECT_TRUE(std::isnan(all[1]));
  EXPECT_TRUE(std::isnan(all[2]));
}

}  // namespace
}  // namespace maquette::scan
