// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file glb_file.hpp
/// The container of glTF 2.0 binary: header, JSON chunk, head of the binary chunk; and what every
/// asset says of itself. Khronos glTF 2.0 specification, chapter 4.

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "core/files.hpp"
#include "core/result.hpp"
#include "core/tri_mesh.hpp"
#include "export/draco_piece.hpp"

namespace maquette::exporting {

inline constexpr double kMetresPerMillimetre = 1e-3;

/// Sections of a binary chunk start at multiples of four.
[[nodiscard]] constexpr std::uint64_t glb_padded(std::uint64_t bytes) {
  return (bytes + 3) / 4 * 4;
}

/// Header and JSON chunk (padded with spaces), then the head of the binary chunk; the caller goes
/// on with exactly `binary_bytes` bytes. @pre binary_bytes is a multiple of four
/// @return bytes of the whole file; EXPORT_TOO_MANY_TRIANGLES: 2^32 or more
[[nodiscard]] Result<std::uint64_t> write_glb_head(AtomicFile& file, std::string json,
                                                   std::uint64_t binary_bytes,
                                                   const std::filesystem::path& path);

/// Bytes of a file that says in its header that it has as many; nothing of one that was cut off,
/// has another container's header or is not there.
[[nodiscard]] std::optional<std::uint64_t> whole_glb_bytes(const std::filesystem::path& path);

/// The way a model vector goes into glTF: x east -> x, z up -> y, y north -> -z. No unit.
[[nodiscard]] constexpr Vec3 gltf_axes(Vec3 v) {
  return {v.x, v.z, -v.y};
}

/// Area-weighted mean of the normals around each vertex, in glTF's axes; up where a vertex has no
/// face, or faces that cancel. One thread, so that sums have one order.
[[nodiscard]] std::vector<Float3> gltf_normals(const TriMesh& mesh);

}  // namespace maquette::exporting
