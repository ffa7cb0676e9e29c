// SPDX-License-Identifier: GPL-3.0-or-later
#include "heightmap/field_io.hpp"

#include <cmath>
#include <cstdint>
#include <cstdio>
#include <optional>
#include <string>
#include <string_view>

#include <cpl_string.h>
#include <cpl_vsi.h>
#include <fmt/format.h>
#include <ogr_spatialref.h>

#include "core/files.hpp"
#include "heightmap/detail/gdal_support.hpp"

namespace maquette::heightmap {
namespace {

constexpr const char* kModelFrame =
    "LOCAL_CS[\"maquette model frame\",UNIT[\"millimetre\",0.001],AXIS[\"x\",EAST],"
    "AXIS[\"y\",NORTH]]";
// The geotransform speaks of corners; adding and taking off half a pixel may lose the last bit.
constexpr const char* kFrameItem = "MAQUETTE_X0_Y0_SPACING_MM";

bool is_millimetre(std::string_view unit) {
  return unit == "mm" || unit == "millimetre" || unit == "millimeter" || unit == "millimetres" ||
         unit == "millimeters";
}

Result<void> check_unit(GDALDataset& dataset, const std::string& name) {
  const std::string band_unit = dataset.GetRasterBand(1)->GetUnitType();
  if (!band_unit.empty() && !is_millimetre(band_unit))
    return fail(kRasterUnit,
                fmt::format("{}: heights are in '{}', a model field is in mm; make one from a "
                            "planet raster with `maquette fuse`",
                            name, band_unit));
  const OGRSpatialReference* srs = dataset.GetSpatialRef();
  if (srs == nullptr || srs->IsEmpty()) return {};
  if (srs->IsGeographic() || srs->IsGeocentric())
    return fail(kRasterUnit,
                fmt::format("{}: coordinates are degrees on a planet, a model field is in mm; make "
                            "one with `maquette fuse`",
                            name));
  // A program that keeps no units of local frames: the band has the last word.
  if (srs->IsLocal() && !band_unit.empty()) return {};
  const double metres = srs->GetLinearUnits();
  if (std::abs(metres - 0.001) > 1e-9)
    return fail(
        kRasterUnit,
        fmt::format("{}: coordinates are in units of {} m, a model field is in mm; make one "
                    "from a planet raster with `maquette fuse`",
                    name, metres));
  return {};
}

struct Frame {
  double x0_mm = 0.0, y0_mm = 0.0, spacing_mm = 1.0;
};

Result<Frame> read_frame(GDALDataset& dataset, const std::string& name) {
  const int cols = dataset.GetRasterXSize();
  const int rows = dataset.GetRasterYSize();
  if (dataset.GetRasterCount() != 1)
    return fail(kRasterShape, fmt::format("{}: has {} bands, a height field has one", name,
                                          dataset.GetRasterCount()));
  if (cols < 2 || rows < 2)
    return fail(kRasterShape,
                fmt::format("{}: is {} x {} nodes, at least 2 x 2 are needed", name, cols, rows));
  double gt[6] = {};
  if (dataset.GetGeoTransform(gt) != CE_None)
    return fail(kRasterShape,
                fmt::format("{}: has no geotransform, so the node spacing is unknown", name));
  if (gt[2] != 0.0 || gt[4] != 0.0 || !(gt[1] > 0.0) || !(gt[5] < 0.0))
    return fail(kRasterShape, fmt::format("{}: must be north up and not rotated; its geotransform "
                                          "is {} {} {} {} {} {}",
                                          name, gt[0], gt[1], gt[2], gt[3], gt[4], gt[5]));
  if (std::abs(gt[1] + gt[5]) > 1e-6 * gt[1])
    return fail(kRasterShape,
                fmt::format("{}: pixels must be square, they are {} x {}", name, gt[1], -gt[5]));
  Frame frame{gt[0] + 0.5 * gt[1], gt[3] + (rows - 0.5) * gt[5], gt[1]};
  if (const char* item = dataset.GetMetadataItem(kFrameItem)) {
    Frame exact;
    if (std::sscanf(item, "%lf %lf %lf", &exact.x0_mm, &exact.y0_mm, &exact.spacing_mm) == 3) {
      // Only if no other program has cropped or moved the raster since.
      const double tolerance = 1e-6 * frame.spacing_mm;
      if (std::abs(exact.x0_mm - frame.x0_mm) < tolerance &&
          std::abs(exact.y0_mm - frame.y0_mm) < tolerance &&
          std::abs(exact.spacing_mm - frame.spacing_mm) * std::max(rows, cols) < tolerance)
        frame = exact;
    }
  }
  return frame;
}

Result<Grid<float>> read_heights(GDALDataset& dataset, const std::string& name) {
  GDALRasterBand& band = *dataset.GetRasterBand(1);
  const int cols = dataset.GetRasterXSize();
  const int rows = dataset.GetRasterYSize();
  int has_nodata = 0, has_scale = 0, has_offset = 0;
  const double nodata = band.GetNoDataValue(&has_nodata);
  const double scale = band.GetScale(&has_scale);
  const double offset = band.GetOffset(&has_offset);
  const bool raw = (has_scale == 0 || scale == 1.0) && (has_offset == 0 || offset == 0.0);
  Grid<float> z(rows, cols);
  const detail::ErrorCapture capture;
  for (int line = 0; line < rows; ++line) {
    const auto row = z.row(rows - 1 - line);  // files are north up
    if (band.RasterIO(GF_Read, 0, line, cols, 1, row.data(), cols, 1, GDT_Float32, 0, 0, nullptr) !=
        CE_None)
      return fail(kRasterNotReadable, fmt::format("{}: cannot read line {} of {}: {}", name, line,
                                                  rows, capture.text()));
    for (float& h : row) {
      if (std::isnan(h)) continue;  // keeps the bits
      if (!std::isfinite(h) || (has_nodata != 0 && h == static_cast<float>(nodata)))
        h = NAN;
      else if (!raw)
        h = static_cast<float>((has_scale != 0 ? scale : 1.0) * h +
                               (has_offset != 0 ? offset : 0.0));
    }
  }
  return z;
}

/// A file in GDAL's memory file system that disappears with the object.
class MemoryFile {
 public:
  MemoryFile() : name_(fmt::format("/vsimem/maquette-{}.tif", static_cast<const void*>(this))) {}
  MemoryFile(const MemoryFile&) = delete;
  MemoryFile& operator=(const MemoryFile&) = delete;
  ~MemoryFile() {
    VSIUnlink(name_.c_str());
    VSIUnlink((name_ + ".aux.xml").c_str());
  }
  [[nodiscard]] const std::string& name() const { return name_; }

 private:
  std::string name_;
};

}  // namespace

Result<ModelField> read_model_field(const std::filesystem::path& path) {
  const std::string name = path.string();
  MAQUETTE_TRY(const detail::DatasetPtr dataset, detail::open_raster(path));
  MAQUETTE_TRY_VOID(check_unit(*dataset, name));
  MAQUETTE_TRY(const Frame frame, read_frame(*dataset, name));
  MAQUETTE_TRY(Grid<float> z, read_heights(*dataset, name));
  if (std::isnan(height_range(z).min))
    return fail(kAllVoid, fmt::format("{}: has no height, only voids", name));
  return ModelField{std::move(z), Millimetres{frame.spacing_mm}, Millimetres{frame.x0_mm},
                    Millimetres{frame.y0_mm}};
}

Result<void> write_model_grid(const Grid<float>& values, const ModelField& like, const char* unit,
                              const std::filesystem::path& path) {
  MAQUETTE_CHECK(values.rows() == like.z_mm.rows() && values.cols() == like.z_mm.cols(),
                 "grid {} x {}, field {} x {}", values.rows(), values.cols(), like.z_mm.rows(),
                 like.z_mm.cols());
  MAQUETTE_CHECK(values.rows() >= 2 && values.cols() >= 2 && like.spacing.value() > 0.0,
                 "{} x {} nodes, spacing {}", values.rows(), values.cols(), like.spacing.value());
  MAQUETTE_TRY(AtomicFile file, AtomicFile::create(path));
  detail::register_gdal_drivers();
  const detail::ErrorCapture capture;
  const auto failed = [&] {
    return fail(kFileNotWritable, fmt::format("{}: {}", path.string(), capture.text()));
  };
  // Written in memory first: one place (AtomicFile) knows about full disks and renaming.
  const MemoryFile memory;
  const int cols = static_cast<int>(values.cols());
  const int rows = static_cast<int>(values.rows());
  GDALDriver* driver = GetGDALDriverManager()->GetDriverByName("GTiff");
  CPLStringList options;
  options.SetNameValue("BIGTIFF", "IF_SAFER");
  detail::DatasetPtr dataset(
      driver->Create(memory.name().c_str(), cols, rows, 1, GDT_Float32, options.List()));
  if (!dataset) return failed();
  const double s = like.spacing.value();
  double gt[6] = {like.x0.value() - 0.5 * s, s, 0.0, like.y0.value() + (rows - 0.5) * s, 0.0, -s};
  OGRSpatialReference frame;
  frame.importFromWkt(kModelFrame);
  dataset->SetMetadataItem(GDALMD_AREA_OR_POINT, GDALMD_AOP_POINT);
  dataset->SetGeoTransform(gt);
  dataset->SetSpatialRef(&frame);
  dataset->SetMetadataItem(
      kFrameItem,
      fmt::format("{:.17g} {:.17g} {:.17g}", like.x0.value(), like.y0.value(), s).c_str());
  GDALRasterBand& band = *dataset->GetRasterBand(1);
  band.SetNoDataValue(NAN);
  band.SetUnitType(unit);
  for (int line = 0; line < rows; ++line) {
    auto* row = const_cast<float*>(values.row(rows - 1 - line).data());  // GDAL only reads it
    if (band.RasterIO(GF_Write, 0, line, cols, 1, row, cols, 1, GDT_Float32, 0, 0, nullptr) !=
        CE_None)
      return failed();
  }
  dataset.reset();
  if (capture.failed()) return failed();
  vsi_l_offset bytes = 0;
  const GByte* data = VSIGetMemFileBuffer(memory.name().c_str(), &bytes, FALSE);
  if (data == nullptr) return failed();
  file.write(data, static_cast<std::size_t>(bytes));
  return file.commit();
}

Result<void> write_model_field(const ModelField& field, const std::filesystem::path& path) {
  return write_model_grid(field.z_mm, field, "mm", path);
}

}  // namespace maquette::heightmap
