// SPDX-License-Identifier: GPL-3.0-or-later

// Repairs by S. Loriot, M. Rouxel-Labbe, J. Tournois, I. O. Yaz, Polygon Mesh Processing, in: CGAL
// User and Reference Manual. Holes: P. Liepa, Filling Holes in Meshes, SGP 2003,
// doi:10.2312/SGP/SGP03/200-206.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <exception>
#include <numeric>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Polygon_mesh_processing/border.h>
#include <CGAL/Polygon_mesh_processing/connected_components.h>
#include <CGAL/Polygon_mesh_processing/measure.h>
#include <CGAL/Polygon_mesh_processing/orient_polygon_soup.h>
#include <CGAL/Polygon_mesh_processing/orientation.h>
#include <CGAL/Polygon_mesh_processing/repair_degeneracies.h>
#include <CGAL/Polygon_mesh_processing/repair_polygon_soup.h>
#include <CGAL/Polygon_mesh_processing/self_intersections.h>
#include <CGAL/Polygon_mesh_processing/triangulate_hole.h>
#include <CGAL/Surface_mesh.h>
#include <fmt/format.h>

#include "meshing/mesh_io.hpp"
#include "meshing/stone_body.hpp"

namespace maquette::meshing {
namespace {

namespace pmp = CGAL::Polygon_mesh_processing;
using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Point = Kernel::Point_3;
using Mesh = CGAL::Surface_mesh<Point>;
using Triangle = std::array<std::size_t, 3>;

struct Soup {
  std::vector<Point> points;
  std::vector<Triangle> triangles;
};

std::string place(const Point& p) {
  return fmt::format("x {:.6g} y {:.6g} z {:.6g}", p.x(), p.y(), p.z());
}

double diagonal(const Box3& box) {
  return box.empty() ? 0.0 : norm(box.max - box.min);
}

/// Points within `tolerance` of another become it. They are sorted along a direction in which no
/// wall of a part lies, so that only few are compared.
std::size_t merge_points(Soup& soup, double tolerance) {
  const Vec3 along = normalized(Vec3{1.0, 0.6180339887, 0.3819660113});
  std::vector<std::size_t> order(soup.points.size()), same(soup.points.size());
  std::vector<double> way;
  for (const Point& p : soup.points) way.push_back(dot(along, {p.x(), p.y(), p.z()}));
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::iota(same.begin(), same.end(), std::size_t{0});
  std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return std::pair(way[a], a) < std::pair(way[b], b);
  });
  std::size_t merged = 0;
  for (std::size_t i = 0; i < order.size(); ++i) {
    const std::size_t a = order[i];
    if (same[a] != a) continue;
    for (std::size_t j = i + 1; j < order.size() && way[order[j]] - way[a] <= tolerance; ++j) {
      const std::size_t b = order[j];
      if (same[b] != b ||
          CGAL::squared_distance(soup.points[a], soup.points[b]) > tolerance * tolerance)
        continue;
      same[b] = a;
      ++merged;
    }
  }
  for (Triangle& t : soup.triangles)
    for (std::size_t& v : t) v = same[v];
  return merged;
}

bool same_turn(const Soup& now, const Triangle& a, const Soup& before, const Triangle& b) {
  for (std::size_t shift = 0; shift < 3; ++shift) {
    bool same = true;
    for (std::size_t k = 0; k < 3; ++k)
      same = same && now.points[a[(k + shift) % 3]] == before.points[b[k]];
    if (same) return true;
  }
  return false;
}

Soup soup_of(const TriMesh& mesh, MeshRepairs& repairs) {
  Soup soup;
  for (const Vec3& v : mesh.vertices_mm) soup.points.emplace_back(v.x, v.y, v.z);
  for (const auto& [a, b, c] : mesh.triangles) soup.triangles.push_back({a, b, c});
  repairs.merged_points = merge_points(soup, kSamePointShare * diagonal(mesh.bounds()));
  repairs.degenerate_faces =
      static_cast<std::size_t>(std::erase_if(soup.triangles, [](const Triangle& t) {
        return t[0] == t[1] || t[1] == t[2] || t[2] == t[0];
      }));
  repairs.repeated_faces =
      pmp::merge_duplicate_polygons_in_polygon_soup(soup.points, soup.triangles);
  pmp::remove_isolated_points_in_polygon_soup(soup.points, soup.triangles);
  return soup;
}

/// Faces keep the numbers of their triangles. Nothing where an edge has more than two triangles or
/// sheets cross in a vertex even after the soup's orientation.
std::optional<Mesh> mesh_of(const Soup& soup) {
  Mesh mesh;
  for (const Point& p : soup.points) mesh.add_vertex(p);
  for (const Triangle& t : soup.triangles) {
    const auto vertex = [](std::size_t i) {
      return Mesh::Vertex_index(static_cast<Mesh::size_type>(i));
    };
    if (mesh.add_face(vertex(t[0]), vertex(t[1]), vertex(t[2])) == Mesh::null_face())
      return std::nullopt;
  }
  return mesh;
}

void remove_degenerate(Mesh& mesh, MeshRepairs& repairs) {
  std::size_t count = 0;
  for (const Mesh::Face_index f : mesh.faces()) count += pmp::is_degenerate_triangle_face(f, mesh);
  if (count == 0) return;
  repairs.degenerate_faces += count;
  pmp::remove_degenerate_faces(mesh);
}

/// Holes that are narrow enough are filled; the others are said.
Result<void> fill_holes(Mesh& mesh, double size, MeshRepairs& repairs) {
  std::vector<Mesh::Halfedge_index> cycles;
  pmp::extract_boundary_cycles(mesh, std::back_inserter(cycles));
  std::size_t too_wide = 0, edges_of_widest = 0;
  double widest = 0.0;
  Point at;
  for (const Mesh::Halfedge_index h : cycles) {
    Box3 box;
    std::size_t edges = 0;
    for (const Mesh::Halfedge_index e : CGAL::halfedges_around_face(h, mesh)) {
      const Point& p = mesh.point(mesh.target(e));
      box.add({p.x(), p.y(), p.z()});
      ++edges;
    }
    const double width = diagonal(box);
    if (width <= kSmallHoleShare * size) {
      std::vector<Mesh::Face_index> patch;
      pmp::triangulate_hole(mesh, h, std::back_inserter(patch));
      if (!patch.empty()) {
        ++repairs.filled_holes;
        continue;
      }
    }
    ++too_wide;
    if (width >= widest) {
      widest = width;
      edges_of_widest = edges;
      at = mesh.point(mesh.target(h));
    }
  }
  if (too_wide > 0)
    return fail(kStoneNotClosed,
                fmt::format("is not closed: {} {} cannot be filled; the widest has {} edges, is "
                            "{:.4g} across (at most {:.4g}, a tenth of the stone, is filled) and "
                            "lies at {}; close it in a mesh editor",
                            too_wide, too_wide == 1 ? "hole" : "holes", edges_of_widest, widest,
                            kSmallHoleShare * size, place(at)));
  return {};
}

Result<void> expect_no_cuts(const Mesh& mesh) {
  std::vector<std::pair<Mesh::Face_index, Mesh::Face_index>> pairs;
  pmp::self_intersections(mesh, std::back_inserter(pairs));
  if (pairs.empty()) return {};
  const auto first = *std::min_element(pairs.begin(), pairs.end());
  const Point& at = mesh.point(mesh.target(mesh.halfedge(first.first)));
  return fail(kStoneCutsItself,
              fmt::format("cuts itself: {} {} of triangles go through each other, the first at {}; "
                          "make one surface of it in a mesh editor (a union, or a remeshing)",
                          pairs.size(), pairs.size() == 1 ? "pair" : "pairs", place(at)));
}

/// One shell: the largest, outward. What lies inside is filled, dust is dropped.
/// @pre closed, does not cut itself
Result<void> keep_one_piece(Mesh& mesh, MeshRepairs& repairs) {
  std::vector<std::array<Mesh::Vertex_index, 3>> before(mesh.num_faces());
  const auto corners = [&](Mesh::Face_index f) {
    std::array<Mesh::Vertex_index, 3> c;
    std::size_t k = 0;
    for (const Mesh::Vertex_index v : mesh.vertices_around_face(mesh.halfedge(f))) c[k++] = v;
    std::rotate(c.begin(), std::min_element(c.begin(), c.end()), c.end());
    return c;
  };
  for (const Mesh::Face_index f : mesh.faces()) before[static_cast<std::size_t>(f)] = corners(f);
  pmp::orient_to_bound_a_volume(mesh);
  std::size_t turned = 0;
  for (const Mesh::Face_index f : mesh.faces())
    turned += before[static_cast<std::size_t>(f)] != corners(f);

  auto piece_of = mesh.add_property_map<Mesh::Face_index, std::uint32_t>("f:piece", 0).first;
  const std::size_t count = pmp::connected_components(mesh, piece_of);
  std::vector<double> volume(count, 0.0);
  std::vector<Point> at(count);
  for (const Mesh::Face_index f : mesh.faces()) {
    std::array<Point, 3> p;
    std::size_t k = 0;
    for (const Mesh::Vertex_index v : mesh.vertices_around_face(mesh.halfedge(f)))
      p[k++] = mesh.point(v);
    const Point origin = mesh.point(*mesh.vertices().begin());
    volume[piece_of[f]] += CGAL::volume(origin, p[0], p[1], p[2]);
    at[piece_of[f]] = p[0];
  }
  const auto largest =
      static_cast<std::size_t>(std::max_element(volume.begin(), volume.end()) - volume.begin());
  std::vector<std::size_t> large;
  for (std::size_t i = 0; i < count; ++i) {
    if (i == largest) continue;
    if (volume[i] < 0.0)
      ++repairs.filled_cavities;
    else if (volume[i] < kDustShare * volume[largest])
      ++repairs.dropped_pieces;
    else
      large.push_back(i);
  }
  if (!large.empty())
    return fail(kStoneInPieces,
                fmt::format("is of {} pieces: beside the largest one of {:.1f} % of its volume at "
                            "{}; a stone is one body, unite them or give each a file of its own",
                            large.size() + 1, 100.0 * volume[large[0]] / volume[largest],
                            place(at[large[0]])));
  const std::array<std::size_t, 1> keep{largest};
  if (count > 1) pmp::keep_connected_components(mesh, keep, piece_of);
  mesh.remove_property_map(piece_of);
  repairs.turned_faces += turned;
  return {};
}

TriMesh to_tri_mesh(Mesh& mesh) {
  mesh.collect_garbage();
  TriMesh out;
  for (const Mesh::Vertex_index v : mesh.vertices()) {
    const Point& p = mesh.point(v);
    out.vertices_mm.push_back({p.x(), p.y(), p.z()});
  }
  for (const Mesh::Face_index f : mesh.faces()) {
    std::array<std::uint32_t, 3> t{};
    std::size_t k = 0;
    for (const Mesh::Vertex_index v : mesh.vertices_around_face(mesh.halfedge(f)))
      t[k++] = static_cast<std::uint32_t>(v);
    out.triangles.push_back(t);
  }
  return out;
}

Result<TriMesh> repair(const TriMesh& source, MeshRepairs& repairs, const RunContext& run) {
  const double size = diagonal(source.bounds());
  Soup soup = soup_of(source, repairs);
  if (soup.triangles.empty())
    return fail(kMeshEmpty, "no triangle has an area; a stone is a closed surface");
  const Soup before = soup;
  pmp::orient_polygon_soup(soup.points, soup.triangles);
  for (std::size_t i = 0; i < soup.triangles.size(); ++i)
    repairs.turned_faces += !same_turn(soup, soup.triangles[i], before, before.triangles[i]);
  auto mesh = mesh_of(soup);
  if (!mesh)
    return fail(kStoneNotClosed,
                "is no surface of a body: an edge has more than two triangles; make one surface of "
                "it in a mesh editor");
  if (run.stopped()) return fail(kCancelled, "repairing a stone was stopped");
  remove_degenerate(*mesh, repairs);
  MAQUETTE_TRY_VOID(fill_holes(*mesh, size, repairs));
  remove_degenerate(*mesh, repairs);
  mesh->collect_garbage();
  if (mesh->is_empty() || mesh->number_of_faces() == 0)
    return fail(kMeshEmpty, "no triangle has an area; a stone is a closed surface");
  if (run.stopped()) return fail(kCancelled, "repairing a stone was stopped");
  MAQUETTE_TRY_VOID(expect_no_cuts(*mesh));
  MAQUETTE_TRY_VOID(keep_one_piece(*mesh, repairs));
  // A body of rounding errors: thinner than what is merged in points.
  if (const double volume = pmp::volume(*mesh); !(volume > kSamePointShare * size * size * size))
    return fail(kStoneFlat, fmt::format("has a volume of {:.3g}, which is nothing for a size of "
                                        "{:.4g}; a stone has three extents",
                                        volume, size));
  return to_tri_mesh(*mesh);
}

}  // namespace

Result<TriMesh> repair_stone(const TriMesh& mesh, MeshRepairs& repairs, const RunContext& run) {
  if (mesh.triangles.size() > kMostStoneTriangles)
    return fail(kStoneTooLarge, fmt::format("has {} triangles, a stone may have {}; reduce it in a "
                                            "mesh editor",
                                            mesh.triangles.size(), kMostStoneTriangles));
  try {
    return repair(mesh, repairs, run);
  } catch (const std::exception& e) {
    return fail(kStoneNotClosed, fmt::format("cannot be repaired: {}", e.what()));
  }
}

}  // namespace maquette::meshing
