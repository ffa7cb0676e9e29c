// SPDX-License-Identifier: GPL-3.0-or-later

// What is claimed in scan/check_stations.hpp: scanners on the right and the wrong side of the part,
// in any frame; two stations of one file that agree (20 seeds, none is called stray), and one of
// which is displaced by known amounts or stands quite elsewhere.

#include "scan/check_stations.hpp"

#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "support/matchers.hpp"
#include "support/scan_terrain.hpp"

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
