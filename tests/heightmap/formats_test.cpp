// SPDX-License-Identifier: GPL-3.0-or-later

// Claims of heightmap/fuse.hpp and dem_reader.hpp about files, and how each is attacked
//   a height stands where its pixel's centre is, whatever   an analytic planet written in each
//     the format, to 0.01 pixel                               format, by GDAL where it can write
//                                                             it, else label and bytes by hand;
//                                                             the oracle is vector algebra
//   PDS3 labels whose projection offsets count from pixel   the same raster labelled both ways
//     one (MEGDR), whose scale is rounded                     and with a scale of five digits
//   voids: each format's own special pixels                 all five of ISIS in each type, PDS3
//                                                             and PDS4 constants; NaN
//   scale and offset                                        stored as numbers far from metres
//   cut short                                               every format refused, or said by GDAL

#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <functional>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <gdal_utils.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/files.hpp"
#include "heightmap/field_io.hpp"
#include "heightmap/fuse.hpp"
#include "support/analytic_planet.hpp"
#include "support/matchers.hpp"

namespace maquette::heightmap {
namespace {

namespace fs = std::filesystem;
using testing_support::below_plane;
using testing_support::displacement;
using testing_support::FailsWith;
using testing_support::PlanetRaster;
using testing_support::raster_around;
using testing_support::ScratchFolder;
using testing_support::Succeeds;
using testing_support::Waves;
using testing_support::write_planet_raster;

const Body kMoon = *body_by_name("moon");
const Body kMars = *body_by_name("mars");
constexpr double kHalfWidth_m = 300.0;

/// A place, the map it is drawn in and the file that is written of it.
struct Place {
  Body body = kMoon;
  double latitude = 3.0, longitude = 40.0;
  std::string projection = "+proj=eqc +R=1737400 +units=m";
  double pixel = 10.0;
  int cells = 100;
};

Waves planet_of(const Place& p) {
  return {2.0 * p.pixel, p.body.equatorial_radius_m / (20.0 * p.pixel)};
}
PlanetRaster raster_of(const Place& p) {
  return raster_around(p.projection, p.latitude, p.longitude, p.pixel, p.cells, planet_of(p));
}

FuseRequest site_at(const Place& p, const fs::path& file) {
  FuseRequest request;
  request.body = p.body;
  request.centre_latitude_deg = p.latitude;
  request.centre_longitude_deg = p.longitude;
  request.half_width = Metres{kHalfWidth_m};
  request.spacing = Metres{kHalfWidth_m / 38.0};
  request.sources = {Source{"raster", file}};
  request.restore = false;  // heights as the raster has them
  return request;
}

/// Heights stand where they should to 0.01 pixel.
void expect_in_place(const Place& p, const fs::path& file) {
  const FuseRequest request = site_at(p, file);
  const auto fused = fuse(request);
  ASSERT_THAT(fused, Succeeds());
  const Waves planet = planet_of(p);
  const PlanetField& f = fused->field;
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

// ---- written by GDAL

GDALDataset* opened(const fs::path& path) {
  return static_cast<GDALDataset*>(GDALOpen(path.c_str(), GA_ReadOnly));
}

void copy_as(const char* driver, const fs::path& from, const fs::path& to,
             const std::vector<const char*>& options = {}) {
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

struct Written {
  const char* name;
  const char* driver;
  const char* file;
  GDALDataType type;
  double scale, offset;  // height = scale * stored + offset
  std::vector<const char*> options;
};

class ByGdal : public ::testing::TestWithParam<Written> {};

void write_as(const Written& w, const Place& p, const ScratchFolder& scratch) {
  PlanetRaster raster = raster_of(p);
  raster.type = w.type;
  raster.scale = w.scale;
  raster.offset = w.offset;
  write_planet_raster(raster, scratch / "plain.tif");
  copy_as(w.driver, scratch / "plain.tif", scratch / w.file, w.options);
}

INSTANTIATE_TEST_SUITE_P(
    Formats, ByGdal,
    ::testing::Values(
        Written{"cog", "COG", "a.tif", GDT_Float32, 1, 0, {"BLOCKSIZE=128", "COMPRESS=DEFLATE"}},
        Written{"cog_int16_scaled", "COG", "a.tif", GDT_Int16, 0.01, 250, {"BLOCKSIZE=128"}},
        Written{
            "jpeg2000", "JP2OpenJPEG", "a.jp2", GDT_Int16, 1, 0, {"REVERSIBLE=YES", "QUALITY=100"}},
        Written{"isis_real", "ISIS3", "a.cub", GDT_Float32, 1, 0, {}},
        Written{"isis_real_tiled", "ISIS3", "a.cub", GDT_Float32, 1, 0, {"TILED=YES"}},
        Written{"isis_int16_scaled", "ISIS3", "a.cub", GDT_Int16, 0.01, 250, {}},
        Written{"isis_detached", "ISIS3", "a.lbl", GDT_Float32, 1, 0, {"DATA_LOCATION=EXTERNAL"}},
        Written{"isis_geotiff", "ISIS3", "a.lbl", GDT_Float32, 1, 0, {"DATA_LOCATION=GEOTIFF"}},
        Written{"pds4", "PDS4", "a.xml", GDT_Float32, 1, 0, {}},
        Written{"pds4_int16_scaled", "PDS4", "a.xml", GDT_Int16, 0.01, 250, {}},
        Written{"pds4_geotiff", "PDS4", "a.xml", GDT_Float32, 1, 0, {"IMAGE_FORMAT=GEOTIFF"}},
        Written{"vrt", "VRT", "a.vrt", GDT_Int16, 0.01, 250, {}}),
    [](const auto& one) { return std::string(one.param.name); });

TEST_P(ByGdal, CylindricalPixelsStandWhereTheyShould) {
  const ScratchFolder scratch;
  const Place p;
  write_as(GetParam(), p, scratch);
  expect_in_place(p, scratch / GetParam().file);
}

TEST_P(ByGdal, PolarPixelsStandWhereTheyShould) {
  const ScratchFolder scratch;
  const Place p{kMoon, -87.2, 162.8, "+proj=stere +lat_0=-90 +R=1737400 +units=m"};
  write_as(GetParam(), p, scratch);
  expect_in_place(p, scratch / GetParam().file);
}

// ---- PDS3, by hand

/// How the raster is written; the projection lines follow from the place.
struct Pds3 {
  const char* sample_type = "LSB_INTEGER";
  int bits = 16;
  double scale = 0.01, offset = 1737400.0;  // of the stored numbers
  bool attached = false;
  double origin_of_first_pixel = 0.0;  // MEGDR: 1
  std::string map = "SIMPLE CYLINDRICAL";
  double centre_latitude = 0.0, centre_longitude = 0.0;
  double a_km = 1737.4, c_km = 1737.4;
  std::string map_scale{}, map_resolution{};  // empty: exact, not stated
  std::string more{};                         // lines of the projection
  std::string image_more{};                   // lines of the image
};

template <class T>
void append(std::string& bytes, double value, bool msb) {
  const T stored =
      std::is_integral_v<T> ? static_cast<T>(std::lround(value)) : static_cast<T>(value);
  char raw[sizeof(T)];
  std::memcpy(raw, &stored, sizeof(T));
  if (msb) std::reverse(raw, raw + sizeof(T));
  bytes.append(raw, sizeof(T));
}

/// @param stored  changes a stored number (row, column, number), or leaves it
void write_pds3(const Pds3& w, const PlanetRaster& raster, const fs::path& folder,
                const std::function<double(int, int, double)>& stored = nullptr) {
  const std::string type = w.sample_type;
  const bool msb = type.starts_with("MSB") || type == "IEEE_REAL";
  std::string image;
  for (int r = 0; r < raster.rows; ++r)
    for (int c = 0; c < raster.cols; ++c) {
      double v = (raster.height(raster.west + (c + 0.5) * raster.pixel,
                                raster.north - (r + 0.5) * raster.pixel) +
                  (w.offset > 1e6 ? w.a_km * 1000.0 : 0.0) - w.offset) /
                 w.scale;
      if (stored) v = stored(r, c, v);
      if (type.find("REAL") != std::string::npos)
        append<float>(image, v, msb);
      else if (w.bits == 16)
        append<std::int16_t>(image, v, msb);
      else
        append<std::int32_t>(image, v, msb);
    }
  const int record = raster.cols * w.bits / 8;
  std::string label = fmt::format(
      "PDS_VERSION_ID = PDS3\r\nRECORD_TYPE = FIXED_LENGTH\r\nRECORD_BYTES = {}\r\n"
      "^IMAGE = {}\r\nOBJECT = IMAGE\r\n LINES = {}\r\n LINE_SAMPLES = {}\r\n SAMPLE_TYPE = {}\r\n"
      " SAMPLE_BITS = {}\r\n UNIT = METER\r\n SCALING_FACTOR = {}\r\n OFFSET = {:.1f}\r\n{}"
      "END_OBJECT = IMAGE\r\nOBJECT = IMAGE_MAP_PROJECTION\r\n MAP_PROJECTION_TYPE = \"{}\"\r\n"
      " A_AXIS_RADIUS = {:.6f} <KM>\r\n B_AXIS_RADIUS = {:.6f} <KM>\r\n"
      " C_AXIS_RADIUS = {:.6f} <KM>\r\n CENTER_LATITUDE = {}\r\n CENTER_LONGITUDE = {}\r\n"
      " MAP_SCALE = {}\r\n{} LINE_PROJECTION_OFFSET = {:.9f}\r\n"
      " SAMPLE_PROJECTION_OFFSET = {:.9f}\r\n{}END_OBJECT = IMAGE_MAP_PROJECTION\r\nEND\r\n",
      record, w.attached ? fmt::format("{} <BYTES>", 4001) : "\"A.IMG\"", raster.rows, raster.cols,
      type, w.bits, w.scale, w.offset, w.image_more, w.map, w.a_km, w.a_km, w.c_km,
      w.centre_latitude, w.centre_longitude,
      w.map_scale.empty() ? fmt::format("{:.12g} <METERS/PIXEL>", raster.pixel) : w.map_scale,
      w.map_resolution.empty() ? "" : fmt::format(" MAP_RESOLUTION = {}\r\n", w.map_resolution),
      raster.north / raster.pixel - 0.5 + w.origin_of_first_pixel,
      -raster.west / raster.pixel - 0.5 + w.origin_of_first_pixel, w.more);
  if (w.attached) {
    ASSERT_LE(label.size(), 4000U);
    label.resize(4000, ' ');
    image = label + image;
  } else {
    ASSERT_THAT(write_file(folder / "A.LBL", label), Succeeds());
  }
  ASSERT_THAT(write_file(folder / "A.IMG", image), Succeeds());
}

struct Pds3Case {
  const char* name;
  Pds3 label;
  Place place;
};
class ByHand : public ::testing::TestWithParam<Pds3Case> {};

const Place kSouth{kMoon, -87.2, 162.8, "+proj=stere +lat_0=-90 +lon_0=0 +R=1737400 +units=m"};
/// HiRISE: a sphere of the radius at latitude -25, pixels true there.
const Place kZumba{kMars, -28.5, 226.9,
                   "+proj=eqc +lat_ts=-25 +lon_0=226.94 +R=3392593.611 +units=m"};

INSTANTIATE_TEST_SUITE_P(
    Pds3, ByHand,
    ::testing::Values(
        Pds3Case{"lsb_int16_detached", {}, {}},
        Pds3Case{"msb_int16_attached", {"MSB_INTEGER", 16, 0.01, 1737400.0, true}, {}},
        Pds3Case{"float_lsb_attached", {"PC_REAL", 32, 1.0, 0.0, true}, {}},
        Pds3Case{"float_msb", {"IEEE_REAL", 32, 1.0, 0.0}, {}},
        Pds3Case{"polar",
                 {"LSB_INTEGER", 16, 0.01, 1737400.0, false, 0.0, "POLAR STEREOGRAPHIC", -90.0},
                 kSouth},
        Pds3Case{"hirise_local_radius",
                 {"PC_REAL", 32, 1.0, 0.0, true, 0.0, "EQUIRECTANGULAR", -25.0, 226.94, 3392.593611,
                  3392.593611},
                 kZumba},
        // Latitudes y / R are planetographic: the map of the sphere is one of the ellipsoid.
        Pds3Case{"planetographic",
                 {"PC_REAL", 32, 1.0, 0.0, false, 0.0, "SIMPLE CYLINDRICAL", 0.0, 0.0, 3396.19,
                  3376.2, "", "", " COORDINATE_SYSTEM_NAME = \"PLANETOGRAPHIC\"\r\n"},
                 {kMars, 40.0, 10.0, "+proj=eqc +a=3396190 +b=3376200 +units=m"}},
        // 30 degrees west is 330 east; columns still run eastwards.
        Pds3Case{"longitudes_west",
                 {"LSB_INTEGER", 16, 0.01, 1737400.0, false, 0.0, "SIMPLE CYLINDRICAL", 0.0, 30.0,
                  1737.4, 1737.4, "", "", " POSITIVE_LONGITUDE_DIRECTION = WEST\r\n"},
                 {kMoon, 3.0, 331.0, "+proj=eqc +lon_0=-30 +R=1737400 +units=m"}}),
    [](const auto& one) { return std::string(one.param.name); });

TEST_P(ByHand, PixelsStandWhereTheyShould) {
  const ScratchFolder scratch;
  write_pds3(GetParam().label, raster_of(GetParam().place), scratch.path());
  expect_in_place(GetParam().place, scratch / (GetParam().label.attached ? "A.IMG" : "A.LBL"));
  if (!GetParam().label.attached)
    expect_in_place(GetParam().place, scratch / "A.IMG");  // finds the label beside it
}

/// A map of 4 pixels a degree around the whole body in strips of rows: far from the origin,
/// where a rounded scale and an origin counted otherwise show.
TEST(Pds3Label, OffsetsThatCountFromOneAndRoundedScalesAreUnderstood) {
  const double radius = 1737400.0, pixel = radius * std::numbers::pi / 180.0 / 4.0;
  Place p{kMoon, 44.0, 178.7, "+proj=eqc +R=1737400 +units=m", pixel};
  PlanetRaster raster;
  const Waves planet{3000.0, 12.0};
  const auto inverse = std::make_shared<testing_support::MapInverse>(p.projection);
  raster.projection = p.projection;
  raster.pixel = pixel;
  raster.cols = 1440;
  raster.rows = 720;
  raster.west = -720.0 * pixel;
  raster.north = 360.0 * pixel;
  raster.height = [&](double x, double y) { return planet((*inverse)(x, y)); };
  const std::string edges =
      " MAXIMUM_LATITUDE = 90.0\r\n MINIMUM_LATITUDE = -90.0\r\n WESTERNMOST_LONGITUDE = -180.0\r\n"
      " EASTERNMOST_LONGITUDE = 180.0\r\n";
  const auto off_by = [&](const Pds3& label) {
    const ScratchFolder scratch;
    write_pds3(label, raster, scratch.path());
    FuseRequest request = site_at(p, scratch / "A.LBL");
    request.half_width = Metres{30.0 * pixel};
    request.spacing = Metres{0.7 * pixel};
    request.half_width = Metres{42.0 * 0.7 * pixel};
    const auto fused = fuse(request);
    EXPECT_THAT(fused, Succeeds());
    if (!fused) return 1e9;
    Grid<float> truth(fused->field.z_m.rows(), fused->field.z_m.cols());
    for (std::ptrdiff_t r = 0; r < truth.rows(); ++r)
      for (std::ptrdiff_t c = 0; c < truth.cols(); ++c)
        truth(r, c) = static_cast<float>(planet(below_plane(
            kMoon, p.latitude, p.longitude,
            fused->field.x0.value() + request.spacing.value() * static_cast<double>(c),
            fused->field.y0.value() + request.spacing.value() * static_cast<double>(r))));
    // Interpolation weakens waves alike everywhere: it does not shift them.
    const auto d = displacement(fused->field.z_m, truth, request.spacing.value());
    const double east_m = d.east_m / std::cos(p.latitude * std::numbers::pi / 180.0);
    return std::hypot(east_m, d.north_m) / pixel;
  };
  Pds3 lola{"PC_REAL", 32, 1.0, 0.0};
  lola.more = edges;
  EXPECT_LT(off_by(lola), 0.01) << "offsets 359.5, 719.5 as LOLA has them";
  Pds3 mola = lola;
  mola.origin_of_first_pixel = 1.0;
  EXPECT_LT(off_by(mola), 0.01) << "offsets 360.5, 720.5 as MEGDR has them";
  Pds3 rounded = lola;
  rounded.map_resolution = "4.0 <PIXEL/DEGREE>";
  rounded.map_scale = "7.5807 <KM/PIXEL>";  // 7.580838 in truth: 0.013 pixel off at 178.7 E
  EXPECT_LT(off_by(rounded), 0.01) << "the resolution is exact";
  rounded.origin_of_first_pixel = 1.0;
  EXPECT_LT(off_by(rounded), 0.01) << "both";
  // What is corrected is seen by this test at all: without the edges the origin is off by one.
  mola.more.clear();
  EXPECT_NEAR(off_by(mola), std::sqrt(2.0), 0.03);
}

TEST(Pds3Label, ATurnedMapIsRefused) {
  const ScratchFolder scratch;
  const Place p;
  Pds3 label;
  label.more = " MAP_PROJECTION_ROTATION = 90.0 <DEGREE>\r\n";
  write_pds3(label, raster_of(p), scratch.path());
  const auto fused = fuse(site_at(p, scratch / "A.LBL"));
  EXPECT_THAT(fused, FailsWith(kNoProjection));
  EXPECT_THAT(fused.error().message, ::testing::HasSubstr("MAP_PROJECTION_ROTATION"));
}

TEST(Pds3Label, IntegersOf32BitsAreRefusedNotMisread) {
  const ScratchFolder scratch;
  const Place p;
  write_pds3({"LSB_INTEGER", 32}, raster_of(p), scratch.path());
  const auto fused = fuse(site_at(p, scratch / "A.LBL"));
  EXPECT_THAT(fused, FailsWith(kRasterNotReadable));
  EXPECT_THAT(fused.error().message, ::testing::HasSubstr("32 bits"));
}

// ---- special pixels

/// Void at these pixels and nowhere else: coverage counts nodes, nodes stand on pixel centres.
void expect_voids(const fs::path& file, int voids) {
  FuseRequest request;
  request.body = kMoon;
  request.half_width = Metres{200};
  request.spacing = Metres{10};
  request.sources = {Source{"raster", file}};
  request.restore = false;
  const auto fused = fuse(request);
  ASSERT_THAT(fused, Succeeds());
  const int nodes = 41 * 41;
  EXPECT_EQ(std::lround((1.0 - fused->sources[0].coverage) * nodes), voids) << file;
  for (const float h : fused->field.z_m.cells()) ASSERT_NEAR(h, 150.0, 0.01);
}

/// 60 x 60 pixels of 10 m, centres at multiples of 10 m from (0, 0).
PlanetRaster level() {
  PlanetRaster r;
  r.west = -305.0;
  r.north = 305.0;
  r.cols = r.rows = 61;
  r.height = [](double, double) { return 150.0; };
  return r;
}
constexpr int kAt[5][2] = {{20, 30}, {24, 30}, {28, 31}, {32, 30}, {36, 33}};

TEST(SpecialPixels, OfPds3IntegersAndRealsAreVoids) {
  const auto writes = [](const Pds3& label, const std::vector<double>& specials) {
    const ScratchFolder scratch;
    write_pds3(label, level(), scratch.path(), [&](int r, int c, double v) {
      for (std::size_t i = 0; i < specials.size(); ++i)
        if (r == kAt[i][0] && c == kAt[i][1]) return specials[i];
      return v;
    });
    expect_voids(scratch / "A.LBL", static_cast<int>(specials.size()));
  };
  Pds3 integers{"MSB_INTEGER", 16, 0.01, 0.0};
  integers.image_more =
      " CORE_NULL = -32768\r\n CORE_LOW_REPR_SATURATION = -32767\r\n"
      " CORE_LOW_INSTR_SATURATION = -32766\r\n CORE_HIGH_INSTR_SATURATION = -32765\r\n"
      " CORE_HIGH_REPR_SATURATION = -32764\r\n";
  writes(integers, {-32768, -32767, -32766, -32765, -32764});
  Pds3 reals{"PC_REAL", 32, 1.0, 0.0};
  reals.image_more = " MISSING_CONSTANT = 16#FF7FFFFB#\r\n INVALID_CONSTANT = -9999.99\r\n";
  writes(reals, {static_cast<double>(std::bit_cast<float>(0xFF7FFFFBU)), -9999.99, NAN});
}

TEST(SpecialPixels, OfIsisCubesAreVoidsInEveryType) {
  GDALAllRegister();
  struct Type {
    GDALDataType type;
    std::vector<double> specials;  // NULL, LRS, LIS, HIS, HRS
    double scale;
  };
  const auto real = [](std::uint32_t bits) {
    return static_cast<double>(std::bit_cast<float>(bits));
  };
  for (const Type& t :
       {Type{GDT_Int16, {-32768, -32767, -32766, -32765, -32764}, 0.01},
        Type{GDT_UInt16, {0, 1, 2, 65534, 65535}, 0.01}, Type{GDT_Byte, {0, 255}, 1.0},
        Type{GDT_Float32,
             {real(0xFF7FFFFB), real(0xFF7FFFFC), real(0xFF7FFFFD), real(0xFF7FFFFE),
              real(0xFF7FFFFF)},
             1.0}}) {
    const ScratchFolder scratch;
    PlanetRaster raster = level();
    raster.type = t.type;
    raster.scale = t.scale;
    write_planet_raster(raster, scratch / "plain.tif");
    copy_as("ISIS3", scratch / "plain.tif", scratch / "a.cub");
    auto* cube = static_cast<GDALDataset*>(GDALOpen((scratch / "a.cub").c_str(), GA_Update));
    ASSERT_NE(cube, nullptr);
    for (std::size_t i = 0; i < t.specials.size(); ++i) {
      double v = t.specials[i];
      EXPECT_EQ(cube->GetRasterBand(1)->RasterIO(GF_Write, kAt[i][1], kAt[i][0], 1, 1, &v, 1, 1,
                                                 GDT_Float64, 0, 0, nullptr),
                CE_None);
    }
    GDALClose(cube);
    expect_voids(scratch / "a.cub", static_cast<int>(t.specials.size()));
  }
}

TEST(SpecialPixels, OfPds4AndNanAreVoids) {
  const ScratchFolder scratch;
  PlanetRaster raster = level();
  raster.height = [](double x, double y) {
    return std::abs(x) < 1.0 && std::abs(y) < 1.0 ? -3000.0 : 150.0;
  };
  raster.has_nodata = true;
  raster.nodata = -3000.0;
  write_planet_raster(raster, scratch / "plain.tif");
  copy_as("PDS4", scratch / "plain.tif", scratch / "a.xml");
  expect_voids(scratch / "a.xml", 1);
  // A second constant, which GDAL does not know of.
  auto text = read_file(scratch / "a.xml");
  ASSERT_THAT(text, Succeeds());
  const auto at = text->find("<Special_Constants>");
  ASSERT_NE(at, std::string::npos);
  text->insert(at + 19, "<saturated_constant>-2500</saturated_constant>");
  ASSERT_THAT(write_file(scratch / "a.xml", *text), Succeeds());
  {
    std::fstream image(scratch / "a.img", std::ios::in | std::ios::out | std::ios::binary);
    const float saturated = -2500.0F;
    image.seekp(4 * (36 * 61 + 33));
    image.write(reinterpret_cast<const char*>(&saturated), 4);
  }
  expect_voids(scratch / "a.xml", 2);

  raster.has_nodata = false;
  raster.height = [](double x, double y) {
    return std::abs(x) < 1.0 && std::abs(y) < 1.0 ? NAN : 150.0;
  };
  write_planet_raster(raster, scratch / "nan.tif");
  expect_voids(scratch / "nan.tif", 1);
}

// ---- cut short

TEST(CutShort, IsRefusedInEveryFormat) {
  for (const Written& w :
       {Written{"pds4", "PDS4", "a.xml", GDT_Float32, 1, 0, {}},
        Written{"isis", "ISIS3", "a.cub", GDT_Float32, 1, 0, {}},
        Written{"jp2", "JP2OpenJPEG", "a.jp2", GDT_Int16, 1, 0, {"REVERSIBLE=YES", "QUALITY=100"}},
        Written{"cog", "COG", "a.tif", GDT_Float32, 1, 0, {"BLOCKSIZE=128"}}}) {
    const ScratchFolder scratch;
    const Place p;
    write_as(w, p, scratch);
    const fs::path image = scratch / (std::string(w.driver) == "PDS4" ? "a.img" : w.file);
    fs::resize_file(image, fs::file_size(image) / 2);
    EXPECT_THAT(fuse(site_at(p, scratch / w.file)), FailsWith(kRasterNotReadable)) << w.name;
  }
}

}  // namespace
}  // namespace maquette::heightmap
