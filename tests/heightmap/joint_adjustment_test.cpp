// SPDX-License-Identifier: GPL-3.0-or-later

// Claims of heightmap/detail/joint_adjustment.hpp and how each is attacked
//   0.02 pixel against the truth, any two and    four surfaces known everywhere, each with its own
//   every loop of pairs                            ground, shift, height and tilt; 20 seeds
//   the covariance is honest                     chi^2 per degree of freedom over 100 seeds, of
//                                                  each surface and so of what pairs share
//   better than surface after surface            the same surfaces, each onto the first alone
//   surfaces without noise                       solved, each pair, to what interpolation is off by
//   bow and seam steps where asked               planted and found, and what they do if not asked
//   a surface that no pair ties stays            flat ground

#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <Eigen/Dense>

#include "core/random.hpp"
#include "heightmap/detail/joint_adjustment.hpp"
#include "support/wave_relief.hpp"

namespace maquette::heightmap::detail {
namespace {

using testing_support::WaveRelief;

struct Truth {
  double east = 0.0, north = 0.0, up = 0.0, tilt_east = 0.0, tilt_north = 0.0;
  double bow = 0.0;   // of x^2, at the edge
  double step = 0.0;  // left of a line along y at x = 10
};

constexpr std::ptrdiff_t kNodes = 128;
constexpr double kHalf = 0.5 * static_cast<double>(kNodes - 1);
const Seam kSeam{10.0, -100.0, 10.0, 100.0};

/// What `truth` moves onto the relief, with white noise.
Grid<float> seen(const WaveRelief& relief, const Truth& truth, double noise, std::uint64_t seed) {
  Grid<double> exact(kNodes, kNodes, 0.0);
  relief.add_to(exact, {-kHalf + truth.east, -kHalf + truth.north}, 1.0, 0.0, 1.0);
  Grid<float> z(kNodes, kNodes);
  for (std::ptrdiff_t r = 0; r < kNodes; ++r)
    for (std::ptrdiff_t c = 0; c < kNodes; ++c) {
      const double x_own = static_cast<double>(c) - kHalf, y_own = static_cast<double>(r) - kHalf;
      const double x = x_own + truth.east, y = y_own + truth.north;
      z(r, c) = static_cast<float>(
          exact(r, c) - truth.up - truth.tilt_east * x - truth.tilt_north * y -
          truth.bow * x * x / (kHalf * kHalf) - truth.step * (x_own < 10.0 ? 0.5 : -0.5) +
          noise * random_normal(seed, static_cast<std::uint64_t>(r * kNodes + c)));
    }
  return z;
}

/// Columns outside [first, past) become voids.
Grid<float> only(Grid<float> z, std::ptrdiff_t first, std::ptrdiff_t past) {
  for (std::ptrdiff_t r = 0; r < z.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < z.cols(); ++c)
      if (c < first || c >= past) z(r, c) = NAN;
  return z;
}

Truth drawn(std::uint64_t seed) {
  return {6.0 * (random_uniform(seed, 1) - 0.5), 6.0 * (random_uniform(seed, 2) - 0.5),
          20.0 * (random_uniform(seed, 3) - 0.5), 0.005 * (random_uniform(seed, 4) - 0.5),
          0.005 * (random_uniform(seed, 5) - 0.5)};
}

/// A first surface over the western half only, others overlapping each other more than it.
struct Scene {
  std::vector<Truth> truths;
  std::vector<Grid<float>> z;
  std::vector<JointSurface> surfaces;
};
Scene scene(std::uint64_t seed, double noise) {
  Scene s;
  const WaveRelief relief(seed, seed % 2 == 0 ? 0.9 : 0.6, 0.04, 6.2832);
  const std::ptrdiff_t ranges[4][2] = {{0, 80}, {15, 110}, {40, 128}, {0, 128}};
  for (std::size_t k = 0; k < 4; ++k) {
    s.truths.push_back(k == 0 ? Truth{} : drawn(100 * seed + k));
    s.z.push_back(
        only(seen(relief, s.truths[k], noise, 1000 * seed + k), ranges[k][0], ranges[k][1]));
  }
  for (const Grid<float>& z : s.z) s.surfaces.push_back({&z, 1.0, true, false, {}});
  return s;
}

TEST(JointAdjustment, FindsAllSurfacesAndLoopsClose) {
  double square = 0.0, alone = 0.0, worst_loop = 0.0, loop_before = 0.0, loop_square = 0.0;
  double worst_pair = 0.0, over_sigma = 0.0;
  int n = 0;
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    const Scene s = scene(seed, 0.02);
    const auto found = joint_adjustment(s.surfaces, 1.0);
    ASSERT_TRUE(found) << seed;
    EXPECT_EQ(found->pairs.size(), 6U);
    for (std::size_t k = 1; k < 4; ++k) {
      ASSERT_TRUE(found->poses[k].found);
      square += std::pow(found->poses[k].east_m - s.truths[k].east, 2.0) +
                std::pow(found->poses[k].north_m - s.truths[k].north, 2.0);
      const auto one = coregister(s.z[0], s.z[k], 1.0, 1.0, 1.0);
      ASSERT_TRUE(one);
      alone += std::pow(one->east_m - s.truths[k].east, 2.0) +
               std::pow(one->north_m - s.truths[k].north, 2.0);
      n += 2;
    }
    // What a mosaic shows: how far any two of them lie off each other.
    for (std::size_t j = 0; j < 4; ++j)
      for (std::size_t k = j + 1; k < 4; ++k)
        worst_pair =
            std::fmax(worst_pair, std::hypot((found->poses[k].east_m - s.truths[k].east) -
                                                 (found->poses[j].east_m - s.truths[j].east),
                                             (found->poses[k].north_m - s.truths[k].north) -
                                                 (found->poses[j].north_m - s.truths[j].north)));
    over_sigma += std::pow(found->loop_after_px / found->loop_sigma_px, 2.0) / 20.0;
    worst_loop = std::fmax(worst_loop, found->loop_after_px);
    loop_square += found->loop_after_px * found->loop_after_px / 20.0;
    loop_before = std::fmax(loop_before, found->loop_before_px);
  }
  const double rms = std::sqrt(square / n), rms_alone = std::sqrt(alone / n);
  RecordProperty("rms_px", std::to_string(rms));
  RecordProperty("rms_px_each_onto_the_first", std::to_string(rms_alone));
  RecordProperty("worst_loop_px", std::to_string(worst_loop));
  RecordProperty("worst_loop_of_separate_pairs_px", std::to_string(loop_before));
  EXPECT_LT(rms, 0.02);
  RecordProperty("rms_loop_px", std::to_string(std::sqrt(loop_square)));
  EXPECT_LT(worst_loop, 0.02);
  EXPECT_LT(rms, rms_alone);
  RecordProperty("worst_of_any_two_px", std::to_string(worst_pair));
  RecordProperty("worst_loop_over_its_sigma_rms", std::to_string(std::sqrt(over_sigma)));
  EXPECT_LT(worst_pair, 0.02);
  // It is the noise of pairs that fails to close, no mistake of the adjustment: the worst of four
  // loops is 1.44 sigma where they are independent, less where they share their noise. Measured
  // 0.84; 1.96 with cubic convolution, whose loss of short waves was no noise.
  EXPECT_GT(std::sqrt(over_sigma), 0.6);
  EXPECT_LT(std::sqrt(over_sigma), 1.44);
}

TEST(JointAdjustment, StatesAnHonestCovariance) {
  double sum = 0.0;
  int n = 0;
  for (std::uint64_t seed = 1; seed <= 100; ++seed) {
    const Scene s = scene(seed, 0.15);
    const auto found = joint_adjustment(s.surfaces, 1.0);
    ASSERT_TRUE(found) << seed;
    for (std::size_t k = 1; k < 4; ++k) {
      const JointPose& p = found->poses[k];
      const Truth& t = s.truths[k];
      Eigen::VectorXd d(5);
      d << p.east_m - t.east, p.north_m - t.north, p.up_m - t.up, p.tilt_east - t.tilt_east,
          p.tilt_north - t.tilt_north;
      const Eigen::Map<const Eigen::MatrixXd> c(p.covariance.data(), 5, 5);
      sum += d.dot(c.ldlt().solve(d));
      n += 5;
    }
  }
  RecordProperty("chi2_per_freedom", std::to_string(sum / n));
  // 100 independent scenes of three surfaces: sqrt(2 / 1500) = 0.04, more as surfaces share noise.
  EXPECT_NEAR(sum / n, 1.0, 0.1);
}

/// Residuals are then what interpolation is off by, and Tukey's weights take them apart.
TEST(JointAdjustment, SettlesWithoutNoise) {
  double worst = 0.0;
  for (std::uint64_t seed = 1; seed <= 12; ++seed) {
    const Scene s = scene(seed, 0.0);
    const auto found = joint_adjustment(s.surfaces, 1.0);
    ASSERT_TRUE(found) << seed;
    EXPECT_EQ(found->pairs.size(), 6U) << seed;
    for (std::size_t k = 1; k < 4; ++k) {
      const JointPose& p = found->poses[k];
      ASSERT_TRUE(p.found) << seed;
      worst =
          std::fmax(worst, std::hypot(p.east_m - s.truths[k].east, p.north_m - s.truths[k].north));
      for (std::size_t i = 0; i < 5; ++i) EXPECT_GT(p.covariance[6 * i], 0.0) << seed << " " << i;
    }
  }
  RecordProperty("worst_px", std::to_string(worst));
  EXPECT_LT(worst, 2e-3);  // measured 0.0011, mostly 0.0002
}

TEST(JointAdjustment, FindsBowAndSeamWhereAsked) {
  double square = 0.0;
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    Scene s = scene(seed, 0.03);
    const WaveRelief relief(seed, seed % 2 == 0 ? 0.9 : 0.6, 0.04, 6.2832);
    Truth bent = drawn(100 * seed + 3);
    bent.bow = 1.5;
    bent.step = -0.8;
    s.z[3] = seen(relief, bent, 0.03, 1000 * seed + 3);
    s.surfaces[3].bow = true;
    s.surfaces[3].seams = {kSeam};
    const auto found = joint_adjustment(s.surfaces, 1.0);
    ASSERT_TRUE(found) << seed;
    const JointPose& p = found->poses[3];
    ASSERT_TRUE(p.found) << coregister(s.z[1], s.z[3], 1.0, 1.0, 1.0)->refusal;
    // Each within what it says of itself: five sigma, for 40 looks at it.
    const auto sigma = [&](std::size_t i) { return std::sqrt(p.covariance[i * 9 + i]); };
    EXPECT_NEAR(p.bow_m[0], bent.bow, 5.0 * sigma(5)) << seed;
    EXPECT_NEAR(p.bow_m[1], 0.0, 5.0 * sigma(6)) << seed;
    EXPECT_NEAR(p.bow_m[2], 0.0, 5.0 * sigma(7)) << seed;
    EXPECT_NEAR(p.steps_m[0], bent.step, 5.0 * sigma(8)) << seed;
    EXPECT_LT(sigma(5), 0.05);
    EXPECT_LT(sigma(8), 0.05);
    square += std::pow(p.east_m - bent.east, 2.0) + std::pow(p.north_m - bent.north, 2.0);
  }
  EXPECT_LT(std::sqrt(square / 20.0), 0.02);
}

TEST(JointAdjustment, LeavesOutWhatNoPairTies) {
  Scene s = scene(3, 0.03);
  s.z[2] = Grid<float>(kNodes, kNodes, 5.0F);
  const auto found = joint_adjustment(s.surfaces, 1.0);
  ASSERT_TRUE(found);
  EXPECT_TRUE(found->poses[1].found);
  EXPECT_FALSE(found->poses[2].found);
  EXPECT_TRUE(found->poses[3].found);
  EXPECT_EQ(found->pairs.size(), 3U);
  for (JointSurface& one : s.surfaces) one.horizontal = &one == &s.surfaces[0];
  EXPECT_FALSE(joint_adjustment(s.surfaces, 1.0));
}

}  // namespace
}  // namespace maquette::heightmap::detail
