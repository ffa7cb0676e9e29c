// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file height_field.hpp
/// The two height fields of the project: of the planet (metres, site frame) and
/// of the model (millimetres, model frame). Node is point: node (r, c) stands at
/// x = x0 + c spacing, y = y0 + r spacing, row 0 southernmost. A void is NaN.

#include <cmath>

#include "core/grid.hpp"
#include "core/units.hpp"

namespace maquette::heightmap {

/// Heights above the site's datum in the site frame: a local tangent plane on
/// the body's ellipsoid, x east, y north, origin at the site's centre.
struct PlanetField {
  Grid<float> z_m;
  Metres spacing{1.0};
  Metres x0{0.0};
  Metres y0{0.0};
};

/// Surface of the physical model. The nodes span the part: n x m nodes bound
/// (n - 1) x (m - 1) cells; each cell is two triangles, cut from its lower left
/// to its upper right node (this diagonal everywhere, in every room).
struct ModelField {
  Grid<float> z_mm;
  Millimetres spacing{1.0};
  Millimetres x0{0.0};
  Millimetres y0{0.0};

  [[nodiscard]] double x_mm(std::ptrdiff_t col) const {
    return x0.value() + spacing.value() * static_cast<double>(col);
  }
  [[nodiscard]] double y_mm(std::ptrdiff_t row) const {
    return y0.value() + spacing.value() * static_cast<double>(row);
  }
};

struct HeightRange {
  float min = NAN;  ///< of all that is not void; NaN if all is
  float max = NAN;
  std::ptrdiff_t voids = 0;
};
[[nodiscard]] HeightRange height_range(const Grid<float>& z);

/// Height of the triangulated surface (see ModelField) at a point; NaN outside
/// and where the triangle has a void corner. Exact at nodes. O(1).
[[nodiscard]] double height_at(const ModelField& field, double x_mm, double y_mm);

}  // namespace maquette::heightmap
