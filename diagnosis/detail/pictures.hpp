// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

// Values between a picture's pixels, and what spreads them.

#include <array>
#include <functional>

#include "core/grid.hpp"

namespace maquette::diagnosis::detail {

/// Between nodes; the edge goes on.
/// @param row,col  of nodes: whole numbers at them
[[nodiscard]] float bilinear(const Grid<float>& g, double row, double col);
/// The same by Catmull-Rom's cubics.
[[nodiscard]] float cubic(const Grid<float>& g, double row, double col);

/// Separable Gaussian; the edge goes on.
/// @param variance_px2  at most 0: the picture stays
void blur(Grid<float>& image, double variance_px2);
/// Gaussian of each pixel's own variance, where that is not 0.
/// @param variance_px2  shape as the image
void blur_by_place(Grid<float>& image, const Grid<float>& variance_px2);
/// A straight motion: what the tensor's larger axis has beyond the smaller one is values along a
/// line, the rest is a Gaussian.
/// @param tensor_px2  variance along columns, covariance, variance along rows
/// @param wanted  (row, column): elsewhere the picture is not smeared along the line
void smear(Grid<float>& image, const std::array<double, 3>& tensor_px2,
           const std::function<bool(std::ptrdiff_t row, std::ptrdiff_t col)>& wanted);

}  // namespace maquette::diagnosis::detail
