// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file geodesic.hpp
/// Distance along a surface from a set of sources, at every vertex: the field whose level
/// lines are geodesic offsets (cnc/geodesic_passes.hpp).
///
/// Takes   TriMesh (any connected or unconnected triangles, boundary and edges of three
///         triangles allowed), or ModelField as the triangulated grid it is, without a mesh
/// Gives   one float a vertex, millimetres; INFINITY where no way leads from a source
///
/// Method. Fast marching: at a triangle's corner C the distance is that of the wave through the
/// values at the other two corners A and B, if it comes through the triangle, else along an edge
/// (R. Kimmel, J. Sethian, "Computing geodesic paths on manifolds", PNAS 95, 1998,
/// doi:10.1073/pnas.95.15.8431). Waves are plane, of first order, where there are segments or a
/// slowness; from points and vertices alone they are round, about the place that has the distances
/// of A and B (M. Novotni, R. Klein, "Computing geodesic distances on triangular meshes", WSCG
/// 2002). Where the angle at C is obtuse, triangles beyond AB are unfolded into the plane of ABC
/// until a vertex lies at less than a right angle from both CA and CB; it splits C's triangle into
/// two (same paper, section 4). That says when a vertex gets its turn. Its value then comes from
/// farther back: the line that the wave came along is followed over the next five triangles that
/// are unfolded into the plane, and the wave through the last edge of them counts. Values along
/// edges are guessed once in five triangles then, where facets turn no bend of the surface is taken
/// for one of the front, and most waves that only seem to come through an edge, because two others
/// meet there, are found out. Around points and vertices the distances are exact out to
/// `exact_radius`: straight lines are followed over unfolded triangles and go on from saddle
/// vertices (J. Chen, Y. Han, "Shortest paths on a polyhedron", SoCG 1990, doi:10.1145/98524.98601,
/// with the filter of S.-Q. Xin, G.-J. Wang, ACM Trans. Graph. 28, 2009,
/// doi:10.1145/1559755.1559761). Near segments they are exact for the triangles crossed and their
/// neighbours.
///
/// Accuracy. Exact up to rounding (2^-24 of the distance) within exact_radius where there are no
/// segments, and for plane waves on developable surfaces without obtuse triangles; round waves on a
/// plane to 1e-4. Else, from points, with the default exact_radius, within 1 % of the distance at
/// every vertex: too long by at most 0.4 % where neighbouring facets turn by 20 degrees on average,
/// 0.7 % at 38 and 0.8 % at 44 degrees, too short, where waves meet (opposite sides of an
/// obstacle), by up to 0.9 % just beyond the radius and by 0.1 mm of edges of 0.5 mm farther out;
/// on average wrong by 0.1, 0.2 and 0.3 %. A smaller radius: half an edge. From segments and
/// slowness, where waves meet (a corner of the outline), too short by half an edge. Points beside
/// segments: first order times a logarithm. Not followed exactly: lines through edges of triangles
/// turned against each other, and beyond 4 million windows a source or 64 a vertex; unfolding of
/// obtuse triangles ends at a boundary or after 16. Cost. About 1.3 M vertices/s on one core, 1.0 M
/// of a TriMesh. ModelField: 4 bytes and a bit a node for the result and a front of O(sqrt(n));
/// TriMesh: 28 bytes a triangle beside. Exact discs: 6 to 20 us a vertex in reach.

#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "core/result.hpp"
#include "core/run_context.hpp"
#include "core/tri_mesh.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::meshing {

inline constexpr ErrorCode kGeodesicSource{"MESHING_GEODESIC_SOURCE"};
inline constexpr ErrorCode kGeodesicSurface{"MESHING_GEODESIC_SURFACE"};

/// Corner 0 + u (corner 1 - corner 0) + v (corner 2 - corner 0); u, v >= 0, u + v <= 1.
/// Triangle t of a ModelField with m columns: 2 (row (m - 1) + column) is the lower right half
/// of that cell, corners (0, 0), (0, 1), (1, 1) as (row, column); one more is the upper left
/// half, corners (0, 0), (1, 1), (1, 0). Vertex of a node: row m + column.
struct SurfacePoint {
  std::uint64_t triangle = 0;
  double u = 0.0, v = 0.0;
};
/// Straight piece of a line on the surface, inside or on the rim of one triangle.
struct SurfaceSegment {
  std::uint64_t triangle = 0;
  double u0 = 0.0, v0 = 0.0, u1 = 0.0, v1 = 0.0;
};

/// All of them have distance 0.
struct GeodesicSources {
  std::vector<std::uint32_t> vertices;
  std::vector<SurfacePoint> points;
  std::vector<SurfaceSegment> segments;
};

struct PlanPoint {
  double x_mm = 0.0, y_mm = 0.0;
};

/// The line over the field whose plan is `line`, cut where it crosses from facet to facet. Its
/// ends, and vertices where it turns by more than 20 degrees, become points as well, since round
/// waves start there. A single point is fine; a last point equal to the first closes it.
/// @return MESHING_GEODESIC_SOURCE if a point lies off the field
[[nodiscard]] Result<void> add_polyline(GeodesicSources& sources,
                                        const heightmap::ModelField& field,
                                        std::span<const PlanPoint> line);
/// The field's outline.
void add_outline(GeodesicSources& sources, const heightmap::ModelField& field);
/// All edges of only one triangle; inward corners become vertices.
void add_boundary(GeodesicSources& sources, const TriMesh& mesh);

struct GeodesicOptions {
  /// Around each point and vertex; NaN: 20 mean edges (of a grid: 20 times its spacing).
  double exact_radius_mm = std::numeric_limits<double>::quiet_NaN();
  /// Vertices farther away stay INFINITY.
  double max_distance_mm = std::numeric_limits<double>::infinity();
  /// Distance counted for each millimetre near a vertex, one a vertex; empty: 1 everywhere. With
  /// it, exact_radius counts as 0.
  std::span<const float> slowness{};
};

/// Deterministic; one thread.
/// @return MESHING_GEODESIC_SOURCE: no source, or one off the surface;
///         MESHING_GEODESIC_SURFACE: a coordinate not finite, an index out of range, a slowness
///         not positive or their number wrong; CORE_CANCELLED
[[nodiscard]] Result<std::vector<float>> geodesic_distance(const TriMesh& mesh,
                                                           const GeodesicSources& sources,
                                                           const GeodesicOptions& options = {},
                                                           const RunContext& run = {});
/// @pre at least 2 x 2 nodes, fewer than 2^32
[[nodiscard]] Result<Grid<float>> geodesic_distance(const heightmap::ModelField& field,
                                                    const GeodesicSources& sources,
                                                    const GeodesicOptions& options = {},
                                                    const RunContext& run = {});

}  // namespace maquette::meshing
