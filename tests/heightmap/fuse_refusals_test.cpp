// SPDX-License-Identifier: GPL-3.0-or-later

// Claims of heightmap/fuse.hpp about what is refused: one bad input for each code, and the
// message names what a person must know. Raw products are written byte by byte.
//   CORE_FILE_NOT_FOUND, HEIGHTMAP_RASTER_NOT_READABLE   missing; text; PDS3 and VRT and ISIS cut
//                                                        short; labels whose image is not there
//   NO_PROJECTION, WRONG_BODY, NO_OVERLAP, NOT_COVERED, ALL_VOID, SOURCE_UNIT,
//   IMPLAUSIBLE_HEIGHT, CORE_CANCELLED                   one case or more each
// and what must not be refused: special pixels are voids, all layouts of PDS3 pointers

#include <cmath>
#include <cstdint>
#include <string>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/files.hpp"
#include "heightmap/field_io.hpp"
#include "heightmap/fuse.hpp"
#include "support/matchers.hpp"
#include "support/planet_raster.hpp"

namespace maquette::heightmap {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using testing_support::FailsWith;
using testing_support::PlanetRaster;
using testing_support::ScratchFolder;
using testing_support::Succeeds;
using testing_support::write_planet_raster;

const Body kMoon = *body_by_name("moon");
const Body kMars = *body_by_name("mars");

/// 600 m around (0, 0) on the Moon, 10 m pixels.
PlanetRaster good() {
  PlanetRaster r;
  r.west = -300.0;
  r.north = 300.0;
  r.cols = r.rows = 60;
  r.height = [](double x, double y) { return 100.0 + 0.1 * x - 0.05 * y; };
  return r;
}

FuseRequest site(const std::filesystem::path& raster, const Body& body = kMoon) {
  FuseRequest request;
  request.body = body;
  request.half_width = Metres{200};
  request.spacing = Metres{5};
  request.sources = {Source{"raster", raster}};
  return request;
}

std::string message(const Result<FusedSurface>& result) {
  return result ? "success" : result.error().message;
}

/// A 40 x 40 int16 PDS3 image of the constant 100 at 10 m around (0, 0).
std::string pds3_label(const std::string& pointer, int record_bytes, const std::string& unit) {
  return fmt::format(
      "PDS_VERSION_ID = PDS3\r\nRECORD_TYPE = FIXED_LENGTH\r\nRECORD_BYTES = {}\r\n"
      "FILE_RECORDS = 40\r\n/* a comment = trap */\r\nTARGET_NAME = MOON\r\n^IMAGE = {}\r\n"
      "NOTE = \"two\r\n lines = \"\r\nOBJECT = IMAGE\r\n LINES = 40\r\n LINE_SAMPLES = 40\r\n"
      " SAMPLE_TYPE = LSB_INTEGER\r\n SAMPLE_BITS = 16\r\n UNIT = {}\r\n SCALING_FACTOR = 0.5\r\n"
      " OFFSET = 1737400.\r\nEND_OBJECT = IMAGE\r\nOBJECT = IMAGE_MAP_PROJECTION\r\n"
      " MAP_PROJECTION_TYPE = \"SIMPLE CYLINDRICAL\"\r\n A_AXIS_RADIUS = 1737.4 <KM>\r\n"
      " B_AXIS_RADIUS = 1737.4 <KM>\r\n C_AXIS_RADIUS = 1737.4 <KM>\r\n"
      " POSITIVE_LONGITUDE_DIRECTION = EAST\r\n CENTER_LATITUDE = 0\r\n CENTER_LONGITUDE = 0\r\n"
      " MAP_SCALE = 10 <M/PIX>\r\n MAP_RESOLUTION = 3032.3 <PIX/DEG>\r\n"
      " LINE_PROJECTION_OFFSET = 19.5\r\n SAMPLE_PROJECTION_OFFSET = 19.5\r\n"
      " LINE_FIRST_PIXEL = 1\r\n LINE_LAST_PIXEL = 40\r\n SAMPLE_FIRST_PIXEL = 1\r\n"
      " SAMPLE_LAST_PIXEL = 40\r\n MAP_PROJECTION_ROTATION = 0\r\n"
      "END_OBJECT = IMAGE_MAP_PROJECTION\r\nEND\r\n",
      record_bytes, pointer, unit);
}

std::string int16_image(std::int16_t value = 200) {
  std::string bytes;
  for (int i = 0; i < 1600; ++i) {
    bytes.push_back(static_cast<char>(value & 0xff));
    bytes.push_back(static_cast<char>((value >> 8) & 0xff));
  }
  return bytes;
}

FuseRequest small_site(const std::filesystem::path& raster) {
  FuseRequest request = site(raster);
  request.half_width = Metres{100};
  return request;
}

TEST(FuseRefuses, MissingFileAndNoRaster) {
  const ScratchFolder scratch;
  EXPECT_THAT(fuse(site(scratch / "no.tif")), FailsWith(kFileNotFound));
  ASSERT_THAT(write_file(scratch / "text.img", "no label, no image"), Succeeds());
  EXPECT_THAT(fuse(site(scratch / "text.img")), FailsWith(kRasterNotReadable));
}

struct PointerCase {
  const char* name;
  const char* pointer;
  int gap;  // bytes before the image in its file; -1: attached label
};
class Pds3 : public ::testing::TestWithParam<PointerCase> {};
INSTANTIATE_TEST_SUITE_P(Pointers, Pds3,
                         ::testing::Values(PointerCase{"file", "\"A.IMG\"", 0},
                                           PointerCase{"record", "(\"A.IMG\", 3)", 160},
                                           PointerCase{"bytes", "(\"A.IMG\", 101 <BYTES>)", 100},
                                           PointerCase{"attached_record", "31", -1},
                                           PointerCase{"attached_bytes", "2401 <BYTES>", -1}),
                         [](const auto& one) { return std::string(one.param.name); });

TEST_P(Pds3, ReadsWholeAndRefusesCutShort) {
  const ScratchFolder scratch;
  const bool attached = GetParam().gap < 0;
  std::string label = pds3_label(GetParam().pointer, 80, "METER");
  std::string image = std::string(static_cast<std::size_t>(std::max(0, GetParam().gap)), 'x');
  if (attached) {
    ASSERT_LE(label.size(), 2400U);
    label.resize(2400, ' ');
    image = label;
  } else {
    ASSERT_THAT(write_file(scratch / "A.LBL", label), Succeeds());
  }
  image += int16_image();
  const auto opened = scratch / (attached ? "A.IMG" : "A.LBL");
  ASSERT_THAT(write_file(scratch / "A.IMG", image), Succeeds());
  const auto fused = fuse(small_site(opened));
  ASSERT_THAT(fused, Succeeds());
  for (const float h : fused->field.z_m.cells()) ASSERT_NEAR(h, 100.0, 1e-3);
  EXPECT_THAT(fuse(small_site(scratch / "A.IMG")), Succeeds()) << "finds the label beside it";

  for (const std::size_t missing : {1U, 100U, 3000U}) {
    ASSERT_THAT(write_file(scratch / "A.IMG", image.substr(0, image.size() - missing)), Succeeds());
    const auto cut = fuse(small_site(opened));
    EXPECT_THAT(cut, FailsWith(kRasterNotReadable)) << missing;
    EXPECT_THAT(message(cut), AllOf(HasSubstr("A.IMG"), HasSubstr(std::to_string(image.size())),
                                    HasSubstr(std::to_string(image.size() - missing))));
  }
  if (attached) return;
  std::filesystem::remove(scratch / "A.IMG");
  const auto gone = fuse(small_site(opened));
  EXPECT_THAT(gone, FailsWith(kRasterNotReadable));
  EXPECT_THAT(message(gone), HasSubstr("A.IMG"));
}

TEST(FuseReads, UnitOfThePds3Label) {
  const ScratchFolder scratch;
  ASSERT_THAT(write_file(scratch / "A.IMG", int16_image()), Succeeds());
  // Label says kilometres: 200 * 0.5 + 1737400 km is nowhere on the Moon.
  ASSERT_THAT(write_file(scratch / "A.LBL", pds3_label("\"A.IMG\"", 80, "KILOMETER")), Succeeds());
  EXPECT_THAT(fuse(small_site(scratch / "A.LBL")), FailsWith(kImplausibleHeight));
  ASSERT_THAT(write_file(scratch / "A.LBL", pds3_label("\"A.IMG\"", 80, "KELVIN")), Succeeds());
  EXPECT_THAT(fuse(small_site(scratch / "A.LBL")), FailsWith(kSourceUnit));
}

TEST(FuseRefuses, VrtWithoutOrWithHalfAnImage) {
  const ScratchFolder scratch;
  ASSERT_THAT(
      write_file(scratch / "a.vrt",
                 "<VRTDataset rasterXSize=\"40\" rasterYSize=\"40\"><SRS>+proj=eqc +R=1737400</SRS>"
                 "<GeoTransform>-200,10,0,200,0,-10</GeoTransform>"
                 "<VRTRasterBand dataType=\"Int16\" band=\"1\" subClass=\"VRTRawRasterBand\">"
                 "<SourceFilename relativeToVRT=\"1\">a.raw</SourceFilename>"
                 "<ImageOffset>0</ImageOffset><PixelOffset>2</PixelOffset>"
                 "<LineOffset>80</LineOffset><ByteOrder>LSB</ByteOrder>"
                 "</VRTRasterBand></VRTDataset>"),
      Succeeds());
  const auto gone = fuse(small_site(scratch / "a.vrt"));
  EXPECT_THAT(gone, FailsWith(kRasterNotReadable));
  EXPECT_THAT(message(gone), HasSubstr("a.raw"));
  ASSERT_THAT(write_file(scratch / "a.raw", int16_image().substr(0, 3000)), Succeeds());
  const auto cut = fuse(small_site(scratch / "a.vrt"));
  EXPECT_THAT(cut, FailsWith(kRasterNotReadable));
  EXPECT_THAT(message(cut), AllOf(HasSubstr("3000"), HasSubstr("3200")));
  ASSERT_THAT(write_file(scratch / "a.raw", int16_image()), Succeeds());
  EXPECT_THAT(fuse(small_site(scratch / "a.vrt")), Succeeds());
}

TEST(FuseRefuses, NoProjection) {
  const ScratchFolder scratch;
  PlanetRaster r = good();
  r.projection.clear();
  write_planet_raster(r, scratch / "a.tif");
  EXPECT_THAT(fuse(site(scratch / "a.tif")), FailsWith(kNoProjection));
  const ModelField model{Grid<float>(10, 10, 1.0F), Millimetres{1}, {}, {}};
  ASSERT_THAT(write_model_field(model, scratch / "model.tif"), Succeeds());
  const auto fused = fuse(site(scratch / "model.tif"));
  EXPECT_THAT(fused, FailsWith(kNoProjection));
  EXPECT_THAT(message(fused), AllOf(HasSubstr("model.tif"), HasSubstr("model field")));
}

TEST(FuseRefuses, WrongBodyButNotLocalRadii) {
  const ScratchFolder scratch;
  write_planet_raster(good(), scratch / "moon.tif");
  const auto fused = fuse(site(scratch / "moon.tif", kMars));
  EXPECT_THAT(fused, FailsWith(kWrongBody));
  EXPECT_THAT(message(fused), AllOf(HasSubstr("the moon"), HasSubstr("mars")));
  PlanetRaster r = good();
  for (const char* radius : {"3396190", "3376200", "3396036.81", "3389500"}) {
    r.projection = std::string("+proj=eqc +units=m +R=") + radius;
    write_planet_raster(r, scratch / "mars.tif");
    EXPECT_THAT(fuse(site(scratch / "mars.tif", kMars)), Succeeds()) << radius;
    EXPECT_THAT(fuse(site(scratch / "mars.tif", kMoon)), FailsWith(kWrongBody)) << radius;
  }
  r.projection = "+proj=eqc +units=m +ellps=WGS84";
  write_planet_raster(r, scratch / "earth.tif");
  EXPECT_THAT(message(fuse(site(scratch / "earth.tif", kMars))), HasSubstr("earth"));
}

TEST(FuseRefuses, NoOverlapWithBothExtents) {
  const ScratchFolder scratch;
  write_planet_raster(good(), scratch / "a.tif");
  FuseRequest request = site(scratch / "a.tif");
  for (const auto& [lat, lon] : {std::pair{45.0, 0.0}, {0.0, 90.0}, {0.0, -1.0}, {0.0, 181.0}}) {
    request.centre_latitude_deg = lat;
    request.centre_longitude_deg = lon;
    EXPECT_THAT(fuse(request), FailsWith(kNoOverlap)) << lat << " " << lon;
  }
  request.centre_latitude_deg = 45.0;
  EXPECT_THAT(message(fuse(request)), AllOf(HasSubstr("44.99"), HasSubstr("-0.0099")));
  request.centre_latitude_deg = 0.0;
  request.centre_longitude_deg = 360.0;
  EXPECT_THAT(fuse(request), Succeeds());
}

TEST(FuseRefuses, NotCovered) {
  const ScratchFolder scratch;
  write_planet_raster(good(), scratch / "a.tif");
  FuseRequest request = site(scratch / "a.tif");
  request.centre_longitude_deg = 0.004;  // 121 m east: 21 m of 400 stick out
  const auto fused = fuse(request);
  EXPECT_THAT(fused, FailsWith(kNotCovered));
  EXPECT_THAT(message(fused), HasSubstr("93.8")) << "the share that is covered";
  request.spacing = Metres{1};
  request.centre_longitude_deg = 0.00333;  // 1 m
  EXPECT_THAT(fuse(request), Succeeds());
}

TEST(FuseRefuses, AllVoid) {
  const ScratchFolder scratch;
  PlanetRaster r = good();
  r.height = [](double, double) { return -3.4028226550889e38; };  // ISIS NULL, undeclared
  write_planet_raster(r, scratch / "a.tif");
  EXPECT_THAT(fuse(site(scratch / "a.tif")), FailsWith(kAllVoid));
  r.has_nodata = true;
  r.nodata = -32767;
  r.height = [](double, double) { return -32767.0; };
  write_planet_raster(r, scratch / "a.tif");
  EXPECT_THAT(fuse(site(scratch / "a.tif")), FailsWith(kAllVoid));
}

TEST(FuseRefuses, UnitsThatContradict) {
  const ScratchFolder scratch;
  PlanetRaster r = good();
  r.unit = "km";
  r.height = [](double, double) { return 1.5; };
  write_planet_raster(r, scratch / "a.tif");
  FuseRequest request = site(scratch / "a.tif");
  EXPECT_THAT(fuse(request), Succeeds());
  request.sources[0].unit = "m";
  EXPECT_THAT(fuse(request), FailsWith(kSourceUnit));
  request.sources[0].unit = "furlong";
  EXPECT_THAT(fuse(request), FailsWith(kSourceUnit));
  r.unit = "foot";
  write_planet_raster(r, scratch / "a.tif");
  EXPECT_THAT(fuse(site(scratch / "a.tif")), FailsWith(kSourceUnit));
}

TEST(FuseRefuses, ImplausibleHeightsWithTheRange) {
  const ScratchFolder scratch;
  PlanetRaster r = good();
  const auto refuses = [&](const char* range) {
    write_planet_raster(r, scratch / "a.tif");
    const auto fused = fuse(site(scratch / "a.tif"));
    EXPECT_THAT(fused, FailsWith(kImplausibleHeight));
    EXPECT_THAT(message(fused), HasSubstr(range));
  };
  r.height = [](double, double) { return -17758.0; };  // LDEM without its scale of 0.5
  refuses("-17758");
  r.height = [](double x, double) { return x < 0 ? 25600.0 : -25601.0; };  // bytes swapped
  refuses("-25601");
  r.height = [](double x, double) { return x < 0 ? 1737400.0 : 12.0; };  // radius and height
  refuses("1.7374e+06");
  r.height = [](double, double) { return 1700000.0; };  // a radius 37 km too small
  refuses("1.7e+06");
  r.height = [](double, double) { return -32767.0; };  // nodata that nobody declared
  refuses("-32767");
}

TEST(FuseReads, IsisSpecialPixelsAreVoids) {
  const ScratchFolder scratch;
  GDALAllRegister();
  GDALDataset* cube = GetGDALDriverManager()->GetDriverByName("ISIS3")->Create(
      (scratch / "a.cub").c_str(), 60, 60, 1, GDT_Int16, nullptr);
  ASSERT_NE(cube, nullptr);
  double gt[6] = {-300.0, 10.0, 0.0, 300.0, 0.0, -10.0};
  cube->SetGeoTransform(gt);
  OGRSpatialReference srs;
  srs.SetFromUserInput("+proj=eqc +R=1737400 +units=m");
  cube->SetSpatialRef(&srs);
  std::vector<std::int16_t> pixels(3600, 150);
  for (int i = 0; i < 5; ++i)
    pixels[static_cast<std::size_t>(60 * (20 + 4 * i) + 30)] =
        static_cast<std::int16_t>(-32768 + i);  // NULL, LRS, LIS, HIS, HRS
  EXPECT_EQ(cube->GetRasterBand(1)->RasterIO(GF_Write, 0, 0, 60, 60, pixels.data(), 60, 60,
                                             GDT_Int16, 0, 0, nullptr),
            CE_None);
  GDALClose(cube);
  FuseRequest request = site(scratch / "a.cub");
  const auto fused = fuse(request);
  ASSERT_THAT(fused, Succeeds());
  EXPECT_LT(fused->sources[0].coverage, 0.9999);
  for (const float h : fused->field.z_m.cells()) ASSERT_NEAR(h, 150.0, 0.01);
}

TEST(FuseRefuses, Cancelled) {
  const ScratchFolder scratch;
  write_planet_raster(good(), scratch / "a.tif");
  std::stop_source stop;
  stop.request_stop();
  RunContext run;
  run.stop = stop.get_token();
  EXPECT_THAT(fuse(site(scratch / "a.tif"), run), FailsWith(kCancelled));
}

TEST(Fuse, SaysNothingOnTheTerminal) {
  const ScratchFolder scratch;
  ASSERT_THAT(write_file(scratch / "text.vrt", "<VRTDataset"), Succeeds());
  ::testing::internal::CaptureStderr();
  EXPECT_FALSE(fuse(site(scratch / "text.vrt")).has_value());
  EXPECT_EQ(::testing::internal::GetCapturedStderr(), "");
}

}  // namespace
}  // namespace maquette::heightmap
