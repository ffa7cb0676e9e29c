// SPDX-License-Identifier: GPL-3.0-or-later
#include "meshing/geodesic.hpp"

#include <cmath>

#include <fmt/format.h>

#include "core/check.hpp"
#include "meshing/detail/corner_surface.hpp"
#include "meshing/detail/fast_marching.hpp"
#include "meshing/detail/straight_lines.hpp"

namespace maquette::meshing {
namespace {

constexpr double kDefaultRadiusInEdges = 20.0;
constexpr double kOnVertex = 1e-9;  // weights this near to a corner's are the corner
constexpr double kRim = 1e-9;       // weights may be outside by this much, from rounding

bool inside(double u, double v) {
  return u >= -kRim && v >= -kRim && u + v <= 1.0 + kRim;
}

template <class Surface>
Result<void> check_sources(const Surface& surface, const GeodesicSources& sources) {
  if (sources.vertices.empty() && sources.points.empty() && sources.segments.empty())
    return fail(kGeodesicSource, "no source: give at least one vertex, point or segment");
  for (std::size_t i = 0; i < sources.vertices.size(); ++i)
    if (sources.vertices[i] >= surface.vertices())
      return fail(kGeodesicSource, fmt::format("source vertex {} is {}, but there are {} vertices",
                                               i, sources.vertices[i], surface.vertices()));
  const auto check = [&](const char* what, std::size_t i, std::uint64_t triangle, double u,
                         double v) -> Result<void> {
    if (triangle < surface.triangles() && inside(u, v)) return {};
    return fail(kGeodesicSource,
                fmt::format("source {} {} is at weights {}, {} of triangle {}; there are {} "
                            "triangles, and weights are at least 0 with a sum of at most 1",
                            what, i, u, v, triangle, surface.triangles()));
  };
  for (std::size_t i = 0; i < sources.points.size(); ++i) {
    const SurfacePoint& p = sources.points[i];
    MAQUETTE_TRY_VOID(check("point", i, p.triangle, p.u, p.v));
  }
  for (std::size_t i = 0; i < sources.segments.size(); ++i) {
    const SurfaceSegment& s = sources.segments[i];
    MAQUETTE_TRY_VOID(check("segment", i, s.triangle, s.u0, s.v0));
    MAQUETTE_TRY_VOID(check("segment", i, s.triangle, s.u1, s.v1));
  }
  return {};
}

Result<void> check_slowness(std::span<const float> slowness, std::size_t vertices) {
  if (slowness.empty()) return {};
  if (slowness.size() != vertices)
    return fail(kGeodesicSurface, fmt::format("{} slownesses for {} vertices; one each is needed",
                                              slowness.size(), vertices));
  for (std::size_t v = 0; v < slowness.size(); ++v)
    if (!(slowness[v] > 0.0F && std::isfinite(slowness[v])))
      return fail(
          kGeodesicSurface,
          fmt::format("slowness of vertex {} is {}; it must be greater than 0", v, slowness[v]));
  return {};
}

/// @return false if stopped
template <class Surface>
bool distances(const Surface& surface, const GeodesicSources& sources,
               const GeodesicOptions& options, double mean_edge, std::span<float> distance,
               const RunContext& run) {
  const bool weighted = !options.slowness.empty();
  double radius = std::isnan(options.exact_radius_mm) ? kDefaultRadiusInEdges * mean_edge
                                                      : options.exact_radius_mm;
  radius = weighted ? 0.0 : std::min(radius, options.max_distance_mm);
  detail::FastMarching<Surface> marching(surface, options.slowness, distance);
  marching.round_waves(!weighted && sources.segments.empty());
  struct Seeds {
    detail::FastMarching<Surface>& marching;
    std::span<const float> slowness;
    [[nodiscard]] double value(std::uint32_t v) const { return marching.value(v); }
    void seed(std::uint32_t v, double d) {
      marching.seed(v, slowness.empty() ? d : d * static_cast<double>(slowness[v]));
    }
  } seeds{marching, options.slowness};
  detail::StraightLines<Surface, Seeds> lines(surface, seeds);
  for (const std::uint32_t v : sources.vertices) lines.from_vertex(v, radius);
  for (const SurfacePoint& p : sources.points) {
    const auto c = surface.corner(p.triangle);
    if (p.u < kOnVertex && p.v < kOnVertex)
      lines.from_vertex(surface.vertex(c), radius);
    else if (p.u > 1.0 - kOnVertex)
      lines.from_vertex(surface.vertex(surface.next(c)), radius);
    else if (p.v > 1.0 - kOnVertex)
      lines.from_vertex(surface.vertex(surface.prev(c)), radius);
    else
      lines.from_point(c, p.u, p.v, radius);
  }
  for (const SurfaceSegment& s : sources.segments)
    lines.from_segment(surface.corner(s.triangle), {s.u0, s.v0}, {s.u1, s.v1});
  if (sources.segments.empty()) marching.keep_up_to(std::min(radius, lines.complete_up_to()));
  return marching.run(options.max_distance_mm, run);
}

double mean_edge(const TriMesh& mesh) {
  double sum = 0.0;
  for (const auto& t : mesh.triangles)
    for (std::size_t i = 0; i < 3; ++i)
      sum += norm(mesh.vertices_mm[t[i]] - mesh.vertices_mm[t[(i + 1) % 3]]);
  return mesh.triangles.empty() ? 0.0 : sum / (3.0 * static_cast<double>(mesh.triangles.size()));
}

}  // namespace

Result<std::vector<float>> geodesic_distance(const TriMesh& mesh, const GeodesicSources& sources,
                                             const GeodesicOptions& options,
                                             const RunContext& run) {
  for (std::size_t v = 0; v < mesh.vertices_mm.size(); ++v) {
    const Vec3 p = mesh.vertices_mm[v];
    if (!std::isfinite(p.x) || !std::isfinite(p.y) || !std::isfinite(p.z))
      return fail(kGeodesicSurface, fmt::format("vertex {} is at ({}, {}, {})", v, p.x, p.y, p.z));
  }
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t)
    for (const std::uint32_t v : mesh.triangles[t])
      if (v >= mesh.vertices_mm.size())
        return fail(kGeodesicSurface, fmt::format("triangle {} names vertex {} of {}", t, v,
                                                  mesh.vertices_mm.size()));
  if (mesh.triangles.size() >= (std::uint64_t{1} << 32) / 3)
    return fail(kGeodesicSurface,
                fmt::format("{} triangles; at most {} are possible", mesh.triangles.size(),
                            (std::uint64_t{1} << 32) / 3 - 1));
  MAQUETTE_TRY_VOID(check_slowness(options.slowness, mesh.vertices_mm.size()));
  const detail::MeshSurface surface(mesh);
  MAQUETTE_TRY_VOID(check_sources(surface, sources));
  std::vector<float> distance(surface.vertices(), INFINITY);
  if (!distances(surface, sources, options, mean_edge(mesh), distance, run))
    return fail(kCancelled, "geodesic distances: stopped");
  return distance;
}

Result<Grid<float>> geodesic_distance(const heightmap::ModelField& field,
                                      const GeodesicSources& sources,
                                      const GeodesicOptions& options, const RunContext& run) {
  const std::ptrdiff_t rows = field.z_mm.rows(), cols = field.z_mm.cols();
  MAQUETTE_CHECK(rows >= 2 && cols >= 2 && field.z_mm.cells().size() < (std::uint64_t{1} << 32),
                 "{} x {} nodes", rows, cols);
  for (std::ptrdiff_t r = 0; r < rows; ++r)
    for (std::ptrdiff_t c = 0; c < cols; ++c)
      if (!std::isfinite(field.z_mm(r, c)))
        return fail(kGeodesicSurface, fmt::format("height is {} at row {}, column {}; fill voids",
                                                  field.z_mm(r, c), r, c));
  const detail::GridSurface surface(field);
  MAQUETTE_TRY_VOID(check_slowness(options.slowness, surface.vertices()));
  MAQUETTE_TRY_VOID(check_sources(surface, sources));
  Grid<float> distance(rows, cols, INFINITY);
  if (!distances(surface, sources, options, field.spacing.value(), distance.cells(), run))
    return fail(kCancelled, "geodesic distances: stopped");
  return distance;
}

}  // namespace maquette::meshing
