// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file tiles.hpp
/// A surface in tiles with joints that no stone stands on.
///
/// Takes   ModelField; the stones' poses; how wide (x) and long (y) a tile may be
/// Gives   windows of nodes (grid_stream.hpp makes their solids)
///
/// The surface is cut into strips across y, each strip across x by itself, so that its joints need
/// to avoid its own stones only (like bricks). Of all cuts along rows or columns of nodes that keep
/// the width and avoid the stones the fewest are taken, and of those the most even ones (least sum
/// of squares), by dynamic programming.

#include <span>
#include <vector>

#include "core/result.hpp"
#include "heightmap/height_field.hpp"
#include "meshing/bands.hpp"
#include "meshing/grid_stream.hpp"
#include "meshing/stones.hpp"

namespace maquette::meshing {

inline constexpr ErrorCode kJointMeetsStones{"MESHING_JOINT_MEETS_STONES"};

struct Tile {
  int number = 0;            ///< 1, 2, ... from south to north, in a strip from west to east
  int strip = 0, place = 0;  ///< which strip from the south, which tile of it from the west; from 1
  NodeWindow nodes;          ///< neighbours share their border nodes
};

struct TileOptions {
  Millimetres max_width{INFINITY};   ///< along x; INFINITY: not cut
  Millimetres max_length{INFINITY};  ///< along y
  Millimetres clearance{1.0};        ///< from a joint to what of a stone is nearest to it
};

/// MESHING_BANDS_DEGENERATE: a tile narrower than two cells, a surface of fewer than 2 x 2 nodes,
/// negative clearance. MESHING_JOINT_MEETS_STONES: wherever a joint is needed stones stand; names
/// the stretch and the stones, and the width that would do.
[[nodiscard]] Result<std::vector<Tile>> split_into_tiles(const heightmap::ModelField& surface,
                                                         std::span<const PlacedStone> stones,
                                                         const TileOptions& options);

}  // namespace maquette::meshing
