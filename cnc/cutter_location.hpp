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
/// (drop-cutter, C.-M. Chuang, C.-Y. Chen, H.-T. Yau, "A reverse engineering approach to
/// generating interference-free tool paths in three-axis machining from scanned data of physical
/// models", Int. J. Adv. Manuf.
/// Technol. 19, 2002, doi:10.1007/PL00003965). Three sieves, each certified:
///   all cells in reach      upper bounds in single precision from tables; lower bound from the
///                           nodes (reach_window.hpp)
///   those that beat it      under a ball: the contacts themselves in single precision, widened by
///   (about 8)               the rounding (ball_bound.hpp)
///   those that still do     the contacts in double (cell_contact.hpp)
///   (hardly more than 1)
/// Cutters of more than 24 cells, shank and holder go by tiles instead (height_tiles.hpp).
///
/// Accuracy. Exact up to rounding in double: |error| < 1e-9 mm for heights below 1 m, for a radius
/// within 1e-12 mm of the one given (what is just at the rim of a flat end may count or not).
/// Outside the outline there is no surface: the cutter hangs over the edge.
/// Cost. O((R / spacing)^2) a point, independent of the size of the field; the surface is
/// copied once, 4 bytes a node, and 2 MiB of tables stand beside it.

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

/// Immutable: copies share the surface, and threads may share one.
class DropCutter {
 public:
  /// @pre field has at least 2 x 2 nodes, all finite; spacing and radius > 0,
  /// 0 <= corner radius <= radius; holder parts of radii > 0 and height >= 0
  DropCutter(const heightmap::ModelField& field, const Cutter& tool);
  /// {3.0} would be a cutter of radius 3 whose corner is the default's.
  DropCutter(const heightmap::ModelField& field, std::initializer_list<double>) = delete;

  /// The same (x, y) gives the same bits whatever was asked before.
  [[nodiscard]] CutterContact drop(double x_mm, double y_mm) const;
  /// Height of the cutter's tip at which its shank or holder first touches: below it the cutter
  /// is too short for the place. -INFINITY: no holder given, or nothing within its reach.
  [[nodiscard]] CutterContact drop_holder(double x_mm, double y_mm) const;

 private:
  struct Surface;
  std::shared_ptr<const Surface> surface_;
};

}  // namespace maquette::cnc
