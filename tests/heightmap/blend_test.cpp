// SPDX-License-Identifier: GPL-3.0-or-later

// Claims of heightmap/detail/blend.hpp and how each is attacked
//   detail is whole nearly to the border   its amplitude in the middle of the ramp, against a
//   feather's smaller errors in the ramp              known relief, ten seeds, against a hard seam
//   and a feather no step at the border                   differences across it against those
//   elsewhere long waves of the better source count   a fine source with noise that its means keep
//   uncertainty                             share of errors within sigma, in the layer and below

#include <array>
#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/random.hpp"
#include "heightmap/detail/blend.hpp"
#include "support/wave_relief.hpp"

namespace maquette::heightmap::detail {
namespace {

using testing_support::WaveRelief;

constexpr std::ptrdiff_t kRows = 200, kCols = 400, kBorder = 240;  // the layer is west of it
constexpr double kCoarse = 32.0, kRamp = 64.0;

struct Scene {
  Grid<double> truth;
  Grid<float> below, layer;
};

/// Relief of 4 to 200 nodes; below: means over 32 nodes with errors of longer waves; layer: the
/// relief with white noise.
Scene scene(std::uint64_t seed, double below_errors, double noise) {
  const WaveRelief relief(seed, 0.7, 0.05, 6.2832), errors(900 + seed, 0.2, 1.0, 6.2832);
  Scene s{Grid<double>(kRows, kCols, 0.0), Grid<float>(kRows, kCols),
          Grid<float>(kRows, kCols, NAN)};
  Grid<double> coarse(kRows, kCols, 0.0), long_errors(kRows, kCols, 0.0);
  relief.add_to(s.truth, {0.0, 0.0}, 1.0, 0.0, 0.0);
  relief.add_to(coarse, {0.0, 0.0}, 1.0, 0.0, kCoarse);
  errors.add_to(long_errors, {0.0, 0.0}, 0.06, 0.0, 0.0);  // waves from 67 nodes on
  for (std::ptrdiff_t r = 0; r < kRows; ++r)
    for (std::ptrdiff_t c = 0; c < kCols; ++c) {
      s.below(r, c) = static_cast<float>(coarse(r, c) + below_errors * long_errors(r, c));
      if (c < kBorder)
        s.layer(r, c) = static_cast<float>(
            s.truth(r, c) +
            noise * random_normal(700 + seed, static_cast<std::uint64_t>(r * kCols + c)));
    }
  return s;
}

struct Result {
  Grid<float> z, sigma;
  Grid<std::uint8_t> source;
};

Result blended(const Scene& s, double below_sigma, double layer_sigma) {
  Result out{s.below, Grid<float>(kRows, kCols, static_cast<float>(below_sigma)),
             Grid<std::uint8_t>(kRows, kCols, 0)};
  blend(out.z, out.sigma, out.source, s.layer, {kCoarse, 1.0, below_sigma, layer_sigma, kRamp}, 1);
  return out;
}

Grid<float> feathered(const Scene& s) {
  Grid<float> z = s.below;
  for (std::ptrdiff_t r = 0; r < kRows; ++r)
    for (std::ptrdiff_t c = 0; c < kBorder; ++c) {
      const auto w = static_cast<float>(std::fmin(1.0, static_cast<double>(kBorder - c) / kRamp));
      z(r, c) = (1.0F - w) * z(r, c) + w * s.layer(r, c);
    }
  return z;
}

/// Root mean square of the error in a strip of columns.
double rms(const Grid<float>& z, const Grid<double>& truth, std::ptrdiff_t from,
           std::ptrdiff_t to) {
  double sum = 0.0, n = 0.0;
  for (std::ptrdiff_t r = 0; r < kRows; ++r)
    for (std::ptrdiff_t c = from; c < to; ++c, n += 1.0)
      sum += std::pow(static_cast<double>(z(r, c)) - truth(r, c), 2.0);
  return std::sqrt(sum / n);
}

/// Slope of the true detail in the result: 1 if detail is whole. Second differences over 4 nodes.
double detail_kept(const Grid<float>& z, const Grid<double>& truth, std::ptrdiff_t from,
                   std::ptrdiff_t to) {
  double both = 0.0, own = 0.0;
  for (std::ptrdiff_t r = 2; r + 2 < kRows; ++r)
    for (std::ptrdiff_t c = from; c < to; ++c) {
      const double t = truth(r - 2, c) + truth(r + 2, c) - 2.0 * truth(r, c);
      both += t * static_cast<double>(z(r - 2, c) + z(r + 2, c) - 2.0F * z(r, c));
      own += t * t;
    }
  return both / own;
}

TEST(BlendBands, KeepsDetailWhereAFeatherHalvesIt) {
  double ours = 0.0, feather = 0.0, error = 0.0, feather_error = 0.0, hard_error = 0.0;
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    const Scene s = scene(seed, 0.02, 0.01);
    const Result out = blended(s, 0.3, 0.01);
    const Grid<float> soft = feathered(s);
    const std::ptrdiff_t middle = kBorder - 32;
    ours += 0.1 * detail_kept(out.z, s.truth, middle - 8, middle + 8);
    feather += 0.1 * detail_kept(soft, s.truth, middle - 8, middle + 8);
    const auto ramp = static_cast<std::ptrdiff_t>(kRamp);
    error += 0.1 * rms(out.z, s.truth, kBorder - ramp, kBorder);
    feather_error += 0.1 * rms(soft, s.truth, kBorder - ramp, kBorder);
    Grid<float> seam = s.below;
    for (std::ptrdiff_t r = 0; r < kRows; ++r)
      for (std::ptrdiff_t c = 0; c < kBorder; ++c) seam(r, c) = s.layer(r, c);
    hard_error += 0.1 * rms(seam, s.truth, kBorder - ramp, kBorder);
  }
  RecordProperty("detail_kept", std::to_string(ours));
  RecordProperty("detail_kept_by_feather", std::to_string(feather));
  RecordProperty("rmse", std::to_string(error));
  RecordProperty("rmse_feather", std::to_string(feather_error));
  RecordProperty("rmse_hard_seam", std::to_string(hard_error));
  EXPECT_NEAR(ours, 1.0, 0.03);
  EXPECT_NEAR(feather, 0.5, 0.05);
  EXPECT_LT(error, 0.5 * feather_error);
}

TEST(BlendBands, LeavesNoStepAtTheBorder) {
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    const Scene s = scene(seed, 0.1, 0.01);
    const Result out = blended(s, 0.3, 0.01);
    double across = 0.0, coarse = 0.0, hard = 0.0;
    for (std::ptrdiff_t r = 0; r < kRows; ++r) {
      across += std::abs(static_cast<double>(out.z(r, kBorder) - out.z(r, kBorder - 1)));
      coarse += std::abs(static_cast<double>(s.below(r, kBorder) - s.below(r, kBorder - 1)));
      hard += std::abs(static_cast<double>(s.below(r, kBorder) - s.layer(r, kBorder - 1)));
    }
    // One node's share of the rim: a smoothstep's value at a third.
    EXPECT_LT(across, coarse + 0.4 * hard);
    for (std::ptrdiff_t r = 0; r < kRows; ++r) {
      ASSERT_EQ(out.z(r, kBorder), s.below(r, kBorder));
      ASSERT_EQ(out.source(r, 0), 1);
      ASSERT_EQ(out.source(r, kBorder), 0);
    }
  }
}

TEST(BlendBands, TakesLongWavesFromTheBetterSource) {
  // Noise of 3 in the layer's single nodes is 0.05 in means over 64 x 64, two pixels of the base,
  // which errs by less.
  double below = 0.0, ours = 0.0, layer = 0.0;
  for (std::uint64_t seed = 1; seed <= 8; ++seed) {
    const Scene s = scene(seed, 0.0, 3.0);
    const Result out = blended(s, 0.02, 3.0);
    for (std::ptrdiff_t r = 60; r + 40 < kRows; r += 64)
      for (std::ptrdiff_t c = 60; c < 140; c += 64) {
        double a = 0.0, b = 0.0, l = 0.0;
        for (std::ptrdiff_t i = -32; i < 32; ++i)
          for (std::ptrdiff_t j = -32; j < 32; ++j) {
            const double t = s.truth(r + i, c + j);
            a += static_cast<double>(out.z(r + i, c + j)) - t;
            b += static_cast<double>(s.below(r + i, c + j)) - t;
            l += static_cast<double>(s.layer(r + i, c + j)) - t;
          }
        ours += a * a;
        below += b * b;
        layer += l * l;
      }
  }
  EXPECT_LT(ours, 0.5 * layer);  // of the squares
  RecordProperty("share_of_layers_error", std::to_string(std::sqrt(ours / layer)));
  RecordProperty("share_of_bases_error", std::to_string(std::sqrt(ours / below)));
}

TEST(BlendBands, StatesTheLayersUncertaintyInside) {
  const Scene s = scene(3, 0.05, 0.2);
  const Result out = blended(s, 1.0, 0.2);
  double within = 0.0, n = 0.0;
  for (std::ptrdiff_t r = 0; r < kRows; ++r)
    for (std::ptrdiff_t c = 0; c < kBorder - static_cast<std::ptrdiff_t>(kRamp); ++c, n += 1.0)
      within += std::abs(static_cast<double>(out.z(r, c)) - s.truth(r, c)) <
                        static_cast<double>(out.sigma(r, c))
                    ? 1.0
                    : 0.0;
  EXPECT_NEAR(within / n, 0.683, 0.03);
  EXPECT_FLOAT_EQ(out.sigma(10, kBorder), 1.0F);
}

}  // namespace
}  // namespace maquette::heightmap::detail
