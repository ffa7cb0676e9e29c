// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file shell.hpp
/// What both meshers share: the top as the field's own triangles, four walls, base.

#include <cstdint>
#include <limits>
#include <string_view>
#include <vector>

#include "core/result.hpp"
#include "core/run_context.hpp"
#include "core/tri_mesh.hpp"
#include "heightmap/height_field.hpp"
#include "meshing/solid.hpp"

namespace maquette::meshing::detail {

/// Cells rows [row0, row1) x columns [col0, col1) of a field.
struct CellBlock {
  std::ptrdiff_t row0 = 0, row1 = 0, col0 = 0, col1 = 0;
  [[nodiscard]] bool empty() const { return row0 >= row1 || col0 >= col1; }
  [[nodiscard]] bool overlaps(const CellBlock& o) const {
    return row0 < o.row1 && o.row0 < row1 && col0 < o.col1 && o.col0 < col1;
  }
};

/// New triangles in place of the cells of a block. Its border is the block's border,
/// node by node, so that it fits into the hole.
struct Patch {
  CellBlock block;
  static constexpr std::uint32_t kNotANode = std::numeric_limits<std::uint32_t>::max();
  /// Per vertex: row * cols + col of the node it is, or kNotANode.
  std::vector<std::uint32_t> node;
  TriMesh mesh;  ///< closed except along the block's border, counter-clockwise from above
};

/// MESHING_SURFACE_HAS_VOIDS with the first row and column. `before` says what voids are to be
/// filled before: "meshing".
[[nodiscard]] Result<void> check_no_voids(const Grid<float>& z, std::string_view before);

/// MESHING_SURFACE_HAS_VOIDS, MESHING_BASE_TOO_THIN
/// @pre two nodes at least in each direction, fewer than 4 G nodes
[[nodiscard]] Result<void> check_surface(const heightmap::ModelField& surface,
                                         const SolidOptions& options);

/// Closed solid: the top with `patches` (blocks disjoint) put in, walls, base as a fan.
[[nodiscard]] Result<TriMesh> close_shell(const heightmap::ModelField& surface, double base_z_mm,
                                          const std::vector<Patch>& patches, const RunContext& run);

}  // namespace maquette::meshing::detail
