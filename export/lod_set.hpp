// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file lod_set.hpp
/// A surface as a set of tiles in levels of detail that engines stream: 3D Tiles 1.1 of glTF.
///
/// Takes   ModelField, millimetres, no voids; stones in their poses
/// Gives   tiles/DEPTH/X/Y.glb     depth 0 is the coarsest, X and Y from the south-western corner
///         tileset.json            explicit: each tile with its box and its measured error
///         tileset_implicit.json   the same tiles as an implicit quadtree,
///         subtrees/DEPTH/X/Y.subtree
///         stones/DEPTH/X/Y.glb    stones in levels of detail (lod_stones.hpp)
///         lod.json                lattice, errors (of the model, mm) and bytes by level; of each
///                                 tile
/// Frame   of a tileset: metres at model size, x east, y north, z up, origin at the field's
///         south-western node and the model's z = 0 (glTF inside is y up, as 3D Tiles asks). With a
///         place on a body everything is in metres at full size, and the root's transform, which
///         turns and moves but does not scale, carries that to the body's fixed frame. (Were the
///         scale in the transform, geometricError would have to be read scaled by it, as 3D Tiles
///         1.1 has it, "tile transforms": CesiumJS does that, 3d-tiles-renderer does not.)
/// Errors  geometricError of a tile is not less than the vertical distance of what a decoder gets
///         to the full surface, measured everywhere (lod_tile.hpp), and not less than any child's.
///         With implicit tiling it halves from level to level, so the root's is as large as that
///         takes; subtrees say each tile's own (TILE_GEOMETRIC_ERROR, TILE_BOUNDING_BOX) to those
///         who read metadata, as CesiumJS does.
/// Skirts  only if asked for. Errors are those of the surface without them; tiles are then made
///         and measured twice, first to know how deep skirts have to be.
/// Boxes   contain content and children, and are a step larger on each side.
/// Work    tiles in parallel, each file whole or not at all. A run that was stopped goes on: tiles
///         of the same heights, options and version are kept if they are as long as their header
///         says. Same bytes for any number of threads.
/// Memory  a third of the heights more, and one tile a thread; with pictures half the heights more.
///
/// 3D Tiles 1.1, OGC 22-025r4; body other than Earth: extension 3DTILES_ellipsoid.

#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/run_context.hpp"
#include "export/lod_asset.hpp"
#include "export/lod_stones.hpp"
#include "heightmap/body.hpp"
#include "meshing/stones.hpp"

namespace maquette::exporting {

/// Where the field's middle is.
struct LodPlace {
  heightmap::Body body;
  double latitude_deg = 0.0;   ///< planetocentric, north positive
  double longitude_deg = 0.0;  ///< east positive
  double height_m = 0.0;       ///< of the model's z = 0 above the ellipsoid
  double exaggeration = 1.0;   ///< vertical, of the model; taken back
};

struct LodSetOptions {
  /// Of the position grid over the whole set, 8 to 22: 2^bits - 1 steps hold its longest side.
  int position_bits = 16;
  std::ptrdiff_t tile_quads = 256;  ///< edge of a tile, 16 to 1024
  LodFilter filter = LodFilter::smooth;
  LodAssetOptions asset;
  bool skirts = false;  ///< lod_skirts.hpp
  int texels = 0;  ///< along the side of a tile's pictures (lod_pictures.hpp), 0: none; to 4096
  std::optional<std::filesystem::path> albedo;  ///< a raster over the surface (lod_albedo.hpp)
  std::optional<Millimetres> max_error;         ///< that the finest level must keep
  std::optional<LodPlace> place;
};

struct LodTileReport {
  LodTileKey key;
  std::uint64_t triangles = 0, vertices = 0, bytes = 0;
  LodTileError error;
  std::int32_t lowest = 0, highest = 0;  ///< steps, skirt included
  std::int32_t skirt = 0;                ///< its depth in steps; 0: none
  bool kept = false;                     ///< was there from an earlier run
};

struct LodLevelReport {
  std::uint64_t tiles = 0, triangles = 0, bytes = 0;
  LodTileError error;     ///< the largest, and the root of the mean square
  double skirt_mm = 0.0;  ///< depth
};

struct LodSetReport {
  LodLattice lattice;
  std::vector<LodLevelReport> levels;  ///< 0: full resolution
  std::vector<LodTileReport> tiles;    ///< coarsest first
  std::vector<LodStones> stones;       ///< coarsest first
  std::vector<std::filesystem::path> outputs;
};

/// The lattice of a field. EXPORT_QUANTISATION_TOO_COARSE: a step above a quarter of the spacing,
/// or half of one above `max_error`, with the bits that would do; EXPORT_OPTION_OUT_OF_RANGE.
[[nodiscard]] Result<LodLattice> lod_lattice(const heightmap::ModelField& field,
                                             const LodSetOptions& options);

/// Writes the set into `folder`, which is made. EXPORT_HEIGHT_NOT_FINITE; EXPORT_LIBRARY_FAILED;
/// EXPORT_ALBEDO_UNUSABLE; CORE_FILE_NOT_WRITABLE, CORE_DISK_FULL; CORE_CANCELLED (tiles that are
/// done stay); and lod_lattice's.
[[nodiscard]] Result<LodSetReport> write_lod_set(const heightmap::ModelField& field,
                                                 std::span<const meshing::PlacedStone> stones,
                                                 const LodSetOptions& options,
                                                 const std::filesystem::path& folder,
                                                 const RunContext& run = {});

/// 1 without a place; with one what makes the model as large as what it shows.
[[nodiscard]] LodContentScale content_scale(const std::optional<LodPlace>& place,
                                            double scale_denominator);
[[nodiscard]] LodContentScale content_scale(const LodSetOptions& options);
/// EXPORT_OPTION_OUT_OF_RANGE: a latitude, an exaggeration or a scale that cannot be.
[[nodiscard]] Result<void> check_place(const std::optional<LodPlace>& place,
                                       double scale_denominator);

/// lod.json
[[nodiscard]] std::string to_json(const LodSetReport& report, const LodSetOptions& options,
                                  const heightmap::ModelField& field);

}  // namespace maquette::exporting
