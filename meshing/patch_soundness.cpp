// SPDX-License-Identifier: GPL-3.0-or-later
#define CGAL_LINKED_WITH_TBB 1
#include "meshing/detail/patch_soundness.hpp"

#include <algorithm>

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Polygon_mesh_processing/self_intersections.h>
#include <CGAL/Surface_mesh.h>

namespace maquette::meshing::detail {
namespace {

using heightmap::ModelField;
using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Triangle = std::array<std::uint32_t, 3>;
using EdgeTable = std::unordered_map<Edge, std::uint32_t, EdgeHash>;  // directed edge -> triangle

Vec3 area_vector(const std::vector<Vec3>& p, const Triangle& t) {
  return cross(p[t[1]] - p[t[0]], p[t[2]] - p[t[0]]);
}

/// Triangles that cut another one.
std::vector<std::uint32_t> cut_triangles(const TriMesh& mesh) {
  using Mesh = CGAL::Surface_mesh<Kernel::Point_3>;
  Mesh cgal;
  for (const Vec3& v : mesh.vertices_mm) cgal.add_vertex({v.x, v.y, v.z});
  for (const Triangle& t : mesh.triangles)
    cgal.add_face(Mesh::Vertex_index(t[0]), Mesh::Vertex_index(t[1]), Mesh::Vertex_index(t[2]));
  std::vector<std::pair<Mesh::Face_index, Mesh::Face_index>> pairs;
  CGAL::Polygon_mesh_processing::self_intersections<CGAL::Parallel_if_available_tag>(
      cgal, std::back_inserter(pairs));
  std::vector<std::uint32_t> cut;
  for (const auto& [a, b] : pairs) {
    cut.push_back(a);
    cut.push_back(b);
  }
  std::sort(cut.begin(), cut.end());
  cut.erase(std::unique(cut.begin(), cut.end()), cut.end());
  return cut;
}

}  // namespace

std::string keep_manifold_sheet(const ModelField& field, Patch& patch, std::vector<Vec3>& goal) {
  std::vector<Triangle>& triangles = patch.mesh.triangles;
  EdgeTable table;
  const auto fill = [&] {
    table.clear();
    table.reserve(3 * triangles.size());
    for (std::uint32_t t = 0; t < triangles.size(); ++t)
      for (std::size_t i = 0; i < 3; ++i)
        if (!table.try_emplace({triangles[t][i], triangles[t][(i + 1) % 3]}, t).second)
          return false;
    return true;
  };
  if (!fill()) return "an edge has more than two triangles";
  std::vector<std::uint32_t> queue;
  std::vector<char> reached(triangles.size(), 0);
  for (const auto& [e, t] : table)
    if (!table.contains({e[1], e[0]}) && !reached[t]) {
      if (patch.node[e[0]] == Patch::kNotANode) return "a hole stayed open";
      reached[t] = 1;
      queue.push_back(t);
    }
  while (!queue.empty()) {
    const Triangle t = triangles[queue.back()];
    queue.pop_back();
    for (std::size_t i = 0; i < 3; ++i)
      if (const auto it = table.find({t[(i + 1) % 3], t[i]});
          it != table.end() && !reached[it->second]) {
        reached[it->second] = 1;
        queue.push_back(it->second);
      }
  }
  std::size_t kept = 0;
  for (std::size_t t = 0; t < triangles.size(); ++t)
    if (reached[t]) triangles[kept++] = triangles[t];
  triangles.resize(kept);
  fill();

  // Border: exactly the block's, once round.
  const std::ptrdiff_t cols = field.z_mm.cols();
  std::size_t border = 0;
  for (const auto& [e, t] : table) {
    if (table.contains({e[1], e[0]})) continue;
    ++border;
    for (const std::uint32_t v : e) {
      if (patch.node[v] == Patch::kNotANode) return "a hole stayed open";
      const std::ptrdiff_t r = patch.node[v] / cols;
      const std::ptrdiff_t c = patch.node[v] % cols;
      const CellBlock& b = patch.block;
      if (r != b.row0 && r != b.row1 && c != b.col0 && c != b.col1) return "a hole stayed open";
    }
  }
  const CellBlock& b = patch.block;
  if (border != static_cast<std::size_t>(2 * (b.row1 - b.row0 + b.col1 - b.col0)))
    return "its border is not the block's";

  // Vertices: walk round from one triangle; all triangles must be met.
  std::vector<std::uint32_t> count(patch.node.size(), 0), some(patch.node.size(), 0);
  for (std::uint32_t t = 0; t < triangles.size(); ++t)
    for (const std::uint32_t v : triangles[t]) {
      ++count[v];
      some[v] = t;
    }
  for (std::uint32_t v = 0; v < count.size(); ++v) {
    if (count[v] == 0) continue;
    const auto corner = [&](std::uint32_t t) {
      return static_cast<std::size_t>(std::find(triangles[t].begin(), triangles[t].end(), v) -
                                      triangles[t].begin());
    };
    std::uint32_t met = 1;
    for (const bool forward : {true, false}) {
      std::uint32_t t = some[v];
      for (;;) {
        const std::size_t i = corner(t);
        const Edge across =
            forward ? Edge{v, triangles[t][(i + 2) % 3]} : Edge{triangles[t][(i + 1) % 3], v};
        const auto next = table.find(across);
        if (next == table.end() || next->second == some[v]) {
          t = next == table.end() ? Patch::kNotANode : next->second;
          break;
        }
        t = next->second;
        ++met;
      }
      if (t == some[v]) break;  // once round
    }
    if (met != count[v]) return "two parts touch in a vertex only";
  }
  // Vertices of dropped pockets.
  std::vector<std::uint32_t> renamed(patch.node.size(), 0);
  std::uint32_t used = 0;
  for (std::uint32_t v = 0; v < count.size(); ++v)
    if (count[v] > 0) {
      renamed[v] = used;
      patch.node[used] = patch.node[v];
      goal[used] = goal[v];
      patch.mesh.vertices_mm[used++] = patch.mesh.vertices_mm[v];
    } else {
      renamed[v] = Patch::kNotANode;
    }
  patch.node.resize(used);
  goal.resize(used);
  patch.mesh.vertices_mm.resize(used);
  for (Triangle& t : triangles)
    for (std::uint32_t& v : t) v = renamed[v];
  return {};
}

std::string settle(TriMesh& mesh, const std::vector<Vec3>& goal) {
  const std::vector<Vec3> from = mesh.vertices_mm;
  std::vector<double> share(from.size(), 1.0);
  constexpr int kRounds = 24;
  constexpr double kLeastCosine = 0.1;  // of the turn of a triangle's normal
  constexpr double kLeastArea = 1e-3;   // of its area before
  for (int round = 0; round < kRounds; ++round) {
    for (std::size_t v = 0; v < from.size(); ++v)
      mesh.vertices_mm[v] = share[v] == 1.0   ? goal[v]
                            : share[v] == 0.0 ? from[v]
                                              : from[v] + share[v] * (goal[v] - from[v]);
    std::vector<char> back(from.size(), 0);
    bool sound = true;
    for (const Triangle& t : mesh.triangles) {
      if (share[t[0]] == 0.0 && share[t[1]] == 0.0 && share[t[2]] == 0.0) continue;
      const Vec3 before = area_vector(from, t);
      const Vec3 after = area_vector(mesh.vertices_mm, t);
      if (norm(after) >= kLeastArea * norm(before) &&
          dot(before, after) >= kLeastCosine * norm(before) * norm(after))
        continue;
      for (const std::uint32_t v : t) back[v] = goal[v] != from[v];
      sound = sound && !(back[t[0]] || back[t[1]] || back[t[2]]);
    }
    if (sound) {
      const std::vector<std::uint32_t> cut = cut_triangles(mesh);
      if (cut.empty()) return {};
      for (const std::uint32_t t : cut)
        for (const std::uint32_t v : mesh.triangles[t])
          if (goal[v] != from[v] && share[v] > 0.0) {
            back[v] = 1;
            sound = false;
          }
      if (sound) return "its triangles cut each other";
    }
    for (std::size_t v = 0; v < from.size(); ++v)
      if (back[v]) share[v] = share[v] > 0.2 ? 0.5 * share[v] : 0.0;
  }
  return "its triangles cut each other";
}

}  // namespace maquette::meshing::detail
