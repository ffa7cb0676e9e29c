// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file cutter_shape.hpp
/// A cutter's underside, and cutters that contain it wherever it may stand.
///
/// Minkowski sums of a cutter of corner radius r with a disc and with a ball are cutters again:
/// - with a horizontal disc: the flat end grows, the corner stays. It contains the cutter
///   moved sideways; dropped on a surface it bounds the cutter locations around from above, and on
///   flat ground equals them.
/// - with a ball of radius a: radius and corner grow by a, the tip hangs a lower. Dropped on a
///   surface and raised by a, the cutter keeps the distance a from the surface everywhere, measured
///   in space; so it leaves at least a above it vertically, and just a on flat ground. This is how
///   every strategy here leaves an allowance.

#include <cmath>

#include "cnc/tool.hpp"

namespace maquette::cnc {

/// Height of the underside above the tip at distance d >= 0 from the axis; INFINITY beyond the
/// radius.
[[nodiscard]] inline double underside_mm(const Cutter& cutter, double d_mm) {
  const double r = cutter.corner_radius_mm, t = d_mm - (cutter.radius_mm - r);
  if (d_mm > cutter.radius_mm) return INFINITY;
  if (t <= 0.0) return 0.0;
  return t * t / (r + std::sqrt(std::fmax(0.0, r * r - t * t)));
}

/// @pre by_mm >= 0
[[nodiscard]] inline Cutter moved_sideways(Cutter cutter, double by_mm) {
  cutter.radius_mm += by_mm;
  return cutter;
}
/// Tip `by_mm` lower. @pre by_mm >= 0
[[nodiscard]] inline Cutter with_allowance(Cutter cutter, double by_mm) {
  cutter.radius_mm += by_mm;
  cutter.corner_radius_mm += by_mm;
  return cutter;
}

}  // namespace maquette::cnc
