// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>

#include "core/tri_mesh.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::testing_support {

/// The open surface of a field without voids: its nodes in rows, each cell cut from lower left to
/// upper right.
inline TriMesh mesh_of(const heightmap::ModelField& f) {
  TriMesh mesh;
  const auto rows = static_cast<std::uint32_t>(f.z_mm.rows());
  const auto cols = static_cast<std::uint32_t>(f.z_mm.cols());
  for (std::uint32_t r = 0; r < rows; ++r)
    for (std::uint32_t c = 0; c < cols; ++c)
      mesh.vertices_mm.push_back({f.x_mm(c), f.y_mm(r), static_cast<double>(f.z_mm(r, c))});
  for (std::uint32_t r = 0; r + 1 < rows; ++r)
    for (std::uint32_t c = 0; c + 1 < cols; ++c) {
      const std::uint32_t v = r * cols + c;
      mesh.triangles.push_back({v, v + 1, v + cols + 1});
      mesh.triangles.push_back({v, v + cols + 1, v + cols});
    }
  return mesh;
}

}  // namespace maquette::testing_support
