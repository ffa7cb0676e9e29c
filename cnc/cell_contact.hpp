// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file cell_contact.hpp
/// Contacts of one cell of a height grid. A cell owns its first node, the edges that start
/// there (along x, along y, across) and its two facets, so that each feature is looked at once.

#include <algorithm>
#include <cmath>

#include "cnc/contact.hpp"

namespace maquette::cnc {

/// In the cell's own coordinates: node z00 at the origin, the axis at (px, py). Where the field
/// ends, `right` or `above` says that there is no next column or row.
struct CellCorners {
  double px, py;
  double z00, z10, z01, z11;  // first digit: along x
  bool right, above;
};

template <class Shape>
class CellContact {
 public:
  CellContact(const Shape& shape, double spacing_mm)
      : shape_(shape), d_(spacing_mm), per_d_(1.0 / spacing_mm) {}

  void touch(const CellCorners& c, Touch& best) const {
    touch_vertex(shape_, -c.px, -c.py, c.z00, best);
    if (c.right) {
      edge(c, c.px, c.py, d_, c.z10 - c.z00, 1.0, 0.0, best);
    }
    if (c.above) {
      edge(c, c.py, c.px, d_, c.z01 - c.z00, 0.0, 1.0, best);
    }
    if (!(c.right && c.above)) return;
    constexpr double kHalf = 0.70710678118654752440;
    edge(c, (c.px + c.py) * kHalf, (c.py - c.px) * kHalf, d_ / kHalf, c.z11 - c.z00, kHalf, kHalf,
         best);
    facet(
        c, (c.z10 - c.z00) * per_d_, (c.z11 - c.z10) * per_d_,
        [&](double x, double y) { return y >= 0.0 && x <= d_ && y <= x; }, best);
    facet(
        c, (c.z11 - c.z01) * per_d_, (c.z01 - c.z00) * per_d_,
        [&](double x, double y) { return x >= 0.0 && y <= d_ && y >= x; }, best);
  }

 private:
  /// Edge from the origin along the unit vector (ex, ey); the axis stands at `along`, `beside`.
  void edge(const CellCorners& c, double along, double beside, double length, double rise,
            double ex, double ey, Touch& best) const {
    const double m = rise / length;
    double s, underside;
    if (!find_peak(shape_, beside * beside, m, along, length, s, underside)) return;
    const double tip = c.z00 + m * s - underside;
    if (tip > best.tip_mm) best = {tip, s * ex - c.px, s * ey - c.py};
  }

  template <class Inside>
  void facet(const CellCorners& c, double gx, double gy, Inside&& inside, Touch& best) const {
    const double g2 = gx * gx + gy * gy;
    const double tip = c.z00 + gx * c.px + gy * c.py + shape_.above_plane(g2);
    if (!(tip > best.tip_mm)) return;
    const double away = g2 > 0.0 ? shape_.on_plane(g2).away_mm / std::sqrt(g2) : 0.0;
    if (inside(c.px + away * gx, c.py + away * gy)) best = {tip, away * gx, away * gy};
  }

  Shape shape_;
  double d_, per_d_;
};

}  // namespace maquette::cnc
