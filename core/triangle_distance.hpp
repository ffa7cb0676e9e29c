// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file triangle_distance.hpp
/// How far a point is from a triangle.

#include "core/vec.hpp"

namespace maquette {

/// Square of the distance between a point and a triangle; NaN if a corner is. Ericson,
/// "Real-Time Collision Detection", 2005, section 5.1.5 (regions of the nearest feature).
[[nodiscard]] double triangle_distance2(Vec3 p, Vec3 a, Vec3 b, Vec3 c);

}  // namespace maquette
