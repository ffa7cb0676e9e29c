// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file lod_albedo.hpp
/// The colour of the ground, from a raster over the surface, as pictures over tiles.
///
/// Takes   what GDAL reads, one band (grey) or three (red, green, blue), and an alpha band:
///           8 or 16 bits    sRGB, as pictures have it
///           floats          reflectance, 0 to 1
///         lying on the surface in one of three ways:
///           no georeference      from edge to edge, first row in the north; as wide for its height
///                                as the site is, to a pixel
///           the model's frame    a local CRS or none, millimetres: x and y of design.tif
///           a CRS of the body    with LodPlace: brought to the plane of the place (GDAL's warper)
///         It may reach beyond the site, and has to cover it: no void, no transparent pixel.
/// Gives   sRGB of 8 bits, with no more pixels than the raster or the finest tiles' pictures have
/// Pictures of tiles are means of light, not of sRGB numbers, over what a texel covers; they lie as
///         those of normals do (lod_pictures.hpp).
/// Memory  three bytes a pixel (grey one), twice that while reading (floats: five times)

#include <cstdint>
#include <filesystem>
#include <vector>

#include "core/result.hpp"
#include "export/lod_set.hpp"

namespace maquette::exporting {

inline constexpr ErrorCode kAlbedoUnusable{"EXPORT_ALBEDO_UNUSABLE"};

/// Pixels over the field from node to node, the first in the north-western corner.
struct LodAlbedo {
  std::ptrdiff_t width = 0, height = 0;
  std::vector<std::vector<std::uint8_t>> bands;  ///< sRGB; one or three
};

/// EXPORT_ALBEDO_UNUSABLE: cannot be read, does not lie on the surface or not on all of it, or has
/// other bands or values than those above.
[[nodiscard]] Result<LodAlbedo> read_lod_albedo(const std::filesystem::path& path,
                                                const heightmap::ModelField& field,
                                                const LodSetOptions& options);

/// A tile's picture as PNG. @param texels  along its side, at most: no more than there are pixels
/// EXPORT_LIBRARY_FAILED: GDAL gave up.
[[nodiscard]] Result<std::vector<char>> albedo_picture(const LodAlbedo& albedo,
                                                       const heightmap::ModelField& field,
                                                       const LodTileMesh& tile, int texels);

}  // namespace maquette::exporting
