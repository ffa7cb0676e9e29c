// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file edge_turns.hpp
/// Edges of a triangulation turned where that brings it nearer to the field (data-dependent
/// triangulation: N. Dyn, D. Levin, S. Rippa, IMA J. Numer. Anal. 10, 1990,
/// doi:10.1093/imanum/10.1.137): Delaunay triangles lie across ridges and valleys, these along.

#include <cstdint>

#include "meshing/detail/surface_triangulation.hpp"

namespace maquette::meshing::detail {

/// Each inner edge once: it is turned if both new triangles are seen from above the right way
/// round, no node under them is farther off than `bound_mm`, and the sum of squares falls.
/// The triangulation is then no longer Delaunay: neither insert() nor refine() may follow.
/// @return how many were turned
std::uint64_t turn_edges(SurfaceTriangulation& surface, double bound_mm);

}  // namespace maquette::meshing::detail
