// SPDX-License-Identifier: GPL-3.0-or-later
#define CGAL_LINKED_WITH_TBB 1
#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include <CGAL/Polygon_mesh_processing/self_intersections.h>

#include "meshing/coordinate_rounding.hpp"
#include "meshing/detail/union_mesh.hpp"

namespace maquette::meshing::detail {
namespace {

namespace pmp = CGAL::Polygon_mesh_processing;
using Mesh = UnionMesh;
using Vertex = Mesh::Vertex_index;
using Halfedge = Mesh::Halfedge_index;
using Edge = Mesh::Edge_index;
using Face = Mesh::Face_index;

constexpr int kRounds = 4;

Vec3 area_vector(Vec3 a, Vec3 b, Vec3 c) {
  return cross(b - a, c - a);
}

double lowest_height(Vec3 a, Vec3 b, Vec3 c) {
  const double longest = std::fmax(norm(b - a), std::fmax(norm(c - b), norm(a - c)));
  return norm(area_vector(a, b, c)) / longest;
}

double height_of(const Mesh& mesh, Face f) {
  const auto [a, b, c] = corners_of(mesh, f);
  return lowest_height(a, b, c);
}

double length_of(const Mesh& mesh, Edge e) {
  return norm(place(mesh, mesh.vertex(e, 0)) - place(mesh, mesh.vertex(e, 1)));
}

/// Of an edge or a triangle, whatever way it is turned.
template <std::size_t n>
auto key_of(std::array<Vec3, n> corners) {
  std::sort(corners.begin(), corners.end(),
            [](Vec3 a, Vec3 b) { return order_of(a) < order_of(b); });
  std::array<std::array<double, 3>, n> key;
  for (std::size_t i = 0; i < n; ++i) key[i] = order_of(corners[i]);
  return key;
}

void sort_by_place(const Mesh& mesh, std::vector<Face>& faces) {
  std::sort(faces.begin(), faces.end(), [&](Face a, Face b) {
    return key_of(corners_of(mesh, a)) < key_of(corners_of(mesh, b));
  });
}

/// Where `from` goes to `to`: false if a triangle that stays would turn over. Those lower than
/// `ignored_mm` are not asked: which way they are turned says nothing.
bool can_move(const Mesh& mesh, Vertex from, Vertex to, Vec3 place_of_both, double ignored_mm) {
  for (const Halfedge h : CGAL::halfedges_around_target(from, mesh)) {
    if (mesh.is_border(h)) continue;
    const Vertex a = mesh.target(mesh.next(h)), b = mesh.source(h);
    if (a == to || b == to) continue;  // goes away
    const Vec3 p = place(mesh, from), pa = place(mesh, a), pb = place(mesh, b);
    if (ignored_mm > 0.0 && lowest_height(p, pa, pb) < ignored_mm) continue;
    if (!(dot(area_vector(p, pa, pb), area_vector(place_of_both, pa, pb)) > 0.0)) return false;
  }
  return true;
}

enum class Keep { first, last, either };

/// Of two ends of which neither stays, the one that `keep` says.
bool collapse(Mesh& mesh, const Stays& stays, Edge e, Keep keep, double ignored_mm) {
  const Vertex a = mesh.vertex(e, 0), b = mesh.vertex(e, 1);
  const Vec3 pa = place(mesh, a), pb = place(mesh, b);
  const bool a_stays = stays(pa), b_stays = stays(pb);
  if ((a_stays && b_stays) || !CGAL::Euler::does_satisfy_link_condition(e, mesh)) return false;
  const bool a_is_first = order_of(pa) < order_of(pb);
  const auto to = [&](Vec3 kept) {
    if (!can_move(mesh, a, b, kept, ignored_mm) || !can_move(mesh, b, a, kept, ignored_mm))
      return false;
    const Vertex v = CGAL::Euler::collapse_edge(e, mesh);
    mesh.point(v) = {kept.x, kept.y, kept.z};
    return true;
  };
  const bool keep_a = a_stays || (!b_stays && a_is_first == (keep != Keep::last));
  if (to(keep_a ? pa : pb)) return true;
  return keep == Keep::either && !a_stays && !b_stays && to(keep_a ? pb : pa);
}

/// In the order of their places: CGAL numbers edges by where they lie in memory.
void collapse_short_edges(Mesh& mesh, const Stays& stays, bool keep_first) {
  for (int round = 0; round < kRounds; ++round) {
    std::vector<Edge> edges;
    for (const Edge e : mesh.edges())
      if (length_of(mesh, e) < kShortestEdge_mm) edges.push_back(e);
    const auto key = [&](Edge e) {
      return key_of(std::array{place(mesh, mesh.vertex(e, 0)), place(mesh, mesh.vertex(e, 1))});
    };
    std::sort(edges.begin(), edges.end(), [&](Edge a, Edge b) { return key(a) < key(b); });
    bool any = false;
    for (const Edge e : edges)
      if (!mesh.is_removed(e) && length_of(mesh, e) < kShortestEdge_mm)
        any = collapse(mesh, stays, e, keep_first ? Keep::first : Keep::last, 0.0) || any;
    if (!any) return;
  }
}

/// Turns the longest edge if both triangles are then higher than this one and lie in the
/// neighbour's plane, which is that of both, as the third corner lies on its edge.
bool turn(Mesh& mesh, Face f) {
  const double low = height_of(mesh, f);
  Halfedge longest = mesh.halfedge(f);
  for (const Halfedge h : CGAL::halfedges_around_face(mesh.halfedge(f), mesh))
    if (length_of(mesh, mesh.edge(h)) > length_of(mesh, mesh.edge(longest))) longest = h;
  const Halfedge other = mesh.opposite(longest);
  const Vertex a = mesh.source(longest), b = mesh.target(longest),
               c = mesh.target(mesh.next(longest)), d = mesh.target(mesh.next(other));
  const Vec3 pa = place(mesh, a), pb = place(mesh, b), pc = place(mesh, c), pd = place(mesh, d);
  if (mesh.halfedge(c, d) != Mesh::null_halfedge()) return false;
  const Vec3 normal = area_vector(pb, pa, pd);
  if (!(dot(area_vector(pc, pa, pd), normal) > 0.0) ||
      !(dot(area_vector(pb, pc, pd), normal) > 0.0) ||
      !(std::fmin(lowest_height(pc, pa, pd), lowest_height(pb, pc, pd)) > low))
    return false;
  CGAL::Euler::flip_edge(longest, mesh);
  return true;
}

/// Moves the surface by no more than kLowestTriangle_mm.
void turn_flat_triangles(Mesh& mesh) {
  for (int round = 0; round < kRounds; ++round) {
    std::vector<Face> flat;
    for (const Face f : mesh.faces())
      if (height_of(mesh, f) < kLowestTriangle_mm) flat.push_back(f);
    sort_by_place(mesh, flat);
    bool any = false;
    for (const Face f : flat)  // one may have been turned as another one's neighbour
      if (height_of(mesh, f) < kLowestTriangle_mm) any = turn(mesh, f) || any;
    if (!any) return;
  }
}

// ---- what rounding spoils --------------------------------------------------------

/// Triangles without area, and of two that cut each other the lower one. Coordinates that the
/// rounding leaves as they are were looked at before.
std::vector<Face> spoilt_by(const Mesh& mesh, CoordinateRounding rounding) {
  std::vector<UnionKernel::Point_3> points(mesh.num_vertices());
  bool any_moves = rounding == CoordinateRounding::none;
  for (const Vertex v : mesh.vertices()) {
    const Vec3 p = place(mesh, v);
    const Vec3 q{rounded(p.x, rounding), rounded(p.y, rounding), rounded(p.z, rounding)};
    points[v] = {q.x, q.y, q.z};
    any_moves = any_moves || q != p;
  }
  if (!any_moves) return {};
  std::vector<Face> spoilt;
  for (const Face f : mesh.faces()) {
    const Halfedge h = mesh.halfedge(f);
    if (CGAL::collinear(points[mesh.source(h)], points[mesh.target(h)],
                        points[mesh.target(mesh.next(h))]))
      spoilt.push_back(f);
  }
  if (spoilt.empty()) {
    std::vector<std::pair<Face, Face>> pairs;
    pmp::self_intersections<CGAL::Parallel_if_available_tag>(
        faces(mesh), mesh, std::back_inserter(pairs),
        CGAL::parameters::vertex_point_map(CGAL::make_property_map(points)));
    for (const auto& [a, b] : pairs) {
      const auto key = [&](Face f) {
        return std::pair{height_of(mesh, f), key_of(corners_of(mesh, f))};
      };
      spoilt.push_back(key(a) < key(b) ? a : b);
    }
  }
  std::sort(spoilt.begin(), spoilt.end());
  spoilt.erase(std::unique(spoilt.begin(), spoilt.end()), spoilt.end());
  sort_by_place(mesh, spoilt);
  return spoilt;
}

/// By collapsing the shortest edge, or else by turning the longest.
bool mend(Mesh& mesh, const Stays& stays, Face f, bool keep_first) {
  if (mesh.is_removed(f)) return true;
  Edge shortest = mesh.edge(mesh.halfedge(f));
  for (const Halfedge h : CGAL::halfedges_around_face(mesh.halfedge(f), mesh))
    if (length_of(mesh, mesh.edge(h)) < length_of(mesh, shortest)) shortest = mesh.edge(h);
  if (length_of(mesh, shortest) < kLongestMended_mm &&
      (collapse(mesh, stays, shortest, keep_first ? Keep::first : Keep::last, kShortestEdge_mm) ||
       collapse(mesh, stays, shortest, Keep::either, kShortestEdge_mm)))
    return true;
  return height_of(mesh, f) < kShortestEdge_mm && turn(mesh, f);
}

}  // namespace

void tidy(Mesh& mesh, const Stays& stays, bool keep_first) {
  collapse_short_edges(mesh, stays, keep_first);
  turn_flat_triangles(mesh);
  mesh.collect_garbage();
}

void round_places(Mesh& mesh, const Stays& stays) {
  constexpr auto kTo = CoordinateRounding::float32;
  for (const Vertex v : mesh.vertices()) {
    const Vec3 p = place(mesh, v);
    if (!stays(p)) mesh.point(v) = {rounded(p.x, kTo), rounded(p.y, kTo), rounded(p.z, kTo)};
  }
}

bool mend_for_files(Mesh& mesh, const Stays& stays, bool keep_first) {
  constexpr int kMostRounds = 12;
  int round = 0;
  for (bool sound = false; !sound;) {
    sound = true;
    for (const auto rounding : {CoordinateRounding::none, CoordinateRounding::float32,
                                CoordinateRounding::micro, CoordinateRounding::lib3mf}) {
      const std::vector<Face> spoilt = spoilt_by(mesh, rounding);
      if (spoilt.empty()) continue;
      if (++round > kMostRounds) return false;
      bool any = false;
      for (const Face f : spoilt) any = mend(mesh, stays, f, keep_first) || any;
      if (!any) return false;
      tidy(mesh, stays, keep_first);
      sound = false;
      break;
    }
  }
  return true;
}

}  // namespace maquette::meshing::detail
