// SPDX-License-Identifier: GPL-3.0-or-later

// camera/stack.hpp and camera/effects/frame.hpp:
//   the order is checked ............. every pair of effects turned round; twice; a missing link;
//                                      the message says why
//   the same bits .................... 1, 2 and 16 threads, the whole stack
//   time and seed .................... the same: the same picture; another: another
//   swaps ............................ of effects that commute exactly 0, of others not; which
//                                      pairs; those that cannot change places are named, with why
//   depth and lit .................... bent as the picture is, by lens and rolling shutter
//   bad frames, K, fields of view .... each error code
//   photon transfer .................. variance against mean of flat fields through the whole
//                                      sensor: gain and read noise come back to 2 %

#include "camera/stack.hpp"

#include <algorithm>
#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include "support/matchers.hpp"
#include "support/shots.hpp"

namespace maquette::camera {
namespace {

using testing::HasSubstr;
using testing_support::FailsWith;
using testing_support::flat;
using testing_support::shot_of;
using testing_support::Succeeds;

/// Every effect with settings under which it does something.
Stack whole() {
  return {MotionBlur{},
          RollingShutter{1e-4},
          DepthOfField{900.0, 5, 3.0},
          Distortion{"quotient", {0.0, 0.1}, {1e-3, 0.0, -1e-3}, {}, {}},
          Vignetting{},
          Diffraction{6},
          VeilingGlare{0.02},
          Exposure{},
          Bayer{},
          QuantumEfficiency{},
          Prnu{0.01},
          Smear{1e-6},
          DarkCurrent{50.0},
          HotPixels{0.001, 1e5},
          ShotNoise{},
          FullWell{0.5},
          Dsnu{5.0},
          ReadNoise{12.0},
          RowColumnNoise{3.0, 4.0},
          Adc{},
          Demosaic{},
          WhiteBalance{},
          PictureNoise{0.0, 0.01, 0.01},
          Tone{},
          Jpeg{90}};
}

Frame scene(int width, int height) {
  Frame frame = flat(width, height, 0.0, 3);
  for (std::size_t b = 0; b < 3; ++b)
    for (std::ptrdiff_t r = 0; r < height; ++r)
      for (std::ptrdiff_t c = 0; c < width; ++c)
        frame.bands[b](r, c) = static_cast<float>(
            0.5 + 0.6 * std::sin(0.1 * static_cast<double>(r + 2 * c) + static_cast<double>(b)));
  frame.depth_mm = Grid<float>(height, width, 700.0F);
  for (std::ptrdiff_t r = height / 2; r < height; ++r)
    for (float& v : frame.depth_mm.row(r)) v = 1200.0F;
  return frame;
}

TEST(Check, TakesThePhysicalOrderOnly) {
  const Shot shot = shot_of(64, 48);
  const Stack right = whole();
  ASSERT_THAT(check(right, shot), Succeeds());
  for (std::size_t i = 0; i < right.size(); ++i)
    for (std::size_t j = i + 1; j < right.size(); ++j) {
      Stack wrong = right;
      std::swap(wrong[i], wrong[j]);
      EXPECT_THAT(check(wrong, shot), FailsWith(kStackOrder)) << i << " " << j;
    }
}

TEST(Check, SaysWhyAnOrderIsWrong) {
  const Shot shot = shot_of(64, 48);
  const auto early = check({Exposure{}, QuantumEfficiency{}, ShotNoise{}, DarkCurrent{}}, shot);
  ASSERT_THAT(early, FailsWith(kStackOrder));
  EXPECT_THAT(early.error().message, HasSubstr("'dark_current' stands after 'shot_noise'"));
  EXPECT_THAT(early.error().message, HasSubstr("before they are counted"));
  const auto twice = check({Exposure{}, Exposure{}}, shot);
  ASSERT_THAT(twice, FailsWith(kStackOrder));
  EXPECT_THAT(twice.error().message, HasSubstr("twice"));
  const auto gap = check({Exposure{}, ReadNoise{}}, shot);
  ASSERT_THAT(gap, FailsWith(kStackOrder));
  EXPECT_THAT(gap.error().message, HasSubstr("takes electrons, but 'exposure' gives photons"));
}

TEST(Check, RefusesWhatNoCameraHas) {
  EXPECT_THAT(check(Stack{Prnu{-1.0}}, shot_of(8, 8)), FailsWith(kStackOrder));
  EXPECT_THAT(check({Exposure{}, QuantumEfficiency{}, Prnu{NAN}}, shot_of(8, 8)),
              FailsWith(kEffectOutOfRange));
  EXPECT_THAT(check({Exposure{}, Bayer{"rgbg"}}, shot_of(8, 8)), FailsWith(kEffectOutOfRange));
  const auto with = [](auto change) {
    Shot shot = shot_of(64, 48);
    change(shot);
    return check(Stack{}, shot);
  };
  EXPECT_THAT(with([](Shot& s) { s.intrinsics.fx_px = 0.0; }), FailsWith(kIntrinsics));
  EXPECT_THAT(with([](Shot& s) { s.intrinsics.fx_px = s.intrinsics.fy_px = 1e12; }),
              FailsWith(kIntrinsics));  // empty field of view
  EXPECT_THAT(with([](Shot& s) { s.intrinsics.fx_px = s.intrinsics.fy_px = 1e-3; }),
              FailsWith(kIntrinsics));
  EXPECT_THAT(with([](Shot& s) { s.intrinsics.fy_px *= 20.0; }), FailsWith(kIntrinsics));
  EXPECT_THAT(with([](Shot& s) { s.intrinsics.skew_px = -1e6; }), FailsWith(kIntrinsics));
  EXPECT_THAT(with([](Shot& s) { s.intrinsics.cx_px = 1e5; }), FailsWith(kIntrinsics));
  EXPECT_THAT(with([](Shot& s) { s.intrinsics.cy_px = NAN; }), FailsWith(kIntrinsics));
  EXPECT_THAT(with([](Shot& s) { s.intrinsics.width_px = 0; }), FailsWith(kIntrinsics));
  EXPECT_THAT(with([](Shot& s) { s.bits = 30; }), FailsWith(kEffectOutOfRange));
  EXPECT_THAT(with([](Shot& s) { s.quantum_efficiency.clear(); }), FailsWith(kEffectOutOfRange));
}

TEST(Expose, RefusesFramesThatAreNotTheCameras) {
  const Shot shot = shot_of(16, 12);
  EXPECT_THAT(expose({}, shot, flat(16, 12, 1.0, 2)), FailsWith(kFrame));
  EXPECT_THAT(expose({}, shot, flat(12, 16, 1.0, 3)), FailsWith(kFrame));
  Frame depth = flat(16, 12, 1.0, 3);
  depth.depth_mm = Grid<float>(3, 3);
  EXPECT_THAT(expose({}, shot, depth), FailsWith(kFrame));
  Frame bad = flat(16, 12, 1.0, 3);
  bad.bands[1](3, 4) = NAN;
  const auto result = expose({}, shot, bad);
  ASSERT_THAT(result, FailsWith(kFrame));
  EXPECT_THAT(result.error().message, HasSubstr("row 3, column 4"));
  std::stop_source stop;
  stop.request_stop();
  RunContext run;
  run.stop = stop.get_token();
  EXPECT_THAT(expose(whole(), shot, flat(16, 12, 1.0, 3), run), FailsWith(kCancelled));
}

TEST(Expose, TakesGreyLightForColourSensorsAndColourForGreyOnes) {
  Shot shot = shot_of(4, 4);
  const auto colour = expose({}, shot, flat(4, 4, 0.5, 1));
  ASSERT_THAT(colour, Succeeds());
  EXPECT_EQ(colour->bands.size(), 3U);
  shot.quantum_efficiency = {0.5};
  Frame light = flat(4, 4, 0.5, 3);
  light.bands[2] = Grid<float>(4, 4, 2.0F);
  const auto grey = expose({}, shot, light);
  ASSERT_THAT(grey, Succeeds());
  ASSERT_EQ(grey->bands.size(), 1U);
  EXPECT_EQ(grey->bands[0](1, 1), 1.0F);
}

TEST(Expose, GivesTheSameBitsForAnyNumberOfThreads) {
  Shot shot = shot_of(203, 151);
  shot.velocity_mm_s = {300.0, 100.0, -50.0}, shot.angular_rate_rad_s = {0.1, 0.2, -0.3};
  shot.f_number = 4.0;
  std::vector<Frame> pictures;
  for (const int threads : {1, 2, 16}) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism,
                                    static_cast<std::size_t>(threads));
    tbb::task_arena arena(threads);
    arena.execute([&] {
      auto picture = expose(whole(), shot, scene(203, 151));
      ASSERT_THAT(picture, Succeeds());
      pictures.push_back(*std::move(picture));
    });
  }
  ASSERT_EQ(pictures.size(), 3U);
  EXPECT_EQ(pictures[0].bands, pictures[1].bands);
  EXPECT_EQ(pictures[0].bands, pictures[2].bands);
}

TEST(Expose, GivesAnotherPictureAtAnotherTime) {
  Shot shot = shot_of(64, 48);
  const auto at = [&](double time_s, std::uint64_t seed) {
    shot.time_s = time_s, shot.seed = seed;
    return expose(whole(), shot, scene(64, 48))->bands;
  };
  EXPECT_EQ(at(3.25, 1), at(3.25, 1));
  EXPECT_NE(at(3.25, 1), at(3.25000001, 1));
  EXPECT_NE(at(3.25, 1), at(3.25, 2));
}

TEST(Swaps, SayWhatOrderChanges) {
  const Shot shot = shot_of(64, 48);
  const auto list = swaps({Exposure{}, QuantumEfficiency{}, Prnu{0.05}, DarkCurrent{2e5},
                           HotPixels{0.01, 1e5}, ShotNoise{}, Adc{}, WhiteBalance{}, Tone{}},
                          shot, scene(64, 48));
  ASSERT_THAT(list, Succeeds());
  ASSERT_EQ(list->size(), 36U);  // of nine effects
  // Four effects on electrons can change places with each other, and no others.
  EXPECT_EQ(std::count_if(list->begin(), list->end(),
                          [](const Swap& s) {
                            EXPECT_EQ(std::isnan(s.mean_abs_255), !s.impossible.empty());
                            return s.impossible.empty();
                          }),
            6);
  const auto fixed = std::find_if(list->begin(), list->end(), [](const Swap& s) {
    return s.first == "shot_noise" && s.second == "adc";
  });
  ASSERT_NE(fixed, list->end());
  EXPECT_EQ(
      fixed->impossible,
      "'shot_noise' works on electrons and 'adc' makes numbers of the converter of electrons");
  const auto of = [&](const std::string& a, const std::string& b) {
    const auto found = std::find_if(list->begin(), list->end(),
                                    [&](const Swap& s) { return s.first == a && s.second == b; });
    EXPECT_NE(found, list->end()) << a << " " << b;
    return found->mean_abs_255;
  };
  // Sums commute, but for the rounding of float: less than a number of the converter.
  EXPECT_LT(of("dark_current", "hot_pixels"), 0.02);
  // The gain of 5 % then acts on 2000 electrons of heat, too: 5 % of 2000 / 60000 of linear light.
  EXPECT_GT(of("prnu", "dark_current"), 0.05);
  EXPECT_GT(of("dark_current", "shot_noise"), 0.05);
}

// A picture that is its own mask: where it is dark and bright after the lens has bent it, depth and
// lit must say the same. Bicubic sampling rings within two pixels of the edges.
TEST(Expose, BendsDepthAndLitWithThePicture) {
  Shot shot = shot_of(120, 90, 1.0);  // 118 pixels: 54 degrees across
  shot.angular_rate_rad_s = {0.3, 0.2, 1.5};
  Frame frame;
  Grid<float> squares(90, 120);
  for (std::ptrdiff_t r = 0; r < 90; ++r)
    for (std::ptrdiff_t c = 0; c < 120; ++c)
      squares(r, c) = (r / 15 + c / 15) % 2 == 0 ? 1.0F : 0.0F;
  frame.bands = {squares};
  frame.depth_mm = frame.lit = squares;
  for (const Stack& stack :
       {Stack{Distortion{"quotient", {0.0, 0.3}, {0.0}, {}, {}}}, Stack{RollingShutter{1e-3}}}) {
    const auto bent = expose(stack, shot, frame);
    ASSERT_THAT(bent, Succeeds());
    EXPECT_EQ(bent->depth_mm, bent->lit);
    int moved = 0, wrong = 0;
    for (std::size_t i = 0; i < squares.cells().size(); ++i) {
      const float v = bent->bands[0].cells()[i];
      moved += bent->lit.cells()[i] != squares.cells()[i] ? 1 : 0;
      wrong += std::abs(v - 0.5F) > 0.45F && (v > 0.5F) != (bent->lit.cells()[i] > 0.5F) ? 1 : 0;
    }
    EXPECT_GT(moved, 300);
    EXPECT_EQ(wrong, 0);
  }
  frame.lit = Grid<float>(3, 3);
  EXPECT_THAT(expose({}, shot, frame), FailsWith(kFrame));
}

/// Temporal variance and mean, from two shots of the same flat field.
TEST(Expose, KeepsThePhotonTransferCurve) {
  Shot shot = shot_of(512, 512);
  shot.gain_e_per_dn = 4.0;
  shot.quantum_efficiency = {0.5};
  shot.full_well_e = 60000.0;
  shot.black_level_dn = 500.0;
  const double read = 12.0;
  const Stack stack{Exposure{},       QuantumEfficiency{}, Prnu{0.01},
                    DarkCurrent{0.0}, ShotNoise{},         FullWell{},
                    Dsnu{20.0},       ReadNoise{read},     Adc{}};
  for (const double level : {0.0, 0.001, 0.01, 0.1, 0.5, 0.8}) {
    shot.time_s = 1.0;
    const auto a = expose(stack, shot, flat(512, 512, level, 1));
    shot.time_s = 2.0;
    const auto b = expose(stack, shot, flat(512, 512, level, 1));
    ASSERT_TRUE(a && b);
    double sum = 0.0, square = 0.0;
    const auto x = a->bands[0].cells(), y = b->bands[0].cells();
    for (std::size_t i = 0; i < x.size(); ++i) {
      const double d = static_cast<double>(x[i]) - static_cast<double>(y[i]);
      sum += static_cast<double>(x[i]), square += d * d;
    }
    const double n = static_cast<double>(x.size());
    const double electrons = level * 60000.0;
    // EMVA 1288: sigma^2 = K^2 (sigma_d^2 + mu_e) + 1/12. The standard error of the variance is
    // sqrt(2 / n) = 0.3 %; asked for are 2 %.
    const double expected = (read * read + electrons) / 16.0 + 1.0 / 12.0;
    EXPECT_NEAR(0.5 * square / n / expected, 1.0, 0.02) << level;
    // 20 electrons of DSNU and 1 % of PRNU, averaged over n pixels: six standard errors.
    EXPECT_NEAR(sum / n, 500.0 + electrons / 4.0,
                6.0 * std::hypot(6.0, 0.01 * electrons / 4.0) / std::sqrt(n));
  }
}

}  // namespace
}  // namespace maquette::camera
