// SPDX-License-Identifier: GPL-3.0-or-later

// Points that an edge has mixed with the ground behind it are kept apart for the stones, in the
// model frame: each lies on a beam that passes the edge.

#include <cmath>
#include <cstdio>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/files.hpp"
#include "heightmap/field_io.hpp"
#include "scan/cloud_stream.hpp"
#include "support/matchers.hpp"
#include "support/program.hpp"
#include "support/scan_terrain.hpp"
#include "tools/measured_part.hpp"

namespace maquette::tools {
namespace {

using testing_support::ScratchFolder;
using testing_support::Succeeds;

constexpr std::uint64_t kSeed = 17;
constexpr double kLow = 60.0, kHigh = 90.0, kTall_mm = 25.0;  // of a block

/// Of a segment from one place to another: the least distance to the block's upper edges.
double from_edges(Vec3 from, Vec3 to) {
  double least = INFINITY;
  for (int k = 0; k <= 2000; ++k) {
    const Vec3 p = from + (k / 2000.0) * (to - from);
    const double dx = std::fmax(std::fmax(kLow - p.x, p.x - kHigh), 0.0),
                 dy = std::fmax(std::fmax(kLow - p.y, p.y - kHigh), 0.0);
    const double inside =
        std::fmin(std::fmin(p.x - kLow, kHigh - p.x), std::fmin(p.y - kLow, kHigh - p.y));
    const double across = dx > 0.0 || dy > 0.0 ? std::hypot(dx, dy) : inside;
    // Upright edges, too: below the top only what is across counts.
    const double above = p.z - kTall_mm;
    const double corner = std::hypot(std::fmin(std::abs(p.x - kLow), std::abs(p.x - kHigh)),
                                     std::fmin(std::abs(p.y - kLow), std::abs(p.y - kHigh)));
    least = std::fmin(least, std::hypot(across, above));
    if (above < 0.0) least = std::fmin(least, corner);
  }
  return least;
}

TEST(MeasuredPart, KeepsWhatEdgesHaveMixed) {
  const ScratchFolder scratch;
  std::printf("seed %llu\n", static_cast<unsigned long long>(kSeed));
  heightmap::ModelField design{Grid<float>(301, 301), Millimetres{0.5}, Millimetres{0.0},
                               Millimetres{0.0}};
  for (std::ptrdiff_t r = 0; r < 301; ++r)
    for (std::ptrdiff_t c = 0; c < 301; ++c) {
      const double x = design.x_mm(c), y = design.y_mm(r);
      design.z_mm(r, c) = static_cast<float>(1.5 * std::sin(x / 20.0) + 1.5 * std::cos(y / 16.0));
      if (x < kLow || x > kHigh || y < kLow || y > kHigh) continue;
      design.z_mm(r, c) = static_cast<float>(kTall_mm);
    }
  ASSERT_THAT(heightmap::write_model_field(design, scratch / "design.tif"), Succeeds());
  const Vec3 station{75.0, -500.0, 400.0};
  const auto scanned = testing_support::run_program(
      scratch.path(), "scan design.tif --station-mm 75 -500 400 --max-points 150000 --out s.ply",
      "cd '" + scratch.path().string() + "' &&");
  ASSERT_EQ(scanned.exit_code, 0) << scanned.err;
  auto cloud = scan::read_cloud(scratch / "s.ply");
  ASSERT_THAT(cloud, Succeeds());
  cloud->station_mm = station;
  const RigidTransform elsewhere = testing_support::random_pose(kSeed, {75, 75, 10}, 0.02, 3.0);
  const scan::Cloud seen = testing_support::seen_from(*cloud, elsewhere);
  ASSERT_THAT(scan::write_cloud(seen, scratch / "s.ply"), Succeeds());
  const Vec3 at = elsewhere.point(station);
  ASSERT_THAT(write_file(scratch / "case.toml",
                         "schema = \"maquette.case/1\"\ndesign = \"design.tif\"\n[[scan]]\npoints "
                         "= \"s.ply\"\nbeam_diameter_mm = 3.2\nscanner_position_mm = [" +
                             std::to_string(at.x) + ", " + std::to_string(at.y) + ", " +
                             std::to_string(at.z) + "]\n"),
              Succeeds());
  const auto input = read_case(scratch / "case.toml");
  ASSERT_THAT(input, Succeeds());
  NominalPart nominal;
  ASSERT_THAT(read_nominal(nominal, **input, {}), Succeeds());
  MeasuredPart all;
  ASSERT_THAT(add_scan(all, (*input)->scans.front(), **input, nominal, {}), Succeeds());
  ASSERT_EQ(all.figures.size(), 1U);
  const MixedPoints& mixed = all.mixed;
  // A block 30 mm wide in front of ground some 40 mm behind its edge; 0.4 mm from point to point.
  EXPECT_GT(mixed.points_mm.size(), 100U);
  EXPECT_LE(mixed.points_mm.size(), all.figures[0].mixed);
  ASSERT_EQ(mixed.views.size(), 1U);
  EXPECT_EQ(mixed.views[0].points, mixed.points_mm.size());
  EXPECT_EQ(mixed.scan_of_view, std::vector<std::size_t>{0});
  ASSERT_TRUE(mixed.views[0].station_mm.has_value());
  // 0.3 mm of noise, 150 000 points: some microradians, 640 mm away.
  EXPECT_LT(norm(*mixed.views[0].station_mm - station), 0.5);
  std::size_t far = 0;
  for (const Vec3& p : mixed.points_mm)
    // One and a half 1/e^2 radii, beyond which is a thousandth of a beam, and a step.
    if (from_edges(station, p) > 1.5 * 0.5 * 3.2 + 0.5) ++far;
  // Waves have no edges. In the scan's frame nearly all would be beside the block.
  EXPECT_LT(static_cast<double>(far), 0.06 * static_cast<double>(mixed.points_mm.size()))
      << mixed.points_mm.size();
}

}  // namespace
}  // namespace maquette::tools
