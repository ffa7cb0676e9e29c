// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file mesh_borders.hpp
/// Borders of a mesh in which no edge has more than two triangles.

#include <cstdint>
#include <vector>

#include "core/tri_mesh.hpp"
#include "scan/cloud.hpp"

namespace maquette::scan::detail {

/// Gives every fan of triangles round a vertex a vertex of its own where a vertex holds several
/// together: the mesh becomes a 2-manifold with border (Gueziec, Taubin, Lazarus, Horn 2001,
/// doi:10.1109/2945.928166). @return how many vertices were added
std::size_t part_fans(TriMesh& mesh, std::vector<Colour>& colours);

/// Each loop of border edges once, vertices in the order in which a fan that fills it runs.
/// @pre part_fans
[[nodiscard]] std::vector<std::vector<std::uint32_t>> border_loops(const TriMesh& mesh);

}  // namespace maquette::scan::detail
