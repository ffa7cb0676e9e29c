// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file stock_depth.hpp
/// How deep a cutter that follows the design stands in what is still on it, along its axis: the
/// depth that chip thickness depends on (feeds.hpp).
///
/// Takes   design; stock over it (ModelField, mm) or a height over the design; the cutter
/// Gives   a bound on the depth for the tip anywhere along a line
///
/// Method. Within the cutter's radius R of a place, let t be the stock's greatest height over the
/// design and s the steepest slope of the design. A ball touches the surface at most at the angle
/// atan(s) from its tip, and stock of the thickness t reaches acos(1 - t / R) further round it; so
/// it is engaged up to R (1 - cos(atan(s) + acos(1 - t / R))) above the tip, at most R + t. With
/// a corner of r < R the same holds for r. A bound, not an estimate: t is not divided by the
/// slope, and the thickest and the steepest need not be at one place.
///
/// Cost. Four comparisons a node for each spacing within R; 4 bytes a node.

#include <limits>

#include "cnc/tool.hpp"
#include "core/grid.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::cnc {

class StockDepth {
 public:
  /// @param stock         heights before the cut; void or not there: `thickness`
  /// @param thickness_mm  of stock over the design where no stock says it
  /// @pre the design has at least 2 x 2 nodes
  StockDepth(const heightmap::ModelField& design, const heightmap::ModelField* stock,
             double thickness_mm, const Cutter& cutter);

  /// Greatest depth for the axis between two places.
  [[nodiscard]] double along_mm(double x0_mm, double y0_mm, double x1_mm, double y1_mm) const;
  [[nodiscard]] double deepest_mm() const { return deepest_; }

 private:
  Grid<float> depth_;
  double x0_, y0_, spacing_, deepest_ = 0.0;
};

}  // namespace maquette::cnc
