// SPDX-License-Identifier: GPL-3.0-or-later

// What is claimed in scan/check_stations.hpp: scanners on the right and the wrong side of the part,
// a mesh too, in any frame; columns of simulated phase-shift and structured-light scans, which meet
// where the scanner stands, and say so where another place is stated; the density of 144 scans
// without a grid, as they are, thinned at random, by voxels, to a raster, and without what met the
// surface at a grazing angle: none is refused where its place is right, and as they are all are
// where it is not; two stations of one file that agree (20 seeds, none is called stray), and one of
// which is displaced by known amounts or stands quite elsewhere.

#include "scan/check_stations.hpp"

#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <set>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "assets/devices.hpp"
#include "core/random.hpp"
#include "scan/scanner_sim.hpp"
#include "scan/structured_light.hpp"
#include "support/matchers.hpp"
#include "support/scan_terrain.hpp"
#include "support/simple_solids.hpp"

namespace maquette::scan {
namespace {

using heightmap::ModelField;
using testing::HasSubstr;
using testing_support::FailsWith;
using testing_support::points_on;
using testing_support::random_pose;
using testing_support::rough_part;
using testing_support::seen_from;
using testing_support::Succeeds;

TEST(Viewpoints, OnTheWrongSideAreRefused) {
  const ModelField part = rough_part(3, 151, 151, 1.0);
  Cloud cloud = points_on(part, 20'000, 5, 0.05);
  const RigidTransform other = random_pose(4, {75, 75, 10}, 2.0, 900.0);
  for (const auto& [z, good] : {std::pair{900.0, true}, {-900.0, false}}) {
    cloud.station_mm = Vec3{75.0, -400.0, z};
    const Cloud seen = seen_from(cloud, other);
    const auto checked = check_viewpoints(seen, other.inverse(), part);
    if (good) {
      EXPECT_THAT(checked, Succeeds());
      continue;
    }
    ASSERT_THAT(checked, FailsWith(kStationPose));
    EXPECT_THAT(checked.error().message, HasSubstr("x 75.0, y -400.0, z -900.0 mm"));
    EXPECT_THAT(checked.error().message, HasSubstr("100 %"));
  }
  cloud.station_mm.reset();
  EXPECT_THAT(check_viewpoints(cloud, {}, part), Succeeds()) << "not known";
}

// Half a ball is seen from a place far away, and from its opposite none of that half.
TEST(Viewpoints, OnTheWrongSideOfAMeshAreRefused) {
  const TriMesh ball = testing_support::sphere_solid({10, 20, 30}, 50.0, 90);
  const MeshDistance mesh(ball);
  const Vec3 aside = normalized(Vec3{2.0, -1.0, -2.0});  // heights would not show it
  Cloud cloud;
  for (std::uint64_t i = 0; i < 20'000; ++i) {
    const Vec3 n = normalized(
        Vec3{random_normal(1, 3 * i), random_normal(1, 3 * i + 1), random_normal(1, 3 * i + 2)});
    // From 1000 mm all is seen that is 50 / 1000 or more up: the rim of the sight.
    if (dot(n, aside) > 0.05)
      cloud.points_mm.push_back(Vec3{10, 20, 30} + (50.0 + 0.05 * random_normal(2, i)) * n);
  }
  cloud.station_mm = Vec3{10, 20, 30} + 1000.0 * aside;
  EXPECT_THAT(check_viewpoints(cloud, {}, mesh), Succeeds());
  cloud.station_mm = Vec3{10, 20, 30} - 1000.0 * aside;
  const auto checked = check_viewpoints(cloud, {}, mesh);
  ASSERT_THAT(checked, FailsWith(kStationPose));
  EXPECT_THAT(checked.error().message, HasSubstr("100 %"));
  cloud.points_mm = {{500, 500, 500}};
  EXPECT_THAT(check_viewpoints(cloud, {}, mesh), Succeeds()) << "nothing of the part";
}

constexpr Vec3 kTarget{100.0, 100.0, 10.0};

ModelField hilly(std::uint64_t seed) {
  return rough_part(seed, 201, 201, 1.0);
}

Cloud phase_shift(const ModelField& part, Vec3 station, std::uint64_t seed) {
  ScanOptions o;
  o.scanner = *assets::find_preset(assets::scanner_presets(), "zf5006h");
  o.station_mm = station;
  o.seed = seed;
  o.footprint_rays = 1;
  o.max_points = 4'000'000;
  // What an instrument in good order has left (some 10 arc seconds), beside its circles' noise.
  o.angular = {.encoder_noise_rad = 3e-5, .collimation_rad = 5e-5, .trunnion_rad = 5e-5};
  auto cloud = simulate_scan(part, {}, o);
  return cloud ? *std::move(cloud) : Cloud{};
}

Cloud structured_light(const ModelField& part, Vec3 station, std::uint64_t seed) {
  StructuredLightOptions o;
  o.scanner = *assets::find_preset(assets::structured_light_presets(), "structured_light");
  o.model_from_station = look_at(station, kTarget);
  o.max_points = 200'000;
  o.seed = seed;
  auto cloud = simulate_structured_light(part, {}, o);
  return cloud ? *std::move(cloud) : Cloud{};
}

using Scanner = Cloud (*)(const ModelField&, Vec3, std::uint64_t);
class SightPlanes : public testing::TestWithParam<std::pair<Scanner, double>> {};

TEST_P(SightPlanes, MeetWhereTheScannerStands) {
  const auto [scan, range] = GetParam();
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    const ModelField part = hilly(seed);
    const double heading = static_cast<double>(seed);
    const Vec3 stands{100.0 + 0.7 * range * std::cos(heading),
                      100.0 + 0.7 * range * std::sin(heading), 0.7 * range};
    Cloud cloud = scan(part, stands, seed);
    // As files round them: 0.01 mm.
    for (Vec3& p : cloud.points_mm)
      p = {std::round(100.0 * p.x) / 100.0, std::round(100.0 * p.y) / 100.0,
           std::round(100.0 * p.z) / 100.0};
    ASSERT_GT(cloud.points_mm.size(), 20'000U);
    cloud.stations.clear();
    cloud.station_mm = stands;
    EXPECT_THAT(check_sight_planes(cloud), Succeeds()) << "seed " << seed;
    // Seen in another frame the same.
    const RigidTransform other = random_pose(seed, {100, 100, 10}, 1.0, 500.0);
    EXPECT_THAT(check_sight_planes(seen_from(cloud, other)), Succeeds()) << "seed " << seed;
    // Beside it, at the same height and distance: the right side of the part.
    cloud.station_mm = stands + 0.2 * range * Vec3{-std::sin(heading), std::cos(heading), 0.0};
    const auto checked = check_sight_planes(cloud);
    ASSERT_THAT(checked, FailsWith(kStationPose)) << "seed " << seed;
    double x = 0.0, y = 0.0, z = 0.0;
    ASSERT_EQ(std::sscanf(checked.error().message.c_str(),
                          "columns of the scan meet at x %lf, y %lf, z %lf", &x, &y, &z),
              3);
    // All columns hold the scanner's axis, so it is the distance from that which they tell:
    // vertical, or the camera's upward direction. Rounding (0.003 mm) over the relief (some 5 mm)
    // by the range and over the root of 10 000 points: some mm.
    const Vec3 axis = scan == phase_shift ? Vec3{0.0, 0.0, 1.0}
                                          : look_at(stands, kTarget).direction({0.0, 1.0, 0.0});
    EXPECT_LT(norm(cross(Vec3{x, y, z} - stands, axis)), 0.01 * range) << checked.error().message;
  }
}

TEST_P(SightPlanes, OfAFlatPartSayNothing) {
  const auto [scan, range] = GetParam();
  const ModelField flat{Grid<float>(201, 201, 10.0F), Millimetres{1.0}, Millimetres{0.0},
                        Millimetres{0.0}};
  Cloud cloud = scan(flat, {100.0, -0.6 * range, 0.7 * range}, 3);
  cloud.stations.clear();
  cloud.station_mm = Vec3{100.0 + 0.2 * range, -0.6 * range, 0.7 * range};
  EXPECT_THAT(check_sight_planes(cloud), Succeeds());
}

TEST_P(SightPlanes, WithoutAGridPass) {
  const auto [scan, range] = GetParam();
  Cloud cloud = scan(hilly(1), {100.0, -0.6 * range, 0.7 * range}, 3);
  cloud.stations.clear();
  cloud.grid.clear();
  cloud.station_mm = Vec3{100.0 + 0.2 * range, -0.6 * range, 0.7 * range};
  EXPECT_THAT(check_sight_planes(cloud), Succeeds());
}

enum class Thinned { no, at_random, by_voxels, by_small_voxels, to_raster, where_grazing };

/// Without a grid, as other programs write clouds.
Cloud loose(const Cloud& cloud, Vec3 station, const ModelField& part, Thinned thinned) {
  // One and a half points a voxel, or four.
  const double point_mm = std::sqrt(200.0 * 200.0 / static_cast<double>(cloud.points_mm.size()));
  const double voxel = (thinned == Thinned::by_small_voxels ? 1.2 : 2.0) * point_mm;
  std::set<std::array<std::int64_t, 3>> voxels;
  Cloud some;
  some.station_mm = station;
  for (std::size_t i = 0; i < cloud.points_mm.size(); ++i) {
    const Vec3 p = cloud.points_mm[i];
    bool stays = true;
    if (thinned == Thinned::at_random) stays = random_uniform(7, i) < 0.5;
    if (thinned == Thinned::by_voxels || thinned == Thinned::by_small_voxels ||
        thinned == Thinned::to_raster)
      stays = voxels
                  .insert({std::llround(p.x / voxel), std::llround(p.y / voxel),
                           thinned == Thinned::to_raster ? 0 : std::llround(p.z / voxel)})
                  .second;
    if (thinned == Thinned::where_grazing) {
      const auto h = [&](double dx, double dy) {
        return heightmap::height_at(part, p.x + dx, p.y + dy);
      };
      const Vec3 normal = normalized(
          Vec3{0.5 * (h(-1.0, 0.0) - h(1.0, 0.0)), 0.5 * (h(0.0, -1.0) - h(0.0, 1.0)), 1.0});
      stays = random_uniform(8, i) < dot(normal, normalized(station - p));
    }
    if (stays) some.points_mm.push_back(p);
  }
  return some;
}

// 12 scans of each scanner in six states, from 30, 42 and 54 degrees above the part.
TEST_P(SightPlanes, DensityIsThatOfTheScannersPlace) {
  const auto [scan, range] = GetParam();
  for (std::uint64_t seed = 1; seed <= 12; ++seed) {
    const ModelField part = hilly(seed);
    const double heading = 1.7 * static_cast<double>(seed);
    const double up = (30.0 + 12.0 * static_cast<double>(seed % 3)) * 0.017453292519943295;
    const auto at = [&](double turn) {
      return kTarget + range * Vec3{std::cos(up) * std::cos(heading + turn),
                                    std::cos(up) * std::sin(heading + turn), std::sin(up)};
    };
    const Cloud raw = scan(part, at(0.0), seed);
    ASSERT_GT(raw.points_mm.size(), 20'000U);
    const RigidTransform other = random_pose(seed, {100, 100, 10}, 1.0, 500.0);
    for (const Thinned thinned :
         {Thinned::no, Thinned::at_random, Thinned::by_voxels, Thinned::by_small_voxels,
          Thinned::to_raster, Thinned::where_grazing}) {
      const Cloud cloud = seen_from(loose(raw, at(0.0), part, thinned), other);
      EXPECT_THAT(check_density(cloud, other.inverse(), part), Succeeds())
          << "seed " << seed << ", " << static_cast<int>(thinned);
    }
    for (const double turn : {0.7, 1.6, 3.1}) {
      const auto checked = check_density(loose(raw, at(turn), part, Thinned::no), {}, part);
      ASSERT_THAT(checked, FailsWith(kStationPose)) << "seed " << seed << ", " << turn;
      Vec3 p;
      ASSERT_EQ(std::sscanf(checked.error().message.c_str(),
                            "the scan's points lie as dense as from x %lf, y %lf, z %lf", &p.x,
                            &p.y, &p.z),
                3);
      // Steps of five degrees, and what chance adds.
      EXPECT_LT(norm(p - at(0.0)), 0.25 * range) << "seed " << seed << ", " << turn;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Scanners, SightPlanes,
                         testing::Values(std::pair<Scanner, double>{phase_shift, 1500.0},
                                         std::pair<Scanner, double>{structured_light, 550.0}),
                         [](const auto& of) { return of.index == 0 ? "PhaseShift" : "Camera"; });

/// Two stations of 20 000 points; the second one's are moved.
Cloud two_stations(const ModelField& part, std::uint64_t seed, const RigidTransform& moved) {
  Cloud cloud = points_on(part, 40'000, seed, 0.05);
  for (std::size_t i = 20'000; i < 40'000; ++i)
    cloud.points_mm[i] = moved.point(cloud.points_mm[i]);
  cloud.stations.resize(2);
  for (ScanStation& s : cloud.stations) s.points = 20'000;
  cloud.stations[1].name = "west";
  return cloud;
}

TEST(Stations, ThatAgreeAreNotStray) {
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    const ModelField part = rough_part(seed, 151, 151, 1.0);
    const Cloud cloud = two_stations(part, seed, {});
    const auto found = register_scan(cloud, part);
    ASSERT_THAT(found, Succeeds());
    EXPECT_TRUE(stray_stations(cloud, *found, part).empty()) << "seed " << seed;
  }
}

TEST(Stations, ThatDisagreeAreNamedWithTheirDistance) {
  const ModelField part = rough_part(8, 151, 151, 1.0);
  for (const double d : {0.1, 0.5, 2.0}) {
    const Vec3 shift{0.6 * d, -0.8 * d, 0.0};
    const Cloud cloud = two_stations(part, 2, {{}, shift});
    const auto found = register_scan(cloud, part);
    ASSERT_THAT(found, Succeeds()) << d;
    const auto stray = stray_stations(cloud, *found, part);
    ASSERT_FALSE(stray.empty()) << d;
    // Together they are between both, or at one of them: distances add up to the shift.
    double sum = 0.0;
    for (const StrayStation& s : stray) sum += s.off_mm;
    EXPECT_NEAR(sum, d, 0.03 + (stray.size() == 1 ? 0.05 : 0.0)) << d;
    EXPECT_EQ(stray.back().name, "west");
  }
}

TEST(Stations, ThatStandElsewhereAreNamed) {
  const ModelField part = rough_part(8, 151, 151, 1.0);
  const Cloud cloud = two_stations(part, 2, {{}, {400.0, 0.0, 0.0}});
  RegisterOptions there;
  there.anywhere = false;
  const auto found = register_scan(cloud, part, there);
  ASSERT_THAT(found, Succeeds());
  const auto stray = stray_stations(cloud, *found, part);
  ASSERT_EQ(stray.size(), 1U);
  EXPECT_EQ(stray[0].name, "west");
  EXPECT_TRUE(std::isnan(stray[0].off_mm));
}

}  // namespace
}  // namespace maquette::scan
