// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file arc_geometry.hpp
/// Arcs in their plane, for those who write and those who read them.

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numbers>

#include "cnc/toolpath.hpp"

namespace maquette::cnc {

/// Axes of the plane in right-handed order, then its normal: 0 x, 1 y, 2 z.
struct PlaneAxes {
  std::size_t first, second, third;
};
[[nodiscard]] constexpr PlaneAxes axes_of(ArcPlane plane) {
  const std::size_t third = plane == ArcPlane::xy ? 2 : plane == ArcPlane::zx ? 1 : 0;
  return {(third + 1) % 3, (third + 2) % 3, third};
}

struct PlanePoint {
  double u = 0.0, v = 0.0;
};

/// Angle from `start` to `end`, both as seen from the centre, in the arc's direction; [0, 2 pi).
[[nodiscard]] inline double sweep_rad(PlanePoint start, PlanePoint end, bool counter_clockwise) {
  const double cross = start.u * end.v - start.v * end.u, dot = start.u * end.u + start.v * end.v;
  const double angle = std::atan2(counter_clockwise ? cross : -cross, dot);
  return angle < 0.0 ? angle + 2.0 * std::numbers::pi : angle;
}

/// Centre, seen from the start, of the arc with this radius to an end `chord` away: the arc of
/// at most half a turn, or of at least half a turn where the radius is negative. A radius
/// shorter than half the chord gives the chord's middle.
/// @pre the chord is not zero
[[nodiscard]] inline PlanePoint centre_by_radius(PlanePoint chord, double radius,
                                                 bool counter_clockwise) {
  const double half = 0.5 * std::hypot(chord.u, chord.v);
  const double rise = std::sqrt(std::fmax(0.0, radius * radius - half * half));
  // The centre lies left of the chord for the short counter-clockwise arc.
  const double side = counter_clockwise == (radius >= 0.0) ? rise : -rise;
  return {0.5 * chord.u - side * chord.v / (2.0 * half),
          0.5 * chord.v + side * chord.u / (2.0 * half)};
}

/// Centre of the arc, seen from its start, along the plane's first and second axis; ticks.
[[nodiscard]] inline PlanePoint arm_of(const ToolPosition& from, const PathMove& arc) {
  const std::array<std::int64_t, 3> centre{arc.i, arc.j, arc.k};
  const std::array<std::int64_t, 3> way{arc.to.x - from.x, arc.to.y - from.y, arc.to.z - from.z};
  const PlaneAxes axes = axes_of(arc.plane);
  const auto seen = [&axes](const std::array<std::int64_t, 3>& a) {
    return PlanePoint{static_cast<double>(a[axes.first]), static_cast<double>(a[axes.second])};
  };
  if (arc.radius == 0) return seen(centre);
  return centre_by_radius(seen(way), static_cast<double>(arc.radius), arc.counter_clockwise);
}

}  // namespace maquette::cnc
