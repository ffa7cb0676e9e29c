// SPDX-License-Identifier: GPL-3.0-or-later

// Length and chords of a motion.

#include <array>
#include <cmath>

#include "cnc/arc_geometry.hpp"
#include "cnc/gcode_reader.hpp"

namespace maquette::cnc {
namespace {

[[nodiscard]] std::array<double, 3> coordinates(Vec3 v) {
  return {v.x, v.y, v.z};
}

}  // namespace

double length_mm(const Motion& motion) {
  const Vec3 d = motion.to_mm - motion.from_mm;
  if (motion.kind != Motion::Kind::arc) return norm(d);
  const std::size_t third = axes_of(motion.plane).third;
  auto radius = [&](Vec3 p) {
    auto arm = coordinates(p - motion.centre_mm);
    arm[third] = 0.0;
    return norm(Vec3{arm[0], arm[1], arm[2]});
  };
  const double mean = 0.5 * (radius(motion.from_mm) + radius(motion.to_mm));
  return std::hypot(mean * motion.sweep_rad, coordinates(d)[third]);
}

void for_each_chord(const Motion& motion, double deviation_mm,
                    const std::function<void(Vec3, Vec3)>& chord) {
  if (motion.kind != Motion::Kind::arc) {
    chord(motion.from_mm, motion.to_mm);
    return;
  }
  const auto [first, second, third] = axes_of(motion.plane);
  const auto a = coordinates(motion.from_mm), b = coordinates(motion.to_mm),
             c = coordinates(motion.centre_mm);
  const double r0 = std::hypot(a[first] - c[first], a[second] - c[second]);
  const double r1 = std::hypot(b[first] - c[first], b[second] - c[second]);
  const double begin = std::atan2(a[second] - c[second], a[first] - c[first]);
  // P(phi) = r(phi) (cos, sin) with r linear: |P''| <= r + 2 |r'|; the third axis is linear.
  const double sweep = std::abs(motion.sweep_rad);
  const double curvature = std::fmax(r0, r1) + 2.0 * std::abs(r1 - r0) / sweep;
  const double pieces =
      std::fmax(1.0, std::ceil(sweep * std::sqrt(curvature / (8.0 * deviation_mm))));
  const auto n = static_cast<std::uint64_t>(pieces);
  Vec3 from = motion.from_mm;
  for (std::uint64_t i = 1; i <= n; ++i) {
    Vec3 to = motion.to_mm;
    if (i < n) {
      const double t = static_cast<double>(i) / pieces;
      const double phi = begin + t * motion.sweep_rad;
      const double r = r0 + t * (r1 - r0);
      std::array<double, 3> p{};
      p[first] = c[first] + r * std::cos(phi);
      p[second] = c[second] + r * std::sin(phi);
      p[third] = a[third] + t * (b[third] - a[third]);
      to = {p[0], p[1], p[2]};
    }
    chord(from, to);
    from = to;
  }
}

}  // namespace maquette::cnc
