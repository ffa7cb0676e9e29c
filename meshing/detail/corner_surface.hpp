// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file corner_surface.hpp
/// Triangle connectivity as corners (a triangle and one of its vertices), the same words for a
/// TriMesh, where it is tabulated, and for the triangulated grid, where it is computed.
///
///   vertex(c), point(c)     of the corner
///   next(c), prev(c)        the other corners of its triangle, in turn
///   opposite(c)             corner beyond the edge that faces c; exists() is false if there is no
///                           single such triangle
///   for_each_corner(v, f)   f(c) for each corner at vertex v
///   corner(triangle)        its corner 0

#include <cstdint>
#include <limits>
#include <vector>

#include "core/tri_mesh.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::meshing::detail {

class MeshSurface {
 public:
  using Corner = std::uint32_t;
  static constexpr Corner kNone = std::numeric_limits<Corner>::max(), kUnset = kNone - 1;

  /// @pre all indices in range, fewer than 2^32 / 3 triangles
  explicit MeshSurface(const TriMesh& mesh)
      : mesh_(mesh), vertex_of_(reinterpret_cast<const std::uint32_t*>(mesh.triangles.data())) {
    static_assert(sizeof(mesh.triangles.front()) == 3 * sizeof(std::uint32_t));
    const auto corners = static_cast<Corner>(3 * mesh.triangles.size());
    first_.assign(mesh.vertices_mm.size() + 1, 0);
    for (Corner c = 0; c < corners; ++c) ++first_[vertex(c) + 1];
    for (std::size_t v = 1; v < first_.size(); ++v) first_[v] += first_[v - 1];
    at_.resize(corners);
    std::vector<Corner> fill(first_.begin(), first_.end() - 1);
    for (Corner c = 0; c < corners; ++c) at_[fill[vertex(c)]++] = c;
    opposite_.assign(corners, kUnset);
    for (Corner c = 0; c < corners; ++c) {
      if (opposite_[c] != kUnset) continue;
      opposite_[c] = find_opposite(c);
      if (opposite_[c] != kNone && !degenerate(c)) opposite_[opposite_[c]] = c;
    }
  }

  [[nodiscard]] std::size_t vertices() const { return mesh_.vertices_mm.size(); }
  [[nodiscard]] std::uint64_t triangles() const { return mesh_.triangles.size(); }
  [[nodiscard]] Corner corner(std::uint64_t triangle) const {
    return static_cast<Corner>(3 * triangle);
  }
  [[nodiscard]] bool exists(Corner c) const { return c != kNone; }
  [[nodiscard]] std::uint32_t vertex(Corner c) const { return vertex_of_[c]; }
  [[nodiscard]] Vec3 point(Corner c) const { return mesh_.vertices_mm[vertex(c)]; }
  [[nodiscard]] Corner next(Corner c) const { return c % 3 == 2 ? c - 2 : c + 1; }
  [[nodiscard]] Corner prev(Corner c) const { return c % 3 == 0 ? c + 2 : c - 1; }
  [[nodiscard]] Corner opposite(Corner c) const { return opposite_[c]; }
  template <class F>
  void for_each_corner(std::uint32_t v, F&& f) const {
    for (Corner k = first_[v]; k < first_[v + 1]; ++k) f(at_[k]);
  }

  /// Triangles at the edge that faces c, its own included.
  [[nodiscard]] int triangles_at_edge(Corner c) const {
    int count = 0;
    const std::uint32_t a = vertex(next(c)), b = vertex(prev(c));
    for_each_corner(a, [&](Corner k) { count += vertex(next(k)) == b || vertex(prev(k)) == b; });
    return count;
  }

 private:
  /// An edge counts twice then, and opposite() is not mutual.
  [[nodiscard]] bool degenerate(Corner c) const {
    const std::uint32_t v = vertex(c), a = vertex(next(c)), b = vertex(prev(c));
    return v == a || v == b || a == b;
  }
  [[nodiscard]] Corner find_opposite(Corner c) const {
    const std::uint32_t a = vertex(next(c)), b = vertex(prev(c));
    Corner found = kNone;
    int others = 0;
    for_each_corner(a, [&](Corner k) {
      if (k / 3 == c / 3) return;
      if (vertex(next(k)) == b) {
        found = prev(k);
        ++others;
      } else if (vertex(prev(k)) == b) {
        found = next(k);
        ++others;
      }
    });
    return others == 1 ? found : kNone;
  }

  const TriMesh& mesh_;
  const std::uint32_t* vertex_of_;  ///< by corner
  std::vector<Corner> first_, at_, opposite_;
};

class GridSurface {
 public:
  /// Cell, and 3 half + index in the half's triangle (SurfacePoint's numbering).
  struct Corner {
    std::int32_t row, col;
    std::uint32_t which;
  };

  explicit GridSurface(const heightmap::ModelField& field)
      : z_(field.z_mm.cells().data()),
        rows_(static_cast<std::int32_t>(field.z_mm.rows())),
        cols_(static_cast<std::int32_t>(field.z_mm.cols())),
        d_(field.spacing.value()) {}

  [[nodiscard]] std::size_t vertices() const {
    return static_cast<std::size_t>(rows_) * static_cast<std::size_t>(cols_);
  }
  [[nodiscard]] std::uint64_t triangles() const {
    return 2 * static_cast<std::uint64_t>(rows_ - 1) * static_cast<std::uint64_t>(cols_ - 1);
  }
  [[nodiscard]] Corner corner(std::uint64_t triangle) const {
    const std::uint64_t cell = triangle / 2, across = static_cast<std::uint64_t>(cols_ - 1);
    return {static_cast<std::int32_t>(cell / across), static_cast<std::int32_t>(cell % across),
            static_cast<std::uint32_t>(3 * (triangle % 2))};
  }
  [[nodiscard]] bool exists(Corner c) const {
    return static_cast<std::uint32_t>(c.row) < static_cast<std::uint32_t>(rows_ - 1) &&
           static_cast<std::uint32_t>(c.col) < static_cast<std::uint32_t>(cols_ - 1);
  }
  [[nodiscard]] std::uint32_t vertex(Corner c) const {
    return static_cast<std::uint32_t>(c.row + kRow[c.which]) * static_cast<std::uint32_t>(cols_) +
           static_cast<std::uint32_t>(c.col + kCol[c.which]);
  }
  /// x and y from the field's first node.
  [[nodiscard]] Vec3 point(Corner c) const {
    return {d_ * (c.col + kCol[c.which]), d_ * (c.row + kRow[c.which]),
            static_cast<double>(z_[vertex(c)])};
  }
  [[nodiscard]] Corner next(Corner c) const { return {c.row, c.col, kNext[c.which]}; }
  [[nodiscard]] Corner prev(Corner c) const { return {c.row, c.col, kPrev[c.which]}; }
  [[nodiscard]] Corner opposite(Corner c) const {
    return {c.row + kBeyondRow[c.which], c.col + kBeyondCol[c.which], kBeyond[c.which]};
  }
  template <class F>
  void for_each_corner(std::uint32_t v, F&& f) const {
    const auto r = static_cast<std::int32_t>(v / static_cast<std::uint32_t>(cols_));
    const auto c = static_cast<std::int32_t>(v % static_cast<std::uint32_t>(cols_));
    const bool up = r<rows_ - 1, down = r> 0, right = c<cols_ - 1, left = c> 0;
    if (up && right) {
      f(Corner{r, c, 0});
      f(Corner{r, c, 3});
    }
    if (up && left) f(Corner{r, c - 1, 1});
    if (down && left) {
      f(Corner{r - 1, c - 1, 2});
      f(Corner{r - 1, c - 1, 4});
    }
    if (down && right) f(Corner{r - 1, c, 5});
  }

 private:
  static constexpr std::int32_t kRow[6] = {0, 0, 1, 0, 1, 1}, kCol[6] = {0, 1, 1, 0, 1, 0};
  static constexpr std::uint32_t kNext[6] = {1, 2, 0, 4, 5, 3}, kPrev[6] = {2, 0, 1, 5, 3, 4};
  static constexpr std::int32_t kBeyondRow[6] = {0, 0, -1, 1, 0, 0};
  static constexpr std::int32_t kBeyondCol[6] = {1, 0, 0, 0, -1, 0};
  static constexpr std::uint32_t kBeyond[6] = {4, 5, 3, 2, 0, 1};

  const float* z_;
  std::int32_t rows_, cols_;
  double d_;
};

}  // namespace maquette::meshing::detail
