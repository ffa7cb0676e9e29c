// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/stock_depth.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <oneapi/tbb/parallel_for.h>

namespace maquette::cnc {
namespace {

/// Greatest value within `reach` nodes along both axes.
void widen(Grid<float>& field, std::ptrdiff_t reach) {
  Grid<float> along(field.rows(), field.cols());
  const auto each_row = [&](auto&& work) {
    oneapi::tbb::parallel_for(std::ptrdiff_t{0}, field.rows(), work);
  };
  each_row([&](std::ptrdiff_t r) {
    for (std::ptrdiff_t c = 0; c < field.cols(); ++c) {
      const auto row = field.row(r);
      along(r, c) =
          *std::max_element(row.begin() + std::max<std::ptrdiff_t>(0, c - reach),
                            row.begin() + std::min<std::ptrdiff_t>(field.cols(), c + reach + 1));
    }
  });
  each_row([&](std::ptrdiff_t r) {
    const auto to = field.row(r);
    std::fill(to.begin(), to.end(), -INFINITY);
    for (std::ptrdiff_t k = std::max<std::ptrdiff_t>(0, r - reach);
         k <= std::min(field.rows() - 1, r + reach); ++k) {
      const auto from = along.row(k);
      for (std::size_t c = 0; c < to.size(); ++c) to[c] = std::max(to[c], from[c]);
    }
  });
}

}  // namespace

StockDepth::StockDepth(const heightmap::ModelField& design, const heightmap::ModelField* stock,
                       double thickness_mm, const Cutter& cutter)
    : depth_(design.z_mm.rows(), design.z_mm.cols()),
      x0_(design.x0.value()),
      y0_(design.y0.value()),
      spacing_(design.spacing.value()) {
  const std::ptrdiff_t rows = depth_.rows(), cols = depth_.cols();
  Grid<float> slope(rows, cols);
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, rows, [&](std::ptrdiff_t r) {
    for (std::ptrdiff_t c = 0; c < cols; ++c) {
      const auto z = [&](std::ptrdiff_t row, std::ptrdiff_t col) {
        return static_cast<double>(design.z_mm(std::clamp<std::ptrdiff_t>(row, 0, rows - 1),
                                               std::clamp<std::ptrdiff_t>(col, 0, cols - 1)));
      };
      double thick = thickness_mm;
      if (stock != nullptr) {
        const double h = heightmap::height_at(*stock, design.x_mm(c), design.y_mm(r));
        if (std::isfinite(h)) thick = h - z(r, c);
      }
      depth_(r, c) = static_cast<float>(std::max(0.0, thick));
      // Steeper than each facet at the node.
      const double dx = std::max(std::abs(z(r, c + 1) - z(r, c)), std::abs(z(r, c) - z(r, c - 1)));
      const double dy = std::max(std::abs(z(r + 1, c) - z(r, c)), std::abs(z(r, c) - z(r - 1, c)));
      slope(r, c) = static_cast<float>(std::hypot(dx, dy) / spacing_);
    }
  });
  // What lies between nodes is no more than at the nodes around.
  const auto reach = static_cast<std::ptrdiff_t>(std::ceil(cutter.radius_mm / spacing_)) + 1;
  widen(depth_, reach);
  widen(slope, reach);
  const double r0 = cutter.corner_radius_mm;
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, rows, [&](std::ptrdiff_t r) {
    for (std::ptrdiff_t c = 0; c < cols; ++c) {
      const double t = static_cast<double>(depth_(r, c));
      if (t == 0.0) continue;
      double depth = r0 + t;
      if (t < r0) {
        const double angle = std::atan(static_cast<double>(slope(r, c))) + std::acos(1.0 - t / r0);
        if (angle < 0.5 * std::numbers::pi) depth = r0 * (1.0 - std::cos(angle));
      }
      if (r0 == 0.0) depth = t + static_cast<double>(slope(r, c)) * 2.0 * cutter.radius_mm;
      depth_(r, c) = static_cast<float>(depth);
    }
  });
  for (const float d : depth_.cells()) deepest_ = std::max(deepest_, static_cast<double>(d));
}

double StockDepth::along_mm(double x0_mm, double y0_mm, double x1_mm, double y1_mm) const {
  const double length = std::hypot(x1_mm - x0_mm, y1_mm - y0_mm);
  const auto steps = static_cast<std::int64_t>(std::ceil(length / spacing_));
  float most = 0.0F;
  for (std::int64_t i = 0; i <= steps; ++i) {
    const double t = steps == 0 ? 0.0 : static_cast<double>(i) / static_cast<double>(steps);
    const auto node = [&](double from, double to, double origin, std::ptrdiff_t count) {
      return std::clamp<std::ptrdiff_t>(std::llround((from + t * (to - from) - origin) / spacing_),
                                        0, count - 1);
    };
    most = std::max(most, depth_(node(y0_mm, y1_mm, y0_, depth_.rows()),
                                 node(x0_mm, x1_mm, x0_, depth_.cols())));
  }
  return static_cast<double>(most);
}

}  // namespace maquette::cnc
