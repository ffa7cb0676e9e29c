// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file reach_window.hpp
/// Which cells of a height grid a cutter could touch: certified bounds in single precision for
/// all cells in reach, from tables of what depends on the position within a cell alone.
///
/// For each cell an upper bound of the tip that any contact in it asks for, the smaller of
///   largest of its corners' own values + kappa d^2 / 4
///   its highest corner - the underside's rise at its nearest point
/// and for the point a lower bound, the best contact with a node. kappa is the underside's
/// curvature at the cell's farthest point: on a right-angled triangle of legs d a function whose
/// second derivative is nowhere below -kappa exceeds its largest corner by at most kappa / 2 times
/// the squared radius of the circumcircle, d^2 / 2.
/// Positions on a lattice of `per_cell` places per cell and axis, and a hair beside them, have
/// tables of their own. All others take those of the nearest place, with distances widened.

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "cnc/lanes.hpp"
#include "cnc/tool.hpp"

namespace maquette::cnc {

/// Where a window lies. Cells are counted from the field's first.
struct WindowPlace {
  std::ptrdiff_t row, col;  // of its first cell
  const float* tables;
  std::ptrdiff_t rows;  // of cells
};

struct WindowCell {
  std::int16_t row, col;  // from the window's first
};

class ReachWindows {
 public:
  static constexpr float kOutOfReach = -1e30F;
  static constexpr std::ptrdiff_t kMostReach = 24;  ///< cells
  static constexpr std::size_t kMostCells = 3072;   ///< of a window, unused columns included

  /// Wider cutters have no windows.
  [[nodiscard]] static bool fits(const Cutter& tool, double spacing_mm) {
    return tool.radius_mm <= static_cast<double>(kMostReach) * spacing_mm;
  }

  /// @pre fits()
  /// @param furthest_mm  no node is further from 0
  ReachWindows(const Cutter& tool, double spacing_mm, double furthest_mm);

  /// Whether a field of so many nodes along an axis can be touched from position t along it.
  [[nodiscard]] bool reaches(double t, std::ptrdiff_t nodes) const {
    return t > -reach_ && t < static_cast<double>(nodes - 1) + reach_;
  }
  /// @param tx, ty  position in cells from the field's first node
  [[nodiscard]] WindowPlace at(double tx, double ty) const;
  /// Nodes that must be had on each side of the field, where reaches().
  [[nodiscard]] std::ptrdiff_t margin_rows() const { return 2 * margin_ + 1; }
  [[nodiscard]] std::ptrdiff_t margin_cols() const { return std::max(2 * margin_ + 1, width_ + 2); }

  /// Upper bound of each cell, row by row of whole registers; returns the lower bound of the tip,
  /// kOutOfReach or less where no node is surely in reach.
  /// @param z      first node of the window, of a field with `stride` nodes a row
  /// @param bound  room for kMostCells
  float bounds(const WindowPlace& place, const float* z, std::ptrdiff_t stride, float* bound) const;
  /// Moves the cells whose bound is more than `low` to the front; returns how many they are.
  std::size_t collect(const WindowPlace& place, float low, float* bound, WindowCell* cells) const;

 private:
  struct Axis {  // of one place along an axis
    std::ptrdiff_t first = 0, cells = 0;
  };
  void fill(float* tables, std::size_t set, std::ptrdiff_t ly, std::ptrdiff_t lx) const;

  Cutter tool_;
  double d_, rounding_;
  std::ptrdiff_t per_cell_ = 1;
  std::array<double, 2> slack_mm_{};
  double reach_ = 0.0;  // cells
  std::ptrdiff_t width_ = 0, rows_ = 0, margin_ = 0;
  std::array<std::vector<Axis>, 2> axis_;  // [set][place]; set 0: on the lattice
  std::vector<float> tables_;
};

}  // namespace maquette::cnc
