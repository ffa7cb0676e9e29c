// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file terrain_fit.hpp
/// A terrain mesh of so many triangles with a small sum of squares, in three steps: triangles
/// where the ground is rough, vertices to where they serve best, the worst nodes as vertices.

#include <cstdint>

#include "core/run_context.hpp"
#include "meshing/detail/terrain_mesh.hpp"

namespace maquette::meshing::detail {

/// Right triangles, halved from the middle of their longest side where the best plane leaves
/// much (the hierarchy of W. Evans, D. Kirkpatrick, G. Townsend, "Right-triangulated irregular
/// networks", Algorithmica 30, 2001, doi:10.1007/s00453-001-0006-x; neighbours are halved first
/// where they must be, as M. Duchaineau et al., "ROAMing terrain", Visualization 1997). The
/// limit of what may be left is found on a share of the ground, then lowered in a few sweeps.
/// Vertices of the border stand on nodes.
/// @pre mesh is empty; @post at most `triangles`, or two
void bisect_terrain(TerrainMesh& mesh, std::uint64_t triangles, const RunContext& run);

/// Moves inner vertices in x, y and z to where the sum of squares is least, and turns edges.
/// One round: all triangles are measured, edges turned (each third round), then each vertex
/// moves by a Gauss-Newton step of its three coordinates, the plain sideways ones damped
/// (K. Levenberg 1944): under a triangle of slope g the surface follows a corner by its share
/// of dz - g.(dx, dy). What is missing is kept up to date to first order from vertex to vertex
/// (Gauss-Seidel). Ends with heights alone. Vertices of more than 24 triangles do not move.
void fit_vertices(TerrainMesh& mesh, const RunContext& run);

/// Inserts the farthest nodes with their heights, turning edges around them, until there are
/// `triangles`, or one fewer.
void insert_worst(TerrainMesh& mesh, std::uint64_t triangles, const RunContext& run);

}  // namespace maquette::meshing::detail
