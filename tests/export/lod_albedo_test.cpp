// SPDX-License-Identifier: GPL-3.0-or-later

// export/lod_albedo.hpp, rasters written and pictures read by GDAL:
//   a picture without georeference ... from edge to edge: pixel by pixel where texels are as wide,
//                                      the mean of light (not of numbers) where they are wider
//   the model's frame ................ a ramp in closed form, from a raster that reaches beyond
//   a CRS of the body ................ latitude and longitude in closed form on a sphere
//   floats ........................... reflectance as sRGB in closed form; 16 bits like 8
//   the material ..................... white, so that the picture alone says the colour
//   each reason not to use it; another albedo makes tiles again

#include <cstring>
#include <fstream>
#include <functional>
#include <numbers>

#include <cpl_vsi.h>
#include <gdal.h>
#include <gtest/gtest.h>
#include <ogr_spatialref.h>
#include <nlohmann/json.hpp>

#include "export/cad.hpp"
#include "export/lod_albedo.hpp"
#include "export/lod_tileset.hpp"
#include "heightmap/model_frame.hpp"
#include "support/matchers.hpp"

namespace maquette::exporting {
namespace {

namespace fs = std::filesystem;
using heightmap::ModelField;
using nlohmann::json;
using testing_support::FailsWith;
using testing_support::ScratchFolder;
using testing_support::Succeeds;

double light_of(double number) {
  const double s = number / 255.0;
  return s <= 0.04045 ? s / 12.92 : std::pow((s + 0.055) / 1.055, 2.4);
}
double number_of(double light) {
  return 255.0 * (light <= 0.0031308 ? 12.92 * light : 1.055 * std::pow(light, 1.0 / 2.4) - 0.055);
}

/// 64 x 48 quads of half a millimetre, a little hilly, at x = -3, y = 5.
ModelField site() {
  ModelField f{Grid<float>(49, 65), Millimetres{0.5}, Millimetres{-3.0}, Millimetres{5.0}};
  for (std::ptrdiff_t r = 0; r < 49; ++r)
    for (std::ptrdiff_t c = 0; c < 65; ++c)
      f.z_mm(r, c) = static_cast<float>(std::sin(0.2 * static_cast<double>(c + 2 * r)));
  return f;
}

struct Raster {
  int cols = 64, rows = 48, bands = 3;
  GDALDataType type = GDT_Byte;
  std::string wkt = {};
  std::array<double, 6> affine = {};  ///< all 0: none
  std::optional<double> nodata = {};
};
/// @param value  of band, row from the north, column
fs::path write(const fs::path& path, const Raster& raster,
               const std::function<double(int, int, int)>& value) {
  GDALAllRegister();
  const char* driver = path.extension() == ".png" ? "PNG" : "GTiff";
  GDALDatasetH memory = GDALCreate(GDALGetDriverByName("MEM"), "", raster.cols, raster.rows,
                                   raster.bands, raster.type, nullptr);
  std::vector<double> row(static_cast<std::size_t>(raster.cols));
  for (int b = 0; b < raster.bands; ++b) {
    GDALRasterBandH band = GDALGetRasterBand(memory, b + 1);
    if (raster.nodata) GDALSetRasterNoDataValue(band, *raster.nodata);
    for (int r = 0; r < raster.rows; ++r) {
      for (int c = 0; c < raster.cols; ++c) row[static_cast<std::size_t>(c)] = value(b, r, c);
      EXPECT_EQ(GDALRasterIO(band, GF_Write, 0, r, raster.cols, 1, row.data(), raster.cols, 1,
                             GDT_Float64, 0, 0),
                CE_None);
    }
  }
  if (raster.affine[1] != 0.0) {
    auto affine = raster.affine;
    GDALSetGeoTransform(memory, affine.data());
  }
  if (!raster.wkt.empty()) GDALSetProjection(memory, raster.wkt.c_str());
  GDALClose(GDALCreateCopy(GDALGetDriverByName(driver), path.c_str(), memory, FALSE, nullptr,
                           nullptr, nullptr));
  GDALClose(memory);
  return path;
}

std::string moon_degrees(double radius_m = 1737400.0) {
  OGRSpatialReference crs;
  crs.SetGeogCS("moon", "D_moon", "moon", radius_m, 0.0, "Reference meridian", 0.0);
  char* text = nullptr;
  crs.exportToWkt(&text);
  std::string wkt = text;
  CPLFree(text);
  return wkt;
}

LodSetOptions options_with(const fs::path& albedo, int texels = 32) {
  LodSetOptions options;
  options.tile_quads = 32;
  options.texels = texels;
  options.albedo = albedo;
  options.asset.compression = LodCompression::plain;
  return options;
}

struct Tile {
  json head;
  int side = 0;
  std::vector<std::vector<std::uint8_t>> bands;
  [[nodiscard]] double at(std::size_t band, int row, int col) const {
    return bands[band][static_cast<std::size_t>(row * side + col)];
  }
};
Tile tile_of(const fs::path& folder, int depth, int x, int y) {
  const std::string bytes = read_file(folder / lod_tile_uri(depth, x, y)).value();
  std::uint32_t size = 0;
  std::memcpy(&size, bytes.data() + 12, sizeof size);
  Tile tile;
  tile.head = json::parse(bytes.substr(20, size));
  const json& use = tile.head["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"];
  const json& texture = tile.head["textures"][use["index"].get<std::size_t>()];
  const json& image = tile.head["images"][texture["source"].get<std::size_t>()];
  const json& view = tile.head["bufferViews"][image["bufferView"].get<std::size_t>()];
  std::string png = bytes.substr(28 + size).substr(view["byteOffset"], view["byteLength"]);
  VSIFCloseL(VSIFileFromMemBuffer("/vsimem/albedo.png", reinterpret_cast<GByte*>(png.data()),
                                  png.size(), FALSE));
  GDALDatasetH dataset = GDALOpen("/vsimem/albedo.png", GA_ReadOnly);
  EXPECT_NE(dataset, nullptr);
  const int n = tile.side = GDALGetRasterXSize(dataset);
  EXPECT_EQ(GDALGetRasterYSize(dataset), n);
  for (int b = 1; b <= GDALGetRasterCount(dataset); ++b) {
    tile.bands.emplace_back(static_cast<std::size_t>(n * n));
    EXPECT_EQ(GDALRasterIO(GDALGetRasterBand(dataset, b), GF_Read, 0, 0, n, n,
                           tile.bands.back().data(), n, n, GDT_Byte, 0, 0),
              CE_None);
  }
  GDALClose(dataset);
  VSIUnlink("/vsimem/albedo.png");
  return tile;
}

TEST(LodAlbedo, LiesFromEdgeToEdge) {
  const ScratchFolder scratch;
  // Numbers without a pattern that a shift or a mirror would keep.
  const auto number = [](int b, int r, int c) { return (37 * c + 101 * r + 53 * b + r * c) % 256; };
  const auto path = write(scratch / "a.png", {}, number);
  ASSERT_THAT(write_lod_set(site(), {}, options_with(path), scratch / "lod"), Succeeds());
  EXPECT_FALSE(fs::exists(scratch / "a.png.aux.xml"));
  // Depth 1: tiles of 32 quads and 32 texels, a pixel a quad. Row 0 is in the north, 48 quads up.
  for (const int x : {0, 1}) {
    const Tile tile = tile_of(scratch / "lod", 1, x, 0);
    ASSERT_EQ(tile.side, 32);
    ASSERT_EQ(tile.bands.size(), 3U);
    for (int b = 0; b < 3; ++b)
      for (int r = 0; r < 32; ++r)
        for (int c = 0; c < 32; ++c)
          ASSERT_EQ(tile.at(static_cast<std::size_t>(b), r, c), number(b, 16 + r, 32 * x + c));
  }
  // The northern tile is 16 quads high: what is below is its last row.
  const Tile north = tile_of(scratch / "lod", 1, 1, 1);
  EXPECT_EQ(north.at(1, 15, 3), number(1, 15, 35));
  const json& surface = north.head["materials"][0]["pbrMetallicRoughness"];
  EXPECT_EQ(surface["baseColorFactor"], json({1.0, 1.0, 1.0, 1.0}));
  EXPECT_TRUE(north.head["materials"][0].contains("occlusionTexture"));
  // Depth 0: texels of two by two pixels, mean of light; half a number of rounding.
  const Tile whole = tile_of(scratch / "lod", 0, 0, 0);
  ASSERT_EQ(whole.side, 32);
  for (std::size_t b = 0; b < 3; ++b)
    for (int r = 0; r < 24; ++r)
      for (int c = 0; c < 32; ++c) {
        double light = 0.0;
        for (int k = 0; k < 4; ++k)
          light += 0.25 * light_of(number(static_cast<int>(b), 2 * r + k / 2, 2 * c + k % 2));
        ASSERT_NEAR(whole.at(b, r, c), number_of(light), 0.5001) << b << " " << r << " " << c;
      }
}

TEST(LodAlbedo, LiesInTheModelsFrame) {
  const ScratchFolder scratch;
  // Reflectance that grows to the east and north, in mm of the model, from well beyond the site.
  const auto reflectance = [](double x, double y) {
    return 0.1 + 0.01 * (x + 3.0) + 0.008 * (y - 5.0);
  };
  for (const auto type : {GDT_Float32, GDT_UInt16}) {
    const Raster raster{.cols = 400,
                        .rows = 350,
                        .bands = 1,
                        .type = type,
                        .wkt = heightmap::kModelFrameWkt,
                        .affine = {-7.0, 0.1, 0.0, 35.0, 0.0, -0.1}};
    const auto path = write(scratch / "a.tif", raster, [&](int, int r, int c) {
      const double light = reflectance(-7.0 + 0.1 * (c + 0.5), 35.0 - 0.1 * (r + 0.5));
      return type == GDT_Float32 ? light : std::round(number_of(light) / 255.0 * 65535.0);
    });
    ASSERT_THAT(write_lod_set(site(), {}, options_with(path), scratch / "lod"), Succeeds());
    for (const int x : {0, 1}) {
      const Tile tile = tile_of(scratch / "lod", 1, x, 0);
      ASSERT_EQ(tile.bands.size(), 1U);
      ASSERT_EQ(tile.side, 32);
      for (int r = 0; r < 32; ++r)
        for (int c = 0; c < 32; ++c) {
          const double east = -3.0 + 16.0 * x + 0.5 * (c + 0.5),
                       north = 5.0 + 16.0 - 0.5 * (r + 0.5);
          // Rounded twice, and at the outline only what is inside counts.
          ASSERT_NEAR(tile.at(0, r, c), number_of(reflectance(east, north)), 1.2) << r << " " << c;
        }
    }
  }
}

TEST(LodAlbedo, LiesOnItsBody) {
  const ScratchFolder scratch;
  const double lat = -43.3, lon = -11.2, radius = 1737400.0, degree = std::numbers::pi / 180.0;
  // 32 x 24 m about the place; a degree is 30.3 km.
  const double step = 2e-5;  // degrees, 0.6 m
  const auto grey = [&](double la, double lo) {
    return 100.0 + 5e4 * (la - lat) + 3e4 * (lo - lon);
  };
  const Raster raster{.cols = 120,
                      .rows = 100,
                      .bands = 1,
                      .wkt = moon_degrees(),
                      .affine = {lon - 60 * step, step, 0.0, lat + 50 * step, 0.0, -step}};
  const auto path = write(scratch / "a.tif", raster, [&](int, int r, int c) {
    return std::round(grey(lat + (49.5 - r) * step, lon + (c - 59.5) * step));
  });
  LodSetOptions options = options_with(path);
  EXPECT_THAT(write_lod_set(site(), {}, options, scratch / "lod"), FailsWith(kAlbedoUnusable));
  options.place = LodPlace{*heightmap::body_by_name("moon"), lat, lon};
  ASSERT_THAT(write_lod_set(site(), {}, options, scratch / "lod"), Succeeds());
  for (const int x : {0, 1}) {
    const Tile tile = tile_of(scratch / "lod", 1, x, 0);
    for (int r = 0; r < 32; ++r)
      for (int c = 0; c < 32; ++c) {
        // Metres from the middle on the tangent plane; the sphere bends by nothing over that.
        const double east = -16.0 + 16.0 * x + 0.5 * (c + 0.5),
                     north = -12.0 + 16.0 - 0.5 * (r + 0.5);
        const double la = lat + north / radius / degree,
                     lo = lon + east / radius / std::cos(lat * degree) / degree;
        // Rounded twice; and a pixel is 1 (rows) and 0.6 (columns) numbers wide.
        ASSERT_NEAR(tile.at(0, r, c), grey(la, lo), 1.6) << r << " " << c;
      }
  }
  // Of another body nothing is known here.
  options.albedo = write(scratch / "mars.tif",
                         Raster{.cols = 120,
                                .rows = 100,
                                .bands = 1,
                                .wkt = moon_degrees(3396190.0),
                                .affine = raster.affine},
                         [](int, int, int) { return 9.0; });
  EXPECT_THAT(write_lod_set(site(), {}, options, scratch / "lod"), FailsWith(kAlbedoUnusable));
}

TEST(LodAlbedo, HasNoMoreTexelsThanPixels) {
  const ScratchFolder scratch;
  const auto path = write(scratch / "a.png", {.cols = 16, .rows = 12, .bands = 1},
                          [](int, int r, int c) { return 10 * r + c; });
  ASSERT_THAT(write_lod_set(site(), {}, options_with(path, 256), scratch / "lod"), Succeeds());
  EXPECT_EQ(tile_of(scratch / "lod", 0, 0, 0).side, 16);
  EXPECT_EQ(tile_of(scratch / "lod", 1, 0, 0).side, 8);
}

TEST(LodAlbedo, RefusesWhatCannotBe) {
  const ScratchFolder scratch;
  const auto even = [](int, int, int) { return 0.5; };
  std::vector<fs::path> bad{scratch / "nowhere.png"};
  std::ofstream(scratch / "text.png") << "no picture";
  bad.push_back(scratch / "text.png");
  bad.push_back(write(scratch / "wide.png", {.cols = 96}, even));
  bad.push_back(write(scratch / "two.tif", {.bands = 2}, even));
  bad.push_back(write(scratch / "signed.tif", {.type = GDT_Int16}, even));
  bad.push_back(write(scratch / "bright.tif", {.bands = 1, .type = GDT_Float32},
                      [](int, int r, int) { return r == 20 ? 1.5 : 0.2; }));
  bad.push_back(
      write(scratch / "elsewhere.tif", {.affine = {500.0, 0.5, 0.0, 29.0, 0.0, -0.5}}, even));
  bad.push_back(write(scratch / "half.tif", {.affine = {-3.0, 0.25, 0.0, 29.0, 0.0, -0.5}}, even));
  bad.push_back(
      write(scratch / "void.tif", {.bands = 1, .type = GDT_Float32, .nodata = -1.0},
            [](int, int r, int c) { return r > 20 && r < 25 && c > 9 && c < 15 ? -1.0 : 0.5; }));
  for (const fs::path& path : bad) {
    const auto made = write_lod_set(site(), {}, options_with(path), scratch / "lod");
    EXPECT_THAT(made, FailsWith(kAlbedoUnusable)) << path;
    if (!made) {
      EXPECT_NE(made.error().message.find(path.string()), std::string::npos);
    }
  }
  EXPECT_FALSE(fs::exists(scratch / "lod"));  // nothing is begun
  const auto good = write(scratch / "good.png", {}, [](int, int, int) { return 90.0; });
  EXPECT_THAT(write_lod_set(site(), {}, options_with(good, 0), scratch / "lod"),
              FailsWith(kOptionOutOfRange));
}

TEST(LodAlbedo, OfOtherContentMakesTilesAgain) {
  const ScratchFolder scratch;
  const fs::path path = scratch / "a.png";
  const auto kept = [&](double number) {
    write(path, {}, [&](int, int, int) { return number; });
    const auto report = write_lod_set(site(), {}, options_with(path), scratch / "lod");
    EXPECT_THAT(report, Succeeds());
    return std::count_if(report->tiles.begin(), report->tiles.end(),
                         [](const auto& t) { return t.kept; });
  };
  EXPECT_EQ(kept(90.0), 0);
  EXPECT_EQ(kept(90.0), 5);
  EXPECT_EQ(kept(91.0), 0);
}

}  // namespace
}  // namespace maquette::exporting
