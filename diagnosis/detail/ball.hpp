// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

// A ball of another size, its tip where it was.

#include <cmath>

#include "core/vec.hpp"

namespace maquette::diagnosis::detail {

/// By how much the ball's underside rises, upwards, over the place where its normal is `n`, if its
/// radius grows by `larger`: r' - sqrt(r'^2 - rho^2) less the same of r, rho^2 = r^2 (1 - n_z^2).
/// To first order larger (1 - 1 / n_z), which is taken where the smaller ball does not reach.
[[nodiscard]] inline double ball_rise(double radius, Vec3 n, double larger) {
  const double r = radius + larger, q = r * r - radius * radius * (1.0 - n.z * n.z);
  if (!(q > 0.0)) return larger * (1.0 - 1.0 / n.z);
  return r - std::sqrt(q) - radius * (1.0 - n.z);
}

}  // namespace maquette::diagnosis::detail
