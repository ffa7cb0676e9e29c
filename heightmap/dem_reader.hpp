// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file dem_reader.hpp
/// One elevation product of a planet: where a point of the body lies in its pixels,
/// and the heights of a window of pixels. Its .cpp is the only place that knows GDAL
/// for planet rasters.
///
/// Pixel coordinates are GDAL's: pixel (i, j) covers [i, i + 1) x [j, j + 1), so its
/// centre is (i + 0.5, j + 0.5), whatever AREA_OR_POINT says (GDAL has already moved
/// the geotransform of a "Point" GeoTIFF by half a pixel).
///
/// Scale and offset are applied here: GDAL only reports them. A product that holds
/// radii (LOLA: offset 1737400) becomes heights above the body's equatorial radius;
/// SiteFrame::radius_deficit_m brings them to the ellipsoid.

#include <filesystem>
#include <memory>
#include <span>
#include <string>

#include "core/grid.hpp"
#include "core/result.hpp"
#include "core/run_context.hpp"
#include "heightmap/body.hpp"
#include "heightmap/fuse.hpp"

namespace maquette::heightmap {

/// Heights of a rectangle of pixels, each the mean of step_u x step_v pixels of the file.
struct PixelWindow {
  Grid<float> height_m;        ///< row 0 is the file's upper row; void NaN
  double u0 = 0.0, v0 = 0.0;   ///< pixel coordinates of the upper left corner
  int step_u = 1, step_v = 1;  ///< pixels of the file per cell
  bool radii = false;          ///< values were radii; now above the equatorial radius
};

/// Half-open rectangle of pixels. Columns of a product that runs around the body may
/// be negative or beyond the last: they wrap.
struct PixelRectangle {
  long u_begin = 0, v_begin = 0, u_end = 0, v_end = 0;
};

/// Degrees east and planetocentric north.
struct GeoBox {
  double south = 0.0, north = 0.0, west = 0.0, east = 0.0;
};

class DemReader {
 public:
  /// Opens and checks everything that needs no pixels.
  /// @return the reader, or CORE_FILE_NOT_FOUND, HEIGHTMAP_RASTER_NOT_READABLE,
  ///         HEIGHTMAP_NO_PROJECTION, HEIGHTMAP_WRONG_BODY, HEIGHTMAP_SOURCE_UNIT
  [[nodiscard]] static Result<DemReader> open(const Source& source, const Body& body);
  /// The same for an image: values are brightness in any unit, and stay as the file has them after
  /// scale and offset.
  [[nodiscard]] static Result<DemReader> open_image(const std::filesystem::path& path,
                                                    const std::string& name, const Body& body);
  DemReader(DemReader&&) noexcept;
  ~DemReader();

  [[nodiscard]] long cols() const;
  [[nodiscard]] long rows() const;
  [[nodiscard]] bool wraps() const;  ///< columns close around the body
  [[nodiscard]] GeoBox extent() const;
  [[nodiscard]] const std::string& name() const;

  /// Longitudes are brought to the branch that is continuous around this point.
  void centre_on(double latitude_deg, double longitude_deg);

  /// Planetocentric degrees -> pixel coordinates; NaN where the map projection has no
  /// answer. Thread-safe.
  void to_pixels(std::span<const double> latitude_deg, std::span<const double> longitude_deg,
                 std::span<double> u, std::span<double> v) const;

  /// Reads a window; pixels beyond an edge that does not wrap repeat the edge, so that
  /// interpolation works up to the raster's border.
  /// @return the window, or HEIGHTMAP_RASTER_NOT_READABLE, HEIGHTMAP_IMPLAUSIBLE_HEIGHT,
  ///         CORE_CANCELLED
  [[nodiscard]] Result<PixelWindow> read(const PixelRectangle& rectangle, int step_u, int step_v,
                                         const RunContext& run) const;

 private:
  struct State;
  explicit DemReader(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace maquette::heightmap
