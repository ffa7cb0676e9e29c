// SPDX-License-Identifier: GPL-3.0-or-later

// Claims of heightmap/fuse.hpp about where heights end up, and how each is attacked
//   every node stands where it should, whatever the map     analytic planet in 9 maps and two
//     projection, to 0.01 pixel (half a pixel would be 50     bodies; oracle is vector algebra
//     times that)                                             and shares no code
//   AREA and POINT GeoTIFFs agree                           same raster written both ways
//   global products close around the body and over poles   sites on the seam and on the pole
//   0..360 and -180..180 are the same                       centre and raster on either branch
//   scale, offset, km, radii                                stored in each way, same heights
//   fine nodes see a smooth surface                         second differences at 1/10 pixel
//   coarse nodes see means, not aliases                     checkerboard averaged away
//   same result for any number of threads                   1 thread against all

#include <cmath>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <oneapi/tbb/global_control.h>

#include "heightmap/fuse.hpp"
#include "support/analytic_planet.hpp"
#include "support/matchers.hpp"

namespace maquette::heightmap {
namespace {

using testing_support::below_plane;
using testing_support::displacement;
using testing_support::MapInverse;
using testing_support::PlanetRaster;
using testing_support::raster_around;
using testing_support::ScratchFolder;
using testing_support::Succeeds;
using testing_support::Waves;
using testing_support::write_planet_raster;

const Body kMoon = *body_by_name("moon");
const Body kMars = *body_by_name("mars");

FuseRequest site(const Body& body, double latitude, double longitude, double half_width,
                 double spacing, const std::filesystem::path& raster) {
  FuseRequest request;
  request.body = body;
  request.centre_latitude_deg = latitude;
  request.centre_longitude_deg = longitude;
  request.half_width = Metres{half_width};
  request.spacing = Metres{spacing};
  request.sources = {Source{"raster", raster}};
  request.restore = false;  // heights as the raster has them
  return request;
}

template <class Planet>
Grid<float> truth_on(const FuseRequest& request, const PlanetField& field, const Planet& planet) {
  Grid<float> truth(field.z_m.rows(), field.z_m.cols());
  for (std::ptrdiff_t r = 0; r < truth.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < truth.cols(); ++c)
      truth(r, c) = static_cast<float>(planet(
          below_plane(request.body, request.centre_latitude_deg, request.centre_longitude_deg,
                      field.x0.value() + field.spacing.value() * static_cast<double>(c),
                      field.y0.value() + field.spacing.value() * static_cast<double>(r))));
  return truth;
}

struct MapCase {
  const char* name;
  Body body;
  double latitude, longitude;
  std::string projection;
  double pixel;    // map units
  double pixel_m;  // on the ground
  double half_width_m;
};

class AnyMap : public ::testing::TestWithParam<MapCase> {};

// Wavelength 20 pixels or more: cubic convolution is then exact to some 1e-4 of the amplitude.
TEST_P(AnyMap, NodesStandWhereTheyShould) {
  const MapCase& m = GetParam();
  const ScratchFolder scratch;
  const Waves planet{2.0 * m.pixel_m, m.body.equatorial_radius_m / (20.0 * m.pixel_m)};
  write_planet_raster(raster_around(m.projection, m.latitude, m.longitude, m.pixel, 120, planet),
                      scratch / "a.tif");
  // Odd spacing: nodes fall everywhere between pixels; 77 nodes: the last tile is partial.
  const FuseRequest request = site(m.body, m.latitude, m.longitude, m.half_width_m,
                                   m.half_width_m / 38.0, scratch / "a.tif");
  const auto fused = fuse(request);
  ASSERT_THAT(fused, Succeeds());
  const auto truth = truth_on(request, fused->field, planet);
  const auto d = displacement(fused->field.z_m, truth, request.spacing.value());
  EXPECT_NEAR(d.east_m / m.pixel_m, 0.0, 0.01);
  EXPECT_NEAR(d.north_m / m.pixel_m, 0.0, 0.01);
  EXPECT_LT(d.worst_m, 0.02 * 3.0 * planet.amplitude_m);
  EXPECT_NEAR(fused->sources.at(0).pixel_m / m.pixel_m, 1.0, 0.05);
  EXPECT_EQ(fused->sources.at(0).coverage, 1.0);
}

INSTANTIATE_TEST_SUITE_P(
    Maps, AnyMap,
    ::testing::Values(MapCase{"moon_equirectangular", kMoon, 3.0, 40.0,
                              "+proj=eqc +R=1737400 +units=m", 10.0, 10.0, 400.0},
                      MapCase{"moon_equirectangular_lon0_180", kMoon, 3.0, -60.0,
                              "+proj=eqc +lon_0=180 +R=1737400 +units=m", 10.0, 10.0, 400.0},
                      MapCase{"moon_south_polar", kMoon, -87.2, 62.8,
                              "+proj=stere +lat_0=-90 +R=1737400 +units=m", 10.0, 10.0, 400.0},
                      MapCase{"moon_at_the_pole", kMoon, -90.0, 0.0,
                              "+proj=stere +lat_0=-90 +R=1737400 +units=m", 10.0, 10.0, 400.0},
                      MapCase{"moon_degrees", kMoon, -20.0, 200.0, "+proj=longlat +R=1737400",
                              0.0005, 15.16, 400.0},
                      MapCase{"mars_equirectangular", kMars, -4.667, 137.37,
                              "+proj=eqc +R=3396190 +units=m", 1.0, 1.0, 45.0},
                      MapCase{"mars_local_radius", kMars, -28.0, 226.9,
                              "+proj=eqc +lat_ts=-25 +lon_0=226.94 +R=3392593.61 +units=m", 1.0,
                              1.026, 45.0},
                      MapCase{"mars_polar_radius", kMars, 83.5, -13.0,
                              "+proj=stere +lat_0=90 +R=3376200 +units=m", 10.0, 10.0, 350.0},
                      MapCase{"mars_sinusoidal", kMars, 12.6, 355.7,
                              "+proj=sinu +lon_0=0 +R=3396190 +units=m", 5.0, 5.0, 200.0},
                      MapCase{"mars_planetographic", kMars, 40.0, 10.0,
                              "+proj=eqc +lon_0=10 +lat_ts=40 +a=3396190 +b=3376200 +units=m", 5.0,
                              5.0, 200.0}),
    [](const auto& one) { return std::string(one.param.name); });

TEST(Fuse, AreaAndPointGeoTiffsAgree) {
  const ScratchFolder scratch;
  const Waves planet{20.0, 8000.0};
  auto raster = raster_around("+proj=eqc +R=1737400 +units=m", 0, 0, 10.0, 80, planet);
  write_planet_raster(raster, scratch / "area.tif");
  raster.point = true;
  write_planet_raster(raster, scratch / "point.tif");
  const auto area = fuse(site(kMoon, 0, 0, 200, 4, scratch / "area.tif"));
  const auto point = fuse(site(kMoon, 0, 0, 200, 4, scratch / "point.tif"));
  ASSERT_THAT(area, Succeeds());
  ASSERT_THAT(point, Succeeds());
  // Writing as Point moves the tie point by half a pixel, which may cost the last bit of it.
  EXPECT_LT(displacement(point->field.z_m, area->field.z_m, 4.0).worst_m, 1e-4);
}

struct SeamCase {
  const char* name;
  double latitude, longitude;
};
class GlobalProduct : public ::testing::TestWithParam<SeamCase> {};
INSTANTIATE_TEST_SUITE_P(
    Sites, GlobalProduct,
    ::testing::Values(SeamCase{"seam_at_zero", 5.0, 0.0}, SeamCase{"seam_at_360", 5.0, 360.0},
                      SeamCase{"middle", -5.0, -180.0}, SeamCase{"west", 10.0, -90.0},
                      SeamCase{"north_pole", 90.0, 0.0}, SeamCase{"near_south_pole", -89.3, 33.0}),
    [](const auto& one) { return std::string(one.param.name); });

TEST_P(GlobalProduct, ClosesAroundTheBodyAndOverThePoles) {
  const ScratchFolder scratch;
  const Waves planet{300.0, 4.0};
  for (const bool degrees : {true, false}) {
    PlanetRaster r;
    const double per_degree = kMoon.equatorial_radius_m * std::numbers::pi / 180.0;
    const double unit = degrees ? 1.0 : per_degree;
    r.projection = degrees ? "+proj=longlat +R=1737400" : "+proj=eqc +lon_0=180 +R=1737400";
    const auto inverse = MapInverse(r.projection);
    r.pixel = 0.5 * unit;
    r.west = degrees ? 0.0 : -180.0 * unit;
    r.north = 90.0 * unit;
    r.cols = 720;
    r.rows = 360;
    r.height = [&](double x, double y) { return planet(inverse(x, y)); };
    write_planet_raster(r, scratch / "global.tif");
    const auto request = site(kMoon, GetParam().latitude, GetParam().longitude, 60000.0, 1000.0,
                              scratch / "global.tif");
    const auto fused = fuse(request);
    ASSERT_THAT(fused, Succeeds());
    const auto d = displacement(fused->field.z_m, truth_on(request, fused->field, planet), 1000.0);
    constexpr double kPixel = 15163.0;
    EXPECT_NEAR(fused->sources.at(0).pixel_m, kPixel, 20.0);
    EXPECT_NEAR(d.east_m / kPixel, 0.0, 0.02) << degrees;
    EXPECT_NEAR(d.north_m / kPixel, 0.0, 0.02) << degrees;
    EXPECT_LT(d.worst_m, 3.0) << degrees;  // 1 % of the amplitude; a seam would show 100 %
  }
}

TEST(Fuse, StorageDoesNotMatter) {
  const ScratchFolder scratch;
  const Waves planet{200.0, 8000.0};
  const auto plain = raster_around("+proj=eqc +R=1737400 +units=m", 2, 3, 10.0, 60, planet);
  write_planet_raster(plain, scratch / "m.tif");
  const auto reference = fuse(site(kMoon, 2, 3, 200, 5, scratch / "m.tif"));
  ASSERT_THAT(reference, Succeeds());
  const auto worst = [&](const PlanetRaster& raster, const std::string& unit) {
    write_planet_raster(raster, scratch / "other.tif");
    auto request = site(kMoon, 2, 3, 200, 5, scratch / "other.tif");
    request.sources[0].unit = unit;
    const auto other = fuse(request);
    EXPECT_THAT(other, Succeeds());
    return other ? displacement(other->field.z_m, reference->field.z_m, 5.0).worst_m : 1e9;
  };
  auto scaled = plain;
  scaled.type = GDT_Int16;
  scaled.scale = 0.5;
  EXPECT_LT(worst(scaled, "auto"), 0.5) << "half metre steps";
  auto radius = scaled;  // as LOLA stores it
  radius.offset = 1737400.0;
  radius.height = [plain](double x, double y) { return 1737400.0 + plain.height(x, y); };
  EXPECT_LT(worst(radius, "auto"), 0.5);
  auto km = plain;
  km.height = [plain](double x, double y) { return plain.height(x, y) / 1000.0; };
  EXPECT_LT(worst(km, "km"), 1e-3);
  km.unit = "km";
  EXPECT_LT(worst(km, "auto"), 1e-3);
  auto km_radius = km;  // as LOLA's float products: kilometres of radius
  km_radius.unit = "";
  km_radius.offset = 1737.4;
  km_radius.height = [plain](double x, double y) { return 1737.4 + plain.height(x, y) / 1000.0; };
  EXPECT_LT(worst(km_radius, "auto"), 1e-2);
}

TEST(Fuse, RadiiOnAnEllipsoidBecomeHeightsAboveIt) {
  const ScratchFolder scratch;
  const double lat = 60.0, a = kMars.equatorial_radius_m, b = kMars.polar_radius_m;
  auto raster = raster_around("+proj=longlat +R=3396190", lat, 20.0, 0.001, 60,
                              [&](const testing_support::Direction& n) {
                                const double s = n[2], c = std::sqrt(1 - s * s);
                                return 123.0 + 1.0 / std::sqrt(c * c / (a * a) + s * s / (b * b));
                              });
  raster.type = GDT_Float64;
  write_planet_raster(raster, scratch / "radius.tif");
  const auto fused = fuse(site(kMars, lat, 20.0, 400, 20, scratch / "radius.tif"));
  ASSERT_THAT(fused, Succeeds());
  for (const float h : fused->field.z_m.cells()) ASSERT_NEAR(h, 123.0, 0.01);
}

TEST(Fuse, NodesFinerThanPixelsSeeNoFacets) {
  const ScratchFolder scratch;
  const Waves planet{3.0, kMoon.equatorial_radius_m / 12.0};  // wavelength 12 pixels of 1 m
  write_planet_raster(raster_around("+proj=eqc +R=1737400 +units=m", 0, 0, 1.0, 40, planet),
                      scratch / "a.tif");
  const auto request = site(kMoon, 0, 0, 10, 0.1, scratch / "a.tif");
  const auto fused = fuse(request);
  ASSERT_THAT(fused, Succeeds());
  const auto truth = truth_on(request, fused->field, planet);
  // Of the second difference; bilinear facets would put a whole pixel's bend (ten times as
  // much) into one node and none into the rest.
  const auto bend = [](const Grid<float>& z, std::ptrdiff_t r, std::ptrdiff_t c) {
    return static_cast<double>(z(r, c - 1)) + static_cast<double>(z(r, c + 1)) -
           2.0 * static_cast<double>(z(r, c));
  };
  double worst_found = 0.0, worst_true = 0.0;
  for (std::ptrdiff_t r = 0; r < truth.rows(); ++r)
    for (std::ptrdiff_t c = 1; c + 1 < truth.cols(); ++c) {
      worst_found = std::fmax(worst_found, std::abs(bend(fused->field.z_m, r, c)));
      worst_true = std::fmax(worst_true, std::abs(bend(truth, r, c)));
    }
  EXPECT_LT(worst_found, 1.6 * worst_true);
}

TEST(Fuse, NodesCoarserThanPixelsSeeMeans) {
  const ScratchFolder scratch;
  PlanetRaster r;
  r.pixel = 1.0;
  r.west = -100.0;
  r.north = 100.0;
  r.cols = r.rows = 200;
  r.height = [](double x, double y) {
    const auto i = static_cast<long>(std::floor(x)) + static_cast<long>(std::floor(y));
    return 0.1 * x + (i % 2 == 0 ? 5.0 : -5.0);
  };
  write_planet_raster(r, scratch / "checker.tif");
  const auto fused = fuse(site(kMoon, 0, 0, 80, 8, scratch / "checker.tif"));
  ASSERT_THAT(fused, Succeeds());
  for (std::ptrdiff_t i = 0; i < fused->field.z_m.rows(); ++i)
    for (std::ptrdiff_t j = 0; j < fused->field.z_m.cols(); ++j)
      ASSERT_NEAR(fused->field.z_m(i, j), 0.1 * (-80.0 + 8.0 * static_cast<double>(j)), 0.01);
}

TEST(Fuse, ThreadsDoNotMatter) {
  const ScratchFolder scratch;
  const Waves planet{20.0, 8000.0};
  write_planet_raster(raster_around("+proj=eqc +R=1737400 +units=m", 0, 0, 10.0, 80, planet),
                      scratch / "a.tif");
  auto request = site(kMoon, 0, 0, 200, 1, scratch / "a.tif");
  request.synthetic_detail = 1.0;
  const auto many = fuse(request);
  const oneapi::tbb::global_control one(oneapi::tbb::global_control::max_allowed_parallelism, 1);
  const auto single = fuse(request);
  ASSERT_THAT(many, Succeeds());
  ASSERT_THAT(single, Succeeds());
  EXPECT_EQ(many->field.z_m, single->field.z_m);
  EXPECT_EQ(many->sigma_m, single->sigma_m);
}

}  // namespace
}  // namespace maquette::heightmap
