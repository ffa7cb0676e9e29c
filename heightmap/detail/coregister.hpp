// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file coregister.hpp
/// How one surface must move to lie on another: shift, height and tilt, and where asked
/// a turn about the vertical and a scale; with its covariance, or the reason why not.
///
/// Method. Nuth and Kaab 2011, doi:10.5194/tc-5-271-2011: the height difference of two shifted
/// surfaces is the shift times the slope. In its linear form (difference = shift . gradient
/// + height + tilt . place) flat ground needs no division by its slope; solved by Gauss-Newton
/// with Tukey's weights (Beaton and Tukey 1974, doi:10.1080/00401706.1974.10489171) from coarse
/// to fine. The start is the shift at which the clipped slopes of both correlate most.
///
/// Both surfaces are brought to the coarser one's resolution first, and both are smoothed by half a
/// coarse pixel: else interpolation, which smooths noise most half-way between pixels, draws the
/// shift there.
///
/// Noise has slopes too: the normal equations take products of the one surface's slopes with the
/// other's, so that steps are not too short and the covariance not too small.
///
/// Covariance. Height differences of neighbours are alike (pixels wider than cells, correlated
/// noise), so least squares' own covariance is too small. Here it is the sandwich of the
/// scores' covariance, summed over lags up to where residuals no longer correlate (flat-top window,
/// Politis 2003, doi:10.1111/1467-9868.00415). It does not know of errors as long as the overlap:
/// what a bow does to the tilt is not in it.

#include <array>
#include <optional>
#include <string>

#include "core/grid.hpp"

namespace maquette::heightmap::detail {

struct CoregisterOptions {
  bool height_only = false;
  bool rotation = false, scale = false;
  double most_sigma_pixels = 0.1;  ///< of the coarser surface; less exact shifts are refused
};

/// A point p of the upper surface, from the middle of the grid, belongs at
/// scale * turn(rotation) p + (east, north), raised by up + tilt . (its new place).
struct Coregistration {
  enum Unknown { kEast, kNorth, kUp, kTiltEast, kTiltNorth, kRotation, kScale, kUnknowns };
  double east_m = 0.0, north_m = 0.0, up_m = 0.0;
  double tilt_east = 0.0, tilt_north = 0.0;  ///< metres per metre
  double rotation_rad = 0.0;                 ///< counter-clockwise from above
  double scale = 1.0;
  /// Of the values above in the order of Unknown; zero for what was not asked.
  std::array<std::array<double, kUnknowns>, kUnknowns> covariance{};

  double overlap = 0.0;  ///< share of the grid's cells in which both have a height
  /// Median and normalised median absolute deviation of lower less upper, both in the coarser
  /// resolution (where it is refused for few pixels: as they are).
  double median_before_m = 0.0, median_after_m = 0.0;
  double nmad_before_m = 0.0, nmad_after_m = 0.0;
  /// False: relief or overlap do not say where the upper surface lies (`refusal` says why);
  /// then only its height moves, to a median difference of zero.
  bool horizontal = false;
  std::string refusal;

  [[nodiscard]] double sigma(Unknown u) const;
  /// Where on the upper surface the point lies that belongs at (x, y); metres from the middle.
  [[nodiscard]] std::array<double, 2> origin_of(double x_m, double y_m) const;
};

/// Both grids on the same nodes, voids NaN.
/// @param lower_pixel_m, upper_pixel_m  their resolutions
/// @return nothing if no node has both heights
///
/// Accuracy (tests: twenty seeds, three reliefs): same resolution 0.0025 pixel rms; chi^2 per
/// degree of freedom of the stated covariance 0.97 to 1.03, on strips of 40 pixels 1.04. Ten fine
/// pixels to a coarse one, 100 coarse ones a side, jitter, a fifth of outliers: 0.025 fine pixel,
/// tilt 3.7 microradians, height 1 % of the coarse noise, chi^2 per degree of freedom 1.07.
/// A horizontal shift is claimed if it is known to a tenth of the coarser pixel from at least 30 of
/// them, and slopes of both then correlate by 0.5 or more.
[[nodiscard]] std::optional<Coregistration> coregister(const Grid<float>& lower,
                                                       const Grid<float>& upper, double spacing_m,
                                                       double lower_pixel_m, double upper_pixel_m,
                                                       const CoregisterOptions& options = {});

}  // namespace maquette::heightmap::detail
