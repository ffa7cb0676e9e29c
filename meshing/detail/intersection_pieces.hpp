// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file intersection_pieces.hpp
/// Which triangles of a solid must be held against each other so that no self-intersection is
/// missed: pieces of a few thousand, so that memory stays small and cost is linear, and none where
/// the shape itself says that nothing can cut.
///
/// Room    meshing:  mesh -> [intersection_pieces] -> CGAL, piece by piece -> mesh_checks
///
/// Why it is complete. Seen from above the bounding box is cut into squares; a triangle belongs to
/// all squares that its own box meets. Two triangles that cut have a point in common, its square is
/// among those of both, so they meet in that square's piece. With the height field of the top less
/// is enough. Call plain a triangle that is the field's own (half a cell, its nodes to the bit, one
/// vertex a node, above the base), shell one that lies as a whole in the plane of a wall or of the
/// base, where these planes bound the mesh:
///   plain with plain ..... two halves of cells of one graph: no more than a shared edge or vertex
///   shell with any ....... only with triangles that have a vertex in one of the planes, for the
///                          others lie strictly inside: all those are one piece
///   any with the rest .... the pieces of those squares that a triangle of neither kind meets

#include <cstdint>
#include <vector>

#include "core/tri_mesh.hpp"
#include "heightmap/height_field.hpp"
#include "meshing/coordinate_rounding.hpp"

namespace maquette::meshing::detail {

struct IntersectionPieces {
  std::vector<std::uint32_t> faces;  ///< piece after piece
  std::vector<std::size_t> first;    ///< of each piece, and one past the last
  [[nodiscard]] std::size_t count() const { return first.size() - 1; }
};

/// @param surface  of the top, if there is one
/// @param rounding  that the mesh's coordinates have been through
/// @pre indices in range, coordinates finite, no triangle twice and none without area
[[nodiscard]] IntersectionPieces intersection_pieces(const TriMesh& mesh,
                                                     const heightmap::ModelField* surface,
                                                     CoordinateRounding rounding);

}  // namespace maquette::meshing::detail
