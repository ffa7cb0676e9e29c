// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file moments.hpp
/// First and second moments of a voxel's points, and the plane through those of several.

#include <optional>

#include "core/vec.hpp"

namespace maquette::scan::detail {

/// Sums over points, about a place that the user keeps (a voxel's middle).
struct Moments {
  double n = 0.0;
  Vec3 sum;
  double xx = 0, xy = 0, xz = 0, yy = 0, yz = 0, zz = 0;

  /// Adds sums about a place that lies `offset` from this one's.
  void add(const Moments& m, Vec3 offset);
};

struct Plane {
  Vec3 normal;            ///< unit, either way
  double rough_mm = 0.0;  ///< standard deviation of the points along it
};
/// That of least scatter; nothing for fewer than six points, points on a line, and points without
/// shape.
[[nodiscard]] std::optional<Plane> plane_of(const Moments& m);

}  // namespace maquette::scan::detail
