// SPDX-License-Identifier: GPL-3.0-or-later

// What is claimed in cnc/raster.hpp, and how it is attacked:
//
//   directions ............. every whole degree: as near as promised, exact at multiples of 45
//   rows ................... against a brute-force clip of each row place by place
//   stepover ............... gaps between rows, first and last on the edges along an axis
//   links .................. random pairs: unbroken, inside, as short as along plus across

#include "cnc/raster.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/random.hpp"

namespace maquette::cnc {
namespace {

bool inside(const RasterArea& a, const LatticeLine& line, std::int64_t k) {
  const std::int64_t x = line.x + k * line.dx, y = line.y + k * line.dy;
  return x >= a.left && x <= a.right && y >= a.bottom && y <= a.top;
}

TEST(Raster, DirectionsAreAsNearAsPromised) {
  for (int degree = -360; degree <= 360; ++degree) {
    const RasterFrame frame = raster_frame({0, 10000, 0, 10000}, degrees(degree));
    const double as_cut = std::atan2(static_cast<double>(frame.dy), static_cast<double>(frame.dx)) *
                          180.0 / std::numbers::pi;
    const double off = std::abs(std::remainder(as_cut - degree, 360.0));
    const double from_45 = std::abs(std::remainder(degree, 45.0));
    EXPECT_LE(off, from_45 < 0.5 ? 1e-9 : from_45 < 5.0 ? 0.91 : 0.5) << degree;
    EXPECT_EQ(frame.dx % kResolution, 0);
    EXPECT_EQ(frame.dy % kResolution, 0);
    EXPECT_LE(frame.step_mm(), 0.032 + 1e-12);
    if (degree % 90 == 0) {
      EXPECT_TRUE(frame.along_an_axis());
      EXPECT_DOUBLE_EQ(frame.step_mm(), 0.001);
    }
  }
}

class Rasters : public testing::TestWithParam<int> {};

TEST_P(Rasters, RowsAreClippedAndApartAsAsked) {
  const RasterArea area{-30010, 25000, 12500, 49990};
  const double degree = GetParam();
  const RasterFrame frame = raster_frame(area, degrees(degree));
  const auto rows = raster_rows(frame, area, 0.31);
  ASSERT_GE(rows.size(), 3U);
  const auto gap = static_cast<std::int64_t>(std::floor(0.31 / frame.step_mm() + 1e-6));
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const LatticeLine line = frame.row(rows[i].across);
    EXPECT_TRUE(inside(area, line, rows[i].first));
    EXPECT_TRUE(inside(area, line, rows[i].last));
    EXPECT_FALSE(inside(area, line, rows[i].first - 1));
    EXPECT_FALSE(inside(area, line, rows[i].last + 1));
    if (i == 0) continue;
    EXPECT_LE(rows[i].across - rows[i - 1].across, gap);
    if (i + 1 < rows.size()) {
      EXPECT_EQ(rows[i].across - rows[i - 1].across, gap);
    }
  }
  if (frame.along_an_axis()) {
    const auto at_edge = [&](const RasterRow& row) {
      const LatticeLine line = frame.row(row.across);
      return frame.dx == 0 ? line.x == area.left || line.x == area.right
                           : line.y == area.bottom || line.y == area.top;
    };
    EXPECT_TRUE(at_edge(rows.front()));
    EXPECT_TRUE(at_edge(rows.back()));
  }
}

TEST_P(Rasters, LinksAreUnbrokenInsideAndNoLongerThanAllowed) {
  const RasterArea area{-30010, 25000, 12500, 49990};
  const RasterFrame frame = raster_frame(area, degrees(GetParam()));
  const auto rows = raster_rows(frame, area, 0.31);
  const auto seed = static_cast<std::uint64_t>(GetParam() + 1000);
  std::size_t found = 0;
  for (std::uint64_t i = 0; i < 300; ++i) {
    const auto pick = [&](std::uint64_t k, std::int64_t low, std::int64_t high) {
      return low + static_cast<std::int64_t>(random_uniform(seed, 8 * i + k) *
                                             static_cast<double>(high - low + 1));
    };
    const auto last = static_cast<std::int64_t>(rows.size()) - 1;
    const RasterRow &a = rows[static_cast<std::size_t>(pick(0, 0, last))],
                    &b = rows[static_cast<std::size_t>(pick(1, 0, last))];
    const std::int64_t from = pick(2, a.first, a.last), to = pick(3, b.first, b.last);
    const auto way = link_inside(frame, area, a.across, from, b.across, to, 3.0);
    const double length =
        frame.step_mm() * static_cast<double>(std::abs(to - from) + std::abs(a.across - b.across));
    if (length > 3.0) {
      EXPECT_TRUE(way.empty());
      continue;
    }
    if (way.empty()) continue;  // neither row reaches below the other's end
    ++found;
    const LatticeLine start = frame.row(a.across), end = frame.row(b.across);
    std::int64_t x = start.x + from * start.dx, y = start.y + from * start.dy;
    double sum = 0.0;
    for (const LineSegment& s : way) {
      EXPECT_EQ(s.line.x + s.from * s.line.dx, x);
      EXPECT_EQ(s.line.y + s.from * s.line.dy, y);
      EXPECT_TRUE(inside(area, s.line, s.from));
      EXPECT_TRUE(inside(area, s.line, s.to));
      x = s.line.x + s.to * s.line.dx;
      y = s.line.y + s.to * s.line.dy;
      sum += s.length_mm();
    }
    EXPECT_EQ(x, end.x + to * end.dx);
    EXPECT_EQ(y, end.y + to * end.dy);
    EXPECT_NEAR(sum, length, 1e-9);
  }
  EXPECT_GT(found, 10U);
}
INSTANTIATE_TEST_SUITE_P(Degrees, Rasters,
                         testing::Values(0, 90, 180, 270, 45, 135, 30, -20, 77, 200, 301));

}  // namespace
}  // namespace maquette::cnc
