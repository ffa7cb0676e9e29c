// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file register_mesh.hpp
/// Where a scan lies on a part that is given as triangles.
///
/// Coarse   on what of the mesh is seen from above (upper_envelope.hpp), as register_scan does:
/// from
///          the pose given, or from anywhere. If that does not lead to the part (a stone scanned
///          all round), the pose given is tried on the mesh itself.
/// Fine     point to the plane of the nearest triangle, all sides of the mesh, with the weights,
///          the covariance and the refusals of register_scan, on 300 000 points.
/// Accepted if the points come to rest with least_overlap of them within five times the noise and a
///          noise below 1/200 of the mesh's diagonal: another part of the same size lies off by
///          more. What the search from above has refused stays refused where the unit is wrong, and
///          where the points lie on what is seen from above.

#include "core/result.hpp"
#include "core/run_context.hpp"
#include "scan/cloud.hpp"
#include "scan/mesh_distance.hpp"
#include "scan/register.hpp"

namespace maquette::scan {

/// @param top  upper_envelope() of the mesh
/// @return as register_scan
[[nodiscard]] Result<Registration> register_mesh(const Cloud& cloud, const MeshDistance& mesh,
                                                 const heightmap::ModelField& top,
                                                 const RegisterOptions& options = {},
                                                 const RunContext& run = {});

}  // namespace maquette::scan
