// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file decimate.hpp
/// One coarser level of a mesh by quadric error (OpenMesh; Garland and Heckbert
/// 1997, doi:10.1145/258734.258849), with the vertical error measured afterwards.

#include "core/result.hpp"
#include "core/run_context.hpp"
#include "core/tri_mesh.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::meshing {

struct DecimatedMesh {
  TriMesh mesh;
  double max_vertical_error_mm = 0.0;  ///< against `surface`, at every vertex and every node
  double rms_vertical_error_mm = 0.0;
};

/// The open top surface of the field (no walls), reduced to about
/// `target_triangles`; its border stays on the outline. Fields of more than eight nodes
/// per triangle wanted, but not of less than 1024^2 and always of more than 2048^2, are
/// sub-sampled by whole factors first (the measured error includes that). About 50 us a
/// node then. Vertices are
/// nodes of the field; seen from above no triangle is turned over. The corners stay, so
/// two triangles are the least. MESHING_SURFACE_HAS_VOIDS, CORE_CANCELLED.
[[nodiscard]] Result<DecimatedMesh> decimate_surface(const heightmap::ModelField& surface,
                                                     std::uint64_t target_triangles,
                                                     const RunContext& run = {});

}  // namespace maquette::meshing
