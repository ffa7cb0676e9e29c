// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file packed_grid.hpp
/// Rasters as a page carries them: a third to a fifth of float32.
///
/// zlib of 2 n bytes: the high bytes of n numbers row by row, then the low ones; each number less
/// (its left + lower - lower left neighbour), modulo 65536. 0 is a void, k is low + (k - 1) step.

#include <string>
#include <string_view>
#include <vector>

#include "tools/view/view_fields.hpp"

namespace maquette::tools {

/// A thinned raster as the page unpacks it ("grid" above).
struct PackedGrid {
  std::string bytes;
  double low = 0.0, step = 1.0;
};
/// @param least_step  values are rounded to this, or to 1/65534 of their range
[[nodiscard]] PackedGrid packed(const ThinnedField& field, double least_step);
/// What the page reads out of it.
[[nodiscard]] std::vector<float> unpacked(const PackedGrid& grid, std::size_t rows,
                                          std::size_t cols);

/// zlib's format, which a browser's DecompressionStream("deflate") undoes.
[[nodiscard]] std::string deflated(std::string_view bytes);

}  // namespace maquette::tools
