// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file mesh_properties.hpp
/// Plain properties of triangle meshes, counted without any mesh library.

#include <algorithm>
#include <array>
#include <cstdint>
#include <map>
#include <set>
#include <utility>

#include <gmock/gmock.h>

#include "core/mesh_stream.hpp"
#include "core/tri_mesh.hpp"

namespace maquette::testing_support {

/// All of a stream at once.
inline TriMesh collected(const MeshStream& stream) {
  TriMesh mesh;
  mesh.vertices_mm.resize(stream.vertex_count());
  mesh.triangles.resize(stream.triangle_count());
  stream.vertices(0, mesh.vertices_mm);
  stream.triangles(0, mesh.triangles);
  return mesh;
}

inline double signed_volume_mm3(const TriMesh& m) {
  double six = 0.0;
  for (const auto& t : m.triangles)
    six += dot(m.vertices_mm[t[0]], cross(m.vertices_mm[t[1]], m.vertices_mm[t[2]]));
  return six / 6.0;
}

/// Triangles whose corners all lie in the plane of this x (or y), each from its least corner on.
/// @param turned  seen from the other side
inline std::set<std::array<std::array<double, 3>, 3>> in_plane(const TriMesh& m, bool x, double at,
                                                               bool turned) {
  std::set<std::array<std::array<double, 3>, 3>> found;
  for (const auto& t : m.triangles) {
    std::array<std::array<double, 3>, 3> corners{};
    bool flat = true;
    for (std::size_t k = 0; k < 3; ++k) {
      const Vec3 v = m.vertices_mm[t[turned ? 2 - k : k]];
      corners[k] = {v.x, v.y, v.z};
      flat = flat && (x ? v.x : v.y) == at;
    }
    if (!flat) continue;
    std::rotate(corners.begin(), std::min_element(corners.begin(), corners.end()), corners.end());
    found.insert(corners);
  }
  return found;
}

/// Every directed edge once, and its opposite once: closed, oriented, 2-manifold at edges.
MATCHER(IsClosedAndOriented, "is closed and oriented") {
  std::map<std::pair<std::uint32_t, std::uint32_t>, int> directed;
  for (const auto& t : arg.triangles)
    for (std::size_t i = 0; i < 3; ++i) ++directed[{t[i], t[(i + 1) % 3]}];
  for (const auto& [edge, count] : directed) {
    const auto back = directed.find({edge.second, edge.first});
    if (count != 1 || back == directed.end() || back->second != 1) {
      *result_listener << "edge " << edge.first << "-" << edge.second << " occurs " << count
                       << " times, its opposite " << (back == directed.end() ? 0 : back->second)
                       << " times";
      return false;
    }
  }
  return !directed.empty();
}

}  // namespace maquette::testing_support
