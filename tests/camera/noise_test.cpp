// SPDX-License-Identifier: GPL-3.0-or-later

// camera/effects/noise.hpp:
//   normal quantile .................. against erfc, at 20000 places up to 6 sigma: 1e-4
//   Poisson counts ................... mean, variance, third moment against the distribution's
//   counts of a row .................. the same as one by one, to the bit
//   streams are independent .......... correlation of 16 M draws between seeds, times, effects,
//                                      neighbours: below 1e-3 (four standard errors of 2.5e-4)
//   fixed pattern .................... depends on the serial number only

#include "camera/effects/noise.hpp"

#include <cmath>
#include <numbers>

#include <gtest/gtest.h>

namespace maquette::camera {
namespace {

TEST(NormalFrom, IsTheQuantile) {
  const NormalTable& table = normal_table();
  for (std::uint32_t i = 1; i <= 20000; ++i) {
    const auto k = static_cast<std::uint32_t>(
        std::exp(static_cast<double>(i) / 20000.0 * std::log(2147483647.0)));
    const double p = (static_cast<double>(k) + 1.0) * 0x1.0p-32;
    const double z = static_cast<double>(normal_from(table, k));
    // How far z lies from the place whose probability is p: 1e-4 of the table, 1e-6 of float p.
    const double density = std::exp(-0.5 * z * z) / std::sqrt(2.0 * std::numbers::pi);
    ASSERT_NEAR(0.5 * std::erfc(-z / std::numbers::sqrt2), p, 1.1e-4 * density + 1e-7 * p) << k;
    ASSERT_EQ(normal_from(table, k | 0x80000000U), -normal_from(table, k));
  }
}

class Poisson : public testing::TestWithParam<double> {};

TEST_P(Poisson, HasTheMomentsOfTheDistribution) {
  const double mean = GetParam();
  const NoiseStream stream{42};
  constexpr int kDraws = 4'000'000;
  double sum = 0.0, square = 0.0, cube = 0.0;
  for (std::uint64_t i = 0; i < kDraws; ++i) {
    const float count = poisson_from(normal_table(), static_cast<float>(mean),
                                     static_cast<std::uint32_t>(stream.bits(i) >> 32));
    ASSERT_EQ(count, std::floor(count));
    const double d = static_cast<double>(count) - mean;
    sum += d, square += d * d, cube += d * d * d;
  }
  // Five standard errors: sqrt(mean / n), mean sqrt((2 + 1 / mean) / n), sqrt(15) mean^1.5 /
  // sqrt(n); above 30 the table's step adds 2e-5 of the standard deviation to the mean.
  const double n = kDraws, root = std::sqrt(mean);
  EXPECT_NEAR(sum / n, 0.0, 5.0 * root / std::sqrt(n) + 2e-5 * root);
  EXPECT_NEAR(square / n, mean,
              5.0 * mean * std::sqrt((2.0 + 1.0 / mean) / n) +
                  (mean > 30.0 ? 1.0 / 12.0 + 1e-4 * mean : 0.0));
  EXPECT_NEAR(cube / n, mean,
              5.0 * std::sqrt((15.0 * mean * mean + 25.0 * mean + 1.0) * mean / n) +
                  (mean > 30.0 ? 1.0 : 0.0));
}
INSTANTIATE_TEST_SUITE_P(Means, Poisson, testing::Values(0.05, 1.0, 7.5, 29.9, 30.1, 200.0, 4e4));

TEST(PoissonFrom, OfNothingIsNothing) {
  EXPECT_EQ(poisson_from(normal_table(), 0.0F, 7), 0.0F);
  EXPECT_EQ(poisson_from(normal_table(), -3.0F, 7), 0.0F);
  EXPECT_EQ(poisson_from(normal_table(), 40.0F, 0x80000000U | 0U),
            poisson_from(normal_table(), 40.0F, 0x80000000U));
}

double correlation(const NoiseStream& a, const NoiseStream& b, std::uint64_t lag) {
  const NormalTable& table = normal_table();
  constexpr std::uint64_t kDraws = 1 << 24;
  double sum = 0.0;
  for (std::uint64_t i = 0; i < kDraws; ++i)
    sum +=
        static_cast<double>(normal_from(table, static_cast<std::uint32_t>(a.bits(i) >> 32)) *
                            normal_from(table, static_cast<std::uint32_t>(b.bits(i + lag) >> 32)));
  return sum / static_cast<double>(kDraws);
}

TEST(PoissonCounts, AreTheSameTogether) {
  const NoiseStream stream{7};
  for (const std::size_t count : {1U, 3U, 64U, 65U, 1000U}) {
    std::vector<float> means(count), counts;
    for (std::size_t i = 0; i < count; ++i) {
      const double u = random_uniform(9, i);
      means[i] = static_cast<float>(std::exp(16.0 * u - 5.0));
      if (i % 9 == 4) means[i] = i % 2 == 0 ? 0.0F : -1.0F;
      if (i % 31 == 30) means[i] = NAN;
      if (i % 17 == 16) means[i] = i % 2 == 0 ? 30.0F : std::nextafter(30.0F, 0.0F);
    }
    counts = means;
    poisson_counts(normal_table(), stream, 100 * count, counts);
    for (std::size_t i = 0; i < count; ++i)
      ASSERT_EQ(counts[i],
                poisson_from(normal_table(), means[i],
                             static_cast<std::uint32_t>(stream.bits(100 * count + i) >> 32)))
          << means[i];
  }
}

TEST(NoiseStreams, AreNotCorrelated) {
  Shot shot, other;
  shot.seed = 1, other.seed = 2;
  const auto stream = temporal_noise(shot, "read_noise");
  EXPECT_LT(std::abs(correlation(stream, temporal_noise(other, "read_noise"), 0)), 1e-3);
  other = shot;
  other.time_s = 1e-9;
  EXPECT_LT(std::abs(correlation(stream, temporal_noise(other, "read_noise"), 0)), 1e-3);
  EXPECT_LT(std::abs(correlation(stream, temporal_noise(shot, "shot_noise"), 0)), 1e-3);
  EXPECT_LT(std::abs(correlation(stream, stream, 1)), 1e-3);
  EXPECT_LT(std::abs(correlation(stream, stream, std::uint64_t{1} << 30)), 1e-3);  // next row
  EXPECT_NEAR(correlation(stream, stream, 0), 1.0, 1.8e-3);  // five of sqrt(2 / n)
}

TEST(FixedPattern, DependsOnTheSerialNumberOnly) {
  Shot a, b;
  b.seed = 9, b.time_s = 7.0;
  EXPECT_EQ(fixed_pattern(a, "prnu").key, fixed_pattern(b, "prnu").key);
  EXPECT_NE(temporal_noise(a, "prnu").key, temporal_noise(b, "prnu").key);
  b.serial = 2;
  EXPECT_NE(fixed_pattern(a, "prnu").key, fixed_pattern(b, "prnu").key);
  EXPECT_NE(fixed_pattern(a, "prnu").key, fixed_pattern(a, "dsnu").key);
}

}  // namespace
}  // namespace maquette::camera
