// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file height_spline.hpp
/// A height field as one smooth function, for CAD programs that know no grids.
///
/// Room    meshing:  ModelField -> [height_spline] -> export (STEP)
/// Takes   ModelField, millimetres, no voids, 4 x 4 nodes or more
/// Gives   z(x, y) as a bicubic tensor-product B-spline: C2, clamped at the border, knots in mm
///
/// Method. Least squares at the nodes (C. de Boor, "A Practical Guide to Splines", 2001, ch. XIV
/// and XVII): the problem is separable, so rows and columns are solved one after the other by
/// banded Cholesky factors. Knots are evenly spaced, as far apart as the tolerance allows: 32
/// cells, then ever closer; at last one pole a node (not-a-knot interpolation), which meets every
/// node. Time goes with the nodes, memory with the poles.

#include <vector>

#include "core/grid.hpp"
#include "core/result.hpp"
#include "core/run_context.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::meshing {

struct HeightSpline {
  std::vector<double> knots_x_mm, knots_y_mm;  ///< distinct ones; the outer ones count four times
  Grid<double> poles_mm;                       ///< heights; knots + 2 rows (y) and columns (x)
  double max_error_mm = 0.0, rms_error_mm = 0.0;  ///< at the nodes
  /// Greatest distance from the triangulated surface at the middles of cells: between nodes both
  /// are a guess.
  double max_between_mm = 0.0;
};

/// MESHING_SURFACE_HAS_VOIDS with row and column; CORE_CANCELLED.
/// @pre 4 x 4 nodes or more, tolerance > 0
[[nodiscard]] Result<HeightSpline> fit_height_spline(const heightmap::ModelField& surface,
                                                     Millimetres tolerance,
                                                     const RunContext& run = {});

/// Of the knots' distinct values; the outer ones for outside places.
[[nodiscard]] double height_of(const HeightSpline& spline, double x_mm, double y_mm);

/// Where the poles of a cubic with these knots stand, so that its x is its parameter.
[[nodiscard]] std::vector<double> greville_places(const std::vector<double>& knots_mm);

}  // namespace maquette::meshing
