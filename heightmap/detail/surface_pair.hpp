// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file surface_pair.hpp
/// Two surfaces on cells of one resolution, ready to be compared: what pairwise (coregister.hpp)
/// and joint alignment (joint_adjustment.hpp) have in common.

#include <array>
#include <vector>

#include "core/grid.hpp"

namespace maquette::heightmap::detail {

inline constexpr double kTukey = 4.685;  ///< 95 % efficiency for normal noise

struct SurfacePair {
  Grid<float> lower, upper;  ///< means of whole nodes; spikes and voids NaN
  std::ptrdiff_t nodes = 1;  ///< of a cell's side
  double cell_m = 1.0;
  bool resolved = false;  ///< the grid is large enough for cells of a third of the coarser pixel
  bool by_upper = false;  ///< whose slopes residuals are weighed with
};

/// Three cells to a pixel of the coarser surface, each the mean of whole nodes. Nodes left over at
/// the upper and right edge are dropped. Both grids on the same nodes.
[[nodiscard]] SurfacePair cells_of(const Grid<float>& lower, const Grid<float>& upper,
                                   double spacing_m, double coarse_m);

/// The finer one as the coarser pixel would have seen it, then both a little blurred.
void bring_to_one_resolution(SurfacePair& pair, double lower_pixel_m, double upper_pixel_m);

/// Means of m x m cells; void if more than half of them are.
[[nodiscard]] Grid<float> block_means(const Grid<float>& z, std::ptrdiff_t m);

/// Cubic convolution in cell units with its gradient; NaN if any of the 16 is missing.
[[nodiscard]] std::array<double, 3> height_and_gradient(const Grid<float>& z, double x, double y);

struct Spread {
  double median = 0.0, nmad = 0.0;
  std::size_t n = 0;
};
/// NaN are left out.
[[nodiscard]] Spread spread_of(const std::vector<double>& residual);

/// Tukey's psi(e) / scale and its derivative.
[[nodiscard]] double psi(double e, double limit);
[[nodiscard]] double psi_slope(double e, double limit);

}  // namespace maquette::heightmap::detail
