// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file map_place.hpp
/// An analytic planet drawn in a map around a place, files of it, and whether heights read from a
/// file stand where they should. Needs LIBS GDAL::GDAL.

#include <filesystem>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <gdal_utils.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "heightmap/fuse.hpp"
#include "support/analytic_planet.hpp"
#include "support/matchers.hpp"

namespace maquette::testing_support {

inline const heightmap::Body kMoon = *heightmap::body_by_name("moon");
inline const heightmap::Body kMars = *heightmap::body_by_name("mars");
inline constexpr double kSiteHalfWidth_m = 300.0;

/// A place, the map it is drawn in and the file that is written of it.
struct Place {
  heightmap::Body body = kMoon;
  double latitude = 3.0, longitude = 40.0;
  std::string projection = "+proj=eqc +R=1737400 +units=m";
  double pixel = 10.0;
  int cells = 100;
};

inline Waves planet_of(const Place& p) {
  return {2.0 * p.pixel, p.body.equatorial_radius_m / (20.0 * p.pixel)};
}
inline PlanetRaster raster_of(const Place& p) {
  return raster_around(p.projection, p.latitude, p.longitude, p.pixel, p.cells, planet_of(p));
}

inline heightmap::FuseRequest site_at(const Place& p, const std::filesystem::path& file) {
  heightmap::FuseRequest request;
  request.body = p.body;
  request.centre_latitude_deg = p.latitude;
  request.centre_longitude_deg = p.longitude;
  request.half_width = Metres{kSiteHalfWidth_m};
  request.spacing = Metres{kSiteHalfWidth_m / 38.0};
  request.sources = {heightmap::Source{"raster", file}};
  request.restore = false;  // heights as the raster has them
  return request;
}

/// Heights stand where they should to 0.01 pixel.
inline void expect_in_place(const Place& p, const std::filesystem::path& file) {
  const heightmap::FuseRequest request = site_at(p, file);
  const auto fused = heightmap::fuse(request);
  ASSERT_THAT(fused, Succeeds());
  const Waves planet = planet_of(p);
  const heightmap::PlanetField& f = fused->field;
  Grid<float> truth(f.z_m.rows(), f.z_m.cols());
  for (std::ptrdiff_t r = 0; r < truth.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < truth.cols(); ++c)
      truth(r, c) = static_cast<float>(
          planet(below_plane(p.body, p.latitude, p.longitude,
                             f.x0.value() + f.spacing.value() * static_cast<double>(c),
                             f.y0.value() + f.spacing.value() * static_cast<double>(r))));
  const auto d = displacement(f.z_m, truth, f.spacing.value());
  EXPECT_NEAR(d.east_m / p.pixel, 0.0, 0.01);
  EXPECT_NEAR(d.north_m / p.pixel, 0.0, 0.01);
  EXPECT_NEAR(d.bias_m, 0.0, 0.02);  // stored to 1 m at the worst: 0.29 / sqrt(3600 pixels) = 0.005
  ::testing::Test::RecordProperty("east_pixels", fmt::format("{:.5f}", d.east_m / p.pixel));
  ::testing::Test::RecordProperty("north_pixels", fmt::format("{:.5f}", d.north_m / p.pixel));
}

inline GDALDataset* opened(const std::filesystem::path& path) {
  return static_cast<GDALDataset*>(GDALOpen(path.c_str(), GA_ReadOnly));
}

inline void copy_as(const char* driver, const std::filesystem::path& from,
                    const std::filesystem::path& to, const std::vector<const char*>& options = {}) {
  GDALDataset* in = opened(from);
  ASSERT_NE(in, nullptr);
  char** list = nullptr;
  for (const char* o : options) list = CSLAddString(list, o);
  GDALDataset* out = GetGDALDriverManager()->GetDriverByName(driver)->CreateCopy(
      to.c_str(), in, FALSE, list, nullptr, nullptr);
  EXPECT_NE(out, nullptr) << CPLGetLastErrorMsg();
  if (out != nullptr) GDALClose(out);
  GDALClose(in);
  CSLDestroy(list);
}

}  // namespace maquette::testing_support
