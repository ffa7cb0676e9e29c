// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/path_figures.hpp"

#include <algorithm>
#include <array>

#include "cnc/arc_geometry.hpp"

namespace maquette::cnc {
namespace {

constexpr std::size_t kWindow = 32;

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
  const ToolPosition centre{from.x + m.i, from.y + m.j, from.z + m.k};
  const auto seen = [&](const ToolPosition& at) {
    return PlanePoint{number(at.*first - centre.*first), number(at.*second - centre.*second)};
  };
  const PlanePoint start = seen(from), end = seen(m.to);
  const double sweep = sweep_rad(start, end, m.counter_clockwise);
  const double r0 = std::hypot(start.u, start.v), r1 = std::hypot(end.u, end.v);
  const auto reach = static_cast<std::int64_t>(std::ceil(std::max(r0, r1)));
  for (int quarter = 0; quarter < 4; ++quarter) {
    const bool along_first = quarter % 2 == 0;
    const double side = quarter < 2 ? 1.0 : -1.0;
    const PlanePoint top{along_first ? side : 0.0, along_first ? 0.0 : side};
    if (sweep_rad(start, top, m.counter_clockwise) > sweep) continue;
    const Coordinate axis = along_first ? first : second;
    if (quarter < 2)
      high.*axis = std::max(high.*axis, centre.*axis + reach);
    else
      low.*axis = std::min(low.*axis, centre.*axis - reach);
  }
  return std::hypot(0.5 * (r0 + r1) * sweep, number(m.to.*third - from.*third));
}

void extend(ToolPosition& low, ToolPosition& high, const ToolPosition& a) {
  low = {std::min(low.x, a.x), std::min(low.y, a.y), std::min(low.z, a.z)};
  high = {std::max(high.x, a.x), std::max(high.y, a.y), std::max(high.z, a.z)};
}

}  // namespace

void PathFigures::add(const PathFigures& piece) {
  lines += piece.lines;
  arcs += piece.arcs;
  rapids += piece.rapids;
  cutting_length_mm += piece.cutting_length_mm;
  rapid_length_mm += piece.rapid_length_mm;
  cutting_time_min += piece.cutting_time_min;
  shortest_cut_mm = std::min(shortest_cut_mm, piece.shortest_cut_mm);
  highest_rate_per_s = std::max(highest_rate_per_s, piece.highest_rate_per_s);
  extend(low, high, piece.low);
  extend(low, high, piece.high);
  lowest_cut = std::min(lowest_cut, piece.lowest_cut);
  highest_cut = std::max(highest_cut, piece.highest_cut);
}

PathFigures figures_of(const Toolpath& path) {
  PathFigures f;
  ToolPosition at = path.start;
  extend(f.low, f.high, at);
  std::array<double, kWindow> seconds{};
  double in_window = 0.0;
  std::size_t cuts = 0;
  for (const PathMove& m : path.moves) {
    ToolPosition low = at, high = at;
    extend(low, high, m.to);
    double length = mm_of_ticks(1);
    if (m.kind == PathMove::Kind::arc)
      length *= arc(at, m, low, high);
    else
      length *= std::hypot(number(m.to.x - at.x), number(m.to.y - at.y), number(m.to.z - at.z));
    extend(f.low, f.high, low);
    extend(f.low, f.high, high);
    at = m.to;
    if (m.kind == PathMove::Kind::rapid) {
      ++f.rapids;
      f.rapid_length_mm += length;
      continue;
    }
    ++(m.kind == PathMove::Kind::arc ? f.arcs : f.lines);
    f.lowest_cut = std::min(f.lowest_cut, low.z);
    f.highest_cut = std::max(f.highest_cut, high.z);
    f.cutting_length_mm += length;
    f.cutting_time_min += length / m.feed_mm_min;
    f.shortest_cut_mm = std::min(f.shortest_cut_mm, length);
    double& oldest = seconds[cuts % kWindow];
    in_window += 60.0 * length / m.feed_mm_min - oldest;
    oldest = 60.0 * length / m.feed_mm_min;
    ++cuts;
    if (cuts >= kWindow && in_window > 0.0)
      f.highest_rate_per_s = std::max(f.highest_rate_per_s, number(kWindow) / in_window);
  }
  if (cuts > 0 && cuts < kWindow && in_window > 0.0)
    f.highest_rate_per_s = number(static_cast<std::int64_t>(cuts)) / in_window;
  return f;
}

}  // namespace maquette::cnc
