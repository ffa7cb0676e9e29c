// SPDX-License-Identifier: GPL-3.0-or-later
#include <CGAL/Constrained_Delaunay_triangulation_2.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Triangulation_vertex_base_with_info_2.h>

#include <unordered_set>

#include "core/check.hpp"
#include "meshing/dowels.hpp"

namespace maquette::meshing::detail {
namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Vertices = CGAL::Triangulation_vertex_base_with_info_2<std::uint32_t, Kernel>;
using Faces = CGAL::Constrained_triangulation_face_base_2<Kernel>;
using Plane = CGAL::Constrained_Delaunay_triangulation_2<
    Kernel, CGAL::Triangulation_data_structure_2<Vertices, Faces>,
    CGAL::No_constraint_intersection_tag>;

}  // namespace

std::vector<std::array<std::uint32_t, 3>> triangulate_ring(std::span<const Flat> outer,
                                                           std::span<const Flat> hole) {
  Plane plane;
  std::vector<Plane::Vertex_handle> handles;
  for (const auto& ring : {outer, hole}) {
    const std::size_t first = handles.size();
    for (const Flat& p : ring) {
      handles.push_back(plane.insert(Kernel::Point_2(p.s, p.z)));
      handles.back()->info() = static_cast<std::uint32_t>(handles.size() - 1);
    }
    for (std::size_t i = 0; i < ring.size(); ++i)
      plane.insert_constraint(handles[first + i], handles[first + (i + 1) % ring.size()]);
  }
  // From outside inwards: every constraint that is crossed changes sides.
  std::unordered_set<Plane::Face_handle, CGAL::Handle_hash_function> seen, inside;
  std::vector<std::pair<Plane::Face_handle, bool>> open{{plane.infinite_face(), false}};
  while (!open.empty()) {
    const auto [face, is_inside] = open.back();
    open.pop_back();
    if (!seen.insert(face).second) continue;
    if (is_inside) inside.insert(face);
    for (int i = 0; i < 3; ++i)
      open.emplace_back(face->neighbor(i), is_inside != plane.is_constrained({face, i}));
  }
  std::vector<std::array<std::uint32_t, 3>> triangles;
  for (auto f = plane.finite_faces_begin(); f != plane.finite_faces_end(); ++f)
    if (inside.contains(f))
      triangles.push_back({f->vertex(0)->info(), f->vertex(1)->info(), f->vertex(2)->info()});
  MAQUETTE_CHECK(triangles.size() == outer.size() + hole.size(), "{} triangles of {} corners",
                 triangles.size(), outer.size() + hole.size());
  // CGAL's own order goes by addresses.
  for (auto& t : triangles) std::rotate(t.begin(), std::min_element(t.begin(), t.end()), t.end());
  std::sort(triangles.begin(), triangles.end());
  return triangles;
}

}  // namespace maquette::meshing::detail
