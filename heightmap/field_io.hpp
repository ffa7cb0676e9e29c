// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file field_io.hpp
/// Height field files of the model frame: float32 GeoTIFF, local engineering CRS
/// in millimetres, north up, band unit "mm", voids NaN (also declared as nodata).
/// Written with AREA_OR_POINT=Point; both conventions are read (GDAL's transform
/// speaks of pixel corners either way, so node = corner + half a pixel).

#include <filesystem>
#include <memory>
#include <span>
#include <vector>

#include "core/result.hpp"
#include "core/vec.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::heightmap {

inline constexpr ErrorCode kRasterNotReadable{"HEIGHTMAP_RASTER_NOT_READABLE"};
inline constexpr ErrorCode kRasterUnit{"HEIGHTMAP_RASTER_UNIT"};
inline constexpr ErrorCode kRasterShape{"HEIGHTMAP_RASTER_SHAPE"};
inline constexpr ErrorCode kAllVoid{"HEIGHTMAP_ALL_VOID"};

/// Reads a model field.
/// @return the field, or
///   CORE_FILE_NOT_FOUND             no such file
///   HEIGHTMAP_RASTER_NOT_READABLE   GDAL cannot open it or it is truncated; says what GDAL said
///   HEIGHTMAP_RASTER_SHAPE          rotated or non-square pixels, fewer than 2 x 2 nodes,
///                                   more than one band
///   HEIGHTMAP_RASTER_UNIT           band unit or CRS unit is present and is not mm
///                                   (a planet raster: says to run `maquette fuse`)
///   HEIGHTMAP_ALL_VOID              no finite height
[[nodiscard]] Result<ModelField> read_model_field(const std::filesystem::path& path);

/// The same of a grid of any unit in the model frame, as write_model_grid leaves it; z_mm is then
/// in that unit.
[[nodiscard]] Result<ModelField> read_model_grid(const std::filesystem::path& path);

/// Heights of the triangulated surface of a field file at many places (their z does not matter),
/// without holding the field; NaN where height_at gives it.
/// @return one height a place, in order; read_model_field's errors
[[nodiscard]] Result<std::vector<double>> heights_at(const std::filesystem::path& path,
                                                     std::span<const Vec3> places_mm);

/// Writes a field row by row without holding it, whole or not at all. Same heights, same bytes
/// as write_model_field.
class ModelFieldWriter {
 public:
  struct Shape {
    std::ptrdiff_t rows, cols;
    Millimetres spacing, x0, y0;
  };
  /// @pre at least 2 x 2 nodes, spacing > 0
  /// @return the open file; CORE_FILE_NOT_WRITABLE; CORE_DISK_FULL if there is less space
  ///         than the heights need
  [[nodiscard]] static Result<ModelFieldWriter> create(const std::filesystem::path& path,
                                                       const Shape& shape, const char* unit = "mm");
  ModelFieldWriter(ModelFieldWriter&&) noexcept;
  ModelFieldWriter& operator=(ModelFieldWriter&&) noexcept;
  ~ModelFieldWriter();  ///< without commit() nothing is left

  /// The northernmost row first, as in the file. @pre not more often than there are rows
  [[nodiscard]] Result<void> write_row(std::span<const float> heights_mm);
  /// @pre all rows are written
  [[nodiscard]] Result<void> commit();

 private:
  struct State;
  explicit ModelFieldWriter(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

/// Writes the field whole or not at all. Same field, same bytes.
[[nodiscard]] Result<void> write_model_field(const ModelField& field,
                                             const std::filesystem::path& path);

/// Writes any grid on the nodes of `like` (uncertainty, source mask, deviation)
/// in the same frame; `unit` goes to the band.
[[nodiscard]] Result<void> write_model_grid(const Grid<float>& values, const ModelField& like,
                                            const char* unit, const std::filesystem::path& path);

}  // namespace maquette::heightmap
