// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file level_region.hpp
/// Where a cutter may stand with its tip at a height: cells whose every point is free.
///
/// A cell is free at z if the cutter, moved sideways by half a diagonal and so containing
/// itself at every place of the cell, may stand at the cell's centre with its tip at z. A
/// straight path is free if it stays in free cells. On flat ground this loses nothing; beside a
/// wall the path keeps up to half a diagonal more distance.

#include <vector>

#include "cnc/cell_grid.hpp"
#include "cnc/tool.hpp"
#include "core/grid.hpp"
#include "core/run_context.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::cnc {

/// Per cell the tip's lowest height at which the cutter keeps `allowance` from the design (in
/// space) at every point of the cell; -INFINITY where the design is out of reach. Empty if
/// the run was stopped.
/// Cost: one cutter location a cell. @pre as for DropCutter; allowance >= 0
[[nodiscard]] Grid<float> lowest_tips(const heightmap::ModelField& design, const Cutter& cutter,
                                      double allowance_mm, const CellGrid& grid,
                                      const RunContext& run = {});

/// The free cells at one height. Refers to the grid of tips.
class LevelRegion {
 public:
  LevelRegion(const Grid<float>& lowest_tips, double z_mm) : tips_(lowest_tips), z_(z_mm) {}

  [[nodiscard]] bool free(std::ptrdiff_t row, std::ptrdiff_t col) const {
    return tips_.contains(row, col) && static_cast<double>(tips_(row, col)) <= z_;
  }
  /// The straight path from centre to centre.
  [[nodiscard]] bool free(Cell from, Cell to) const;

  /// Closed walks along the inner rim of each region (4-connected) and around each of its holes,
  /// region on the left; from a cell to one that shares a side or, past a blocked cell's
  /// corner, only a corner with it.
  [[nodiscard]] std::vector<std::vector<Cell>> rims() const;

  /// Fewer vertices: free straight pieces that pass every cell of the chain within
  /// `within_cells`; ends stay.
  [[nodiscard]] std::vector<Cell> straightened(const std::vector<Cell>& chain,
                                               double within_cells) const;

 private:
  const Grid<float>& tips_;
  double z_;
};

}  // namespace maquette::cnc
