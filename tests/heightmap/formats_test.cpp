// SPDX-License-Identifier: GPL-3.0-or-later

// Claims of heightmap/fuse.hpp and dem_reader.hpp about files that GDAL can write (PDS3:
// pds3_label_test.cpp; special_pixels_test.cpp), and how each is attacked
//   a height stands where its pixel's centre is, whatever   an analytic planet written in each
//     the format, to 0.01 pixel                               format; the oracle is vector algebra
//   ISIS3 and PDS4 labels: planetographic latitudes,        words of a label exchanged, and the map
//     longitudes that count westwards                         that they then stand for
//   scale and offset                                        stored as numbers far from metres
//   cut short                                               every format refused, or said by GDAL

#include <filesystem>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/files.hpp"
#include "heightmap/field_io.hpp"
#include "heightmap/fuse.hpp"
#include "support/map_place.hpp"
#include "support/matchers.hpp"

namespace maquette::heightmap {
namespace {

namespace fs = std::filesystem;
using namespace testing_support;

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

// ---- words of labels

struct Word {
  std::string is, becomes;
};
struct LabelCase {
  const char* name;
  const char* driver;
  std::string drawn;    ///< map that the label then stands for
  std::string written;  ///< map that GDAL writes down
  std::vector<Word> words;
  double latitude, longitude;
  Body body;
};
class Labels : public ::testing::TestWithParam<LabelCase> {};

const std::string kSphere = "+proj=eqc +R=3396190 +units=m",
                  kEllipsoid = "+proj=eqc +a=3396190 +b=3376200 +units=m",
                  kWest = "+proj=eqc +lon_0=-30 +R=1737400 +units=m";
const Word kIsisPole{"PolarRadius          = 3396190.0", "PolarRadius          = 3376200.0"},
    kIsisGraphic{"= Planetocentric", "= Planetographic"},
    kPds4Pole{"<cart:c_axis_radius unit=\"m\">3396190<", "<cart:c_axis_radius unit=\"m\">3376200<"},
    kPds4Graphic{">Planetocentric<", ">Planetographic<"};

// y / R of an equirectangular map is the latitude that the label speaks of: 40 degrees of the one
// kind are 0.34 degrees, 20 km, from 40 of the other.
INSTANTIATE_TEST_SUITE_P(
    Words, Labels,
    ::testing::Values(
        LabelCase{"isis_planetocentric", "ISIS3", kSphere, kSphere, {kIsisPole}, 40, 10, kMars},
        LabelCase{"isis_planetographic",
                  "ISIS3",
                  kEllipsoid,
                  kSphere,
                  {kIsisPole, kIsisGraphic},
                  40,
                  10,
                  kMars},
        LabelCase{
            "isis_south", "ISIS3", kEllipsoid, kSphere, {kIsisPole, kIsisGraphic}, -50, 250, kMars},
        LabelCase{"pds4_planetocentric", "PDS4", kSphere, kSphere, {kPds4Pole}, 40, 10, kMars},
        LabelCase{"pds4_planetographic",
                  "PDS4",
                  kEllipsoid,
                  kSphere,
                  {kPds4Pole, kPds4Graphic},
                  40,
                  10,
                  kMars},
        // 30 degrees west is 330 east; columns still run eastwards.
        LabelCase{"isis_west",
                  "ISIS3",
                  kWest,
                  kWest,
                  {{"= PositiveEast", "= PositiveWest"},
                   {"CenterLongitude      = -30.0", "CenterLongitude      = 30.0"}},
                  3,
                  331,
                  kMoon},
        LabelCase{"pds4_west",
                  "PDS4",
                  kWest,
                  kWest,
                  {{">Positive East<", ">Positive West<"},
                   {"longitude_of_central_meridian unit=\"deg\">-30<",
                    "longitude_of_central_meridian unit=\"deg\">30<"}},
                  3,
                  331,
                  kMoon}),
    [](const auto& one) { return std::string(one.param.name); });

TEST_P(Labels, SayWherePixelsStand) {
  const LabelCase& l = GetParam();
  const ScratchFolder scratch;
  const Place place{l.body, l.latitude, l.longitude, l.drawn};
  PlanetRaster raster = raster_of(place);
  raster.projection = l.written;  // same pixels, same metres of the map
  write_planet_raster(raster, scratch / "plain.tif");
  const bool isis = std::string(l.driver) == "ISIS3";
  const fs::path label = scratch / (isis ? "a.lbl" : "a.xml");
  copy_as(l.driver, scratch / "plain.tif", label,
          isis ? std::vector<const char*>{"DATA_LOCATION=EXTERNAL"} : std::vector<const char*>{});
  auto text = read_file(label);
  ASSERT_THAT(text, Succeeds());
  for (const Word& w : l.words) {
    const auto at = text->find(w.is);
    ASSERT_NE(at, std::string::npos) << w.is << " in\n" << *text;
    text->replace(at, w.is.size(), w.becomes);
  }
  ASSERT_THAT(write_file(label, *text), Succeeds());
  expect_in_place(place, label);
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
