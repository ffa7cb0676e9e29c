// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file lod_asset.hpp
/// One tile as a glTF 2.0 binary in memory.
///
/// Positions are whole numbers of the set's lattice from the tile's own origin (north-western
/// corner, lowest height); the node's scale is the lattice's step in metres (of the content: at
/// model size, or full size where LodContentScale says so), its translation that origin. So a
/// vertex that two tiles share is step * (the same whole number) in both, and floats
/// hold all coordinates exactly (below 2^24). y is up, x east, z south.
///
///   draco    KHR_draco_mesh_compression, quantised on the lattice itself: decoding gives back the
///            whole numbers, nothing is rounded once more. Inside, x is up, and the node turns
///            that; normals are rounded from what Draco predicts (draco_normals.hpp), on the
///            outline from zero, so that neighbours of one level have the same there
///   meshopt  EXT_meshopt_compression with KHR_mesh_quantization: positions in 16 bits (in floats
///            where the tile is wider), normals octahedral in 8 bits; triangles in an order that
///            vertex caches like
///   plain    floats and 32 bit indices
///
/// With pictures (lod_pictures.hpp) the material has them as normalTexture, occlusionTexture and
/// baseColorTexture, and texture coordinates are whole numbers of the field's nodes over the
/// picture's side (in 16 bits of it for meshopt). Where there is a picture of normals the vertices'
/// are upright, with tangents to the east.

#include <string>
#include <string_view>
#include <vector>

#include "core/result.hpp"
#include "export/lod_pictures.hpp"
#include "export/lod_tile.hpp"

namespace maquette::exporting {

enum class LodCompression { draco, meshopt, plain };
[[nodiscard]] std::string_view name(LodCompression compression);

/// What the ground is made of, as glTF's metallic-roughness model has it.
enum class LodMaterial { paint, regolith, foil };
[[nodiscard]] std::string_view name(LodMaterial material);

struct LodAssetOptions {
  LodCompression compression = LodCompression::draco;
  LodMaterial material = LodMaterial::paint;
  bool normals = true;
  int normal_bits = 7;                ///< of draco, octahedral (draco_normals.hpp)
  double scale_denominator = 1000.0;  ///< recorded
  bool merge_stones = false;          ///< one mesh instead of instances (lod_stones.hpp)
};

/// Metres of the content for a metre of the model: 1 at model size; 1000 for the full size of a
/// model 1:1000, and upwards less by its exaggeration.
struct LodContentScale {
  double horizontal = 1.0, vertical = 1.0;
};

struct GlbContent {
  std::string json;
  std::vector<char> binary;  ///< a multiple of four bytes
};

/// The material as a JSON object.
[[nodiscard]] std::string material_json(LodMaterial material);

/// @param pictures  null: none; @pre with pictures `options.normals`
/// EXPORT_LIBRARY_FAILED: Draco or meshoptimizer gave up.
[[nodiscard]] Result<GlbContent> encode_lod_tile(const LodTileMesh& tile, const LodLattice& lattice,
                                                 const LodTileError& error,
                                                 const LodAssetOptions& options,
                                                 LodContentScale content = {},
                                                 const LodPictures* pictures = nullptr);

}  // namespace maquette::exporting
