// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/detail/dual_mesh.hpp"

#include <span>
#include <unordered_map>
#include <utility>

namespace maquette::scan::detail {
namespace {

constexpr std::array<unsigned, 3> kNext{1, 2, 0}, kAfter{2, 0, 1};

/// A face with four crossings: does the function have the sign of its lower left and upper right
/// corners in the middle?
bool joins_diagonal(float f00, float f10, float f01, float f11) {
  return static_cast<double>(f00) * static_cast<double>(f11) >
         static_cast<double>(f10) * static_cast<double>(f01);
}

/// The face of a cell across axis n on its lower or upper side.
struct Face {
  unsigned c00, c10, c01, c11;      // corners
  unsigned low, high, left, right;  // edges: along u at either v, along v at either u
  Face(unsigned n, unsigned side) {
    const unsigned u = kNext[n], v = kAfter[n];
    c00 = side << n;
    c10 = c00 | 1U << u;
    c01 = c00 | 1U << v;
    c11 = c10 | 1U << v;
    low = edge_of(u, c00);
    high = edge_of(u, c01);
    left = edge_of(v, c00);
    right = edge_of(v, c10);
  }
};

}  // namespace

bool CellSurfaces::crosses(unsigned edge) const {
  const unsigned axis = edge / 4, u = axis == 0 ? 1 : 0, v = axis == 2 ? 1 : 2;
  const unsigned from = (edge & 1U) << u | (edge >> 1 & 1U) << v, to = from | 1U << axis;
  return (below >> from & 1U) != (below >> to & 1U);
}

CellSurfaces surfaces_of(const std::array<float, 8>& f) {
  CellSurfaces s;
  for (unsigned c = 0; c < 8; ++c)
    if (f[c] < 0.0F) s.below = static_cast<std::uint8_t>(s.below | 1U << c);
  if (s.below == 0 || s.below == 255) return s;
  std::array<unsigned, 12> piece{};
  for (unsigned e = 0; e < 12; ++e) piece[e] = e;
  const auto join = [&](unsigned a, unsigned b) {
    const unsigned from = piece[a], to = piece[b];
    for (unsigned& p : piece)
      if (p == from) p = to;
  };
  for (unsigned n = 0; n < 3; ++n)
    for (unsigned side = 0; side < 2; ++side) {
      const Face face(n, side);
      std::array<unsigned, 4> crossed{};
      unsigned count = 0;
      for (const unsigned e : {face.low, face.high, face.left, face.right})
        if (s.crosses(e)) crossed[count++] = e;
      if (count == 2) join(crossed[0], crossed[1]);
      if (count != 4) continue;
      const bool diagonal = joins_diagonal(f[face.c00], f[face.c10], f[face.c01], f[face.c11]);
      join(face.low, diagonal ? face.right : face.left);
      join(face.high, diagonal ? face.left : face.right);
    }
  std::array<unsigned, 4> names{};
  for (unsigned e = 0; e < 12; ++e) {
    if (!s.crosses(e)) continue;
    unsigned k = 0;
    while (k < s.count && names[k] != piece[e]) ++k;
    if (k == s.count) names[s.count++] = piece[e];
    s.of_edge |= k << (2 * e);
  }
  return s;
}

Crossing crossing_of(const std::array<float, 8>& f, unsigned edge) {
  const unsigned axis = edge / 4, u = axis == 0 ? 1 : 0, v = axis == 2 ? 1 : 2;
  const unsigned from = (edge & 1U) << u | (edge >> 1 & 1U) << v, to = from | 1U << axis;
  const double a = static_cast<double>(f[from]), b = static_cast<double>(f[to]);
  return {from, to, a / (a - b)};
}

std::array<float, 8> DualGrid::at_corners(std::size_t cell) const {
  std::array<float, 8> f{};
  for (std::size_t c = 0; c < 8; ++c) f[c] = values[corners[cell][c]];
  return f;
}

Vec3 DualGrid::corner_mm(std::size_t cell, unsigned c) const {
  const std::uint64_t key = keys[cell];
  const auto at = [](std::int64_t i, unsigned bit) {
    return static_cast<double>(i) + static_cast<double>(bit & 1U);
  };
  return grid->origin_mm + grid->voxel_mm * Vec3{at(VoxelGrid::x_of(key), c),
                                                 at(VoxelGrid::y_of(key), c >> 1),
                                                 at(VoxelGrid::z_of(key), c >> 2)};
}

namespace {

class Joiner {
 public:
  Joiner(const DualGrid& cells, TriMesh& mesh, std::vector<Colour>& colours)
      : d_(cells), mesh_(mesh), colours_(colours) {}

  void around_edge(std::size_t k, unsigned axis) {
    const CellSurfaces& own = d_.surfaces[k];
    const bool from = (own.below & 1U) != 0, to = (own.below >> (1U << axis) & 1U) != 0;
    if (from == to) return;
    const unsigned u = kNext[axis], v = kAfter[axis];
    const std::uint64_t key = d_.keys[k];
    std::array<std::size_t, 4> cell{};
    std::array<unsigned, 4> edge{};
    std::array<std::uint32_t, 4> ring{};
    // Counter-clockwise about the axis: (0,0), (-1,0), (-1,-1), (0,-1).
    for (unsigned i = 0; i < 4; ++i) {
      const bool back_u = i == 1 || i == 2, back_v = i == 2 || i == 3;
      std::int64_t c[3] = {VoxelGrid::x_of(key), VoxelGrid::y_of(key), VoxelGrid::z_of(key)};
      c[u] -= back_u ? 1 : 0;
      c[v] -= back_v ? 1 : 0;
      const std::uint32_t found = d_.cell_of.find(VoxelGrid::key(c[0], c[1], c[2]));
      if (found == KeyMap::npos || d_.surfaces[found].count == 0) return;
      cell[i] = found;
      edge[i] = edge_of(axis, (back_u ? 1U << u : 0U) | (back_v ? 1U << v : 0U));
      ring[i] = d_.vertex[d_.first[found] + d_.surfaces[found].piece(edge[i])];
      if (ring[i] == KeyMap::npos) return;
    }
    std::array<std::uint32_t, 8> polygon{};
    std::size_t n = 0;
    for (unsigned i = 0; i < 4; ++i) {
      polygon[n++] = ring[i];
      // The cell on the upper side of the face between a cell of the ring and the next.
      const unsigned j = (i + 1) % 4, upper = i == 0 ? 0U : i == 1 ? 1U : i == 2 ? 3U : 0U;
      const unsigned lower = upper == i ? j : i;
      const std::uint32_t between =
          second_way(cell[upper], cell[lower], i % 2 == 0 ? u : v, edge[upper]);
      if (between != KeyMap::npos) polygon[n++] = between;
    }
    if (!from)
      for (std::size_t i = 0; i < n / 2; ++i) std::swap(polygon[i], polygon[n - 1 - i]);
    fill({polygon.data(), n});
  }

 private:
  /// The vertex on a face that a joint of two cells goes over, or npos.
  std::uint32_t second_way(std::size_t upper, std::size_t lower, unsigned n, unsigned edge) {
    const CellSurfaces& a = d_.surfaces[upper];
    const CellSurfaces& b = d_.surfaces[lower];
    const Face face(n, 0);
    const auto below = [&](unsigned c) { return a.below >> c & 1U; };
    if (below(face.c00) != below(face.c11) || below(face.c10) != below(face.c01) ||
        below(face.c00) == below(face.c10))
      return KeyMap::npos;
    const Face other(n, 1);
    if (a.piece(face.low) != a.piece(face.high) || b.piece(other.low) != b.piece(other.high))
      return KeyMap::npos;
    const std::array<float, 8> f = d_.at_corners(upper);
    const bool diagonal = joins_diagonal(f[face.c00], f[face.c10], f[face.c01], f[face.c11]);
    const unsigned with_high = diagonal ? face.left : face.right;
    if (edge != face.high && edge != with_high) return KeyMap::npos;
    const auto next = static_cast<std::uint32_t>(mesh_.vertices_mm.size());
    const auto [found, fresh] = on_faces_.try_emplace(upper * 4 + n, next);
    if (!fresh) return found->second;
    Vec3 p;
    for (const unsigned e : {face.high, with_high}) {
      const Crossing c = crossing_of(f, e);
      const Vec3 start = d_.corner_mm(upper, c.from);
      p += 0.5 * (start + c.share * (d_.corner_mm(upper, c.to) - start));
    }
    mesh_.vertices_mm.push_back(p);
    if (!colours_.empty())
      colours_.push_back(colours_[d_.vertex[d_.first[upper] + a.piece(face.high)]]);
    return next;
  }

  void fill(std::span<const std::uint32_t> polygon) {
    auto& triangles = mesh_.triangles;
    if (polygon.size() == 4) {
      const auto square = [&](std::size_t a, std::size_t b) {
        const Vec3 d = mesh_.vertices_mm[polygon[a]] - mesh_.vertices_mm[polygon[b]];
        return dot(d, d);
      };
      // The shorter diagonal.
      const std::size_t s = square(0, 2) <= square(1, 3) ? 0 : 1;
      triangles.push_back({polygon[s], polygon[s + 1], polygon[s + 2]});
      triangles.push_back({polygon[s], polygon[s + 2], polygon[(s + 3) % 4]});
      return;
    }
    // A diagonal might be the edge that was to be avoided.
    const auto middle = static_cast<std::uint32_t>(mesh_.vertices_mm.size());
    Vec3 sum;
    for (const std::uint32_t i : polygon) sum += mesh_.vertices_mm[i];
    mesh_.vertices_mm.push_back((1.0 / static_cast<double>(polygon.size())) * sum);
    if (!colours_.empty()) colours_.push_back(colours_[polygon[0]]);
    for (std::size_t i = 0; i < polygon.size(); ++i)
      triangles.push_back({polygon[i], polygon[(i + 1) % polygon.size()], middle});
  }

  const DualGrid& d_;
  TriMesh& mesh_;
  std::vector<Colour>& colours_;
  std::unordered_map<std::uint64_t, std::uint32_t> on_faces_;
};

}  // namespace

void join_cells(const DualGrid& cells, TriMesh& mesh, std::vector<Colour>& colours) {
  Joiner joiner(cells, mesh, colours);
  for (std::size_t k = 0; k < cells.keys.size(); ++k)
    if (cells.surfaces[k].count > 0)
      for (unsigned axis = 0; axis < 3; ++axis) joiner.around_edge(k, axis);
}

}  // namespace maquette::scan::detail
