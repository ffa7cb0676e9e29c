// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/steepness.hpp"

#include <algorithm>
#include <cmath>

#include <oneapi/tbb/parallel_for.h>

namespace maquette::cnc {

SteepnessTiles::SteepnessTiles(const heightmap::ModelField& field, BallNose tool)
    : R_(tool.radius_mm),
      x0_(field.x0.value()),
      y0_(field.y0.value()),
      x1_(field.x_mm(field.z_mm.cols() - 1)),
      y1_(field.y_mm(field.z_mm.rows() - 1)) {
  const double d = field.spacing.value();
  const auto cells =
      std::max<std::ptrdiff_t>(1, static_cast<std::ptrdiff_t>(std::lround(0.5 * R_ / d)));
  side_mm_ = d * static_cast<double>(cells);
  const std::ptrdiff_t cell_rows = field.z_mm.rows() - 1, cell_cols = field.z_mm.cols() - 1;
  rows_ = (cell_rows + cells - 1) / cells;
  cols_ = (cell_cols + cells - 1) / cells;
  tiles_.resize(static_cast<std::size_t>(rows_ * cols_));
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, rows_, [&](std::ptrdiff_t i) {
    for (std::ptrdiff_t j = 0; j < cols_; ++j) {
      float highest = -INFINITY, steepest = 0.0F;
      for (std::ptrdiff_t r = i * cells; r < std::min((i + 1) * cells, cell_rows); ++r)
        for (std::ptrdiff_t c = j * cells; c < std::min((j + 1) * cells, cell_cols); ++c) {
          const float z00 = field.z_mm(r, c), z10 = field.z_mm(r, c + 1);
          const float z01 = field.z_mm(r + 1, c), z11 = field.z_mm(r + 1, c + 1);
          highest = std::max({highest, z00, z10, z01, z11});
          const float a = z10 - z00, b = z11 - z10, e = z11 - z01, f = z01 - z00;
          steepest = std::max({steepest, a * a + b * b, e * e + f * f});
        }
      // 1e-6: six roundings to 24 bits, rounded up.
      const double t2 = static_cast<double>(steepest) / (d * d) * (1.0 + 1e-6);
      tiles_[static_cast<std::size_t>(i * cols_ + j)] = {
          highest, std::nextafter(static_cast<float>(R_ / std::sqrt(1.0 + t2)), 0.0F)};
    }
  });
}

ContactBound SteepnessTiles::bound(double x_min, double x_max, double y_min, double y_max,
                                   double lowest_tip_mm) const {
  const auto index = [this](double mm, std::ptrdiff_t count) {
    return std::clamp<std::ptrdiff_t>(static_cast<std::ptrdiff_t>(std::floor(mm / side_mm_)), 0,
                                      count - 1);
  };
  // A hair wider, so that a rounded quotient never loses a tile.
  const double reach = R_ * (1.0 + 1e-9) + 1e-9;
  const std::ptrdiff_t i0 = index(y_min - reach - y0_, rows_),
                       i1 = index(y_max + reach - y0_, rows_);
  const std::ptrdiff_t j0 = index(x_min - reach - x0_, cols_),
                       j1 = index(x_max + reach - x0_, cols_);
  const double at_height = R_ + lowest_tip_mm;
  const double reach2 = reach * reach;
  ContactBound found{R_, lowest_tip_mm};
  for (std::ptrdiff_t i = i0; i <= i1; ++i) {
    const double low = y0_ + side_mm_ * static_cast<double>(i);
    const double dy = std::max({0.0, low - y_max, y_min - low - side_mm_});
    for (std::ptrdiff_t j = j0; j <= j1; ++j) {
      const double left = x0_ + side_mm_ * static_cast<double>(j);
      const double dx = std::max({0.0, left - x_max, x_min - left - side_mm_});
      const Tile& tile = tiles_[static_cast<std::size_t>(i * cols_ + j)];
      const double highest = static_cast<double>(tile.highest);
      const double by_height = std::max(0.0, at_height - highest);
      if (dx * dx + dy * dy + by_height * by_height > reach2) continue;
      found.highest_mm = std::max(found.highest_mm, highest);
      found.least_depth_mm = std::min(found.least_depth_mm,
                                      std::max(by_height, static_cast<double>(tile.least_depth)));
    }
  }
  // Over the outline's edge the normal leans out by as much again.
  const double beyond = std::hypot(std::max({0.0, x0_ - x_min, x_max - x1_}),
                                   std::max({0.0, y0_ - y_min, y_max - y1_})) /
                        R_;
  if (beyond > 0.0) found.least_depth_mm *= std::sqrt(std::max(0.0, 1.0 - beyond * beyond));
  return found;
}

}  // namespace maquette::cnc
