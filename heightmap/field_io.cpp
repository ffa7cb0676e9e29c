// SPDX-License-Identifier: GPL-3.0-or-later
#include "heightmap/field_io.hpp"

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <optional>
#include <string>
#include <string_view>

#include <cpl_string.h>
#include <fmt/format.h>
#include <ogr_spatialref.h>

#include "core/files.hpp"
#include "heightmap/detail/gdal_support.hpp"
#include "heightmap/grid_frame.hpp"
#include "heightmap/model_frame.hpp"

namespace maquette::heightmap {
namespace {

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

/// Reads lines of heights as they are meant: voids NaN, scale and offset applied.
class HeightLines {
 public:
  HeightLines(GDALDataset& dataset, std::string name)
      : band_(*dataset.GetRasterBand(1)),
        cols_(dataset.GetRasterXSize()),
        rows_(dataset.GetRasterYSize()),
        name_(std::move(name)) {
    nodata_ = band_.GetNoDataValue(&has_nodata_);
    int has_scale = 0, has_offset = 0;
    const double scale = band_.GetScale(&has_scale), offset = band_.GetOffset(&has_offset);
    scale_ = has_scale != 0 ? scale : 1.0;
    offset_ = has_offset != 0 ? offset : 0.0;
  }
  /// @param r  from the south
  Result<void> read(std::ptrdiff_t r, std::span<float> row) {
    const detail::ErrorCapture capture;
    const int line = rows_ - 1 - static_cast<int>(r);  // files are north up
    if (band_.RasterIO(GF_Read, 0, line, cols_, 1, row.data(), cols_, 1, GDT_Float32, 0, 0,
                       nullptr) != CE_None)
      return fail(kRasterNotReadable, fmt::format("{}: cannot read line {} of {}: {}", name_, line,
                                                  rows_, capture.text()));
    const bool raw = scale_ == 1.0 && offset_ == 0.0;
    for (float& h : row) {
      if (std::isnan(h)) continue;  // keeps the bits
      if (!std::isfinite(h) || (has_nodata_ != 0 && h == static_cast<float>(nodata_)))
        h = NAN;
      else if (!raw)
        h = static_cast<float>(scale_ * h + offset_);
    }
    return {};
  }

 private:
  GDALRasterBand& band_;
  int cols_, rows_;
  std::string name_;
  int has_nodata_ = 0;
  double nodata_ = 0.0, scale_ = 1.0, offset_ = 0.0;
};

Result<Grid<float>> read_heights(GDALDataset& dataset, const std::string& name) {
  Grid<float> z(dataset.GetRasterYSize(), dataset.GetRasterXSize());
  HeightLines lines(dataset, name);
  for (std::ptrdiff_t r = z.rows() - 1; r >= 0; --r) MAQUETTE_TRY_VOID(lines.read(r, z.row(r)));
  return z;
}

Result<ModelField> read_whole(GDALDataset& dataset, const std::string& name) {
  MAQUETTE_TRY(const Frame frame, read_frame(dataset, name));
  MAQUETTE_TRY(Grid<float> z, read_heights(dataset, name));
  if (std::isnan(height_range(z).min))
    return fail(kAllVoid, fmt::format("{}: has no height, only voids", name));
  return ModelField{std::move(z), Millimetres{frame.spacing_mm}, Millimetres{frame.x0_mm},
                    Millimetres{frame.y0_mm}};
}

}  // namespace

Result<ModelField> read_model_field(const std::filesystem::path& path) {
  MAQUETTE_TRY(const detail::DatasetPtr dataset, detail::open_raster(path));
  MAQUETTE_TRY_VOID(check_unit(*dataset, path.string()));
  return read_whole(*dataset, path.string());
}

Result<ModelField> read_model_grid(const std::filesystem::path& path) {
  MAQUETTE_TRY(const detail::DatasetPtr dataset, detail::open_raster(path));
  return read_whole(*dataset, path.string());
}

Result<GridFrame> read_grid_frame(const std::filesystem::path& path) {
  MAQUETTE_TRY(const detail::DatasetPtr dataset, detail::open_raster(path));
  MAQUETTE_TRY(const Frame frame, read_frame(*dataset, path.string()));
  return GridFrame{dataset->GetRasterYSize(),     dataset->GetRasterXSize(),
                   Millimetres{frame.spacing_mm}, Millimetres{frame.x0_mm},
                   Millimetres{frame.y0_mm},      dataset->GetRasterBand(1)->GetUnitType()};
}

Result<std::vector<double>> heights_at(const std::filesystem::path& path,
                                       std::span<const Vec3> places_mm) {
  const std::string name = path.string();
  MAQUETTE_TRY(const detail::DatasetPtr dataset, detail::open_raster(path));
  MAQUETTE_TRY_VOID(check_unit(*dataset, name));
  MAQUETTE_TRY(const Frame frame, read_frame(*dataset, name));
  const std::ptrdiff_t rows = dataset->GetRasterYSize(), cols = dataset->GetRasterXSize();
  // Places by the row of cells they are in, two rows of nodes at a time.
  const auto row_of = [&](const Vec3& p) {
    const double r = std::floor((p.y - frame.y0_mm) / frame.spacing_mm);
    return static_cast<std::size_t>(std::clamp(r, 0.0, static_cast<double>(rows - 2)));
  };
  std::vector<std::size_t> start(static_cast<std::size_t>(rows), 0), order(places_mm.size());
  for (const Vec3& p : places_mm) ++start[row_of(p) + 1];
  for (std::size_t i = 1; i < start.size(); ++i) start[i] += start[i - 1];
  std::vector<std::size_t> next = start;
  for (std::size_t i = 0; i < places_mm.size(); ++i) order[next[row_of(places_mm[i])]++] = i;

  std::vector<double> heights(places_mm.size(), NAN);
  HeightLines lines(*dataset, name);
  ModelField two{Grid<float>(2, cols), Millimetres{frame.spacing_mm}, Millimetres{frame.x0_mm},
                 Millimetres{0.0}};
  std::ptrdiff_t held = -1;  // the row of nodes in two.z_mm.row(0)
  for (std::ptrdiff_t r = rows - 2; r >= 0; --r) {
    const auto i0 = start[static_cast<std::size_t>(r)], i1 = start[static_cast<std::size_t>(r) + 1];
    if (i0 == i1) continue;
    if (held == r + 1)
      std::ranges::copy(two.z_mm.row(0), two.z_mm.row(1).begin());
    else
      MAQUETTE_TRY_VOID(lines.read(r + 1, two.z_mm.row(1)));
    MAQUETTE_TRY_VOID(lines.read(r, two.z_mm.row(0)));
    held = r;
    two.y0 = Millimetres{frame.y0_mm + frame.spacing_mm * static_cast<double>(r)};
    for (std::size_t i = i0; i < i1; ++i)
      heights[order[i]] = height_at(two, places_mm[order[i]].x, places_mm[order[i]].y);
  }
  return heights;
}

struct ModelFieldWriter::State {
  State(const std::filesystem::path& path, const Shape& of) : file(path), name(path), shape(of) {}
  AtomicPath file;
  std::filesystem::path name;
  Shape shape;
  detail::DatasetPtr dataset;
  std::ptrdiff_t written = 0;

  [[nodiscard]] tl::unexpected<Error> failed(const detail::ErrorCapture& capture) const {
    return fail(kFileNotWritable, fmt::format("{}: {}", name.string(), capture.text()));
  }
};

ModelFieldWriter::ModelFieldWriter(std::unique_ptr<State> state) : state_(std::move(state)) {}
ModelFieldWriter::ModelFieldWriter(ModelFieldWriter&&) noexcept = default;
ModelFieldWriter& ModelFieldWriter::operator=(ModelFieldWriter&&) noexcept = default;
ModelFieldWriter::~ModelFieldWriter() = default;

Result<ModelFieldWriter> ModelFieldWriter::create(const std::filesystem::path& path,
                                                  const Shape& shape, const char* unit) {
  MAQUETTE_CHECK(shape.rows >= 2 && shape.cols >= 2 && shape.spacing.value() > 0.0,
                 "{} x {} nodes, spacing {}", shape.rows, shape.cols, shape.spacing.value());
  auto state = std::make_unique<State>(path, shape);
  MAQUETTE_TRY_VOID(state->file.prepare());
  // GDAL is vague about full disks, so they are asked for beforehand.
  std::error_code ec;
  const auto space = std::filesystem::space(state->file.path(), ec);
  const auto bytes = 4 * static_cast<std::uintmax_t>(shape.rows * shape.cols);
  if (!ec && space.available < bytes) return tl::unexpected(write_error(path, ENOSPC));
  detail::register_gdal_drivers();
  const detail::ErrorCapture capture;
  GDALDriver* driver = GetGDALDriverManager()->GetDriverByName("GTiff");
  CPLStringList options;
  options.SetNameValue("BIGTIFF", "IF_SAFER");
  const int cols = static_cast<int>(shape.cols), rows = static_cast<int>(shape.rows);
  state->dataset.reset(
      driver->Create(state->file.path().c_str(), cols, rows, 1, GDT_Float32, options.List()));
  if (!state->dataset) return state->failed(capture);
  GDALDataset& dataset = *state->dataset;
  const double s = shape.spacing.value(), x0 = shape.x0.value(), y0 = shape.y0.value();
  double gt[6] = {x0 - 0.5 * s, s, 0.0, y0 + (rows - 0.5) * s, 0.0, -s};
  OGRSpatialReference frame;
  frame.importFromWkt(kModelFrameWkt);
  dataset.SetMetadataItem(GDALMD_AREA_OR_POINT, GDALMD_AOP_POINT);
  dataset.SetGeoTransform(gt);
  dataset.SetSpatialRef(&frame);
  dataset.SetMetadataItem(kFrameItem, fmt::format("{:.17g} {:.17g} {:.17g}", x0, y0, s).c_str());
  GDALRasterBand& band = *dataset.GetRasterBand(1);
  band.SetNoDataValue(NAN);
  band.SetUnitType(unit);
  if (capture.failed()) return state->failed(capture);
  return ModelFieldWriter(std::move(state));
}

Result<void> ModelFieldWriter::write_row(std::span<const float> heights_mm) {
  State& s = *state_;
  MAQUETTE_CHECK(
      s.written < s.shape.rows && heights_mm.size() == static_cast<std::size_t>(s.shape.cols),
      "row {} of {}, {} of {} heights", s.written, s.shape.rows, heights_mm.size(), s.shape.cols);
  const detail::ErrorCapture capture;
  const int cols = static_cast<int>(s.shape.cols);
  auto* row = const_cast<float*>(heights_mm.data());  // GDAL only reads it
  if (s.dataset->GetRasterBand(1)->RasterIO(GF_Write, 0, static_cast<int>(s.written), cols, 1, row,
                                            cols, 1, GDT_Float32, 0, 0, nullptr) != CE_None)
    return s.failed(capture);
  // GDAL would keep a twentieth of the machine's memory.
  constexpr std::ptrdiff_t kRowsHeld = 512;
  if (++s.written % kRowsHeld == 0) s.dataset->FlushCache();
  if (capture.failed()) return s.failed(capture);
  return {};
}

Result<void> ModelFieldWriter::commit() {
  State& s = *state_;
  MAQUETTE_CHECK(s.written == s.shape.rows, "{} of {} rows are written", s.written, s.shape.rows);
  const detail::ErrorCapture capture;
  s.dataset.reset();
  if (capture.failed()) return s.failed(capture);
  return s.file.commit();
}

Result<void> write_model_grid(const Grid<float>& values, const ModelField& like, const char* unit,
                              const std::filesystem::path& path) {
  MAQUETTE_CHECK(values.rows() == like.z_mm.rows() && values.cols() == like.z_mm.cols(),
                 "grid {} x {}, field {} x {}", values.rows(), values.cols(), like.z_mm.rows(),
                 like.z_mm.cols());
  MAQUETTE_TRY(auto writer,
               ModelFieldWriter::create(
                   path, {values.rows(), values.cols(), like.spacing, like.x0, like.y0}, unit));
  for (std::ptrdiff_t r = values.rows() - 1; r >= 0; --r)
    MAQUETTE_TRY_VOID(writer.write_row(values.row(r)));
  return writer.commit();
}

Result<void> write_model_field(const ModelField& field, const std::filesystem::path& path) {
  return write_model_grid(field.z_mm, field, "mm", path);
}

}  // namespace maquette::heightmap
