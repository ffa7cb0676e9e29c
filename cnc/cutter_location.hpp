// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file cutter_location.hpp
/// Lowest gouge-free height of a ball, bull-nose or flat cutter over the triangulated height grid.
///
/// Takes   ModelField without voids (heights checked by the caller, see mill.cpp)
/// Gives   height of the tip at (x, y) and a point where the cutter touches
///
/// Method. tip(p) = max over q in the outline, |q - p| <= R, of h(q) - rise(|q - p|), where the
/// underside of a cutter of corner radius rc rises by rc - sqrt(rc^2 - (r - R + rc)^2) from its
/// flat part outwards; the maximum over facets, edges and vertices as in contact.hpp
/// (drop-cutter, C.-M. Chuang,
/// C.-Y. Chen, H.-T. Yau, "A reverse engineering approach to generating interference-free tool
/// paths in three-axis machining from scanned data of physical models", Int. J. Adv. Manuf.
/// Technol. 19, 2002, doi:10.1007/PL00003965). First every cell in reach gets a certified upper
/// bound in single precision from its corners: on a cell of side d the contact height exceeds
/// the largest of its corners by at most kappa d^2 / 4, where kappa = rc^2 / (rc^2 - t^2)^1.5 is
/// the underside's curvature at the cell's farthest corner, t beyond the flat part (a chord bound
/// over the circumcircle of a right-angled triangle). Only cells whose bound beats the best contact
/// so far are worked out in double.
///
/// Accuracy. Exact up to rounding in double: |error| < 1e-9 mm for heights below 1 m, for a radius
/// within 1e-12 mm of the one given (what is just at the rim of a flat end may count or not).
/// Outside the outline there is no surface: the cutter hangs over the edge.
/// Cost. O((R / spacing)^2) a point, independent of the size of the field; the surface is
/// copied once, 4 bytes a node.

#include <cmath>
#include <initializer_list>
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
  /// @pre field has at least 2 x 2 nodes, all finite; spacing and radius > 0,
  /// 0 <= corner radius <= radius
  DropCutter(const heightmap::ModelField& field, const Cutter& tool);
  /// {3.0} would be a cutter of radius 3 whose corner is the default's.
  DropCutter(const heightmap::ModelField& field, std::initializer_list<double>) = delete;
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
