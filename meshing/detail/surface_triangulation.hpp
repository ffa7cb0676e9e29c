// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file surface_triangulation.hpp
/// Delaunay triangulation, seen from above, of some nodes of a field, refined where it is
/// farthest from the field: greedy insertion, M. Garland, P. S. Heckbert, "Fast polygonal
/// approximation of terrains and height fields", CMU-CS-95-181, 1995.
///
/// Against that text: the first vertices come from a coarse grid (most of the scanning there is
/// of the first few triangles), triangles wait in 128 lists per doubling of their error in place
/// of a heap (the worst is taken to 0.5 %).
///
/// Memory  40 bytes a triangle, 12 a vertex, 0.2 MB.

#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <vector>

#include "core/run_context.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::meshing::detail {

/// Grows without moving what it has, and can be taken apart from the front.
template <class T>
class Chunked {
 public:
  static constexpr std::size_t kShift = 14, kChunk = std::size_t{1} << kShift;
  [[nodiscard]] std::uint32_t size() const { return size_; }
  T& operator[](std::uint32_t i) { return chunks_[i >> kShift][i & (kChunk - 1)]; }
  const T& operator[](std::uint32_t i) const { return chunks_[i >> kShift][i & (kChunk - 1)]; }
  std::uint32_t push(const T& value) {
    if ((size_ >> kShift) == chunks_.size()) chunks_.emplace_back(new T[kChunk]);
    (*this)[size_] = value;
    return size_++;
  }
  /// Frees all whole chunks before i; they must not be asked for again.
  void free_before(std::uint32_t i) {
    if ((i & (kChunk - 1)) == 0 && i > 0) chunks_[(i >> kShift) - 1].reset();
  }

 private:
  std::vector<std::unique_ptr<T[]>> chunks_;
  std::uint32_t size_ = 0;
};

class SurfaceTriangulation {
 public:
  static constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();
  struct Vertex {
    std::int32_t row = 0, col = 0;
    float z_mm = 0.0F;
  };
  struct Triangle {
    std::array<std::uint32_t, 3> v{};                     ///< counter-clockwise seen from above
    std::array<std::uint32_t, 3> n{kNone, kNone, kNone};  ///< across the edge opposite of v[i]
    /// While it waits: its worst node and links of the list. height_fit.hpp keeps products here.
    union {
      struct {
        std::uint32_t worst_node;
        float error_mm;
        std::uint32_t before, after;
      } wait;
      std::array<float, 4> product;
    };
    Triangle() : wait{kNone, 0.0F, kNone, kNone} {}
  };

  /// The rectangle as two triangles. @param locked  refine() takes no node of the border
  /// @pre two rows and columns at least, no voids
  SurfaceTriangulation(const heightmap::ModelField& field, bool locked);

  /// Inserts a node that is not yet a vertex, found by walking from `hint`; nothing is
  /// scanned. @return a triangle at it, the next hint
  std::uint32_t insert(std::int32_t row, std::int32_t col, std::uint32_t hint);

  /// Finds every triangle's worst node; those with one farther off than `error_mm` wait.
  void scan_all(double error_mm);
  /// Inserts worst nodes until no triangle waits, there are `most_triangles` (or 0.05 % fewer,
  /// if the worst is then what it was lowest) or the run is stopped. @pre scan_all()
  void refine(std::uint64_t most_triangles, const RunContext& run);
  /// The most that a node is off, over all triangles. After scan_all() or refine().
  [[nodiscard]] double worst_mm() const;

  [[nodiscard]] const heightmap::ModelField& field() const { return field_; }
  [[nodiscard]] const Chunked<Vertex>& vertices() const { return vertices_; }
  [[nodiscard]] Chunked<Vertex>& vertices() { return vertices_; }
  [[nodiscard]] Chunked<Triangle>& triangles() { return triangles_; }
  [[nodiscard]] bool on_border(const Vertex& v) const {
    return v.row == 0 || v.col == 0 || v.row == last_row_ || v.col == last_col_;
  }

  /// In cells; positive if the corners are counter-clockwise.
  [[nodiscard]] std::int64_t doubled_area(const Triangle& t) const {
    return doubled_area(vertices_[t.v[0]], vertices_[t.v[1]], vertices_[t.v[2]]);
  }

  /// Calls visit(row, first column, last column, height at column 0, height per column) for
  /// every row of nodes in the triangle. `half_open`: each node in exactly one triangle, those
  /// of the last row and column in none; else those of the edges too.
  template <class Visit>
  void for_rows(const Triangle& t, bool half_open, Visit visit) const;

 private:
  static constexpr std::uint64_t kStopEarly = 2000;
  static constexpr int kMantissaBits = 7;  // 128 lists per doubling
  static std::uint32_t list_of(float error_mm);
  [[nodiscard]] std::int64_t doubled_area(const Vertex& a, const Vertex& b, const Vertex& c) const {
    return static_cast<std::int64_t>(b.col - a.col) * (c.row - a.row) -
           static_cast<std::int64_t>(b.row - a.row) * (c.col - a.col);
  }
  [[nodiscard]] bool waits(const Triangle& t) const {
    return static_cast<double>(t.wait.error_mm) > least_mm_;
  }
  void scan(std::uint32_t t);
  void link(std::uint32_t t);
  void unlink(std::uint32_t t);
  void relink_neighbour(std::uint32_t of, std::uint32_t from, std::uint32_t to);
  std::uint32_t add(std::uint32_t a, std::uint32_t b, std::uint32_t c);
  void split_inside(std::uint32_t t, std::uint32_t p);
  void split_edge(std::uint32_t t, std::size_t edge, std::uint32_t p);
  void legalise();
  std::uint32_t insert_into(std::uint32_t t, std::int32_t row, std::int32_t col);
  [[nodiscard]] bool in_circle(const Triangle& t, const Vertex& q) const;
  template <class Do>
  void star(std::uint32_t t, Do act) const;

  const heightmap::ModelField& field_;
  std::int32_t last_row_, last_col_;
  Chunked<Vertex> vertices_;
  Chunked<Triangle> triangles_;
  std::vector<std::uint32_t> head_;  ///< first of each list
  std::uint32_t top_ = 0;            ///< no list above this one has any
  std::vector<std::uint32_t> stack_;
  bool locked_;
  double least_mm_ = INFINITY;  ///< nothing waits before scan_all()
};

template <class Visit>
void SurfaceTriangulation::for_rows(const Triangle& t, bool half_open, Visit visit) const {
  std::array<Vertex, 3> at{vertices_[t.v[0]], vertices_[t.v[1]], vertices_[t.v[2]]};
  const auto area = static_cast<double>(doubled_area(at[0], at[1], at[2]));
  const auto z =
      static_cast<double>(at[0].z_mm);  // from here on, so that level triangles have level points
  const double z1 = static_cast<double>(at[1].z_mm) - z, z2 = static_cast<double>(at[2].z_mm) - z;
  const double r1 = at[1].row - at[0].row, r2 = at[2].row - at[0].row;
  const double c1 = at[1].col - at[0].col, c2 = at[2].col - at[0].col;
  const double per_col = (z1 * r2 - z2 * r1) / area, per_row = (z2 * c1 - z1 * c2) / area;
  const double row0 = at[0].row, col0 = at[0].col;
  // Sorted by row; the long edge runs from the first to the last.
  if (at[1].row < at[0].row) std::swap(at[0], at[1]);
  if (at[2].row < at[1].row) std::swap(at[1], at[2]);
  if (at[1].row < at[0].row) std::swap(at[0], at[1]);
  const bool middle_is_east = doubled_area(at[0], at[1], at[2]) > 0;
  const auto slope = [](const Vertex& a, const Vertex& b) {
    return b.row == a.row ? 0.0 : static_cast<double>(b.col - a.col) / (b.row - a.row);
  };
  const double long_slope = slope(at[0], at[2]);
  const double low_slope = slope(at[0], at[1]), high_slope = slope(at[1], at[2]);
  // Crossings are multiples of 1 / rows: rounding cannot reach the next one.
  constexpr double kRounding = 1e-7;
  const std::int32_t end = half_open ? at[2].row : at[2].row + 1;
  for (std::int32_t r = at[0].row; r < end; ++r) {
    const double on_long = at[0].col + long_slope * (r - at[0].row);
    const double on_other = r < at[1].row ? at[0].col + low_slope * (r - at[0].row)
                                          : at[1].col + high_slope * (r - at[1].row);
    const double west = middle_is_east ? on_long : on_other;
    const double east = middle_is_east ? on_other : on_long;
    const auto from = static_cast<std::int32_t>(std::ceil(west - kRounding));
    const std::int32_t to = half_open ? static_cast<std::int32_t>(std::ceil(east - kRounding)) - 1
                                      : static_cast<std::int32_t>(std::floor(east + kRounding));
    if (from <= to) visit(r, from, to, z + per_row * (r - row0) - per_col * col0, per_col);
  }
}

}  // namespace maquette::meshing::detail
