// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file union_error.hpp
/// How far a solid's top is from the terrain and the stones that it is the union of.

#include <array>
#include <cstdint>
#include <span>

#include "core/run_context.hpp"
#include "core/tri_mesh.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::meshing::detail {

struct UnionError {
  std::uint64_t on_terrain = 0, on_stones = 0;          ///< vertices, by what is nearer
  double max_vertical_mm = 0.0, rms_vertical_mm = 0.0;  ///< of those on terrain
  double max_mm = 0.0;  ///< of all samples, to what is nearer: terrain (vertically) or a stone
};

/// Some of a mesh.
struct PartOfMesh {
  std::span<const Vec3> vertices_mm;
  std::span<const std::array<std::uint32_t, 3>> triangles;
};

/// Samples: vertices, middles of triangles, and of edges where a triangle has corners of several
/// kinds (node of the field, vertex of a stone, others). Walls and base are left out. Independent
/// of how the solid was made: heights by interpolation, distances by box trees of the stones.
/// Cost: about 50 ns a triangle of terrain, 5 us one of a stone.
/// @param base_z_mm  of the base, which is no part of the top
/// @pre finite coordinates, indices in range
[[nodiscard]] UnionError union_error(const PartOfMesh& solid, double base_z_mm,
                                     const heightmap::ModelField& field,
                                     std::span<const TriMesh> stones, const RunContext& run);

}  // namespace maquette::meshing::detail
