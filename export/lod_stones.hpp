// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file lod_stones.hpp
/// Stones in their poses as glTF, in levels of detail that go with the ground's.
///
/// A file holds the stones of one cell of the ground's quadtree, each distinct shape once. A shape
/// that lies in several places is one node with EXT_mesh_gpu_instancing, one that lies in one place
/// a node of its own; `extras` of a node has the numbers of its stones, in order. Merged
/// (LodAssetOptions::merge_stones) they are one mesh in which `_FEATURE_ID_0` of a vertex
/// (EXT_mesh_features) says which of these numbers is its stone's: more bytes, one draw call, and
/// no extension that an engine must have.
///
/// Levels. Rocks are subdivided icosahedra (assets/rocks.hpp): four triangles become the one that
/// they were, and its corners are vertices of the finer mesh still. So any point of either surface
/// has one of the other on the same triangle, and these are nowhere farther apart than at vertices:
/// that largest distance bounds the Hausdorff distance, both ways. Stones of imported shape stay as
/// they are.

#include <span>

#include "export/lod_asset.hpp"
#include "meshing/stones.hpp"

namespace maquette::exporting {

/// Stones of one cell in one level of detail.
struct LodStones {
  int depth = 0;                ///< of the ground's tiles that they go with
  int cells = 0;                ///< 2^this cells are a side of the quadtree's square
  std::ptrdiff_t x = 0, y = 0;  ///< cell, from the south-western corner
  int coarser = 0;              ///< how many times four triangles have become one
  std::vector<meshing::PlacedStone> stones;
  Box3 box;               ///< metres, the tileset's frame
  double error_mm = 0.0;  ///< bound of the Hausdorff distance, of the model
  std::uint64_t triangles = 0, bytes = 0;
};

/// Relative to tileset.json.
[[nodiscard]] std::string lod_stones_uri(const LodStones& stones);

/// Which stones go together, coarsest first; boxes, errors and sizes are not known yet. Cells are
/// as small as leaves eight stones to one, and shapes that lie in many cells not too often stored.
/// @param deepest   depth of the ground's finest level
/// @param width_mm  of the quadtree's square
/// @param corner_mm its south-western corner (x, y)
[[nodiscard]] std::vector<LodStones> divide_stones(std::span<const meshing::PlacedStone> stones,
                                                   int deepest, double width_mm, Vec3 corner_mm);

/// Metres of the content, y up, relative to `corner_mm` (x, y) and the model's z = 0; normals
/// smooth. What is not at model size hangs from one node that has the content's scale. Sets the
/// error, the box and the count of triangles.
/// @pre at least one stone
[[nodiscard]] GlbContent encode_stones(LodStones& stones, Vec3 corner_mm,
                                       const LodAssetOptions& options,
                                       LodContentScale content = {});

}  // namespace maquette::exporting
