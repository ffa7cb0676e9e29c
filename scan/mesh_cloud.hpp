// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file mesh_cloud.hpp
/// A polygon mesh through a cloud of points, with colours at its vertices; open where nothing was
/// seen, or closed.
///
/// Takes    a cloud with stations (normals are turned towards the scanner), any shape, overhangs
///          included
/// Method   The cloud is cut into voxels; each gives the mean of its points with a normal
///          (scan/merge.hpp). Around them an implicit function is summed: the distance to the
///          neighbours' planes with weights that fall with distance (Shen, O'Brien, Shewchuk
///          2004, doi:10.1145/1015706.1015816; Kolluri 2008, doi:10.1145/1361192.1361195). Its zero
///          is meshed by one vertex for each piece of it in a cell (dual marching cubes: Nielson
///          2004, doi:10.1109/VISUAL.2004.28), which then steps onto the zero along the gradient.
/// Manifold By construction: an edge has one or two triangles, the triangles at a vertex are one
///          fan, closed or open (scan/detail/dual_mesh.hpp, mesh_borders.hpp). Faces may still
///          pass through each other where the points do.
/// Open     Triangles are made only near points (a voxel away at most). Chance leaves a voxel and
/// its
///          neighbours without points now and then (1068 times in 5 M voxels of four points), so
///          holes whose border is no longer than 16 voxels are closed by a fan and counted: gaps up
///          to three voxels wide. Gaps of six and more stay, whatever their length. Their border
///          loops are listed with length and area.
/// Closed   Each border loop is filled by a fan from its middle: no hole remains, but what a fan
///          covers was not seen; the outer border of an open part is closed likewise.
/// Accuracy On smooth surfaces of curvature 1/R within voxel^2 / R of the points' mean, and
///          their noise falls with the root of the points per neighbourhood.
/// Memory   Goes with the voxels, not with the points: 4.9 GiB for 5 M voxels, of 20 M points or of
///          more.
/// Cost     20 M points on 2 m x 2 m, 10.4 M triangles: 173 s of CPU on a loaded machine, most of
///          it in parallel (tests/bench/scan_merge_bench).

#include <filesystem>
#include <vector>

#include "core/result.hpp"
#include "core/run_context.hpp"
#include "core/tri_mesh.hpp"
#include "scan/cloud_stream.hpp"

namespace maquette::scan {

inline constexpr ErrorCode kMeshCloudOptions{"SCAN_MESH_OPTIONS"};
inline constexpr ErrorCode kMeshCloudSparse{"SCAN_MESH_SPARSE"};

struct MeshCloudOptions {
  /// 0: four points each where there are any, more where that would be above 6 million voxels
  double voxel_mm = 0.0;
  bool closed = false;
};

/// A loop of border edges.
struct MeshHole {
  std::size_t edges = 0;
  double length_mm = 0.0;
  double area_mm2 = 0.0;  ///< of the fan that fills it
  Vec3 middle_mm;
};

struct CloudMesh {
  TriMesh mesh;
  std::vector<Colour> colours;  ///< one a vertex, or empty
  std::vector<MeshHole> holes;  ///< of the open mesh, longest first, without pinholes
  std::size_t pinholes = 0;     ///< closed
  double voxel_mm = 0.0;
};

/// @param open  of any size: it is read twice, in batches
/// @return the mesh, or
///   SCAN_MESH_OPTIONS  voxel negative or too small for the extent
///   SCAN_MESH_SPARSE   no triangles: too few points a voxel to tell a surface
///   CORE_CANCELLED, errors of reading
[[nodiscard]] Result<CloudMesh> mesh_cloud(const OpenCloud& open,
                                           const MeshCloudOptions& options = {},
                                           const RunContext& run = {});
[[nodiscard]] Result<CloudMesh> mesh_cloud(const Cloud& cloud, const MeshCloudOptions& options = {},
                                           const RunContext& run = {});

/// Binary PLY: double x y z, uchar red green blue where there are colours, faces as uchar + 3 uint.
/// CORE_FILE_NOT_WRITABLE, CORE_DISK_FULL
[[nodiscard]] Result<void> write_mesh_ply(const CloudMesh& mesh, const std::filesystem::path& path);

}  // namespace maquette::scan
