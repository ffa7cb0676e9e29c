// SPDX-License-Identifier: GPL-3.0-or-later
#include "meshing/decimate.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "core/check.hpp"
#include "meshing/detail/edge_turns.hpp"
#include "meshing/detail/height_fit.hpp"
#include "meshing/detail/shell.hpp"
#include "meshing/detail/surface_triangulation.hpp"
#include "meshing/detail/terrain_fit.hpp"

namespace maquette::meshing {
namespace {

using detail::SurfaceTriangulation;
using detail::TerrainMesh;
using heightmap::ModelField;

/// First vertices stand this far apart, in nodes: scanning what is larger costs much, and one in
/// five hundred triangles on a grid is not seen in the error (of one in 32 it is 1 % larger).
std::int32_t first_cell(const ModelField& field, const DecimateOptions& options) {
  constexpr double kShare = 1.0 / 512.0, kLargest = 128.0;
  const auto nodes = static_cast<double>(field.z_mm.rows() * field.z_mm.cols());
  const double wanted = std::fmax(kShare * static_cast<double>(options.most_triangles), 1.0);
  const double cell = std::sqrt(2.0 * nodes / wanted);
  // To a bound the count is not known: level ground then has the largest cells.
  if (options.max_error.value() > 0.0) return static_cast<std::int32_t>(std::fmax(cell, kLargest));
  return static_cast<std::int32_t>(std::fmax(cell, 2.0));
}

/// Puts vertices on a grid, row by row there and back, so that each is near the one before.
void insert_grid(SurfaceTriangulation& surface, std::int32_t cell) {
  const auto rows = static_cast<std::int32_t>(surface.field().z_mm.rows());
  const auto cols = static_cast<std::int32_t>(surface.field().z_mm.cols());
  std::uint32_t hint = 0;
  bool back = false;
  for (std::int32_t r = cell; r < rows - 1; r += cell, back = !back) {
    const std::int32_t last = (cols - 2) / cell * cell;
    for (std::int32_t c = cell; c < cols - 1; c += cell)
      hint = surface.insert(r, back ? last + cell - c : c, hint);
  }
}

/// Splits the line of nodes first .. last at its worst node until none is farther than
/// `error_mm` from it (Douglas, Peucker 1973, vertically), and reports the nodes in between.
/// Looks at these nodes alone: whoever has the same ones gets the same line.
template <class Height, class Take>
void split_line(std::ptrdiff_t first, std::ptrdiff_t last, double error_mm, Height height,
                Take take) {
  std::vector<std::pair<std::ptrdiff_t, std::ptrdiff_t>> open{{first, last}};
  while (!open.empty()) {
    const auto [a, b] = open.back();
    open.pop_back();
    const double rise = (height(b) - height(a)) / static_cast<double>(b - a);
    double worst = error_mm;
    std::ptrdiff_t at = -1;
    for (std::ptrdiff_t i = a + 1; i < b; ++i) {
      const double off = std::abs(height(a) + rise * static_cast<double>(i - a) - height(i));
      if (!(off > worst)) continue;
      worst = off;
      at = i;
    }
    if (at < 0) continue;
    take(at);
    open.emplace_back(at, b);
    open.emplace_back(a, at);
  }
}

void insert_border(SurfaceTriangulation& surface, double error_mm) {
  const Grid<float>& z = surface.field().z_mm;
  std::uint32_t hint = 0;
  const auto insert = [&](std::ptrdiff_t r, std::ptrdiff_t c) {
    hint = surface.insert(static_cast<std::int32_t>(r), static_cast<std::int32_t>(c), hint);
  };
  for (const std::ptrdiff_t r : {std::ptrdiff_t{0}, z.rows() - 1})
    split_line(
        0, z.cols() - 1, error_mm, [&](std::ptrdiff_t c) { return static_cast<double>(z(r, c)); },
        [&](std::ptrdiff_t c) { insert(r, c); });
  for (const std::ptrdiff_t c : {std::ptrdiff_t{0}, z.cols() - 1})
    split_line(
        0, z.rows() - 1, error_mm, [&](std::ptrdiff_t r) { return static_cast<double>(z(r, c)); },
        [&](std::ptrdiff_t r) { insert(r, c); });
}

/// The mesh, and its vertical errors at all nodes. Triangles are given back as they are copied.
template <class Triangulation>
DecimatedMesh take_mesh(Triangulation& surface) {
  const ModelField& field = surface.field();
  DecimatedMesh result;
  result.mesh.triangles.reserve(surface.triangles().size());
  const auto last_row = static_cast<std::int32_t>(field.z_mm.rows() - 1);
  const auto last_col = static_cast<std::int32_t>(field.z_mm.cols() - 1);
  double sum = 0.0;
  for (std::uint32_t t = 0; t < surface.triangles().size(); ++t) {
    const auto& triangle = surface.triangles()[t];
    MAQUETTE_CHECK(surface.doubled_area(triangle) > 0, "triangle {} was turned over", t);
    const auto off_at = [&](std::int32_t r, std::int32_t k, double z, double per_col) {
      return std::abs(z + per_col * k - static_cast<double>(field.z_mm(r, k)));
    };
    surface.for_rows(
        triangle, true,
        [&](std::int32_t r, std::int32_t from, std::int32_t to, double z, double per_col) {
          for (std::int32_t k = from; k <= to; ++k) {
            const double off = off_at(r, k, z, per_col);
            sum += off * off;
          }
        });
    surface.for_rows(
        triangle, false,
        [&](std::int32_t r, std::int32_t from, std::int32_t to, double z, double per_col) {
          for (std::int32_t k = from; k <= to; ++k) {
            const double off = off_at(r, k, z, per_col);
            result.max_vertical_error_mm = std::max(result.max_vertical_error_mm, off);
            // Those of the last row and column are no one's above. Vertices there have no error,
            // and all others are in one triangle.
            if (r == last_row || k == last_col) sum += off * off;
          }
        });
    result.mesh.triangles.push_back(triangle.v);
    surface.triangles().free_before(t);
  }
  // Only now, when the triangles' memory is free.
  result.mesh.vertices_mm.reserve(surface.vertices().size());
  const auto place = [&](Millimetres start, std::int32_t parts) {
    return start.value() + field.spacing.value() * parts / Triangulation::kParts;
  };
  for (std::uint32_t v = 0; v < surface.vertices().size(); ++v) {
    const auto& at = surface.vertices()[v];
    result.mesh.vertices_mm.push_back(
        {place(field.x0, at.col), place(field.y0, at.row), static_cast<double>(at.z_mm)});
  }
  const auto nodes = static_cast<double>(field.z_mm.rows() * field.z_mm.cols());
  result.rms_vertical_error_mm = std::sqrt(sum / nodes);
  return result;
}

Result<void> check_heights(const Grid<float>& z) {
  MAQUETTE_CHECK(z.rows() >= 2 && z.cols() >= 2, "a field of {} x {} nodes has no cell", z.rows(),
                 z.cols());
  MAQUETTE_CHECK(z.rows() < std::ptrdiff_t{0xF0000000} / z.cols(),
                 "{} x {} nodes: more than 32 bit indices reach", z.rows(), z.cols());
  return detail::check_no_voids(z, "decimating");
}

tl::unexpected<Error> stopped() {
  return fail(kCancelled, "decimation was stopped");
}

/// Whether squares are to be small for a count, rather than the worst node near.
bool wants_squares(const Grid<float>& z, const DecimateOptions& options) {
  // Nodes a triangle: of fewer there is nothing left to fit.
  constexpr std::uint64_t kLeastNodes = 4;
  return options.max_error.value() == 0.0 && !options.lock_border &&
         z.cols() >= TerrainMesh::kLeastColumns &&
         options.most_triangles <= z.cells().size() / kLeastNodes;
}

/// To a count, by least squares.
Result<DecimatedMesh> fit_to_count(const ModelField& surface, std::uint64_t triangles,
                                   const RunContext& run) {
  // For the worst nodes: without them single ones are farther off than ten times the rms.
  constexpr std::uint64_t kKeptForWorst = 33;
  TerrainMesh mesh(surface);
  detail::bisect_terrain(mesh, triangles - triangles / kKeptForWorst, run);
  run.progress(0.2);
  if (run.stopped()) return stopped();
  detail::fit_vertices(mesh, run);
  run.progress(0.8);
  if (run.stopped()) return stopped();
  detail::insert_worst(mesh, triangles, run);
  if (run.stopped()) return stopped();
  DecimatedMesh result = take_mesh(mesh);
  run.progress(1.0);
  return result;
}

}  // namespace

Result<DecimatedMesh> decimate_surface(const ModelField& surface, const DecimateOptions& options,
                                       const RunContext& run) {
  MAQUETTE_TRY_VOID(check_heights(surface.z_mm));
  const double bound = options.max_error.value(), border = options.border_error.value();
  MAQUETTE_CHECK(bound >= 0.0 && border >= 0.0, "errors of {} and {} mm", bound, border);
  MAQUETTE_CHECK(!options.lock_border || bound == 0.0 || border <= bound,
                 "a border to {} mm cannot keep {} mm", border, bound);
  if (wants_squares(surface.z_mm, options))
    return fit_to_count(surface, options.most_triangles, run);
  SurfaceTriangulation triangulation(surface, options.lock_border);
  if (options.lock_border) insert_border(triangulation, border);
  insert_grid(triangulation, first_cell(surface, options));
  if (run.stopped()) return stopped();
  triangulation.scan_all(bound);
  run.progress(0.1);
  triangulation.refine(options.most_triangles, run);
  if (run.stopped()) return stopped();
  run.progress(0.5);
  const double reached = std::max(triangulation.worst_mm(), options.lock_border ? border : 0.0);
  detail::turn_edges(triangulation, reached);
  if (run.stopped()) return stopped();
  run.progress(0.8);
  detail::fit_heights(triangulation, reached);
  if (run.stopped()) return stopped();
  DecimatedMesh result = take_mesh(triangulation);
  run.progress(1.0);
  return result;
}

}  // namespace maquette::meshing
