// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file viewpoint.hpp
/// From where points were seen, and how wide the beam was.

#include <cstddef>
#include <optional>

#include "core/vec.hpp"

namespace maquette::scan {

/// Of the next `points` points of a list.
struct Viewpoint {
  std::optional<Vec3> station_mm;  ///< in the points' frame; nothing: seen from straight above
  double beam_diameter_mm = 0.0;   ///< at the part, 1/e^2; 0: a ray
  std::size_t points = 0;
};

}  // namespace maquette::scan
