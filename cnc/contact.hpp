// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file contact.hpp
/// Where a body of revolution, lowered along its axis, touches a vertex, an edge or a facet:
/// closed forms for the undersides of ball, bull-nose and flat cutters and of holder parts.
///
/// Takes   coordinates relative to the axis (x, y) and absolute heights, mm
/// Gives   the highest contact so far. Heights are of a reference point of the body: the centre
///         of the corner's circle, which stands `corner` above the tip.
///
/// Method. The underside rises by p(r) at distance r <= reach from the axis; p is convex and
/// does not fall, so z - p is concave on a plane and on a line and has one peak there.
///   plane of slope g     the peak is where p' = g, straight uphill of the axis
///   line of slope m at   the peak is where p'(r) s / r = m, s along the line from its nearest
///   distance h           point to the axis, r^2 = h^2 + s^2
/// On a triangle whose plane's peak lies outside, the largest value lies on an edge that
/// separates the two: a straight walk from anywhere in the triangle to the peak climbs, and
/// leaves through such an edge. On an edge whose line's peak lies outside, it lies on a vertex.
/// The line's peak is closed except under a bull nose's corner (a quartic; solved by Newton
/// steps in the half angle's tangent, kept inside a bracket).
///
/// Accuracy. Rounding of doubles. Contact at exactly `reach` counts: the bodies are kHair
/// (relative) larger for what only asks whether something is in reach.

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace maquette::cnc {

inline constexpr double kHair = 4e-16;

/// The best contact so far; dx, dy from the axis to where the body touches.
struct Touch {
  double z_mm = -INFINITY;  ///< of the body's reference point
  double dx_mm = 0.0, dy_mm = 0.0;
};

/// Where the peak on a line or a plane lies, as distance from the line's nearest point or the
/// axis, and the height of the reference point above it.
struct Peak {
  double away_mm, lift_mm;
};

struct BallShape {
  explicit BallShape(double radius_mm) : R(radius_mm), reach2(R * R * (1.0 + kHair)) {}
  double R, reach2;

  [[nodiscard]] double lift(double r2) const { return std::sqrt(std::max(0.0, R * R - r2)); }
  [[nodiscard]] Peak on_line(double h2, double m) const {
    const double w = std::sqrt(std::max(0.0, R * R - h2) / (1.0 + m * m));
    return {m * w, w};
  }
  [[nodiscard]] Peak on_plane(double g2) const {
    const double w = R / std::sqrt(1.0 + g2);
    return {std::sqrt(g2) * w, w};
  }
  /// How far the reference point over the axis stands above the plane at the axis.
  [[nodiscard]] double above_plane(double g2) const { return R * std::sqrt(1.0 + g2); }
};

struct FlatShape {
  explicit FlatShape(double radius_mm) : R(radius_mm), reach2(R * R * (1.0 + kHair)) {}
  double R, reach2;

  [[nodiscard]] static double lift(double) { return 0.0; }
  [[nodiscard]] Peak on_line(double h2, double m) const {
    return {m > 0.0 ? std::sqrt(std::max(0.0, R * R - h2)) : 0.0, 0.0};
  }
  [[nodiscard]] Peak on_plane(double g2) const { return {g2 > 0.0 ? R : 0.0, 0.0}; }
  [[nodiscard]] double above_plane(double g2) const { return R * std::sqrt(g2); }
};

struct BullShape {
  BullShape(double radius_mm, double corner_mm)
      : a(radius_mm - corner_mm),
        rc(corner_mm),
        R(radius_mm),
        reach2(R * R * (1.0 + kHair)) {}
  double a, rc, R, reach2;

  [[nodiscard]] double lift(double r2) const {
    const double t = std::max(0.0, std::sqrt(r2) - a);
    return std::sqrt(std::max(0.0, (rc - t) * (rc + t)));
  }
  [[nodiscard]] Peak on_line(double h2, double m) const;
  [[nodiscard]] Peak on_plane(double g2) const {
    if (g2 == 0.0) return {0.0, rc};
    const double w = rc / std::sqrt(1.0 + g2);
    return {a + std::sqrt(g2) * w, w};
  }
  [[nodiscard]] double above_plane(double g2) const {
    return a * std::sqrt(g2) + rc * std::sqrt(1.0 + g2);
  }
};

/// Disc of radius a, then a cone that has risen by `height` at R; R <= a: the disc alone. The
/// reference point is the disc's centre.
struct ConeShape {
  ConeShape(double disc_mm, double radius_mm, double height_mm)
      : a(disc_mm),
        R(std::max(disc_mm, radius_mm)),
        height(radius_mm > disc_mm ? height_mm : 0.0),
        slope(radius_mm > disc_mm ? height_mm / (radius_mm - disc_mm) : 0.0),
        reach2(R * R * (1.0 + kHair)) {}
  double a, R, height, slope, reach2;

  [[nodiscard]] double lift(double r2) const {
    return r2 > a * a ? -std::min(height, slope * (std::sqrt(r2) - a)) : 0.0;
  }
  [[nodiscard]] Peak on_line(double h2, double m) const {
    if (m <= 0.0) return {0.0, lift(h2)};
    const double first2 = std::max(0.0, a * a - h2), last2 = std::max(0.0, R * R - h2);
    const double q = m / slope;
    double s2 = q < 1.0 ? h2 * q * q / ((1.0 - q) * (1.0 + q)) : last2;
    s2 = std::clamp(s2, first2, last2);
    return {std::sqrt(s2), lift(h2 + s2)};
  }
  [[nodiscard]] Peak on_plane(double g2) const {
    if (g2 == 0.0) return {0.0, 0.0};
    return g2 < slope * slope ? Peak{a, 0.0} : Peak{R, -height};
  }
  [[nodiscard]] double above_plane(double g2) const {
    const double g = std::sqrt(g2);
    return std::max(g * a, g * R - height);
  }
};

inline Peak BullShape::on_line(double h2, double m) const {
  if (m <= 0.0) return {0.0, lift(h2)};
  // t = tan(phi / 2), phi from straight down to the contact on the corner's circle:
  // F(t) = sin(phi) s - m r cos(phi), s = sqrt(r^2 - h^2), r = a + rc sin(phi), climbs through 0.
  const double h = std::sqrt(h2);
  double low = 0.0, high = 1.0;
  if (h > a) {
    const double sine = std::min(1.0, (h - a) / rc);
    low = sine / (1.0 + std::sqrt((1.0 - sine) * (1.0 + sine)));
  }
  // A line at the axis' distance h meets the ball of radius rc + a at first guess.
  const double w = std::sqrt(std::max(0.0, R * R - h2) / (1.0 + m * m));
  const double phi_tan = w > 0.0 ? std::sqrt(h2 + m * m * w * w) / w : INFINITY;
  double t = std::isinf(phi_tan) ? 1.0 : phi_tan / (1.0 + std::sqrt(1.0 + phi_tan * phi_tan));
  if (!(t > low && t < high)) t = 0.5 * (low + high);
  double s = 0.0, cosine = 1.0;
  for (int i = 0; i < 100; ++i) {
    const double k = 1.0 / (1.0 + t * t), sine = 2.0 * t * k;
    cosine = (1.0 - t) * (1.0 + t) * k;
    const double r = a + rc * sine;
    s = std::sqrt(std::max(0.0, (r - h) * (r + h)));
    const double f = sine * s - m * r * cosine;
    (f < 0.0 ? low : high) = t;
    const double slope =  // dF / dphi
        s > 0.0
            ? cosine * s + sine * r * rc * cosine / s + m * r * sine - m * rc * cosine * cosine
            : INFINITY;
    // dphi / dt = 2 / (1 + t^2)
    double next = t - f / slope * (0.5 * (1.0 + t * t));
    if (!(next > low && next < high)) next = 0.5 * (low + high);
    if (std::abs(next - t) <= 2e-16 || f == 0.0) break;
    t = next;
  }
  return {s, rc * cosine};
}

/// @param vx, vy  relative to the axis
template <class Shape>
inline void touch_vertex(const Shape& shape, double vx, double vy, double vz, Touch& best) {
  const double r2 = vx * vx + vy * vy;
  if (!(r2 <= shape.reach2)) return;
  const double z = vz + shape.lift(r2);
  if (z > best.z_mm) best = {z, vx, vy};
}

/// The inside of the edge from a to b (relative to the axis); its ends are vertices.
template <class Shape>
inline void touch_edge(const Shape& shape, double ax, double ay, double az, double bx, double by,
                       double bz, Touch& best) {
  const double ex = bx - ax, ey = by - ay, rise = bz - az;
  const double length2 = ex * ex + ey * ey;
  if (!(length2 > 0.0)) return;  // upright: a vertex is higher
  const double length = std::sqrt(length2);
  const double cross = ax * ey - ay * ex, h2 = cross * cross / length2;
  if (!(h2 <= shape.reach2)) return;
  const double m = rise / length;
  const Peak peak = shape.on_line(h2, std::abs(m));
  const double s = -(ax * ex + ay * ey) / length + (m < 0.0 ? -peak.away_mm : peak.away_mm);
  if (!(s > 0.0 && s < length)) return;
  const double u = s / length, z = az + rise * u + peak.lift_mm;
  if (z > best.z_mm) best = {z, ax + u * ex, ay + u * ey};
}

}  // namespace maquette::cnc
