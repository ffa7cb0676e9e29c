// SPDX-License-Identifier: GPL-3.0-or-later

// Claims of heightmap/photoclinometry.hpp and how each is attacked
//   detail between the resolutions gets its error    reliefs known everywhere, drawn by the test's
//     lowered by 40 % at least, the low band stays      own shading with albedo and noise; three
//                                                       suns, two laws of reflectance, four seeds
//                                                       each
//   smooth albedo is not taken for relief            level ground under spots
//   nothing without an image, in shadow              NaN, a sun behind the hill
//   fuse() does so with files                        both products as GeoTIFF; refuses an image
//   that
//                                                       shows no more, or lies elsewhere

#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "core/random.hpp"
#include "heightmap/fuse.hpp"
#include "heightmap/photoclinometry.hpp"
#include "support/matchers.hpp"
#include "support/planet_raster.hpp"
#include "support/wave_relief.hpp"

namespace maquette::heightmap {
namespace {

using testing_support::Succeeds;
using testing_support::WaveRelief;

constexpr std::ptrdiff_t kNodes = 512;
constexpr double kDem = 16.0;  // nodes a pixel

Grid<double> relief_at(const WaveRelief& relief, double dx, double dy, double pixel) {
  Grid<double> z(kNodes, kNodes, 0.0);
  relief.add_to(z, {dx, dy}, 1.0, 0.0, pixel);
  return z;
}

/// Lunar-Lambert in the form of the angles' cosines, slopes by differences of a hundredth of a
/// node.
Grid<float> drawn(const WaveRelief& relief, const WaveRelief* spots, double azimuth,
                  double elevation, double l, double noise, std::uint64_t seed) {
  const double h = 0.005;
  const auto east = relief_at(relief, h, 0, 1.0), west = relief_at(relief, -h, 0, 1.0),
             north = relief_at(relief, 0, h, 1.0), south = relief_at(relief, 0, -h, 1.0);
  Grid<double> albedo(kNodes, kNodes, 0.0);
  if (spots != nullptr) spots->add_to(albedo, {0, 0}, 1.0 / 8.0, 0.0, 1.0);  // 32 to 1600 nodes
  Grid<float> image(kNodes, kNodes);
  for (std::size_t i = 0; i < image.cells().size(); ++i) {
    const double p = (east.cells()[i] - west.cells()[i]) / (2.0 * h),
                 q = (north.cells()[i] - south.cells()[i]) / (2.0 * h);
    const double length = std::sqrt(p * p + q * q + 1.0);
    const double cos_i = (-p * std::cos(elevation) * std::sin(azimuth) -
                          q * std::cos(elevation) * std::cos(azimuth) + std::sin(elevation)) /
                         length;
    const double cos_e = 1.0 / length;
    const double shade = cos_i <= 0.0 ? 0.0 : 2.0 * l * cos_i / (cos_i + cos_e) + (1.0 - l) * cos_i;
    image.cells()[i] = static_cast<float>(220.0 * std::exp(albedo.cells()[i]) * shade *
                                          (1.0 + noise * random_normal(seed, i)));
  }
  return image;
}

/// Heights as pixels of kDem nodes show them: the mean of each, and between them interpolated.
Grid<float> coarse(const WaveRelief& relief) {
  const auto n = static_cast<std::ptrdiff_t>(kNodes / kDem) + 6;
  const double first = (0.5 - 3.0) * kDem - 0.5;
  Grid<double> pixels(n, n, 0.0);
  relief.add_to(pixels, {first, first}, kDem, 0.0, kDem);
  const auto keys = [](double t) {
    t = std::abs(t);
    return t < 1.0 ? (1.5 * t - 2.5) * t * t + 1.0
                   : (t < 2.0 ? ((-0.5 * t + 2.5) * t - 4.0) * t + 2.0 : 0.0);
  };
  Grid<float> z(kNodes, kNodes);
  for (std::ptrdiff_t r = 0; r < kNodes; ++r)
    for (std::ptrdiff_t c = 0; c < kNodes; ++c) {
      const double u = (static_cast<double>(c) - first) / kDem,
                   v = (static_cast<double>(r) - first) / kDem;
      double sum = 0.0;
      for (auto j = static_cast<std::ptrdiff_t>(v) - 1; j < static_cast<std::ptrdiff_t>(v) + 3; ++j)
        for (auto i = static_cast<std::ptrdiff_t>(u) - 1; i < static_cast<std::ptrdiff_t>(u) + 3;
             ++i)
          sum += keys(u - static_cast<double>(i)) * keys(v - static_cast<double>(j)) * pixels(j, i);
      z(r, c) = static_cast<float>(sum);
    }
  return z;
}

/// Less what a Gaussian of one pixel of the elevation model leaves: the band of detail.
Grid<double> low(const Grid<double>& z, double sigma) {
  std::vector<double> k;
  for (double x = -std::ceil(4 * sigma); x <= std::ceil(4 * sigma); ++x)
    k.push_back(std::exp(-0.5 * x * x / (sigma * sigma)));
  const auto reach = static_cast<std::ptrdiff_t>(k.size() / 2);
  Grid<double> half(z.rows(), z.cols(), 0.0), out(half);
  for (const bool rows : {true, false}) {
    const Grid<double>& in = rows ? z : half;
    Grid<double>& to = rows ? half : out;
    for (std::ptrdiff_t r = 0; r < z.rows(); ++r)
      for (std::ptrdiff_t c = 0; c < z.cols(); ++c) {
        double sum = 0.0, weight = 0.0;
        for (std::ptrdiff_t i = -reach; i <= reach; ++i) {
          const std::ptrdiff_t y = rows ? r : r + i, x = rows ? c + i : c;
          if (y < 0 || x < 0 || y >= z.rows() || x >= z.cols()) continue;
          sum += k[static_cast<std::size_t>(i + reach)] * in(y, x);
          weight += k[static_cast<std::size_t>(i + reach)];
        }
        to(r, c) = sum / weight;
      }
  }
  return out;
}

double rms(const Grid<double>& z) {
  double sum = 0.0, n = 0.0;
  for (std::ptrdiff_t r = 32; r + 32 < z.rows(); ++r)
    for (std::ptrdiff_t c = 32; c + 32 < z.cols(); ++c) {
      sum += z(r, c) * z(r, c);
      n += 1.0;
    }
  return std::sqrt(sum / n);
}

/// The law that WaveRelief(hurst, roughness) follows: variance of differences over 10 nodes.
detail::Roughness law_of(const WaveRelief& relief, double hurst) {
  const auto z = relief_at(relief, 0, 0, 1.0);
  double square = 0.0, n = 0.0;
  for (std::ptrdiff_t r = 0; r < kNodes; r += 3)
    for (std::ptrdiff_t c = 10; c < kNodes; ++c, ++n)
      square += std::pow(z(r, c) - z(r, c - 10), 2.0);
  return {hurst, square / n / std::pow(10.0, 2.0 * hurst), 0.0};
}

struct Case {
  const char* name;
  double hurst, roughness, azimuth_deg, elevation_deg, l, albedo;
};
class Shaded : public ::testing::TestWithParam<Case> {};
INSTANTIATE_TEST_SUITE_P(
    Suns, Shaded,
    ::testing::Values(Case{"west_30_lunar_lambert", 0.85, 0.012, 270.0, 30.0, 0.55, 0.01},
                      Case{"northwest_20_lommel_seeliger", 0.85, 0.008, 315.0, 20.0, 1.0, 0.01},
                      Case{"south_45_lunar_lambert_rough", 0.7, 0.015, 175.0, 45.0, 0.55, 0.005}),
    [](const auto& one) { return std::string(one.param.name); });

TEST_P(Shaded, LowersTheErrorOfDetailAndLeavesTheLowBand) {
  const Case& k = GetParam();
  double before2 = 0.0, after2 = 0.0, low_moved = 0.0, low_size = 0.0;
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    const WaveRelief relief(seed, k.hurst, k.roughness, 6.2832),
        spots(seed + 50, 0.5, k.albedo, 6.2832);
    const auto truth = relief_at(relief, 0, 0, 1.0);
    const double azimuth = k.azimuth_deg * std::numbers::pi / 180.0,
                 elevation = k.elevation_deg * std::numbers::pi / 180.0;
    const auto image = drawn(relief, &spots, azimuth, elevation, k.l, 0.01, seed);
    const Grid<float> z = coarse(relief);
    Shading shading{azimuth, elevation, k.l, 0.01, 0.1, 100.0};
    const auto found = photoclinometry(z, image, 1.0, kDem, 1.0, law_of(relief, k.hurst), shading);
    ASSERT_THAT(found, Succeeds());
    Grid<double> before(kNodes, kNodes), after(before), added(before);
    for (std::size_t i = 0; i < truth.cells().size(); ++i) {
      before.cells()[i] = static_cast<double>(z.cells()[i]) - truth.cells()[i];
      added.cells()[i] = static_cast<double>(found->added_m.cells()[i]);
      after.cells()[i] = before.cells()[i] + added.cells()[i];
    }
    // Detail: what a Gaussian of half a pixel's width (sigma) does not show.
    const auto detail_of = [](const Grid<double>& d) {
      Grid<double> out = low(d, 0.5 * kDem);
      for (std::size_t i = 0; i < out.cells().size(); ++i)
        out.cells()[i] = d.cells()[i] - out.cells()[i];
      return rms(out);
    };
    before2 += std::pow(detail_of(before), 2.0);
    after2 += std::pow(detail_of(after), 2.0);
    low_moved += std::pow(rms(low(added, 2.0 * kDem)), 2.0);
    low_size += std::pow(rms(low(relief_at(relief, 0, 0, 1.0), 2.0 * kDem)), 2.0);
  }
  const double lowered = 1.0 - std::sqrt(after2 / before2);
  const double moved = std::sqrt(low_moved / before2);
  RecordProperty("detail_error_lowered_percent", std::to_string(100.0 * lowered));
  RecordProperty("low_band_moved_percent_of_detail_error", std::to_string(100.0 * moved));
  EXPECT_GE(lowered, 0.40);
  EXPECT_LT(moved, 0.01);
  EXPECT_LT(std::sqrt(low_moved / low_size), 5e-3);  // tiles end; of that band's own height
}

TEST(Photoclinometry, SmoothAlbedoIsNoRelief) {
  const WaveRelief flat(1, 0.85, 0.0, 6.2832), spots(7, 0.5, 0.01, 6.2832),
      rough(2, 0.85, 0.012, 6.2832);
  const auto image = drawn(flat, &spots, 4.7, 0.5, 0.55, 0.0, 1);
  const Grid<float> level(kNodes, kNodes, 0.0F);
  const auto law = law_of(rough, 0.85);
  const auto found =
      photoclinometry(level, image, 1.0, kDem, 1.0, law, {4.7, 0.5, 0.55, 0.01, 0.1, 100.0});
  ASSERT_THAT(found, Succeeds());
  // As relief of that law it would have to be this high.
  const auto believed =
      photoclinometry(level, image, 1.0, kDem, 1.0, law, {4.7, 0.5, 0.55, 0.01, 1e-6, 100.0});
  Grid<double> a(kNodes, kNodes), b(a);
  for (std::size_t i = 0; i < a.cells().size(); ++i) {
    a.cells()[i] = static_cast<double>(found->added_m.cells()[i]);
    b.cells()[i] = static_cast<double>(believed->added_m.cells()[i]);
  }
  RecordProperty("rms_m", std::to_string(rms(a)));
  RecordProperty("rms_m_without_albedo", std::to_string(rms(b)));
  EXPECT_LT(rms(a), 0.5 * rms(b));
}

TEST(Photoclinometry, AddsNothingWithoutImageOrLight) {
  const WaveRelief relief(3, 0.85, 0.012, 6.2832);
  const Grid<float> none(kNodes, kNodes, NAN), dark(kNodes, kNodes, 0.0F), z = coarse(relief);
  for (const Grid<float>* image : {&none, &dark}) {
    const auto found = photoclinometry(z, *image, 1.0, kDem, 1.0, law_of(relief, 0.85), {4.7, 0.5});
    ASSERT_THAT(found, Succeeds());
    for (const float a : found->added_m.cells()) ASSERT_EQ(a, 0.0F);
  }
}

TEST(FuseWithImage, AddsDetailAndRefusesWhatCannot) {
  const testing_support::ScratchFolder scratch;
  const WaveRelief relief(4, 0.85, 0.024, 6.2832);  // nodes of 2 m
  const double azimuth = 4.7, elevation = 0.5;
  const auto image = drawn(relief, nullptr, azimuth, elevation, 0.55, 0.01, 4);
  testing_support::PlanetRaster dem, photo;
  const double half = static_cast<double>(kNodes);  // of 512 nodes of 2 m
  const auto n = static_cast<std::ptrdiff_t>(kNodes / kDem);
  Grid<double> pixels(n, n, 0.0);
  relief.add_to(pixels, {0.5 * kDem - 0.5, 0.5 * kDem - 0.5}, kDem, 0.0, kDem);
  dem.west = photo.west = -half;
  dem.north = photo.north = half;
  dem.pixel = 2.0 * kDem;
  dem.cols = dem.rows = static_cast<int>(n);
  // Slopes are those of heights in units of 2 m nodes: 2 m of height a unit.
  dem.height = [&](double x, double y) {
    return 2.0 * pixels(static_cast<std::ptrdiff_t>((y + half) / dem.pixel),
                        static_cast<std::ptrdiff_t>((x + half) / dem.pixel));
  };
  photo.pixel = 2.0;
  photo.cols = photo.rows = static_cast<int>(kNodes);
  photo.height = [&](double x, double y) {
    return static_cast<double>(image(static_cast<std::ptrdiff_t>((y + half) / 2.0),
                                     static_cast<std::ptrdiff_t>((x + half) / 2.0)));
  };
  write_planet_raster(dem, scratch / "dem.tif");
  write_planet_raster(photo, scratch / "photo.tif");
  FuseRequest request;
  request.body = *body_by_name("moon");
  request.half_width = Metres{400};
  request.spacing = Metres{2};
  request.restore = false;
  request.sources = {Source{"dem", scratch / "dem.tif", "auto", 0.1}};
  const auto error = [&](const FusedSurface& s) {
    // Nodes stand on corners of image pixels.
    const auto truth = relief_at(relief, -0.5, -0.5, 1.0);
    double sum = 0.0, count = 0.0;
    for (std::ptrdiff_t r = 20; r + 20 < s.field.z_m.rows(); ++r)
      for (std::ptrdiff_t c = 20; c + 20 < s.field.z_m.cols(); ++c, ++count)
        sum += std::pow(static_cast<double>(s.field.z_m(r, c)) - 2.0 * truth(r + 56, c + 56), 2.0);
    return std::sqrt(sum / count);
  };
  const auto without = fuse(request);
  ASSERT_THAT(without, Succeeds());
  const double deg = 180.0 / std::numbers::pi;
  request.images = {
      ImageSource{"nac", scratch / "photo.tif", azimuth * deg, elevation * deg, 0.55, 0.01}};
  const auto with = fuse(request);
  ASSERT_THAT(with, Succeeds());
  RecordProperty("rms_without_m", std::to_string(error(*without)));
  RecordProperty("rms_with_m", std::to_string(error(*with)));
  EXPECT_LT(error(*with), 0.6 * error(*without));
  ASSERT_EQ(with->images.size(), 1U);
  EXPECT_EQ(with->images[0].coverage, 1.0);
  EXPECT_LT(with->sigma_m(200, 200), without->sigma_m(200, 200));

  request.spacing = Metres{40};
  EXPECT_THAT(fuse(request), testing_support::FailsWith(kImageNotFiner));
  request.spacing = Metres{2};
  photo.west += 90000.0;
  photo.height = [](double, double) { return 100.0; };
  write_planet_raster(photo, scratch / "photo.tif");
  EXPECT_THAT(fuse(request), testing_support::FailsWith(kNoOverlap));
}

}  // namespace
}  // namespace maquette::heightmap
