// SPDX-License-Identifier: GPL-3.0-or-later

// camera/effects, from light to file, each against its closed form:
//   exposure ......... photons of a known radiance by hand; relative: value 1 fills the well
//   bayer, demosaic .. constant and linear pictures come back exactly inside; both methods; order
//   of
//                      patterns
//   dark current ..... growth against values worked out by hand; doubling near room temperature
//   smear ............ a bright bar's tail; the sum over a column
//   full well ........ charge kept to 1e-6 for random columns; one pixel's spill by hand
//   hot pixels ....... share, mean rate; the same places at another time; dark library between
//   prnu, dsnu, read, row, column ... mean and variance; what repeats and what does not
//   adc .............. rounding, black level, both ends
//   white balance .... grey is grey; mosaics
//   tone ............. against the curve itself, everywhere
//   jpeg ............. a flat picture to one step; worse for lower quality; large pictures refused

#include <cmath>
#include <numeric>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "camera/image_io.hpp"
#include "camera/stack.hpp"
#include "core/random.hpp"
#include "support/matchers.hpp"
#include "support/shots.hpp"

namespace maquette::camera {
namespace {

using testing_support::FailsWith;
using testing_support::flat;
using testing_support::shot_of;
using testing_support::Succeeds;

template <class E>
Frame through(const E& effect, const Shot& shot, Frame frame) {
  EXPECT_THAT(check(effect, shot), Succeeds());
  const RowFunction f = rows(effect, shot, frame);
  for (std::ptrdiff_t r = 0; r < frame.bands[0].rows(); ++r) {
    std::vector<std::span<float>> spans;
    for (auto& band : frame.bands) spans.push_back(band.row(r));
    f(r, spans);
  }
  return frame;
}

struct Moments {
  double mean = 0.0, variance = 0.0;
};
Moments moments(const Grid<float>& g) {
  double sum = 0.0, square = 0.0;
  for (const float v : g.cells()) sum += static_cast<double>(v);
  const double n = static_cast<double>(g.cells().size()), mean = sum / n;
  for (const float v : g.cells()) {
    const double d = static_cast<double>(v) - mean;
    square += d * d;
  }
  return {mean, square / n};
}

TEST(ExposureEffect, CountsThePhotonsOfAKnownRadiance) {
  Shot shot = shot_of(4, 4);
  shot.f_number = 8.0, shot.pixel_pitch_um = 10.0, shot.exposure_s = 0.02;
  shot.wavelength_nm = {500.0};
  Exposure e;
  e.radiance_of_one = {2.0}, e.transmission = 0.9;
  // pi 2 0.9 / 256 W/m2 = 0.0220893; times 1e-10 m2 and 0.02 s: 4.41786e-14 J; a photon of 500 nm
  // has 3.972892e-19 J.
  EXPECT_NEAR(photons_at_one(e, shot, 0), 111200.2, 0.5);
  const Frame f = through(e, shot, flat(4, 4, 0.5));
  EXPECT_NEAR(static_cast<double>(f.bands[0](1, 1)), 55600.1, 0.3);
  e.magnification = 1.0;  // at 1:1 the lens works at twice its f-number
  EXPECT_NEAR(photons_at_one(e, shot, 0), 111200.2 / 4.0, 0.2);
  EXPECT_EQ(through(e, shot, flat(4, 4, -0.5)).bands[0](2, 2), 0.0F);
}

TEST(ExposureEffect, FillsTheWellOfTheBestBandAtOne) {
  Shot shot = shot_of(4, 4);
  shot.quantum_efficiency = {0.2, 0.4, 0.1}, shot.full_well_e = 50000.0;
  const auto f = expose({Exposure{}, QuantumEfficiency{}}, shot, flat(4, 4, 1.0, 3));
  ASSERT_THAT(f, Succeeds());
  for (const auto& [band, electrons] : {std::pair{0U, 25000.0}, {1U, 50000.0}, {2U, 12500.0}})
    EXPECT_NEAR(static_cast<double>(f->bands[band](0, 0)), electrons, 0.01);
}

class Mosaics : public testing::TestWithParam<std::tuple<std::string, std::string>> {};

TEST_P(Mosaics, GiveConstantAndLinearPicturesBack) {
  const auto& [pattern, method] = GetParam();
  const int w = 24, h = 18;
  Shot shot = shot_of(w, h);
  Frame frame = flat(w, h, 0.0, 3);
  for (std::size_t b = 0; b < 3; ++b)
    for (std::ptrdiff_t r = 0; r < h; ++r)
      for (std::ptrdiff_t c = 0; c < w; ++c)
        frame.bands[b](r, c) =
            1000.0F * static_cast<float>(b + 1) + static_cast<float>(8 * r + 4 * c);
  Frame mosaic = frame;
  apply(Bayer{pattern}, shot, mosaic);
  ASSERT_EQ(mosaic.bands.size(), 1U);
  const std::string upper_left = pattern.substr(0, 1);
  EXPECT_EQ(mosaic.bands[0](0, 0), upper_left == "r"   ? 1000.0F
                                   : upper_left == "g" ? 2000.0F
                                                       : 3000.0F);
  const Grid<float> raw = mosaic.bands[0];
  apply(Demosaic{method}, shot, mosaic);
  ASSERT_EQ(mosaic.bands.size(), 3U);
  // Linear along rows and columns: all second differences vanish, so inside both are exact.
  for (std::size_t b = 0; b < 3; ++b)
    for (std::ptrdiff_t r = 2; r < h - 2; ++r)
      for (std::ptrdiff_t c = 2; c < w - 2; ++c)
        ASSERT_EQ(mosaic.bands[b](r, c), frame.bands[b](r, c)) << b << " " << r << " " << c;
  // What was measured stays, edges included.
  const BayerPattern p = *bayer_pattern(pattern);
  for (std::ptrdiff_t r = 0; r < h; ++r)
    for (std::ptrdiff_t c = 0; c < w; ++c)
      ASSERT_EQ(mosaic.bands[static_cast<std::size_t>(p.at(r, c))](r, c), raw(r, c));
}
INSTANTIATE_TEST_SUITE_P(All, Mosaics,
                         testing::Combine(testing::Values("rggb", "bggr", "grbg", "gbrg"),
                                          testing::Values("malvar", "bilinear")));

TEST(DemosaicEffect, HasMalvarsWeights) {
  // One bright green pixel of a black picture: red and blue there get 5/8, a red pixel beside it
  // sees green 1/4, two rows on -1/8 of its own colour (none here).
  Shot shot = shot_of(16, 16);
  Frame f = flat(16, 16, 1000.0);
  f.mosaic = bayer_pattern("rggb");
  f.bands[0](8, 7) = 1800.0F;  // green in a row of red
  apply(Demosaic{}, shot, f);
  EXPECT_EQ(f.bands[0](8, 7), 1000.0F + 5.0F / 8.0F * 800.0F);
  EXPECT_EQ(f.bands[2](8, 7), 1000.0F + 5.0F / 8.0F * 800.0F);
  EXPECT_EQ(f.bands[1](8, 8), 1000.0F + 0.25F * 800.0F);
  EXPECT_EQ(f.bands[0](8, 9), 1000.0F - 0.125F * 800.0F);    // beside in the row: -1/8
  EXPECT_EQ(f.bands[0](10, 7), 1000.0F + 0.0625F * 800.0F);  // across: +1/16
}

TEST(DarkCurrentEffect, GrowsAsSilicon) {
  // T^1.5 exp(-Eg / 2kT) by hand: Eg(293.15) = 1.11264 eV, Eg(300.15) = 1.11078 eV;
  // ln ratio = 1.5 ln(300.15 / 293.15) + (1.11264 / 293.15 - 1.11078 / 300.15) / (2 8.617333e-5)
  const double eg1 = 1.1557 - 7.021e-4 * 293.15 * 293.15 / 1401.15;
  const double eg2 = 1.1557 - 7.021e-4 * 300.15 * 300.15 / 1408.15;
  const double by_hand = std::pow(300.15 / 293.15, 1.5) *
                         std::exp((eg1 / 293.15 - eg2 / 300.15) / (2.0 * 8.617333262e-5));
  EXPECT_NEAR(dark_growth(27.0, 20.0), by_hand, 1e-12);
  EXPECT_GT(dark_growth(28.0, 20.0), 1.9);  // makers' rule: twice for 6 to 9 K
  EXPECT_LT(dark_growth(26.0, 20.0), 2.0);
  EXPECT_EQ(dark_growth(20.0, 20.0), 1.0);
  Shot shot = shot_of(4, 4);
  shot.temperature_c = 27.0, shot.exposure_s = 10.0;
  const Frame f = through(DarkCurrent{3.0, 20.0}, shot, flat(4, 4, 100.0));
  EXPECT_NEAR(static_cast<double>(f.bands[0](0, 0)), 100.0 + 30.0 * by_hand, 1e-4);
}

TEST(SmearEffect, AddsTheColumnsLight) {
  Shot shot = shot_of(8, 100);
  shot.exposure_s = 0.01;
  Frame f = flat(8, 100, 0.0);
  for (std::ptrdiff_t r = 40; r < 50; ++r) f.bands[0](r, 3) = 1000.0F;
  apply(Smear{1e-6}, shot, f);  // 1e-4 of the exposure under each row
  EXPECT_NEAR(static_cast<double>(f.bands[0](0, 3)), 1.0, 1e-5);
  EXPECT_NEAR(static_cast<double>(f.bands[0](45, 3)), 1000.9, 1e-3);
  EXPECT_EQ(f.bands[0](45, 4), 0.0F);
}

TEST(Spill, KeepsTheCharge) {
  for (std::uint64_t seed = 1; seed <= 50; ++seed) {
    std::vector<double> column(500);
    for (std::size_t i = 0; i < column.size(); ++i) {
      const double u = random_uniform(seed, i);
      column[i] = u > 0.9 ? 1e6 * u : 4e4 * u;
    }
    const double share = random_uniform(seed, 999), well = 50000.0;
    const double before = std::accumulate(column.begin(), column.end(), 0.0);
    const LostCharge lost = spill(column, well, share);
    const double after = std::accumulate(column.begin(), column.end(), 0.0);
    EXPECT_NEAR((after + lost.drained_e + lost.ends_e) / before, 1.0, 1e-12) << seed;
    EXPECT_LE(*std::max_element(column.begin(), column.end()), well * (1.0 + 1e-12));
  }
}

TEST(Spill, FillsTheNextWellsThatHaveRoom) {
  std::vector<double> column{0, 90, 50, 300, 100, 95, 0, 0};
  const LostCharge lost = spill(column, 100.0, 1.0);
  // 100 each way: upwards 50 fills one, 10 the next, 40 remain; downwards past a full well, 5, 95.
  EXPECT_THAT(column, testing::ElementsAre(40, 100, 100, 100, 100, 100, 95, 0));
  EXPECT_EQ(lost.ends_e, 0.0);
  column = {300, 0};
  EXPECT_EQ(spill(column, 100.0, 0.5).ends_e, 50.0);
  EXPECT_THAT(column, testing::ElementsAre(100, 50));
}

TEST(FullWellEffect, KeepsTheChargeOfAWholePicture) {
  Shot shot = shot_of(150, 200);
  Frame f = flat(150, 200, 1000.0);
  for (std::ptrdiff_t r = 90; r < 95; ++r)
    for (std::ptrdiff_t c = 60; c < 70; ++c) f.bands[0](r, c) = 500000.0F;
  const double before = moments(f.bands[0]).mean;
  apply(FullWell{1.0}, shot, f);
  EXPECT_NEAR(moments(f.bands[0]).mean / before, 1.0, 1e-6);  // nothing reaches the ends
  EXPECT_EQ(f.bands[0](80, 65), 60000.0F);
  EXPECT_EQ(f.bands[0](80, 59), 1000.0F);
  f = flat(150, 200, 70000.0);
  apply(FullWell{0.0}, shot, f);
  EXPECT_EQ(f.bands[0](7, 7), 60000.0F);
}

TEST(HotPixelsEffect, HaveTheirShareAndMean) {
  Shot shot = shot_of(1000, 1000);
  shot.exposure_s = 2.0;
  const HotPixels e{0.01, 500.0, 20.0};
  const Frame f = through(e, shot, flat(1000, 1000, 0.0));
  double sum = 0.0;
  int hot = 0;
  for (const float v : f.bands[0].cells())
    if (v > 0.0F) ++hot, sum += static_cast<double>(v);
  EXPECT_NEAR(hot, 10000, 500);              // five standard deviations
  EXPECT_NEAR(sum / hot, 1000.0, 5 * 10.0);  // an exponential's standard error
  shot.time_s = 5.0, shot.seed = 77;
  EXPECT_EQ(through(e, shot, flat(1000, 1000, 0.0)).bands, f.bands);
}

TEST(DarkLibraryEffect, IsInterpolatedInTemperature) {
  Shot shot = shot_of(4, 4);
  shot.exposure_s = 2.0;
  DarkLibrary e;
  e.frames.push_back({0.0, Grid<float>(4, 4, 1.0F)});
  e.frames.push_back({20.0, Grid<float>(4, 4, 8.0F)});
  const auto at = [&](double celsius) {
    shot.temperature_c = celsius;
    return static_cast<double>(through(e, shot, flat(4, 4, 0.0)).bands[0](1, 1));
  };
  EXPECT_NEAR(at(0.0), 2.0, 1e-5);
  EXPECT_NEAR(at(20.0), 16.0, 1e-5);
  const double share = (1.0 / 283.15 - 1.0 / 273.15) / (1.0 / 293.15 - 1.0 / 273.15);
  EXPECT_NEAR(at(10.0), 2.0 * std::pow(8.0, share), 1e-4);
  EXPECT_NEAR(at(30.0), 16.0 * dark_growth(30.0, 20.0), 1e-3);
  EXPECT_NEAR(at(-10.0), 2.0 * dark_growth(-10.0, 0.0), 1e-4);
  std::swap(e.frames[0], e.frames[1]);
  EXPECT_THAT(check(e, shot), FailsWith(kEffectOutOfRange));
  e.frames = {{0.0, Grid<float>(3, 4)}};
  EXPECT_THAT(check(e, shot), FailsWith(kEffectOutOfRange));
}

TEST(FixedPatternEffects, RepeatAndHaveTheirVariance) {
  Shot shot = shot_of(1000, 1000), later = shot;
  later.time_s = 1.0;
  const Frame gain = through(Prnu{0.02}, shot, flat(1000, 1000, 1000.0));
  EXPECT_EQ(through(Prnu{0.02}, later, flat(1000, 1000, 1000.0)).bands, gain.bands);
  // Five standard errors: sigma / 1000 and sqrt(2) / 1000 of the variance.
  EXPECT_NEAR(moments(gain.bands[0]).mean, 1000.0, 0.1);
  EXPECT_NEAR(moments(gain.bands[0]).variance / 400.0, 1.0, 0.007);
  const Frame offset = through(Dsnu{3.0}, shot, flat(1000, 1000, 10.0));
  EXPECT_EQ(through(Dsnu{3.0}, later, flat(1000, 1000, 10.0)).bands, offset.bands);
  EXPECT_NEAR(moments(offset.bands[0]).mean, 10.0, 0.015);
  EXPECT_NEAR(moments(offset.bands[0]).variance / 9.0, 1.0, 0.007);
}

TEST(ReadoutNoise, IsNewInEveryShot) {
  Shot shot = shot_of(1000, 1000), later = shot;
  later.time_s = 1.0;
  const Frame a = through(ReadNoise{5.0}, shot, flat(1000, 1000, 0.0));
  EXPECT_NEAR(moments(a.bands[0]).mean, 0.0, 0.025);
  EXPECT_NEAR(moments(a.bands[0]).variance / 25.0, 1.0, 0.007);
  EXPECT_NE(through(ReadNoise{5.0}, later, flat(1000, 1000, 0.0)).bands, a.bands);
  const Frame rows_only = through(RowColumnNoise{2.0, 0.0}, shot, flat(1000, 1000, 0.0));
  EXPECT_EQ(rows_only.bands[0](5, 0), rows_only.bands[0](5, 999));
  EXPECT_NEAR(moments(rows_only.bands[0]).variance / 4.0, 1.0, 5.0 * std::sqrt(2.0 / 1000.0));
  const Frame columns = through(RowColumnNoise{0.0, 2.0}, shot, flat(1000, 1000, 0.0));
  EXPECT_EQ(columns.bands[0](0, 5), columns.bands[0](999, 5));
  EXPECT_EQ(through(RowColumnNoise{0.0, 2.0}, later, flat(1000, 1000, 0.0)).bands, columns.bands);
}

TEST(AdcEffect, RoundsAndClips) {
  Shot shot = shot_of(5, 1);
  shot.gain_e_per_dn = 2.0, shot.bits = 8, shot.black_level_dn = 10.0;
  Frame f = flat(5, 1, 0.0);
  const float electrons[] = {0.0F, 2.9F, 3.1F, -100.0F, 1e6F};
  std::copy(electrons, electrons + 5, f.bands[0].cells().begin());
  f = through(Adc{}, shot, f);
  EXPECT_THAT(f.bands[0].cells(), testing::ElementsAre(10, 11, 12, 0, 255));
  shot.gain_e_per_dn = 0.0;  // the well fills what the black level leaves
  EXPECT_DOUBLE_EQ(gain_of(shot), 60000.0 / 245.0);
}

TEST(WhiteBalanceEffect, MakesGreyGrey) {
  Shot shot = shot_of(8, 8);
  shot.black_level_dn = 512.0;
  for (const Stack& stack :
       {Stack{Exposure{}, QuantumEfficiency{}, Adc{}, WhiteBalance{}},
        Stack{Exposure{}, Bayer{}, QuantumEfficiency{}, Adc{}, WhiteBalance{}},
        Stack{Exposure{}, Bayer{}, QuantumEfficiency{}, Adc{}, Demosaic{}, WhiteBalance{}}}) {
    const auto f = expose(stack, shot, flat(8, 8, 0.25, 3));
    ASSERT_THAT(f, Succeeds());
    for (const auto& band : f->bands)
      for (const float v : band.cells())  // half a number of 15871, times the gain
        ASSERT_NEAR(static_cast<double>(v), 0.25, 0.5 * 1.4 / 15871.0 + 1e-6);
  }
  const Frame two = through(WhiteBalance{{2.0, 1.0, 0.5}}, shot, flat(8, 8, 512.0 + 15871.0, 3));
  EXPECT_NEAR(static_cast<double>(two.bands[0](0, 0)), 2.0, 1e-6);
  EXPECT_NEAR(static_cast<double>(two.bands[2](0, 0)), 0.5, 1e-6);
}

TEST(PictureNoiseEffect, IsOfThreeKinds) {
  const Shot shot = shot_of(500, 500);
  const Frame grey = through(PictureNoise{0.0, 0.0, 0.1}, shot, flat(500, 500, 0.5, 3));
  EXPECT_EQ(grey.bands[0], grey.bands[2]);
  EXPECT_NEAR(moments(grey.bands[0]).variance / 0.01, 1.0, 5.0 * std::sqrt(2.0) / 500.0);
  const Frame colour = through(PictureNoise{0.0, 0.1, 0.0}, shot, flat(500, 500, 0.5, 3));
  double product = 0.0;
  for (std::size_t i = 0; i < 250000; ++i)
    product += static_cast<double>((colour.bands[0].cells()[i] - 0.5F) *
                                   (colour.bands[1].cells()[i] - 0.5F));
  EXPECT_LT(std::abs(product / 250000.0 / 0.01), 5.0 / 500.0);
  const Frame hot = through(PictureNoise{0.01, 0.0, 0.0}, shot, flat(500, 500, 0.5, 3));
  const auto white = std::count(hot.bands[0].cells().begin(), hot.bands[0].cells().end(), 1.0F);
  EXPECT_NEAR(static_cast<double>(white), 2500.0, 250.0);
}

TEST(ToneEffect, IsTheCurve) {
  const Shot shot = shot_of(2000, 2);
  for (const Tone& e : {Tone{}, Tone{"gamma", 2.2}, Tone{"linear"}, Tone{"gamma", 0.5}}) {
    Frame f = flat(2000, 2, 0.0);
    for (std::size_t i = 0; i < 4000; ++i)
      f.bands[0].cells()[i] = static_cast<float>(std::pow(static_cast<double>(i) / 3900.0, 3.0));
    const Frame out = through(e, shot, f);
    for (std::size_t i = 0; i < 4000; ++i)
      ASSERT_NEAR(static_cast<double>(out.bands[0].cells()[i]),
                  encoded(e, static_cast<double>(f.bands[0].cells()[i])), 5e-6)
          << e.curve << i;
  }
  EXPECT_NEAR(encoded(Tone{}, 0.5), 0.735357, 1e-6);  // IEC 61966-2-1
  EXPECT_DOUBLE_EQ(encoded(Tone{}, 2.0), 1.0);
  EXPECT_THAT(check(Tone{"log"}, shot), FailsWith(kEffectOutOfRange));
}

TEST(JpegEffect, LosesMoreAtLowerQuality) {
  const Shot shot = shot_of(64, 64);
  Frame even = flat(64, 64, 0.5, 3);
  ASSERT_THAT(apply(Jpeg{90}, shot, even), Succeeds());
  for (const float v : even.bands[1].cells())
    ASSERT_NEAR(static_cast<double>(v), 0.5, 1.01 / 255.0);
  const auto error = [&](int quality) {
    Frame f = flat(64, 64, 0.0, 3);
    for (std::size_t b = 0; b < 3; ++b)
      for (std::size_t i = 0; i < 4096; ++i)
        f.bands[b].cells()[i] = static_cast<float>(random_uniform(b, i));
    const Frame before = f;
    EXPECT_THAT(apply(Jpeg{quality}, shot, f), Succeeds());
    double sum = 0.0;
    for (std::size_t i = 0; i < 4096; ++i)
      sum += std::abs(static_cast<double>(f.bands[1].cells()[i] - before.bands[1].cells()[i]));
    return sum / 4096.0;
  };
  EXPECT_LT(error(95), error(50));
  EXPECT_LT(error(50), error(5));
  EXPECT_THAT(check(Jpeg{0}, shot), FailsWith(kEffectOutOfRange));
  Frame wide = flat(70000, 1, 0.5);
  EXPECT_THAT(apply(Jpeg{}, shot_of(70000, 1), wide), FailsWith(kImageFormat));
}

TEST(Names, AreSaidInThePhysicalOrder) {
  const auto names = effect_names();
  EXPECT_EQ(names.front(), info(Effect{std::in_place_index<0>}).name);
  EXPECT_EQ(names.back(), "jpeg");
  EXPECT_EQ(name_of(Signal::electrons), "electrons");
}

}  // namespace
}  // namespace maquette::camera
