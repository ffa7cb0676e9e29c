// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file cell_grid.hpp
/// Squares on which roughing decides. Centres are on multiples of what every control keeps
/// (kResolution), so that a path from centre to centre is written exactly as it was decided.

#include <cmath>
#include <cstddef>
#include <cstdint>

#include "cnc/toolpath.hpp"

namespace maquette::cnc {

/// Straightened paths pass the cells that they stand for within this; what a path so far
/// off would leave is not worth a cut.
inline constexpr double kWithinCells = 0.6;

struct Cell {
  std::int32_t row = 0, col = 0;
  friend bool operator==(Cell, Cell) = default;
};

/// Cell (r, c) is the square of side `side` around (x0 + c side, y0 + r side); ticks, side even.
struct CellGrid {
  std::int64_t x0 = 0, y0 = 0, side = 2;
  std::ptrdiff_t rows = 0, cols = 0;

  [[nodiscard]] std::int64_t x(std::ptrdiff_t col) const { return x0 + col * side; }
  [[nodiscard]] std::int64_t y(std::ptrdiff_t row) const { return y0 + row * side; }
  [[nodiscard]] double x_mm(std::ptrdiff_t col) const { return mm_of_ticks(x(col)); }
  [[nodiscard]] double y_mm(std::ptrdiff_t row) const { return mm_of_ticks(y(row)); }
  [[nodiscard]] double side_mm() const { return mm_of_ticks(side); }
  /// From a centre to a corner.
  [[nodiscard]] double half_diagonal_mm() const { return side_mm() * 0.70710678118654757; }
  [[nodiscard]] bool contains(std::ptrdiff_t r, std::ptrdiff_t c) const {
    return r >= 0 && c >= 0 && r < rows && c < cols;
  }
};

[[nodiscard]] inline double distance_in_cells(Cell a, Cell b) {
  return std::hypot(static_cast<double>(a.row - b.row), static_cast<double>(a.col - b.col));
}

}  // namespace maquette::cnc
