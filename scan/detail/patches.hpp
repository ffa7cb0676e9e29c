// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file patches.hpp
/// Patches of a map of cells: which cells belong together, how high and how wide they are.
///
/// Extent   A cell belongs to a patch if the mean over it and its neighbours is nearer to the
/// patch's
///          height than to its surroundings; found anew until it stays.
/// Height   Mean of the cells that lie at least three steps inside, where there are nine of them:
/// what
///          a beam or a range's error carries over the edge lies outside of these. Of smaller
///          patches the mean of cells whose four neighbours belong to it, or, if it is surer, the
///          points' second moment over their first, sum (d^2 - s^2) / sum d: of a patch of one
///          height h among points at zero that is h, however its cells mix both (s: noise of one
///          point, from the surroundings). Base: cells three to six steps outside, without those of
///          other patches.
/// Volume   Sum over the patch and one step around it; cells of its edge, where points of both
/// heights
///          mix, scatter as their own points say, all others as noise says.

#include <cstddef>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "core/grid.hpp"
#include "scan/significance.hpp"

namespace maquette::scan::detail {

/// What the points of a cell add up to; deviations in mm.
struct Cell {
  double n = 0.0, sum = 0.0, square = 0.0;
  double level = 0.0;  ///< cosines of the design's slope
};

/// Scatter of single points: pooled robustly, the typical cell. A cell with many points that
/// scatters more has its own.
[[nodiscard]] double typical_variance(const Grid<Cell>& cells);

/// Cells of one size in which patches are sought. All grids have one shape.
struct Layer {
  const CellMap& map;
  const Grid<Cell>& cells;
  Grid<float> background_mm;  ///< level of the part as a whole at each cell
  Grid<float> sigma_mm;       ///< of a cell's mean; NaN: no points
  Grid<std::uint8_t> marked;  ///< 1: more than noise, against the background
};

/// Of a cell's level of detection over its standard deviation: 95 %, two-sided.
inline constexpr double kLevelOfDetection = 1.96;
/// The pose's share of a cell's variance, mm^2; 0 where it has no mean.
[[nodiscard]] double pose_variance(const CellMap& map, std::ptrdiff_t r, std::ptrdiff_t c);

/// A patch and the cells of its map (row, column) that make its height: inside minus around.
struct FoundPatch {
  using Cells = std::vector<std::pair<std::ptrdiff_t, std::ptrdiff_t>>;
  Finding finding;
  Cells all;     ///< that belong to it
  Cells inside;  ///< whose mean is its height; of a small one all
  Cells around;  ///< its base
};
[[nodiscard]] std::vector<FoundPatch> find_patches(const Layer& layer);
/// The patch that a few of its cells belong to; nothing where it is its surroundings that stand out
/// or where its height is no figure.
[[nodiscard]] std::optional<FoundPatch> patch_at(const Layer& layer, FoundPatch::Cells some);

}  // namespace maquette::scan::detail
