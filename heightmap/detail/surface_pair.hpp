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
  /// No difference is told more exactly: a thousandth of the usual step from cell to cell, which is
  /// what interpolation is off by. As residuals' least spread it keeps Tukey's weights from
  /// taking surfaces without noise apart.
  double least_spread_m = 1e-9;
};

/// What interpolation draws a shift by, in pixels of the coarser surface (rms of an axis, measured
/// without noise on overlaps of 40 to 128 pixels).
inline constexpr double kInterpolation_px = 2e-4;

/// Three cells to a pixel of the coarser surface, each the mean of whole nodes. Nodes left over at
/// the upper and right edge are dropped. Both grids on the same nodes.
[[nodiscard]] SurfacePair cells_of(const Grid<float>& lower, const Grid<float>& upper,
                                   double spacing_m, double coarse_m);

/// The finer one as the coarser pixel would have seen it, then both a little blurred.
void bring_to_one_resolution(SurfacePair& pair, double lower_pixel_m, double upper_pixel_m);

/// Means of m x m cells; void if more than half of them are.
[[nodiscard]] Grid<float> block_means(const Grid<float>& z, std::ptrdiff_t m);

/// Lagrange's polynomial through 8 x 8 cells with its gradient, in cell units; through 4 x 4 where
/// not all are there, NaN where one of these is missing. Between cells it keeps 98 % of waves of
/// four (cubic convolution 88 %: what it takes away drew shifts by 0.01 cell where overlaps are
/// narrow).
[[nodiscard]] std::array<double, 3> height_and_gradient(const Grid<float>& z, double x, double y);

/// The same at a cell, with slopes from three cells on either side (one where not all are there):
/// noise of heights and of these slopes have nothing in common, as with slopes of the polynomials
/// beside it they would. NaN where one of the nearest is missing.
[[nodiscard]] std::array<double, 3> height_and_gradient_at(const Grid<float>& z, std::ptrdiff_t r,
                                                           std::ptrdiff_t c);

struct Spread {
  double median = 0.0, nmad = 0.0;
  std::size_t n = 0;
};
/// NaN are left out.
[[nodiscard]] Spread spread_of(const std::vector<double>& residual);

/// Tukey's psi(e) / scale and its derivative.
[[nodiscard]] double psi(double e, double limit);
[[nodiscard]] double psi_slope(double e, double limit);
/// Mean of that derivative as steps and covariance need it: never below half of the mean weight
/// psi(e) / e, or residuals with long tails would turn steps around.
class MeanSlope {
 public:
  void add(double e, double limit);
  void add(const MeanSlope& other);
  [[nodiscard]] double value() const;

 private:
  double slope_ = 0.0, weight_ = 0.0, n_ = 0.0;
};

}  // namespace maquette::heightmap::detail
