// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file disc_fit.hpp
/// Where a small patch lies, how wide and how high it is, by its points instead of by cells.
///
/// Model    A disc of one height h on a level base, points with independent noise s. Given centre
///          and width the best h is the mean of the n points in the disc less the base, and the
///          likelihood exp(n h^2 / (2 s^2)).
/// Beam     A range is a mean over the beam's width: the disc's edge is the integral of a Gaussian,
/// as
///          if it were straight.
/// Size     Mean and standard deviation over that likelihood, flat in centre, width and height. Its
///          largest value alone would say nothing of how sure it is: the likelihood steps with
///          every point that enters the disc.
/// Use      Beside the outline that cells give: of both descriptions of a patch the one is taken
///          that has more likelihood. That of a small patch which hardly stands out is the disc; a
///          square or a scratch that is seen clearly is its cells.

#include <optional>
#include <span>
#include <vector>

#include "scan/detail/disc_filter.hpp"

namespace maquette::scan::detail {

struct DiscFit {
  double x_mm = 0.0, y_mm = 0.0;
  double diameter_mm = 0.0, sigma_diameter_mm = 0.0;
  double height_mm = 0.0, sigma_height_mm = 0.0;  ///< against its base
  double area_mm2 = 0.0;
  double volume_mm3 = 0.0, sigma_volume_mm3 = 0.0;
  double base_mm = 0.0;   ///< the surroundings against the part as a whole
  double variance = 0.0;  ///< of a point, correlation counted in
  double gain = 0.0;      ///< twice the logarithm of the likelihood, against no disc
};

/// A point beside a disc: place and deviation from the part as a whole.
struct Sample {
  double x_mm, y_mm, d_mm;
};

/// Points up to this many widths of a disc from its middle are asked for.
inline constexpr double kDiscWindow = 2.0;
/// Of these, those beyond this many widths are its base: only the widest discs reach in there.
inline constexpr double kDiscBase = 0.8;

/// @param around  the points within kDiscWindow widths, of any order
/// @param beam_diameter_mm  at the part, 1/e^2 of the intensity; 0: a ray
/// @return nothing where the disc or its surroundings have too few points
[[nodiscard]] std::optional<DiscFit> fit_disc(const Disc& first, std::span<const Sample> around,
                                              double typical_variance,
                                              double beam_diameter_mm = 0.0);

}  // namespace maquette::scan::detail
