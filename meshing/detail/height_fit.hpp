// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file height_fit.hpp
/// Heights of a triangulation's vertices for which the squares of its vertical distances to the
/// field's nodes are least, and none of them is above a bound.
///
/// The least squares are solved by conjugate gradients (the matrix is that of finite elements'
/// masses, well conditioned: six rounds leave below a hundredth). Where a triangle would then be
/// farther off than the bound its corners go half of the way only, and so on; at worst they stay
/// where they were. Vertices of the border stay.
///
/// Memory  20 bytes a vertex, and the places in which triangles wait.

#include "meshing/detail/surface_triangulation.hpp"

namespace maquette::meshing::detail {

/// @pre no triangle is farther than `bound_mm` from a node under it
/// @post the same; triangles wait no more (scan_all)
void fit_heights(SurfaceTriangulation& surface, double bound_mm);

}  // namespace maquette::meshing::detail
