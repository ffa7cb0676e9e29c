// SPDX-License-Identifier: GPL-3.0-or-later

// Claims of heightmap/detail/enlargement.hpp and of `enlarges` in heightmap/fuse.hpp; how each is
// attacked
//   means over wide cells are the wide heights   two sites, three seeds, 1:1000 to 1:200 with
//                                                  synthetic detail: within 5 um of model height;
//                                                  means by a plain double loop over fine nodes
//   any ratio                                    5, 4 (nodes on cell borders) and 2.5 (cut nodes)
//   finer waves stay                             change of waves of two fine nodes
//   sources lie as they lay                      shift and height, at a place of no relief
//   a source outside the enlargement             is left out, not refused
//   artefacts of the wider window                a seam that the enlargement's own window is too
//                                                  small for, in mask and uncertainty

#include <cmath>
#include <numbers>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/random.hpp"
#include "heightmap/detail/enlargement.hpp"
#include "heightmap/fuse.hpp"
#include "support/matchers.hpp"
#include "support/planet_raster.hpp"

namespace maquette::heightmap {
namespace {

using detail::NodeGrid;
using testing_support::PlanetRaster;
using testing_support::ScratchFolder;
using testing_support::Succeeds;

/// Mean over the square cell of the wide node at (x, y), fine nodes being squares too.
double mean_at(const Grid<float>& z, const NodeGrid& fine, double x, double y, double side) {
  const auto part = [&](double middle, double at) {
    const double low = std::max(middle - 0.5 * fine.spacing_m, at - 0.5 * side);
    const double high = std::min(middle + 0.5 * fine.spacing_m, at + 0.5 * side);
    return std::max(0.0, high - low);
  };
  double sum = 0.0, area = 0.0;
  for (std::ptrdiff_t r = 0; r < fine.rows; ++r) {
    const double py = part(fine.y0_m + fine.spacing_m * static_cast<double>(r), y);
    if (py == 0.0) continue;
    for (std::ptrdiff_t c = 0; c < fine.cols; ++c) {
      const double w = py * part(fine.x0_m + fine.spacing_m * static_cast<double>(c), x);
      sum += w * static_cast<double>(z(r, c));
      area += w;
    }
  }
  return area > 0.999 * side * side ? sum / area : NAN;  // NaN: the cell is cut off
}

NodeGrid nodes_of(const PlanetField& f) {
  return {f.x0.value(), f.y0.value(), f.spacing.value(), f.z_m.rows(), f.z_m.cols()};
}

struct Farthest {
  double off_m = 0.0;
  int nodes = 0;
};
Farthest farthest(const Grid<float>& z, const NodeGrid& fine, const Grid<float>& wide_z,
                  const NodeGrid& wide) {
  Farthest out;
  for (std::ptrdiff_t r = 0; r < wide.rows; ++r)
    for (std::ptrdiff_t c = 0; c < wide.cols; ++c) {
      const double mean =
          mean_at(z, fine, wide.x0_m + wide.spacing_m * static_cast<double>(c),
                  wide.y0_m + wide.spacing_m * static_cast<double>(r), wide.spacing_m);
      if (std::isnan(mean)) continue;
      out.off_m = std::max(out.off_m, std::abs(mean - static_cast<double>(wide_z(r, c))));
      ++out.nodes;
    }
  return out;
}

class Ratio : public ::testing::TestWithParam<double> {};
INSTANTIATE_TEST_SUITE_P(Ratios, Ratio, ::testing::Values(5.0, 4.0, 2.5));

TEST_P(Ratio, MeansAreTheWideHeightsAndFineWavesStay) {
  const double ratio = GetParam();
  const NodeGrid wide{-40.0, -30.0, 1.0, 61, 81};
  const NodeGrid fine{-20.0, -20.0, 1.0 / ratio, static_cast<std::ptrdiff_t>(40 * ratio) + 1,
                      static_cast<std::ptrdiff_t>(40 * ratio) + 1};
  Grid<float> wide_z(wide.rows, wide.cols), z(fine.rows, fine.cols);
  for (std::size_t i = 0; i < wide_z.cells().size(); ++i)
    wide_z.cells()[i] = static_cast<float>(random_normal(1, i));
  for (std::size_t i = 0; i < z.cells().size(); ++i)
    z.cells()[i] = static_cast<float>(random_normal(2, i));
  const Grid<float> before = z;
  EXPECT_GT(detail::farthest_mean(z, fine, wide_z, wide), 1.0);
  detail::match_means(z, fine, wide_z, wide);
  const Farthest off = farthest(z, fine, wide_z, wide);
  EXPECT_LT(off.off_m, 2e-6);  // rounding of heights of a few metres, 2e-7, in means
  EXPECT_NEAR(detail::farthest_mean(z, fine, wide_z, wide), off.off_m, 1e-12);
  // 41 x 41 nodes at whole metres; the outermost cells are cut.
  EXPECT_EQ(off.nodes, 39 * 39);
  // Waves of two fine nodes: what of the change is in neighbours' differences of fourth order.
  double changed = 0.0, own = 0.0;
  for (std::ptrdiff_t r = 0; r < fine.rows; ++r)
    for (std::ptrdiff_t c = 2; c + 2 < fine.cols; ++c) {
      const auto fourth = [&](const Grid<float>& g) {
        const auto at = [&](std::ptrdiff_t k) { return static_cast<double>(g(r, c + k)); };
        return at(-2) - 4.0 * at(-1) + 6.0 * at(0) - 4.0 * at(1) + at(2);
      };
      changed += std::pow(fourth(z) - fourth(before), 2.0);
      own += std::pow(fourth(before), 2.0);
    }
  EXPECT_LT(std::sqrt(changed / own), ratio > 3.0 ? 0.05 : 0.2);
}

/// Hills of 8 to 150 m with noise, made here.
PlanetRaster hills(double pixel, double half_width, std::uint64_t seed, double noise_m) {
  PlanetRaster out;
  out.pixel = pixel;
  out.cols = out.rows = static_cast<int>(2.0 * half_width / pixel);
  out.west = -half_width;
  out.north = half_width;
  out.height = [=, count = std::uint64_t{0}](double x, double y) mutable {
    double z = -1500.0 + noise_m * random_normal(90 + seed, ++count);
    for (std::uint64_t k = 0; k < 24; ++k) {
      const double length = 8.0 * std::pow(1.13, static_cast<double>(k));
      const double way = 6.283185 * random_uniform(seed, 2 * k), turn = 6.283185 / length;
      z += 0.012 * length *
           std::sin(turn * (x * std::cos(way) + y * std::sin(way)) +
                    6.283185 * random_uniform(seed, 2 * k + 1));
    }
    return z;
  };
  return out;
}

struct Where {
  const char* body;
  double latitude_deg, longitude_deg;
  const char* projection;
};
const Where kSites[] = {
    {"moon", 0.0, 0.0, "+proj=eqc +lat_ts=0 +lon_0=0 +R=1737400 +units=m +no_defs"},
    {"mars", 0.0, 90.0, "+proj=eqc +lat_ts=0 +lon_0=90 +R=3396190 +units=m +no_defs"}};

class Site : public ::testing::TestWithParam<std::tuple<int, std::uint64_t>> {};
INSTANTIATE_TEST_SUITE_P(SitesAndSeeds, Site,
                         ::testing::Combine(::testing::Values(0, 1),
                                            ::testing::Values(1U, 2U, 3U)));

TEST_P(Site, At200IsAnEnlargementOfThatAt1000) {
  const ScratchFolder scratch;
  const auto [site, seed] = GetParam();
  for (const auto& [name, raster] : {std::pair{"base.tif", hills(20.0, 200.0, seed, 1.0)},
                                     std::pair{"fine.tif", hills(2.0, 90.0, seed, 0.05)}}) {
    PlanetRaster at = raster;
    at.projection = kSites[site].projection;
    write_planet_raster(at, scratch / name);
  }
  FuseRequest request;
  request.body = *body_by_name(kSites[site].body);
  request.centre_latitude_deg = kSites[site].latitude_deg;
  request.centre_longitude_deg = kSites[site].longitude_deg;
  request.half_width = Metres{80.0};
  request.spacing = Metres{0.5};
  request.sources = {{"base", scratch / "base.tif", "auto", 1.0},
                     {"fine", scratch / "fine.tif", "auto", 0.05}};
  request.synthetic_detail = 1.0;
  request.seed = seed;
  const auto wide = fuse(request);
  ASSERT_THAT(wide, Succeeds());
  request.half_width = Metres{16.0};
  request.spacing = Metres{0.1};
  const auto alone = fuse(request);
  ASSERT_THAT(alone, Succeeds());
  request.enlarges = Enlarged{wide->field, wide->sources};
  const auto fine = fuse(request);
  ASSERT_THAT(fine, Succeeds());
  const auto um_of_model = [](double m) { return 1e6 * m / 200.0; };
  const Farthest off =
      farthest(fine->field.z_m, nodes_of(fine->field), wide->field.z_m, nodes_of(wide->field));
  EXPECT_EQ(off.nodes, 63 * 63);
  EXPECT_LT(um_of_model(off.off_m), 5.0);
  EXPECT_NEAR(um_of_model(fine->mean_off_m), um_of_model(off.off_m), 0.01);
  const Farthest without =
      farthest(alone->field.z_m, nodes_of(alone->field), wide->field.z_m, nodes_of(wide->field));
  EXPECT_GT(um_of_model(without.off_m), 200.0) << "or this test sees nothing";
  RecordProperty("low_pass_um", std::to_string(um_of_model(off.off_m)));
  RecordProperty("low_pass_alone_um", std::to_string(um_of_model(without.off_m)));
  EXPECT_EQ(fine->sources[1].shift_up_m, wide->sources[1].shift_up_m);
  EXPECT_EQ(fine->sources[1].shift_east_m, wide->sources[1].shift_east_m);
}

TEST(Enlarged, ShowsArtefactsThatOnlyTheWiderWindowTells) {
  const ScratchFolder scratch;
  PlanetRaster seamed = hills(2.0, 120.0, 3, 0.05);
  seamed.height = [hill = seamed.height](double x, double y) mutable {
    return hill(x, y) + (x > 5.0 ? 0.8 : 0.0);
  };
  write_planet_raster(seamed, scratch / "fine.tif");
  FuseRequest request;
  request.body = *body_by_name("moon");
  request.half_width = Metres{100.0};
  request.spacing = Metres{1.0};
  request.sources = {{"fine", scratch / "fine.tif", "auto", 0.05}};
  const auto wide = fuse(request);
  ASSERT_THAT(wide, Succeeds());
  request.half_width = Metres{20.0};
  request.spacing = Metres{0.2};
  request.enlarges = Enlarged{wide->field, wide->sources};
  const auto alone = fuse(request);
  ASSERT_THAT(alone, Succeeds());
  request.enlarges->sigma_m = wide->sigma_m;
  request.enlarges->artefacts = wide->artefacts;
  const auto fine = fuse(request);
  ASSERT_THAT(fine, Succeeds());
  // x = 5 m and -15 m at y = 0: wide nodes 105 and 85, fine ones 125 and 25.
  ASSERT_EQ(wide->artefacts(100, 105) & kSeam, kSeam);
  EXPECT_EQ(alone->artefacts(100, 125) & kSeam, 0) << "or this test sees nothing";
  EXPECT_EQ(fine->artefacts(100, 125) & kSeam, kSeam);
  EXPECT_EQ(fine->artefacts(100, 25), wide->artefacts(100, 85));
  EXPECT_GE(fine->sigma_m(100, 125), wide->sigma_m(100, 105));
  EXPECT_EQ(fine->sigma_m(100, 25), std::max(alone->sigma_m(100, 25), wide->sigma_m(100, 85)));
  EXPECT_EQ(fine->field.z_m, alone->field.z_m);
}

TEST(Enlarged, LeavesOutASourceThatEndsBeforeIt) {
  const ScratchFolder scratch;
  write_planet_raster(hills(10.0, 200.0, 4, 0.5), scratch / "base.tif");
  PlanetRaster aside = hills(1.0, 40.0, 4, 0.05);  // 30 m east of the middle and beyond
  aside.west = 30.0;
  write_planet_raster(aside, scratch / "aside.tif");
  FuseRequest request;
  request.body = *body_by_name("moon");
  request.half_width = Metres{80.0};
  request.spacing = Metres{0.5};
  request.sources = {{"base", scratch / "base.tif", "auto", 0.5},
                     {"aside", scratch / "aside.tif", "auto", 0.05, Source::Align::none}};
  const auto wide = fuse(request);
  ASSERT_THAT(wide, Succeeds());
  request.half_width = Metres{16.0};
  request.spacing = Metres{0.1};
  EXPECT_THAT(fuse(request), testing_support::FailsWith(kNoOverlap));
  request.enlarges = Enlarged{wide->field, wide->sources};
  const auto fine = fuse(request);
  ASSERT_THAT(fine, Succeeds());
  EXPECT_EQ(fine->sources[1].coverage, 0.0);
  EXPECT_EQ(fine->source(100, 300), 0);
  EXPECT_LT(fine->mean_off_m, 1e-3);
}

}  // namespace
}  // namespace maquette::heightmap
