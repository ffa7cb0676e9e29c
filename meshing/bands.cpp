// SPDX-License-Identifier: GPL-3.0-or-later
#include "meshing/bands.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include <fmt/format.h>

#include "core/check.hpp"

namespace maquette::meshing {
namespace {

/// A width given as a decimal number of millimetres may lie a rounding error beside a
/// whole number of cells; this share of a cell is forgiven.
constexpr double kCellRounding = 1e-9;

std::vector<Band> even_bands(std::ptrdiff_t cells, BandAxis axis, std::ptrdiff_t count) {
  std::vector<Band> bands;
  for (std::ptrdiff_t i = 0; i < count; ++i)
    bands.push_back({.number = static_cast<int>(i + 1),
                     .axis = axis,
                     .first = i * cells / count,
                     .last = (i + 1) * cells / count});
  return bands;
}

Result<std::ptrdiff_t> cells_along(const heightmap::ModelField& surface, BandAxis axis) {
  if (surface.z_mm.rows() < 2 || surface.z_mm.cols() < 2)
    return fail(kBandsDegenerate, fmt::format("surface of {} x {} nodes; bands need at least 2 x 2",
                                              surface.z_mm.rows(), surface.z_mm.cols()));
  return (axis == BandAxis::x ? surface.z_mm.cols() : surface.z_mm.rows()) - 1;
}

Result<std::vector<Band>> bands_between(const heightmap::ModelField& surface, BandAxis axis,
                                        const std::vector<std::ptrdiff_t>& joints) {
  MAQUETTE_TRY(const std::ptrdiff_t cells, cells_along(surface, axis));
  std::vector<Band> bands;
  std::ptrdiff_t first = 0;
  const auto add = [&](std::ptrdiff_t last) {
    bands.push_back(
        {.number = static_cast<int>(bands.size() + 1), .axis = axis, .first = first, .last = last});
    first = last;
  };
  for (const std::ptrdiff_t joint : joints) {
    if (joint <= first || joint >= cells)
      return fail(kBandsDegenerate,
                  fmt::format("joint at line {} of nodes: expected one between {} and {}; joints "
                              "are of another surface",
                              joint, first, cells));
    add(joint);
  }
  add(cells);
  return bands;
}

}  // namespace

Result<std::vector<Band>> split_into_bands(const heightmap::ModelField& surface, BandAxis axis,
                                           Millimetres max_width) {
  MAQUETTE_TRY(const std::ptrdiff_t cells, cells_along(surface, axis));
  const double widest = std::floor(max_width / surface.spacing + kCellRounding);
  if (!(widest >= 2.0))
    return fail(
        kBandsDegenerate,
        fmt::format("band width {} mm is below two cells of {} mm; choose a width of at "
                    "least {} mm",
                    max_width.value(), surface.spacing.value(), 2.0 * surface.spacing.value()));
  const auto at_most = static_cast<std::ptrdiff_t>(std::fmin(widest, static_cast<double>(cells)));
  return even_bands(cells, axis, (cells + at_most - 1) / at_most);
}

Result<std::vector<Band>> split_into_bands(const heightmap::ModelField& surface,
                                           const BandSplit& split) {
  MAQUETTE_CHECK(split.count >= 0, "{}", split.count);
  if (split.joints) return bands_between(surface, split.axis, *split.joints);
  if (split.count == 0) return split_into_bands(surface, split.axis, split.max_width);
  MAQUETTE_TRY(const std::ptrdiff_t cells, cells_along(surface, split.axis));
  const std::ptrdiff_t most = std::max<std::ptrdiff_t>(1, cells / 2);
  if (split.count > most)
    return fail(kBandsDegenerate,
                fmt::format("{} bands of {} cells: one would be narrower than two; {} are possible",
                            split.count, cells, most));
  return even_bands(cells, split.axis, split.count);
}

NodeWindow band_window(const heightmap::ModelField& surface, const Band& band) {
  NodeWindow window = all_nodes(surface);
  const bool along_x = band.axis == BandAxis::x;
  MAQUETTE_CHECK(band.first >= 0 && band.first < band.last &&
                     band.last <= (along_x ? window.col1 : window.row1),
                 "band {} .. {} of {} x {} nodes", band.first, band.last, window.rows(),
                 window.cols());
  (along_x ? window.col0 : window.row0) = band.first;
  (along_x ? window.col1 : window.row1) = band.last;
  return window;
}

heightmap::ModelField band_field(const heightmap::ModelField& surface, const Band& band,
                                 Millimetres margin) {
  const bool along_x = band.axis == BandAxis::x;
  const std::ptrdiff_t nodes = along_x ? surface.z_mm.cols() : surface.z_mm.rows();
  MAQUETTE_CHECK(band.first >= 0 && band.first < band.last && band.last < nodes,
                 "band {} .. {} of {} nodes", band.first, band.last, nodes);
  MAQUETTE_CHECK(margin.value() >= 0.0 && std::isfinite(margin.value()), "{}", margin.value());
  const double cells = std::ceil(margin / surface.spacing - kCellRounding);
  const auto more = static_cast<std::ptrdiff_t>(std::fmin(cells, static_cast<double>(nodes)));
  const std::ptrdiff_t first = std::max<std::ptrdiff_t>(0, band.first - more);
  const std::ptrdiff_t last = std::min(nodes - 1, band.last + more);

  const std::ptrdiff_t rows = along_x ? surface.z_mm.rows() : last - first + 1;
  const std::ptrdiff_t cols = along_x ? last - first + 1 : surface.z_mm.cols();
  const std::ptrdiff_t row0 = along_x ? 0 : first, col0 = along_x ? first : 0;
  heightmap::ModelField part{.z_mm = Grid<float>(rows, cols),
                             .spacing = surface.spacing,
                             .x0 = Millimetres{surface.x_mm(col0)},
                             .y0 = Millimetres{surface.y_mm(row0)}};
  for (std::ptrdiff_t r = 0; r < rows; ++r)
    std::copy_n(surface.z_mm.row(row0 + r).begin() + col0, cols, part.z_mm.row(r).begin());
  return part;
}

}  // namespace maquette::meshing
