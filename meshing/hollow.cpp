// SPDX-License-Identifier: GPL-3.0-or-later
#include "meshing/hollow.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include <fmt/format.h>

#include "core/check.hpp"
#include "meshing/detail/pocket_ceilings.hpp"

namespace maquette::meshing {
namespace {

using detail::Lines;
using detail::PocketLines;
using heightmap::ModelField;
using std::ptrdiff_t;

std::size_t at(ptrdiff_t i) {
  return static_cast<std::size_t>(i);
}

Result<Lines> lay_out(char axis, double from, double to, double rib, double widest, double step) {
  const double inner = to - from;
  if (!(inner >= kLeastPocketDepth_mm))
    return fail(kHollowDoesNotFit,
                fmt::format("between the side walls {:g} mm are left in {}; a pocket is at least "
                            "{:g} mm wide: thinner walls would do",
                            inner, axis, kLeastPocketDepth_mm));
  // A width that fits but for rounding fits.
  const double count = std::max(1.0, std::ceil((inner + rib) / (widest + rib) - 1e-9));
  Lines lines{.pockets = static_cast<int>(count),
              .pocket_mm = (inner - (count - 1.0) * rib) / count};
  if (!(lines.pocket_mm >= kLeastPocketDepth_mm))
    return fail(kHollowDoesNotFit,
                fmt::format("{:g} pockets in {} would be {:g} mm wide between ribs of {:g} mm; "
                            "wider pockets or thinner ribs would do",
                            count, axis, lines.pocket_mm, rib));
  lines.steps = static_cast<ptrdiff_t>(std::max(1.0, std::ceil(lines.pocket_mm / step - 1e-9)));
  for (int p = 0; p < lines.pockets; ++p)
    for (ptrdiff_t k = 0; k <= lines.steps; ++k)
      lines.mm.push_back(from + p * (lines.pocket_mm + rib) +
                         lines.pocket_mm * static_cast<double>(k) /
                             static_cast<double>(lines.steps));
  return lines;
}

void add_rim(const ModelField& surface, double base_mm, TriMesh& mesh) {
  const ptrdiff_t rows = surface.z_mm.rows(), cols = surface.z_mm.cols();
  const auto add = [&](ptrdiff_t r, ptrdiff_t c) {
    mesh.vertices_mm.push_back({surface.x_mm(c), surface.y_mm(r), base_mm});
  };
  for (ptrdiff_t c = 0; c + 1 < cols; ++c) add(0, c);
  for (ptrdiff_t r = 0; r + 1 < rows; ++r) add(r, cols - 1);
  for (ptrdiff_t c = cols - 1; c > 0; --c) add(rows - 1, c);
  for (ptrdiff_t r = rows - 1; r > 0; --r) add(r, 0);
}

/// Rim, frame, ribs, walls and ceilings as triangles.
class UndersideBuilder {
 public:
  UndersideBuilder(const ModelField& surface, double base_mm, const PocketLines& lines,
                   const Grid<double>& ceilings_mm)
      : surface_(surface),
        base_mm_(base_mm),
        lines_(lines),
        x_(lines.x),
        y_(lines.y),
        ceilings_mm_(ceilings_mm) {}

  TriMesh build() {
    add_vertices();
    for (ptrdiff_t j = 0; j + 1 < y_.count(); ++j)
      for (ptrdiff_t i = 0; i + 1 < x_.count(); ++i)
        if (lines_.is_pocket(j, i))
          add_pocket_cell(j, i);
        else
          face(low_(j, i), low_(j + 1, i), low_(j + 1, i + 1), low_(j, i + 1));
    add_frame();
    return std::move(mesh_);
  }

 private:
  void add_vertices() {
    add_rim(surface_, base_mm_, mesh_);
    low_ = Grid<std::uint32_t>(y_.count(), x_.count());
    high_ = low_;
    for (ptrdiff_t j = 0; j < y_.count(); ++j)
      for (ptrdiff_t i = 0; i < x_.count(); ++i) {
        if (x_.border(i) || y_.border(j))
          low_(j, i) = add_vertex(x_.mm[at(i)], y_.mm[at(j)], base_mm_);
        high_(j, i) = add_vertex(x_.mm[at(i)], y_.mm[at(j)], ceilings_mm_(j, i));
      }
  }
  std::uint32_t add_vertex(double x, double y, double z) {
    mesh_.vertices_mm.push_back({x, y, z});
    return static_cast<std::uint32_t>(mesh_.vertices_mm.size() - 1);
  }
  /// Corners as they follow each other seen from outside, cut from the first to the third.
  void face(std::uint32_t a, std::uint32_t b, std::uint32_t c, std::uint32_t d) {
    mesh_.triangles.push_back({a, b, c});
    mesh_.triangles.push_back({a, c, d});
  }
  /// The ceiling, and walls where the pocket ends.
  void add_pocket_cell(ptrdiff_t j, ptrdiff_t i) {
    face(high_(j, i), high_(j + 1, i), high_(j + 1, i + 1), high_(j, i + 1));
    if (x_.first_of_pocket(i)) wall(j, i, j + 1, i);
    if (!x_.in_pocket(i + 1)) wall(j + 1, i + 1, j, i + 1);
    if (y_.first_of_pocket(j)) wall(j, i + 1, j, i);
    if (!y_.in_pocket(j + 1)) wall(j + 1, i, j + 1, i + 1);
  }
  /// From left to right seen from the pocket.
  void wall(ptrdiff_t j0, ptrdiff_t i0, ptrdiff_t j1, ptrdiff_t i1) {
    face(low_(j0, i0), low_(j1, i1), high_(j1, i1), high_(j0, i0));
  }

  /// Between the rim and the outermost lines, in four pieces that are cut at the corners.
  void add_frame() {
    const ptrdiff_t rows = surface_.z_mm.rows() - 1, cols = surface_.z_mm.cols() - 1;
    const ptrdiff_t nx = x_.count(), ny = y_.count();
    std::vector<std::uint32_t> south, east, north, west;
    for (ptrdiff_t i = 0; i < nx; ++i) {
      south.push_back(low_(0, i));
      north.push_back(low_(ny - 1, nx - 1 - i));
    }
    for (ptrdiff_t j = 0; j < ny; ++j) {
      east.push_back(low_(j, nx - 1));
      west.push_back(low_(ny - 1 - j, 0));
    }
    strip(0, cols, south);
    strip(cols, rows, east);
    strip(cols + rows, cols, north);
    strip(2 * cols + rows, rows, west);
  }
  /// Outside of it the rim from vertex `first` over `count` edges, inside another line beside it.
  void strip(ptrdiff_t first, ptrdiff_t count, const std::vector<std::uint32_t>& inner) {
    const ptrdiff_t all = 2 * (surface_.z_mm.rows() + surface_.z_mm.cols() - 2);
    const auto outer = [&](ptrdiff_t k) { return static_cast<std::uint32_t>((first + k) % all); };
    const Vec3 from = mesh_.vertices_mm[outer(0)], along = mesh_.vertices_mm[outer(count)] - from;
    const auto place = [&](std::uint32_t v) { return dot(mesh_.vertices_mm[v] - from, along); };
    ptrdiff_t o = 0;
    std::size_t i = 0;
    while (o < count || i + 1 < inner.size()) {
      const bool outwards =
          i + 1 == inner.size() || (o < count && place(outer(o + 1)) <= place(inner[i + 1]));
      if (outwards) {
        mesh_.triangles.push_back({outer(o), inner[i], outer(o + 1)});
        ++o;
      } else {
        mesh_.triangles.push_back({outer(o), inner[i], inner[i + 1]});
        ++i;
      }
    }
  }

  const ModelField& surface_;
  double base_mm_;
  const PocketLines& lines_;
  const Lines &x_, &y_;
  const Grid<double>& ceilings_mm_;
  Grid<std::uint32_t> low_, high_;
  TriMesh mesh_;
};

Result<void> check_options(const HollowOptions& o) {
  for (const auto& [name, value, least] :
       {std::tuple{"wall", o.wall.value(), 0.1}, std::tuple{"rib", o.rib.value(), 0.1},
        std::tuple{"pocket", o.pocket.value(), kLeastPocketDepth_mm},
        std::tuple{"step", o.step.value() == 0.0 ? 1.0 : o.step.value(), 0.01}})
    if (!(value >= least && value <= 1e4))
      return fail(kHollowDoesNotFit,
                  fmt::format("a {} of {} mm; {} to 10000 mm expected", name, value, least));
  return {};
}

}  // namespace

Underside plain_underside(const ModelField& surface, Millimetres base_z) {
  Underside under;
  add_rim(surface, base_z.value(), under.mesh);
  under.rim_vertices = under.mesh.vertices_mm.size();
  const auto rim = static_cast<std::uint32_t>(under.rim_vertices);
  const Vec3 from = under.mesh.vertices_mm.front();
  const Vec3 to =
      under.mesh
          .vertices_mm[static_cast<std::size_t>(surface.z_mm.rows() - 1 + surface.z_mm.cols() - 1)];
  under.mesh.vertices_mm.push_back(0.5 * (from + to));
  for (std::uint32_t k = 0; k < rim; ++k) under.mesh.triangles.push_back({rim, (k + 1) % rim, k});
  return under;
}

Result<Underside> hollow_underside(const ModelField& surface, const ModelField& roof,
                                   Millimetres base_z, const HollowOptions& options,
                                   const RunContext& run) {
  MAQUETTE_CHECK(roof.z_mm.rows() == surface.z_mm.rows() &&
                     roof.z_mm.cols() == surface.z_mm.cols() && surface.z_mm.rows() >= 2 &&
                     surface.z_mm.cols() >= 2,
                 "roof of {} x {} nodes", roof.z_mm.rows(), roof.z_mm.cols());
  MAQUETTE_TRY_VOID(check_options(options));
  const double wall = options.wall.value(), base = base_z.value();
  const double step =
      options.step.value() > 0.0 ? options.step.value() : 4.0 * surface.spacing.value();
  const auto thick = [&](std::size_t side) { return wall + options.cut[side].value(); };
  PocketLines lines;
  MAQUETTE_TRY(lines.x, lay_out('x', surface.x_mm(0) + thick(3),
                                surface.x_mm(surface.z_mm.cols() - 1) - thick(1),
                                options.rib.value(), options.pocket.value(), step));
  MAQUETTE_TRY(lines.y, lay_out('y', surface.y_mm(0) + thick(0),
                                surface.y_mm(surface.z_mm.rows() - 1) - thick(2),
                                options.rib.value(), options.pocket.value(), step));
  RunContext fitting = run;
  fitting.progress = [&run](double share) { run.progress(0.9 * share); };
  const auto ceilings = detail::fit_ceilings(surface, roof, lines, wall, base, fitting);
  if (!ceilings) return fail(kCancelled, "hollowing was stopped");
  if (const double missing = base + kLeastPocketDepth_mm - ceilings->lowest_mm; missing > 0.0) {
    const auto lowest = static_cast<double>(heightmap::height_range(surface.z_mm).min);
    return fail(kHollowDoesNotFit,
                fmt::format("walls of {:g} mm leave pockets of less than {:g} mm in a base of {:g} "
                            "mm; a base of {:.1f} mm or thinner walls would do",
                            wall, kLeastPocketDepth_mm, lowest - base,
                            std::ceil(10.0 * (lowest - base + missing)) / 10.0));
  }
  MAQUETTE_CHECK(ceilings->least_height_mm >= wall, "{} mm above a ceiling: whose roof is it?",
                 ceilings->least_height_mm);
  Underside under{
      .mesh = UndersideBuilder(surface, base, lines, ceilings->z_mm).build(),
      .rim_vertices = 2 * static_cast<std::uint64_t>(surface.z_mm.rows() + surface.z_mm.cols() - 2),
      .pockets_x = lines.x.pockets,
      .pockets_y = lines.y.pockets,
      .pocket_x_mm = lines.x.pocket_mm,
      .pocket_y_mm = lines.y.pocket_mm,
      .volume_mm3 = ceilings->volume_mm3,
      .lowest_ceiling_mm = ceilings->lowest_mm,
      .highest_ceiling_mm = ceilings->highest_mm,
      .least_height_mm = ceilings->least_height_mm,
      .mean_excess_mm = ceilings->mean_excess_mm,
      .most_excess_mm = ceilings->most_excess_mm};
  run.progress(1.0);
  return under;
}

}  // namespace maquette::meshing
