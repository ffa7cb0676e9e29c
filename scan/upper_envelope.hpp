// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file upper_envelope.hpp
/// What of a mesh is seen from straight above, as heights on a grid: where a scan may lie on it,
/// and the sheet on which its deviations are drawn.

#include "core/result.hpp"
#include "core/tri_mesh.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::scan {

inline constexpr ErrorCode kNoUpperSide{"SCAN_NO_UPPER_SIDE"};

/// Heights of the highest triangle over each node of a grid whose spacing is the mean leg of the
/// triangles that face up, as if they were halves of squares: a triangulated height grid comes
/// out as the grid that it was made from, to rounding. At most 4097 nodes a side. Nodes beside the
/// mesh are voids. What lies below an overhang is not in it.
/// @return SCAN_NO_UPPER_SIDE if no triangle faces up or the mesh has no extent in x or y
[[nodiscard]] Result<heightmap::ModelField> upper_envelope(const TriMesh& mesh);

}  // namespace maquette::scan
