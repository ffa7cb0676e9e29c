// SPDX-License-Identifier: GPL-3.0-or-later

// What is claimed in assets/synthetic_products.hpp, and how each claim is attacked:
//
//   GDAL finds every pixel where it is ..... read back through GDAL; latitude and longitude
//                                            by PROJ; site frame by vector algebra written
//                                            here; residual displacement estimated from the
//                                            truth's own slopes
//   heights are truth + plant + noise ...... mean and spread of the residuals
//   real archive formats ................... record arithmetic, OFFSET and SCALING_FACTOR,
//                                            label corners against GDAL's, missing constant
//   what is covered ........................ no void within the half width, voids in the
//                                            corners; the coarse reaches 4 x as far
//   on a sphere, an ellipsoid, any side .... Moon and Mars, longitudes about 0 and 180
//   same site, same bytes .................. one thread against all; another seed differs
//   every documented error ................. one case per field, stop, folder missing

#include "assets/synthetic_products.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <filesystem>
#include <limits>
#include <memory>
#include <numbers>
#include <ostream>
#include <regex>
#include <stop_token>
#include <string>
#include <vector>

#include <gdal_priv.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <ogr_spatialref.h>
#include <tbb/global_control.h>
#include <nlohmann/json.hpp>

#include "core/vec.hpp"
#include "support/matchers.hpp"

namespace maquette::assets {

/// What GoogleTest says of a failed parameter.
void PrintTo(const SyntheticSite& s, std::ostream* out) {
  *out << s.body.name << " at " << s.centre_latitude_deg << ", " << s.centre_longitude_deg
       << ", seed " << s.seed;
}

namespace {

using testing_support::FailsWith;
using testing_support::ScratchFolder;
using testing_support::Succeeds;

constexpr double kDegree = std::numbers::pi / 180.0;

SyntheticSite moon() {
  return {};
}
SyntheticSite mars() {
  SyntheticSite s;
  s.body = {"mars", 3396190.0, 3376200.0};
  s.centre_latitude_deg = 18.44;
  s.centre_longitude_deg = 77.45;
  s.seed = 3;
  return s;
}
SyntheticSite at_longitude(double longitude_deg) {
  SyntheticSite s;
  s.centre_latitude_deg = 26.1;
  s.centre_longitude_deg = longitude_deg;
  s.seed = 4;
  return s;
}

/// The site frame by vector algebra: point of the ellipsoid at a planetocentric
/// direction, minus the centre, along east and north of the ellipsoid's normal.
class Plane {
 public:
  explicit Plane(const SyntheticSite& s)
      : a_(s.body.equatorial_radius_m), b_(s.body.polar_radius_m) {
    centre_ = on_ellipsoid(s.centre_latitude_deg, s.centre_longitude_deg);
    up_ = normalized(Vec3{centre_.x / (a_ * a_), centre_.y / (a_ * a_), centre_.z / (b_ * b_)});
    east_ = normalized(cross(Vec3{0.0, 0.0, 1.0}, up_));
    north_ = cross(up_, east_);
  }
  void east_north(double latitude_deg, double longitude_deg, double& e, double& n) const {
    const Vec3 d = on_ellipsoid(latitude_deg, longitude_deg) - centre_;
    e = dot(d, east_);
    n = dot(d, north_);
  }

 private:
  [[nodiscard]] Vec3 on_ellipsoid(double latitude_deg, double longitude_deg) const {
    const double lat = latitude_deg * kDegree, lon = longitude_deg * kDegree;
    const double r = 1.0 / std::hypot(std::cos(lat) / a_, std::sin(lat) / b_);
    return r * Vec3{std::cos(lat) * std::cos(lon), std::cos(lat) * std::sin(lon), std::sin(lat)};
  }
  double a_, b_;
  Vec3 centre_, up_, east_, north_;
};

/// A raster as GDAL sees it.
struct Raster {
  int width = 0, height = 0;
  std::vector<double> value, latitude, longitude;  // of pixel centres
  double offset = 0.0, scale = 1.0, nodata = 0.0, pixel_m = 0.0, radius_m = 0.0;
  double corner_latitude[2], corner_longitude[2];  // upper left, lower right
};

Raster read(const std::filesystem::path& path) {
  GDALAllRegister();
  Raster r;
  const std::unique_ptr<GDALDataset> data(GDALDataset::Open(path.c_str(), GDAL_OF_RASTER));
  EXPECT_NE(data, nullptr) << path;
  if (!data) return r;
  EXPECT_STREQ(data->GetDriverName(), "PDS");
  EXPECT_EQ(data->GetRasterCount(), 1);
  r.width = data->GetRasterXSize();
  r.height = data->GetRasterYSize();
  GDALRasterBand* band = data->GetRasterBand(1);
  r.offset = band->GetOffset();
  r.scale = band->GetScale();
  r.nodata = band->GetNoDataValue();
  double t[6];
  EXPECT_EQ(data->GetGeoTransform(t), CE_None);
  EXPECT_EQ(t[2], 0.0);
  EXPECT_EQ(t[4], 0.0);
  EXPECT_EQ(t[1], -t[5]);
  r.pixel_m = t[1];
  const auto n = static_cast<std::size_t>(r.width) * static_cast<std::size_t>(r.height);
  r.value.resize(n);
  EXPECT_EQ(band->RasterIO(GF_Read, 0, 0, r.width, r.height, r.value.data(), r.width, r.height,
                           GDT_Float64, 0, 0),
            CE_None);
  OGRSpatialReference map(*data->GetSpatialRef());
  map.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
  r.radius_m = map.GetSemiMajor();
  const std::unique_ptr<OGRSpatialReference> globe(map.CloneGeogCS());
  globe->SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
  const std::unique_ptr<OGRCoordinateTransformation> to_globe(
      OGRCreateCoordinateTransformation(&map, globe.get()));
  for (int y = 0; y < r.height; ++y)
    for (int x = 0; x < r.width; ++x) {
      r.longitude.push_back(t[0] + (x + 0.5) * t[1]);
      r.latitude.push_back(t[3] + (y + 0.5) * t[5]);
    }
  EXPECT_TRUE(to_globe->Transform(r.width * r.height, r.longitude.data(), r.latitude.data()));
  for (int k = 0; k < 2; ++k) {
    r.corner_longitude[k] = t[0] + k * r.width * t[1];
    r.corner_latitude[k] = t[3] + k * r.height * t[5];
  }
  EXPECT_TRUE(to_globe->Transform(2, r.corner_longitude, r.corner_latitude));
  return r;
}

/// Residuals of a product against the truth: least squares for a displacement of the
/// content by (east, north, up).
struct Fit {
  double east = 0.0, north = 0.0, up = 0.0, rms = 0.0;
  int pixels = 0, voids = 0, voids_inside = 0;
  double reach = INFINITY;  // of the covered square about the centre
};

Fit fit(const Raster& r, const SyntheticSite& site, double inside_m, double shift_east,
        double shift_north, double shift_up) {
  const Plane plane(site);
  Fit f;
  double m[3][4] = {};
  double sum2 = 0.0;
  double w = INFINITY, e_max = -INFINITY, s = INFINITY, n_max = -INFINITY;
  for (std::size_t i = 0; i < r.value.size(); ++i) {
    double e = 0.0, n = 0.0;
    plane.east_north(r.latitude[i], r.longitude[i], e, n);
    w = std::min(w, e), e_max = std::max(e_max, e);
    s = std::min(s, n), n_max = std::max(n_max, n);
    if (r.value[i] == r.nodata) {
      ++f.voids;
      f.voids_inside += std::max(std::abs(e), std::abs(n)) <= inside_m;
      continue;
    }
    if (i % 2 != 0) continue;  // half of the pixels decide as well and cost half
    const double te = e - shift_east, tn = n - shift_north, h = 0.25;
    const double ge =
        (synthetic_height_m(site, te + h, tn) - synthetic_height_m(site, te - h, tn)) / (2.0 * h);
    const double gn =
        (synthetic_height_m(site, te, tn + h) - synthetic_height_m(site, te, tn - h)) / (2.0 * h);
    const double residual = r.value[i] * r.scale - synthetic_height_m(site, te, tn) - shift_up;
    sum2 += residual * residual;
    ++f.pixels;
    // z(e - de) = z - de ge - dn gn
    const double row[3] = {-ge, -gn, 1.0};
    for (int a = 0; a < 3; ++a) {
      for (int b = 0; b < 3; ++b) m[a][b] += row[a] * row[b];
      m[a][3] += row[a] * residual;
    }
  }
  for (int a = 0; a < 3; ++a)  // Gauss and Jordan; positive definite, no pivoting needed
    for (int b = 0; b < 3; ++b)
      if (b != a) {
        const double k = m[b][a] / m[a][a];
        for (int c = 0; c < 4; ++c) m[b][c] -= k * m[a][c];
      }
  f.east = m[0][3] / m[0][0];
  f.north = m[1][3] / m[1][1];
  f.up = m[2][3] / m[2][2];
  f.rms = std::sqrt(sum2 / f.pixels);
  f.reach = std::min({-w, e_max, -s, n_max});
  return f;
}

double keyword(const std::string& label, const std::string& key) {
  std::smatch match;
  EXPECT_TRUE(std::regex_search(label, match, std::regex("[\\s^]" + key + "\\s*= *([-+0-9.eE]+)")))
      << key;
  return match.empty() ? NAN : std::stod(match[1]);
}

class ProductsOfSite : public testing::TestWithParam<SyntheticSite> {
 protected:
  void SetUp() override {
    const auto written = write_synthetic_products(site, scratch.path());
    ASSERT_THAT(written, Succeeds());
    products = *written;
  }
  const SyntheticSite site = GetParam();
  ScratchFolder scratch;
  SyntheticProducts products;
};

// The displacement is known to 0.05 m / (0.15 slope * sqrt(5e4)) = 1.5 mm for the fine and
// to 0.33 / (0.15 * sqrt(2e3)) = 50 mm for the coarse product: both are far below 0.02 pixel.
TEST_P(ProductsOfSite, FineIsWhereGdalSaysItIs) {
  const Raster r = read(products.fine_img);
  ASSERT_FALSE(r.value.empty());
  EXPECT_EQ(r.pixel_m, site.fine_pixel.value());
  EXPECT_EQ(r.offset, 0.0);
  EXPECT_EQ(r.scale, 1.0);
  const Fit f = fit(r, site, site.half_width.value(), site.planted_shift_east.value(),
                    site.planted_shift_north.value(), site.planted_shift_up.value());
  EXPECT_NEAR(f.east, 0.0, 0.01);
  EXPECT_NEAR(f.north, 0.0, 0.01);
  EXPECT_NEAR(f.up, 0.0, 5.0 * site.fine_noise_m / std::sqrt(f.pixels));
  EXPECT_NEAR(f.rms, site.fine_noise_m, 5.0 * site.fine_noise_m / std::sqrt(2.0 * f.pixels));
  EXPECT_EQ(f.voids, 4 * 36) << "triangles of side 8 in four corners";
  EXPECT_EQ(f.voids_inside, 0);
  EXPECT_GE(f.reach, site.half_width.value() + 9.0 * site.fine_pixel.value());
}

TEST_P(ProductsOfSite, CoarseIsWhereGdalSaysItIs) {
  const Raster r = read(products.coarse_lbl);
  ASSERT_FALSE(r.value.empty());
  EXPECT_NEAR(r.pixel_m, site.coarse_pixel.value(), 0.01);
  EXPECT_EQ(r.offset, site.body.equatorial_radius_m);
  EXPECT_EQ(r.radius_m, site.body.equatorial_radius_m);
  EXPECT_EQ(r.scale, 0.5);
  const Fit f = fit(r, site, 4.0 * site.half_width.value(), 0.0, 0.0, 0.0);
  const double sigma = std::hypot(site.coarse_noise_m, 0.5 / std::sqrt(12.0));
  EXPECT_NEAR(f.east, 0.0, 0.01 * site.coarse_pixel.value());
  EXPECT_NEAR(f.north, 0.0, 0.01 * site.coarse_pixel.value());
  EXPECT_NEAR(f.up, 0.0, 5.0 * sigma / std::sqrt(f.pixels));
  EXPECT_NEAR(f.rms, sigma, 5.0 * sigma / std::sqrt(2.0 * f.pixels));
  EXPECT_EQ(f.voids, 0);
  EXPECT_GE(f.reach, 4.0 * site.half_width.value());
}

TEST_P(ProductsOfSite, LabelsAgreeWithThePixelsAndTheFiles) {
  const std::string fine = *read_file(products.fine_img);
  const std::string fine_label = fine.substr(0, fine.find("\r\nEND\r\n"));
  const double record = keyword(fine_label, "RECORD_BYTES");
  EXPECT_EQ(record, 4.0 * keyword(fine_label, "LINE_SAMPLES"));
  EXPECT_EQ(keyword(fine_label, "FILE_RECORDS") * record, static_cast<double>(fine.size()));
  EXPECT_EQ(keyword(fine_label, "LABEL_RECORDS") + keyword(fine_label, "LINES"),
            keyword(fine_label, "FILE_RECORDS"));
  const std::string coarse_label = *read_file(products.coarse_lbl);
  EXPECT_EQ(keyword(coarse_label, "FILE_RECORDS") * keyword(coarse_label, "RECORD_BYTES"),
            static_cast<double>(std::filesystem::file_size(products.coarse_img)));
  for (const auto& [label, path] :
       {std::pair(fine_label, products.fine_img), std::pair(coarse_label, products.coarse_lbl)}) {
    const Raster r = read(path);
    // Labels give nine decimals.
    EXPECT_NEAR(keyword(label, "MAXIMUM_LATITUDE"), r.corner_latitude[0], 1e-8);
    EXPECT_NEAR(keyword(label, "MINIMUM_LATITUDE"), r.corner_latitude[1], 1e-8);
    EXPECT_NEAR(
        std::remainder(keyword(label, "WESTERNMOST_LONGITUDE") - r.corner_longitude[0], 360.0), 0.0,
        1e-8);
    EXPECT_NEAR(
        std::remainder(keyword(label, "EASTERNMOST_LONGITUDE") - r.corner_longitude[1], 360.0), 0.0,
        1e-8);
    // Every line of a PDS label ends in CR LF.
    EXPECT_EQ(std::count(label.begin(), label.end(), '\n'),
              std::count(label.begin(), label.end(), '\r'));
  }
  const Raster r = read(products.fine_img);
  double low = INFINITY, high = -INFINITY;
  for (const double v : r.value)
    if (v != r.nodata) low = std::min(low, v), high = std::max(high, v);
  EXPECT_GE(low, keyword(fine_label, "VALID_MINIMUM") - 1e-6);
  EXPECT_LE(high, keyword(fine_label, "VALID_MAXIMUM") + 1e-6);
  const Raster c = read(products.coarse_lbl);
  EXPECT_EQ(keyword(coarse_label, "MINIMUM"), *std::min_element(c.value.begin(), c.value.end()));
  EXPECT_EQ(keyword(coarse_label, "MAXIMUM"), *std::max_element(c.value.begin(), c.value.end()));
}

TEST_P(ProductsOfSite, TruthFileSaysWhatWasPlanted) {
  const auto j = nlohmann::json::parse(*read_file(products.truth_json));
  EXPECT_EQ(j["schema"], "maquette.synthetic_site/1");
  EXPECT_EQ(j["seed"], site.seed);
  EXPECT_EQ(j["centre_latitude_deg"], site.centre_latitude_deg);
  EXPECT_EQ(j["centre_longitude_deg"], site.centre_longitude_deg);
  EXPECT_EQ(j["body"]["name"], site.body.name);
  EXPECT_EQ(j["fine"]["shift_east_m"], 1.7);
  EXPECT_EQ(j["fine"]["shift_north_m"], -0.9);
  EXPECT_EQ(j["fine"]["shift_up_m"], 4.2);
  EXPECT_EQ(j["fine"]["noise_m"], 0.05);
  EXPECT_EQ(j["coarse"]["noise_m"], 0.3);
  EXPECT_TRUE(std::filesystem::exists(scratch / j["coarse"]["image"].get<std::string>()));
}

// Longitudes 0.001 and 359.9995 lie within the site's reach of the meridian, 180 on the
// map's own centre, -11.2 is 348.8 written otherwise.
INSTANTIATE_TEST_SUITE_P(Site, ProductsOfSite,
                         testing::Values(moon(), mars(), at_longitude(0.001),
                                         at_longitude(359.9995), at_longitude(180.0),
                                         at_longitude(-11.2)),
                         [](const auto& param_info) {
                           return param_info.param.body.name + "_" +
                                  std::to_string(param_info.index);
                         });

TEST(SyntheticProducts, MarsFineMapHasTheLocalRadiusAsHiriseHas) {
  const ScratchFolder scratch;
  const auto written = write_synthetic_products(mars(), scratch.path());
  ASSERT_THAT(written, Succeeds());
  const double lat = 20.0 * kDegree;  // standard parallel of a site at 18.44
  const double radius = 1.0 / std::hypot(std::cos(lat) / 3396190.0, std::sin(lat) / 3376200.0);
  EXPECT_NEAR(read(written->fine_img).radius_m, radius, 1e-3);
}

TEST(SyntheticProducts, VoidsCarryTheMissingConstantOfTheLabel) {
  const ScratchFolder scratch;
  const auto written = write_synthetic_products(moon(), scratch.path());
  ASSERT_THAT(written, Succeeds());
  EXPECT_THAT(*read_file(written->fine_img), testing::HasSubstr("MISSING_CONSTANT = 16#FF7FFFFB#"));
  const Raster r = read(written->fine_img);
  EXPECT_EQ(r.value[0], static_cast<double>(std::bit_cast<float>(0xFF7FFFFBU)));
}

SyntheticSite small() {
  SyntheticSite s;
  s.half_width = Metres{40.0};
  return s;
}

std::string all_bytes(const SyntheticProducts& p) {
  return *read_file(p.fine_img) + *read_file(p.coarse_img) + *read_file(p.coarse_lbl) +
         *read_file(p.truth_json);
}

TEST(SyntheticProducts, SameSiteSameBytesForAnyNumberOfThreads) {
  const ScratchFolder one, all, other;
  std::string one_thread;
  {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, 1);
    one_thread = all_bytes(*write_synthetic_products(small(), one.path()));
  }
  EXPECT_EQ(one_thread, all_bytes(*write_synthetic_products(small(), all.path())));
  // Written again over the old files.
  EXPECT_EQ(one_thread, all_bytes(*write_synthetic_products(small(), one.path())));
  SyntheticSite another = small();
  another.seed += 1;
  EXPECT_NE(one_thread, all_bytes(*write_synthetic_products(another, other.path())));
}

TEST(SyntheticProducts, NoiseIsWhiteAndCanBeSwitchedOff) {
  SyntheticSite quiet = small(), loud = small();
  quiet.fine_noise_m = 0.0;
  loud.fine_noise_m = 1.0;
  const ScratchFolder a, b;
  const Raster without = read(write_synthetic_products(quiet, a.path())->fine_img);
  const Raster with = read(write_synthetic_products(loud, b.path())->fine_img);
  ASSERT_EQ(without.value.size(), with.value.size());
  double sum = 0.0, sum2 = 0.0, right = 0.0, below = 0.0;
  int n = 0;
  const auto noise = [&](int y, int x) {
    const auto i = static_cast<std::size_t>(y * with.width + x);
    return with.value[i] - without.value[i];
  };
  for (int y = 8; y + 9 < with.height; ++y)
    for (int x = 8; x + 9 < with.width; ++x) {
      const double v = noise(y, x);
      sum += v;
      sum2 += v * v;
      right += v * noise(y, x + 1);
      below += v * noise(y + 1, x);
      ++n;
    }
  const double five_sigma = 5.0 / std::sqrt(n);
  EXPECT_NEAR(sum / n, 0.0, five_sigma);
  EXPECT_NEAR(sum2 / n, 1.0, five_sigma * std::sqrt(2.0));
  EXPECT_NEAR(right / n, 0.0, five_sigma);
  EXPECT_NEAR(below / n, 0.0, five_sigma);
}

// ---- failures -----------------------------------------------------------------

TEST(SyntheticProductsFailures, EveryFieldIsChecked) {
  const ScratchFolder scratch;
  const auto with = [&](auto change) {
    SyntheticSite s = small();
    change(s);
    return write_synthetic_products(s, scratch.path());
  };
  using S = SyntheticSite;
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THAT(with([](S& s) { s.body.equatorial_radius_m = 0.0; }), FailsWith(kSiteOutOfRange));
  EXPECT_THAT(with([](S& s) { s.body.polar_radius_m = kNan; }), FailsWith(kSiteOutOfRange));
  EXPECT_THAT(with([](S& s) { s.body.name = ""; }), FailsWith(kSiteOutOfRange));
  EXPECT_THAT(with([](S& s) { s.body.name = "../moon"; }), FailsWith(kSiteOutOfRange));
  EXPECT_THAT(with([](S& s) { s.centre_latitude_deg = 85.0; }), FailsWith(kSiteOutOfRange));
  EXPECT_THAT(with([](S& s) { s.centre_latitude_deg = kNan; }), FailsWith(kSiteOutOfRange));
  EXPECT_THAT(with([](S& s) { s.centre_longitude_deg = 361.0; }), FailsWith(kSiteOutOfRange));
  EXPECT_THAT(with([](S& s) { s.half_width = Metres{0.0}; }), FailsWith(kSiteOutOfRange));
  EXPECT_THAT(with([](S& s) { s.half_width = Metres{1e6}; }), FailsWith(kSiteOutOfRange));
  EXPECT_THAT(with([](S& s) { s.fine_pixel = Metres{-1.0}; }), FailsWith(kSiteOutOfRange));
  EXPECT_THAT(with([](S& s) { s.fine_pixel = Metres{1e-4}; }), FailsWith(kSiteOutOfRange));
  EXPECT_THAT(with([](S& s) { s.coarse_pixel = Metres{50.0}; }), FailsWith(kSiteOutOfRange));
  EXPECT_THAT(with([](S& s) { s.planted_shift_up = Metres{kNan}; }), FailsWith(kSiteOutOfRange));
  EXPECT_THAT(with([](S& s) { s.fine_noise_m = -0.1; }), FailsWith(kSiteOutOfRange));
  EXPECT_THAT(with([](S& s) { s.coarse_noise_m = 1e3; }), FailsWith(kSiteOutOfRange));
  EXPECT_TRUE(std::filesystem::is_empty(scratch.path())) << "a refused site leaves no file";
}

TEST(SyntheticProductsFailures, StopLeavesNoFile) {
  const ScratchFolder scratch;
  std::stop_source stop;
  stop.request_stop();
  RunContext run;
  run.stop = stop.get_token();
  EXPECT_THAT(write_synthetic_products(small(), scratch.path(), run), FailsWith(kCancelled));
  EXPECT_TRUE(std::filesystem::is_empty(scratch.path()));
}

TEST(SyntheticProductsFailures, MissingFolderIsNamed) {
  const ScratchFolder scratch;
  const auto result = write_synthetic_products(small(), scratch / "nowhere");
  ASSERT_THAT(result, FailsWith(kFileNotWritable));
  EXPECT_THAT(result.error().message, testing::HasSubstr("nowhere"));
}

TEST(SyntheticProducts, ProgressRunsFromNothingToAll) {
  const ScratchFolder scratch;
  std::vector<double> seen;
  RunContext run;
  run.progress = [&](double share) { seen.push_back(share); };
  ASSERT_THAT(write_synthetic_products(small(), scratch.path(), run), Succeeds());
  ASSERT_FALSE(seen.empty());
  EXPECT_TRUE(std::is_sorted(seen.begin(), seen.end()));
  EXPECT_DOUBLE_EQ(seen.back(), 1.0);
}

}  // namespace
}  // namespace maquette::assets
