// SPDX-License-Identifier: GPL-3.0-or-later

// export/heightmap_pyramid.hpp, read back by GDAL and byte by byte:
//   numbers ........................... offset + scale * number is the field's height within half a
//                                       scale at full resolution; the stated rounding is the one
//                                       found
//   PNG and RAW ....................... the same numbers, rows from the north and from the south
//   neighbours ........................ have their border's nodes in common, to the bit, each
//   level;
//                                       beyond the site the outermost height
//   errors of levels .................. against the same by hand; rise with the level
//   GeoTIFF ........................... tiled, with overviews, COG by its layout; heights to the
//   bit,
//                                       readable as a model field; on a body its own ellipsoid,
//                                       metres at full size, within the stated rounding
//   full size ......................... numbers stay, offset, scale and distances are full size's
//   engines' numbers .................. Unreal's and Unity's rules give the heights back
//   same bytes for any thread count; nothing but what is listed; each error code

#include <map>
#include <set>

#include <gdal.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <ogr_spatialref.h>
#include <tbb/global_control.h>
#include <nlohmann/json.hpp>

#include "core/files.hpp"
#include "core/random.hpp"
#include "export/cad.hpp"
#include "export/heightmap_pyramid.hpp"
#include "heightmap/field_io.hpp"
#include "support/matchers.hpp"
#include "support/terrain.hpp"

namespace maquette::exporting {
namespace {

namespace fs = std::filesystem;
using heightmap::ModelField;
using nlohmann::json;
using testing_support::FailsWith;
using testing_support::ScratchFolder;
using testing_support::Succeeds;

ModelField relief(std::ptrdiff_t rows, std::ptrdiff_t cols) {
  ModelField f{Grid<float>(rows, cols), Millimetres{0.5}, Millimetres{-7.0}, Millimetres{3.0}};
  for (std::ptrdiff_t r = 0; r < rows; ++r)
    for (std::ptrdiff_t c = 0; c < cols; ++c)
      f.z_mm(r, c) = static_cast<float>(
          7.0 * std::sin(0.05 * static_cast<double>(c)) * std::cos(0.031 * static_cast<double>(r)) +
          0.2 * random_uniform(3, static_cast<std::uint64_t>(r * cols + c)) - 2.0);
  return f;
}

struct Raster {
  std::ptrdiff_t rows = 0, cols = 0;
  GDALDataType type = GDT_Unknown;
  std::vector<double> values;  ///< rows from the north
  [[nodiscard]] double at(std::ptrdiff_t line, std::ptrdiff_t col) const {
    return values[static_cast<std::size_t>(line * cols + col)];
  }
};
Raster read_raster(const fs::path& path) {
  GDALAllRegister();
  Raster r;
  GDALDatasetH dataset = GDALOpen(path.c_str(), GA_ReadOnly);
  EXPECT_NE(dataset, nullptr) << path;
  if (dataset == nullptr) return r;
  EXPECT_EQ(GDALGetRasterCount(dataset), 1);
  const int cols = GDALGetRasterXSize(dataset), rows = GDALGetRasterYSize(dataset);
  r.rows = rows;
  r.cols = cols;
  GDALRasterBandH band = GDALGetRasterBand(dataset, 1);
  r.type = GDALGetRasterDataType(band);
  r.values.resize(static_cast<std::size_t>(r.rows * r.cols));
  EXPECT_EQ(
      GDALRasterIO(band, GF_Read, 0, 0, cols, rows, r.values.data(), cols, rows, GDT_Float64, 0, 0),
      CE_None);
  GDALClose(dataset);
  return r;
}

/// Numbers of a level put together from its tiles, rows from the south; expects the same where
/// tiles have nodes in common.
Grid<int> level_of(const fs::path& folder, const json& heights, std::size_t level) {
  const json& l = heights["levels"][level];
  const std::ptrdiff_t nodes = heights["tile_nodes"], quads = nodes - 1;
  const std::ptrdiff_t across = l["tiles"][0], up = l["tiles"][1];
  Grid<int> all(up * quads + 1, across * quads + 1, -1);
  for (std::ptrdiff_t x = 0; x < across; ++x)
    for (std::ptrdiff_t y = 0; y < up; ++y) {
      const fs::path stem =
          folder / std::to_string(l["depth"].get<int>()) / std::to_string(x) / std::to_string(y);
      const Raster png = read_raster(fs::path(stem).concat(".png"));
      EXPECT_EQ(png.type, GDT_UInt16);
      EXPECT_EQ(png.rows, nodes);
      EXPECT_EQ(png.cols, nodes);
      const std::string raw = *read_file(fs::path(stem).concat(".raw"));
      EXPECT_EQ(raw.size(), static_cast<std::size_t>(2 * nodes * nodes));
      for (std::ptrdiff_t r = 0; r < nodes; ++r)
        for (std::ptrdiff_t c = 0; c < nodes; ++c) {
          const auto byte = [&](std::ptrdiff_t i) {
            return static_cast<unsigned char>(
                raw[static_cast<std::size_t>(2 * (r * nodes + c) + i)]);
          };
          const int number = byte(0) + 256 * byte(1);
          EXPECT_EQ(png.at(nodes - 1 - r, c), number);
          int& known = all(y * quads + r, x * quads + c);
          EXPECT_TRUE(known < 0 || known == number) << "crack at level " << level;
          known = number;
        }
    }
  return all;
}

HeightmapOptions small_tiles() {
  HeightmapOptions o;
  o.tile_quads = 32;
  return o;
}

TEST(HeightmapPyramid, NumbersAreTheHeights) {
  // Parts of tiles, a level that does not end on the site's last node, one tile only.
  for (const auto& [rows, cols] :
       std::vector<std::pair<std::ptrdiff_t, std::ptrdiff_t>>{{131, 102}, {129, 65}, {20, 33}}) {
    const ModelField f = relief(rows, cols);
    const ScratchFolder scratch;
    const auto report = write_heightmaps(f, small_tiles(), scratch.path());
    ASSERT_THAT(report, Succeeds());
    const json heights = json::parse(*read_file(scratch / "heights.json"));
    const double offset = heights["offset_m"], scale = heights["scale_m"];
    const auto pyramid = LodPyramid::create(f, static_cast<int>(heights["levels"].size()));
    std::set<int> used;
    for (std::size_t level = 0; level < heights["levels"].size(); ++level) {
      const json& l = heights["levels"][level];
      const Grid<int> numbers = level_of(scratch.path(), heights, level);
      const Grid<float>& z = pyramid->heights_mm(static_cast<int>(level));
      EXPECT_EQ(l["nodes"], json({z.cols(), z.rows()}));
      double rounding = 0.0;
      for (std::ptrdiff_t r = 0; r < numbers.rows(); ++r)
        for (std::ptrdiff_t c = 0; c < numbers.cols(); ++c) {
          const double own =
              1e-3 * static_cast<double>(z(std::min(r, z.rows() - 1), std::min(c, z.cols() - 1)));
          rounding = std::max(rounding, std::fabs(offset + scale * numbers(r, c) - own));
          used.insert(numbers(r, c));
        }
      // Half a number, and doubles' rounding of 10 mm.
      EXPECT_LE(rounding, 0.5 * scale + 1e-15);
      EXPECT_NEAR(rounding, l["largest_rounding_m"].get<double>(), 1e-15);
      EXPECT_GT(rounding, 0.4 * scale);
      // By hand: bilinear at the nodes of the full resolution.
      double largest = 0.0, squares = 0.0;
      const double stride = std::ldexp(1.0, static_cast<int>(level));
      for (std::ptrdiff_t r = 0; r < rows; ++r)
        for (std::ptrdiff_t c = 0; c < cols; ++c) {
          const double y = static_cast<double>(r) / stride, x = static_cast<double>(c) / stride;
          double sum = 0.0;
          for (std::ptrdiff_t i = 0; i < 2; ++i)
            for (std::ptrdiff_t j = 0; j < 2; ++j) {
              const auto row = static_cast<std::ptrdiff_t>(y) + i,
                         col = static_cast<std::ptrdiff_t>(x) + j;
              const double w = std::max(0.0, 1.0 - std::fabs(y - static_cast<double>(row))) *
                               std::max(0.0, 1.0 - std::fabs(x - static_cast<double>(col)));
              if (w > 0.0) sum += w * (offset + scale * numbers(row, col));
            }
          const double off = std::fabs(sum - 1e-3 * static_cast<double>(f.z_mm(r, c)));
          largest = std::max(largest, off);
          squares += off * off;
        }
      EXPECT_NEAR(largest, l["largest_error_m"].get<double>(), 1e-14);
      EXPECT_NEAR(std::sqrt(squares / static_cast<double>(rows * cols)),
                  l["rms_error_m"].get<double>(), 1e-14);
      if (level > 0) {
        EXPECT_GT(l["rms_error_m"].get<double>(),
                  heights["levels"][level - 1]["rms_error_m"].get<double>());
      }
      // What the engines make of a number, by their own rules.
      const double unreal_cm = heights["unreal_z_cm"].get<double>() +
                               (1234.0 - 32768.0) / 128.0 * l["unreal_scale"][2].get<double>();
      EXPECT_NEAR(unreal_cm, 100.0 * (offset + scale * 1234.0), 1e-9);
      EXPECT_NEAR(l["unity_terrain_size_m"][1].get<double>() * 1234.0 / 65535.0, scale * 1234.0,
                  1e-12);
      EXPECT_NEAR(l["unity_terrain_size_m"][0].get<double>(), 32 * 0.5e-3 * stride, 1e-12);
      EXPECT_NEAR(l["unreal_scale"][0].get<double>(), 0.05 * stride, 1e-12);
    }
    EXPECT_EQ(heights["levels"].back()["tiles"], json({1, 1}));
    EXPECT_TRUE(used.contains(0) && used.contains(65535)) << "the range is not used";
    std::set<fs::path> there;
    for (const auto& e : fs::recursive_directory_iterator(scratch.path()))
      if (e.is_regular_file()) there.insert(e.path());
    EXPECT_EQ(there, std::set<fs::path>(report->outputs.begin(), report->outputs.end()));
    std::uint64_t bytes = 0;
    for (const fs::path& path : there) bytes += fs::file_size(path);
    EXPECT_EQ(report->bytes, bytes);
  }
}

TEST(HeightmapPyramid, GeoTiffIsCloudOptimized) {
  const ModelField f = relief(700, 600);  // more than one block of 512
  const ScratchFolder scratch;
  HeightmapOptions options;
  ASSERT_THAT(write_heightmaps(f, options, scratch.path()), Succeeds());
  const fs::path path = scratch / "heights.tif";
  GDALDatasetH dataset = GDALOpen(path.c_str(), GA_ReadOnly);
  ASSERT_NE(dataset, nullptr);
  EXPECT_STREQ(GDALGetMetadataItem(dataset, "LAYOUT", "IMAGE_STRUCTURE"), "COG");
  EXPECT_STREQ(GDALGetMetadataItem(dataset, "COMPRESSION", "IMAGE_STRUCTURE"), "DEFLATE");
  GDALRasterBandH band = GDALGetRasterBand(dataset, 1);
  EXPECT_GE(GDALGetOverviewCount(band), 1);
  int wide = 0, high = 0;
  GDALGetBlockSize(band, &wide, &high);
  EXPECT_EQ(wide, 512);
  EXPECT_EQ(high, 512);
  GDALClose(dataset);
  const auto again = heightmap::read_model_field(path);
  ASSERT_THAT(again, Succeeds());
  EXPECT_EQ(again->z_mm, f.z_mm);  // to the bit
  EXPECT_NEAR(again->x0.value(), -7.0, 1e-9);
  EXPECT_NEAR(again->y0.value(), 3.0, 1e-9);
  EXPECT_NEAR(again->spacing.value(), 0.5, 1e-12);

  // On Mars, heights three times too high.
  constexpr double kHigh = 1000.0 / 3.0;
  options.place = LodPlace{*heightmap::body_by_name("mars"), -5.4, 137.8, 0.0, 3.0};
  const auto report = write_heightmaps(f, options, scratch / "body");
  ASSERT_THAT(report, Succeeds());
  const Raster full = read_raster(scratch / "body/heights.tif");
  double rounding = 0.0;
  for (std::ptrdiff_t r = 0; r < 700; ++r)
    for (std::ptrdiff_t c = 0; c < 600; ++c)
      rounding = std::max(rounding, std::fabs(full.at(699 - r, c) -
                                              kHigh * 1e-3 * static_cast<double>(f.z_mm(r, c))));
  EXPECT_LT(rounding, 4e-7);  // half a bit of a float below 8 m
  EXPECT_GT(rounding, 0.0);
  EXPECT_EQ(rounding, report->geotiff_rounding_m);
  dataset = GDALOpen((scratch / "body/heights.tif").c_str(), GA_ReadOnly);
  ASSERT_NE(dataset, nullptr);
  EXPECT_STREQ(GDALGetRasterUnitType(GDALGetRasterBand(dataset, 1)), "m");
  std::array<double, 6> corner{};
  GDALGetGeoTransform(dataset, corner.data());
  EXPECT_NEAR(corner[1], 0.5, 1e-12);
  EXPECT_NEAR(corner[0], -0.5 * 599 * 0.5 - 0.25, 1e-9);
  EXPECT_NEAR(corner[3], 0.5 * 699 * 0.5 + 0.25, 1e-9);
  const OGRSpatialReference frame = *OGRSpatialReference::FromHandle(GDALGetSpatialRef(dataset));
  EXPECT_TRUE(frame.IsProjected());
  EXPECT_NEAR(frame.GetSemiMajor(), 3396190.0, 1e-6);
  EXPECT_NEAR(frame.GetSemiMinor(), 3376200.0, 1e-2);
  EXPECT_STREQ(frame.GetAttrValue("PROJECTION"), SRS_PT_ORTHOGRAPHIC);
  // Geodetic, of planetocentric -5.4: tan(-5.4 deg) * (a / b)^2.
  EXPECT_NEAR(frame.GetProjParm(SRS_PP_LATITUDE_OF_ORIGIN), -5.463749, 1e-5);
  EXPECT_NEAR(frame.GetProjParm(SRS_PP_CENTRAL_MERIDIAN), 137.8, 1e-9);
  GDALClose(dataset);

  // Of the tiles only what is said about them changes.
  const json small = json::parse(*read_file(scratch / "heights.json"));
  const json large = json::parse(*read_file(scratch / "body/heights.json"));
  EXPECT_EQ(*read_file(scratch / "0/0/0.raw"), *read_file(scratch / "body/0/0/0.raw"));
  EXPECT_NEAR(large["scale_m"].get<double>(), kHigh * small["scale_m"].get<double>(), 1e-12);
  EXPECT_NEAR(large["offset_m"].get<double>(), kHigh * small["offset_m"].get<double>(), 1e-9);
  EXPECT_NEAR(large["levels"][1]["spacing_m"].get<double>(), 1.0, 1e-12);
  EXPECT_NEAR(large["levels"][1]["largest_error_m"].get<double>(),
              kHigh * small["levels"][1]["largest_error_m"].get<double>(), 1e-9);
}

TEST(HeightmapPyramid, IsTheSameForAnyThreads) {
  const ModelField f = relief(131, 102);
  const ScratchFolder one, many;
  {
    const tbb::global_control single(tbb::global_control::max_allowed_parallelism, 1);
    ASSERT_THAT(write_heightmaps(f, small_tiles(), one.path()), Succeeds());
  }
  const auto report = write_heightmaps(f, small_tiles(), many.path());
  ASSERT_THAT(report, Succeeds());
  for (const fs::path& path : report->outputs)
    EXPECT_EQ(*sha256_file(path), *sha256_file(one.path() / fs::relative(path, many.path())))
        << path;
}

TEST(HeightmapPyramid, AFlatSurfaceIsNumberZero) {
  const ModelField f{Grid<float>(40, 40, 2.5F), Millimetres{0.5}, {}, {}};
  const ScratchFolder scratch;
  const auto report = write_heightmaps(f, small_tiles(), scratch.path());
  ASSERT_THAT(report, Succeeds());
  EXPECT_EQ(report->offset_m, 2.5e-3);
  EXPECT_GT(report->scale_m, 0.0);
  EXPECT_EQ(report->levels[0].largest_m, 0.0);
  EXPECT_EQ(*read_file(scratch / "0/0/0.raw"), std::string(2 * 33 * 33, '\0'));
}

TEST(HeightmapPyramid, RefusesWhatCannotBe) {
  const ScratchFolder scratch;
  ModelField f = relief(40, 40);
  HeightmapOptions options = small_tiles();
  for (const std::ptrdiff_t quads : {0, 8, 33, 1000, 8192}) {
    options.tile_quads = quads;
    EXPECT_THAT(write_heightmaps(f, options, scratch / "out"), FailsWith(kOptionOutOfRange));
  }
  options = small_tiles();
  options.place = LodPlace{*heightmap::body_by_name("moon"), 91.0, 0.0, 0.0, 1.0};
  EXPECT_THAT(write_heightmaps(f, options, scratch / "out"), FailsWith(kOptionOutOfRange));
  EXPECT_FALSE(fs::exists(scratch / "out"));
  EXPECT_THAT(write_heightmaps(f, small_tiles(), "/proc/nowhere"), FailsWith(kFileNotWritable));
  std::stop_source stop;
  RunContext run;
  run.stop = stop.get_token();
  stop.request_stop();
  EXPECT_THAT(write_heightmaps(f, small_tiles(), scratch / "stopped", run), FailsWith(kCancelled));
  EXPECT_FALSE(fs::exists(scratch / "stopped/heights.json"));
  f.z_mm(3, 4) = NAN;
  EXPECT_THAT(write_heightmaps(f, small_tiles(), scratch / "out"), FailsWith(kHeightNotFinite));
}

}  // namespace
}  // namespace maquette::exporting
