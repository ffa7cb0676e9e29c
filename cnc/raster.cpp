// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/raster.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <numeric>

#include "core/check.hpp"

namespace maquette::cnc {
namespace {

constexpr std::int64_t kLargestStep = 32;  // times kResolution
constexpr double kShortestRow_mm = 0.2;

std::int64_t floor_div(std::int64_t a, std::int64_t b) {
  const std::int64_t q = a / b;
  return q * b != a && ((a < 0) != (b < 0)) ? q - 1 : q;
}
std::int64_t ceil_div(std::int64_t a, std::int64_t b) {
  return -floor_div(-a, b);
}

/// Narrows [first, last] to the k with low <= at + k step <= high.
void narrow(std::int64_t at, std::int64_t step, std::int64_t low, std::int64_t high,
            std::int64_t& first, std::int64_t& last) {
  if (step == 0) {
    if (at < low || at > high) last = first - 1;
    return;
  }
  std::int64_t from = step > 0 ? low - at : high - at, to = step > 0 ? high - at : low - at;
  first = std::max(first, ceil_div(from, step));
  last = std::min(last, floor_div(to, step));
}

}  // namespace

RasterFrame raster_frame(const RasterArea& area, Radians direction) {
  const double c = std::cos(direction.value()), s = std::sin(direction.value());
  std::int64_t p = 0, q = 0;
  double least = INFINITY;
  // Shortest first, so that the axes have steps of one.
  for (std::int64_t n = 1; n <= kLargestStep; ++n)
    for (std::int64_t m = -n; m <= n; ++m)
      for (const auto& [a, b] : {std::pair{n, m}, {-n, m}, {m, n}, {m, -n}}) {
        if (a * a + b * b > kLargestStep * kLargestStep) continue;
        const auto x = static_cast<double>(a), y = static_cast<double>(b);
        if (x * c + y * s <= 0.0) continue;
        const double off = std::abs(std::atan2(x * s - y * c, x * c + y * s));
        if (off < least - 1e-12) least = off, p = a, q = b;
      }
  RasterFrame frame;
  frame.dx = p * kResolution;
  frame.dy = q * kResolution;
  // Rightmost corner: least -q x + p y.
  frame.x0 = q > 0 || (q == 0 && p > 0) ? (q > 0 ? area.right : area.left)
                                        : (q < 0 ? area.left : area.right);
  frame.y0 = p > 0 || (p == 0 && q > 0) ? area.bottom : area.top;
  return frame;
}

RasterRow clip_row(const RasterFrame& frame, const RasterArea& area, std::int64_t j) {
  const LatticeLine line = frame.row(j);
  constexpr std::int64_t kFar = std::int64_t{1} << 40;
  RasterRow row{j, -kFar, kFar};
  narrow(line.x, line.dx, area.left, area.right, row.first, row.last);
  narrow(line.y, line.dy, area.bottom, area.top, row.first, row.last);
  return row;
}

std::vector<RasterRow> raster_rows(const RasterFrame& frame, const RasterArea& area,
                                   double stepover_mm) {
  const double unit = frame.step_mm();
  // How far the area reaches across, in steps.
  const auto p = static_cast<double>(frame.dx), q = static_cast<double>(frame.dy);
  double reach = 0.0;
  for (const std::int64_t x : {area.left, area.right})
    for (const std::int64_t y : {area.bottom, area.top})
      reach = std::max(
          reach, (-q * static_cast<double>(x - frame.x0) + p * static_cast<double>(y - frame.y0)) /
                     (p * p + q * q));
  const auto last = static_cast<std::int64_t>(std::floor(reach + 1e-9));
  std::vector<RasterRow> rows;
  const auto add = [&](std::int64_t j) {
    if (!rows.empty() && rows.back().across >= j) return;
    const RasterRow row = clip_row(frame, area, j);
    if (static_cast<double>(row.last - row.first) * unit >= kShortestRow_mm) rows.push_back(row);
  };
  const auto apart = static_cast<std::int64_t>(std::floor(stepover_mm / unit + 1e-6));
  MAQUETTE_CHECK(apart >= 1, "stepover {} mm in steps of {} mm", stepover_mm, unit);
  for (std::int64_t j = 0; j < last; j += apart) add(j);
  add(last);
  return rows;
}

std::vector<LineSegment> link_inside(const RasterFrame& frame, const RasterArea& area,
                                     std::int64_t row, std::int64_t from, std::int64_t other,
                                     std::int64_t to, double limit_mm) {
  const double unit = frame.step_mm();
  const auto steps = std::llabs(to - from) + std::llabs(other - row);
  if (static_cast<double>(steps) * unit > limit_mm) return {};
  std::vector<LineSegment> way;
  const auto go = [&](const LatticeLine& line, std::int64_t a, std::int64_t b) {
    if (a != b) way.push_back({line, a, b});
  };
  const RasterRow here = clip_row(frame, area, row), there = clip_row(frame, area, other);
  // The area is convex: with both ends inside, so is what lies between them.
  if (to >= here.first && to <= here.last) {
    go(frame.row(row), from, to);
    go(frame.column(to), row, other);
  } else if (from >= there.first && from <= there.last) {
    go(frame.column(from), row, other);
    go(frame.row(other), from, to);
  }
  return way;
}

}  // namespace maquette::cnc
