// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file simplify.hpp
/// Stones, spacecraft and other bodies with fewer triangles.
///
/// Room    mesh_io -> [simplify] -> export
/// Takes   a 2-manifold mesh, millimetres; open ones keep their borders, and what cuts itself is
///         warned of
/// Gives   one of fewer triangles, and how far the two are apart; closed, and free of cuts, if it
///         was
///
/// Method. Half edges collapsed in the order of their quadrics' errors (M. Garland, P. Heckbert,
/// "Surface simplification using quadric error metrics", SIGGRAPH 1997,
/// doi:10.1145/258734.258849), by OpenMesh; vertices that stay do not move. A collapse that turns a
/// facet's normal by more than 60 degrees is not made; where the outcome still cuts itself it is
/// made anew with 30 and with 15 degrees.
/// Terrain has an algorithm of its own (decimate.hpp): its error is vertical and has a bound.
/// Cost. A body of 1.3 M triangles to 20 000: 85 s of processor time, 0.55 GiB; to a deviation some
/// eight times that.

#include <cstdint>

#include "core/result.hpp"
#include "core/run_context.hpp"
#include "core/tri_mesh.hpp"
#include "core/units.hpp"
#include "meshing/mesh_checks.hpp"

namespace maquette::meshing {

inline constexpr ErrorCode kNotSimplified{"MESHING_NOT_SIMPLIFIED"};

struct SimplifiedMesh {
  TriMesh mesh;
  /// Largest distance from either to the other, at vertices, middles of edges and of triangles.
  double deviation_mm = 0.0;
  MeshCertificate certificate;
};

/// As few triangles as `triangles`, or as few above that as normals allow.
/// MESHING_NOT_SIMPLIFIED: not manifold, degenerate triangles, or nothing comes of it that is as
/// sound; CORE_CANCELLED.
/// @pre triangles >= 4
[[nodiscard]] Result<SimplifiedMesh> simplify(const TriMesh& mesh, std::uint64_t triangles,
                                              const RunContext& run = {});

/// The fewest triangles, to a sixteenth, that keep `most` as deviation.
/// The same errors. @pre most > 0
[[nodiscard]] Result<SimplifiedMesh> simplify_within(const TriMesh& mesh, Millimetres most,
                                                     const RunContext& run = {});

}  // namespace maquette::meshing
