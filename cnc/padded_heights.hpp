// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file padded_heights.hpp
/// Copy of a height grid with nodes at kNoSurface around it, so that windows and tiles may reach
/// over its edge. 4 bytes a node.

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "cnc/cell_contact.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::cnc {

/// Heights where there is no surface. Its square is a finite float.
inline constexpr float kNoSurface = -1e15F;

struct PaddedHeights {
  /// @param margin_rows, margin_cols  nodes to be had on each side
  PaddedHeights(const heightmap::ModelField& field, std::ptrdiff_t margin_rows,
                std::ptrdiff_t margin_cols)
      : d(field.spacing.value()),
        per_d(1.0 / d),
        x0(field.x0.value()),
        y0(field.y0.value()),
        rows(field.z_mm.rows()),
        cols(field.z_mm.cols()),
        stride(cols + margin_cols),  // what is right of a row is left of the next
        z(static_cast<std::size_t>((rows + 2 * margin_rows) * stride), kNoSurface),
        first(margin_rows * stride + margin_cols) {
    for (std::ptrdiff_t r = 0; r < rows; ++r) {
      const auto from = field.z_mm.row(r);
      std::copy(from.begin(), from.end(), z.data() + first + r * stride);
    }
  }

  [[nodiscard]] const float* node(std::ptrdiff_t row, std::ptrdiff_t col) const {
    return z.data() + first + row * stride + col;
  }
  /// @pre the node (row, col) is one of the field's
  [[nodiscard]] CellCorners corners(std::ptrdiff_t row, std::ptrdiff_t col, double x_mm,
                                    double y_mm) const {
    const float* z0 = node(row, col);
    const float* z1 = z0 + stride;
    return {x_mm - (x0 + d * static_cast<double>(col)),
            y_mm - (y0 + d * static_cast<double>(row)),
            static_cast<double>(z0[0]),
            static_cast<double>(z0[1]),
            static_cast<double>(z1[0]),
            static_cast<double>(z1[1]),
            col + 1 < cols,
            row + 1 < rows};
  }

  double d, per_d, x0, y0;
  std::ptrdiff_t rows, cols;
  std::ptrdiff_t stride;
  std::vector<float> z;
  std::ptrdiff_t first;  // of the field's nodes
};

}  // namespace maquette::cnc
