// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <array>
#include <cmath>

#include "meshing/detail/terrain_fit.hpp"

namespace maquette::meshing::detail {
namespace {

using Vertex = TerrainMesh::Vertex;
using Triangle = TerrainMesh::Triangle;
constexpr std::uint32_t kNone = TerrainMesh::kNone;
constexpr int kParts = TerrainMesh::kParts;
constexpr float kPart = 1.0F / kParts;

class VertexFit {
 public:
  VertexFit(TerrainMesh& mesh, const RunContext& run) : mesh_(mesh), run_(run) {}

  void go() {
    // More rounds bring 1 % each; edges settle earlier.
    constexpr int kRounds = 7;
    find_triangles();
    for (int round = 0; round < kRounds; ++round) {
      measure_all();
      if (round % 3 == 0) turn_all();
      if (run_.stopped()) return;
      for (std::uint32_t v = 0; v < mesh_.vertices().size(); ++v) move(v, true);
    }
    // Heights alone, for where the vertices are now.
    measure_all();
    for (int sweep = 0; sweep < 2 && !run_.stopped(); ++sweep)
      for (std::uint32_t v = 0; v < mesh_.vertices().size(); ++v) move(v, false);
    measure_all();
  }

 private:
  static constexpr std::size_t kMostAround = 24;

  /// A triangle around the vertex: its corner there, area in cells, slope.
  struct Around {
    std::uint32_t triangle;
    std::uint32_t corner;
    float area, per_col, per_row;
  };
  /// What the sum of squares is about at a vertex: gradient, and products of the surface's
  /// changes with z, x and y.
  struct Local {
    float z = 0, x = 0, y = 0, zz = 0, zx = 0, zy = 0, xx = 0, xy = 0, yy = 0, squares = 0;
  };

  void find_triangles() {
    for (std::uint32_t t = 0; t < mesh_.triangles().size(); ++t)
      for (const std::uint32_t v : mesh_.triangles()[t].v) mesh_.vertices()[v].triangle = t;
  }

  void measure_all() {
    double sum = 0.0;
    for (std::uint32_t t = 0; t < mesh_.triangles().size(); ++t) {
      mesh_.measure(mesh_.triangles()[t]);
      sum += static_cast<double>(mesh_.triangles()[t].squares);
    }
    mean_ = static_cast<float>(sum / mesh_.triangles().size());
  }

  /// Each edge once, where there is something to win.
  void turn_all() {
    for (std::uint32_t t = 0; t < mesh_.triangles().size(); ++t)
      for (std::size_t i = 0; i < 3; ++i) {
        const Triangle& near = mesh_.triangles()[t];
        const std::uint32_t u = near.n[i];
        if (u == kNone || u < t || near.squares + mesh_.triangles()[u].squares < mean_) continue;
        if (mesh_.turn(t, i) != kNone) break;  // the other edges have other corners now
      }
  }

  /// @return how many, 0 if there are too many
  std::size_t look_around(std::uint32_t v, Local& sum) {
    const Vertex& at = mesh_.vertices()[v];
    std::uint32_t t = at.triangle;
    std::size_t count = 0;
    do {
      if (count == kMostAround) return 0;
      const Triangle& triangle = mesh_.triangles()[t];
      const std::uint32_t k = triangle.v[0] == v ? 0U : triangle.v[1] == v ? 1U : 2U;
      const std::uint32_t next = k == 2 ? 0U : k + 1, last = k == 0 ? 2U : k - 1;
      const Vertex &p = mesh_.vertices()[triangle.v[next]], &q = mesh_.vertices()[triangle.v[last]];
      const float r1 = static_cast<float>(p.row - at.row) * kPart,
                  r2 = static_cast<float>(q.row - at.row) * kPart;
      const float c1 = static_cast<float>(p.col - at.col) * kPart,
                  c2 = static_cast<float>(q.col - at.col) * kPart;
      const float z1 = p.z_mm - at.z_mm, z2 = q.z_mm - at.z_mm;
      const float doubled = c1 * r2 - r1 * c2, per = 1.0F / doubled;
      const float gx = (z1 * r2 - z2 * r1) * per, gy = (z2 * c1 - z1 * c2) * per;
      around_[count++] = {t, k, 0.5F * doubled, gx, gy};
      // The integral of a corner's share squared is a sixth of the area.
      const float weight = doubled / 12.0F, pull = triangle.pull[k];
      sum.squares += triangle.squares;
      sum.z += pull;
      sum.x -= pull * gx;
      sum.y -= pull * gy;
      sum.zz += weight;
      sum.zx -= weight * gx;
      sum.zy -= weight * gy;
      sum.xx += weight * gx * gx;
      sum.xy += weight * gx * gy;
      sum.yy += weight * gy * gy;
      t = triangle.n[next];
    } while (t != at.triangle);
    return count;
  }

  /// Sideways, in parts: the step of all three coordinates, shortened to half a triangle.
  std::array<std::int32_t, 2> sideways(const Local& s, std::size_t count) const {
    // Damping: as if a node to the side cost a tenth of the mean square under the triangles.
    constexpr float kDamping = 0.1F;
    const float more = kDamping * s.squares / 6.0F;  // squares / (6 zz) is per node
    const float xx = s.xx + more, yy = s.yy + more;
    // Without z, which follows by itself.
    const float per = 1.0F / s.zz;
    const float a = xx - s.zx * s.zx * per, b = s.xy - s.zx * s.zy * per,
                c = yy - s.zy * s.zy * per;
    const float x = s.x - s.zx * s.z * per, y = s.y - s.zy * s.z * per;
    const float det = a * c - b * b;
    if (!(det > 0.0F)) return {0, 0};
    float dx = (c * x - b * y) / det, dy = (a * y - b * x) / det;
    const float most = 1.5F * s.zz / static_cast<float>(count);  // a quarter of the mean area
    const float length = dx * dx + dy * dy;
    if (length > most) {
      const float shorter = std::sqrt(most / length);
      dx *= shorter;
      dy *= shorter;
    }
    return {static_cast<std::int32_t>(std::lrint(dy * kParts)),
            static_cast<std::int32_t>(std::lrint(dx * kParts))};
  }

  /// Whether all triangles around stay large enough.
  bool fits(const Vertex& at, std::size_t count) const {
    for (std::size_t i = 0; i < count; ++i) {
      const Around& a = around_[i];
      const Triangle& t = mesh_.triangles()[a.triangle];
      const std::int64_t area = detail::doubled_area(at, mesh_.vertices()[t.v[(a.corner + 1) % 3]],
                                                     mesh_.vertices()[t.v[(a.corner + 2) % 3]]);
      constexpr float kLeastShare = 0.05F * 2.0F * kParts * kParts;
      if (area < TerrainMesh::kLeastArea || static_cast<float>(area) < kLeastShare * a.area)
        return false;
    }
    return true;
  }

  void move(std::uint32_t v, bool freely) {
    Vertex& at = mesh_.vertices()[v];
    if (mesh_.on_border(at)) return;
    Local s;
    const std::size_t count = look_around(v, s);
    if (count == 0) return;
    float dx = 0.0F, dy = 0.0F;
    if (freely) {
      auto [rows, cols] = sideways(s, count);
      for (int half = 0; (rows != 0 || cols != 0) && half < 3; ++half, rows /= 2, cols /= 2) {
        Vertex there = at;
        there.row += rows;
        there.col += cols;
        if (!inside(there) || !fits(there, count)) continue;
        at.row = there.row;
        at.col = there.col;
        dx = static_cast<float>(cols) * kPart;
        dy = static_cast<float>(rows) * kPart;
        break;
      }
    }
    const float dz = (s.z - s.zx * dx - s.zy * dy) / s.zz;
    at.z_mm += dz;
    for (std::size_t i = 0; i < count; ++i) {
      const Around& a = around_[i];
      auto& pull = mesh_.triangles()[a.triangle].pull;
      // The integral of two corners' shares is a twelfth of the area, of one squared a sixth.
      const float rise = (dz - a.per_col * dx - a.per_row * dy) * a.area / 12.0F;
      for (float& p : pull) p -= rise;
      pull[a.corner] -= rise;
    }
  }

  [[nodiscard]] bool inside(const Vertex& v) const {
    const Grid<float>& z = mesh_.field().z_mm;
    return v.row > 0 && v.col > 0 && v.row < (z.rows() - 1) * kParts &&
           v.col < (z.cols() - 1) * kParts;
  }

  TerrainMesh& mesh_;
  const RunContext& run_;
  float mean_ = 0.0F;
  std::array<Around, kMostAround> around_{};
};

}  // namespace

void fit_vertices(TerrainMesh& mesh, const RunContext& run) {
  VertexFit(mesh, run).go();
}

}  // namespace maquette::meshing::detail
