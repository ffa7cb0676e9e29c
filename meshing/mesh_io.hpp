// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file mesh_io.hpp
/// Binary PLY, the meshes' own format on disk (float64 vertices, so that writing
/// and reading gives the same bits), and reading of meshes that others made.

#include <filesystem>

#include "core/mesh_stream.hpp"
#include "core/result.hpp"
#include "core/run_context.hpp"
#include "core/tri_mesh.hpp"

namespace maquette::meshing {

inline constexpr ErrorCode kMeshFormat{"MESHING_MESH_FORMAT"};
inline constexpr ErrorCode kMeshEmpty{"MESHING_MESH_EMPTY"};

/// Little-endian binary PLY: double x y z, faces as uchar + 3 uint; comment lines state
/// frame and unit. Streams, 1 MiB at a time. CORE_CANCELLED, CORE_DISK_FULL,
/// CORE_FILE_NOT_WRITABLE.
[[nodiscard]] Result<void> write_ply(const TriMesh& mesh, const std::filesystem::path& path,
                                     const RunContext& run = {});

[[nodiscard]] Result<void> write_ply(const MeshStream& mesh, const std::filesystem::path& path,
                                     const RunContext& run = {});

/// PLY, STL or OBJ, chosen by content and not by name.
///   PLY  ascii and both binary kinds, any scalar types, other elements and properties
///        skipped; polygons are fanned from their first corner
///   STL  ascii and binary; corners of equal coordinates (+0 = -0) become one vertex, in
///        order of first appearance; stored normals are ignored
///   OBJ  v and f (v, v/t, v//n, v/t/n, negative indices, polygons fanned); what the
///        format knows beside these is skipped, groups are not kept
/// Triangles come in the file's order, degenerate ones included; nothing is repaired
/// (mesh_checks says what a mesh is). Units are the file's.
/// CORE_FILE_NOT_FOUND, CORE_FILE_NOT_READABLE; MESHING_MESH_FORMAT with line or byte
/// offset and what was expected; MESHING_MESH_EMPTY: no triangle; CORE_CANCELLED.
/// Coordinates are finite, indices in range. Bytes after the end of binary data are
/// reported by run.warn. The file is mapped: it must not be shortened meanwhile.
[[nodiscard]] Result<TriMesh> read_mesh(const std::filesystem::path& path,
                                        const RunContext& run = {});

}  // namespace maquette::meshing
