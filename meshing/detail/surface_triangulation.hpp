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
#include <vector>

#include "core/run_context.hpp"
#include "heightmap/height_field.hpp"
#include "meshing/detail/chunked.hpp"
#include "meshing/detail/triangle_rows.hpp"

namespace maquette::meshing::detail {

class SurfaceTriangulation {
 public:
  static constexpr int kParts = 1;  ///< vertices stand on nodes
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
    return detail::doubled_area(vertices_[t.v[0]], vertices_[t.v[1]], vertices_[t.v[2]]);
  }

  /// for_rows() of triangle_rows.hpp.
  template <class Visit>
  void for_rows(const Triangle& t, bool half_open, Visit visit) const {
    detail::for_rows<kParts>(std::array{vertices_[t.v[0]], vertices_[t.v[1]], vertices_[t.v[2]]},
                             half_open, visit);
  }

 private:
  static constexpr std::uint64_t kStopEarly = 2000;
  static constexpr int kMantissaBits = 7;  // 128 lists per doubling
  static std::uint32_t list_of(float error_mm);
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

}  // namespace maquette::meshing::detail
