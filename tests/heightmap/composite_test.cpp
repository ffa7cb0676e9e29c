// SPDX-License-Identifier: GPL-3.0-or-later

// Claims of heightmap/composite.hpp and detail/composite_bands.hpp and how each is attacked
//   slopes at the crossover are the relief's   reliefs of 400 plane waves whose spectrum is known
//   in
//                                                closed form; the gain against it, ten seeds; power
//                                                of the result by Fourier sums written out here
//   long waves stay, short ones are exchanged  single waves on either side, flat other surface
//   both have half at the crossover            single waves there
//   edges stay whole                           a slope and long waves, up to the outermost node
//   who is where                               rasters of Moon and Mars: masks, reports, gain
//   sigma covers the ground of the site        share of errors within 1.96 sigma
//   an enlargement has the same heights        means over wide nodes
//   one body, wrong file, crossovers that do   each its error, with numbers that would do
//     not work, flat detail

#include <algorithm>
#include <cmath>
#include <complex>
#include <cstdint>
#include <numbers>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/random.hpp"
#include "heightmap/composite.hpp"
#include "heightmap/detail/composite_bands.hpp"
#include "support/matchers.hpp"
#include "support/planet_raster.hpp"

namespace maquette::heightmap {
namespace {

using ::testing::HasSubstr;
using testing_support::FailsWith;
using testing_support::PlanetRaster;
using testing_support::ScratchFolder;
using testing_support::Succeeds;
using testing_support::write_planet_raster;

constexpr double kTurn = 2.0 * std::numbers::pi;

struct Wave {
  double amplitude, fx, fy, phase;
  [[nodiscard]] double f() const { return std::hypot(fx, fy); }
};
using Ground = std::vector<Wave>;

/// Waves from `shortest` to `longest`, evenly over octaves, heights as length^hurst.
Ground ground(std::uint64_t seed, double roughness, double hurst, double shortest, double longest,
              std::uint64_t many = 400) {
  Ground out;
  for (std::uint64_t i = 0; i < many; ++i) {
    const double length =
        shortest *
        std::pow(longest / shortest, (static_cast<double>(i) + random_uniform(seed, 3 * i)) /
                                         static_cast<double>(many));
    const double way = kTurn * random_uniform(seed, 3 * i + 1);
    out.push_back({roughness * std::pow(length, hurst), std::cos(way) / length,
                   std::sin(way) / length, kTurn * random_uniform(seed, 3 * i + 2)});
  }
  return out;
}

/// The library's own product looks for infinities.
std::complex<double> turned(std::complex<double> a, std::complex<double> by) {
  return {a.real() * by.real() - a.imag() * by.imag(), a.real() * by.imag() + a.imag() * by.real()};
}

double height(const Ground& g, double x, double y) {
  double z = 0.0;
  for (const Wave& w : g) z += w.amplitude * std::sin(kTurn * (w.fx * x + w.fy * y) + w.phase);
  return z;
}

Grid<float> seen(const Ground& g, std::ptrdiff_t n, double spacing) {
  Grid<double> z(n, n, 0.0);
  for (const Wave& w : g) {
    const std::complex<double> step = std::polar(1.0, kTurn * w.fx * spacing);
    for (std::ptrdiff_t r = 0; r < n; ++r) {
      std::complex<double> at =
          std::polar(w.amplitude, kTurn * w.fy * spacing * static_cast<double>(r) + w.phase);
      for (std::ptrdiff_t c = 0; c < n; ++c, at = turned(at, step)) z(r, c) += at.imag();
    }
  }
  Grid<float> out(n, n);
  for (std::size_t i = 0; i < z.cells().size(); ++i)
    out.cells()[i] = static_cast<float>(z.cells()[i]);
  return out;
}

/// Mean square slope of the octave around a wavelength, weighed as the header says.
double slope_power(const Ground& g, double wavelength) {
  double sum = 0.0;
  for (const Wave& w : g) {
    const double octave = std::log2(w.f() * wavelength) + 0.5;
    if (octave <= 0.0 || octave >= 1.0) continue;
    sum += 0.5 * std::pow(w.amplitude * kTurn * w.f() * std::sin(std::numbers::pi * octave), 2.0);
  }
  return sum;
}

/// Mean square slope of waves between two lengths, by Fourier sums over the middle under a window.
double seen_slope_power(const Grid<float>& z, double spacing, double shortest, double longest) {
  const std::ptrdiff_t n = z.rows(), edge = n / 8, inner = n - 2 * edge;
  const auto window = [&](std::ptrdiff_t i) {
    return std::pow(std::sin(std::numbers::pi * (static_cast<double>(i - edge) + 0.5) /
                             static_cast<double>(inner)),
                    2.0);
  };
  double sum = 0.0;
  constexpr std::uint64_t kSums = 150;
  for (std::uint64_t k = 0; k < kSums; ++k) {
    // Even over the plane of frequencies.
    const double a = 1.0 / (longest * longest), b = 1.0 / (shortest * shortest);
    const double f = std::sqrt(a + (b - a) * (static_cast<double>(k) + 0.5) / kSums);
    const double way = kTurn * random_uniform(99, k);
    const double fx = f * std::cos(way), fy = f * std::sin(way);
    std::complex<double> total = 0.0;
    for (std::ptrdiff_t r = edge; r < n - edge; ++r) {
      std::complex<double> row = 0.0, at = 1.0;
      const std::complex<double> step = std::polar(1.0, -kTurn * fx * spacing);
      for (std::ptrdiff_t c = edge; c < n - edge; ++c, at = turned(at, step))
        row += window(c) * static_cast<double>(z(r, c)) * at;
      total += window(r) * row * std::polar(1.0, -kTurn * fy * spacing * static_cast<double>(r));
    }
    sum += std::norm(total) * f * f;
  }
  return sum;
}

double rms(const Grid<float>& z, std::ptrdiff_t margin) {
  double sum = 0.0, n = 0.0;
  for (std::ptrdiff_t r = margin; r < z.rows() - margin; ++r)
    for (std::ptrdiff_t c = margin; c < z.cols() - margin; ++c, n += 1.0)
      sum += std::pow(static_cast<double>(z(r, c)), 2.0);
  return std::sqrt(sum / n);
}

Grid<float> sum_of(Grid<float> a, const Grid<float>& b) {
  for (std::size_t i = 0; i < a.cells().size(); ++i) a.cells()[i] += b.cells()[i];
  return a;
}

constexpr std::ptrdiff_t kNodes = 320;
constexpr double kSpacing = 0.5, kCrossover_m = 12.0;  // 13 waves across

TEST(CompositeBands, SlopesContinueAtTheCrossover) {
  double square = 0.0, chi2 = 0.0, worst = 0.0, ratio_sum = 0.0, steepest = 0.0;
  constexpr int kSeeds = 10;
  for (std::uint64_t seed = 1; seed <= kSeeds; ++seed) {
    // Steep detail of another law on gentle relief, and the reverse.
    const double strength = seed % 2 == 0 ? 5.0 : 0.2;
    const Ground relief = ground(seed, 0.01, 0.8, 6.0, 300.0),
                 detail = ground(100 + seed, 0.01 * strength, 0.7, 1.5, 300.0);
    const Grid<float> low = seen(relief, kNodes, kSpacing), high = seen(detail, kNodes, kSpacing);
    const CompositeMatch match = detail::match_slopes(low, high, kSpacing, kCrossover_m);
    const double truth =
        std::sqrt(slope_power(relief, kCrossover_m) / slope_power(detail, kCrossover_m));
    const double off = match.gain / truth - 1.0;
    square += off * off / kSeeds;
    worst = std::fmax(worst, std::abs(off));
    chi2 += std::pow((match.gain - truth) / match.gain_sigma, 2.0) / kSeeds;
    EXPECT_NEAR(match.relief_slope, std::sqrt(slope_power(relief, kCrossover_m)),
                0.15 * match.relief_slope);
    const Grid<float> made = sum_of(low, detail::exchanged_waves(low, high, kSpacing, match));
    const double ratio =
        std::sqrt(seen_slope_power(made, kSpacing, kCrossover_m / std::numbers::sqrt2,
                                   kCrossover_m * std::numbers::sqrt2) /
                  seen_slope_power(low, kSpacing, kCrossover_m / std::numbers::sqrt2,
                                   kCrossover_m * std::numbers::sqrt2));
    ratio_sum += ratio / kSeeds;
    steepest = std::fmax(steepest, std::abs(ratio - 1.0));
    if (seed > 2) continue;
    // Without a gain the same place would be five times as steep or a fifth.
    const CompositeMatch plain{kCrossover_m, 1.0};
    const double unmatched =
        std::sqrt(seen_slope_power(sum_of(low, detail::exchanged_waves(low, high, kSpacing, plain)),
                                   kSpacing, 0.5 * kCrossover_m, kCrossover_m) /
                  seen_slope_power(low, kSpacing, 0.5 * kCrossover_m, kCrossover_m));
    EXPECT_GT(std::abs(std::log(unmatched)), 0.5);
  }
  RecordProperty("gain_rms_relative_error", std::to_string(std::sqrt(square)));
  RecordProperty("gain_worst_relative_error", std::to_string(worst));
  RecordProperty("gain_chi2", std::to_string(chi2));
  RecordProperty("slope_over_relief_mean", std::to_string(ratio_sum));
  RecordProperty("slope_over_relief_worst", std::to_string(steepest));
  // 160 m hold 500 independent values of this octave: 1 / sqrt(500) of the gain. Waves of fixed
  // heights scatter less than Gaussian relief, for which gain_sigma is stated.
  EXPECT_LT(std::sqrt(square), 0.05);
  EXPECT_LT(chi2, 1.5);
  // Where both meet their waves add up at random: 150 Fourier sums see that to 6 % of one seed.
  EXPECT_NEAR(ratio_sum, 1.0, 0.05);
  EXPECT_LT(steepest, 0.2);
}

TEST(CompositeBands, LongWavesStayAndShortOnesAreExchanged) {
  const CompositeMatch match{kCrossover_m, 0.5};
  const Grid<float> flat(kNodes, kNodes, 3.0F);
  const auto edge = static_cast<std::ptrdiff_t>(kCrossover_m / kSpacing);
  const Grid<float> long_waves =
                        seen(ground(5, 1.0, 0.0, 2.0 * kCrossover_m, 200.0, 40), kNodes, kSpacing),
                    short_waves =
                        seen(ground(6, 1.0, 0.0, 2.0, 0.7 * kCrossover_m, 40), kNodes, kSpacing);
  EXPECT_LT(rms(detail::exchanged_waves(long_waves, flat, kSpacing, match), edge),
            2e-3 * rms(long_waves, 0));
  EXPECT_LT(rms(detail::exchanged_waves(flat, long_waves, kSpacing, match), edge),
            2e-3 * rms(long_waves, 0));
  const Grid<float> gone =
      sum_of(short_waves, detail::exchanged_waves(short_waves, flat, kSpacing, match));
  EXPECT_LT(rms(gone, edge), 0.02 * rms(short_waves, 0));
  Grid<float> added = detail::exchanged_waves(flat, short_waves, kSpacing, match);
  for (std::size_t i = 0; i < added.cells().size(); ++i)
    added.cells()[i] -= 0.5F * short_waves.cells()[i];
  EXPECT_LT(rms(added, edge), 0.02 * rms(short_waves, 0));
}

TEST(CompositeBands, BothHaveHalfOfThePowerAtTheCrossover) {
  const CompositeMatch match{kCrossover_m, 1.0};
  const Grid<float> flat(kNodes, kNodes, 0.0F),
      wave = seen({{1.0, 0.6 / kCrossover_m, 0.8 / kCrossover_m, 0.3}}, kNodes, kSpacing);
  const auto edge = static_cast<std::ptrdiff_t>(2.0 * kCrossover_m / kSpacing);
  EXPECT_NEAR(rms(sum_of(wave, detail::exchanged_waves(wave, flat, kSpacing, match)), edge) /
                  rms(wave, edge),
              std::numbers::sqrt2 / 2.0, 0.01);
  EXPECT_NEAR(rms(detail::exchanged_waves(flat, wave, kSpacing, match), edge) / rms(wave, edge),
              std::numbers::sqrt2 / 2.0, 0.01);
}

TEST(CompositeBands, EdgesStayWhole) {
  const CompositeMatch match{kCrossover_m, 1.0};
  Grid<float> slope(kNodes, kNodes);
  const Grid<float> flat(kNodes, kNodes, 0.0F);
  const Ground hills = ground(7, 0.02, 1.0, 8.0 * kCrossover_m, 400.0, 12);
  const Grid<float> wide = seen(hills, kNodes, kSpacing);
  for (std::ptrdiff_t r = 0; r < kNodes; ++r)
    for (std::ptrdiff_t c = 0; c < kNodes; ++c)
      slope(r, c) =
          -1500.0F + 0.3F * static_cast<float>(c) - 0.2F * static_cast<float>(r) + wide(r, c);
  const Grid<float> change = detail::exchanged_waves(slope, flat, kSpacing, match);
  float farthest = 0.0F;
  for (const float c : change.cells()) farthest = std::max(farthest, std::abs(c));
  // Curvature turns over at the edge: of waves of eight crossovers, 30 m high, that is some cm.
  RecordProperty("farthest_m", std::to_string(farthest));
  EXPECT_LT(static_cast<double>(farthest), 0.015 * rms(wide, 0));
}

/// Moon of 5 m pixels, Mars of 1 m at another place, both known everywhere.
class Composite : public ::testing::Test {
 protected:
  void SetUp() override {
    const auto raster = [&](double radius, double pixel, double half, const Ground& g,
                            double level) {
      PlanetRaster r;
      r.projection =
          "+proj=eqc +lat_ts=0 +lon_0=0 +R=" + std::to_string(radius) + " +units=m +no_defs";
      r.pixel = pixel;
      r.cols = r.rows = static_cast<int>(2.0 * half / pixel);
      r.west = -half;
      r.north = half;
      r.height = [&g, level](double x, double y) { return level + height(g, x, y); };
      return r;
    };
    write_planet_raster(raster(1737400.0, 5.0, 150.0, moon_, -1500.0), scratch_ / "moon.tif");
    auto mars = raster(3396190.0, 1.0, 115.0, mars_, 200.0);
    const double east = 3396190.0 * 10.0 * std::numbers::pi / 180.0;  // at 10 E
    const auto here = mars.height;
    mars.west += east;
    mars.height = [here, east](double x, double y) { return here(x - east, y); };
    write_planet_raster(mars, scratch_ / "mars.tif");
    request_.relief.body = *body_by_name("moon");
    request_.relief.half_width = Metres{100.0};
    request_.relief.spacing = Metres{1.0};
    request_.relief.sources = {Source{"lola", scratch_ / "moon.tif", "auto", 0.1}};
    request_.detail = request_.relief;
    request_.detail.body = *body_by_name("mars");
    request_.detail.centre_longitude_deg = 10.0;
    request_.detail.sources = {Source{"hirise", scratch_ / "mars.tif", "auto", 0.02}};
  }
  ScratchFolder scratch_;
  const Ground moon_ = ground(11, 0.01, 0.9, 12.0, 300.0, 150),
               mars_ = ground(12, 0.05, 0.9, 3.0, 300.0, 150);
  CompositeRequest request_;
};

TEST_F(Composite, SaysWhoIsWhereAndCoversTheGround) {
  const auto made = composite(request_);
  ASSERT_THAT(made, Succeeds());
  EXPECT_NEAR(made->match.crossover_m, 20.0, 0.1) << "four pixels of the relief";
  const double truth = std::sqrt(slope_power(moon_, 20.0) / slope_power(mars_, 20.0));
  EXPECT_NEAR(made->match.gain, truth, 3.0 * made->match.gain_sigma);
  EXPECT_LT(made->match.gain_sigma, 0.02);
  ASSERT_EQ(made->surface.sources.size(), 2U);
  EXPECT_EQ(made->surface.sources[0].name, "lola");
  EXPECT_EQ(made->surface.sources[1].name, "hirise");
  EXPECT_EQ(made->surface.source(50, 50), 0);
  EXPECT_EQ(made->detail_source(50, 50), 1);
  double covered = 0.0, nodes = 0.0, level = 0.0;
  for (std::ptrdiff_t r = 0; r < 201; ++r)
    for (std::ptrdiff_t c = 0; c < 201; ++c, nodes += 1.0) {
      const double off =
          static_cast<double>(made->surface.field.z_m(r, c)) + 1500.0 -
          height(moon_, static_cast<double>(c) - 100.0, static_cast<double>(r) - 100.0);
      covered +=
          std::abs(off) < 1.96 * static_cast<double>(made->surface.sigma_m(r, c)) ? 1.0 : 0.0;
      level += off;
    }
  EXPECT_GT(covered / nodes, 0.92);
  EXPECT_NEAR(level / nodes, 0.0, 0.01) << "nothing of the detail's own level";
}

TEST_F(Composite, TakesACrossoverThatIsAskedFor) {
  request_.crossover_m = 16.0;
  const auto made = composite(request_);
  ASSERT_THAT(made, Succeeds());
  EXPECT_EQ(made->match.crossover_m, 16.0);
}

TEST_F(Composite, IsEnlargedWithTheSameHeights) {
  const auto wide = composite(request_);
  ASSERT_THAT(wide, Succeeds());
  CompositeRequest fine = request_;
  fine.relief.half_width = fine.detail.half_width = Metres{20.0};
  fine.relief.spacing = fine.detail.spacing = Metres{0.2};
  fine.as_before = wide->match;
  fine.wider.field = wide->surface.field;
  fine.relief.enlarges.emplace().sources = {wide->surface.sources[0]};
  fine.detail.enlarges.emplace().sources = {wide->surface.sources[1]};
  const auto made = composite(fine);
  ASSERT_THAT(made, Succeeds());
  EXPECT_EQ(made->match.gain, wide->match.gain);
  EXPECT_LT(made->surface.mean_off_m, 0.001) << "float32 at -1500 m";
  // By hand: the mean over the cell of the wide node at the centre.
  double sum = 0.0, weights = 0.0;
  for (std::ptrdiff_t r = -3; r <= 3; ++r)
    for (std::ptrdiff_t c = -3; c <= 3; ++c) {
      const double w = (std::abs(r) == 3 ? 0.0 : 1.0) * (std::abs(c) == 3 ? 0.0 : 1.0);
      sum += w * static_cast<double>(made->surface.field.z_m(100 + r, 100 + c));
      weights += w;
    }
  EXPECT_NEAR(sum / weights, static_cast<double>(wide->surface.field.z_m(100, 100)), 0.001);
}

TEST_F(Composite, RefusesWhatCannotBeCombined) {
  CompositeRequest one_body = request_;
  one_body.detail = one_body.relief;
  const auto same = composite(one_body);
  EXPECT_THAT(same, FailsWith(kSameBody));
  EXPECT_THAT(same.error().message, ::testing::AllOf(HasSubstr("moon"), HasSubstr("same_body")));

  CompositeRequest wrong = request_;
  wrong.detail.sources[0].path = scratch_ / "moon.tif";
  wrong.detail.centre_longitude_deg = 0.0;
  EXPECT_THAT(composite(wrong), FailsWith(kWrongBody)) << "said to be of Mars, and is not";
  wrong = request_;
  wrong.relief.sources.push_back(request_.detail.sources[0]);
  EXPECT_THAT(composite(wrong), FailsWith(kWrongBody)) << "never aligned with the Moon";
}

TEST_F(Composite, RefusesCrossoversThatDoNotWork) {
  const auto refused = [&](double crossover_m, const char* expected) {
    request_.crossover_m = crossover_m;
    const auto made = composite(request_);
    ASSERT_THAT(made, FailsWith(kCrossover));
    EXPECT_THAT(made.error().message, HasSubstr(expected));
  };
  refused(10.0, "14.1");  // 2 sqrt(2) pixels of 5 m
  refused(40.0, "25 m");  // 200 m / 8
  std::swap(request_.relief, request_.detail);
  refused(8.0, "detail's pixels");
  std::swap(request_.relief, request_.detail);
  PlanetRaster flat;
  flat.projection = "+proj=eqc +lat_ts=0 +lon_0=0 +R=3396190 +units=m +no_defs";
  flat.pixel = 1.0;
  flat.cols = flat.rows = 240;
  flat.west = -120.0;
  flat.north = 120.0;
  write_planet_raster(flat, scratch_ / "flat.tif");
  request_.detail.centre_longitude_deg = 0.0;
  request_.detail.sources[0].path = scratch_ / "flat.tif";
  refused(0.0, "no slopes");
}

}  // namespace
}  // namespace maquette::heightmap
