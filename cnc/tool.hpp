// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file tool.hpp
/// The ball-nose cutter. Its programmed point is the tip: the lowest point of the
/// ball, `radius` below its centre.

#include <cmath>

namespace maquette::cnc {

struct BallNose {
  double radius_mm = 3.0;  ///< > 0
};

/// Ridge between two parallel passes on flat ground: R - sqrt(R^2 - (stepover / 2)^2).
/// @pre 0 <= stepover <= 2 R
[[nodiscard]] inline double scallop_mm(BallNose tool, double stepover_mm) {
  const double half = 0.5 * stepover_mm;
  // Written as a quotient: the difference would lose half its digits at small stepovers.
  return half * half / (tool.radius_mm + std::sqrt(tool.radius_mm * tool.radius_mm - half * half));
}

}  // namespace maquette::cnc
