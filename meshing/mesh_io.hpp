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

/// PLY, STL, OBJ or glTF, chosen by content and not by name.
///   PLY  ascii and both binary kinds, any scalar types, other elements and properties
///        skipped; polygons are fanned from their first corner
///   STL  ascii and binary; corners of equal coordinates (+0 = -0) become one vertex, in
///        order of first appearance; stored normals are ignored
///   OBJ  v and f (v, v/t, v//n, v/t/n, negative indices, polygons fanned); what the
///        format knows beside these is skipped, groups are not kept
///   glTF binary or text, of version 2: the triangles of the scene with their nodes' poses, plain,
///        quantised (KHR_mesh_quantization) or by Draco; corners of equal coordinates become one
///        vertex. The format is in metres with y up: x stays, y becomes z, z becomes -y, in mm
/// Triangles come in the file's order, degenerate ones included; nothing is repaired
/// (mesh_checks says what a mesh is). Units are the file's, of a glTF mm.
/// CORE_FILE_NOT_FOUND, CORE_FILE_NOT_READABLE; MESHING_MESH_FORMAT with line or byte
/// offset and what was expected; MESHING_MESH_EMPTY: no triangle; CORE_CANCELLED.
/// Coordinates are finite, indices in range. Bytes after the end of binary data are
/// reported by run.warn. The file is mapped: it must not be shortened meanwhile.
[[nodiscard]] Result<TriMesh> read_mesh(const std::filesystem::path& path,
                                        const RunContext& run = {});

/// Whether read_mesh takes the file for a glTF, whose unit the format says.
[[nodiscard]] Result<bool> is_gltf(const std::filesystem::path& path);

}  // namespace maquette::meshing
