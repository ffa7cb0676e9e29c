// SPDX-License-Identifier: GPL-3.0-or-later
// Boolean union by corefinement with exact constructions, of which the double nearest to each new
// vertex is kept: S. Loriot, J. Tournois, I. Yaz, "Polygon mesh processing", CGAL 5.5 manual; the
// predicates are those of CGAL's filtered kernel.
#define CGAL_LINKED_WITH_TBB 1
#include "meshing/detail/exact_union.hpp"

#include <algorithm>
#include <cmath>

#include <CGAL/Polygon_mesh_processing/connected_components.h>
#include <CGAL/Polygon_mesh_processing/corefinement.h>
#include <CGAL/Polygon_mesh_processing/measure.h>
#include <CGAL/Polygon_mesh_processing/polygon_soup_to_polygon_mesh.h>
#include <CGAL/Polygon_mesh_processing/self_intersections.h>
#include <fmt/format.h>

#include "meshing/coordinate_rounding.hpp"
#include "meshing/detail/patch_soundness.hpp"
#include "meshing/detail/union_mesh.hpp"

namespace maquette::meshing::detail {
namespace {

namespace pmp = CGAL::Polygon_mesh_processing;
using heightmap::ModelField;
using Kernel = UnionKernel;
using Mesh = UnionMesh;
using Vertex = Mesh::Vertex_index;
using Face = Mesh::Face_index;

/// Ways to make the united mesh fit for use, the best first.
struct Attempt {
  bool for_files;  ///< vertices where files can have them, and proven as files will have it
  bool tidied, keep_first;
};
constexpr Attempt kAttempts[] = {{true, true, true},
                                 {true, true, false},
                                 {false, true, true},
                                 {false, true, false},
                                 {false, false, true}};

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
Mesh body_of(const TriMesh& stone, Vec3 shift, CoordinateRounding rounding) {
  std::vector<Kernel::Point_3> points;
  for (const Vec3& v : stone.vertices_mm) {
    const Vec3 p =
        Vec3{rounded(v.x, rounding), rounded(v.y, rounding), rounded(v.z, rounding)} + shift;
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

/// With the coordinates that a file will have, so that these are what is united; a stone that they
/// spoil has its own.
Mesh body_of(const TriMesh& stone, Vec3 shift, bool near) {
  Mesh mesh;
  if (near) mesh = body_of(stone, shift, CoordinateRounding::float32);
  return mesh.is_empty() ? body_of(stone, shift, CoordinateRounding::none) : mesh;
}

bool is_near(const StoneCluster& cluster) {
  const auto near = [](double x) { return std::abs(x) <= kFarthestRounded_mm; };
  return std::all_of(cluster.stones.begin(), cluster.stones.end(), [&](const TriMesh* stone) {
    const Box3 box = stone->bounds();
    return near(box.min.x) && near(box.max.x) && near(box.min.y) && near(box.max.y) &&
           near(box.min.z) && near(box.max.z);
  });
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
  const bool near = is_near(cluster);
  double times = 0.0;  // each stone a little farther, so that they move against each other, too
  for (const TriMesh* stone : cluster.stones) {
    Mesh body = body_of(*stone, (times += 1.0) * shift, near);
    if (body.is_empty()) return ExactUnion{{}, "a stone cuts itself or is no manifold"};
    if (!pmp::corefine_and_compute_union(whole, body, whole))
      return ExactUnion{{}, "they touch in a line or a point only"};
  }
  whole.collect_garbage();
  if (!keep_outer_shell(whole, terrain)) return fail(kNotASolid, std::string(kHangsInTheAir));
  whole.collect_garbage();
  if (whole.number_of_faces() == faces_before) return ExactUnion{};  // all is buried
  const Stays stays = [&terrain](Vec3 p) {
    return terrain.node_at(p) != Patch::kNotANode || terrain.is_base(p);
  };
  // What is tidied may come to cut a neighbour in a narrow crevice: then it is tidied the other
  // way, or left as it is.
  ExactUnion united;
  for (const Attempt& attempt : kAttempts) {
    if (attempt.for_files && !near) continue;
    Mesh tidied = whole;
    if (attempt.tidied) tidy(tidied, stays, attempt.keep_first);
    united = {};
    united.spoilt_in_files = near && !attempt.for_files;
    if (attempt.for_files) {
      round_places(tidied, stays);
      tidy(tidied, stays, attempt.keep_first);
      if (!mend_for_files(tidied, stays, attempt.keep_first)) continue;
    } else if (pmp::does_self_intersect<CGAL::Parallel_if_available_tag>(tidied)) {
      united.why_not = "rounding made triangles cut each other";
    }
    if (united.why_not.empty()) united.why_not = take_sheet(tidied, terrain, united.patch);
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
