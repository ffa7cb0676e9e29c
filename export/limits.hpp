// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file limits.hpp
/// What every writer asks of a mesh before it opens a file.

#include <cmath>
#include <cstdint>
#include <filesystem>
#include <string_view>

#include <fmt/format.h>

#include "core/check.hpp"
#include "core/result.hpp"
#include "core/tri_mesh.hpp"
#include "export/cad.hpp"

namespace maquette::exporting {

/// Binary STL counts triangles in 32 bits.
inline constexpr std::uint64_t kStlTriangleLimit = 0xFFFFFFFFULL;
/// A 3MF part is XML, some 90 bytes a triangle; above this it passes 4 GiB, which
/// several readers cannot take.
inline constexpr std::uint64_t k3mfTriangleLimit = 40'000'000ULL;
/// USD's faceVertexIndices are signed, of 32 bits.
inline constexpr std::uint64_t kUsdVertexLimit = 0x7FFFFFFFULL;
/// A glb file and its chunks count bytes in 32 bits.
inline constexpr std::uint64_t kGlbByteLimit = 0xFFFFFFFFULL;

/// EXPORT_TOO_MANY_TRIANGLES if `amount` is above what `format` can hold.
[[nodiscard]] inline Result<void> within_limit(std::uint64_t amount, std::uint64_t limit,
                                               std::string_view what, std::string_view format,
                                               const std::filesystem::path& path) {
  if (amount <= limit) return {};
  return fail(kTooManyTriangles,
              fmt::format("{}: {} {} are more than {} takes here ({}); decimate the surface or "
                          "export it band by band",
                          path.string(), amount, what, format, limit));
}

/// EXPORT_EMPTY_MESH; an index out of range or a vertex that is not finite is a bug of ours.
[[nodiscard]] inline Result<void> check_mesh_for_export(const TriMesh& mesh,
                                                        const std::filesystem::path& path) {
  if (mesh.triangles.empty())
    return fail(kEmptyMesh,
                fmt::format("{}: the mesh to be written has no triangle", path.string()));
  const std::size_t vertices = mesh.vertices_mm.size();
  for (const auto& t : mesh.triangles)
    MAQUETTE_CHECK(t[0] < vertices && t[1] < vertices && t[2] < vertices,
                   "triangle {} {} {} of a mesh with {} vertices", t[0], t[1], t[2], vertices);
  for (const Vec3& v : mesh.vertices_mm)
    MAQUETTE_CHECK(std::isfinite(v.x + v.y + v.z), "vertex ({}, {}, {}) mm is not finite", v.x, v.y,
                   v.z);
  return {};
}

}  // namespace maquette::exporting
