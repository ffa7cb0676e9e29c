// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file triangle_tree.hpp
/// Boxes over the triangles of a mesh, seen from above: for each its outline along x and y and its
/// top. Triangles stand in the order of a space-filling curve, eight to a group, eight groups to a
/// node, and so on, so that neither pointers nor a shape of the tree are stored.
///
/// Memory: 7 bytes a triangle (the order 4, boxes 3). Building sorts 8 bytes a triangle more.
/// G. M. Morton, "A computer oriented geodetic data base and a new technique in file sequencing",
/// IBM, 1966.

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "cnc/lanes.hpp"
#include "core/tri_mesh.hpp"

namespace maquette::cnc {

class TriangleTree {
 public:
  /// Eight boxes, rounded outwards; one that holds nothing has top -INFINITY.
  struct Node {
    std::array<float, kLanes> x0, x1, y0, y1, top;
  };

  /// Degenerate triangles are kept, those that are upright too: their edges can be touched.
  /// @pre the mesh has triangles, its coordinates are finite, its indices in range
  explicit TriangleTree(const TriMesh& mesh);

  /// 0: boxes of groups of triangles; above: boxes of the level below's nodes. The last has one.
  [[nodiscard]] std::size_t levels() const { return levels_.size(); }
  [[nodiscard]] const Node& node(std::size_t level, std::size_t i) const {
    return levels_[level][i];
  }
  /// Indices of a group's triangles, 8 or, in the last, fewer.
  [[nodiscard]] std::span<const std::uint32_t> group(std::size_t i) const {
    const std::size_t from = i * kLanes;
    return {order_.data() + from, std::min<std::size_t>(kLanes, order_.size() - from)};
  }
  [[nodiscard]] std::size_t bytes() const;

 private:
  std::vector<std::uint32_t> order_;
  std::vector<std::vector<Node>> levels_;
};

}  // namespace maquette::cnc
