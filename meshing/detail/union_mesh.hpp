// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file union_mesh.hpp
/// The mesh that terrain and stones are united in, tidied so that files can hold it.

#include <array>
#include <functional>

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Surface_mesh.h>

#include "core/tri_mesh.hpp"

namespace maquette::meshing::detail {

using UnionKernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using UnionMesh = CGAL::Surface_mesh<UnionKernel::Point_3>;

/// Edges shorter than that are collapsed, triangles lower than that are turned away: what is
/// smaller would not survive the 32 bits of most files at a metre (0.00006 mm).
inline constexpr double kShortestEdge_mm = 1e-3;
inline constexpr double kLowestTriangle_mm = 2e-4;
/// Edges of triangles that rounding spoils are collapsed up to this length.
inline constexpr double kLongestMended_mm = 8e-3;

/// Whether a vertex stays where it is: nodes of the field, the block's base.
using Stays = std::function<bool(Vec3)>;

[[nodiscard]] inline Vec3 place(const UnionMesh& mesh, UnionMesh::Vertex_index v) {
  const auto& p = mesh.point(v);
  return {p.x(), p.y(), p.z()};
}
[[nodiscard]] inline std::array<Vec3, 3> corners_of(const UnionMesh& mesh,
                                                    UnionMesh::Face_index f) {
  const auto h = mesh.halfedge(f);
  return {place(mesh, mesh.source(h)), place(mesh, mesh.target(h)),
          place(mesh, mesh.target(mesh.next(h)))};
}
/// By which vertices are ordered: CGAL numbers them by where they lie in memory.
[[nodiscard]] inline std::array<double, 3> order_of(Vec3 p) {
  return {p.y, p.x, p.z};
}

/// Collapses short edges and turns flat triangles. Of an edge's ends of which neither stays the
/// first or the last is kept.
void tidy(UnionMesh& mesh, const Stays& stays, bool keep_first);

/// Puts all vertices but those that stay onto places that 32 bits hold: STL has them to the bit,
/// 3MF to 1.3e-4 mm.
void round_places(UnionMesh& mesh, const Stays& stays);

/// Collapses and turns what is degenerate or cuts another triangle where coordinates are rounded as
/// a file's are (CoordinateRounding, each): slivers of less than a micrometre.
/// @return false if something is left
[[nodiscard]] bool mend_for_files(UnionMesh& mesh, const Stays& stays, bool keep_first);

}  // namespace maquette::meshing::detail
