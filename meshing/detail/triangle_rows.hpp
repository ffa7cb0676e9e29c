// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file triangle_rows.hpp
/// The rows of nodes under a triangle whose corners are counted in parts of a node's spacing.

#include <array>
#include <cmath>
#include <cstdint>
#include <utility>

namespace maquette::meshing::detail {

/// Twice the area, in parts squared; positive if counter-clockwise. @pre below 2^31 parts apart
template <class Vertex>
[[nodiscard]] std::int64_t doubled_area(const Vertex& a, const Vertex& b, const Vertex& c) {
  return static_cast<std::int64_t>(b.col - a.col) * (c.row - a.row) -
         static_cast<std::int64_t>(b.row - a.row) * (c.col - a.col);
}

/// Calls visit(row, first column, last column, height at column 0, height per column) for every
/// row of nodes in the triangle. `half_open`: each node in exactly one triangle of a
/// triangulation, those of the last row and column in none; else those of the edges too.
/// @tparam kParts  of a node's spacing, in which row and col of a vertex count
/// @pre counter-clockwise, nowhere below row or column 0
template <int kParts, class Vertex, class Visit>
void for_rows(std::array<Vertex, 3> at, bool half_open, Visit visit) {
  constexpr double kPart = 1.0 / kParts;
  const double area = static_cast<double>(doubled_area(at[0], at[1], at[2])) * (kPart * kPart);
  // From one corner on, so that level triangles have level points.
  const auto z = static_cast<double>(at[0].z_mm);
  const double z1 = static_cast<double>(at[1].z_mm) - z, z2 = static_cast<double>(at[2].z_mm) - z;
  const double r1 = (at[1].row - at[0].row) * kPart, r2 = (at[2].row - at[0].row) * kPart;
  const double c1 = (at[1].col - at[0].col) * kPart, c2 = (at[2].col - at[0].col) * kPart;
  const double per_col = (z1 * r2 - z2 * r1) / area, per_row = (z2 * c1 - z1 * c2) / area;
  const double row0 = at[0].row * kPart, col0 = at[0].col * kPart;
  // Sorted by row; the long edge runs from the first to the last.
  if (at[1].row < at[0].row) std::swap(at[0], at[1]);
  if (at[2].row < at[1].row) std::swap(at[1], at[2]);
  if (at[1].row < at[0].row) std::swap(at[0], at[1]);
  const bool middle_is_east = doubled_area(at[0], at[1], at[2]) > 0;
  const auto slope = [](const Vertex& a, const Vertex& b) {
    return b.row == a.row ? 0.0 : static_cast<double>(b.col - a.col) / (b.row - a.row);
  };
  const double long_slope = slope(at[0], at[2]);
  const double low_slope = slope(at[0], at[1]), high_slope = slope(at[1], at[2]);
  // Crossings are multiples of 1 / (rows * parts^2): rounding cannot reach the next one.
  constexpr double kRounding = 1e-7;
  const std::int32_t first = (at[0].row + kParts - 1) / kParts;
  const std::int32_t end = half_open ? (at[2].row + kParts - 1) / kParts : at[2].row / kParts + 1;
  for (std::int32_t r = first; r < end; ++r) {
    const std::int32_t here = r * kParts;
    const double on_long = (at[0].col + long_slope * (here - at[0].row)) * kPart;
    const double on_other = here < at[1].row
                                ? (at[0].col + low_slope * (here - at[0].row)) * kPart
                                : (at[1].col + high_slope * (here - at[1].row)) * kPart;
    const double west = middle_is_east ? on_long : on_other;
    const double east = middle_is_east ? on_other : on_long;
    const auto from = static_cast<std::int32_t>(std::ceil(west - kRounding));
    const std::int32_t to = half_open ? static_cast<std::int32_t>(std::ceil(east - kRounding)) - 1
                                      : static_cast<std::int32_t>(std::floor(east + kRounding));
    if (from <= to) visit(r, from, to, z + per_row * (r - row0) - per_col * col0, per_col);
  }
}

}  // namespace maquette::meshing::detail
