// SPDX-License-Identifier: GPL-3.0-or-later

// meshing/stone_parts.hpp:
//   a catalogue has each shape and size once .. counted by hand; every stone in exactly one
//   shrunk by the clearance ................... cube and box: closed form; rocks: every vertex at
//                                               the clearance by brute force over all triangles,
//                                               facets within a facet's sagitta of it
//   still a solid ............................. CGAL's certificate
//   what a wall rounds off .................... cube's corner: (sqrt 3 - 1) wall / 2; wedge's edge:
//                                               (1 / sin - 1) wall / 2; ball: nothing; larger: all
//   MESHING_STONE_VANISHES .................... reached

#include "meshing/stone_parts.hpp"

#include <numbers>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "meshing/mesh_checks.hpp"
#include "support/matchers.hpp"
#include "support/simple_solids.hpp"

namespace maquette::meshing {
namespace {

using testing_support::box_solid;
using testing_support::FailsWith;
using testing_support::sphere_solid;

PlacedStone stone(int number, std::uint64_t seed, double scale_mm) {
  PlacedStone s;
  s.number = number;
  s.shape.seed = seed;
  s.scale_mm = scale_mm;
  return s;
}

TEST(StoneCatalogue, HasEachShapeAndSizeOnce) {
  const std::vector<PlacedStone> stones{stone(1, 5, 4.0), stone(2, 6, 3.0), stone(3, 5, 4.0),
                                        stone(4, 5, 3.0), stone(5, 6, 3.0), stone(6, 7, 2.0)};
  const auto catalogue = stone_catalogue(stones);
  ASSERT_EQ(catalogue.size(), 4U);
  EXPECT_EQ(catalogue[0].places, (std::vector<std::size_t>{0, 2}));
  EXPECT_EQ(catalogue[0].part_number, "S001");
  EXPECT_EQ(catalogue[1].places, (std::vector<std::size_t>{3}));
  EXPECT_EQ(catalogue[1].shape_number, catalogue[0].shape_number) << "one shape in two sizes";
  EXPECT_EQ(catalogue[2].places, (std::vector<std::size_t>{1, 4}));
  EXPECT_EQ(catalogue[3].places, (std::vector<std::size_t>{5}));
  EXPECT_EQ(catalogue[3].part_number, "S004");
  EXPECT_EQ(catalogue[3].shape_number, 3);
  EXPECT_TRUE(stone_catalogue({}).empty());
}

/// From a point to a triangle, by its seven regions; nothing of the box tree.
double distance_to_triangle(Vec3 p, Vec3 a, Vec3 b, Vec3 c) {
  const auto to_segment = [p](Vec3 from, Vec3 to) {
    const Vec3 d = to - from;
    const double t = std::clamp(dot(p - from, d) / dot(d, d), 0.0, 1.0);
    return norm(p - (from + t * d));
  };
  const Vec3 n = cross(b - a, c - a);
  const bool over = dot(cross(b - a, p - a), n) >= 0 && dot(cross(c - b, p - b), n) >= 0 &&
                    dot(cross(a - c, p - c), n) >= 0;
  if (over) return std::abs(dot(p - a, n)) / norm(n);
  return std::min({to_segment(a, b), to_segment(b, c), to_segment(c, a)});
}

double distance_to(const TriMesh& m, Vec3 p) {
  double least = INFINITY;
  for (const auto& [a, b, c] : m.triangles)
    least = std::fmin(
        least, distance_to_triangle(p, m.vertices_mm[a], m.vertices_mm[b], m.vertices_mm[c]));
  return least;
}

TEST(ShrinkStone, OfBoxesIsKnown) {
  const TriMesh cube = box_solid({-3, -3, -3}, {3, 3, 3});
  const TriMesh smaller = shrink_stone(cube, Millimetres{0.5}).value();
  for (std::size_t i = 0; i < 8; ++i)
    EXPECT_NEAR(norm(smaller.vertices_mm[i] - (2.5 / 3.0) * cube.vertices_mm[i]), 0.0, 2e-6);
  const TriMesh box = box_solid({-4, -3, -2}, {4, 3, 2});
  // The corner meets the offset of the nearest faces, those at 2, first.
  const TriMesh thin = shrink_stone(box, Millimetres{0.25}).value();
  for (std::size_t i = 0; i < 8; ++i)
    EXPECT_NEAR(norm(thin.vertices_mm[i] - (1.0 - 0.25 / 2.0) * box.vertices_mm[i]), 0.0, 2e-5);
  EXPECT_EQ(shrink_stone(box, Millimetres{0.0}).value().vertices_mm, box.vertices_mm);
}

TEST(ShrinkStone, VanishesWhereNothingIsLeft) {
  const auto none = shrink_stone(box_solid({-3, -3, -1}, {3, 3, 1}), Millimetres{1.1});
  ASSERT_THAT(none, FailsWith(kStoneVanishes));
  EXPECT_THAT(none.error().message, testing::HasSubstr("6.000 x 6.000 x 2.000"));
}

class Rocks : public testing::TestWithParam<std::uint64_t> {};
INSTANTIATE_TEST_SUITE_P(Seeds, Rocks, testing::Values(1, 2, 3, 4, 5, 6));

TEST_P(Rocks, KeepTheClearanceAndStaySolid) {
  const double angularity = 0.15 * static_cast<double>(GetParam());
  TriMesh rock = assets::make_rock({.angularity = angularity,
                                    .flatness = 0.6,
                                    .roughness = 0.04,
                                    .seed = GetParam(),
                                    .subdivisions = 3});
  for (Vec3& v : rock.vertices_mm) v = 4.0 * v;
  constexpr double kClearance = 0.15;
  const TriMesh shrunk = shrink_stone(rock, Millimetres{kClearance}).value();
  for (const Vec3& v : shrunk.vertices_mm) EXPECT_NEAR(distance_to(rock, v), kClearance, 2e-6);
  // Facets are chords: an edge of 0.28 mm spans at most 0.28^2 / (8 r) of a hollow of radius r;
  // the roughness leaves none sharper than 1 mm. Across a rectangular edge such a chord lies half
  // its length farther inside.
  const ClearanceRange range = clearance_of(shrunk, rock);
  EXPECT_GT(range.least_mm, kClearance - 0.02);
  EXPECT_LT(range.most_mm, kClearance + 0.14);
  EXPECT_LE(range.least_mm, kClearance);
  const auto certificate = check_mesh(shrunk).value();
  EXPECT_TRUE(certificate.passed()) << to_json(certificate);
  EXPECT_EQ(certificate.euler_number, 2);
  EXPECT_TRUE(certificate.self_intersection_checked);
}

TEST(ThinnerThanWall, OfKnownBodies) {
  const TriMesh cube = box_solid({-3, -3, -3}, {3, 3, 3});
  EXPECT_NEAR(thinner_than_wall_mm(cube, Millimetres{1.0}), (std::sqrt(3.0) - 1.0) / 2, 1e-5);
  EXPECT_EQ(thinner_than_wall_mm(cube, Millimetres{6.5}), INFINITY);
  // A ball loses nothing but what its facets stand off a ball of the same corners.
  const TriMesh ball = sphere_solid({}, 2.0, 40);
  const double sagitta = 2.0 * (1.0 - std::cos(std::numbers::pi / 40));
  EXPECT_LT(thinner_than_wall_mm(ball, Millimetres{2.0}), 2.0 * sagitta);
  EXPECT_EQ(thinner_than_wall_mm(ball, Millimetres{4.01}), INFINITY);
}

/// A lens: two cones of this half angle, base to base, of radius 4.
TriMesh double_cone(double half_angle, std::uint32_t around) {
  const double high = 4.0 * std::tan(half_angle);
  TriMesh m;
  m.vertices_mm = {{0, 0, high}, {0, 0, -high}};
  for (std::uint32_t i = 0; i < around; ++i) {
    const double t = 2.0 * std::numbers::pi * i / around;
    m.vertices_mm.push_back({4.0 * std::cos(t), 4.0 * std::sin(t), 0.0});
  }
  for (std::uint32_t i = 0; i < around; ++i) {
    const std::uint32_t a = 2 + i, b = 2 + (i + 1) % around;
    m.triangles.push_back({0, a, b});
    m.triangles.push_back({1, b, a});
  }
  return m;
}

TEST(ThinnerThanWall, OfASharpRim) {
  for (const double half : {0.3, 0.6}) {
    const double known = (1.0 / std::sin(half) - 1.0) * 0.4;
    // 120 sides: the rim is a polygon, its shrunk corners lie within 4 (1 - cos(pi / 120)).
    EXPECT_NEAR(thinner_than_wall_mm(double_cone(half, 120), Millimetres{0.8}), known, 0.01);
  }
}

}  // namespace
}  // namespace maquette::meshing
