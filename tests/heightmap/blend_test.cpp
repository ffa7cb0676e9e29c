// SPDX-License-Identifier: GPL-3.0-or-later

// Claims of heightmap/detail/blend.hpp, knowledge.hpp, bands.hpp, roughness.hpp; how each is
// attacked
//   error next to the best possible        ten Gaussian reliefs, beside a solver of all nodes that
//                                            knows spectrum, noise and pixels; by place
//   no seam                                step along the border
//   better than others there by 2          gdalwarp's mosaic, a feather, a two-band blend, same run
//   the truth's spectrum, to the border     120 reliefs: octaves where relief is above noise,
//   inside
//                                            and along the border
//   stated uncertainty                     the same: share of errors within 1 and 1.96 sigma, by
//                                            place
//   bands add up, with equal weights        any grid, odd sizes; shares add up to one
//   no images of a wave in other waves      second differences of a wave's bands, weighted unevenly
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
}

/// Spectrum and stated uncertainty need no oracle, so there are truths enough to tell them from
/// chance: an octave of eight truths to 2 %, coverage to 0.6 points.
TEST(Fusion, HasTheTruthsSpectrumAndSaysHowFarItIsOff) {
  WaveLedger waves;
  Coverage coverage;
  Score score;
  for (const TrialCase& what : trial_cases(120)) {
    const Trial t = make_trial(what);
    const Fused ours = fused(t);
    waves.add(t, ours.z_m);
    coverage.add(t, ours);
    add_to(score, t, ours.z_m);
  }
  for (std::size_t octave = 0; octave < WaveLedger::kShown; ++octave)
    for (std::size_t i = 0; i < WaveLedger::kFrom.size(); ++i) {
      if (waves.trials[octave][i] == 0.0) continue;
      const double ratio = waves.ours[octave][i] / waves.truth[octave][i];
      EXPECT_NEAR(ratio, 1.0, 0.05) << "octave " << octave << " from " << WaveLedger::kFrom[i];
      RecordProperty(
          fmt::format("power over truth, waves of {} to {} nodes, relief over noise from {}",
                      2 << octave, 4 << octave, WaveLedger::kFrom[i]),
          fmt::format("{:.4f} of {} truths", ratio, waves.trials[octave][i]));
    }
  for (std::size_t octave = 0; octave < score.power.size(); ++octave) {
    EXPECT_NEAR(score.power[octave] / score.true_power[octave], 1.0, 0.05) << octave;
    RecordProperty(fmt::format("power over truth, profiles at the border, octave {}", octave),
                   fmt::format("{:.4f}", score.power[octave] / score.true_power[octave]));
  }
  for (const Place p : {kInside, kInsideBorder, kOutsideBorder, kOutside}) {
    const double one = coverage.one[p] / coverage.nodes[p],
                 two = coverage.two[p] / coverage.nodes[p];
    EXPECT_NEAR(one, 0.683, 0.03) << p;
    EXPECT_NEAR(two, 0.950, 0.03) << p;
    RecordProperty(fmt::format("within 1 and 1.96 sigma, place {}", static_cast<int>(p)),
                   fmt::format("{:.4f} {:.4f}", one, two));
  }
  const auto& [one, two, nodes] = coverage.outermost;
  RecordProperty("within 1 and 1.96 sigma, outermost nodes",
                 fmt::format("{:.4f} {:.4f}", one / nodes, two / nodes));
  EXPECT_NEAR(one / nodes, 0.683, 0.03);
  EXPECT_NEAR(two / nodes, 0.950, 0.03);
}

/// Beyond a finer source: octaves from two pixels on, where relief is above the pixels' noise.
TEST(Fusion, HasTheTruthsSpectrumInACoarseSource) {
  for (const std::ptrdiff_t pixel : {4, 8})
    for (const double sigma_m : {0.02, 0.06}) {
      std::array<double, kOctaves> ours{}, truth{}, over_noise{};
      for (std::uint64_t seed = 1; seed <= 24; ++seed) {
        const Trial t =
            make_trial({seed, std::array{0.5, 0.7, 0.9}[seed % 3], sigma_m, 0.1, pixel});
        const Grid<float> z = restored(t);
        const Expected e = expected(t);
        for (const std::ptrdiff_t r0 : {16, 48})
          for (const std::ptrdiff_t c0 : {16, 48}) {
            const auto a = wave_powers<64>([&](auto r, auto c) { return double(z(r, c)); }, r0, c0);
            const auto b = wave_powers<64>([&](auto r, auto c) { return t.truth(r, c); }, r0, c0);
            for (std::size_t k = 0; k < kOctaves; ++k) {
              ours[k] += a[k] / e.relief_m2[k];
              truth[k] += b[k] / e.relief_m2[k];
            }
          }
        for (std::size_t k = 0; k < kOctaves; ++k)
          over_noise[k] +=
              e.over_noise[k] / 24.0 * std::pow(0.1 / (sigma_m * static_cast<double>(pixel)), 2.0);
      }
      int looked_at = 0;
      for (std::size_t k = 0; k < kOctaves; ++k) {
        if (std::ptrdiff_t{2} << k < 2 * pixel || over_noise[k] < 1.0) continue;
        EXPECT_NEAR(ours[k] / truth[k], 1.0, 0.05) << "pixel " << pixel << ", octave " << k;
        RecordProperty(
            fmt::format("pixels of {}, noise {} m, waves of {} nodes on", pixel, sigma_m, 2 << k),
            fmt::format("{:.4f}, relief over noise {:.2f}", ours[k] / truth[k], over_noise[k]));
        ++looked_at;
      }
      EXPECT_GT(looked_at, 0);
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

/// What restoring asked for at pixels of ten nodes without noise (Gale at 1:200).
const std::vector<float> kUneven{-2.63F, -2.09F, 0.25F, 1.19F, 2.41F,
                                 2.38F,  1.81F,  1.58F, 0.62F, 0.41F};

/// Of a wave nothing is made but the same wave, weaker or stronger. Images that the few nodes of
/// levels make of it show in second differences, as a pattern of every second, fourth, eighth node.
TEST(Bands, MakeNoImagesOfAWave) {
  constexpr std::ptrdiff_t n = 1200, edge = 200;
  constexpr auto inside = static_cast<double>(n - 2 * edge);
  for (const bool along_x : {true, false})
    for (const double f : {0.01, 0.03, 0.05, 0.07, 0.1, 0.14, 0.2, 0.3}) {
      const double turn = 2.0 * std::numbers::pi * f;
      Grid<float> z(along_x ? 64 : n, along_x ? n : 64);
      for (std::ptrdiff_t r = 0; r < z.rows(); ++r)
        for (std::ptrdiff_t c = 0; c < z.cols(); ++c)
          z(r, c) = static_cast<float>(std::cos(turn * static_cast<double>(along_x ? c : r)));
      const Grid<float> of = weighted_bands(z, 3, {{kUneven}});
      const auto height = [&](std::ptrdiff_t i) {
        return static_cast<double>(along_x ? of(32, i) : of(i, 32));
      };
      double even = 0.0, odd = 0.0;
      for (std::ptrdiff_t i = edge; i < n - edge; ++i) {
        even += 2.0 / inside * height(i) * std::cos(turn * static_cast<double>(i));
        odd += 2.0 / inside * height(i) * std::sin(turn * static_cast<double>(i));
      }
      const auto rest = [&](std::ptrdiff_t i) {
        const double x = turn * static_cast<double>(i);
        return height(i) - even * std::cos(x) - odd * std::sin(x);
      };
      double square = 0.0;
      for (std::ptrdiff_t i = edge + 1; i < n - edge - 1; ++i)
        square += std::pow(rest(i - 1) - 2.0 * rest(i) + rest(i + 1), 2.0);
      const double bend = std::pow(2.0 * std::sin(0.5 * turn), 2.0) * std::sqrt(0.5);
      // With half as many nodes a level's images bend by 0.04 to 0.14 of the wave.
      EXPECT_LT(std::sqrt(square / inside) / bend, 0.001) << f << (along_x ? " x" : " y");
    }
}

TEST(Roughness, MeasuresLawAndNoise) {
  for (const TrialCase& what : trial_cases()) {
    const Trial t = make_trial(what);
    PixelWindow window;
    window.height_m = t.layer;
    const Roughness found = measure_roughness(window, {1.0, 1.0});
    EXPECT_NEAR(found.hurst, what.hurst, 0.1) << what.seed;  // of half of 128 x 128 pixels
    // Least noise is least known: below a third of the relief of the shortest waves.
    EXPECT_NEAR(found.noise_m / what.fine_sigma_m, 1.0, what.fine_sigma_m < 0.05 ? 0.15 : 0.1)
        << what.seed;
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
