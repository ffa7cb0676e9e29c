// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/cutter_reach.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include <oneapi/tbb/parallel_for.h>

#include "core/check.hpp"

namespace maquette::cnc {

using heightmap::ModelField;

namespace {

/// Of one row of cells.
struct SteepRow {
  double highest = 0.0;  // squared rise over spacing
  std::ptrdiff_t col = 0;
  std::uint64_t above = 0;  // facets
};

/// Squared rises over spacing of a cell's two facets, right below and left above the diagonal.
struct Rises {
  double right, left;
};
Rises rises(const Grid<float>& z, std::ptrdiff_t r, std::ptrdiff_t c) {
  const double a = z(r, c), b = z(r, c + 1), e = z(r + 1, c), d = z(r + 1, c + 1);
  return {(b - a) * (b - a) + (d - b) * (d - b), (d - e) * (d - e) + (e - a) * (e - a)};
}

}  // namespace

SlopeMap map_slope(const ModelField& design, double limit_deg) {
  const Grid<float>& z = design.z_mm;
  const std::ptrdiff_t rows = z.rows(), cols = z.cols();
  MAQUETTE_CHECK(rows >= 2 && cols >= 2, "design of {} x {} nodes", rows, cols);
  const double d = design.spacing.value(), degree = 180.0 / std::numbers::pi;
  const double rise = d * std::tan(std::min(limit_deg, 89.999999) / degree);
  // A plane just at the limit is not above it: heights are rounded to float.
  const double limit2 = limit_deg >= 90.0 ? INFINITY : rise * rise * (1.0 + 1e-5);
  std::vector<SteepRow> found(static_cast<std::size_t>(rows - 1));
  SlopeMap map;
  map.steepest_deg = Grid<float>(rows, cols, 0.0F);
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, rows - 1, [&](std::ptrdiff_t r) {
    SteepRow& row = found[static_cast<std::size_t>(r)];
    for (std::ptrdiff_t c = 0; c + 1 < cols; ++c) {
      const Rises f = rises(z, r, c);
      row.above += (f.right > limit2 ? 1U : 0U) + (f.left > limit2 ? 1U : 0U);
      if (const double most = std::max(f.right, f.left); most > row.highest)
        row.highest = most, row.col = c;
    }
  });
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, rows, [&](std::ptrdiff_t r) {
    for (std::ptrdiff_t c = 0; c < cols; ++c) {
      double most = 0.0;
      // Two facets of the cells before and behind, one of each of the others.
      for (std::ptrdiff_t i = std::max<std::ptrdiff_t>(0, r - 1); i <= std::min(r, rows - 2); ++i)
        for (std::ptrdiff_t j = std::max<std::ptrdiff_t>(0, c - 1); j <= std::min(c, cols - 2);
             ++j) {
          const Rises f = rises(z, i, j);
          if (!(i == r && j < c)) most = std::max(most, f.left);
          if (!(i < r && j == c)) most = std::max(most, f.right);
        }
      map.steepest_deg(r, c) = static_cast<float>(std::atan(std::sqrt(most) / d) * degree);
    }
  });
  std::uint64_t above = 0;
  double highest = -1.0;
  for (std::ptrdiff_t r = 0; r + 1 < rows; ++r) {
    const SteepRow& row = found[static_cast<std::size_t>(r)];
    above += row.above;
    if (row.highest <= highest) continue;
    highest = row.highest;
    map.highest_x_mm = design.x_mm(row.col) + 0.5 * d;
    map.highest_y_mm = design.y_mm(r) + 0.5 * d;
  }
  map.highest_deg = std::atan(std::sqrt(highest) / d) * degree;
  map.share_above = static_cast<double>(above) /
                    (2.0 * static_cast<double>(rows - 1) * static_cast<double>(cols - 1));
  return map;
}

Result<CutterReach> map_cutter_reach(const ModelField& design, BallNose ball, Millimetres threshold,
                                     double slope_limit_deg, const RunContext& run) {
  CutterReach reach;
  MAQUETTE_TRY(reach.rest, map_rest(design, ball, threshold, run));
  const Grid<float>& left = reach.rest.remaining.z_mm;
  const auto most = std::max_element(left.cells().begin(), left.cells().end());
  const auto at = static_cast<std::ptrdiff_t>(most - left.cells().begin());
  reach.deepest_x_mm = design.x_mm(at % left.cols());
  reach.deepest_y_mm = design.y_mm(at / left.cols());
  const auto above = std::count_if(left.cells().begin(), left.cells().end(), [&](float z) {
    return static_cast<double>(z) > reach.rest.threshold_mm;
  });
  reach.unreached_share = static_cast<double>(above) / static_cast<double>(left.cells().size());
  reach.slope = map_slope(design, slope_limit_deg);
  const auto range = heightmap::height_range(design.z_mm);
  reach.relief_mm = static_cast<double>(range.max) - static_cast<double>(range.min);
  return reach;
}

}  // namespace maquette::cnc
