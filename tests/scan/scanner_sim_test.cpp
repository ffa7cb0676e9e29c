// SPDX-License-Identifier: GPL-3.0-or-later

// What is claimed in scan/scanner_sim.hpp, and how each claim is attacked:
//
//   ranges and directions ............ a flat part without noise: every point lies on it,
//                                      neighbours stand one angular step apart
//   every direction that can hit ..... counted against a slow loop over the whole sphere,
//                                      stations beside, above and over a corner
//   stones ........................... a sphere: points on it within its facets, what it
//                                      hides is not seen
//   walls hide ....................... a low station sees nothing of the far rim's inside
//   noise ............................ its deviation by range and incidence, mean zero
//   quantised ........................ ranges are whole steps
//   max_points ....................... never exceeded, steps grow evenly
//   seed, threads .................... same bits; another seed, other noise
//   every code ....................... one case each

#include "scan/scanner_sim.hpp"

#include <cmath>
#include <numbers>
#include <set>
#include <stop_token>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <oneapi/tbb/global_control.h>

#include "heightmap/field_tracer.hpp"
#include "scan/surface_distance.hpp"
#include "support/matchers.hpp"
#include "support/scan_terrain.hpp"

namespace maquette::scan {
namespace {

using heightmap::ModelField;
using testing_support::FailsWith;
using testing_support::rough_part;
using testing_support::Succeeds;

ScanOptions exact_scanner(double lines_per_turn, Vec3 station) {
  ScanOptions o;
  o.scanner.name = "test";
  o.scanner.lines_per_turn = lines_per_turn;
  o.station_mm = station;
  return o;
}

/// A sphere of latitude bands, closed.
TriMesh sphere(Vec3 centre, double radius, std::uint32_t bands) {
  TriMesh m;
  const std::uint32_t around = 2 * bands;
  m.vertices_mm.push_back(centre + Vec3{0, 0, radius});
  for (std::uint32_t i = 1; i < bands; ++i)
    for (std::uint32_t j = 0; j < around; ++j) {
      const double theta = std::numbers::pi * i / bands, phi = 2.0 * std::numbers::pi * j / around;
      m.vertices_mm.push_back(centre + radius * Vec3{std::sin(theta) * std::cos(phi),
                                                     std::sin(theta) * std::sin(phi),
                                                     std::cos(theta)});
    }
  m.vertices_mm.push_back(centre - Vec3{0, 0, radius});
  const auto at = [&](std::uint32_t i, std::uint32_t j) {
    return 1 + (i - 1) * around + j % around;
  };
  const auto last = static_cast<std::uint32_t>(m.vertices_mm.size() - 1);
  for (std::uint32_t j = 0; j < around; ++j) {
    m.triangles.push_back({0, at(1, j), at(1, j + 1)});
    for (std::uint32_t i = 1; i + 1 < bands; ++i) {
      m.triangles.push_back({at(i, j), at(i + 1, j), at(i + 1, j + 1)});
      m.triangles.push_back({at(i, j), at(i + 1, j + 1), at(i, j + 1)});
    }
    m.triangles.push_back({at(bands - 1, j), last, at(bands - 1, j + 1)});
  }
  return m;
}

TEST(ScannerSim, PointsLieOnAFlatPart) {
  const ModelField flat{Grid<float>(101, 101, 5.0F), Millimetres{2.0}};
  const Vec3 station{100.0, -800.0, 900.0};
  const auto cloud = simulate_scan(flat, {}, exact_scanner(5000, station));
  ASSERT_THAT(cloud, Succeeds());
  EXPECT_EQ(cloud->station_mm, station);
  ASSERT_EQ(cloud->intensity.size(), cloud->points_mm.size());
  EXPECT_GT(cloud->points_mm.size(), 10'000U);
  const double step = 2.0 * std::numbers::pi / 5000;
  for (std::size_t i = 0; i < cloud->points_mm.size(); ++i) {
    const Vec3 ray = cloud->points_mm[i] - station;
    ASSERT_NEAR(cloud->points_mm[i].z, 5.0, 1e-11);
    // Grey, cosine of incidence, inverse square of the range.
    const double signal = 0.5 * -ray.z / norm(ray) * 9e6 / dot(ray, ray);
    ASSERT_NEAR(cloud->intensity[i], signal, 1e-6 * signal);
    // Whole steps of both angles.
    const double column = std::atan2(ray.y, ray.x) / step,
                 row = std::acos(ray.z / norm(ray)) / step;
    ASSERT_NEAR(column, std::round(column), 1e-7);
    ASSERT_NEAR(row, std::round(row), 1e-7);
  }
  // Order: column by column, in each from the zenith down.
  for (std::size_t i = 1; i < cloud->points_mm.size(); ++i) {
    const Vec3 a = cloud->points_mm[i - 1] - station, b = cloud->points_mm[i] - station;
    const double turn = std::atan2(b.y, b.x) - std::atan2(a.y, a.x);
    ASSERT_TRUE(turn > 0.5 * step || (std::abs(turn) < 0.5 * step && b.z / norm(b) < a.z / norm(a)))
        << i;
  }
}

TEST(ScannerSim, LooksIntoEveryDirectionThatCanHit) {
  const ModelField part = rough_part(3, 41, 61, 2.0, 3.0);
  const heightmap::FieldTracer tracer(part);
  for (const Vec3 station :
       {Vec3{60.0, -150.0, 200.0}, Vec3{-200.0, -150.0, 60.0}, Vec3{60.0, 40.0, 150.0},
        Vec3{-0.5, -0.5, 100.0}, Vec3{300.0, 40.0, 25.0}, Vec3{-80.0, 40.0, 90.0}}) {
    const int turn = 720;
    const double step = 2.0 * std::numbers::pi / turn;
    std::size_t expected = 0;
    for (int column = 0; column < turn; ++column)
      for (int row = 0; row <= turn / 2; ++row) {
        const double s = std::sin(step * row);
        const Vec3 d{s * std::cos(step * column), s * std::sin(step * column),
                     std::cos(step * row)};
        const auto hit = tracer.trace(station, d);
        if (hit && dot(hit->normal, d) < 0.0) ++expected;
      }
    const auto cloud = simulate_scan(part, {}, exact_scanner(turn, station));
    ASSERT_THAT(cloud, Succeeds());
    // A direction that grazes the outline may fall to either side by rounding.
    EXPECT_NEAR(static_cast<double>(cloud->points_mm.size()), static_cast<double>(expected), 3.0)
        << station.x << " " << station.y << " " << station.z;
    EXPECT_GT(expected, 100U);
  }
}

TEST(ScannerSim, SeesStonesAndNotWhatTheyHide) {
  const ModelField flat{Grid<float>(101, 101, 0.0F), Millimetres{2.0}};
  const Vec3 centre{100.0, 100.0, 8.0};
  const TriMesh ball = sphere(centre, 15.0, 90);
  const Vec3 station{100.0, -800.0, 600.0};
  const auto cloud = simulate_scan(flat, std::span(&ball, 1), exact_scanner(10'000, station));
  ASSERT_THAT(cloud, Succeeds());
  int on_ball = 0;
  for (const Vec3& p : cloud->points_mm) {
    const double r = norm(p - centre);
    if (p.z > 1e-9) {
      // Facets stand back from the sphere by at most R (1 - cos(pi / 90 / 2 * sqrt 2)).
      ASSERT_NEAR(r, 15.0, 15.0 * 3.1e-4) << p.x << " " << p.y << " " << p.z;
      ASSERT_LT(dot(p - centre, p - station), 0.5) << "the near side";
      ++on_ball;
      continue;
    }
    // Ground points: the line of sight does not pass through the ball.
    const Vec3 d = normalized(p - station);
    const Vec3 to = centre - station;
    const double across = norm(to - std::fmin(dot(to, d), norm(p - station)) * d);
    ASSERT_GT(across, 14.99) << p.x << " " << p.y;
  }
  EXPECT_GT(on_ball, 1000);
}

TEST(ScannerSim, RefinesStoneHitsInDouble) {
  // Far from the origin, single precision would be 1e-4 mm off along the ray.
  const ModelField flat{Grid<float>(11, 11, -50.0F), Millimetres{1.0}, Millimetres{1990.0},
                        Millimetres{1990.0}};
  TriMesh block;  // a tetrahedron with one level face up
  block.vertices_mm = {
      {1900, 1900, 10.1}, {2100, 1900, 10.1}, {2000, 2150, 10.1}, {2000, 2000, 0.0}};
  block.triangles = {{0, 1, 2}, {0, 3, 1}, {1, 3, 2}, {2, 3, 0}};
  const auto cloud =
      simulate_scan(flat, std::span(&block, 1), exact_scanner(20'000, {2000.0, 1000.0, 1500.0}));
  ASSERT_THAT(cloud, Succeeds());
  double worst = 0.0;
  for (const Vec3& p : cloud->points_mm)
    if (p.z > 9.0) worst = std::max(worst, std::abs(p.z - 10.1));
  EXPECT_LT(worst, 1e-9);
}

TEST(ScannerSim, WallsHideWhatIsBehindThem) {
  // A basin: rim at 10, inside at 0. From a station below the rim's height nothing of
  // the basin's floor can be seen through the wall.
  ModelField basin{Grid<float>(41, 41, 0.0F), Millimetres{1.0}};
  for (std::ptrdiff_t i = 0; i < 41; ++i)
    basin.z_mm(i, 0) = basin.z_mm(i, 40) = basin.z_mm(0, i) = basin.z_mm(40, i) = 10.0F;
  EXPECT_THAT(simulate_scan(basin, {}, exact_scanner(5000, {20.0, -100.0, 5.0})),
              FailsWith(kNothingHit));
  // A stone in the basin is hidden as well, unless it stands above the rim.
  const TriMesh low = sphere({20.0, 20.0, 3.0}, 2.0, 20), high = sphere({20.0, 20.0, 9.0}, 4.0, 20);
  EXPECT_THAT(simulate_scan(basin, std::span(&low, 1), exact_scanner(5000, {20.0, -100.0, 5.0})),
              FailsWith(kNothingHit));
  const auto top =
      simulate_scan(basin, std::span(&high, 1), exact_scanner(5000, {20.0, -100.0, 10.5}));
  ASSERT_THAT(top, Succeeds());
  for (const Vec3& p : top->points_mm) EXPECT_GT(p.z, 10.0 - 1.0);
}

TEST(ScannerSim, WhatIsBuriedIsBehindTheWall) {
  // Level ground at 10, a stone from 3 to 13: a ray below the ground's height meets no
  // terrain before the stone, only the wall.
  const ModelField flat{Grid<float>(41, 41, 10.0F), Millimetres{1.0}};
  const TriMesh stone = sphere({20.0, 20.0, 8.0}, 5.0, 30);
  const auto cloud =
      simulate_scan(flat, std::span(&stone, 1), exact_scanner(20'000, {20.0, -100.0, 9.0}));
  ASSERT_THAT(cloud, Succeeds());
  // Over the rim at y = 0 the line of sight is at 10 or higher, and it still rises.
  for (const Vec3& p : cloud->points_mm) ASSERT_GT(p.z, 10.0);
}

TEST(ScannerSim, AVoidIsAHole) {
  ModelField f{Grid<float>(41, 41, 0.0F), Millimetres{1.0}};
  for (std::ptrdiff_t r = 15; r < 25; ++r)
    for (std::ptrdiff_t c = 15; c < 25; ++c) f.z_mm(r, c) = NAN;
  const auto cloud = simulate_scan(f, {}, exact_scanner(5000, {20.0, -100.0, 100.0}));
  ASSERT_THAT(cloud, Succeeds());
  for (const Vec3& p : cloud->points_mm)
    EXPECT_FALSE(p.x > 14.0 && p.x < 25.0 && p.y > 15.0 && p.y < 24.0 && p.x - p.y < 0.0 &&
                 p.x > 15.0);
}

// ---- noise -----------------------------------------------------------------

TEST(ScannerSim, NoiseFollowsRangeAndIncidence) {
  assets::ScannerPreset s;
  s.range_sigma_mm = 0.4;
  EXPECT_DOUBLE_EQ(range_sigma_mm(s, 3000.0, 1.0), 0.4);
  EXPECT_DOUBLE_EQ(range_sigma_mm(s, 1500.0, 1.0), 0.2);
  EXPECT_DOUBLE_EQ(range_sigma_mm(s, 3000.0, 0.25), 0.8);
  EXPECT_DOUBLE_EQ(range_sigma_mm(s, 3000.0, 0.0), 4.0);

  const ModelField flat{Grid<float>(11, 11, 0.0F), Millimetres{20.0}};
  const Vec3 station{100.0, -1500.0, 1500.0};
  ScanOptions o = exact_scanner(20'000, station);
  o.scanner.range_sigma_mm = 0.4;
  const auto cloud = simulate_scan(flat, {}, o);
  ASSERT_THAT(cloud, Succeeds());
  double sum = 0.0, square = 0.0;
  for (const Vec3& p : cloud->points_mm) {
    const Vec3 d = normalized(p - station);
    const double range = -station.z / d.z;  // where the ray meets the part
    const double e = (norm(p - station) - range) / range_sigma_mm(o.scanner, range, -d.z);
    sum += e;
    square += e * e;
  }
  const auto n = static_cast<double>(cloud->points_mm.size());
  ASSERT_GT(n, 10'000);
  EXPECT_NEAR(sum / n, 0.0, 4.0 / std::sqrt(n));
  EXPECT_NEAR(square / n, 1.0, 4.0 * std::sqrt(2.0 / n));
}

TEST(ScannerSim, RangesAreWholeSteps) {
  const ModelField part = rough_part(1, 41, 41, 2.0);
  ScanOptions o = exact_scanner(5000, {40.0, -300.0, 400.0});
  o.scanner.range_resolution_mm = 0.1;
  o.scanner.range_sigma_mm = 0.05;
  const auto cloud = simulate_scan(part, {}, o);
  ASSERT_THAT(cloud, Succeeds());
  for (const Vec3& p : cloud->points_mm) {
    const double steps = norm(p - o.station_mm) / 0.1;
    ASSERT_NEAR(steps, std::round(steps), 1e-8);
  }
}

TEST(ScannerSim, StaysBelowTheLimitOfPoints) {
  const ModelField flat{Grid<float>(51, 51, 0.0F), Millimetres{2.0}};
  std::string warning;
  RunContext run;
  run.warn = [&](const std::string& text) { warning = text; };
  for (const std::uint64_t limit : {16U, 100U, 5'000U, 20'000U}) {
    ScanOptions o = exact_scanner(1e9, {50.0, -200.0, 300.0});
    o.max_points = limit;
    const auto cloud = simulate_scan(flat, {}, o, run);
    ASSERT_THAT(cloud, Succeeds());
    EXPECT_LE(cloud->points_mm.size(), limit);
    if (limit >= 5'000) {
      EXPECT_GT(cloud->points_mm.size(), limit / 4) << "and is made use of";
    }
    EXPECT_THAT(warning, testing::HasSubstr("to stay below"));
  }
}

TEST(ScannerSim, GivesTheSameBitsForAnyNumberOfThreads) {
  const ModelField part = rough_part(2, 81, 81, 1.0);
  const TriMesh ball = sphere({40.0, 40.0, 12.0}, 6.0, 40);
  ScanOptions o = exact_scanner(8000, {40.0, -200.0, 200.0});
  o.scanner.range_sigma_mm = 0.5;
  const auto with_threads = [&](std::size_t n, std::uint64_t seed) {
    const oneapi::tbb::global_control limit(oneapi::tbb::global_control::max_allowed_parallelism,
                                            n);
    o.seed = seed;
    return simulate_scan(part, std::span(&ball, 1), o);
  };
  const auto one = with_threads(1, 7), four = with_threads(4, 7), other = with_threads(4, 8);
  ASSERT_THAT(one, Succeeds());
  EXPECT_EQ(one->points_mm, four->points_mm);
  EXPECT_EQ(one->intensity, four->intensity);
  ASSERT_EQ(one->points_mm.size(), other->points_mm.size());
  EXPECT_NE(one->points_mm, other->points_mm);
}

// ---- errors ----------------------------------------------------------------

TEST(ScannerSimRefuses, AStationInsideThePart) {
  const ModelField flat{Grid<float>(51, 51, 10.0F), Millimetres{2.0}};
  EXPECT_THAT(simulate_scan(flat, {}, exact_scanner(1000, {50.0, 50.0, 9.0})),
              FailsWith(kStationUnderSurface));
  EXPECT_THAT(simulate_scan(flat, {}, exact_scanner(1000, {50.0, 50.0, 10.0})),
              FailsWith(kStationUnderSurface));
  const TriMesh ball = sphere({50.0, 50.0, 20.0}, 5.0, 20);
  EXPECT_THAT(simulate_scan(flat, std::span(&ball, 1), exact_scanner(1000, {51.0, 50.0, 22.0})),
              FailsWith(kStationUnderSurface));
  EXPECT_THAT(simulate_scan(flat, std::span(&ball, 1), exact_scanner(1000, {51.0, 50.0, 26.0})),
              Succeeds());
}

TEST(ScannerSimRefuses, ToSeeNothing) {
  const ModelField flat{Grid<float>(51, 51, 10.0F), Millimetres{2.0}};
  EXPECT_THAT(simulate_scan(flat, {}, exact_scanner(1000, {50.0, -100.0, 5.0})),
              FailsWith(kNothingHit));
  const ModelField nothing{Grid<float>(51, 51, NAN), Millimetres{2.0}};
  EXPECT_THAT(simulate_scan(nothing, {}, exact_scanner(1000, {50.0, -100.0, 50.0})),
              FailsWith(kNothingHit));
}

TEST(ScannerSimRefuses, OptionsOutOfRange) {
  const ModelField flat{Grid<float>(51, 51, 10.0F), Millimetres{2.0}};
  const ScanOptions good = exact_scanner(1000, {50.0, -100.0, 100.0});
  std::vector<ScanOptions> bad(6, good);
  bad[0].scanner.lines_per_turn = 0.0;
  bad[1].scanner.lines_per_turn = NAN;
  bad[2].scanner.range_sigma_mm = -1.0;
  bad[3].scanner.range_resolution_mm = NAN;
  bad[4].max_points = 0;
  bad[5].station_mm.x = INFINITY;
  for (const ScanOptions& o : bad) EXPECT_THAT(simulate_scan(flat, {}, o), FailsWith(kScanOptions));
}

TEST(ScannerSimRefuses, ToGoOnWhenStopped) {
  const ModelField flat{Grid<float>(51, 51, 10.0F), Millimetres{2.0}};
  std::stop_source stop;
  stop.request_stop();
  RunContext run;
  run.stop = stop.get_token();
  EXPECT_THAT(simulate_scan(flat, {}, exact_scanner(1000, {50.0, -100.0, 100.0}), run),
              FailsWith(kCancelled));
}

}  // namespace
}  // namespace maquette::scan
