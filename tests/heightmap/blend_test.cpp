// SPDX-License-Identifier: GPL-3.0-or-later

// Claims of heightmap/detail/blend.hpp, knowledge.hpp, bands.hpp, roughness.hpp; how each is
// attacked
//   error next to the best possible        ten Gaussian reliefs, beside a solver of all nodes that
//                                            knows spectrum, noise and pixels; by place
//   no seam, detail whole to the border    step and power of waves along the border
//   better than others there by 2          gdalwarp's mosaic, a feather, a two-band blend, same run
//   stated uncertainty                     share of errors within 1 and 1.96 sigma
//   bands add up, with equal weights        any grid, odd sizes; shares add up to one
//   three sources: each where it lies      a third one over a hole of the second: there the base is
//                                            what lies below it
//   a source ends inside                   holes of a layer show what lies below
//   power law and white noise measured     reliefs of known law and noise

#include <array>
#include <cmath>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/random.hpp"
#include "heightmap/detail/bands.hpp"
#include "heightmap/detail/blend.hpp"
#include "support/fusion_peers.hpp"

namespace maquette::heightmap::detail {
namespace {

using namespace testing_support;

TEST(Fusion, IsNextToTheBestPossibleAndSeamless) {
  const FusionTable table = fusion_table();
  const Score &oracle = table.scores[0], &ours = table.scores[1];
  for (const Score& s : table.scores) {
    RecordProperty("all over oracle, " + s.name,
                   std::to_string(s.rmse_of_all() / oracle.rmse_of_all()));
    RecordProperty("border over oracle, " + s.name,
                   std::to_string(s.rmse_at_border() / oracle.rmse_at_border()));
  }
  EXPECT_LT(ours.rmse_of_all(), 1.10 * oracle.rmse_of_all());
  EXPECT_LT(ours.rmse(kInside), 1.10 * oracle.rmse(kInside));
  EXPECT_LT(ours.rmse(kInsideBorder), 1.10 * oracle.rmse(kInsideBorder));
  EXPECT_LT(ours.rmse(kOutside), 1.10 * oracle.rmse(kOutside));
  EXPECT_LT(ours.rmse(kOutsideBorder), 1.25 * oracle.rmse(kOutsideBorder));
  for (std::size_t peer = 3; peer < table.scores.size(); ++peer) {
    EXPECT_LT(ours.rmse_at_border(), 0.5 * table.scores[peer].rmse_at_border());
    EXPECT_LT(ours.rmse(kInsideBorder), 0.5 * table.scores[peer].rmse(kInsideBorder));
    EXPECT_LT(ours.step(), table.scores[peer].step());
  }
  EXPECT_LT(ours.step(), 0.1);
  // Waves of 2 to 4 nodes: in the corners of the spectrum noise is far above relief.
  EXPECT_NEAR(ours.power[0] / ours.true_power[0], 0.9, 0.06);
  for (const std::size_t octave : {1U, 2U, 3U})
    EXPECT_NEAR(ours.power[octave] / ours.true_power[octave], 1.0, 0.05) << octave;
  for (const std::size_t octave : {0U, 1U, 2U}) {
    RecordProperty(
        fmt::format("waves of octave {} over truth", octave),
        fmt::format("{:.4f} of {} trials above noise", ours.waves[octave] / ours.true_waves[octave],
                    ours.true_waves[octave]));
  }
  for (std::size_t place = 0; place < kPlaces; ++place)
    RecordProperty(fmt::format("within one sigma, place {}", place),
                   fmt::format("{:.4f}", table.coverage.one[place] / table.coverage.nodes[place]));
  double one = 0.0, two = 0.0, n = 0.0;
  const Coverage& coverage = table.coverage;
  for (const Place p : {kInside, kInsideBorder, kOutsideBorder, kOutside}) {
    one += coverage.one[p];
    two += coverage.two[p];
    n += coverage.nodes[p];
  }
  EXPECT_NEAR(one / n, 0.683, 0.03);
  EXPECT_NEAR(two / n, 0.950, 0.03);
  for (const Place p : {kInside, kOutside}) {
    // Outside the grid's edge is near, where filters see half of their surroundings.
    EXPECT_NEAR(coverage.one[p] / coverage.nodes[p], 0.683, p == kInside ? 0.03 : 0.05);
    EXPECT_NEAR(coverage.two[p] / coverage.nodes[p], 0.950, 0.03);
  }
}

TEST(Bands, AddUp) {
  for (const auto& [rows, cols] : {std::pair{64, 64}, {37, 101}, {9, 8}}) {
    Grid<float> z(rows, cols);
    for (std::size_t i = 0; i < z.cells().size(); ++i)
      z.cells()[i] = static_cast<float>(random_normal(3, i));
    const Grid<float> whole = weighted_bands(z, 3, {{std::vector<float>(bands_of(3), 1.0F)}});
    for (std::size_t i = 0; i < z.cells().size(); ++i)
      ASSERT_NEAR(whole.cells()[i], z.cells()[i], 2e-6);
  }
  for (const double fx : {0.01, 0.2, 0.47}) {
    double sum = 0.0;
    for (const double s : band_shares(fx, 0.1, 4)) sum += s;
    EXPECT_NEAR(sum, 1.0, 1e-12);
  }
}

/// One band of a wave has the share of it that band_shares says.
TEST(Bands, HaveTheirShareOfAWave) {
  constexpr std::ptrdiff_t n = 257;
  for (const double f : {0.02, 0.06, 0.11, 0.2, 0.3, 0.42}) {
    Grid<float> z(n, n);
    for (std::ptrdiff_t r = 0; r < n; ++r)
      for (std::ptrdiff_t c = 0; c < n; ++c)
        z(r, c) = static_cast<float>(std::cos(2.0 * std::numbers::pi * f * static_cast<double>(c)));
    const auto shares = band_shares(f, 0.0, 3);
    for (std::size_t k = 0; k < shares.size(); ++k) {
      std::vector<float> one(bands_of(3), 0.0F);
      one[k] = 1.0F;
      const Grid<float> band = weighted_bands(z, 3, {{one}});
      double both = 0.0, own = 0.0;
      for (std::ptrdiff_t r = 64; r < n - 64; ++r)
        for (std::ptrdiff_t c = 64; c < n - 64; ++c) {
          both += static_cast<double>(z(r, c)) * static_cast<double>(band(r, c));
          own += static_cast<double>(z(r, c)) * static_cast<double>(z(r, c));
        }
      EXPECT_NEAR(both / own, shares[k], 0.01) << f << " band " << k;
    }
  }
}

TEST(Roughness, MeasuresLawAndNoise) {
  for (const TrialCase& what : trial_cases()) {
    const Trial t = make_trial(what);
    PixelWindow window;
    window.height_m = t.layer;
    const Roughness found = measure_roughness(window, {1.0, 1.0});
    EXPECT_NEAR(found.hurst, what.hurst, 0.1) << what.seed;  // of half of 128 x 128 pixels
    EXPECT_NEAR(found.noise_m / what.fine_sigma_m, 1.0, 0.1) << what.seed;
    // Power of waves of 8 m, where noise does not count.
    const auto power = [](const Roughness& law) {
      return law.spectrum() * std::pow(0.125, -2.0 * law.hurst - 2.0);
    };
    EXPECT_NEAR(power(found) / power({what.hurst, 0.01, 0.0}), 1.0, 0.25) << what.seed;
  }
}

const WaveTable& table_of_hills() {
  static const WaveTable waves = wave_table({0.7, 0.01, 0.0}, 1.0, 128.0, 4);
  return waves;
}

TEST(Blend, ShowsWhatLiesBelowWhereALayerHasHoles) {
  const WaveTable& waves = table_of_hills();
  Grid<float> base(128, 128, 10.0F), second(128, 128, 12.0F), third(128, 128, 11.0F);
  for (std::ptrdiff_t r = 0; r < 128; ++r)
    for (std::ptrdiff_t c = 64; c < 128; ++c) second(r, c) = NAN;
  for (std::ptrdiff_t r = 0; r < 128; ++r)
    for (std::ptrdiff_t c = 0; c < 128; ++c)
      if (r < 64) third(r, c) = NAN;
  Blend blend(waves, base, knowledge_of(waves, 8.0, 2.0), {}, false);
  blend.add(second, knowledge_of(waves, 1.0, 0.05));
  blend.add(third, knowledge_of(waves, 4.0, 0.4));
  const Grid<float> z = blend.heights_m(), sigma = blend.sigma_m();
  const Grid<std::uint8_t> source = blend.source();
  EXPECT_EQ(source(20, 20), 1);
  EXPECT_EQ(source(20, 110), 0);
  EXPECT_EQ(source(110, 20), 1) << "the second is the more exact";
  EXPECT_EQ(source(110, 110), 2) << "over the second's void the third beats the base";
  EXPECT_NEAR(z(20, 110), 10.0, 0.05);
  EXPECT_NEAR(z(20, 20), 12.0, 0.05);
  EXPECT_NEAR(z(110, 20), 12.0, 0.1);
  // Noise of the base in its mean over many pixels counts little, but more than the third's.
  EXPECT_GT(z(110, 110), 10.8);
  EXPECT_LT(sigma(110, 110), sigma(20, 110));
  EXPECT_LE(sigma(110, 20), sigma(20, 20));
}

/// What a third source gains over the void of the second is what it gains over the base alone.
TEST(Blend, TakesNoNoticeOfASourceThatIsNotThere) {
  const WaveTable& waves = table_of_hills();
  Grid<float> base(128, 128), third(128, 128), little(128, 128, NAN);
  for (std::size_t i = 0; i < base.cells().size(); ++i) {
    base.cells()[i] = static_cast<float>(random_normal(1, i));
    third.cells()[i] = static_cast<float>(0.3 * random_normal(2, i));
  }
  for (std::ptrdiff_t r = 0; r < 128; ++r)
    for (std::ptrdiff_t c = 0; c < 10; ++c) little(r, c) = 5.0F;
  const auto coarse = knowledge_of(waves, 8.0, 1.0), fine = knowledge_of(waves, 1.0, 0.01),
             middle = knowledge_of(waves, 3.0, 0.3);
  for (const bool restoring : {false, true}) {
    Blend with(waves, base, coarse, {}, restoring), without(waves, base, coarse, {}, restoring);
    with.add(little, fine);
    with.add(third, middle);
    without.add(third, middle);
    const Grid<float> a = with.heights_m(), b = without.heights_m();
    for (std::ptrdiff_t r = 0; r < 128; ++r)
      for (std::ptrdiff_t c = 80; c < 128; ++c) ASSERT_NEAR(a(r, c), b(r, c), 1e-3);
    EXPECT_FLOAT_EQ(with.sigma_m()(64, 100), without.sigma_m()(64, 100));
    EXPECT_EQ(with.source()(64, 100), 2);
    EXPECT_EQ(without.source()(64, 100), 1);
  }
}

TEST(Blend, MarksWhatWasFilledAndDoubtsIt) {
  const WaveTable& waves = table_of_hills();
  Grid<float> base(64, 64, 3.0F), filled(64, 64, NAN), layer(64, 64, NAN);
  for (std::ptrdiff_t r = 20; r < 30; ++r)
    for (std::ptrdiff_t c = 20; c < 30; ++c) filled(r, c) = 2.0F;
  for (std::ptrdiff_t r = 0; r < 64; ++r)
    for (std::ptrdiff_t c = 0; c < 25; ++c) layer(r, c) = 4.0F;
  Blend blend(waves, base, knowledge_of(waves, 1.0, 0.1), filled, true);
  EXPECT_EQ(blend.source()(25, 27), Blend::kFilled);
  EXPECT_GT(blend.sigma_m()(25, 27), 2.0F);
  EXPECT_LT(blend.sigma_m()(5, 5), 0.2F);
  blend.add(layer, knowledge_of(waves, 1.0, 0.3));
  EXPECT_EQ(blend.source()(25, 22), 1);
  EXPECT_LT(blend.sigma_m()(25, 22), 0.4F);
  EXPECT_EQ(blend.source()(25, 27), Blend::kFilled);
  EXPECT_EQ(blend.source()(5, 5), 0) << "the base is the more exact there";
}

}  // namespace
}  // namespace maquette::heightmap::detail
