// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file cutter_location.hpp
/// Lowest gouge-free height of a ball-nose cutter over the triangulated height grid.
///
/// Takes   ModelField without voids (heights checked by the caller, see mill.cpp)
/// Gives   height of the tip at (x, y) and the point where the ball touches
///
/// Method. tip(p) = max over q in the outline, |q - p| <= R, of h(q) + sqrt(R^2 - |q - p|^2) - R,
/// the maximum taken over facets, edges and vertices in closed form (drop-cutter, C.-M. Chuang,
/// C.-Y. Chen, H.-T. Yau, "A reverse engineering approach to generating interference-free tool
/// paths in three-axis machining from scanned data of physical models", Int. J. Adv. Manuf.
/// Technol. 19, 2002, doi:10.1007/PL00003965). First every cell in reach gets a certified upper
/// bound in single precision from its corners: on a cell of side d the contact height exceeds
/// the largest of its corners by at most kappa d^2 / 4, where kappa = R^2 / (R^2 - r^2)^1.5 is the
/// ball's curvature at the cell's farthest corner r (a chord bound over the circumcircle of a
/// right-angled triangle). Only cells whose bound beats the best contact so far are worked out in
/// double.
///
/// Accuracy. Exact up to rounding in double: |error| < 1e-9 mm for heights below 1 m.
/// Outside the outline there is no surface: the ball hangs over the edge.
/// Cost. O((R / spacing)^2) a point, independent of the size of the field; the surface is
/// copied once, 4 bytes a node.

#include <cmath>
#include <memory>

#include "cnc/tool.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::cnc {

struct CutterContact {
  double tip_mm = -INFINITY;  ///< -INFINITY: nothing within reach
  double dx_mm = 0.0;         ///< from the axis to the point of contact
  double dy_mm = 0.0;
};

/// Copies share the surface, so give each thread a copy. One object must not be used by two
/// threads at once: it keeps scratch space and tables.
class DropCutter {
 public:
  /// @pre field has at least 2 x 2 nodes, all finite; spacing and radius > 0
  DropCutter(const heightmap::ModelField& field, BallNose tool);
  DropCutter(const DropCutter& other);
  DropCutter& operator=(const DropCutter&) = delete;
  ~DropCutter();

  /// The same (x, y) gives the same bits whatever was asked before.
  [[nodiscard]] CutterContact drop(double x_mm, double y_mm);

 private:
  struct Surface;
  struct Scratch;
  std::shared_ptr<const Surface> surface_;
  std::unique_ptr<Scratch> scratch_;
};

}  // namespace maquette::cnc
