// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file terrain_mesh.hpp
/// Triangulation of a field whose inner vertices stand anywhere (to a sixteenth of a node's
/// spacing) with any height; each triangle knows how the nodes under it lie beside it.
///
/// Memory  40 bytes a triangle, 16 a vertex.

#include <array>
#include <cstdint>
#include <limits>
#include <vector>

#include "heightmap/height_field.hpp"
#include "meshing/detail/chunked.hpp"
#include "meshing/detail/triangle_rows.hpp"

namespace maquette::meshing::detail {

class TerrainMesh {
 public:
  static constexpr int kParts = 16;  ///< of a node's spacing
  static constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();
  struct Vertex {
    std::int32_t row = 0, col = 0;  ///< in parts
    float z_mm = 0.0F;
    std::uint32_t triangle = kNone;  ///< one of those around it
  };
  struct Triangle {
    std::array<std::uint32_t, 3> v{};                     ///< counter-clockwise seen from above
    std::array<std::uint32_t, 3> n{kNone, kNone, kNone};  ///< across the edge opposite of v[i]
    /// Sum over the nodes of what is missing to their height, weighted by the corner's share.
    std::array<float, 3> pull{};
    float squares = 0.0F;  ///< sum of what is missing, squared
  };
  /// The node of a triangle farthest from it.
  struct Worst {
    float off_mm = 0.0F;
    std::int32_t row = 0, col = 0;
  };

  /// Without triangles. @pre kLeastColumns columns at least, no voids
  explicit TerrainMesh(const heightmap::ModelField& field);
  static constexpr std::ptrdiff_t kLeastColumns = 8;  ///< what is read at once
  /// Doubled, in parts squared, that moves and turns leave: a quarter of a cell.
  static constexpr std::int64_t kLeastArea = kParts * kParts / 2;

  [[nodiscard]] const heightmap::ModelField& field() const { return field_; }
  [[nodiscard]] std::vector<Vertex>& vertices() { return vertices_; }
  [[nodiscard]] const std::vector<Vertex>& vertices() const { return vertices_; }
  [[nodiscard]] Chunked<Triangle>& triangles() { return triangles_; }
  [[nodiscard]] bool on_border(const Vertex& v) const {
    return v.row == 0 || v.col == 0 || v.row == last_row_ || v.col == last_col_;
  }
  [[nodiscard]] std::int64_t doubled_area(const Triangle& t) const {
    return detail::doubled_area(vertices_[t.v[0]], vertices_[t.v[1]], vertices_[t.v[2]]);
  }
  /// A new vertex with the field's height there, between nodes bilinear.
  std::uint32_t add_vertex(std::int32_t row, std::int32_t col);

  /// Orders triangles and vertices by squares of ground of `nodes` a side, to and fro: most of the
  /// work's time is waiting for memory otherwise. Vertices need not know their triangle yet.
  void sort_by_place(std::int32_t nodes);

  /// Finds pull and squares of a triangle. What rounding of the heights makes is taken for none.
  void measure(Triangle& t) const;
  [[nodiscard]] float squares(const Vertex& a, const Vertex& b, const Vertex& c) const;
  /// The sum of squares that the best plane leaves, about: the weights' products are those of
  /// an even density.
  [[nodiscard]] float fitted_squares(const Triangle& t) const;
  [[nodiscard]] Worst worst(const Triangle& t) const;

  /// Turns the edge opposite of corner i if that lowers the sum of squares by a hundredth and
  /// both triangles are then seen from above. @return the triangle across, which keeps v[i] as
  /// first corner, as `t` does; or kNone
  std::uint32_t turn(std::uint32_t t, std::size_t i);
  void relink(std::uint32_t of, std::uint32_t from, std::uint32_t to);

  /// for_rows() of triangle_rows.hpp.
  template <class Visit>
  void for_rows(const Triangle& t, bool half_open, Visit visit) const {
    detail::for_rows<kParts>(std::array{vertices_[t.v[0]], vertices_[t.v[1]], vertices_[t.v[2]]},
                             half_open, visit);
  }

 private:
  struct Sums {
    float off = 0.0F, off_x = 0.0F, off_y = 0.0F, squares = 0.0F;  ///< x, y from the first corner
  };
  [[nodiscard]] Sums sums(const Vertex& a, const Vertex& b, const Vertex& c) const;

  const heightmap::ModelField& field_;
  std::int32_t last_row_, last_col_;  ///< in parts
  std::vector<Vertex> vertices_;
  Chunked<Triangle> triangles_;
};

}  // namespace maquette::meshing::detail
