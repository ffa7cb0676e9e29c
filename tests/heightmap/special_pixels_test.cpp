// SPDX-License-Identifier: GPL-3.0-or-later

// Claims of heightmap/dem_reader.hpp about pixels that are no heights, and how each is attacked
//   each format's own are voids    all five of ISIS in each type, PDS3 and PDS4 constants; NaN

#include <bit>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/files.hpp"
#include "heightmap/fuse.hpp"
#include "support/map_place.hpp"
#include "support/matchers.hpp"
#include "support/pds3_file.hpp"

namespace maquette::heightmap {
namespace {

namespace fs = std::filesystem;
using namespace testing_support;

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

}  // namespace
}  // namespace maquette::heightmap
