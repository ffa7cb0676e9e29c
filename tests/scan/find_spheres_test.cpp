// SPDX-License-Identifier: GPL-3.0-or-later

// What is claimed in scan/find_spheres.hpp, and how each claim is attacked. One scene: rough ground
// with five datum spheres of 12 mm on it, of which one was taken away and one is mostly hidden; two
// spheres of 12 mm that are no datums, one of 12.6 mm, and four stones of their size that are
// nearly round. Each is seen from one side only, in any frame.
//
//   found ........ the spheres that are there, and nothing else; 6 seeds, with and without station
//   centre ....... within three stated standard deviations (chi-squared over all seeds)
//   match ........ the pose, within its covariance; the missing datum is named; all wrong spheres
//   out refused ...... two spheres, a symmetric arrangement, datums on a line

#include "scan/find_spheres.hpp"

#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <Eigen/Dense>

#include "assets/rocks.hpp"
#include "core/random.hpp"
#include "support/matchers.hpp"
#include "support/scan_terrain.hpp"

namespace maquette::scan {
namespace {

using heightmap::ModelField;
using testing_support::FailsWith;
using testing_support::points_on;
using testing_support::random_pose;
using testing_support::rough_part;
using testing_support::seen_from;
using testing_support::Succeeds;

constexpr double kRadius = 12.0;
constexpr double kNoise = 0.1;

Datum sphere_datum(std::string name, Vec3 at) {
  Datum d;
  d.kind = Datum::Kind::sphere;
  d.name = std::move(name);
  d.at_mm = at;
  d.radius_mm = kRadius;
  return d;
}

/// Points of a sphere that look at the station at less than 75 degrees and lie above `lowest`
/// radii; noise along the line of sight.
void add_sphere(Cloud& cloud, Vec3 centre, double radius, Vec3 station, std::uint64_t seed,
                double lowest = -0.7) {
  for (std::uint64_t i = 0; i < 4'000; ++i) {
    const Vec3 n = normalized(Vec3{random_normal(seed, 3 * i), random_normal(seed, 3 * i + 1),
                                   random_normal(seed, 3 * i + 2)});
    const Vec3 p = centre + radius * n, look = normalized(station - p);
    if (n.z < lowest || dot(n, look) < 0.26) continue;
    cloud.points_mm.push_back(p + kNoise * random_normal(seed + 77, i) * look);
  }
}

struct Scene {
  Cloud cloud;
  std::vector<Datum> datums;
  std::vector<Vec3> there;  ///< centres of spheres of the radius
};

Scene scene_of(std::uint64_t seed) {
  Scene s;
  const Vec3 station{200.0, -600.0, 500.0};
  const ModelField ground = rough_part(seed, 401, 401, 1.0, 0.6);
  s.cloud = points_on(ground, 160'000, seed, kNoise);
  s.cloud.station_mm = station;
  const auto on = [&](double x, double y, double r) {
    return Vec3{x, y, heightmap::height_at(ground, x, y) + 0.8 * r};
  };
  const std::vector<Vec3> places{on(60, 50, kRadius), on(350, 70, kRadius), on(330, 340, kRadius),
                                 on(40, 300, kRadius), on(200, 210, kRadius)};
  for (std::size_t k = 0; k < places.size(); ++k)
    s.datums.push_back(sphere_datum(std::string(1, static_cast<char>('A' + k)), places[k]));
  for (std::size_t k = 0; k < 4; ++k) {  // E is not there
    // Of D only what is above two fifths of its radius: less than a quarter of the sphere.
    add_sphere(s.cloud, places[k], kRadius, station, 100 * seed + k, k == 3 ? 0.4 : -0.7);
    s.there.push_back(places[k]);
  }
  for (const Vec3 p : {on(120, 120, kRadius), on(260, 130, kRadius)}) {
    add_sphere(s.cloud, p, kRadius, station, 100 * seed + 20 + s.there.size());
    s.there.push_back(p);
  }
  add_sphere(s.cloud, on(180, 330, 12.6), 12.6, station, 100 * seed + 30);
  for (std::uint64_t k = 0; k < 4; ++k) {
    assets::RockShape shape;
    shape.seed = 10 * seed + k;
    shape.elongation = 0.95;
    shape.flatness = 0.92;
    shape.roughness = 0.03;
    shape.subdivisions = 5;
    const TriMesh rock = assets::make_rock(shape);
    const Vec3 at = on(100.0 + 60.0 * static_cast<double>(k), 270.0, kRadius);
    const double size = 2.0 * kRadius / norm(rock.bounds().max - rock.bounds().min) * 1.7;
    for (std::size_t i = 0; i < rock.triangles.size(); ++i) {
      const auto& t = rock.triangles[i];
      const Vec3 a = rock.vertices_mm[t[0]], b = rock.vertices_mm[t[1]], c = rock.vertices_mm[t[2]];
      const Vec3 n = normalized(cross(b - a, c - a)), p = at + (size / 3.0) * (a + b + c);
      const Vec3 look = normalized(station - p);
      if (dot(n, look) > 0.26)
        s.cloud.points_mm.push_back(p + kNoise * random_normal(seed + 5, 1000 * k + i) * look);
    }
  }
  return s;
}

class FindSpheresSeeded : public testing::TestWithParam<int> {};
INSTANTIATE_TEST_SUITE_P(Seed, FindSpheresSeeded, testing::Range(1, 7));

TEST_P(FindSpheresSeeded, AndMatchesThem) {
  const auto seed = static_cast<std::uint64_t>(GetParam());
  const Scene scene = scene_of(seed);
  const RigidTransform pose = random_pose(seed, {200, 200, 10}, 2.5, 3000.0);
  Cloud seen = seen_from(scene.cloud, pose);
  if (seed % 2 == 0) seen.station_mm.reset();
  const auto found = find_spheres(seen, std::array{kRadius});
  ASSERT_THAT(found, Succeeds());
  EXPECT_EQ(found->size(), scene.there.size());
  double chi2 = 0.0;
  for (const Vec3& centre : scene.there) {
    const Vec3 at = pose.point(centre);
    const auto f = std::min_element(found->begin(), found->end(),
                                    [&](const FoundSphere& a, const FoundSphere& b) {
                                      return norm(a.centre_mm - at) < norm(b.centre_mm - at);
                                    });
    ASSERT_NE(f, found->end());
    const Vec3 off = f->centre_mm - at;
    EXPECT_LT(norm(off), 0.1) << "seed " << seed;
    EXPECT_LT(f->sigma_mm, 0.05);
    const Eigen::Vector3d e{off.x, off.y, off.z};
    chi2 += e.dot(Eigen::Map<const Eigen::Matrix3d>(f->covariance.data()).ldlt().solve(e));
  }
  // 18 degrees of freedom, 0.1 % beyond 42; six seeds.
  EXPECT_LT(chi2, 46.0) << "seed " << seed;

  const auto match = match_spheres(*found, scene.datums);
  ASSERT_THAT(match, Succeeds());
  EXPECT_THAT(match->matched, testing::ElementsAre("A", "B", "C", "D"));
  EXPECT_THAT(match->missing, testing::ElementsAre("E"));
  const RigidTransform error = match->model_from_scan * pose;
  const Registration& r = match->registration;
  const Vec3 shift = error.point(r.centre_mm) - r.centre_mm;
  Eigen::Matrix<double, 6, 1> e;
  e << shift.x, shift.y, shift.z, 2.0 * error.rotation.x, 2.0 * error.rotation.y,
      2.0 * error.rotation.z;
  const auto c = Eigen::Map<const Eigen::Matrix<double, 6, 6>>(r.covariance.data());
  EXPECT_LT(e.dot(c.ldlt().solve(e)), 24.0) << "6 degrees of freedom, 0.05 %";
  EXPECT_LT(r.sigma_translation_mm, 0.03);
}

FoundSphere found_at(Vec3 at) {
  FoundSphere f;
  f.centre_mm = at;
  f.radius_mm = kRadius;
  f.covariance = {1e-4, 0, 0, 0, 1e-4, 0, 0, 0, 1e-4};
  f.sigma_mm = 0.01;
  return f;
}

TEST(MatchSpheres, RefusesWhatGivesNoPose) {
  const std::vector<Vec3> places{{0, 0, 0}, {100, 0, 0}, {0, 80, 0}, {130, 90, 20}};
  std::vector<Datum> datums;
  std::vector<FoundSphere> found;
  for (const Vec3& p : places) {
    datums.push_back(sphere_datum("d", p));
    found.push_back(found_at(p + Vec3{5, 5, 5}));
  }
  const auto good = match_spheres(found, datums);
  ASSERT_THAT(good, Succeeds());
  EXPECT_LT(norm(good->model_from_scan.translation_mm - Vec3{-5, -5, -5}), 1e-9);
  EXPECT_THAT(match_spheres(std::span(found).first(2), datums), FailsWith(kSpheres));
  EXPECT_THAT(match_spheres(found, std::span(datums).first(2)), FailsWith(kSpheres));
  // A square: it fits turned by a quarter, too.
  std::vector<Datum> square;
  std::vector<FoundSphere> seen;
  for (const Vec3 p : {Vec3{0, 0, 0}, Vec3{100, 0, 0}, Vec3{100, 100, 0}, Vec3{0, 100, 0}}) {
    square.push_back(sphere_datum("d", p));
    seen.push_back(found_at(p));
  }
  const auto symmetric = match_spheres(seen, square);
  ASSERT_THAT(symmetric, FailsWith(kSpheres));
  EXPECT_THAT(symmetric.error().message, testing::HasSubstr("symmetry"));
  std::vector<Datum> line;
  seen.clear();
  for (const double x : {0.0, 50.0, 120.0, 210.0}) {
    line.push_back(sphere_datum("d", {x, 0.0, 0.0}));
    seen.push_back(found_at({x, 0.0, 0.0}));
  }
  EXPECT_THAT(match_spheres(seen, line), FailsWith(kSpheres));
  EXPECT_THAT(find_spheres(Cloud{}, std::array{-1.0}), FailsWith(kSpheres));
}

}  // namespace
}  // namespace maquette::scan
