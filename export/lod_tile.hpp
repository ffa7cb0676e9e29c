// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file lod_tile.hpp
/// One tile of one level as a mesh on the set's lattice, and how far it is from the full surface.
///
/// The lattice. All vertices of all tiles of all levels have whole numbers for coordinates: column
/// and row of the field's node times `steps_per_quad`, and the height in the same step, rounded.
/// One frame for the whole set: a vertex that two tiles have in common has the same three numbers
/// in both, before a tile's own origin, a whole number too, is taken away.
///
/// Why no crack, T-junction or overlap can be between tiles of ANY two levels. A tile of level l
/// covers a rectangle of the field's nodes. Inside, it has the nodes of its level. Along each side
/// behind which the site goes on it has EVERY node of the field, with the field's own height, not
/// the level's. So whatever the levels of two neighbours, both have on what they share of that
/// side the same vertices, all nodes of the field that lie there, joined in the same order. Seen
/// from above, a tile's triangles have positive area and fill its rectangle; the rectangles of a
/// cut through the quadtree fill the site without overlap. Hence the whole is one graph of a
/// height. On the outline of the site, where no neighbour is, the nodes of the level suffice.
/// Cost: 2^l more vertices on inner sides of level l, but half as many such sides from level to
/// level: on 4097 x 4097 nodes with tiles of 256 quads less than 1 % of all triangles.
///
/// Normals along a shared side are those of the tile's level, so that neighbours of one level shade
/// alike on it and no row of finer normals shows; between levels shading changes as detail does.
///
/// Triangles. Cells are cut from lower left to upper right as everywhere. A cell that touches a
/// shared side is cut in fans from its corners that do not lie on it.

#include <array>
#include <cstdint>
#include <vector>

#include "core/vec.hpp"
#include "export/draco_piece.hpp"
#include "export/lod_pyramid.hpp"

namespace maquette::exporting {

struct LodLattice {
  double step_mm = 0.0;             ///< of all three coordinates
  std::int32_t steps_per_quad = 1;  ///< so that the field's spacing is a whole number of steps
  std::ptrdiff_t tile_quads = 256;  ///< edge of a tile in quads of its level; >= 2
};

struct LodTileKey {
  int level = 0;                ///< 0: full resolution
  std::ptrdiff_t x = 0, y = 0;  ///< counted from the south-western corner
};

struct LodVertex {
  std::int32_t col = 0, row = 0;  ///< the field's node
  std::int32_t height = 0;        ///< steps above the model's z = 0
  std::array<float, 2> slope{};   ///< dz/dx, dz/dy of the full resolution, for the normal
};

struct LodTileMesh {
  LodTileKey key;
  std::vector<std::ptrdiff_t> cols, rows;  ///< the field's nodes that the tile's cells lie between
  std::vector<LodVertex> vertices;
  std::vector<std::array<std::uint32_t, 3>> triangles;  ///< counter-clockwise from above
  /// Triangles of cell (r, c) are those from [r * (cols.size() - 1) + c] to the next entry.
  std::vector<std::uint32_t> first_of_cell;
};

/// Tiles of a level along a side of `nodes` nodes.
[[nodiscard]] std::ptrdiff_t lod_tiles(std::ptrdiff_t nodes, const LodLattice& lattice, int level);
/// Levels until one tile holds the site.
[[nodiscard]] int lod_levels(const heightmap::ModelField& field, std::ptrdiff_t tile_quads);

/// @pre the tile exists and heights in steps fit 31 bits
[[nodiscard]] LodTileMesh make_lod_tile(const LodPyramid& pyramid, const LodLattice& lattice,
                                        LodTileKey key);

/// Distance of a tile, as its whole-number coordinates say, to the field's surface over it.
struct LodTileError {
  /// Largest vertical distance. Exact: both surfaces are plane between the nodes of the field and
  /// where their edges cross, and all of these are looked at.
  double vertical_mm = 0.0;
  double rms_mm = 0.0;  ///< vertical, over the field's nodes (a shared side counts once)
  /// Hausdorff distance between the points of both surfaces above the field's nodes and the other
  /// surface; that of the surfaces themselves lies between this and `vertical_mm`.
  double hausdorff_mm = 0.0;
};
[[nodiscard]] LodTileError measure_lod_tile(const heightmap::ModelField& field,
                                            const LodLattice& lattice, const LodTileMesh& tile);

}  // namespace maquette::exporting
