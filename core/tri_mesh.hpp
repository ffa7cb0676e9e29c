// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file tri_mesh.hpp
/// The one triangle mesh that rooms hand to each other.

#include <array>
#include <cstdint>
#include <vector>

#include "core/vec.hpp"

namespace maquette {

/// Indexed triangles in the model frame, millimetres. Triangles are
/// counter-clockwise seen from outside. 24 bytes a vertex, 12 a triangle: a
/// closed surface of 32 M triangles takes 0.8 GB.
struct TriMesh {
  std::vector<Vec3> vertices_mm;
  std::vector<std::array<std::uint32_t, 3>> triangles;

  [[nodiscard]] Box3 bounds() const {
    Box3 box;
    for (const Vec3& v : vertices_mm) box.add(v);
    return box;
  }
};

/// Appends `part` to `whole`; the two stay separate shells.
inline void append(TriMesh& whole, const TriMesh& part) {
  const auto shift = static_cast<std::uint32_t>(whole.vertices_mm.size());
  whole.vertices_mm.insert(whole.vertices_mm.end(), part.vertices_mm.begin(),
                           part.vertices_mm.end());
  whole.triangles.reserve(whole.triangles.size() + part.triangles.size());
  for (const auto& t : part.triangles)
    whole.triangles.push_back({t[0] + shift, t[1] + shift, t[2] + shift});
}

}  // namespace maquette
