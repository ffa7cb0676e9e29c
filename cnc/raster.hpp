// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file raster.hpp
/// Where the parallel passes of a raster lie: rows at any angle, clipped to a rectangle, on an
/// integer lattice, so that each place on each row is exactly on it and exactly writable.
///
/// The passes' direction becomes the nearest rational one, (p, q) times 0.001 mm with
/// p^2 + q^2 <= 32^2: off by nothing at multiples of 45 degrees, by up to 0.91 degrees near them,
/// by at most 0.5 elsewhere. Lattice point (m, j) is origin + m (p, q) + j (-q, p): m along the
/// rows, j across them, to their left.

#include <cstdint>
#include <vector>

#include "cnc/pass_sampler.hpp"
#include "cnc/toolpath.hpp"
#include "core/units.hpp"

namespace maquette::cnc {

/// Ticks, multiples of kResolution, limits included.
struct RasterArea {
  std::int64_t left = 0, right = 0, bottom = 0, top = 0;
};

struct RasterFrame {
  std::int64_t x0 = 0, y0 = 0;            ///< ticks
  std::int64_t dx = kResolution, dy = 0;  ///< one step along the rows

  [[nodiscard]] bool along_an_axis() const { return dx == 0 || dy == 0; }
  [[nodiscard]] LatticeLine row(std::int64_t j) const { return {x0 - j * dy, y0 + j * dx, dx, dy}; }
  [[nodiscard]] LatticeLine column(std::int64_t m) const {
    return {x0 + m * dx, y0 + m * dy, -dy, dx};
  }
  [[nodiscard]] double step_mm() const { return row(0).step_mm(); }
};

/// Places `first` to `last` of row `across`; first <= last.
struct RasterRow {
  std::int64_t across = 0, first = 0, last = 0;
};

/// Piece of a lattice line; cut from `from` to `to`, which may be smaller.
struct LineSegment {
  LatticeLine line;
  std::int64_t from = 0, to = 0;
  [[nodiscard]] double length_mm() const {
    return line.step_mm() * static_cast<double>(from < to ? to - from : from - to);
  }
};

/// Origin at the corner of the area that lies farthest to the right of the rows' direction.
[[nodiscard]] RasterFrame raster_frame(const RasterArea& area, Radians direction);

/// Row j inside the area; empty (first > last) if it misses it.
[[nodiscard]] RasterRow clip_row(const RasterFrame& frame, const RasterArea& area, std::int64_t j);

/// From right to left of the rows' direction, `stepover` apart rounded down to whole steps, the
/// last gap less; each at least 0.2 mm long. Along an axis the first and the last row lie on
/// the area's edges. @pre stepover >= one step
[[nodiscard]] std::vector<RasterRow> raster_rows(const RasterFrame& frame, const RasterArea& area,
                                                 double stepover_mm);

/// Ways inside the area from place `from` of one row to place `to` of another, along one row, then
/// straight across; at most `limit_mm` long, else empty. Both places lie on their rows.
[[nodiscard]] std::vector<LineSegment> link_inside(const RasterFrame& frame, const RasterArea& area,
                                                   std::int64_t row, std::int64_t from,
                                                   std::int64_t other, std::int64_t to,
                                                   double limit_mm);

}  // namespace maquette::cnc
