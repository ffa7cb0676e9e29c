// SPDX-License-Identifier: GPL-3.0-or-later

// What is claimed in scan/register_mesh.hpp, scan/upper_envelope.hpp and of deviate() on a mesh:
//
//   envelope ........ a triangulated grid comes out as that grid; a box from above; overhangs
//   registration .... of a relief's solid from 20 mm and 5 degrees off and from anywhere; of a rock
//                     scanned all round from 1 degree off; another part, another unit and a mirror
//                     image refused, low relief too; a sphere's rotations are named as free
//   deviation ....... a sphere scanned 0.1 mm too large, in closed form; means per vertex; coverage
//                     of half a sphere; no sign flips near edges (1 M points about a cube)
//   welded .......... a soup of triangles has no borders

#include "scan/register_mesh.hpp"

#include <algorithm>
#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "assets/rocks.hpp"
#include "core/random.hpp"
#include "scan/deviate.hpp"
#include "scan/upper_envelope.hpp"
#include "support/field_mesh.hpp"
#include "support/matchers.hpp"
#include "support/scan_terrain.hpp"
#include "support/simple_solids.hpp"

namespace maquette::scan {
namespace {

using heightmap::ModelField;
using testing_support::box_solid;
using testing_support::FailsWith;
using testing_support::mesh_of;
using testing_support::points_on;
using testing_support::random_pose;
using testing_support::rough_part;
using testing_support::seen_from;
using testing_support::sphere_solid;
using testing_support::Succeeds;

/// Even over the area, moved along the normal by noise.
Cloud points_on_mesh(const TriMesh& mesh, std::size_t n, std::uint64_t seed, double sigma) {
  std::vector<double> sum{0.0};
  const auto& v = mesh.vertices_mm;
  for (const auto& t : mesh.triangles)
    sum.push_back(sum.back() + norm(cross(v[t[1]] - v[t[0]], v[t[2]] - v[t[0]])));
  Cloud cloud;
  for (std::uint64_t i = 0; i < n; ++i) {
    const double at = sum.back() * random_uniform(seed, 3 * i);
    const auto k =
        static_cast<std::size_t>(std::upper_bound(sum.begin(), sum.end(), at) - sum.begin() - 1);
    const auto& t = mesh.triangles[std::min(k, mesh.triangles.size() - 1)];
    double a = random_uniform(seed, 3 * i + 1), b = random_uniform(seed, 3 * i + 2);
    if (a + b > 1.0) a = 1.0 - a, b = 1.0 - b;
    const Vec3 u = v[t[1]] - v[t[0]], w = v[t[2]] - v[t[0]];
    cloud.points_mm.push_back(v[t[0]] + a * u + b * w +
                              sigma * random_normal(seed + 1, i) * normalized(cross(u, w)));
  }
  return cloud;
}

/// Root mean square distance of the points from where they belong.
double pose_error(const Cloud& truth, const Cloud& seen, const RigidTransform& model_from_scan) {
  double sum = 0.0;
  for (std::size_t i = 0; i < truth.points_mm.size(); ++i) {
    const Vec3 e = model_from_scan.point(seen.points_mm[i]) - truth.points_mm[i];
    sum += dot(e, e);
  }
  return std::sqrt(sum / static_cast<double>(truth.points_mm.size()));
}

TEST(UpperEnvelope, GivesTheGridBack) {
  const ModelField f = rough_part(1, 81, 121, 0.5);
  const auto e = upper_envelope(mesh_of(f));
  ASSERT_THAT(e, Succeeds());
  ASSERT_EQ(e->z_mm.rows(), 81);
  ASSERT_EQ(e->z_mm.cols(), 121);
  for (std::ptrdiff_t r = 0; r < 81; ++r)
    for (std::ptrdiff_t c = 0; c < 121; ++c)
      ASSERT_NEAR(static_cast<double>(e->z_mm(r, c)), static_cast<double>(f.z_mm(r, c)), 4e-6);
}

TEST(UpperEnvelope, SeesTheHighestOnly) {
  TriMesh two = box_solid({0, 0, 0}, {16, 8, 2});
  append(two, box_solid({4, 2, 5}, {8, 6, 6}));
  const auto e = upper_envelope(two);
  ASSERT_THAT(e, Succeeds());
  EXPECT_EQ(heightmap::height_at(*e, 6.0, 4.0), 6.0) << "hangs over the other";
  EXPECT_EQ(heightmap::height_at(*e, 14.0, 4.0), 2.0);
  TriMesh inside_out = box_solid({0, 0, 0}, {1, 1, 1});
  inside_out.triangles.resize(2);  // its underside
  EXPECT_THAT(upper_envelope(inside_out), FailsWith(kNoUpperSide));
}

TEST(RegisterMesh, BringsAReliefBack) {
  const ModelField f = rough_part(3, 121, 121, 1.0, 2.0);
  const TriMesh mesh = mesh_of(f);
  const MeshDistance tree(mesh);
  const auto top = upper_envelope(mesh);
  ASSERT_THAT(top, Succeeds());
  const Cloud truth = points_on(f, 30'000, 5, 0.05);
  for (const auto& [angle, shift] : {std::pair{0.087, 20.0}, {2.0, 900.0}}) {
    const Cloud seen = seen_from(truth, random_pose(7, {60, 60, 10}, angle, shift));
    const auto r = register_mesh(seen, tree, *top);
    ASSERT_THAT(r, Succeeds()) << angle;
    // 0.05 mm over the root of 30 000 points is 0.0003; sideways by slopes of some 15 degrees more.
    EXPECT_LT(pose_error(truth, seen, r->model_from_scan), 0.004) << angle;
    EXPECT_NEAR(r->noise_mm, 0.05, 0.005);
  }
  const Cloud other = points_on(rough_part(4, 121, 121, 1.0, 2.0), 30'000, 5, 0.05);
  EXPECT_THAT(register_mesh(other, tree, *top), FailsWith(kPoorFit));
}

// What lies on any triangle, for it is tiny or the relief is low, is no fit.
TEST(RegisterMesh, RefusesWhatTheSearchFromAboveHasRefused) {
  const ModelField f = rough_part(3, 121, 121, 1.0, 0.2);  // 0.5 mm rms
  const TriMesh mesh = mesh_of(f);
  const MeshDistance tree(mesh);
  const auto top = upper_envelope(mesh);
  ASSERT_THAT(top, Succeeds());
  const Cloud truth = points_on(f, 30'000, 5, 0.02);
  ASSERT_THAT(register_mesh(truth, tree, *top), Succeeds());
  const Cloud other = points_on(rough_part(4, 121, 121, 1.0, 0.2), 30'000, 5, 0.02);
  EXPECT_THAT(register_mesh(other, tree, *top), FailsWith(kPoorFit));
  Cloud wrong = truth;
  for (Vec3& p : wrong.points_mm) p.x = -p.x;
  EXPECT_THAT(register_mesh(wrong, tree, *top), FailsWith(kMirrored));
  for (const double unit : {1e-3, 1.0 / 25.4}) {
    wrong.points_mm = truth.points_mm;
    for (Vec3& p : wrong.points_mm) p = unit * p;
    EXPECT_THAT(register_mesh(wrong, tree, *top), FailsWith(kUnitSlip)) << unit;
  }
}

TEST(RegisterMesh, BringsARockScannedAllRoundBack) {
  assets::RockShape shape;
  shape.seed = 5;
  shape.subdivisions = 5;
  TriMesh rock = assets::make_rock(shape);
  for (Vec3& v : rock.vertices_mm) v = 40.0 * v;
  const MeshDistance tree(rock);
  const auto top = upper_envelope(rock);
  ASSERT_THAT(top, Succeeds());
  const Cloud truth = points_on_mesh(rock, 20'000, 2, 0.02);
  const Cloud seen = seen_from(truth, random_pose(3, {}, 0.02, 0.5));
  const auto r = register_mesh(seen, tree, *top);
  ASSERT_THAT(r, Succeeds());
  EXPECT_LT(pose_error(truth, seen, r->model_from_scan), 0.003);
}

TEST(RegisterMesh, NamesWhatASphereLeavesFree) {
  const TriMesh ball = sphere_solid({0, 0, 0}, 50.0, 90);
  const MeshDistance tree(ball);
  const auto top = upper_envelope(ball);
  ASSERT_THAT(top, Succeeds());
  const Cloud truth = points_on_mesh(ball, 20'000, 2, 0.02);
  const Cloud seen = seen_from(truth, random_pose(3, {}, 0.5, 0.4));
  const auto r = register_mesh(seen, tree, *top);
  ASSERT_THAT(r, Succeeds());
  EXPECT_EQ(r->free_directions.size(), 3U) << testing::PrintToString(r->free_directions);
  Vec3 middle;
  for (const Vec3& p : seen.points_mm) middle += r->model_from_scan.point(p);
  EXPECT_LT(norm((1.0 / 20'000) * middle), 1.0) << "of a random sample on the ball: 50 / root n";
  EXPECT_LT(norm(r->model_from_scan.point(random_pose(3, {}, 0.5, 0.4).point({0, 0, 0}))), 0.002);
}

TEST(DeviateMesh, OfASphere) {
  const TriMesh ball = sphere_solid({0, 0, 0}, 50.0, 200);
  const MeshDistance tree(ball);
  const auto top = upper_envelope(ball);
  ASSERT_THAT(top, Succeeds());
  Cloud cloud;
  for (std::uint64_t i = 0; i < 200'000; ++i) {
    const Vec3 d = normalized(
        Vec3{random_normal(1, 3 * i), random_normal(1, 3 * i + 1), random_normal(1, 3 * i + 2)});
    if (d.x > 0.0) cloud.points_mm.push_back(50.1 * d);
  }
  const auto d = deviate(cloud, {}, tree, *top);
  ASSERT_THAT(d, Succeeds());
  // Chords of half a band lie below the sphere by 50 (1 - cos(pi / 400)) = 0.0015 mm at most.
  EXPECT_NEAR(d->statistics.min_mm, 0.1, 1e-5);
  EXPECT_LE(d->statistics.max_mm, 0.1 + 0.0032);
  EXPECT_NEAR(d->statistics.coverage, 0.5, 0.02);
  EXPECT_EQ(d->statistics.off_part, 0U);
  double high = -INFINITY;
  for (std::size_t i = 0; i < ball.vertices_mm.size(); ++i) {
    const auto e = static_cast<double>(d->per_vertex_mm[i]);
    if (ball.vertices_mm[i].x < -2.0) {
      EXPECT_TRUE(std::isnan(e));
    }
    if (!std::isnan(e)) high = std::fmax(high, std::abs(e - 0.1));
  }
  EXPECT_LT(high, 0.0032);
  std::size_t nodes = 0;
  for (const float e : d->map_mm.cells()) nodes += std::isnan(e) ? 0U : 1U;
  EXPECT_GT(nodes, 1000U) << "its upper half has a map";
}

TEST(DeviateMesh, NoSignFlipsAboutACube) {
  const TriMesh cube = box_solid({0, 0, 0}, {10, 10, 10});
  const MeshDistance tree(cube);
  std::size_t wrong = 0;
  for (std::uint64_t i = 0; i < 300'000; ++i) {
    // Crowded about edges and corners, down to 1e-6 mm from them.
    Vec3 p{10.0, 10.0, 10.0 * random_uniform(1, 5 * i)};
    const double scale = std::pow(10.0, -6.0 * random_uniform(1, 5 * i + 1));
    p += scale *
         Vec3{random_normal(2, 3 * i), random_normal(2, 3 * i + 1), i % 3 == 0 ? 10.0 - p.z : 0.0};
    const bool inside = p.x > 0 && p.y > 0 && p.z > 0 && p.x < 10 && p.y < 10 && p.z < 10;
    const auto n = tree.nearest(p, 20.0);
    wrong += (n->distance_mm < 0.0) != inside && n->distance_mm != 0.0 ? 1U : 0U;
  }
  EXPECT_EQ(wrong, 0U);
}

TEST(Welded, MakesASurfaceOfASoup) {
  const TriMesh cube = box_solid({0, 0, 0}, {10, 10, 10});
  TriMesh soup;
  for (const auto& t : cube.triangles) {
    const auto n = static_cast<std::uint32_t>(soup.vertices_mm.size());
    for (const std::uint32_t k : t) soup.vertices_mm.push_back(cube.vertices_mm[k]);
    soup.triangles.push_back({n, n + 1, n + 2});
  }
  EXPECT_TRUE(MeshDistance(soup).nearest({10.5, 10.5, 5.0}, 5.0)->border);
  const TriMesh whole = welded(soup);
  EXPECT_FALSE(MeshDistance(whole).nearest({10.5, 10.5, 5.0}, 5.0)->border);
}

}  // namespace
}  // namespace maquette::scan
