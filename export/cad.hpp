// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file cad.hpp
/// CAD files of a solid. `export` is a C++ word, hence namespace exporting.
///
/// Room    solid mesh or model field -> [export] -> files for other people's programs
/// All     appear whole or not at all, have the same bytes for any number of threads,
///         and keep model coordinates in millimetres.
/// Errors  EXPORT_EMPTY_MESH, CORE_FILE_NOT_WRITABLE, CORE_DISK_FULL, CORE_CANCELLED,
///         and those named below.
///
/// Measured with 32 M triangles: CPU seconds, memory beside the mesh, size of the file
///   STL 6 s, 0.1 GB, 1.6 GB; OBJ 6 s, 0.1 GB, 1.4 GB; 3MF 37 s, 1.3 GB, 0.4 GB

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "core/mesh_stream.hpp"
#include "core/result.hpp"
#include "core/run_context.hpp"
#include "core/tri_mesh.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::exporting {

inline constexpr ErrorCode kTooManyTriangles{"EXPORT_TOO_MANY_TRIANGLES"};
inline constexpr ErrorCode kEmptyMesh{"EXPORT_EMPTY_MESH"};
inline constexpr ErrorCode kOptionOutOfRange{"EXPORT_OPTION_OUT_OF_RANGE"};
inline constexpr ErrorCode kLibraryFailed{"EXPORT_LIBRARY_FAILED"};

/// Binary STL, millimetres, normals from the corners (zero for a triangle without
/// area). Streams. EXPORT_TOO_MANY_TRIANGLES: 2^32 or more.
[[nodiscard]] Result<void> write_stl(const TriMesh& mesh, const std::filesystem::path& path,
                                     const RunContext& run = {});
/// The same of a mesh that is made while it is written.
[[nodiscard]] Result<void> write_stl(const MeshStream& mesh, const std::filesystem::path& path,
                                     const RunContext& run = {});
/// Wavefront OBJ, 1e-6 mm, frame and unit in comments. Streams.
[[nodiscard]] Result<void> write_obj(const TriMesh& mesh, const std::filesystem::path& path,
                                     const RunContext& run = {});

[[nodiscard]] Result<void> write_obj(const MeshStream& mesh, const std::filesystem::path& path,
                                     const RunContext& run = {});

/// USD in its text form: one mesh under a prim of that `name`, model frame (upAxis Z, metersPerUnit
/// 0.001), float32, no subdivision, matt paint as UsdPreviewSurface. Streams.
/// EXPORT_TOO_MANY_TRIANGLES: 2^31 vertices or more.
[[nodiscard]] Result<void> write_usda(const TriMesh& mesh, std::string_view name,
                                      const std::filesystem::path& path,
                                      const RunContext& run = {});
[[nodiscard]] Result<void> write_usda(const MeshStream& mesh, std::string_view name,
                                      const std::filesystem::path& path,
                                      const RunContext& run = {});

struct NamedMesh {
  std::string name, part_number;
  const TriMesh* mesh = nullptr;
};
/// 3MF core specification by lib3mf: unit millimetre, one object and build item per
/// mesh, coordinates as lib3mf keeps them (float32, then cut to 1e-6 mm: 1.25e-4 mm off at 2 m;
/// meshing::CoordinateRounding::lib3mf); times and UUIDs are fixed, not drawn.
/// EXPORT_TOO_MANY_TRIANGLES: more than 40 M in all; EXPORT_LIBRARY_FAILED: lib3mf
/// refuses the mesh (a triangle that has a corner twice) or a coordinate over 1e9.
[[nodiscard]] Result<void> write_3mf(const std::vector<NamedMesh>& meshes,
                                     const std::filesystem::path& path, const RunContext& run = {});

/// One of the meshes, shifted, as it is to be built.
struct BuildItem {
  std::size_t mesh = 0;
  Vec3 shift_mm;
  std::string part_number;  ///< of this one of them
};
/// The same with each mesh once and any number of build items that refer to it.
/// @pre items name meshes that are there
[[nodiscard]] Result<void> write_3mf(const std::vector<NamedMesh>& meshes,
                                     const std::vector<BuildItem>& items,
                                     const std::filesystem::path& path, const RunContext& run = {});

/// DXF (R12, read by everything): contour lines at the multiples of `interval` as
/// closed or open POLYLINEs at their height on layer CONTOUR, higher ground on the
/// left; the rectangle of the field at height 0 on layer OUTLINE. See contours.hpp.
/// EXPORT_OPTION_OUT_OF_RANGE: interval not positive, or more than 10 000 levels;
/// EXPORT_EMPTY_MESH: no cell, or every node void.
[[nodiscard]] Result<void> write_dxf_contours(const heightmap::ModelField& surface,
                                              Millimetres interval,
                                              const std::filesystem::path& path,
                                              const RunContext& run = {});

}  // namespace maquette::exporting
