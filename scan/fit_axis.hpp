// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file fit_axis.hpp
/// Where a linear axis runs: a mark on its carriage was measured at several positions.
///
/// p(s) = origin + s scale direction, s the position that the control shows. Least squares of all
/// three coordinates on s; covariances from the residuals.

#include <array>
#include <span>

#include "core/result.hpp"
#include "core/vec.hpp"

namespace maquette::scan {

inline constexpr ErrorCode kAxis{"SCAN_AXIS"};

struct AxisStop {
  double position_mm = 0.0;  ///< as the control shows it
  Vec3 at_mm;                ///< where the mark was measured
};

struct AxisFit {
  Vec3 origin_mm;      ///< the mark at position 0
  Vec3 direction;      ///< unit
  double scale = 1.0;  ///< mm of travel per mm shown
  Vec3 sigma_origin_mm;
  double sigma_direction_rad = 0.0, sigma_scale = 0.0;
  double straightness_mm = 0.0;  ///< largest distance of a stop from the line
  double rms_mm = 0.0;           ///< of the residuals, per coordinate, with freedom taken off
};

/// @return the line, or SCAN_AXIS: fewer than three stops, all at one position, or a value that is
///   not finite
[[nodiscard]] Result<AxisFit> fit_axis(std::span<const AxisStop> stops);

}  // namespace maquette::scan
