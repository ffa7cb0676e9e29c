// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file solid.hpp
/// Heightmap (and stones) -> closed solid, by two meshers.
///
/// Room    meshing:  stones -> [solid] -> mesh_checks -> bands
/// Takes   ModelField, millimetres, no voids; stones as closed meshes
/// Gives   closed, outward-oriented TriMesh: the surface, four vertical walls on
///         the field's outline, a flat base at `base_z`
///
/// grid_solid    plain terrain; the top's vertices are the field's nodes, bit for
///               bit, with the field's own diagonals.
/// volume_solid  union of terrain and stones, facet by facet with exact predicates (CGAL): what is
///               left of the field's triangles and of the stones', and the line where they meet,
///               sharp. Pockets of air under a stone are filled. Where that is no manifold (stones
///               that cut themselves): OpenVDB narrow-band level set filled straight from the
///               height grid, stones united by CSG with a fillet of 1.5 voxels (no crevice too
///               narrow for the mesh), dual contouring, vertices moved onto stones or, straight up
///               or down, terrain, a Delaunay triangulation that joins them to the nodes; run.warn
///               tells. Cells without stones: as grid_solid. Walls and base are exact planes.
///
/// Accuracy of volume_solid: nodes to the bit, all other vertices where 32 bits hold them; every
/// point of the top lies on terrain or stone to 1e-3 mm (edges shorter than that are collapsed),
/// that rounding (1e-4 mm a metre from the origin, 2e-4 at two) and 1e-5 mm a stone of a group
/// (what they are shifted by where they only touch); few, beside slivers that rounding would turn
/// over, to 8e-3 mm. The mesh is sound with the coordinates that STL, OBJ and 3MF make of it, too;
/// run.warn tells where it is not. By level set: away from stones (more than 5
/// voxels and two spacings) the field's own triangles; vertices of the seam lie within half a voxel
/// of terrain or stone; all others on one of the two, except where that would let triangles cut
/// each other. The certificate measures it (MeshCheckOptions::stones).

#include <span>

#include "core/result.hpp"
#include "core/run_context.hpp"
#include "core/tri_mesh.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::meshing {

inline constexpr ErrorCode kSurfaceHasVoids{"MESHING_SURFACE_HAS_VOIDS"};
inline constexpr ErrorCode kBaseTooThin{"MESHING_BASE_TOO_THIN"};
inline constexpr ErrorCode kVoxelTooSmall{"MESHING_VOXEL_TOO_SMALL"};
inline constexpr ErrorCode kNotASolid{"MESHING_NOT_A_SOLID"};

struct SolidOptions {
  Millimetres base_z{-10.0};  ///< height of the underside; below the lowest node by >= 1 mm
  Millimetres voxel{0.0};     ///< of level sets round stones; 0 = the field's spacing
  double memory_limit_gib = 20.0;
};

/// MESHING_SURFACE_HAS_VOIDS (first row and column), MESHING_BASE_TOO_THIN, CORE_CANCELLED
[[nodiscard]] Result<TriMesh> grid_solid(const heightmap::ModelField& surface,
                                         const SolidOptions& options = {},
                                         const RunContext& run = {});

/// The same errors, and MESHING_VOXEL_TOO_SMALL before allocation (with the voxel
/// that would fit), MESHING_NOT_A_SOLID if a stone is not a closed, outward body inside
/// the walls and above the base, hangs in the air, or stands so near a wall (about four
/// voxels) that no terrain is left to join it to. Where no sound mesh comes out, finer
/// voxels (to a quarter) and other lattices are tried; run.warn tells.
/// @pre voxel >= 0
[[nodiscard]] Result<TriMesh> volume_solid(const heightmap::ModelField& surface,
                                           std::span<const TriMesh> stones,
                                           const SolidOptions& options = {},
                                           const RunContext& run = {});

}  // namespace maquette::meshing
