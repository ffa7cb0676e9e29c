// SPDX-License-Identifier: GPL-3.0-or-later
// Boolean union by corefinement with exact constructions, of which the double nearest to each new
// vertex is kept: S. Loriot, J. Tournois, I. Yaz, "Polygon mesh processing", CGAL 5.5 manual; the
// predicates are those of CGAL's filtered kernel.
#define CGAL_LINKED_WITH_TBB 1
#include "meshing/detail/exact_union.hpp"

#include <algorithm>
#include <cmath>

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Polygon_mesh_processing/connected_components.h>
#include <CGAL/Polygon_mesh_processing/corefinement.h>
#include <CGAL/Polygon_mesh_processing/measure.h>
#include <CGAL/Polygon_mesh_processing/polygon_soup_to_polygon_mesh.h>
#include <CGAL/Polygon_mesh_processing/self_intersections.h>
#include <CGAL/Surface_mesh.h>
#include <fmt/format.h>

#include "meshing/detail/patch_soundness.hpp"

namespace maquette::meshing::detail {
namespace {

namespace pmp = CGAL::Polygon_mesh_processing;
using heightmap::ModelField;
using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Mesh = CGAL::Surface_mesh<Kernel::Point_3>;
using Vertex = Mesh::Vertex_index;
using Halfedge = Mesh::Halfedge_index;
using Face = Mesh::Face_index;

Vec3 place(const Mesh& mesh, Vertex v) {
  const auto& p = mesh.point(v);
  return {p.x(), p.y(), p.z()};
}

std::array<Vec3, 3> corners_of(const Mesh& mesh, Face f) {
  const Halfedge h = mesh.halfedge(f);
  return {place(mesh, mesh.source(h)), place(mesh, mesh.target(h)),
          place(mesh, mesh.target(mesh.next(h)))};
}

enum class Tidy { to_first, to_last, not_at_all };

auto order_of(Vec3 p) {
  return std::array{p.y, p.x, p.z};
}

/// The cells under the stones and one more on each side, as far as the field goes.
CellBlock block_under(const ModelField& field, const StoneCluster& cluster) {
  Box3 box;
  for (const TriMesh* stone : cluster.stones)
    for (const Vec3& v : stone->vertices_mm) box.add(v);
  const double s = field.spacing.value();
  const auto cell = [s](double x, double x0) {
    return static_cast<std::ptrdiff_t>(std::floor((x - x0) / s));
  };
  return {std::max<std::ptrdiff_t>(cell(box.min.y, field.y0.value()) - 1, 0),
          std::min(cell(box.max.y, field.y0.value()) + 2, field.z_mm.rows() - 1),
          std::max<std::ptrdiff_t>(cell(box.min.x, field.x0.value()) - 1, 0),
          std::min(cell(box.max.x, field.x0.value()) + 2, field.z_mm.cols() - 1)};
}

/// A part of the field as it is, closed by walls and a base of one fan.
class TerrainBlock {
 public:
  TerrainBlock(const ModelField& field, const StoneCluster& cluster)
      : field_(field), block_(block_under(field, cluster)) {
    double lowest = INFINITY;
    for (std::ptrdiff_t r = block_.row0; r <= block_.row1; ++r)
      for (std::ptrdiff_t c = block_.col0; c <= block_.col1; ++c)
        lowest = std::fmin(lowest, static_cast<double>(field.z_mm(r, c)));
    for (const TriMesh* stone : cluster.stones) lowest = std::fmin(lowest, stone->bounds().min.z);
    base_z_mm_ = lowest - 1.0;
  }

  [[nodiscard]] const CellBlock& block() const { return block_; }
  [[nodiscard]] bool is_base(Vec3 p) const { return p.z == base_z_mm_; }

  [[nodiscard]] Mesh solid() const {
    ModelField part{Grid<float>(block_.row1 - block_.row0 + 1, block_.col1 - block_.col0 + 1),
                    field_.spacing, Millimetres{field_.x_mm(block_.col0)},
                    Millimetres{field_.y_mm(block_.row0)}};
    for (std::ptrdiff_t r = 0; r < part.z_mm.rows(); ++r)
      for (std::ptrdiff_t c = 0; c < part.z_mm.cols(); ++c)
        part.z_mm(r, c) = field_.z_mm(block_.row0 + r, block_.col0 + c);
    TriMesh shell = *close_shell(part, base_z_mm_, {}, {});
    // The whole field's coordinates, which differ from x0 + n spacing by rounding.
    const std::ptrdiff_t cols = part.z_mm.cols();
    for (std::ptrdiff_t r = 0; r < part.z_mm.rows(); ++r)
      for (std::ptrdiff_t c = 0; c < cols; ++c) {
        Vec3& v = shell.vertices_mm[static_cast<std::size_t>(r * cols + c)];
        v.x = field_.x_mm(block_.col0 + c);
        v.y = field_.y_mm(block_.row0 + r);
      }
    Mesh mesh;
    for (const Vec3& v : shell.vertices_mm) mesh.add_vertex({v.x, v.y, v.z});
    for (const auto& t : shell.triangles) mesh.add_face(Vertex(t[0]), Vertex(t[1]), Vertex(t[2]));
    return mesh;
  }

  /// row * cols + col of the node that lies there to the bit, or kNotANode.
  [[nodiscard]] std::uint32_t node_at(Vec3 p) const {
    const double s = field_.spacing.value();
    const auto c = static_cast<std::ptrdiff_t>(std::lround((p.x - field_.x0.value()) / s));
    const auto r = static_cast<std::ptrdiff_t>(std::lround((p.y - field_.y0.value()) / s));
    if (r < block_.row0 || r > block_.row1 || c < block_.col0 || c > block_.col1 ||
        p.x != field_.x_mm(c) || p.y != field_.y_mm(r) ||
        p.z != static_cast<double>(field_.z_mm(r, c)))
      return Patch::kNotANode;
    return static_cast<std::uint32_t>(r * field_.z_mm.cols() + c);
  }

 private:
  const ModelField& field_;
  CellBlock block_;
  double base_z_mm_ = 0.0;
};

/// @return empty if CGAL takes it for no manifold mesh or it cuts itself
Mesh body_of(const TriMesh& stone, Vec3 shift) {
  std::vector<Kernel::Point_3> points;
  for (const Vec3& v : stone.vertices_mm) {
    const Vec3 p = v + shift;
    points.emplace_back(p.x, p.y, p.z);
  }
  std::vector<std::array<std::size_t, 3>> faces;
  for (const auto& t : stone.triangles) faces.push_back({t[0], t[1], t[2]});
  Mesh mesh;
  if (!pmp::is_polygon_soup_a_polygon_mesh(faces)) return mesh;
  pmp::polygon_soup_to_polygon_mesh(points, faces, mesh);
  if (pmp::does_self_intersect<CGAL::Parallel_if_available_tag>(mesh)) mesh.clear();
  return mesh;
}

// ---- short edges ---------------------------------------------------------------

Vec3 area_vector(Vec3 a, Vec3 b, Vec3 c) {
  return cross(b - a, c - a);
}

/// Where `from` goes to `to`: false if a triangle that stays would turn over.
bool can_move(const Mesh& mesh, Vertex from, Vertex to, Vec3 place_of_both) {
  for (const Halfedge h : CGAL::halfedges_around_target(from, mesh)) {
    if (mesh.is_border(h)) continue;
    const Vertex a = mesh.target(mesh.next(h)), b = mesh.source(h);
    if (a == to || b == to) continue;  // goes away
    const Vec3 pa = place(mesh, a), pb = place(mesh, b);
    const Vec3 before = area_vector(place(mesh, from), pa, pb);
    const Vec3 after = area_vector(place_of_both, pa, pb);
    if (!(dot(before, after) > 0.0)) return false;
  }
  return true;
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

/// Collapses edges shorter than kShortestEdge_mm. Nodes stay where they are, of two other ends the
/// first or the last. In the order of their places: CGAL numbers them by where they lie in memory.
void collapse_short_edges(Mesh& mesh, const TerrainBlock& terrain, bool keep_first) {
  constexpr int kRounds = 4;
  const auto length = [&](Mesh::Edge_index e) {
    return norm(place(mesh, mesh.vertex(e, 0)) - place(mesh, mesh.vertex(e, 1)));
  };
  for (int round = 0; round < kRounds; ++round) {
    std::vector<Mesh::Edge_index> edges;
    for (const auto e : mesh.edges())
      if (length(e) < kShortestEdge_mm) edges.push_back(e);
    const auto key = [&](Mesh::Edge_index e) {
      return key_of(std::array{place(mesh, mesh.vertex(e, 0)), place(mesh, mesh.vertex(e, 1))});
    };
    std::sort(edges.begin(), edges.end(), [&](auto a, auto b) { return key(a) < key(b); });
    bool any = false;
    for (const auto e : edges) {
      if (mesh.is_removed(e) || !(length(e) < kShortestEdge_mm)) continue;
      const Vertex a = mesh.vertex(e, 0), b = mesh.vertex(e, 1);
      const Vec3 pa = place(mesh, a), pb = place(mesh, b);
      const auto stays = [&](Vec3 p) {
        return terrain.node_at(p) != Patch::kNotANode || terrain.is_base(p);
      };
      if (stays(pa) && stays(pb)) continue;
      const bool keep_a = stays(pa) || (!stays(pb) && (order_of(pa) < order_of(pb)) == keep_first);
      const Vec3 kept = keep_a ? pa : pb;
      if (!CGAL::Euler::does_satisfy_link_condition(e, mesh) || !can_move(mesh, a, b, kept) ||
          !can_move(mesh, b, a, kept))
        continue;
      const Vertex v = CGAL::Euler::collapse_edge(e, mesh);
      mesh.point(v) = {kept.x, kept.y, kept.z};
      any = true;
    }
    if (!any) return;
  }
}

double lowest_height(Vec3 a, Vec3 b, Vec3 c) {
  const double longest = std::fmax(norm(b - a), std::fmax(norm(c - b), norm(a - c)));
  return norm(area_vector(a, b, c)) / longest;
}

/// Turns the longest edge of triangles lower than kLowestTriangle_mm, which moves the surface by no
/// more than that.
void turn_flat_triangles(Mesh& mesh) {
  constexpr int kRounds = 4;
  const auto height_of = [&](Face f) {
    const auto [a, b, c] = corners_of(mesh, f);
    return lowest_height(a, b, c);
  };
  for (int round = 0; round < kRounds; ++round) {
    std::vector<Face> flat;
    for (const Face f : mesh.faces())
      if (height_of(f) < kLowestTriangle_mm) flat.push_back(f);
    std::sort(flat.begin(), flat.end(), [&](Face a, Face b) {
      return key_of(corners_of(mesh, a)) < key_of(corners_of(mesh, b));
    });
    bool any = false;
    for (const Face f : flat) {
      const double low = height_of(f);
      if (!(low < kLowestTriangle_mm)) continue;  // was turned as another one's neighbour
      Halfedge longest = mesh.halfedge(f);
      for (const Halfedge h : CGAL::halfedges_around_face(mesh.halfedge(f), mesh)) {
        const auto length = [&](Halfedge e) {
          return norm(place(mesh, mesh.source(e)) - place(mesh, mesh.target(e)));
        };
        if (length(h) > length(longest)) longest = h;
      }
      const Halfedge other = mesh.opposite(longest);
      const Vertex a = mesh.source(longest), b = mesh.target(longest),
                   c = mesh.target(mesh.next(longest)), d = mesh.target(mesh.next(other));
      const Vec3 pa = place(mesh, a), pb = place(mesh, b), pc = place(mesh, c), pd = place(mesh, d);
      if (mesh.halfedge(c, d) != Mesh::null_halfedge()) continue;
      // The neighbour's plane is that of both, as c lies on its edge.
      const Vec3 normal = area_vector(pb, pa, pd);
      if (!(dot(area_vector(pc, pa, pd), normal) > 0.0) ||
          !(dot(area_vector(pb, pc, pd), normal) > 0.0) ||
          !(std::fmin(lowest_height(pc, pa, pd), lowest_height(pb, pc, pd)) > low))
        continue;
      CGAL::Euler::flip_edge(longest, mesh);
      any = true;
    }
    if (!any) return;
  }
}

// ---- the sheet -------------------------------------------------------------------

/// Drops pockets of air. @return false if something hangs in the air
bool keep_outer_shell(Mesh& mesh, const TerrainBlock& terrain) {
  auto shell_of = mesh.add_property_map<Face, std::uint32_t>("f:shell", 0).first;
  const auto shells = static_cast<std::uint32_t>(pmp::connected_components(mesh, shell_of));
  bool sound = true;
  if (shells > 1) {
    std::vector<double> volume(shells, 0.0);
    std::uint32_t outer = shells;
    for (const Face f : mesh.faces()) {
      const auto [a, b, c] = corners_of(mesh, f);
      volume[shell_of[f]] += dot(a, cross(b, c));
      if (terrain.is_base(a)) outer = shell_of[f];
    }
    for (std::uint32_t s = 0; s < shells; ++s) sound = sound && (s == outer || volume[s] < 0.0);
    if (sound) pmp::keep_connected_components(mesh, std::vector<std::uint32_t>{outer}, shell_of);
  }
  mesh.remove_property_map(shell_of);
  return sound;
}

/// Without walls and base; vertices by their places and triangles by their vertices, so that
/// nothing is left of the order in which they were found.
/// @return empty, or what is wrong
std::string take_sheet(const Mesh& mesh, const TerrainBlock& terrain, Patch& patch) {
  patch.block = terrain.block();
  std::vector<std::array<Vertex, 3>> kept;
  std::vector<char> used(mesh.num_vertices() + mesh.number_of_removed_vertices(), 0);
  for (const Face f : mesh.faces()) {
    std::array<Vertex, 3> corner;
    std::size_t i = 0;
    bool wall = false;
    for (const Vertex v : mesh.vertices_around_face(mesh.halfedge(f))) {
      corner[i++] = v;
      wall = wall || terrain.is_base(place(mesh, v));
    }
    if (wall) continue;
    kept.push_back(corner);
    for (const Vertex v : corner) used[v] = 1;
  }
  std::vector<Vertex> order;
  for (const Vertex v : mesh.vertices())
    if (used[v]) order.push_back(v);
  std::sort(order.begin(), order.end(), [&](Vertex a, Vertex b) {
    return order_of(place(mesh, a)) < order_of(place(mesh, b));
  });
  std::vector<std::uint32_t> renamed(used.size(), 0);
  std::vector<std::uint32_t> nodes;
  for (const Vertex v : order) {
    renamed[v] = static_cast<std::uint32_t>(patch.node.size());
    const Vec3 p = place(mesh, v);
    patch.node.push_back(terrain.node_at(p));
    patch.mesh.vertices_mm.push_back(p);
    if (patch.node.back() != Patch::kNotANode) nodes.push_back(patch.node.back());
  }
  std::sort(nodes.begin(), nodes.end());
  if (std::adjacent_find(nodes.begin(), nodes.end()) != nodes.end())
    return "two sheets meet in a node";
  for (const auto& c : kept) {
    std::array<std::uint32_t, 3> t{renamed[c[0]], renamed[c[1]], renamed[c[2]]};
    std::rotate(t.begin(), std::min_element(t.begin(), t.end()), t.end());
    const auto& p = patch.mesh.vertices_mm;
    if (CGAL::collinear(Kernel::Point_3(p[t[0]].x, p[t[0]].y, p[t[0]].z),
                        Kernel::Point_3(p[t[1]].x, p[t[1]].y, p[t[1]].z),
                        Kernel::Point_3(p[t[2]].x, p[t[2]].y, p[t[2]].z)))
      return "a triangle has no area";
    patch.mesh.triangles.push_back(t);
  }
  std::sort(patch.mesh.triangles.begin(), patch.mesh.triangles.end());
  return {};
}

}  // namespace

Result<ExactUnion> unite_exactly(const ModelField& surface, const StoneCluster& cluster,
                                 Vec3 shift) try {
  const TerrainBlock terrain(surface, cluster);
  Mesh whole = terrain.solid();
  const auto faces_before = whole.number_of_faces();
  double times = 0.0;  // each stone a little farther, so that they move against each other, too
  for (const TriMesh* stone : cluster.stones) {
    Mesh body = body_of(*stone, (times += 1.0) * shift);
    if (body.is_empty()) return ExactUnion{{}, "a stone cuts itself or is no manifold"};
    if (!pmp::corefine_and_compute_union(whole, body, whole))
      return ExactUnion{{}, "they touch in a line or a point only"};
  }
  whole.collect_garbage();
  if (!keep_outer_shell(whole, terrain)) return fail(kNotASolid, std::string(kHangsInTheAir));
  whole.collect_garbage();
  if (whole.number_of_faces() == faces_before) return ExactUnion{};  // all is buried
  // What is tidied may come to cut a neighbour in a narrow crevice: then it is tidied the other
  // way, or left as it is.
  ExactUnion united;
  for (const Tidy how : {Tidy::to_first, Tidy::to_last, Tidy::not_at_all}) {
    Mesh tidied = whole;
    if (how != Tidy::not_at_all) {
      collapse_short_edges(tidied, terrain, how == Tidy::to_first);
      turn_flat_triangles(tidied);
      tidied.collect_garbage();
    }
    united.patch = {};
    united.why_not = take_sheet(tidied, terrain, united.patch);
    if (united.why_not.empty() && pmp::does_self_intersect<CGAL::Parallel_if_available_tag>(tidied))
      united.why_not = "rounding made triangles cut each other";
    std::vector<Vec3> no_goal = united.patch.mesh.vertices_mm;
    if (united.why_not.empty())
      united.why_not = keep_manifold_sheet(surface, united.patch, no_goal);
    if (united.why_not.empty()) break;
  }
  return united;
} catch (const std::exception& e) {
  return ExactUnion{{}, fmt::format("CGAL: {}", e.what())};
}

}  // namespace maquette::meshing::detail
