// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file surface_distance.hpp
/// How far a point is from the triangulated surface of a model field.

#include <span>

#include "core/vec.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::scan {

/// A point this far beside the outline still counts as on it: rounding of a pose.
inline constexpr double kOutlineSlackMm = 1e-6;

/// Distance to the nearest point of the triangulated surface; positive above, negative
/// below (over a height field that is the side of the nearest triangle's normal). NaN if
/// the point
///   - is beside the field's outline or over a void,
///   - is farther than `reach_mm`,
///   - belongs to a wall of the part: deeper below the surface than one node spacing and
///     nearer to one of the four vertical planes of the outline than to the surface.
/// Exact (double precision) also at edges, nodes and steep sides of stones. Cost grows
/// with (distance / spacing)^2; below one spacing a few cells are looked at.
[[nodiscard]] double signed_distance_mm(const heightmap::ModelField& field, Vec3 point_mm,
                                        double reach_mm);

/// The same of many points, faster where neighbours in the list are near each other.
/// @param distances  one a point
/// @pre points.size() == distances.size()
void signed_distances_mm(const heightmap::ModelField& field, std::span<const Vec3> points_mm,
                         double reach_mm, std::span<double> distances);

}  // namespace maquette::scan
