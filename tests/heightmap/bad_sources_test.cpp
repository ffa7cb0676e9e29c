// SPDX-License-Identifier: GPL-3.0-or-later

// What scientists mix up, and what heightmap/fuse.hpp says to it (more in fuse_refusals_test.cpp,
// formats_test.cpp)
//   another datum             refused where heights may not move, else moved and said; not where
//                               relief differs, nor noise
//   an island of NaN          large: base refused with its share; small: filled, marked, doubted
//   land in a sea of NaN      a source of which a corner is known adds there and nowhere else
//   a label of another body   Mars' relief on a raster that says Moon: no height of that body

#include <cmath>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/random.hpp"
#include "heightmap/field_io.hpp"
#include "heightmap/fuse.hpp"
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

double relief(double x, double y) {
  return 8.0 * std::sin(x / 37.0) + 6.0 * std::sin(y / 29.0 + 1.0) +
         4.0 * std::sin((x + y) / 17.0) + 0.01 * x;
}

PlanetRaster product(double pixel, double up) {
  PlanetRaster r;
  r.pixel = pixel;
  r.cols = r.rows = static_cast<int>(700.0 / pixel);
  r.west = -350.0;
  r.north = r.west + pixel * r.rows;
  r.height = [up](double x, double y) { return relief(x, y) + up; };
  return r;
}

FuseRequest both(const ScratchFolder& scratch) {
  FuseRequest request;
  request.body = *body_by_name("moon");
  request.half_width = Metres{200};
  request.spacing = Metres{4};
  request.restore = false;
  request.sources = {Source{"base", scratch / "base.tif", "auto", 1.0},
                     Source{"fine", scratch / "fine.tif", "auto", 0.3}};
  for (Source& s : request.sources) s.clean = Clean::off;  // sines may pass for ripples
  return request;
}

TEST(BadSources, AnotherDatumIsRefusedOrSaid) {
  const ScratchFolder scratch;
  write_planet_raster(product(10.0, 0.0), scratch / "base.tif");
  write_planet_raster(product(4.0, -600.0), scratch / "fine.tif");  // above 1738.0 km
  FuseRequest request = both(scratch);
  request.sources[1].align = Source::Align::none;
  const auto refused = fuse(request);
  EXPECT_THAT(refused, FailsWith(kDatumDiffers));
  EXPECT_THAT(refused.error().message, HasSubstr("600.0 m below"));
  EXPECT_THAT(refused.error().message, HasSubstr("1738.0 km"));

  std::vector<std::string> warnings;
  RunContext run;
  run.warn = [&](std::string_view text) { warnings.emplace_back(text); };
  request.sources[1].align = Source::Align::automatic;
  const auto moved = fuse(request, run);
  ASSERT_THAT(moved, Succeeds());
  EXPECT_NEAR(moved->sources[1].shift_up_m, 600.0, 0.5);
  ASSERT_EQ(warnings.size(), 1U);
  EXPECT_THAT(warnings[0], HasSubstr("another datum"));

  // 100 m is no datum, and neither is relief that differs.
  write_planet_raster(product(4.0, 100.0), scratch / "fine.tif");
  request.sources[1].align = Source::Align::none;
  EXPECT_THAT(fuse(request), Succeeds());
  PlanetRaster other = product(4.0, 0.0);
  other.height = [](double x, double y) { return 3.0 * x - 2.0 * y + 400.0; };
  write_planet_raster(other, scratch / "fine.tif");
  EXPECT_THAT(fuse(request), Succeeds());
}

TEST(BadSources, AnIslandOfNanIsFilledIfSmallAndRefusedIfLarge) {
  const ScratchFolder scratch;
  FuseRequest request = both(scratch);
  request.sources.resize(1);
  PlanetRaster r = product(4.0, 0.0);
  const auto with_island = [&](double radius) {
    r.height = [radius](double x, double y) {
      return std::hypot(x, y) < radius ? NAN : relief(x, y);
    };
    write_planet_raster(r, scratch / "base.tif");
    return fuse(request);
  };
  const auto large = with_island(60.0);  // 7.1 % of the site; data reach to their pixels' edges
  EXPECT_THAT(large, FailsWith(kNotCovered));
  EXPECT_THAT(large.error().message, HasSubstr("93.1"));
  const auto small = with_island(15.0);  // 0.44 %
  ASSERT_THAT(small, Succeeds());
  EXPECT_EQ(small->source(50, 50), 255);
  EXPECT_EQ(small->source(50, 60), 0);
  EXPECT_GT(small->sigma_m(50, 50), small->sigma_m(50, 60));
  EXPECT_NEAR(small->field.z_m(50, 50), relief(0.0, 0.0), 5.0);
}

TEST(BadSources, LandInASeaOfNanAddsThereOnly) {
  const ScratchFolder scratch;
  write_planet_raster(product(10.0, 0.0), scratch / "base.tif");
  PlanetRaster r = product(4.0, 0.0);
  r.height = [](double x, double y) {
    return x > 100.0 && y > 100.0 ? relief(x, y) + 0.5 * std::sin(x / 3.0) : NAN;
  };
  write_planet_raster(r, scratch / "fine.tif");
  FuseRequest request = both(scratch);
  request.sources[1].align = Source::Align::none;
  const auto fused = fuse(request);
  ASSERT_THAT(fused, Succeeds());
  EXPECT_EQ(fused->source(90, 90), 1);
  EXPECT_EQ(fused->source(50, 50), 0);
  EXPECT_NEAR(fused->sources[1].coverage, 0.0625, 0.01);
  for (const float h : fused->field.z_m.cells()) ASSERT_FALSE(std::isnan(h));
}

TEST(BadSources, ALabelOfAnotherBodyIsBetrayedByItsHeights) {
  const ScratchFolder scratch;
  PlanetRaster r = product(4.0, 18000.0);  // Olympus Mons' flank, said to be on the Moon
  write_planet_raster(r, scratch / "base.tif");
  FuseRequest request = both(scratch);
  request.sources.resize(1);
  const auto fused = fuse(request);
  EXPECT_THAT(fused, FailsWith(kImplausibleHeight));
  EXPECT_THAT(fused.error().message, HasSubstr("moon"));
}

}  // namespace
}  // namespace maquette::heightmap
