// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/path_figures.hpp"

#include <algorithm>
#include <array>

#include "cnc/arc_geometry.hpp"

namespace maquette::cnc {
namespace {

using Coordinate = std::int64_t ToolPosition::*;
constexpr std::array<Coordinate, 3> kCoordinates{&ToolPosition::x, &ToolPosition::y,
                                                 &ToolPosition::z};

double number(std::int64_t ticks) {
  return static_cast<double>(ticks);
}

/// Extends low and high by the quarter points that the arc passes; returns its length in ticks.
double arc(const ToolPosition& from, const PathMove& m, ToolPosition& low, ToolPosition& high) {
  const PlaneAxes axes = axes_of(m.plane);
  const Coordinate first = kCoordinates[axes.first], second = kCoordinates[axes.second],
                   third = kCoordinates[axes.third];
  const PlanePoint arm = arm_of(from, m), start{-arm.u, -arm.v},
                   end{number(m.to.*first - from.*first) - arm.u,
                       number(m.to.*second - from.*second) - arm.v};
  const double sweep = sweep_rad(start, end, m.counter_clockwise);
  const double r0 = std::hypot(start.u, start.v), r1 = std::hypot(end.u, end.v);
  const double reach = std::max(r0, r1);
  for (int quarter = 0; quarter < 4; ++quarter) {
    const bool along_first = quarter % 2 == 0;
    const double side = quarter < 2 ? 1.0 : -1.0;
    const PlanePoint top{along_first ? side : 0.0, along_first ? 0.0 : side};
    if (sweep_rad(start, top, m.counter_clockwise) > sweep) continue;
    const Coordinate axis = along_first ? first : second;
    const double centre = number(from.*axis) + (along_first ? arm.u : arm.v);
    if (quarter < 2)
      high.*axis = std::max(high.*axis, static_cast<std::int64_t>(std::ceil(centre + reach)));
    else
      low.*axis = std::min(low.*axis, static_cast<std::int64_t>(std::floor(centre - reach)));
  }
  return std::hypot(0.5 * (r0 + r1) * sweep, number(m.to.*third - from.*third));
}

void extend(ToolPosition& low, ToolPosition& high, const ToolPosition& a) {
  low = {std::min(low.x, a.x), std::min(low.y, a.y), std::min(low.z, a.z)};
  high = {std::max(high.x, a.x), std::max(high.y, a.y), std::max(high.z, a.z)};
}

}  // namespace

void PathFigures::add(const Toolpath& piece) {
  ToolPosition at = piece.start;
  extend(low, high, at);
  for (const PathMove& m : piece.moves) {
    ToolPosition least = at, most = at;
    extend(least, most, m.to);
    double length = kTick_mm;
    if (m.kind == PathMove::Kind::arc)
      length *= arc(at, m, least, most);
    else
      length *= std::hypot(number(m.to.x - at.x), number(m.to.y - at.y), number(m.to.z - at.z));
    extend(low, high, least);
    extend(low, high, most);
    at = m.to;
    if (m.kind == PathMove::Kind::rapid) {
      ++rapids;
      rapid_length_mm += length;
      continue;
    }
    double& oldest = seconds_[(lines + arcs) % kWindow];
    ++(m.kind == PathMove::Kind::arc ? arcs : lines);
    lowest_cut = std::min(lowest_cut, least.z);
    highest_cut = std::max(highest_cut, most.z);
    cutting_length_mm += length;
    cutting_time_min += length / m.feed_mm_min;
    shortest_cut_mm = std::min(shortest_cut_mm, length);
    in_window_ += 60.0 * length / m.feed_mm_min - oldest;
    oldest = 60.0 * length / m.feed_mm_min;
    if (lines + arcs >= kWindow && in_window_ > 0.0)
      highest_rate_per_s = std::max(highest_rate_per_s, static_cast<double>(kWindow) / in_window_);
  }
}

Box3 PathFigures::extent_mm() const {
  Box3 box;
  if (low.x > high.x) return box;  // nothing moves
  for (const ToolPosition& p : {low, high})
    box.add({mm_of_ticks(p.x), mm_of_ticks(p.y), mm_of_ticks(p.z)});
  return box;
}

}  // namespace maquette::cnc
