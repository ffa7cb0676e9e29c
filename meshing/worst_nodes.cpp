// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <array>
#include <cmath>
#include <queue>
#include <vector>

#include "meshing/detail/terrain_fit.hpp"

namespace maquette::meshing::detail {
namespace {

using Vertex = TerrainMesh::Vertex;
using Triangle = TerrainMesh::Triangle;
constexpr std::uint32_t kNone = TerrainMesh::kNone;
constexpr int kParts = TerrainMesh::kParts;

class WorstNodes {
 public:
  WorstNodes(TerrainMesh& mesh, std::uint64_t triangles, const RunContext& run)
      : mesh_(mesh), most_(triangles), run_(run) {}

  void go() {
    // Only the worst wait in the queue: from three times the rms on, then less.
    constexpr double kFirst = 3.0, kNext = 0.7, kLast = 0.01;
    double squares = 0.0;
    for (std::uint32_t t = 0; t < mesh_.triangles().size(); ++t)
      squares += static_cast<double>(mesh_.triangles()[t].squares);
    const double rms = std::sqrt(squares / static_cast<double>(mesh_.field().z_mm.cells().size()));
    for (double share = kFirst; share > kLast && room() && !run_.stopped(); share *= kNext)
      insert_above(static_cast<float>(share * rms));
  }

 private:
  [[nodiscard]] bool room() { return mesh_.triangles().size() + 2 <= most_; }

  void insert_above(float off_mm) {
    std::priority_queue<std::pair<float, std::uint32_t>> queue;
    const auto rate = [&](std::uint32_t t) {
      const float off = mesh_.worst(mesh_.triangles()[t]).off_mm;
      if (off > off_mm) queue.emplace(off, t);
    };
    for (std::uint32_t t = 0; t < mesh_.triangles().size(); ++t)
      // No node is farther off than all of the triangle's together.
      if (reaches(mesh_.triangles()[t], off_mm)) rate(t);
    for (std::uint64_t done = 0; !queue.empty() && room(); ++done) {
      if (done % 1024 == 0 && run_.stopped()) return;
      const auto [off, t] = queue.top();
      queue.pop();
      const auto worst = mesh_.worst(mesh_.triangles()[t]);
      if (worst.off_mm < off) {  // it was changed since, and rated again
        continue;
      }
      if (!insert(t, worst)) continue;
      for (const std::uint32_t changed : changed_) rate(changed);
    }
  }

  /// Nodes on the north and east edges are among another triangle's: those of the border in none.
  [[nodiscard]] bool reaches(const Triangle& t, float off_mm) const {
    if (t.squares >= off_mm * off_mm) return true;
    for (const std::uint32_t v : t.v)
      if (mesh_.on_border(mesh_.vertices()[v])) return true;
    return false;
  }

  bool insert(std::uint32_t t, const TerrainMesh::Worst& node) {
    Vertex at{node.row * kParts, node.col * kParts, mesh_.field().z_mm(node.row, node.col), t};
    const auto v = mesh_.triangles()[t].v;
    std::array<std::int64_t, 3> area{};
    std::size_t least = 0;
    for (std::size_t i = 0; i < 3; ++i) {
      const Vertex& p = mesh_.vertices()[v[i]];
      if (p.row == at.row && p.col == at.col) return lift(v[i], at.z_mm);
      area[i] = detail::doubled_area(mesh_.vertices()[v[(i + 1) % 3]],
                                     mesh_.vertices()[v[(i + 2) % 3]], at);
      if (area[i] < area[least]) least = i;
    }
    changed_.clear();
    if (area[least] < TerrainMesh::kLeastArea && splits_well(t, least, at, area[least])) {
      split_edge(t, least, at);
    } else {
      if (area[least] <= 0) return false;
      split_inside(t, at);
    }
    for (const std::uint32_t i : changed_) mesh_.measure(mesh_.triangles()[i]);
    turn_around();
    return true;
  }

  /// A vertex that is its own worst node gets the node's height.
  bool lift(std::uint32_t v, float z_mm) {
    Vertex& at = mesh_.vertices()[v];
    if (at.z_mm == z_mm) return false;
    at.z_mm = z_mm;
    changed_.clear();
    std::uint32_t t = at.triangle;
    do {
      changed_.push_back(t);
      Triangle& triangle = mesh_.triangles()[t];
      mesh_.measure(triangle);
      const std::size_t k = triangle.v[0] == v ? 0 : triangle.v[1] == v ? 1 : 2;
      t = triangle.n[(k + 1) % 3];
    } while (t != at.triangle);  // border vertices have their nodes' heights
    return true;
  }

  /// Whether the edge can be bent to the node; one of the border only if it is on it.
  bool splits_well(std::uint32_t t, std::size_t edge, const Vertex& at, std::int64_t area) {
    const std::uint32_t u = mesh_.triangles()[t].n[edge];
    if (u == kNone) return area == 0;
    std::size_t j = 0;
    while (mesh_.triangles()[u].n[j] != t) ++j;
    const auto& v = mesh_.triangles()[u].v;
    const auto corner = [&](std::size_t k) -> const Vertex& { return mesh_.vertices()[v[k % 3]]; };
    // u is (d, c, b), the edge c - b.
    return detail::doubled_area(at, corner(j), corner(j + 1)) > 0 &&
           detail::doubled_area(at, corner(j + 2), corner(j)) > 0;
  }

  void split_inside(std::uint32_t t, const Vertex& at) {
    const std::uint32_t p = add(at);
    const Triangle whole = mesh_.triangles()[t];
    const auto [a, b, c] = whole.v;
    const auto [na, nb, nc] = whole.n;
    const std::uint32_t t1 = mesh_.triangles().size(), t2 = t1 + 1;
    set(t, {p, b, c}, {na, t1, t2});
    set(t1, {p, c, a}, {nb, t2, t});
    set(t2, {p, a, b}, {nc, t, t1});
    mesh_.relink(nb, t, t1);
    mesh_.relink(nc, t, t2);
  }

  /// Two triangles become four, at the border one two.
  void split_edge(std::uint32_t t, std::size_t edge, const Vertex& at) {
    const std::uint32_t p = add(at);
    const Triangle whole = mesh_.triangles()[t];
    const std::uint32_t a = whole.v[edge], b = whole.v[(edge + 1) % 3], c = whole.v[(edge + 2) % 3];
    const std::uint32_t u = whole.n[edge], nb = whole.n[(edge + 1) % 3],
                        nc = whole.n[(edge + 2) % 3];
    const std::uint32_t t1 = mesh_.triangles().size(), u1 = u == kNone ? kNone : t1 + 1;
    set(t, {p, c, a}, {nb, t1, u});
    set(t1, {p, a, b}, {nc, u1, t});
    mesh_.relink(nc, t, t1);
    if (u == kNone) return;
    const Triangle far = mesh_.triangles()[u];
    std::size_t j = 0;
    while (far.n[j] != t) ++j;
    const std::uint32_t d = far.v[j], to_b = far.n[(j + 1) % 3], to_c = far.n[(j + 2) % 3];
    set(u, {p, d, c}, {to_c, t, u1});
    set(u1, {p, b, d}, {to_b, u, t1});
    mesh_.relink(to_b, u, u1);
  }

  std::uint32_t add(const Vertex& at) {
    mesh_.vertices().push_back(at);
    return static_cast<std::uint32_t>(mesh_.vertices().size() - 1);
  }

  void set(std::uint32_t t, std::array<std::uint32_t, 3> v, std::array<std::uint32_t, 3> n) {
    if (t == mesh_.triangles().size()) mesh_.triangles().push({});
    mesh_.triangles()[t].v = v;
    mesh_.triangles()[t].n = n;
    for (const std::uint32_t corner : v) mesh_.vertices()[corner].triangle = t;
    changed_.push_back(t);
  }

  /// Edges opposite of the new vertex, which all in `changed_` have first.
  void turn_around() {
    for (std::size_t i = 0; i < changed_.size(); ++i)
      for (std::uint32_t u = kNone; (u = mesh_.turn(changed_[i], 0)) != kNone;)
        changed_.push_back(u);
  }

  TerrainMesh& mesh_;
  std::uint64_t most_;
  const RunContext& run_;
  std::vector<std::uint32_t> changed_;
};

}  // namespace

void insert_worst(TerrainMesh& mesh, std::uint64_t triangles, const RunContext& run) {
  WorstNodes(mesh, triangles, run).go();
}

}  // namespace maquette::meshing::detail
