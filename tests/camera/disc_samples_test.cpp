// SPDX-License-Identifier: GPL-3.0-or-later

// camera/disc_samples.hpp:
//   the disc is covered evenly ....... moments and the share of an inner disc, with
//                                      less spread than independent points have
//   the mapping keeps areas .......... cells of the square counted in the disc
//   samples are a pure function ...... drawn twice

#include "camera/disc_samples.hpp"

#include <gtest/gtest.h>

namespace maquette::camera {
namespace {

class DiscSamples : public testing::TestWithParam<int> {};

TEST_P(DiscSamples, CoverTheDiscEvenly) {
  const int count = GetParam();
  constexpr int kPixels = 2000;
  double x = 0, y = 0, square = 0;
  int inner = 0;
  std::vector<DiscPoint> points;
  for (std::uint64_t pixel = 0; pixel < kPixels; ++pixel) {
    stratified_disc(count, pixel, points);
    ASSERT_EQ(points.size(), static_cast<std::size_t>(count));
    for (const DiscPoint p : points) {
      const double r2 = p.x * p.x + p.y * p.y;
      ASSERT_LE(r2, 1.0 + 1e-12);
      x += p.x, y += p.y, square += r2, inner += r2 < 0.25 ? 1 : 0;
    }
  }
  // 5 standard errors of independent points, which these must not exceed:
  // 1/2, 1/2, sqrt(1/12), sqrt(3/16) over the root of their number.
  const double n = static_cast<double>(count) * kPixels, root = std::sqrt(n);
  EXPECT_NEAR(x / n, 0.0, 5 * 0.5 / root);
  EXPECT_NEAR(y / n, 0.0, 5 * 0.5 / root);
  EXPECT_NEAR(square / n, 0.5, 5 * 0.2887 / root);
  EXPECT_NEAR(inner / n, 0.25, 5 * 0.433 / root);
}
INSTANTIATE_TEST_SUITE_P(Counts, DiscSamples, testing::Values(1, 4, 7, 12, 16, 64));

TEST(DiscSamples, SpreadLessThanIndependentPoints) {
  // Variance over pixels of the mean of x: 1/4/64 for 64 independent points. One
  // point in each of 8 x 8 cells leaves about 1/64 of that; 1/16 is asked.
  double square = 0;
  std::vector<DiscPoint> points;
  for (std::uint64_t pixel = 0; pixel < 500; ++pixel) {
    stratified_disc(64, pixel, points);
    double x = 0;
    for (const DiscPoint p : points) x += p.x / 64;
    square += x * x / 500;
  }
  EXPECT_LT(square, 0.25 / 64 / 16);
}

TEST(ConcentricDisc, KeepsAreas) {
  // The centres of 1000 x 1000 cells; a disc sector of known area must hold its share.
  int in_sector = 0;
  for (int i = 0; i < 1000; ++i)
    for (int j = 0; j < 1000; ++j) {
      const DiscPoint p = concentric_disc((i + 0.5) / 1000, (j + 0.5) / 1000);
      if (p.x > 0 && p.y > 0 && p.y < p.x && p.x * p.x + p.y * p.y < 0.49) ++in_sector;
    }
  // 1/8 of 0.49; the border of the sector passes some 1000 cells, half of them wrong
  EXPECT_NEAR(in_sector * 1e-6, 0.49 / 8, 5e-4);
}

TEST(DiscSamples, AreAPureFunctionOfTheStream) {
  std::vector<DiscPoint> a, b, c;
  stratified_disc(16, 5, a);
  stratified_disc(16, 5, b);
  stratified_disc(16, 6, c);
  for (std::size_t i = 0; i < a.size(); ++i) {
    EXPECT_EQ(a[i].x, b[i].x);
    EXPECT_NE(a[i].x, c[i].x);
  }
}

}  // namespace
}  // namespace maquette::camera
