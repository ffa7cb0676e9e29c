// SPDX-License-Identifier: GPL-3.0-or-later

// Claims of heightmap/crater_production.hpp and heightmap/detail/craters.hpp; how each is attacked
//   the published curves                 points of Neukum's lunar and martian functions worked out
//                                          here from the papers' coefficients, N(1 km) by age
//   sizes follow the function            chi-square of counts in half octaves, production and
//                                          equilibrium, three seeds; Poisson totals
//   no mean, fresh depth, rim            by quadrature, and at places
//   the same for any threads and part    bytes, of a part of the grid and of one thread
//   hardly seen by a source's pixels     share of variance in means over four pixels
//   the same at two scales               means of fine nodes over a wide node's cell
//   in fuse: counted, marked, in sigma,  with and without, and low-pass consistency of 1:200
//     means of 1:1000 kept

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <oneapi/tbb/global_control.h>

#include "heightmap/crater_production.hpp"
#include "heightmap/detail/craters.hpp"
#include "heightmap/fuse.hpp"
#include "support/matchers.hpp"
#include "support/planet_raster.hpp"

namespace maquette::heightmap {
namespace {

using detail::Crater;
using detail::CraterField;
using detail::NodeGrid;
using testing_support::Succeeds;

const Body kMoon = *body_by_name("moon"), kMars = *body_by_name("mars");

/// Neukum, Ivanov and Hartmann 2001, table 1, and Ivanov 2001, table 1, as printed.
double printed(const std::array<double, 12>& a, double d_km) {
  double log_n = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i)
    log_n += a[i] * std::pow(std::log10(d_km), static_cast<double>(i));
  return std::pow(10.0, log_n);
}
constexpr std::array<double, 12> kPrintedMoon{-3.0876,   -3.557528, 0.781027, 1.021521,
                                              -0.156012, -0.444058, 0.019977, 0.086850,
                                              -0.005874, -0.006809, 0.000825, 0.0000554};
constexpr std::array<double, 12> kPrintedMars{-3.384,   -3.197,    1.257,     0.7915,
                                              -0.4861,  -0.3630,   0.1016,    0.06756,
                                              -0.01181, -0.004753, 0.0006233, 0.00005805};

TEST(CraterProduction, IsThePublishedOne) {
  for (const double d_km : {0.01, 0.05, 0.3, 1.0, 7.0, 60.0}) {
    EXPECT_NEAR(craters_produced(kMoon, 1.0, 1e3 * d_km) * 1e6 / printed(kPrintedMoon, d_km), 1.0,
                1e-9);
    EXPECT_NEAR(craters_produced(kMars, 1.0, 1e3 * d_km) * 1e6 / printed(kPrintedMars, d_km), 1.0,
                1e-9);
  }
  // N(1 km) of the Moon: 8.38e-4 per Gyr for long, 0.0029 per km^2 at 3.5 Gyr.
  EXPECT_NEAR(craters_produced(kMoon, 0.1, 1000.0) * 1e6, 8.38e-5, 0.05e-5 + 0.03 * 8.38e-5);
  EXPECT_NEAR(craters_produced(kMoon, 3.5, 1000.0) * 1e6,
              5.44e-14 * std::exp(6.93 * 3.5) + 8.38e-4 * 3.5, 0.03 * 5e-3);
  // Below 10 m it goes on as a power law.
  const auto n = [](double d) { return craters_produced(kMoon, 1.0, d); };
  EXPECT_NEAR(std::log(n(1.0) / n(2.0)), std::log(n(4.0) / n(8.0)), 1e-9);
  EXPECT_NEAR(std::log(n(9.99) / n(10.0)) / std::log(n(10.0) / n(10.01)), 1.0, 0.01);
  EXPECT_NEAR(craters_in_equilibrium(1000.0) * 1e6, 0.0468, 0.0002);
  EXPECT_EQ(craters_present(kMoon, 3.5, 3.0), craters_in_equilibrium(3.0));
  EXPECT_EQ(craters_present(kMoon, 0.001, 80.0), craters_produced(kMoon, 0.001, 80.0));
  EXPECT_EQ(craters_produced(kMoon, 0.0, 5.0), 0.0);
}

struct Drawn {
  const char* name;
  CraterField field;
  double half_width_m;
};

class Sizes : public ::testing::TestWithParam<std::uint64_t> {};
INSTANTIATE_TEST_SUITE_P(Seeds, Sizes, ::testing::Values(1U, 2U, 3U));

TEST_P(Sizes, FollowTheFunction) {
  const std::uint64_t seed = GetParam();
  for (const Drawn& d : {Drawn{"production", {kMoon, 0.2, 12.0, 96.0, seed}, 12000.0},
                         Drawn{"equilibrium", {kMars, 3.7, 0.5, 8.0, seed}, 250.0}}) {
    const double w = d.half_width_m;
    std::vector<double> diameters;
    for (const Crater& c : detail::draw_craters(d.field, -w, -w, w, w))
      if (std::abs(c.x_m) < w && std::abs(c.y_m) < w) diameters.push_back(c.diameter_m);
    const bool mars = d.field.body.name == "mars";
    const auto expected = [&](double low, double high) {
      const auto n = [&](double m) {
        const double equilibrium = std::pow(10.0, -1.33) * std::pow(1e-3 * m, -1.83);
        if (mars) return equilibrium;  // far below what was produced in 3.7 Gyr
        const double age = (5.44e-14 * std::expm1(6.93 * 0.2) + 8.38e-4 * 0.2) /
                           (5.44e-14 * std::expm1(6.93) + 8.38e-4);
        return std::min(equilibrium, age * printed(kPrintedMoon, 1e-3 * m));
      };
      return (n(low) - n(high)) * 1e-6 * 4.0 * w * w;
    };
    double chi2 = 0.0;
    int bins = 0;
    const double step = std::pow(2.0, 0.4);  // not the classes that are drawn
    for (double low = d.field.smallest_m; low * step <= d.field.largest_m; low *= step, ++bins) {
      const double e = expected(low, low * step);
      const auto o =
          static_cast<double>(std::count_if(diameters.begin(), diameters.end(),
                                            [&](double v) { return v >= low && v < low * step; }));
      ASSERT_GT(e, 20.0) << d.name;
      chi2 += (o - e) * (o - e) / e;
    }
    RecordProperty(std::string(d.name) + "_chi2", std::to_string(chi2));
    RecordProperty(std::string(d.name) + "_bins", bins);
    // 0.1 % of honest draws lie beyond (Wilson and Hilferty).
    const double nu = bins, q = 1.0 - 2.0 / (9.0 * nu) + 3.09 * std::sqrt(2.0 / (9.0 * nu));
    EXPECT_LT(chi2, nu * q * q * q) << d.name;
    const double all = expected(d.field.smallest_m, d.field.largest_m);
    EXPECT_NEAR(static_cast<double>(diameters.size()), all, 4.0 * std::sqrt(all)) << d.name;
  }
}

TEST(CraterShape, HasNoMeanAndItsRim) {
  const Crater c{0.0, 0.0, 10.0, 2.0};
  EXPECT_NEAR(crater_height_m(c, 0.0), -2.0 + 0.48, 0.01);
  EXPECT_NEAR(crater_height_m(c, 5.0), 0.48, 0.01);
  EXPECT_NEAR(crater_height_m(c, 4.9999), crater_height_m(c, 5.0001), 1e-3);
  EXPECT_EQ(crater_height_m(c, 15.0), 0.0);
  double volume = 0.0, dug = 0.0;
  for (int i = 0; i < 150000; ++i) {
    const double r = (i + 0.5) * 1e-4;
    const double part = crater_height_m(c, r) * 2.0 * std::numbers::pi * r * 1e-4;
    volume += part;
    if (part < 0.0) dug -= part;
  }
  EXPECT_LT(std::abs(volume), 1e-3 * dug);
}

TEST(CraterShape, FadesOnlyWhereGroundIsRipe) {
  const auto shallowest = [](double age) {
    double least = 1.0, most = 0.0;
    for (const Crater& c : detail::draw_craters({kMoon, age, 4.0, 8.0, 5}, -300, -300, 300, 300)) {
      least = std::min(least, c.depth_m / c.diameter_m);
      most = std::max(most, c.depth_m / c.diameter_m);
    }
    EXPECT_LE(most, 0.2);
    EXPECT_GT(most, 0.19) << age;
    return least;
  };
  EXPECT_LT(shallowest(3.5), 0.035);
  EXPECT_GT(shallowest(0.002), 0.15);
}

constexpr NodeGrid kNodes{-60.0, -60.0, 0.25, 481, 481};
const CraterField kField{kMoon, 3.5, 0.25, 4.0, 11};

Grid<float> made(const NodeGrid& nodes, const CraterField& field = kField) {
  Grid<float> z(nodes.rows, nodes.cols, 0.0F);
  EXPECT_THAT(detail::add_craters(z, nodes, field, {}), Succeeds());
  return z;
}

TEST(Craters, AreTheSameForAnyThreadsAndPart) {
  const Grid<float> whole = made(kNodes);
  {
    const oneapi::tbb::global_control one(oneapi::tbb::global_control::max_allowed_parallelism, 1);
    EXPECT_EQ(made(kNodes), whole);
  }
  const Grid<float> part = made({-40.0, 10.0, 0.25, 77, 130});
  for (std::ptrdiff_t r = 0; r < part.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < part.cols(); ++c) ASSERT_EQ(part(r, c), whole(r + 280, c + 80));
  CraterField other = kField;
  other.seed = 12;
  EXPECT_NE(made(kNodes, other), whole);
}

TEST(Craters, HaveTheVarianceThatIsSaid) {
  CraterField field = kField;
  field.smallest_m = 1.0;  // four nodes: means over cells take little
  const Grid<float> z = made(kNodes, field);
  double sum = 0.0, square = 0.0;
  for (const float h : z.cells()) {
    sum += static_cast<double>(h);
    square += static_cast<double>(h) * static_cast<double>(h);
  }
  const auto n = static_cast<double>(z.cells().size());
  EXPECT_NEAR(square / n / detail::crater_variance_m2(field), 1.0, 0.25);
  EXPECT_LT(std::abs(sum / n), 0.05 * std::sqrt(square / n));
}

TEST(Craters, AreHardlySeenByPixels) {
  const Grid<float> z = made(kNodes);  // up to a pixel of 4 m
  const auto variance_of_means = [&](std::ptrdiff_t block) {
    double square = 0.0, n = 0.0;
    for (std::ptrdiff_t r = 0; r + block <= z.rows(); r += block)
      for (std::ptrdiff_t c = 0; c + block <= z.cols(); c += block) {
        double mean = 0.0;
        for (std::ptrdiff_t i = 0; i < block; ++i)
          for (std::ptrdiff_t j = 0; j < block; ++j)
            mean += static_cast<double>(z(r + i, c + j)) / static_cast<double>(block * block);
        square += mean * mean;
        n += 1.0;
      }
    return square / n;
  };
  const double pixel = variance_of_means(16) / variance_of_means(1);
  const double four = variance_of_means(64) / variance_of_means(1);
  RecordProperty("share_in_pixels", std::to_string(pixel));
  RecordProperty("share_in_four_pixels", std::to_string(four));
  EXPECT_LT(pixel, 0.15);
  EXPECT_LT(four, 0.01);
}

TEST(Craters, AreTheSameAtTwoScales) {
  CraterField wide_field = kField, fine_field = kField;
  wide_field.smallest_m = 1.0;
  fine_field.smallest_m = 0.2;
  const Grid<float> wide = made({-20.0, -20.0, 1.0, 41, 41}, wide_field);
  const NodeGrid fine_nodes{-20.4, -20.4, 0.2, 205, 205};
  const Grid<float> fine = made(fine_nodes, fine_field);
  double off = 0.0, own = 0.0;
  for (std::ptrdiff_t r = 0; r < 41; ++r)
    for (std::ptrdiff_t c = 0; c < 41; ++c) {
      double mean = 0.0;
      for (std::ptrdiff_t i = 0; i < 5; ++i)
        for (std::ptrdiff_t j = 0; j < 5; ++j)
          mean += static_cast<double>(fine(5 * r + i, 5 * c + j)) / 25.0;
      off += std::pow(mean - static_cast<double>(wide(r, c)), 2.0);
      own += std::pow(static_cast<double>(wide(r, c)), 2.0);
    }
  RecordProperty("off_over_own", std::to_string(std::sqrt(off / own)));
  EXPECT_LT(std::sqrt(off / own), 0.2);  // what differs are craters smaller than a wide node
}

TEST(Craters, GoIntoFuse) {
  const testing_support::ScratchFolder scratch;
  testing_support::PlanetRaster raster;
  raster.pixel = 5.0;
  raster.cols = raster.rows = 60;
  raster.west = -150.0;
  raster.north = 150.0;
  raster.height = [](double x, double y) {
    return 3.0 * std::sin(x / 17.0) * std::cos(y / 23.0) + 0.7 * std::sin(x / 5.1 + y / 4.3);
  };
  write_planet_raster(raster, scratch / "base.tif");
  FuseRequest request;
  request.body = kMoon;
  request.half_width = Metres{100.0};
  request.spacing = Metres{0.5};
  request.sources = {{"base", scratch / "base.tif", "auto", 0.05}};
  request.synthetic_detail = 1.0;
  const auto without = fuse(request);
  ASSERT_THAT(without, Succeeds());
  EXPECT_EQ(without->craters, 0U);
  request.crater_age_gyr = 3.5;
  const auto with = fuse(request);
  ASSERT_THAT(with, Succeeds());
  EXPECT_GT(with->craters, 100U);
  EXPECT_NE(with->field.z_m, without->field.z_m);
  EXPECT_GE(with->sigma_m(50, 50), 0.9F * without->sigma_m(50, 50));
  std::ptrdiff_t marked = 0;
  for (const std::uint8_t s : with->synthetic.cells()) marked += s;
  EXPECT_GT(marked, 100);
  EXPECT_EQ(with->source(50, 50), 0);
  FuseRequest fine = request;
  fine.half_width = Metres{20.0};
  fine.spacing = Metres{0.1};
  fine.enlarges = Enlarged{with->field, with->sources};
  const auto enlarged = fuse(fine);
  ASSERT_THAT(enlarged, Succeeds());
  EXPECT_LT(enlarged->mean_off_m, 1e-3) << "5 um of height at 1:200";
  RecordProperty("low_pass_um", std::to_string(1e6 * enlarged->mean_off_m / 200.0));
}

}  // namespace
}  // namespace maquette::heightmap
