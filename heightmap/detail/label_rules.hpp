// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file label_rules.hpp
/// What the labels of PDS3, PDS4 and ISIS3 say of the map and of special pixels, and GDAL (3.6)
/// passes over.
///
/// - Latitudes may be planetographic on a map that GDAL gives a sphere (up to 0.34 degrees, 20 km,
///   on Mars).
/// - Longitudes may count westwards (GDAL minds that in PDS4 only).
/// - MAP_SCALE is rounded where MAP_RESOLUTION is exact, or the reverse: five digits are half a
///   pixel off at the edge of a global map of 92 160 columns. The one with fewer digits is exact.
/// - Projection offsets count from the first pixel's centre (LOLA: 359.5) or are a place with the
///   first pixel at 1 (MOLA MEGDR: 360.5). The latitudes and longitudes of the edges tell.
/// - A map may be turned (MAP_PROJECTION_ROTATION).
/// - Integers of 32 bits in PDS3 are read as reals.
/// - There are more special pixels than the one GDAL takes for nodata.
///
/// Sources: PDS Standards Reference 3.8, PSDD (MAP_PROJECTION_*, *_CONSTANT); ISIS cube format.

#include <filesystem>
#include <vector>

#include "core/result.hpp"

class GDALDataset;

namespace maquette::heightmap::detail {

struct LabelRules {
  /// (b/a)^2 by which tan(planetocentric) = factor tan(latitude of the map); 1: the same.
  double latitude_factor = 1.0;
  /// Degrees to be added to a longitude east before it goes to GDAL's map projection.
  double longitude_shift_deg = 0.0;
  std::vector<double> special;  ///< stored numbers that are no heights
};

/// Reads the label of `path`, as opened in `dataset`, and corrects `geotransform` by it.
/// @return the rules (of no consequence for files without such a label), or
///   HEIGHTMAP_RASTER_NOT_READABLE  PDS3 with integers of 32 bits
///   HEIGHTMAP_NO_PROJECTION  the map is turned, or has planetographic latitudes in a projection
///                            other than equirectangular, sinusoidal or on an ellipsoid
[[nodiscard]] Result<LabelRules> label_rules(const std::filesystem::path& path,
                                             const GDALDataset& dataset, double (&geotransform)[6]);

}  // namespace maquette::heightmap::detail
