// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file decimate.hpp
/// A field's surface with fewer triangles, to a count or to a bound of its vertical error.
///
/// Method   To a count: triangles halved where the best plane leaves most, then vertices moved in
///          x, y and z by Gauss-Newton steps to where the sum of squared vertical distances to
///          the nodes is least, edges turned with the same aim, at last the farthest nodes
///          inserted (detail/terrain_fit.hpp). To a bound, with a locked border, or with less
///          than four nodes a triangle: greedy insertion of the worst node
///          (detail/surface_triangulation.hpp), edges turned along ridges (detail/edge_turns.hpp),
///          heights of the inner vertices fitted (detail/height_fit.hpp); the last two never pass
///          the error that insertion has reached, so the bound holds.
/// Accuracy measured at every node with the mesh as it is given out. To a count, beside the
///          program hmm (greedy insertion) with as many triangles, on fractal ground and on DEMs
///          of Mars and the Moon: rms 0.51 to 0.67 of its (0.65 at a million triangles of 16 nodes
///          each), largest error 0.40 to 0.93, once 1.04 (both on heights as floats; the program,
///          which takes 16 bits, has three times our largest at a million). To a bound: rms 0.76 to
///          0.84 of greedy insertion's. OpenMesh's quadrics turn 2 to 5 of a hundred triangles over
///          (tools/bench meshing).
/// Cost     To a count of a million 4.4 us of processor time a triangle of 16 nodes, 0.74 of what
///          the program hmm takes; of fewer triangles about as much as hmm. To a bound 2 to 5 us.
///          57 to 60 MiB a million triangles beside the field, the result's 23 among them.

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

/// The open top surface (no walls). Corners and vertices of the border stand on nodes of the
/// outline with their heights; to a bound the inner ones stand on nodes too, to a count on
/// sixteenths of the spacing. Seen from above no triangle is turned over. Two triangles are the
/// least; a locked border may need more than `most_triangles`.
/// MESHING_SURFACE_HAS_VOIDS, CORE_CANCELLED.
/// @pre errors >= 0; border_error <= max_error if both are given and the border is locked
[[nodiscard]] Result<DecimatedMesh> decimate_surface(const heightmap::ModelField& surface,
                                                     const DecimateOptions& options,
                                                     const RunContext& run = {});

}  // namespace maquette::meshing
