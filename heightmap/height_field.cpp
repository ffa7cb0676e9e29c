// SPDX-License-Identifier: GPL-3.0-or-later
#include "heightmap/height_field.hpp"

#include <algorithm>

namespace maquette::heightmap {

HeightRange height_range(const Grid<float>& z) {
  HeightRange range;
  for (const float h : z.cells()) {
    if (std::isnan(h)) {
      ++range.voids;
      continue;
    }
    range.min = std::fmin(range.min, h);  // fmin and fmax ignore the initial NaN
    range.max = std::fmax(range.max, h);
  }
  return range;
}

double height_at(const ModelField& field, double x_mm, double y_mm) {
  const double s = field.spacing.value();
  double u = (x_mm - field.x0.value()) / s;
  double v = (y_mm - field.y0.value()) / s;
  const auto last_col = static_cast<double>(field.z_mm.cols() - 1);
  const auto last_row = static_cast<double>(field.z_mm.rows() - 1);
  // The last nodes are on the field, whatever their coordinates' rounding says.
  if (u > last_col && x_mm <= field.x_mm(field.z_mm.cols() - 1)) u = last_col;
  if (v > last_row && y_mm <= field.y_mm(field.z_mm.rows() - 1)) v = last_row;
  if (!(u >= 0.0 && v >= 0.0 && u <= last_col && v <= last_row)) return NAN;
  const auto c = static_cast<std::ptrdiff_t>(std::min(u, last_col - 1.0));
  const auto r = static_cast<std::ptrdiff_t>(std::min(v, last_row - 1.0));
  const double du = u - static_cast<double>(c);
  const double dv = v - static_cast<double>(r);
  const double z00 = field.z_mm(r, c);
  const double z11 = field.z_mm(r + 1, c + 1);
  // Lower-right triangle (00, 10, 11) or upper-left triangle (00, 11, 01).
  if (du >= dv) {
    const double z10 = field.z_mm(r, c + 1);
    return z00 + du * (z10 - z00) + dv * (z11 - z10);
  }
  const double z01 = field.z_mm(r + 1, c);
  return z00 + dv * (z01 - z00) + du * (z11 - z01);
}

}  // namespace maquette::heightmap
