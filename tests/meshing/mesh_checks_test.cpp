// SPDX-License-Identifier: GPL-3.0-or-later
// What meshing/mesh_checks.hpp claims, and how each claim is attacked:
//
//   measures ................ closed forms: tetrahedron, sphere, torus, two shells
//   every defect is seen .... one planted defect per property, on a mesh sound before
//   vertical error .......... vertices moved by known amounts
//   never fails on a mesh ... indices out of range, coordinates that are not finite, empty
//   self-intersections ...... two bodies that cut; limit of triangles; found in pieces as in the
//                             whole: spikes and bent nodes at random places of terrain, through
//                             top, wall and base, and on a sphere of several pieces
//   to_json ................. parsed again, key by key

#include "meshing/mesh_checks.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "meshing/solid.hpp"
#include "support/matchers.hpp"
#include "support/shapes.hpp"

namespace maquette::meshing {
namespace {

using testing_support::FailsWith;
using testing_support::random_terrain;
using testing_support::Succeeds;
using testing_support::unit_sphere;

TriMesh tetrahedron() {
  return {{{0, 0, 0}, {6, 0, 0}, {0, 6, 0}, {0, 0, 6}},
          {{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}}};
}

TriMesh moved(TriMesh mesh, Vec3 by) {
  for (Vec3& v : mesh.vertices_mm) v += by;
  return mesh;
}

TriMesh torus(std::uint32_t n, std::uint32_t m) {
  TriMesh t;
  for (std::uint32_t i = 0; i < n; ++i)
    for (std::uint32_t j = 0; j < m; ++j) {
      const double u = 2 * std::numbers::pi * i / n, v = 2 * std::numbers::pi * j / m;
      t.vertices_mm.push_back(
          {(3 + std::cos(v)) * std::cos(u), (3 + std::cos(v)) * std::sin(u), std::sin(v)});
      const std::uint32_t a = i * m + j, b = (i + 1) % n * m + j;
      const std::uint32_t c = (i + 1) % n * m + (j + 1) % m, d = i * m + (j + 1) % m;
      t.triangles.push_back({a, b, c});
      t.triangles.push_back({a, c, d});
    }
  return t;
}

MeshCertificate certify(const TriMesh& mesh, const MeshCheckOptions& options = {}) {
  const auto c = check_mesh(mesh, nullptr, options);
  EXPECT_THAT(c, Succeeds());
  return *c;
}

TEST(CheckMesh, MeasuresATetrahedron) {
  const MeshCertificate c = certify(tetrahedron());
  EXPECT_TRUE(c.passed()) << to_json(c);
  EXPECT_EQ(c.vertices, 4U);
  EXPECT_EQ(c.triangles, 4U);
  EXPECT_EQ(c.shells, 1U);
  EXPECT_EQ(c.euler_number, 2);
  EXPECT_DOUBLE_EQ(c.volume_mm3, 36.0);
  EXPECT_DOUBLE_EQ(c.area_mm2, 3 * 18.0 + 18.0 * std::sqrt(3.0));
}

TEST(CheckMesh, MeasuresASphereAndATorus) {
  const MeshCertificate ball = certify(unit_sphere(5));
  EXPECT_TRUE(ball.passed());
  // Chords: the volume falls short by about the mean of edge^2 / 4 = (0.035)^2 / 4.
  EXPECT_NEAR(ball.volume_mm3, 4.0 / 3.0 * std::numbers::pi, 3e-3);
  EXPECT_EQ(ball.euler_number, 2);
  const MeshCertificate ring = certify(torus(96, 48));
  EXPECT_TRUE(ring.passed()) << to_json(ring);
  EXPECT_EQ(ring.euler_number, 0);
  EXPECT_NEAR(ring.volume_mm3, 6 * std::numbers::pi * std::numbers::pi, 0.3);
}

TEST(CheckMesh, LooksAtEveryShell) {
  TriMesh two = tetrahedron();
  append(two, moved(tetrahedron(), {10, 0, 0}));
  MeshCertificate c = certify(two);
  EXPECT_TRUE(c.passed());
  EXPECT_EQ(c.shells, 2U);
  EXPECT_EQ(c.euler_number, 4);
  for (std::size_t t = 4; t < 8; ++t) std::swap(two.triangles[t][0], two.triangles[t][1]);
  c = certify(two);
  EXPECT_TRUE(c.closed && c.manifold);
  EXPECT_FALSE(c.oriented_outward) << "the second shell is inside out";
}

TEST(CheckMesh, SeesAHole) {
  TriMesh mesh = unit_sphere(2);
  mesh.triangles.erase(mesh.triangles.begin() + 17);
  const MeshCertificate c = certify(mesh);
  EXPECT_TRUE(c.manifold);
  EXPECT_FALSE(c.closed);
  EXPECT_FALSE(c.passed());
}

TEST(CheckMesh, SeesInsideOut) {
  TriMesh mesh = unit_sphere(2);
  for (auto& t : mesh.triangles) std::swap(t[0], t[1]);
  const MeshCertificate c = certify(mesh);
  EXPECT_TRUE(c.manifold && c.closed);
  EXPECT_FALSE(c.oriented_outward);
  EXPECT_LT(c.volume_mm3, 0.0);
}

TEST(CheckMesh, SeesOneTurnedTriangle) {
  TriMesh mesh = unit_sphere(2);
  std::swap(mesh.triangles[40][0], mesh.triangles[40][1]);
  EXPECT_FALSE(certify(mesh).manifold);
}

TEST(CheckMesh, SeesAnEdgeOfThreeTriangles) {
  TriMesh mesh = tetrahedron();
  mesh.vertices_mm.push_back({9, 9, 9});
  mesh.triangles.push_back({1, 2, 4});
  EXPECT_FALSE(certify(mesh).manifold);
}

TEST(CheckMesh, SeesBodiesThatShareOneVertex) {
  // Interleaved, so that both fans grow at the shared vertex at the same time.
  const TriMesh a = tetrahedron();
  TriMesh b = tetrahedron();
  for (Vec3& v : b.vertices_mm) v = {-v.x, -v.y, -v.z};
  for (auto& t : b.triangles) std::swap(t[0], t[1]);
  TriMesh both = a;
  for (std::size_t v = 1; v < 4; ++v) both.vertices_mm.push_back(b.vertices_mm[v]);
  both.triangles.clear();
  for (std::size_t t = 0; t < 4; ++t) {
    both.triangles.push_back(a.triangles[t]);
    auto other = b.triangles[t];
    for (auto& v : other) v = v == 0 ? 0 : v + 3;
    both.triangles.push_back(other);
  }
  // Whether building the mesh stumbles over it depends on the order of triangles.
  for (std::uint64_t seed = 0; seed < 100; ++seed) {
    for (std::size_t i = 7; i > 0; --i)
      std::swap(both.triangles[i], both.triangles[random_bits(seed, i) % (i + 1)]);
    EXPECT_FALSE(certify(both).manifold) << "order " << seed;
  }
}

TEST(CheckMesh, CountsDegenerateTriangles) {
  TriMesh mesh = tetrahedron();
  // A vertex in the middle of edge 1-2, T-like on one side only.
  mesh.vertices_mm.push_back({3, 3, 0});
  mesh.triangles[3] = {1, 4, 3};
  mesh.triangles.push_back({4, 2, 3});
  mesh.triangles.push_back({1, 2, 4});  // collinear
  const MeshCertificate c = certify(mesh);
  EXPECT_EQ(c.degenerate_triangles, 1U);
  EXPECT_TRUE(c.manifold && c.closed) << "topologically sound";
  EXPECT_FALSE(c.passed());
  mesh = tetrahedron();
  mesh.triangles.push_back({1, 1, 2});
  EXPECT_EQ(certify(mesh).degenerate_triangles, 1U);
}

TEST(CheckMesh, SeesSelfIntersectionsUpToTheLimit) {
  TriMesh mesh = unit_sphere(2);
  append(mesh, moved(unit_sphere(2), {0.7, 0.1, 0.2}));
  MeshCertificate c = certify(mesh);
  EXPECT_TRUE(c.self_intersection_checked);
  EXPECT_TRUE(c.self_intersecting);
  EXPECT_FALSE(c.passed());
  EXPECT_TRUE(c.manifold && c.closed && c.oriented_outward);
  c = certify(mesh, {.self_intersection_limit = mesh.triangles.size() - 1});
  EXPECT_FALSE(c.self_intersection_checked);
  c = certify(mesh, {.self_intersections = false});
  EXPECT_FALSE(c.self_intersection_checked);
}

TEST(CheckMesh, WhatWasNotLookedForHasNotPassed) {
  const TriMesh mesh = unit_sphere(2);
  EXPECT_TRUE(certify(mesh).passed());
  EXPECT_EQ(shortcomings(certify(mesh)), "");
  for (const MeshCheckOptions& options :
       {MeshCheckOptions{.self_intersections = false},
        MeshCheckOptions{.self_intersection_limit = mesh.triangles.size() - 1}}) {
    const MeshCertificate c = certify(mesh, options);
    EXPECT_TRUE(c.manifold && c.closed && c.oriented_outward && !c.self_intersecting);
    EXPECT_FALSE(c.passed());
    EXPECT_EQ(nlohmann::json::parse(to_json(c))["passed"], false);
    EXPECT_EQ(shortcomings(c), "whether it cuts itself was not found out");
  }
}

/// A body of half a millimetre, corners in odd places.
TriMesh splinter(Vec3 at) {
  TriMesh t = tetrahedron();
  for (Vec3& v : t.vertices_mm) v = at + 0.083 * (v + Vec3{0.0013, 0.0021, 0.0017});
  return t;
}

// With the field as without it: then the terrain's own triangles are no longer left out, and all of
// the 20 000 are one piece.
TEST(CheckMesh, SeesSelfIntersectionsInPiecesAsInTheWhole) {
  const heightmap::ModelField field = random_terrain(6, 91, 111, 0.3, 0.3, 0.02);
  const TriMesh solid = grid_solid(field, {.base_z = Millimetres{-20}}).value();
  ASSERT_FALSE(check_mesh(solid, &field)->self_intersecting);
  ASSERT_TRUE(check_mesh(solid, &field)->passed());
  const double x1 = field.x_mm(110), y1 = field.y_mm(90);
  int cutting = 0, clear = 0;
  for (std::uint64_t i = 0; i < 60; ++i) {
    const auto draw = [&](std::uint64_t k) { return random_uniform(17, 8 * i + k); };
    const double x = x1 * draw(0), y = y1 * draw(1), z = heightmap::height_at(field, x, y);
    TriMesh mesh = solid;
    switch (i % 6) {
      case 0:  // through the top, or near it
        append(mesh, splinter({x, y, z + 2.0 * (draw(2) - 0.5)}));
        break;
      case 1:  // through the base
        append(mesh, splinter({x, y, -20.0 + 2.0 * (draw(2) - 0.5)}));
        break;
      case 2:  // through a wall
        append(mesh, splinter({draw(3) < 0.5 ? -0.2 : x1 - 0.2, y, -20.0 + (z + 20.0) * draw(2)}));
        break;
      case 3:  // through another one, inside
        append(mesh, splinter({x, y, -10.0}));
        append(mesh, splinter({x + 0.4 * draw(2), y, -10.0}));
        break;
      case 4: {  // a node goes over its neighbours
        const auto r = static_cast<std::size_t>(1 + 88 * draw(2));
        const auto c = static_cast<std::size_t>(1 + 108 * draw(3));
        mesh.vertices_mm[r * 111 + c].x += 0.9 * (draw(4) - 0.5);
        break;
      }
      default: {  // a node goes through the base
        const auto r = static_cast<std::size_t>(1 + 88 * draw(2));
        const auto c = static_cast<std::size_t>(1 + 108 * draw(3));
        mesh.vertices_mm[r * 111 + c].z = -20.5 + 1.2 * draw(4);
      }
    }
    const auto pieces = check_mesh(mesh, &field), whole = check_mesh(mesh);
    ASSERT_TRUE(pieces && whole);
    ASSERT_TRUE(pieces->self_intersection_checked && whole->self_intersection_checked) << i;
    EXPECT_EQ(pieces->self_intersecting, whole->self_intersecting) << i;
    (whole->self_intersecting ? cutting : clear) += 1;
  }
  EXPECT_GE(cutting, 15);
  EXPECT_GE(clear, 10);
}

TEST(CheckMesh, SeesSelfIntersectionsOfAMeshOfSeveralPieces) {
  TriMesh ball = unit_sphere(7);  // 327 680 triangles
  for (Vec3& v : ball.vertices_mm) v = 10.0 * v;
  EXPECT_FALSE(certify(ball).self_intersecting);
  for (std::uint64_t i = 0; i < 4; ++i) {
    const Vec3 to = normalized(
        Vec3{random_normal(3, 3 * i), random_normal(3, 3 * i + 1), random_normal(3, 3 * i + 2)});
    TriMesh mesh = ball;
    append(mesh, splinter(10.0 * to - Vec3{0.1, 0.1, 0.1}));  // (0.1, 0.1, 0.1) is inside it
    EXPECT_TRUE(certify(mesh).self_intersecting) << i;
    mesh = ball;
    append(mesh, splinter(8.0 * to));
    EXPECT_FALSE(certify(mesh).self_intersecting) << i;
  }
}

// Its triangles are the field's own, but two sheets lie in one place.
TEST(CheckMesh, SeesTerrainThatIsThereTwice) {
  const heightmap::ModelField field = random_terrain(6, 21, 31, 0.5, 0.2);
  TriMesh mesh = grid_solid(field, {.base_z = Millimetres{-20}}).value();
  append(mesh, TriMesh(mesh));
  const auto c = check_mesh(mesh, &field);
  ASSERT_THAT(c, Succeeds());
  EXPECT_TRUE(c->self_intersecting);
}

TEST(CheckMesh, NeverFailsOnRubbish) {
  EXPECT_FALSE(certify({}).passed());
  TriMesh mesh = tetrahedron();
  mesh.triangles[0][0] = 99;
  EXPECT_FALSE(certify(mesh).passed());
  mesh = tetrahedron();
  mesh.vertices_mm[2].y = NAN;
  EXPECT_FALSE(certify(mesh).passed());
  std::vector<std::array<std::uint32_t, 3>> soup;  // random triangles over few vertices
  mesh = unit_sphere(1);
  for (std::uint64_t i = 0; i < 200; ++i)
    soup.push_back({static_cast<std::uint32_t>(random_bits(4, 3 * i) % 42),
                    static_cast<std::uint32_t>(random_bits(4, 3 * i + 1) % 42),
                    static_cast<std::uint32_t>(random_bits(4, 3 * i + 2) % 42)});
  mesh.triangles = soup;
  EXPECT_FALSE(certify(mesh).passed());
}

TEST(CheckMesh, StopsWhenAsked) {
  std::stop_source stop;
  stop.request_stop();
  RunContext run;
  run.stop = stop.get_token();
  EXPECT_THAT(check_mesh(tetrahedron(), nullptr, {}, run), FailsWith(kCancelled));
}

TEST(CheckMesh, MeasuresVerticalErrorAtVertices) {
  const heightmap::ModelField field = random_terrain(8, 11, 21, 0.5, 0.2);
  auto solid = grid_solid(field, {.base_z = Millimetres{-20}});
  ASSERT_THAT(solid, Succeeds());
  const auto lift = [&](std::ptrdiff_t r, std::ptrdiff_t c, double by) {
    solid->vertices_mm[static_cast<std::size_t>(r * 21 + c)].z += by;
  };
  lift(5, 5, 0.04);
  lift(6, 9, -0.07);
  lift(3, 3, 0.06);  // counts as stone
  lift(0, 7, -3.0);  // on the outline: not compared
  const auto c = check_mesh(*solid, &field);
  ASSERT_THAT(c, Succeeds());
  EXPECT_NEAR(c->max_vertical_error_mm, 0.07, 1e-12);
  EXPECT_EQ(c->vertices_above_surface, 1U);
  EXPECT_EQ(c->vertices_compared, 9U * 19U - 1U);
  EXPECT_NEAR(c->rms_vertical_error_mm, std::sqrt((0.0016 + 0.0049) / 170.0), 1e-12);
}

TEST(CheckMesh, CertificateAsJsonHasEveryKey) {
  MeshCertificate c = certify(tetrahedron());
  c.max_vertical_error_mm = 0.125;
  const auto json = nlohmann::json::parse(to_json(c));
  EXPECT_EQ(json.size(), 21U);
  EXPECT_EQ(json["proof"], "CGAL");
  EXPECT_TRUE(json["rounding_mm"].is_null());  // nobody asked, and null is not 0
  EXPECT_TRUE(json["hausdorff_bound_mm"].is_null());
  EXPECT_TRUE(json["max_union_error_mm"].is_null());
  EXPECT_EQ(json["vertices"], 4);
  EXPECT_EQ(json["triangles"], 4);
  EXPECT_EQ(json["euler_number"], 2);
  EXPECT_EQ(json["max_vertical_error_mm"], 0.125);
  EXPECT_EQ(json["volume_mm3"], c.volume_mm3);
  EXPECT_EQ(json["passed"], true);
  for (const char* key : {"manifold", "closed", "oriented_outward", "self_intersection_checked"})
    EXPECT_EQ(json[key], true) << key;
  c.closed = false;
  EXPECT_EQ(nlohmann::json::parse(to_json(c))["passed"], false);
}

}  // namespace
}  // namespace maquette::meshing
