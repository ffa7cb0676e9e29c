// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file height_tiles.hpp
/// Drop of a wide body (holder, shank, cutters of very many cells) over a height grid: tiles of
/// 8 x 8 cells with their highest node, of which only those are opened that could beat the best
/// contact so far, the most promising first. 4 bytes for 64 nodes.

#include <algorithm>
#include <cmath>
#include <vector>

#include "cnc/cell_contact.hpp"
#include "cnc/lanes.hpp"
#include "cnc/padded_heights.hpp"

namespace maquette::cnc {

class HeightTiles {
 public:
  static constexpr std::ptrdiff_t kTile = kLanes;  // cells
  /// Nodes that must be had around the field.
  static constexpr std::ptrdiff_t kMargin = kTile + kLanes;

  explicit HeightTiles(const PaddedHeights& heights)
      : rows_((heights.rows + kTile - 1) / kTile), cols_((heights.cols + kTile - 1) / kTile) {
    top_.assign(static_cast<std::size_t>(rows_ * cols_), kNoSurface);
    for (std::ptrdiff_t i = 0; i < rows_; ++i)
      for (std::ptrdiff_t j = 0; j < cols_; ++j) {
        float& top = top_[static_cast<std::size_t>(i * cols_ + j)];
        for (std::ptrdiff_t r = 0; r <= kTile; ++r) {  // a cell's far corners are in it too
          const float* z = heights.node(i * kTile + r, j * kTile);
          top = std::max(top, *std::max_element(z, z + kTile + 1));
        }
      }
  }

  template <class Shape>
  void drop(const PaddedHeights& heights, const Shape& shape, double x_mm, double y_mm,
            Touch& best) const {
    const double tx = (x_mm - heights.x0) * heights.per_d;
    const double ty = (y_mm - heights.y0) * heights.per_d;
    const double reach = std::sqrt(shape.reach2) * heights.per_d * (1.0 + 1e-12);
    if (!(tx > -reach - 1.0 && tx < static_cast<double>(heights.cols) + reach)) return;
    if (!(ty > -reach - 1.0 && ty < static_cast<double>(heights.rows) + reach)) return;
    const auto index = [](double t, std::ptrdiff_t count) {
      return std::clamp<std::ptrdiff_t>(
          static_cast<std::ptrdiff_t>(std::floor(t / static_cast<double>(kTile))), 0, count - 1);
    };
    const std::ptrdiff_t i0 = index(ty - reach, rows_), i1 = index(ty + reach, rows_);
    const std::ptrdiff_t j0 = index(tx - reach, cols_), j1 = index(tx + reach, cols_);
    const Bounder<Shape> bound{shape, heights, tx, ty};

    double highest = -INFINITY;
    std::ptrdiff_t first_i = -1, first_j = -1;
    for (std::ptrdiff_t i = i0; i <= i1; ++i)
      for (std::ptrdiff_t j = j0; j <= j1; ++j) {
        const double b = bound(top(i, j), i * kTile, j * kTile, kTile);
        if (b > highest) (highest = b, first_i = i, first_j = j);
      }
    if (first_i < 0) return;
    open(bound, first_i, first_j, x_mm, y_mm, best);
    for (std::ptrdiff_t i = i0; i <= i1; ++i)
      for (std::ptrdiff_t j = j0; j <= j1; ++j)
        if (static_cast<double>(top(i, j)) > best.tip_mm && !(i == first_i && j == first_j) &&
            bound(top(i, j), i * kTile, j * kTile, kTile) > best.tip_mm)
          open(bound, i, j, x_mm, y_mm, best);
  }

 private:
  /// No contact in a square of cells asks for more than its top less the rise at its nearest point.
  template <class Shape>
  struct Bounder {
    const Shape& shape;
    const PaddedHeights& heights;
    double tx, ty;
    double operator()(float top, std::ptrdiff_t row, std::ptrdiff_t col,
                      std::ptrdiff_t cells) const {
      const auto gap = [&](double t, std::ptrdiff_t from) {
        const auto a = static_cast<double>(from);
        return std::max({0.0, a - t, t - a - static_cast<double>(cells)}) * heights.d;
      };
      // Less the rounding of places, so that nothing at the very rim is lost.
      const double dx = gap(tx, col), dy = gap(ty, row), r2 = (dx * dx + dy * dy) * (1.0 - 1e-12);
      if (r2 > shape.reach2) return -INFINITY;
      return static_cast<double>(top) - shape.rise(r2) * (1.0 - 1e-12);
    }
  };

  template <class Shape>
  void open(const Bounder<Shape>& bound, std::ptrdiff_t i, std::ptrdiff_t j, double x_mm,
            double y_mm, Touch& best) const {
    const PaddedHeights& heights = bound.heights;
    const CellContact<Shape> contact(bound.shape, heights.d);
    const std::ptrdiff_t rows = std::min(kTile, heights.rows - i * kTile);
    const std::ptrdiff_t cols = std::min(kTile, heights.cols - j * kTile);
    for (std::ptrdiff_t r = 0; r < rows; ++r) {
      const std::ptrdiff_t row = i * kTile + r;
      const float* z0 = heights.node(row, j * kTile);
      const float* z1 = z0 + heights.stride;
      const Lanes top = larger(larger(load(z0), load(z0 + 1)), larger(load(z1), load(z1 + 1)));
      for (std::ptrdiff_t c = 0; c < cols; ++c) {
        const std::ptrdiff_t col = j * kTile + c;
        if (!(static_cast<double>(top[c]) > best.tip_mm)) continue;
        if (bound(top[c], row, col, 1) > best.tip_mm)
          contact.touch(heights.corners(row, col, x_mm, y_mm), best);
      }
    }
  }

  [[nodiscard]] float top(std::ptrdiff_t i, std::ptrdiff_t j) const {
    return top_[static_cast<std::size_t>(i * cols_ + j)];
  }

  std::ptrdiff_t rows_, cols_;
  std::vector<float> top_;
};

}  // namespace maquette::cnc
