// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/aimed_line.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace maquette::cnc {
namespace {

constexpr double kBeside = 14.0;        // 0.001 mm
constexpr std::int64_t kCoarsest = 32;  // the larger part of a step, 0.001 mm

}  // namespace

PlanBox box_within(const heightmap::ModelField& field) {
  const auto up = [](double mm) {
    return static_cast<std::int32_t>(std::ceil(mm * 1000.0 - 1e-4));
  };
  const auto down = [](double mm) {
    return static_cast<std::int32_t>(std::floor(mm * 1000.0 + 1e-4));
  };
  return {up(field.x0.value()), down(field.x_mm(field.z_mm.cols() - 1)), up(field.y0.value()),
          down(field.y_mm(field.z_mm.rows() - 1))};
}

AimedLine aim(PlanPlace from, PlanPlace to, const PlanBox& box) {
  const std::int64_t x = to.x - from.x, y = to.y - from.y;
  const std::int64_t whole = std::gcd(x, y);
  if (std::max(std::abs(x), std::abs(y)) <= kCoarsest * whole)
    return {{from.x * kResolution, from.y * kResolution, x / whole * kResolution,
             y / whole * kResolution},
            whole};
  const bool mostly_x = std::abs(x) >= std::abs(y);
  const std::int64_t major = mostly_x ? x : y, minor = mostly_x ? y : x;
  const double length = std::hypot(static_cast<double>(x), static_cast<double>(y));
  std::int64_t best_dx = x, best_dy = y, best_steps = 0;
  double farthest = 0.0;
  for (std::int64_t i = 1; i <= std::min(kCoarsest, std::abs(major)); ++i) {
    const std::int64_t u = major > 0 ? i : -i;
    const auto v = std::llround(static_cast<double>(minor) * static_cast<double>(u) /
                                static_cast<double>(major));
    const std::int64_t dx = mostly_x ? u : v, dy = mostly_x ? v : u;
    const double step = std::hypot(static_cast<double>(dx), static_cast<double>(dy));
    const auto off = static_cast<double>(std::abs(x * dy - y * dx));  // length step sine
    const auto towards = static_cast<double>(x * dx + y * dy);
    double far = towards / step;  // along this direction, at the height of the aim
    if (off > 0.0) far = std::min(far, kBeside * length * step / off);
    const auto steps = static_cast<std::int64_t>(far / step);
    const double gone = static_cast<double>(steps) * step;
    if (!(gone > farthest * (1.0 + 1e-9))) continue;
    const std::int64_t end_x = from.x + steps * dx, end_y = from.y + steps * dy;
    if (end_x < box.left || end_x > box.right || end_y < box.bottom || end_y > box.top) continue;
    farthest = gone;
    best_dx = dx;
    best_dy = dy;
    best_steps = steps;
  }
  if (best_steps == 0) best_steps = 1;  // all at once
  return {
      {from.x * kResolution, from.y * kResolution, best_dx * kResolution, best_dy * kResolution},
      best_steps};
}

PlanCurve writable(const PlanCurve& way, const PlanBox& box) {
  PlanCurve result{{}, way.turns};
  for (const PlanPlace to : way.places) {
    if (result.places.empty()) {
      result.places.push_back(to);
      continue;
    }
    while (std::hypot(to.x - result.places.back().x, to.y - result.places.back().y) >
           1e3 * kNear_mm)
      result.places.push_back(aim(result.places.back(), to, box).end());
  }
  return result;
}

}  // namespace maquette::cnc
