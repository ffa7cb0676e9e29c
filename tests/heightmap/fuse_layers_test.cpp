// SPDX-License-Identifier: GPL-3.0-or-later

// Claims of heightmap/fuse.hpp about several sources and how each is attacked
//   a planted shift is found and undone        analytic planet, 4 shifts, 2 pixel ratios, noise;
//                                                to 0.05 coarse pixel, 0.3 m in height
//   three sources are aligned at once          each order of them, and against what was planted
//   without relief only height is moved        plane, tiny relief under noise
//   no shift where there is none               same planet twice
//   a border has no cliff                      fine source that ends inside the site
//   sigma and mask follow the sources          read on both sides of the border
//   small holes of the base are filled, marked one hole; larger sigma inside it
//   synthetic detail: only small waves, right  spectrum slope of a power-law planet measured,
//     strength, own seed, reported in sigma      block means unchanged, seeds differ

#include <array>
#include <cmath>
#include <memory>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/random.hpp"
#include "heightmap/detail/coregister.hpp"
#include "heightmap/detail/small_relief.hpp"
#include "heightmap/detail/void_fill.hpp"
#include "heightmap/fuse.hpp"
#include "support/analytic_planet.hpp"
#include "support/matchers.hpp"

namespace maquette::heightmap {
namespace {

using testing_support::PlanetRaster;
using testing_support::ScratchFolder;
using testing_support::Succeeds;
using testing_support::write_planet_raster;

const Body kMoon = *body_by_name("moon");

/// Relief of several wavelengths from 60 to 400 m.
double relief(double x, double y) {
  struct Wave {
    double amplitude, kx, ky, phase;
  };
  static const std::array<Wave, 12> waves = [] {
    std::array<Wave, 12> out{};
    for (std::uint64_t k = 0; k < 12; ++k) {
      const double wavelength = 60.0 * std::pow(1.19, static_cast<double>(k));
      const double angle = 6.283185 * random_uniform(5, k), wave_number = 6.283185 / wavelength;
      out[k] = {0.03 * wavelength, wave_number * std::cos(angle), wave_number * std::sin(angle),
                6.283185 * random_uniform(6, k)};
    }
    return out;
  }();
  double z = 0.0;
  for (const Wave& w : waves) z += w.amplitude * std::sin(w.kx * x + w.ky * y + w.phase);
  return z;
}

PlanetRaster raster(double pixel, double half_width, std::function<double(double, double)> height) {
  PlanetRaster r;
  r.pixel = pixel;
  r.cols = r.rows = static_cast<int>(2.0 * half_width / pixel);
  r.west = -half_width;
  r.north = half_width;
  r.height = std::move(height);
  return r;
}

/// What a pixel of this size sees: the mean over its area.
std::function<double(double, double)> pixel_mean(double pixel) {
  return [pixel](double x, double y) {
    double sum = 0.0;
    for (int i = 0; i < 8; ++i)
      for (int j = 0; j < 8; ++j)
        sum += relief(x + (i - 3.5) / 8.0 * pixel, y + (j - 3.5) / 8.0 * pixel);
    return sum / 64.0;
  };
}

FuseRequest pair_on(const ScratchFolder& scratch, double half_width, double spacing) {
  FuseRequest request;
  request.body = kMoon;
  request.half_width = Metres{half_width};
  request.spacing = Metres{spacing};
  request.sources = {Source{"base", scratch / "base.tif", "auto", 3.0},
                     Source{"fine", scratch / "fine.tif", "auto", 0.5}};
  return request;
}

struct ShiftCase {
  double east, north, up, coarse_pixel, noise;
};
class PlantedShift : public ::testing::TestWithParam<ShiftCase> {};
INSTANTIATE_TEST_SUITE_P(Shifts, PlantedShift,
                         ::testing::Values(ShiftCase{3.2, -1.7, 12.0, 10.0, 0.0},
                                           ShiftCase{-11.0, 6.0, -40.0, 10.0, 0.2},
                                           ShiftCase{0.8, 0.9, 2.0, 10.0, 0.0},
                                           ShiftCase{9.0, 9.0, 0.0, 20.0, 0.2}));

TEST_P(PlantedShift, IsFoundAndUndone) {
  const ScratchFolder scratch;
  const ShiftCase& p = GetParam();
  const auto base = pixel_mean(p.coarse_pixel);
  write_planet_raster(raster(p.coarse_pixel, 520, base), scratch / "base.tif");
  auto count = std::make_shared<std::uint64_t>(0);
  write_planet_raster(raster(2.0, 480,
                             [&](double x, double y) {
                               return relief(x - p.east, y - p.north) + p.up +
                                      p.noise * random_normal(17, ++*count);
                             }),
                      scratch / "fine.tif");
  const auto fused = fuse(pair_on(scratch, 400, 2.0));
  ASSERT_THAT(fused, Succeeds());
  const SourceReport& report = fused->sources.at(1);
  // Moved back by what was planted.
  EXPECT_NEAR(report.shift_east_m, -p.east, 0.05 * p.coarse_pixel);
  EXPECT_NEAR(report.shift_north_m, -p.north, 0.05 * p.coarse_pixel);
  EXPECT_NEAR(report.shift_up_m, -p.up, 0.3);
  EXPECT_LT(report.nmad_after_m, report.nmad_before_m);
  const double d2 = std::hypot(p.noise, 0.3);
  double sum = 0.0;
  for (std::ptrdiff_t r = 0; r < fused->field.z_m.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < fused->field.z_m.cols(); ++c)
      sum += std::pow(
          static_cast<double>(fused->field.z_m(r, c)) -
              relief(-400.0 + 2.0 * static_cast<double>(c), -400.0 + 2.0 * static_cast<double>(r)),
          2.0);
  EXPECT_LT(std::sqrt(sum / static_cast<double>(fused->field.z_m.cells().size())), d2);
}

TEST(JointAdjustment, OfThreeSourcesDoesNotDependOnTheirOrder) {
  const ScratchFolder scratch;
  write_planet_raster(raster(10.0, 520, pixel_mean(10.0)), scratch / "base.tif");
  const double east[2] = {6.0, -4.0}, north[2] = {-3.0, 5.0}, up[2] = {8.0, -3.0};
  for (int k = 0; k < 2; ++k) {
    auto count = std::make_shared<std::uint64_t>(0);
    auto r = raster(2.0, 480, [&, k, count](double x, double y) {
      return relief(x - east[k], y - north[k]) + up[k] +
             0.2 * random_normal(31 + static_cast<std::uint64_t>(k), ++*count);
    });
    r.cols = 340;  // each half of the site and 200 m of the other's
    if (k == 1) r.west += 480.0 - 200.0;
    write_planet_raster(r, scratch / (k == 0 ? "a.tif" : "b.tif"));
  }
  const auto fused = [&](bool swapped) {
    FuseRequest request = pair_on(scratch, 400, 2.0);
    request.sources = {Source{"base", scratch / "base.tif", "auto", 3.0},
                       Source{"a", scratch / "a.tif", "auto", 0.2},
                       Source{"b", scratch / "b.tif", "auto", 0.2}};
    if (swapped) std::swap(request.sources[1], request.sources[2]);
    return fuse(request);
  };
  const auto one = fused(false), other = fused(true);
  ASSERT_THAT(one, Succeeds());
  ASSERT_THAT(other, Succeeds());
  for (std::size_t k = 0; k < 2; ++k) {
    const SourceReport &s = one->sources[k + 1], &t = other->sources[2 - k];
    EXPECT_TRUE(s.joint) << s.name << ": " << s.height_only;
    EXPECT_NEAR(s.shift_east_m, -east[k], 0.5) << "0.05 of the base's pixel";
    EXPECT_NEAR(s.shift_north_m, -north[k], 0.5);
    EXPECT_NEAR(s.shift_up_m, -up[k], 0.3);
    EXPECT_NEAR(s.shift_east_m, t.shift_east_m, 2e-3) << "a thousandth of a pixel";
    EXPECT_NEAR(s.shift_north_m, t.shift_north_m, 2e-3);
  }
  // What lies beside each other fits to 0.02 of their pixel: one pose is no better known.
  EXPECT_NEAR(one->sources[1].shift_east_m + east[0], one->sources[2].shift_east_m + east[1],
              0.02 * 2.0);
  EXPECT_NEAR(one->sources[1].shift_north_m + north[0], one->sources[2].shift_north_m + north[1],
              0.02 * 2.0);
}

TEST(Coregister, TakesOutATiltAndSaysHowSure) {
  const ScratchFolder scratch;
  write_planet_raster(raster(10.0, 520, pixel_mean(10.0)), scratch / "base.tif");
  write_planet_raster(
      raster(2.0, 480,
             [](double x, double y) { return relief(x - 3.0, y) + 5.0 + 0.01 * x - 0.02 * y; }),
      scratch / "fine.tif");
  const auto fused = fuse(pair_on(scratch, 400, 2.0));
  ASSERT_THAT(fused, Succeeds());
  const SourceReport& report = fused->sources.at(1);
  EXPECT_EQ(report.height_only, "");
  EXPECT_NEAR(report.tilt_east, -0.01, 1e-4);
  EXPECT_NEAR(report.tilt_north, 0.02, 1e-4);
  EXPECT_NEAR(report.shift_east_m, -3.0, 0.2);
  EXPECT_GT(report.covariance[0][0], 0.0);
  EXPECT_LT(std::sqrt(report.covariance[0][0]), 0.5);
  EXPECT_NEAR(report.overlap, 1.0, 1e-9);
  for (const auto& [r, c] : {std::pair{20, 30}, {380, 200}, {200, 380}})
    EXPECT_NEAR(fused->field.z_m(r, c), relief(-400.0 + 2.0 * c, -400.0 + 2.0 * r), 0.3);
}

TEST(Coregister, RefusesWhereItsAnswerIsRequired) {
  const ScratchFolder scratch;
  write_planet_raster(raster(10.0, 520, [](double, double) { return 7.0; }), scratch / "base.tif");
  write_planet_raster(raster(2.0, 480, [](double, double) { return 9.0; }), scratch / "fine.tif");
  FuseRequest request = pair_on(scratch, 400, 2.0);
  const auto automatic = fuse(request);
  ASSERT_THAT(automatic, Succeeds());
  EXPECT_NEAR(automatic->sources[1].shift_up_m, -2.0, 1e-3);
  EXPECT_NE(automatic->sources[1].height_only, "");
  request.sources[1].align = Source::Align::required;
  const auto refused = fuse(request);
  EXPECT_THAT(refused, testing_support::FailsWith(kNotAligned));
  EXPECT_THAT(refused.error().message, ::testing::HasSubstr("directions"));
  request.sources[1].align = Source::Align::none;
  const auto as_is = fuse(request);
  ASSERT_THAT(as_is, Succeeds());
  EXPECT_EQ(as_is->sources[1].shift_up_m, 0.0);
  EXPECT_NEAR(as_is->field.z_m(200, 200), 9.0, 0.05);  // the base has little say
}

TEST(Coregister, LeavesAlignedSurfacesWhereTheyAre) {
  const ScratchFolder scratch;
  write_planet_raster(raster(10.0, 520, pixel_mean(10.0)), scratch / "base.tif");
  write_planet_raster(raster(2.0, 480, relief), scratch / "fine.tif");
  const auto fused = fuse(pair_on(scratch, 400, 2.0));
  ASSERT_THAT(fused, Succeeds());
  EXPECT_NEAR(fused->sources[1].shift_east_m, 0.0, 0.2);
  EXPECT_NEAR(fused->sources[1].shift_north_m, 0.0, 0.2);
  EXPECT_NEAR(fused->sources[1].shift_up_m, 0.0, 0.1);
}

TEST(Coregister, MovesOnlyUpwardsWithoutRelief) {
  Grid<float> lower(200, 200), upper(200, 200);
  for (std::size_t i = 0; i < lower.cells().size(); ++i) {
    lower.cells()[i] = static_cast<float>(100.0 + 0.5 * random_normal(1, i));
    upper.cells()[i] = static_cast<float>(93.0 + 0.5 * random_normal(2, i));
  }
  const auto found = detail::coregister(lower, upper, 1.0, 3.0, 1.0);
  ASSERT_TRUE(found);
  EXPECT_FALSE(found->horizontal);
  EXPECT_EQ(found->east_m, 0.0);
  EXPECT_NEAR(found->up_m, 7.0, 0.02);
}

TEST(Coregister, HasNothingToSayWithoutCommonGround) {
  Grid<float> lower(64, 64, 1.0F);
  EXPECT_FALSE(detail::coregister(lower, Grid<float>(64, 64, NAN), 1.0, 3.0, 1.0));
}

/// Base at 0 m, fine source a plateau that covers the west only.
TEST(Blend, BorderHasNoStepAndSigmaFollows) {
  const ScratchFolder scratch;
  write_planet_raster(raster(40.0, 600, [](double, double) { return 0.0; }), scratch / "base.tif");
  auto west = raster(2.0, 480, [](double, double) { return 4.0; });
  west.cols = 240;  // ends at x = 0
  write_planet_raster(west, scratch / "fine.tif");
  const auto fused = fuse(pair_on(scratch, 400, 2.0));
  ASSERT_THAT(fused, Succeeds());
  const std::ptrdiff_t row = 200, border = 200;
  EXPECT_EQ(fused->source(row, 0), 1);
  EXPECT_EQ(fused->source(row, 400), 0);
  EXPECT_LT(fused->sigma_m(row, 0), 0.5F);
  EXPECT_GT(fused->sigma_m(row, 400), 1.0F);
  EXPECT_LT(fused->sigma_m(row, 400), 3.0F);
  EXPECT_NEAR(fused->sources[1].coverage, 0.5, 0.01);
  // The fine source was laid on the base by its median, 4 m lower: nothing left to see.
  EXPECT_NEAR(fused->sources[1].shift_up_m, -4.0, 1e-3);
  for (std::ptrdiff_t c = 0; c <= 400; ++c) ASSERT_NEAR(fused->field.z_m(row, c), 0.0, 1e-3) << c;
  EXPECT_EQ(fused->sigma_m(row, border - 5), fused->sigma_m(row, 0)) << "whole up to the border";
}

TEST(Blend, LeavesNoCliff) {
  const ScratchFolder scratch;
  write_planet_raster(raster(40.0, 600, [](double, double) { return 0.0; }), scratch / "base.tif");
  auto west = raster(2.0, 480, [](double x, double) { return x < -200.0 ? -5.0 : 5.0; });
  west.cols = 240;
  write_planet_raster(west, scratch / "fine.tif");
  const auto fused = fuse(pair_on(scratch, 400, 2.0));
  ASSERT_THAT(fused, Succeeds());
  double worst = 0.0;
  for (std::ptrdiff_t c = 150; c < 400; ++c)  // east of the source's own step
    worst = std::fmax(worst, std::abs(static_cast<double>(fused->field.z_m(200, c + 1)) -
                                      static_cast<double>(fused->field.z_m(200, c))));
  // 10 m or less over 10 nodes with a smooth step (steepest 1.5 times the mean).
  EXPECT_LT(worst, 10.0 / 10.0 * 1.6);
}

TEST(FillBase, ClosesSmallHolesAndSaysSo) {
  const ScratchFolder scratch;
  auto holed = raster(10.0, 500, [](double x, double y) {
    return std::hypot(x - 103.0, y + 47.0) < 24.0
               ? NAN
               : 50.0 + 0.1 * x + std::sin(x / 15) * std::sin(y / 17);
  });
  write_planet_raster(holed, scratch / "base.tif");
  FuseRequest request = pair_on(scratch, 400, 4.0);
  request.sources.pop_back();
  const auto fused = fuse(request);
  ASSERT_THAT(fused, Succeeds());
  EXPECT_EQ(height_range(fused->field.z_m).voids, 0);
  const std::ptrdiff_t r = (400 - 47) / 4, c = (400 + 103) / 4;
  EXPECT_EQ(fused->source(r, c), 255);
  EXPECT_EQ(fused->source(r, c + 30), 0);
  EXPECT_NEAR(fused->field.z_m(r, c), 60.3, 3.0);
  EXPECT_GT(fused->sigma_m(r, c), fused->sigma_m(r, c + 30));
  EXPECT_LT(fused->sources[0].coverage, 1.0);
}

TEST(FillVoids, KeepsPlanesAndMeasuredNodes) {
  Grid<float> z(101, 77);
  for (std::ptrdiff_t r = 0; r < z.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < z.cols(); ++c)
      z(r, c) = random_uniform(3, static_cast<std::uint64_t>(r * 77 + c)) < 0.3
                    ? NAN
                    : static_cast<float>(r);
  const Grid<float> before = z;
  const auto filled = detail::fill_voids(z).filled;
  std::ptrdiff_t voids = 0;
  for (std::ptrdiff_t r = 0; r < z.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < z.cols(); ++c) {
      if (std::isnan(before(r, c))) {
        ++voids;
        EXPECT_NEAR(z(r, c), static_cast<double>(r), 3.0);
      } else {
        EXPECT_EQ(z(r, c), before(r, c));
      }
    }
  EXPECT_EQ(filled, voids);
}

TEST(DistanceTo, IsNearlyEuclidean) {
  Grid<float> z(60, 90, 1.0F);
  z(20, 30) = NAN;
  z(55, 80) = NAN;
  const auto d = detail::distance_to(z, true);
  for (std::ptrdiff_t r = 0; r < 60; ++r)
    for (std::ptrdiff_t c = 0; c < 90; ++c) {
      const double truth = std::fmin(std::hypot(r - 20, c - 30), std::hypot(r - 55, c - 80));
      ASSERT_GE(d(r, c), truth - 1e-4);
      ASSERT_LE(d(r, c), 1.083 * truth + 1e-4);  // worst of chamfer 1, sqrt 2
    }
  EXPECT_TRUE(std::isinf(detail::distance_to(Grid<float>(3, 3, 0.0F), true)(1, 1)));
}

/// A random surface with the given Hurst exponent: many plane waves, each the mean over pixels.
PixelWindow power_law(double hurst, int n) {
  PixelWindow w;
  w.height_m = Grid<float>(n, n);
  constexpr std::uint64_t kWaves = 400;
  for (std::uint64_t k = 0; k < kWaves; ++k) {
    const double wavelength = 0.5 * std::pow(400.0, random_uniform(1, k));
    const double angle = 6.283185 * random_uniform(2, k), phase = 6.283185 * random_uniform(3, k);
    const double kx = 6.283185 / wavelength * std::cos(angle);
    const double ky = 6.283185 / wavelength * std::sin(angle);
    const auto mean = [](double x) { return std::sin(x) / x; };
    const double a = 0.01 * std::pow(wavelength, hurst) * mean(0.5 * kx) * mean(0.5 * ky);
    for (int r = 0; r < n; ++r)
      for (int c = 0; c < n; ++c)
        w.height_m(r, c) += static_cast<float>(a * std::sin(kx * c + ky * r + phase));
  }
  return w;
}

class SyntheticDetail : public ::testing::TestWithParam<double> {};
INSTANTIATE_TEST_SUITE_P(Hurst, SyntheticDetail, ::testing::Values(0.4, 0.6, 0.8));

TEST_P(SyntheticDetail, ContinuesTheMeasuredPowerLaw) {
  const auto window = power_law(GetParam(), 128);
  const auto found = detail::measure_roughness(window, {1.0, 1.0});
  EXPECT_NEAR(found.hurst, GetParam(), 0.12);  // one realisation
  // At a distance that was not fitted the surface must obey the law too.
  double sum = 0.0, n = 0.0;
  for (std::ptrdiff_t r = 0; r < 128; ++r)
    for (std::ptrdiff_t c = 3; c + 3 < 128; ++c, n += 1.0)
      sum += std::pow(static_cast<double>(window.height_m(r, c + 3) + window.height_m(r, c - 3) -
                                          2.0F * window.height_m(r, c)),
                      2.0);
  const double law =
      found.coefficient * std::pow(3.0, 2.0 * found.hurst) * (4.0 - std::exp2(2.0 * found.hurst));
  EXPECT_NEAR(sum / n / law, 1.0, 0.25);
}

TEST(SyntheticDetail, IsWhatItSaysItIs) {
  const detail::NodeGrid nodes{-100.0, -100.0, 0.25, 801, 801};
  Grid<float> z(801, 801, 0.0F);
  const detail::Roughness law{0.7, 0.01};
  const auto sigma = detail::add_small_relief(z, nodes, law, 4.0, 1.0, 7, {});
  ASSERT_THAT(sigma, Succeeds());
  double sum = 0.0, squares = 0.0;
  for (const float h : z.cells()) {
    sum += static_cast<double>(h);
    squares += static_cast<double>(h) * static_cast<double>(h);
  }
  const auto n = static_cast<double>(z.cells().size());
  EXPECT_NEAR(std::sqrt(squares / n) / *sigma, 1.0, 0.05);
  EXPECT_NEAR(sum / n, 0.0, 0.02 * *sigma);
  // Squared differences over half a pixel and a whole one: the law's, of which waves between
  // 8 m and 0.5 m hold the share that its spectrum k^-(2H+1) says (integrated numerically).
  for (const std::ptrdiff_t lag : {8, 16}) {
    const double distance = 0.25 * static_cast<double>(lag);
    double inside = 0.0, all = 0.0;
    for (double k = 1e-5; k < 100.0; k *= 1.001) {
      const double part =
          std::pow(k, -1.4) * (1.0 - std::cyl_bessel_j(0.0, 6.283185 * k * distance));
      all += part;
      if (k > 0.125 && k < 2.0) inside += part;
    }
    double d2 = 0.0, pairs = 0.0;
    for (std::ptrdiff_t r = 0; r < 801; ++r)
      for (std::ptrdiff_t c = 0; c + lag < 801; ++c, pairs += 1.0)
        d2 += std::pow(static_cast<double>(z(r, c + lag) - z(r, c)), 2.0);
    const double share = d2 / pairs / (0.01 * std::pow(distance, 1.4));
    EXPECT_NEAR(share / (inside / all), 1.0, 0.15) << distance;  // octaves are not sharp
  }
  // Means over 4 x 4 pixels hardly move: what the source resolves stays.
  double block_squares = 0.0, blocks = 0.0;
  for (std::ptrdiff_t r = 0; r + 64 < 801; r += 64)
    for (std::ptrdiff_t c = 0; c + 64 < 801; c += 64, blocks += 1.0) {
      double mean = 0.0;
      for (std::ptrdiff_t i = 0; i < 64; ++i)
        for (std::ptrdiff_t j = 0; j < 64; ++j) mean += static_cast<double>(z(r + i, c + j));
      block_squares += std::pow(mean / 4096.0, 2.0);
    }
  EXPECT_LT(std::sqrt(block_squares / blocks), 0.1 * *sigma);
}

/// One octave is a spline over a lattice of 0.21 of its longest wave: on its points and half-way
/// between them variances are alike, or nodes nearly as far apart would show a pattern.
TEST(SyntheticDetail, IsAsStrongAtEveryPlaceOfItsLattice) {
  const double step_m = 0.21 / 0.125;  // pixels of 4 m
  const auto variance = [&](double x0, double y0) {
    Grid<float> z(201, 201, 0.0F);
    EXPECT_THAT(
        detail::add_small_relief(z, {x0, y0, 2.0 * step_m, 201, 201}, {0.7, 0.01}, 4.0, 1.0, 9, {}),
        Succeeds());
    double squares = 0.0;
    for (const float h : z.cells()) squares += static_cast<double>(h) * static_cast<double>(h);
    return squares;
  };
  const double on = variance(0.0, 0.0);
  // 40 000 nodes, nearly independent: a ratio of two variances scatters by 1 %.
  EXPECT_NEAR(variance(0.5 * step_m, 0.5 * step_m) / on, 1.0, 0.03);
  EXPECT_NEAR(variance(0.5 * step_m, 0.0) / on, 1.0, 0.03);
}

TEST(SyntheticDetail, DependsOnSeedAndPlaceAlone) {
  const detail::Roughness law{0.7, 0.01};
  const auto make = [&](detail::NodeGrid nodes, std::uint64_t seed) {
    Grid<float> z(nodes.rows, nodes.cols, 0.0F);
    EXPECT_THAT(detail::add_small_relief(z, nodes, law, 4.0, 1.0, seed, {}), Succeeds());
    return z;
  };
  const auto whole = make({-50.0, -50.0, 0.5, 201, 201}, 1);
  const auto part = make({-10.0, 5.0, 0.5, 40, 40}, 1);  // its own tile of the same site
  for (std::ptrdiff_t r = 0; r < 40; ++r)
    for (std::ptrdiff_t c = 0; c < 40; ++c) ASSERT_NEAR(part(r, c), whole(r + 110, c + 80), 1e-6);
  EXPECT_NE(make({-50.0, -50.0, 0.5, 201, 201}, 2), whole);
}

TEST(SyntheticDetail, GoesIntoFuseAndSigma) {
  const ScratchFolder scratch;
  auto count = std::make_shared<std::uint64_t>(0);
  write_planet_raster(
      raster(10.0, 520,
             [&](double x, double y) { return relief(x, y) + 0.5 * random_normal(4, ++*count); }),
      scratch / "base.tif");
  FuseRequest request = pair_on(scratch, 400, 2.0);
  request.sources.pop_back();
  const auto plain = fuse(request);
  request.synthetic_detail = 1.0;
  const auto rough = fuse(request);
  request.synthetic_detail = 0.5;
  const auto half = fuse(request);
  ASSERT_THAT(plain, Succeeds());
  ASSERT_THAT(rough, Succeeds());
  ASSERT_THAT(half, Succeeds());
  EXPECT_NE(plain->field.z_m, rough->field.z_m);
  EXPECT_GT(rough->sigma_m(7, 7), plain->sigma_m(7, 7));
  const auto added = [&](const FusedSurface& s, std::ptrdiff_t r, std::ptrdiff_t c) {
    return static_cast<double>(s.field.z_m(r, c)) - static_cast<double>(plain->field.z_m(r, c));
  };
  EXPECT_NEAR(added(*half, 30, 40), 0.5 * added(*rough, 30, 40), 1e-4);
  EXPECT_EQ(rough->source(7, 7), 0) << "a node that a source covers stays that source's";
}

}  // namespace
}  // namespace maquette::heightmap
