// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file heightmap_pyramid.hpp
/// A surface as heightmaps that game engines load, in levels, and as one Cloud-Optimized GeoTIFF.
///
/// Takes   ModelField, millimetres, no voids
/// Gives   DEPTH/X/Y.png   16 bit, rows from the north (as Unreal reads them); depth 0 is one
///                         tile of everything, X and Y count from the south-western corner
///         DEPTH/X/Y.raw   the same numbers, 16 bit little endian, rows from the south (as Unity
///                         reads them)
///         heights.tif     heights as float32, tiled, with overviews (GDAL's COG driver): in the
///                         model frame and mm as the model's own files, or with a place on a body
///                         in metres at full size on the orthographic projection about it
///         heights.json    what a number is in metres, errors, and what to type into the engines
/// Numbers height = offset + scale * number; offset and scale are one pair for all tiles of all
///         levels, and 0 and 65535 are the lowest and the highest of them. So the rounding error is
///         at most half of `scale`: height range / 131070. It is measured, and so is each level's
///         whole error at the nodes of the full resolution, between nodes as bilinear interpolation
///         has it (engines cut each square into two triangles, which differ from that by up to a
///         quarter of the square's twist).
/// Tiles   have 2^n + 1 nodes a side. Neighbours of one level have the nodes between them in
///         common, the same numbers: no crack. (Between levels an engine does what it does.) Nodes
///         keep their distance; what lies beyond the site repeats its outermost height.
/// Levels  as lod_pyramid.hpp has them. Where the site does not end on a node of a level, that
///         level's last node stands beyond the outline and has the outline's height.
/// Work    tiles in parallel, each file whole or not at all, heights.json last. Same bytes for any
///         number of threads.
/// Memory  heights once more as 16 bit, and once as the float raster; one tile a thread
///
/// Unreal Engine, "Landscape Technical Guide": a height is (number - 32768) / 128 times the
/// landscape's z scale, in cm. Unity manual, "Working with heightmaps": 2^n + 1 samples a side.

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "core/run_context.hpp"
#include "export/lod_set.hpp"

namespace maquette::exporting {

struct HeightmapOptions {
  std::ptrdiff_t tile_quads = 512;  ///< a power of two, 16 to 4096; a tile has one node more a side
  LodFilter filter = LodFilter::smooth;
  double scale_denominator = 1000.0;
  std::optional<LodPlace> place;  ///< full size instead of the model's
};

struct HeightmapLevel {
  std::array<std::ptrdiff_t, 2> tiles{};  ///< to the east, to the north
  std::array<std::ptrdiff_t, 2> nodes{};  ///< that have a height of the site
  double spacing_m = 0.0;
  double rounding_m = 0.0;  ///< largest, of the level's own heights
  double largest_m = 0.0;   ///< from the full resolution, at its nodes
  double rms_m = 0.0;
};

struct HeightmapReport {
  double offset_m = 0.0, scale_m = 0.0;  ///< height = offset + scale * number
  double geotiff_rounding_m = 0.0;       ///< largest; 0 at model size, where floats are the field's
  std::vector<HeightmapLevel> levels;    ///< 0: full resolution
  std::uint64_t bytes = 0;
  std::vector<std::filesystem::path> outputs;
};

/// Writes into `folder`, which is made. EXPORT_OPTION_OUT_OF_RANGE; EXPORT_HEIGHT_NOT_FINITE;
/// EXPORT_LIBRARY_FAILED with what GDAL says; CORE_FILE_NOT_WRITABLE, CORE_DISK_FULL;
/// CORE_CANCELLED.
[[nodiscard]] Result<HeightmapReport> write_heightmaps(const heightmap::ModelField& field,
                                                       const HeightmapOptions& options,
                                                       const std::filesystem::path& folder,
                                                       const RunContext& run = {});

/// heights.json
[[nodiscard]] std::string to_json(const HeightmapReport& report, const HeightmapOptions& options);

}  // namespace maquette::exporting
