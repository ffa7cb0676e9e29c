// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file stock_grid.hpp
/// Stock during roughing: for each cell a height that the stock nowhere in the cell exceeds.
///
/// All questions and all cuts are rounded to the safe side over whole cells: cutting lowers a
/// cell only to what every one of its points was lowered to; asking whether a cutter may be
/// somewhere counts every point of a cell as high as the highest. So a rapid that is allowed here
/// touches nothing, and what is reported as left is at least what is left.
///
/// Cost. 4 bytes a cell; a cut: the cells under it; a question: (2 R / side)^2.

#include <vector>

#include "cnc/cell_grid.hpp"
#include "cnc/linking.hpp"
#include "cnc/tool.hpp"
#include "core/grid.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::cnc {

/// Block with vertical sides and a flat top, as it lies on the table. Model frame.
struct StockBox {
  double x0_mm = 0.0, y0_mm = 0.0, x1_mm = 0.0, y1_mm = 0.0, top_mm = 0.0;
};

class StockGrid {
 public:
  /// Empty. The cutter is the one that all questions are about.
  StockGrid(const CellGrid& grid, const Cutter& cutter);

  void add(const StockBox& box);
  /// Nodes as squares: within half a spacing of a node, along each axis, nothing stands higher
  /// than the node says. NaN: no stock there.
  void add(const heightmap::ModelField& field);

  /// The cutter moves from centre to centre with its tip at most at z.
  void cut(Cell from, Cell to, double z_mm);

  /// Whether the cutter would lower some cell by more than `least_mm` wherever it stands within
  /// kWithinCells of the cell's centre.
  [[nodiscard]] bool engaged(Cell at, double z_mm, double least_mm) const;

  /// The cutter may be with its tip at this height or above anywhere within half a side of (x, y).
  [[nodiscard]] double clear_height(double x_mm, double y_mm) const;
  /// The same for rapids. Refers to this object.
  [[nodiscard]] LinkSurface link_surface() const;

  /// -INFINITY: no stock
  [[nodiscard]] const Grid<float>& top_mm() const { return top_; }
  /// Nodes at the cells' centres, again as squares. Without nodes if there is no stock.
  [[nodiscard]] heightmap::ModelField field() const;

 private:
  struct Reach {
    int row, col;
    float cap;  // underside of the cutter
  };
  CellGrid grid_;
  Cutter cutter_;
  Grid<float> top_;
  std::vector<Reach> shrunk_, widened_;  // nearest first
};

/// A surface nowhere below such squares: each node as high as the highest of its neighbours, voids
/// as low as the lowest. What later passes take as their stock.
[[nodiscard]] heightmap::ModelField surface_over(const heightmap::ModelField& squares);

}  // namespace maquette::cnc
