// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file lod_pictures.hpp
/// What a tile's triangles do not show, as pictures over it: normals of the full surface at the
/// places of texels, for tiles that are coarser than that; and how much of an even light the ground
/// gets (sky_view.hpp), for all. Colours of the ground lie the same way (lod_albedo.hpp).
///
/// A picture covers a square from the tile's north-western corner, as wide as the tile's longer
/// side; where the tile ends before, its last values go on. Its first row is in the north. Normals
/// are in the frame of texture coordinates, x east and y north, about the vertical: with a picture
/// of normals, the tile's own are all upright, so that the picture alone says where a place faces,
/// and tiles of any two levels agree on what they share up to the finer one's detail.

#include <vector>

#include "core/result.hpp"
#include "export/lod_tile.hpp"

namespace maquette::exporting {

/// What a tile's picture covers, in nodes of the field.
struct PictureSquare {
  double north = 0.0, south = 0.0, west = 0.0, east = 0.0;  ///< of the tile
  double side = 0.0;                                        ///< of the square
};
[[nodiscard]] PictureSquare picture_square(const LodTileMesh& tile);

struct LodPictures {
  std::vector<char> normal_png;     ///< empty at full resolution
  std::vector<char> occlusion_png;  ///< one band
  std::vector<char> colour_png;     ///< albedo_picture() (lod_albedo.hpp); empty: none
};

/// Light at nodes of every second row and column (pyramid level 1; level 0 if there is no other).
[[nodiscard]] Grid<float> lod_occlusion(const LodPyramid& pyramid);

/// @param texels  along the picture's side; of light no more than it has nodes there
/// @param occlusion  lod_occlusion()
/// EXPORT_LIBRARY_FAILED: GDAL gave up.
[[nodiscard]] Result<LodPictures> make_lod_pictures(const LodPyramid& pyramid,
                                                    const Grid<float>& occlusion,
                                                    const LodTileMesh& tile, int texels);

}  // namespace maquette::exporting
