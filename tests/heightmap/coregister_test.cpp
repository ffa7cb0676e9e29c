// SPDX-License-Identifier: GPL-3.0-or-later

// Claims of heightmap/detail/coregister.hpp and how each is attacked
//   0.01 pixel rms at the same resolution   sums of waves known everywhere, 20 seeds, 3 reliefs
//   a coarse and a fine surface             10 : 1, tilt, noise, a fifth of outliers: errors are
//                                             covered by the covariance that is stated
//   the covariance is honest                chi^2 per degree of freedom of 250 runs, white and
//                                             correlated noise
//   reach                                   20 pixels away, any direction
//   turn and scale where asked              planted, all seven unknowns
//   refusals                                flat ground, one direction only, other ground, a sliver

#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <Eigen/Dense>

#include "core/random.hpp"
#include "heightmap/detail/coregister.hpp"
#include "support/moved_relief.hpp"

namespace maquette::heightmap::detail {
namespace {

using namespace testing_support;

double chi2(const Coregistration& found, const Truth& truth, int unknowns) {
  Eigen::VectorXd d(unknowns);
  const std::array<double, 7> off{found.east_m - truth.east,
                                  found.north_m - truth.north,
                                  found.up_m - truth.up,
                                  found.tilt_east - truth.tilt_east,
                                  found.tilt_north - truth.tilt_north,
                                  found.rotation_rad - truth.turn,
                                  found.scale - truth.scale};
  Eigen::MatrixXd c(unknowns, unknowns);
  for (int i = 0; i < unknowns; ++i) {
    d[i] = off[static_cast<std::size_t>(i)];
    for (int j = 0; j < unknowns; ++j)
      c(i, j) = found.covariance[static_cast<std::size_t>(i)][static_cast<std::size_t>(j)];
  }
  return d.dot(c.ldlt().solve(d));
}

TEST(Coregister, FindsSurfacesOfTheSameResolutionToAHundredthOfAPixel) {
  for (const Ground& g : kGrounds) {
    double square = 0.0;
    int n = 0;
    for (std::uint64_t seed = 1; seed <= 20; ++seed) {
      const WaveRelief relief(seed, g.hurst, g.roughness, g.directions_rad);
      const Truth truth = drawn(100 + seed, 3.0);
      const auto found = coregister(seen(relief, 160, {}, 0.02, 200 + seed),
                                    seen(relief, 160, truth, 0.02, 300 + seed), 1.0, 1.0, 1.0);
      ASSERT_TRUE(found);
      ASSERT_TRUE(found->horizontal) << g.name << " seed " << seed << ": " << found->refusal;
      square +=
          std::pow(found->east_m - truth.east, 2.0) + std::pow(found->north_m - truth.north, 2.0);
      n += 2;
    }
    const double rms = std::sqrt(square / n);
    EXPECT_LT(rms, 0.01) << g.name;
    RecordProperty(std::string("rms_px_") + g.name, std::to_string(rms));
  }
}

TEST(Coregister, StatesAnHonestCovariance) {
  for (const double correlated : {0.0, 1.5}) {
    const std::uint64_t runs = correlated == 0.0 ? 100 : 150;
    double sum = 0.0;
    int n = 0;
    for (std::uint64_t seed = 1; seed <= runs; ++seed) {
      const Ground& g = kGrounds[seed % 2];
      const WaveRelief relief(seed, g.hurst, g.roughness, g.directions_rad);
      const Truth truth = drawn(1000 + seed, 2.0);
      Grid<float> low = seen(relief, 96, {}, correlated == 0.0 ? 0.15 : 0.0, 2000 + seed);
      if (correlated > 0.0) {
        // Noise of a stereo matcher: alike over some pixels.
        const std::ptrdiff_t reach = 4;
        for (std::ptrdiff_t r = 0; r < 96; ++r)
          for (std::ptrdiff_t c = 0; c < 96; ++c) {
            double noise = 0.0;
            for (std::ptrdiff_t i = -reach; i <= reach; ++i)
              for (std::ptrdiff_t j = -reach; j <= reach; ++j)
                noise += std::exp(-0.5 * static_cast<double>(i * i + j * j) /
                                  (correlated * correlated)) *
                         random_normal(3000 + seed,
                                       static_cast<std::uint64_t>((r + i + 10) * 200 + c + j + 10));
            low(r, c) += static_cast<float>(0.05 * noise);
          }
      }
      const auto found = coregister(low, seen(relief, 96, truth, 0.05, 4000 + seed), 1.0, 1.0, 1.0);
      ASSERT_TRUE(found);
      if (!found->horizontal) continue;  // said so
      sum += chi2(*found, truth, 5);
      ++n;
    }
    ASSERT_GE(10 * n, static_cast<int>(9 * runs));
    const double per_freedom = sum / (5.0 * n);
    // sqrt(2 / (5 n)) is 0.06; the covariances scatter too, the more so the longer the correlation.
    EXPECT_NEAR(per_freedom, 1.0, 0.1) << "correlation " << correlated;
    RecordProperty("chi2_per_freedom_at_" + std::to_string(correlated),
                   std::to_string(per_freedom));
  }
}

/// Strips of 40 columns: what interpolation takes away from short waves counts most there.
TEST(Coregister, StatesAnHonestCovarianceOnNarrowStrips) {
  double sum = 0.0;
  int n = 0;
  for (std::uint64_t seed = 1; seed <= 120; ++seed) {
    const Ground& g = kGrounds[seed % 2];
    const double noise = seed % 4 < 2 ? 0.02 : 0.1;
    const WaveRelief relief(seed, g.hurst, g.roughness, g.directions_rad);
    const Truth truth = drawn(5000 + seed, 3.0);
    Grid<float> west = seen(relief, 128, {}, noise, 6000 + seed),
                east = seen(relief, 128, truth, noise, 7000 + seed);
    for (std::ptrdiff_t r = 0; r < 128; ++r) {
      for (std::ptrdiff_t c = 84; c < 128; ++c) west(r, c) = NAN;
      for (std::ptrdiff_t c = 0; c < 44; ++c) east(r, c) = NAN;
    }
    const auto found = coregister(west, east, 1.0, 1.0, 1.0);
    ASSERT_TRUE(found && found->horizontal) << "seed " << seed;
    sum += chi2(*found, truth, 5);
    n += 5;
  }
  RecordProperty("chi2_per_freedom", std::to_string(sum / n));
  EXPECT_NEAR(sum / n, 1.0, 0.1);  // 600 degrees of freedom scatter by 0.06
}

/// 100 x 100 coarse pixels, so that relief and noise can tell the figures. 1000 nodes are no whole
/// number of cells, and tilts are large: a height that is not the one at the middle shows.
TEST(Coregister, BringsAFineSurfaceOntoACoarseOneDespiteOutliers) {
  constexpr std::ptrdiff_t kSide = 1000;
  double sum = 0.0, up = 0.0, tilt = 0.0, over_sigma = 0.0;
  std::array<double, 2> square{};
  int n = 0;
  for (std::uint64_t seed = 1; seed <= 60; ++seed) {  // twenty of each ground
    const Ground& g = kGrounds[seed % 3];
    const WaveRelief relief(seed, g.hurst, g.roughness, g.directions_rad);
    const Truth truth = drawn(50 + seed, 8.0);
    Grid<float> fine = seen(relief, kSide, truth, 0.05, 60 + seed);
    for (std::ptrdiff_t r = 0; r < kSide; ++r)
      for (std::ptrdiff_t c = 0; c < kSide; ++c) {
        // Jitter: ripples along the track. And a fifth of outliers.
        fine(r, c) += static_cast<float>(
            0.03 * std::sin(2.0 * std::numbers::pi * static_cast<double>(r) / 37.0));
        const auto i = static_cast<std::uint64_t>(r * kSide + c);
        if (random_uniform(70 + seed, i) < 0.2)
          fine(r, c) += static_cast<float>(20.0 * random_normal(80 + seed, i));
      }
    const auto found =
        coregister(seen_coarsely(relief, kSide, 10, 0.1, 90 + seed), fine, 1.0, 10.0, 1.0);
    ASSERT_TRUE(found);
    ASSERT_TRUE(found->horizontal) << "seed " << seed << ": " << found->refusal;
    sum += chi2(*found, truth, 5);
    square[0] += std::pow(found->east_m - truth.east, 2.0);
    square[1] += std::pow(found->north_m - truth.north, 2.0);
    over_sigma +=
        0.5 *
        (std::pow((found->east_m - truth.east) / found->sigma(Coregistration::kEast), 2.0) +
         std::pow((found->north_m - truth.north) / found->sigma(Coregistration::kNorth), 2.0));
    tilt += std::pow(found->tilt_east - truth.tilt_east, 2.0) +
            std::pow(found->tilt_north - truth.tilt_north, 2.0);
    up += std::pow(found->up_m - truth.up, 2.0);
    ++n;
  }
  const double east_px = std::sqrt(square[0] / n), north_px = std::sqrt(square[1] / n);
  RecordProperty("rms_fine_px", fmt::format("{:.4f} {:.4f}", east_px, north_px));
  RecordProperty("rms_over_sigma", fmt::format("{:.3f}", std::sqrt(over_sigma / n)));
  RecordProperty("rms_up_over_coarse_noise", fmt::format("{:.4f}", std::sqrt(up / n) / 0.1));
  RecordProperty("tilt_urad", fmt::format("{:.3f}", 1e6 * std::sqrt(tilt / (2.0 * n))));
  RecordProperty("chi2_per_freedom", fmt::format("{:.3f}", sum / (5.0 * n)));
  EXPECT_LT(east_px, 0.05);
  EXPECT_LT(north_px, 0.05);
  EXPECT_LT(std::sqrt(up / n), 0.1 * 0.1);
  EXPECT_LT(std::sqrt(tilt / (2.0 * n)), 5e-6);
  // The shift is covered by what is stated: 120 values scatter by 0.07.
  EXPECT_NEAR(std::sqrt(over_sigma / n), 1.0, 0.2);
  EXPECT_NEAR(sum / (5.0 * n), 1.0, 0.1);  // 300 degrees of freedom scatter by 0.08
}

TEST(Coregister, ReachesTwentyPixelsInAnyDirection) {
  for (int way = 0; way < 8; ++way) {
    const WaveRelief relief(7, 0.8, 0.04, 6.2832);
    Truth truth;
    truth.east = 20.0 * std::cos(way * std::numbers::pi / 4.0);
    truth.north = 20.0 * std::sin(way * std::numbers::pi / 4.0);
    const auto found = coregister(seen(relief, 128, {}, 0.02, 1), seen(relief, 128, truth, 0.02, 2),
                                  1.0, 1.0, 1.0);
    ASSERT_TRUE(found && found->horizontal) << (found ? found->refusal : "nothing common");
    EXPECT_NEAR(found->east_m, truth.east, 0.05);
    EXPECT_NEAR(found->north_m, truth.north, 0.05);
  }
}

TEST(Coregister, FindsTurnAndScaleWhereAsked) {
  const WaveRelief relief(11, 0.7, 0.05, 6.2832);
  const Truth truth{1.3, -0.8, 4.0, 0.004, -0.003, 0.012, 1.006};
  CoregisterOptions options;
  options.rotation = options.scale = true;
  const auto found = coregister(seen(relief, 200, {}, 0.02, 1), seen(relief, 200, truth, 0.02, 2),
                                1.0, 1.0, 1.0, options);
  ASSERT_TRUE(found && found->horizontal) << found->refusal;
  EXPECT_NEAR(found->rotation_rad, truth.turn, 1e-4);
  EXPECT_NEAR(found->scale, truth.scale, 1e-4);
  EXPECT_NEAR(found->east_m, truth.east, 0.02);
  EXPECT_NEAR(found->up_m, truth.up, 0.01);
  EXPECT_NEAR(found->tilt_east, truth.tilt_east, 1e-4);
  EXPECT_LT(chi2(*found, truth, 7), 24.3);  // 0.1 % of seven degrees of freedom
  const auto [x, y] = found->origin_of(30.0, -20.0);
  const double c = truth.scale * std::cos(truth.turn), s = truth.scale * std::sin(truth.turn);
  EXPECT_NEAR(c * x - s * y + truth.east, 30.0, 0.03);
  EXPECT_NEAR(s * x + c * y + truth.north, -20.0, 0.03);
}

TEST(Coregister, RefusesWhatGroundAndOverlapDoNotTell) {
  const WaveRelief hills(3, 0.9, 0.03, 6.2832), others(4, 0.9, 0.03, 6.2832);
  const Grid<float> low = seen(hills, 128, {}, 0.02, 1);
  const auto flat = coregister(seen(WaveRelief(1, 0.5, 0.0, 1.0), 128, {}, 0.1, 1),
                               seen(WaveRelief(1, 0.5, 0.0, 1.0), 128, {}, 0.1, 2), 1.0, 1.0, 1.0);
  ASSERT_TRUE(flat);
  EXPECT_FALSE(flat->horizontal);
  EXPECT_NE(flat->refusal, "");

  const WaveRelief furrows(5, 0.8, 0.05, 0.0);  // all waves along one direction
  const auto one_way = coregister(seen(furrows, 128, {}, 0.05, 1),
                                  seen(furrows, 128, {0.5, 0.5}, 0.05, 2), 1.0, 1.0, 1.0);
  ASSERT_TRUE(one_way);
  EXPECT_FALSE(one_way->horizontal) << one_way->sigma(Coregistration::kEast);

  const auto other = coregister(low, seen(others, 128, {}, 0.02, 2), 1.0, 1.0, 1.0);
  ASSERT_TRUE(other);
  EXPECT_FALSE(other->horizontal);

  Grid<float> sliver = seen(hills, 128, {}, 0.02, 2);
  for (std::ptrdiff_t r = 0; r < 128; ++r)
    for (std::ptrdiff_t c = 0; c < 128; ++c)
      if (r > 4 || c > 4) sliver(r, c) = NAN;
  const auto little = coregister(low, sliver, 1.0, 1.0, 1.0);
  ASSERT_TRUE(little);
  EXPECT_FALSE(little->horizontal);
  EXPECT_THAT(little->refusal, ::testing::HasSubstr("25.0 pixels"));
}

}  // namespace
}  // namespace maquette::heightmap::detail
