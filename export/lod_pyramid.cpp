// SPDX-License-Identifier: GPL-3.0-or-later
#include "export/lod_pyramid.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include "core/check.hpp"

namespace maquette::exporting {
namespace {

using Slope = LodPyramid::Slope;

/// Places and weights of a filter along one side, at one node of the coarser level.
struct Taps {
  std::array<std::ptrdiff_t, 5> at{};
  std::array<double, 5> weight{};
  std::size_t count = 0;
};

/// @param nodes  of the field; `level` is the coarser one
Taps height_taps(std::ptrdiff_t nodes, int level, std::ptrdiff_t index, LodFilter filter) {
  const std::ptrdiff_t below = lod_nodes(nodes, level - 1);
  const std::ptrdiff_t regular = (nodes - 1) >> (level - 1);  // the last that keeps its distance
  const std::ptrdiff_t middle = std::min(2 * index, below - 1);
  if (filter == LodFilter::sample || middle < 2 || middle + 2 > regular)
    return {.at = {middle}, .weight = {1.0}, .count = 1};
  return {.at = {middle - 2, middle - 1, middle, middle + 1, middle + 2},
          .weight = {-0.125, 0.25, 0.75, 0.25, -0.125},
          .count = 5};
}

Taps slope_taps(std::ptrdiff_t nodes, int level, std::ptrdiff_t index) {
  const std::ptrdiff_t below = lod_nodes(nodes, level - 1);
  const std::ptrdiff_t middle = std::min(2 * index, below - 1);
  return {.at = {std::max<std::ptrdiff_t>(middle - 1, 0), middle, std::min(middle + 1, below - 1)},
          .weight = {0.25, 0.5, 0.25},
          .count = 3};
}

/// Mean of the triangles about a node. All have the same area seen from above, so this is the
/// slope of the sum of their normals weighted by area.
Slope slope_of_field(const heightmap::ModelField& field, std::ptrdiff_t row, std::ptrdiff_t col) {
  const Grid<float>& z = field.z_mm;
  const bool west = col > 0, south = row > 0, east = col + 1 < z.cols(), north = row + 1 < z.rows();
  const auto rise = [&](std::ptrdiff_t r0, std::ptrdiff_t c0, std::ptrdiff_t r1,
                        std::ptrdiff_t c1) {
    return static_cast<double>(z(row + r1, col + c1)) - static_cast<double>(z(row + r0, col + c0));
  };
  double dx = 0.0, dy = 0.0, count = 0.0;
  const auto add = [&](double x, double y) {
    dx += x;
    dy += y;
    count += 1.0;
  };
  if (north && east) {
    add(rise(0, 0, 0, 1), rise(0, 1, 1, 1));
    add(rise(1, 0, 1, 1), rise(0, 0, 1, 0));
  }
  if (south && west) {
    add(rise(-1, -1, -1, 0), rise(-1, 0, 0, 0));
    add(rise(0, -1, 0, 0), rise(-1, -1, 0, -1));
  }
  if (north && west) add(rise(0, -1, 0, 0), rise(0, 0, 1, 0));
  if (south && east) add(rise(0, 0, 0, 1), rise(-1, 0, 0, 0));
  const double run = field.spacing.value() * count;
  return {static_cast<float>(dx / run), static_cast<float>(dy / run)};
}

}  // namespace

std::ptrdiff_t lod_nodes(std::ptrdiff_t nodes, int level) {
  const std::ptrdiff_t stride = std::ptrdiff_t{1} << level;
  return (nodes - 1 + stride - 1) / stride + 1;
}

std::ptrdiff_t lod_node(std::ptrdiff_t nodes, int level, std::ptrdiff_t index) {
  return std::min(index << level, nodes - 1);
}

Slope LodPyramid::slope(int level, std::ptrdiff_t row, std::ptrdiff_t col) const {
  return level == 0 ? slope_of_field(*field_, row, col)
                    : upper_[static_cast<std::size_t>(level - 1)].slope(row, col);
}

Result<LodPyramid> LodPyramid::create(const heightmap::ModelField& field, int levels,
                                      LodFilter filter) {
  MAQUETTE_CHECK(levels >= 1, "{} levels", levels);
  const std::ptrdiff_t rows = field.z_mm.rows(), cols = field.z_mm.cols();
  for (std::ptrdiff_t r = 0; r < rows; ++r)
    for (std::ptrdiff_t c = 0; c < cols; ++c)
      if (!std::isfinite(field.z_mm(r, c)))
        return fail(kHeightNotFinite,
                    fmt::format("no height at row {}, column {} ({:.3f}, {:.3f} mm); levels need a "
                                "field without voids",
                                r, c, field.x_mm(c), field.y_mm(r)));
  LodPyramid made;
  made.field_ = &field;
  for (int level = 1; level < levels; ++level) {
    Upper upper{Grid<float>(lod_nodes(rows, level), lod_nodes(cols, level)),
                Grid<Slope>(lod_nodes(rows, level), lod_nodes(cols, level))};
    const Grid<float>& below = made.heights_mm(level - 1);
    tbb::parallel_for(std::ptrdiff_t{0}, upper.z_mm.rows(), [&](std::ptrdiff_t r) {
      const Taps down = height_taps(rows, level, r, filter),
                 slope_down = slope_taps(rows, level, r);
      for (std::ptrdiff_t c = 0; c < upper.z_mm.cols(); ++c) {
        const Taps along = height_taps(cols, level, c, filter);
        double z = 0.0;
        for (std::size_t i = 0; i < down.count; ++i)
          for (std::size_t j = 0; j < along.count; ++j)
            z += down.weight[i] * along.weight[j] *
                 static_cast<double>(below(down.at[i], along.at[j]));
        upper.z_mm(r, c) = static_cast<float>(z);
        const Taps slope_along = slope_taps(cols, level, c);
        double dx = 0.0, dy = 0.0;
        for (std::size_t i = 0; i < slope_down.count; ++i)
          for (std::size_t j = 0; j < slope_along.count; ++j) {
            const Slope s = made.slope(level - 1, slope_down.at[i], slope_along.at[j]);
            const double w = slope_down.weight[i] * slope_along.weight[j];
            dx += w * static_cast<double>(s[0]);
            dy += w * static_cast<double>(s[1]);
          }
        upper.slope(r, c) = {static_cast<float>(dx), static_cast<float>(dy)};
      }
    });
    made.upper_.push_back(std::move(upper));
  }
  return made;
}

}  // namespace maquette::exporting
