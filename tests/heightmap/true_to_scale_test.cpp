// SPDX-License-Identifier: GPL-3.0-or-later

// Claims of heightmap/fuse.hpp about the site frame and about size, and how each is attacked
//   a site of 2 km is true to scale to 1e-5      landmarks on a sphere whose places are spherical
//     at 60 and 85 degrees, on any map             trigonometry; their distances in the result
//   of a raster of any size only the pixels      30 000 x 60 000 pixels, sparse; what lies beyond
//     that are needed are read, below 1 GiB        the site is no height; the process' peak

#include <array>
#include <cmath>
#include <fstream>
#include <numbers>
#include <string>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "heightmap/fuse.hpp"
#include "support/analytic_planet.hpp"
#include "support/matchers.hpp"

namespace maquette::heightmap {
namespace {

using testing_support::Direction;
using testing_support::raster_around;
using testing_support::ScratchFolder;
using testing_support::Succeeds;
using testing_support::write_planet_raster;

const Body kMoon = *body_by_name("moon");
constexpr double kDegree = std::numbers::pi / 180.0;

/// The point at `distance_m` along the great circle that leaves (lat, lon) at `azimuth` from north.
Direction along(double lat_deg, double lon_deg, double azimuth_deg, double distance_m) {
  const double arc = distance_m / kMoon.equatorial_radius_m, lat = lat_deg * kDegree,
               lon = lon_deg * kDegree, az = azimuth_deg * kDegree;
  const double s = std::sin(lat) * std::cos(arc) + std::cos(lat) * std::sin(arc) * std::cos(az);
  const double dlon =
      std::atan2(std::sin(az) * std::sin(arc) * std::cos(lat), std::cos(arc) - std::sin(lat) * s);
  const double c = std::sqrt(1.0 - s * s);
  return {c * std::cos(lon + dlon), c * std::sin(lon + dlon), s};
}

/// Round hills at eight points of the compass.
struct Hills {
  std::array<Direction, 8> at;
  double width_m = 40.0;
  double operator()(const Direction& n) const {
    double z = 0.0;
    for (const Direction& h : at) {
      const double d =
          kMoon.equatorial_radius_m * std::hypot(n[0] - h[0], n[1] - h[1], n[2] - h[2]) / width_m;
      z += 50.0 * std::exp(-0.5 * d * d);
    }
    return z;
  }
};

/// Where a hill stands in the result: middle of what is above half of it, twice refined.
std::array<double, 2> summit(const PlanetField& f, double x, double y) {
  for (int i = 0; i < 20; ++i) {
    double sx = 0.0, sy = 0.0, sw = 0.0;
    for (std::ptrdiff_t r = 0; r < f.z_m.rows(); ++r)
      for (std::ptrdiff_t c = 0; c < f.z_m.cols(); ++c) {
        const double px = f.x0.value() + f.spacing.value() * static_cast<double>(c) - x,
                     py = f.y0.value() + f.spacing.value() * static_cast<double>(r) - y;
        const double d2 = (px * px + py * py) / (40.0 * 40.0);
        if (d2 > 9.0) continue;
        // A matched filter: its fixed point is where hill and weight stand on each other.
        const double w = static_cast<double>(f.z_m(r, c)) * std::exp(-0.5 * d2);
        sx += w * px;
        sy += w * py;
        sw += w;
      }
    x += 2.0 * sx / sw;  // product of two Gaussians stands half-way
    y += 2.0 * sy / sw;
  }
  return {x, y};
}

struct Site {
  const char* name;
  double latitude;
  std::string projection;
  double pixel;  // map units
};
class TrueToScale : public ::testing::TestWithParam<Site> {};
INSTANTIATE_TEST_SUITE_P(
    Maps, TrueToScale,
    ::testing::Values(Site{"equirectangular_60", 60.0, "+proj=eqc +R=1737400 +units=m", 5.0},
                      Site{"equirectangular_true_at_60", 60.0,
                           "+proj=eqc +lat_ts=60 +R=1737400 +units=m", 5.0},
                      Site{"equirectangular_85", 85.0, "+proj=eqc +R=1737400 +units=m", 5.0},
                      Site{"mercator_60", 60.0, "+proj=merc +R=1737400 +units=m", 10.0},
                      Site{"polar_60", 60.0, "+proj=stere +lat_0=90 +R=1737400 +units=m", 5.0},
                      Site{"polar_85", 85.0, "+proj=stere +lat_0=90 +R=1737400 +units=m", 5.0},
                      Site{"sinusoidal_60", 60.0, "+proj=sinu +R=1737400 +units=m", 5.0}),
    [](const auto& one) { return std::string(one.param.name); });

TEST_P(TrueToScale, DistancesOfLandmarksAreThoseOnTheBody) {
  const ScratchFolder scratch;
  const Site& s = GetParam();
  const double lon = 20.0, reach_m = 850.0;
  Hills hills;
  for (std::size_t i = 0; i < 8; ++i)
    hills.at[i] = along(s.latitude, lon, 45.0 * static_cast<double>(i), reach_m);
  // Columns of a cylindrical map are wider than the ground by 1 / cos(latitude), at most 11.5.
  auto raster = raster_around(s.projection, s.latitude, lon, s.pixel, 600, hills);
  if (s.projection.find("eqc") != std::string::npos) {
    const int cols = s.latitude > 80.0 ? 5400 : 1000;
    raster.west -= 0.5 * s.pixel * (cols - raster.cols);
    raster.cols = cols;
  }
  if (s.projection.find("sinu") != std::string::npos) {
    raster.west -= 300.0 * s.pixel;
    raster.north += 100.0 * s.pixel;
    raster.cols = 1200;
    raster.rows = 800;
  }
  write_planet_raster(raster, scratch / "a.tif");
  FuseRequest request;
  request.body = kMoon;
  request.centre_latitude_deg = s.latitude;
  request.centre_longitude_deg = lon;
  request.half_width = Metres{1000};
  request.spacing = Metres{4};
  request.sources = {Source{"raster", scratch / "a.tif"}};
  request.restore = false;
  const auto fused = fuse(request);
  ASSERT_THAT(fused, Succeeds());

  std::array<std::array<double, 2>, 8> found;
  for (std::size_t i = 0; i < 8; ++i) {
    const double az = 45.0 * static_cast<double>(i) * kDegree;
    found[i] = summit(fused->field, reach_m * std::sin(az), reach_m * std::cos(az));
  }
  double worst = 0.0;
  for (std::size_t i = 0; i < 8; ++i)
    for (std::size_t j = 0; j < i; ++j) {
      const Direction &a = hills.at[i], &b = hills.at[j];
      const double chord = std::hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
      const double arc_m = 2.0 * kMoon.equatorial_radius_m * std::asin(0.5 * chord);
      const double in_model = std::hypot(found[i][0] - found[j][0], found[i][1] - found[j][1]);
      worst = std::fmax(worst, std::abs(in_model / arc_m - 1.0));
    }
  RecordProperty("worst_scale_error", fmt::format("{:.2e}", worst));
  EXPECT_LT(worst, 1e-5);
}

/// Peak resident memory of this process since the last call with `reset`, MiB.
double peak_mib(bool reset) {
  if (reset) std::ofstream("/proc/self/clear_refs") << "5";
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);)
    if (line.starts_with("VmHWM:")) return std::stod(line.substr(6)) / 1024.0;
  return NAN;
}

/// 60 000 columns and 30 000 rows of float around the whole Moon, almost all of it holes in the
/// file. Around the site it holds a plane, beyond that what no height is: reading that is an error.
class OutOfCore : public ::testing::TestWithParam<bool> {};
INSTANTIATE_TEST_SUITE_P(Layouts, OutOfCore, ::testing::Bool(),
                         [](const auto& one) { return one.param ? "tiles" : "strips"; });

TEST_P(OutOfCore, ReadsOnlyWhatIsNeededBelowOneGibibyte) {
  const ScratchFolder scratch;
  GDALAllRegister();
  const int cols = 60000, rows = 30000;
  const double pixel = 2.0 * std::numbers::pi * kMoon.equatorial_radius_m / cols;
  char** options = nullptr;
  options = CSLSetNameValue(options, "SPARSE_OK", "TRUE");
  options = CSLSetNameValue(options, "BIGTIFF", "YES");
  if (GetParam()) options = CSLSetNameValue(options, "TILED", "YES");
  auto* big = GetGDALDriverManager()->GetDriverByName("GTiff")->Create(
      (scratch / "big.tif").c_str(), cols, rows, 1, GDT_Float32, options);
  CSLDestroy(options);
  ASSERT_NE(big, nullptr);
  OGRSpatialReference srs;
  srs.SetFromUserInput("+proj=eqc +R=1737400 +units=m");
  big->SetSpatialRef(&srs);
  double gt[6] = {-0.5 * cols * pixel, pixel, 0.0, 0.5 * rows * pixel, 0.0, -pixel};
  big->SetGeoTransform(gt);
  // The site: +-1200 pixels about (0, 0). The corners need 1218 columns (7 degrees north);
  // poison from 1230 on.
  const int middle_u = cols / 2, middle_v = rows / 2, near = 1230, far = 1500;
  std::vector<float> line(static_cast<std::size_t>(2 * far));
  for (int v = middle_v - far; v < middle_v + far; ++v) {
    for (int u = middle_u - far; u < middle_u + far; ++u) {
      const bool needed = std::abs(u - middle_u) < near && std::abs(v - middle_v) < near;
      line[static_cast<std::size_t>(u - middle_u + far)] =
          needed ? static_cast<float>(0.1 * (u - middle_u) - 0.05 * (v - middle_v)) : 9e9F;
    }
    ASSERT_EQ(big->GetRasterBand(1)->RasterIO(GF_Write, middle_u - far, v, 2 * far, 1, line.data(),
                                              2 * far, 1, GDT_Float32, 0, 0, nullptr),
              CE_None);
  }
  GDALClose(big);

  const double before = peak_mib(true);
  FuseRequest request;
  request.body = kMoon;
  request.half_width = Metres{1200.0 * pixel};
  request.spacing = Metres{2.0 * pixel};
  request.sources = {Source{"big", scratch / "big.tif"}};
  request.restore = false;
  const auto fused = fuse(request);
  ASSERT_THAT(fused, Succeeds());
  const double peak = peak_mib(false);
  RecordProperty("peak_mib", fmt::format("{:.0f}", peak));
  RecordProperty("before_mib", fmt::format("{:.0f}", before));
  EXPECT_LT(peak, 1024.0);
  const Grid<float>& z = fused->field.z_m;
  EXPECT_NEAR(z(600, 600), -0.075, 1.0);  // pixel centres are half a pixel off the middle
  EXPECT_NEAR(z(600, 1100) - z(600, 100), 0.1 * 2000.0, 1.0);
}

}  // namespace
}  // namespace maquette::heightmap
