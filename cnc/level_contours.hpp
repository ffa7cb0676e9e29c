// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file level_contours.hpp
/// Where a field known at the nodes of a grid passes a level: which edges of the grid, in
/// which order. Places on the edges are the caller's to find.
///
/// Marching squares, with the saddle decided by the mean of the four corners (G. M. Nielson,
/// B. Hamann, "The asymptotic decider", Proc. IEEE Visualization '91, 1991,
/// doi:10.1109/VISUAL.1991.175782, says why it must be decided at all; a wrong decision here costs
/// a detour, never a gouge).

#include <cstddef>
#include <cstdint>
#include <functional>
#include <vector>

#include "core/grid.hpp"

namespace maquette::cnc {

/// From node (row, col) to the next one along x or y.
struct GridEdge {
  std::int32_t row = 0, col = 0;
  bool along_x = true;
  friend bool operator==(const GridEdge&, const GridEdge&) = default;
};

/// Edges passed by one contour, in order, what is not above the level to the left. Closed
/// contours do not repeat the first edge.
struct LevelContour {
  std::vector<GridEdge> edges;
  bool closed = false;
};

/// Contours between nodes above the level and nodes at or below it, through those cells
/// (lower left node) that `wanted` says; those with an end begin there. Order: by where
/// they begin, row by row.
[[nodiscard]] std::vector<LevelContour> level_contours(
    const Grid<float>& field, double level,
    const std::function<bool(std::ptrdiff_t row, std::ptrdiff_t col)>& wanted);

}  // namespace maquette::cnc
