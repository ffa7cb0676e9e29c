// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file decimate.hpp
/// A field's surface with fewer triangles, to a count or to a bound of its vertical error.
///
/// Method   Greedy insertion of the worst node (detail/surface_triangulation.hpp), edges turned
///          along ridges (detail/edge_turns.hpp), heights of the inner vertices fitted by least
///          squares (detail/height_fit.hpp). The last two never pass the error that insertion
///          has reached, so the bound holds.
/// Accuracy measured at every node with the mesh as it is given out, in integers of rows and
///          columns. Beside plain greedy insertion with as many triangles: the same maximum to 0.1
///          %, rms 0.76 to 0.84 of its. Beside the program hmm, which stops wherever it is: 0.4 to
///          0.7 of its maximum, rms 0.81 of its. OpenMesh's quadrics: 2.7 to 2.9 times our
///          maximum, 1.4 times our rms, 2 to 5 of a hundred triangles turned over (tools/bench
///          meshing).
/// Cost     2 to 5 us of processor time a triangle at 16 nodes each, more the less of the field
///          caches hold; 59 MiB a million triangles beside the field, the result's 23 among them.

#include <cstdint>

#include "core/result.hpp"
#include "core/run_context.hpp"
#include "core/tri_mesh.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::meshing {

struct DecimateOptions {
  /// Ends at whichever comes first. 0 mm with no count: all nodes that are not on the facets.
  std::uint64_t most_triangles = std::uint64_t{1} << 32;
  Millimetres max_error{0.0};  ///< vertical, at every node
  /// The border's vertices depend on the border's heights and `border_error` alone, so that
  /// fields which share a border (bands) have the same vertices there, with the nodes' heights.
  bool lock_border = false;
  Millimetres border_error{0.0};  ///< vertical, along the border; not more than max_error then
};

struct DecimatedMesh {
  TriMesh mesh;
  double max_vertical_error_mm = 0.0;  ///< against the field, at every node
  double rms_vertical_error_mm = 0.0;
};

/// The open top surface (no walls). Vertices stand on nodes, corners and border on the outline
/// with the nodes' heights; seen from above no triangle is turned over. Two triangles are the
/// least; a locked border may need more than `most_triangles`.
/// MESHING_SURFACE_HAS_VOIDS, CORE_CANCELLED.
/// @pre errors >= 0; border_error <= max_error if both are given and the border is locked
[[nodiscard]] Result<DecimatedMesh> decimate_surface(const heightmap::ModelField& surface,
                                                     const DecimateOptions& options,
                                                     const RunContext& run = {});

}  // namespace maquette::meshing
