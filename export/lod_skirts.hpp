// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file lod_skirts.hpp
/// Walls that hang from a tile's rim along each side behind which the site goes on, for engines
/// that move vertices (morphing, coarser floats) and could tear open what meets here
/// (lod_tile.hpp). The outline of the site gets none.
///
/// A wall looks outwards, has the rim's vertices above and the same ones `depth` lower below, with
/// the rim's slopes and places in pictures, so that what is seen of it is shaded as the ground is.
/// What a tile is without skirts stays as it is, vertices and triangles first.

#include "export/lod_tile.hpp"

namespace maquette::exporting {

/// @param depth  steps; > 0
void add_skirts(LodTileMesh& tile, const heightmap::ModelField& field, std::int32_t depth);

/// How deep skirts of a level have to be: the largest errors of the level and of the next coarser
/// one together, rounded up, and a step: both surfaces lie within theirs of the full one, so none
/// of a neighbour of these levels is lower than the skirt's foot.
/// @param coarser  of the coarsest level its own
[[nodiscard]] std::int32_t skirt_depth(const LodTileError& own, const LodTileError& coarser,
                                       const LodLattice& lattice);

}  // namespace maquette::exporting
