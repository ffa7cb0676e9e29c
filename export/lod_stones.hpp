// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file lod_stones.hpp
/// Stones in their poses as one glTF: each distinct shape once. A shape that lies in several places
/// is one node with EXT_mesh_gpu_instancing, one that lies in one place a node of its own; `extras`
/// of a node has the numbers of its stones, in order. Merged (LodAssetOptions::merge_stones) they
/// are one mesh in which `_FEATURE_ID_0` of a vertex (EXT_mesh_features) says which of these
/// numbers is its stone's: more bytes, one draw call, and no extension that an engine must have.

#include <span>

#include "export/lod_asset.hpp"
#include "meshing/stones.hpp"

namespace maquette::exporting {

/// Metres of the content, y up, relative to `corner_mm` (x, y) and the model's z = 0; normals
/// smooth. What is not at model size hangs from one node that has the content's scale.
/// @pre at least one stone
[[nodiscard]] GlbContent encode_stones(std::span<const meshing::PlacedStone> stones, Vec3 corner_mm,
                                       const LodAssetOptions& options,
                                       LodContentScale content = {});

/// Of the stones, in the tileset's frame (metres, z up).
[[nodiscard]] Box3 stones_box(std::span<const meshing::PlacedStone> stones, Vec3 corner_mm,
                              LodContentScale content = {});

}  // namespace maquette::exporting
