// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file mesh_checks.hpp
/// What a mesh is proven to be, by CGAL.

#include <cmath>
#include <cstdint>
#include <span>
#include <string>

#include "core/result.hpp"
#include "core/run_context.hpp"
#include "core/tri_mesh.hpp"
#include "heightmap/height_field.hpp"
#include "meshing/coordinate_rounding.hpp"

namespace maquette::meshing {

/// The farthest that a solid of terrain and stones may be from both of them.
inline constexpr double kMostUnionError_mm = 0.02;

struct MeshCertificate {
  /// How the properties below were shown: "CGAL", or "graph of a height" (grid_stream.hpp).
  std::string proof = "CGAL";
  std::uint64_t vertices = 0, triangles = 0;
  bool manifold = false;          ///< CGAL: a valid 2-manifold polygon mesh
  bool closed = false;            ///< CGAL::is_closed
  bool oriented_outward = false;  ///< CGAL: is_outward_oriented, every shell
  std::uint64_t degenerate_triangles = 0;
  bool self_intersection_checked = false;
  bool self_intersecting = false;
  std::uint64_t shells = 0;
  std::int64_t euler_number = 0;
  double volume_mm3 = 0.0, area_mm2 = 0.0;
  double max_vertical_error_mm = 0.0;  ///< top vertices against the field; 0 if none given
  double rms_vertical_error_mm = 0.0;
  std::uint64_t vertices_compared = 0;       ///< with the field
  std::uint64_t vertices_above_surface = 0;  ///< taken for a stone's and not compared
  /// With stones: the farthest that any vertex, middle of a triangle or of an edge where terrain
  /// and stones meet is from the nearer of both (terrain: vertically); NaN where none were given.
  double max_union_error_mm = NAN;
  /// How far the file format's rounding moves a vertex; NaN where nobody asked.
  double rounding_mm = NAN;
  /// The field's surface and the file's top are nowhere farther apart, both ways; NaN where
  /// that is not proven (stones).
  double hausdorff_bound_mm = NAN;
  /// A solid; what was not looked for is not taken for granted.
  [[nodiscard]] bool sound() const {
    return manifold && closed && oriented_outward && degenerate_triangles == 0 &&
           self_intersection_checked && !self_intersecting;
  }
  /// With stones the union's error counts, too: a fillet round them, where there was no exact
  /// union, does not pass.
  [[nodiscard]] bool passed() const {
    return sound() && !(max_union_error_mm > kMostUnionError_mm);
  }
};
/// Why a certificate has not passed, in words; empty if it has.
[[nodiscard]] std::string shortcomings(const MeshCertificate& certificate);

struct MeshCheckOptions {
  /// Costs most. Piece by piece (detail/intersection_pieces.hpp), so that nothing but time limits
  /// it; where `surface` is given, most of the terrain's own triangles need not be looked at.
  bool self_intersections = true;
  std::uint64_t self_intersection_limit = UINT64_MAX;  ///< off above this many triangles
  /// Of so many first triangles, whose vertices come first, too, heights are compared: the top of a
  /// part that is hollow or engraved (shaped_solid.hpp). All other checks look at all.
  std::uint64_t top_triangles = UINT64_MAX;
  /// That the mesh's coordinates have been through, and the surface's have not.
  CoordinateRounding rounding = CoordinateRounding::none;
  /// What was united with the surface: vertices on them are then told from terrain by distance, and
  /// all are compared.
  std::span<const TriMesh> stones{};
};

/// Never fails on a bad mesh: says in the certificate what is wrong with it. A mesh with
/// indices out of range or coordinates that are not finite gets counts and no property;
/// volume and orientation are found for closed manifold meshes only; self-intersection is
/// looked for where no triangle is degenerate. CORE_CANCELLED.
/// @param surface  when given, vertices above the base are compared with it (away from
///                 walls, base and stones higher than 0.05 mm above it). A surface that
///                 as a whole is too high thus counts as stone: see
///                 `vertices_above_surface`; not so where options.stones are given
[[nodiscard]] Result<MeshCertificate> check_mesh(const TriMesh& mesh,
                                                 const heightmap::ModelField* surface = nullptr,
                                                 const MeshCheckOptions& options = {},
                                                 const RunContext& run = {});
[[nodiscard]] std::string to_json(const MeshCertificate& certificate);

}  // namespace maquette::meshing
