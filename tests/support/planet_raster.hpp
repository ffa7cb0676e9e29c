// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file planet_raster.hpp
/// Small planet rasters of analytic surfaces, written with GDAL, and where the real
/// ones are. Needs LIBS GDAL::GDAL.

#include <cstdlib>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include <gdal_priv.h>
#include <gtest/gtest.h>
#include <ogr_spatialref.h>

namespace maquette::testing_support {

/// A GeoTIFF to write; the height function gets the map coordinates of pixel centres.
struct PlanetRaster {
  std::string projection = "+proj=eqc +lat_ts=0 +lon_0=0 +R=1737400 +units=m +no_defs";
  double west = 0.0, north = 0.0, pixel = 10.0;  ///< outer corner and side, map units
  int cols = 64, rows = 64;
  std::function<double(double x, double y)> height = [](double, double) { return 0.0; };
  GDALDataType type = GDT_Float32;
  double scale = 1.0, offset = 0.0;  ///< height = scale * stored + offset
  std::string unit;
  bool has_nodata = false;
  double nodata = 0.0;
  bool point = false;  ///< AREA_OR_POINT=Point
};

inline void write_planet_raster(const PlanetRaster& raster, const std::filesystem::path& path) {
  GDALAllRegister();
  GDALDriver* driver = GetGDALDriverManager()->GetDriverByName("GTiff");
  const std::unique_ptr<GDALDataset, void (*)(GDALDataset*)> dataset(
      driver->Create(path.string().c_str(), raster.cols, raster.rows, 1, raster.type, nullptr),
      [](GDALDataset* d) { GDALClose(d); });
  ASSERT_NE(dataset, nullptr);
  if (raster.point) dataset->SetMetadataItem(GDALMD_AREA_OR_POINT, GDALMD_AOP_POINT);
  double gt[6] = {raster.west, raster.pixel, 0.0, raster.north, 0.0, -raster.pixel};
  dataset->SetGeoTransform(gt);
  if (!raster.projection.empty()) {
    OGRSpatialReference srs;
    ASSERT_EQ(srs.SetFromUserInput(raster.projection.c_str()), OGRERR_NONE);
    srs.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
    dataset->SetSpatialRef(&srs);
  }
  GDALRasterBand& band = *dataset->GetRasterBand(1);
  if (raster.has_nodata) band.SetNoDataValue(raster.nodata);
  if (raster.scale != 1.0) band.SetScale(raster.scale);
  if (raster.offset != 0.0) band.SetOffset(raster.offset);
  if (!raster.unit.empty()) band.SetUnitType(raster.unit.c_str());
  std::vector<double> line(static_cast<std::size_t>(raster.cols));
  for (int r = 0; r < raster.rows; ++r) {
    for (int c = 0; c < raster.cols; ++c)
      line[static_cast<std::size_t>(c)] = (raster.height(raster.west + (c + 0.5) * raster.pixel,
                                                         raster.north - (r + 0.5) * raster.pixel) -
                                           raster.offset) /
                                          raster.scale;
    ASSERT_EQ(band.RasterIO(GF_Write, 0, r, raster.cols, 1, line.data(), raster.cols, 1,
                            GDT_Float64, 0, 0, nullptr),
              CE_None);
  }
}

}  // namespace maquette::testing_support
