// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file band_joints.hpp
/// Strips whose joints keep off the stones.
///
/// Takes   ModelField; how to split it; the stones' poses
/// Gives   bands (bands.hpp), and which joints meet which stones all the same
///
/// Even bands stay where none of their joints meets a stone. Else, of all joints along lines of
/// nodes that keep the width, or the number, those are taken that meet the fewest stones, of these
/// the fewest bands, of these the most even ones. One that meets a stone is no error, for stones
/// can be glued on after the strips have been joined: it is named.

#include <cstddef>
#include <span>
#include <vector>

#include "core/result.hpp"
#include "heightmap/height_field.hpp"
#include "meshing/bands.hpp"
#include "meshing/stones.hpp"

namespace maquette::meshing {

/// A joint with stones on it, or too near to it.
struct JointAtStones {
  int joint = 0;             ///< 1: between bands 1 and 2
  double at_mm = 0.0;        ///< its coordinate along the split's axis
  std::vector<int> through;  ///< numbers of the stones that stand across it
  std::vector<int> near;     ///< of those beside it that are nearer than the clearance
};

struct BandLayout {
  std::vector<Band> bands;
  std::size_t even_bands = 0;       ///< as many as there would be if there were no stones
  std::vector<JointAtStones> kept;  ///< joints that could not keep off, ascending
};

/// @param clearance  from a joint to what of a stone is nearest to it (of its box)
/// As split_into_bands; MESHING_BANDS_DEGENERATE also for a negative clearance.
/// Time goes with the lines of nodes times those in a band.
[[nodiscard]] Result<BandLayout> split_beside_stones(const heightmap::ModelField& surface,
                                                     const BandSplit& split,
                                                     std::span<const PlacedStone> stones,
                                                     Millimetres clearance);

/// The layout's joints as a split of the same surface.
[[nodiscard]] BandSplit split_of(const BandLayout& layout);

}  // namespace maquette::meshing
