// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file contact.hpp
/// Where a body of revolution, lowered along its axis, touches a vertex, an edge or a facet:
/// closed forms for the undersides of ball, bull-nose and flat cutters and of holder parts.
///
/// Takes   coordinates relative to the axis (x, y) and absolute heights, mm
/// Gives   the highest contact so far, as the height of the body's lowest point
///
/// Method. The underside rises by p(r) at distance r <= reach from the axis; p is convex and
/// does not fall, so z - p is concave on a plane and on a line and has one peak there.
///   plane of slope g     the peak is where p' = g, straight uphill of the axis
///   line of slope m at   the peak is where p'(r) s / r = m, s along the line from its nearest
///   distance h           point to the axis, r^2 = h^2 + s^2
/// The largest value on a surface of triangles is the peak of some facet's plane that lies in the
/// facet, of some edge's line that lies on the edge, or a vertex; all others lie outside. The
/// line's peak is closed except under a bull nose's corner (a quartic, solved by Newton steps).
///
/// Accuracy. Rounding of doubles. Contact at exactly `reach` counts: the bodies are kHair
/// (relative) larger for what only asks whether something is in reach. Under a flat end the
/// height is that of the surface, bit for bit.

#include <algorithm>
#include <cmath>
#include <variant>

#include "cnc/tool.hpp"
#include "core/check.hpp"
#include "core/vec.hpp"

namespace maquette::cnc {

inline constexpr double kHair = 4e-16;

/// The best contact so far; dx, dy from the axis to where the body touches.
struct Touch {
  double tip_mm = -INFINITY;
  double dx_mm = 0.0, dy_mm = 0.0;
};

/// Where the peak on a line or a plane lies, as distance from the line's nearest point or the
/// axis, and how far the underside has risen there.
struct Peak {
  double away_mm, rise_mm;
};

struct BallShape {
  explicit BallShape(double radius_mm) : R(radius_mm), reach2(R * R * (1.0 + kHair)) {}
  double R, reach2;

  [[nodiscard]] double rise(double r2) const { return R - std::sqrt(std::max(0.0, R * R - r2)); }
  [[nodiscard]] Peak on_line(double h2, double m) const {
    const double w = std::sqrt(std::max(0.0, R * R - h2) / (1.0 + m * m));
    return {m * w, R - w};
  }
  [[nodiscard]] Peak on_plane(double g2) const {
    const double w = R / std::sqrt(1.0 + g2);
    return {std::sqrt(g2) * w, R - w};
  }
  /// Height of the tip above the plane at the axis, when the body lies on the plane.
  [[nodiscard]] double above_plane(double g2) const { return R * (std::sqrt(1.0 + g2) - 1.0); }
};

struct FlatShape {
  explicit FlatShape(double radius_mm) : R(radius_mm), reach2(R * R * (1.0 + kHair)) {}
  double R, reach2;

  [[nodiscard]] static double rise(double) { return 0.0; }
  [[nodiscard]] Peak on_line(double h2, double m) const {
    return {m > 0.0 ? std::sqrt(std::max(0.0, R * R - h2)) : 0.0, 0.0};
  }
  [[nodiscard]] Peak on_plane(double g2) const { return {g2 > 0.0 ? R : 0.0, 0.0}; }
  [[nodiscard]] double above_plane(double g2) const { return R * std::sqrt(g2); }
};

/// Flat to the radius a, then a quarter circle of radius rc.
struct BullShape {
  BullShape(double radius_mm, double corner_mm)
      : a(radius_mm - corner_mm), rc(corner_mm), R(radius_mm), reach2(R * R * (1.0 + kHair)) {}
  double a, rc, R, reach2;

  [[nodiscard]] double rise(double r2) const {
    const double t = std::sqrt(r2) - a;
    return t > 0.0 ? rc - std::sqrt(std::max(0.0, (rc - t) * (rc + t))) : 0.0;
  }
  [[nodiscard]] Peak on_line(double h2, double m) const;
  /// Whether the peak on a line that rises by m surely lies outside [from, to], measured along it
  /// from its nearest point to the axis. Saves most of the quartics.
  [[nodiscard]] bool misses(double h2, double m, double from, double to) const {
    constexpr double kMargin = 1e-6;
    return steeper(h2, m, from - kMargin) || !steeper(h2, m, to + kMargin);
  }
  /// Whether the underside climbs faster than the line at s.
  [[nodiscard]] bool steeper(double h2, double m, double s) const {
    if (s <= 0.0) return false;
    const double r = std::sqrt(h2 + s * s), t = r - a;
    return t >= rc || (t > 0.0 && t * s > m * r * std::sqrt((rc - t) * (rc + t)));
  }
  [[nodiscard]] Peak on_plane(double g2) const {
    if (g2 == 0.0) return {0.0, 0.0};
    const double w = rc / std::sqrt(1.0 + g2);
    return {a + std::sqrt(g2) * w, rc - w};
  }
  [[nodiscard]] double above_plane(double g2) const {
    return a * std::sqrt(g2) + rc * (std::sqrt(1.0 + g2) - 1.0);
  }
};

/// Disc of radius a, then a cone that has risen by `height` at R; R <= a: the disc alone.
struct ConeShape {
  ConeShape(double disc_mm, double radius_mm, double height_mm)
      : a(disc_mm),
        R(std::max(disc_mm, radius_mm)),
        height(radius_mm > disc_mm ? height_mm : 0.0),
        slope(radius_mm > disc_mm ? height_mm / (radius_mm - disc_mm) : 0.0),
        reach2(R * R * (1.0 + kHair)) {}
  double a, R, height, slope, reach2;

  [[nodiscard]] double rise(double r2) const {
    return r2 > a * a ? std::min(height, slope * (std::sqrt(r2) - a)) : 0.0;
  }
  [[nodiscard]] Peak on_line(double h2, double m) const {
    if (m <= 0.0) return {0.0, rise(h2)};
    const double first2 = std::max(0.0, a * a - h2), last2 = std::max(0.0, R * R - h2);
    const double q = m / slope;
    double s2 = q < 1.0 ? h2 * q * q / ((1.0 - q) * (1.0 + q)) : last2;
    s2 = std::clamp(s2, first2, last2);
    return {std::sqrt(s2), rise(h2 + s2)};
  }
  [[nodiscard]] Peak on_plane(double g2) const {
    if (g2 == 0.0) return {0.0, 0.0};
    return g2 < slope * slope ? Peak{a, 0.0} : Peak{R, height};
  }
  [[nodiscard]] double above_plane(double g2) const {
    const double g = std::sqrt(g2);
    return std::max(g * a, g * R - height);
  }
};

inline Peak BullShape::on_line(double h2, double m) const {
  if (m <= 0.0) return {0.0, rise(h2)};
  // The plane through the line that the corner lies on leans by v across it: v is where
  //   F(v) = a v / sqrt(m^2 + v^2) + rc v / sqrt(1 + m^2 + v^2) - h
  // is 0. F climbs ever less steeply, so Newton's steps from the left never pass the root. They
  // start where it would be under a flat end of the same radius, which is not beyond it.
  const double h = std::min(std::sqrt(h2), R), m2 = m * m;
  const double under2 = (R - h) * (R + h);
  // At the rim itself the plane is upright.
  if (!(under2 > R * R * 1e-15)) return {m > 0.0 ? std::sqrt(under2) : 0.0, rc};
  double v = h * m / std::sqrt(under2), g2 = m2 + v * v;
  for (int i = 0; i < 200; ++i) {
    const double p = 1.0 / std::sqrt(g2), q = 1.0 / std::sqrt(1.0 + g2);
    const double f = a * v * p + rc * v * q - h;
    const double next = v - f / (a * m2 * p * p * p + rc * (1.0 + m2) * q * q * q);
    if (!(next - v > 1e-15 * v)) break;
    v = next;
    g2 = m2 + v * v;
  }
  const double g = std::sqrt(g2), root = std::sqrt(1.0 + g2);
  return {(a + rc * g / root) * m / g, rc * g2 / (root * (root + 1.0))};
}

using CutterShape = std::variant<BallShape, FlatShape, BullShape>;
[[nodiscard]] inline CutterShape shape_of(const Cutter& tool) {
  if (tool.is_ball()) return BallShape(tool.radius_mm);
  if (tool.corner_radius_mm == 0.0) return FlatShape(tool.radius_mm);
  return BullShape(tool.radius_mm, tool.corner_radius_mm);
}

[[nodiscard]] inline ConeShape cone_of(const HolderPart& part) {
  return {part.bottom_radius_mm, part.top_radius_mm, part.height_mm};
}
inline void check_cutter(const Cutter& tool) {
  const double R = tool.radius_mm, rc = tool.corner_radius_mm;
  MAQUETTE_CHECK(R > 0.0, "radius {} mm", R);
  MAQUETTE_CHECK(rc >= 0.0 && rc <= R, "corner {} mm of radius {} mm", rc, R);
  for (const HolderPart& p : tool.holder)
    MAQUETTE_CHECK(p.bottom_radius_mm > 0.0 && p.top_radius_mm > 0.0 && p.height_mm >= 0.0,
                   "holder part of radii {} and {} mm, {} mm high", p.bottom_radius_mm,
                   p.top_radius_mm, p.height_mm);
}

/// Peak on a line of slope m that passes the axis at a distance of sqrt(h2), as place along the
/// line; the axis' foot stands at `along`, and only peaks within (0, length) are wanted.
template <class Shape>
inline bool find_peak(const Shape& shape, double h2, double m, double along, double length,
                      double& s, double& rise) {
  if (!(h2 <= shape.reach2)) return false;
  if constexpr (requires { shape.misses(h2, m, along, along); }) {
    if (m >= 0.0 ? shape.misses(h2, m, -along, length - along)
                 : shape.misses(h2, -m, along - length, along))
      return false;
  }
  const Peak peak = shape.on_line(h2, std::abs(m));
  s = along + (m < 0.0 ? -peak.away_mm : peak.away_mm);
  rise = peak.rise_mm;
  return s > 0.0 && s < length;
}

/// @param vx, vy  relative to the axis
template <class Shape>
inline void touch_vertex(const Shape& shape, double vx, double vy, double vz, Touch& best) {
  const double r2 = vx * vx + vy * vy;
  if (!(r2 <= shape.reach2)) return;
  const double tip = vz - shape.rise(r2);
  if (tip > best.tip_mm) best = {tip, vx, vy};
}

/// The inside of the edge from p to q; the ends are vertices.
template <class Shape>
inline void touch_edge(const Shape& shape, Vec3 p, Vec3 q, Touch& best) {
  const Vec3 e = q - p;
  const double length2 = e.x * e.x + e.y * e.y;
  if (!(length2 > 0.0)) return;  // upright: its upper end is higher
  const double aside = p.x * e.y - p.y * e.x, h2 = aside * aside / length2;
  const double length = std::sqrt(length2);
  double s, rise;
  if (!find_peak(shape, h2, e.z / length, -(p.x * e.x + p.y * e.y) / length, length, s, rise))
    return;
  const double u = s / length, tip = p.z + e.z * u - rise;
  if (tip > best.tip_mm) best = {tip, p.x + u * e.x, p.y + u * e.y};
}

/// The inside of the facet p, q, s, whichever way it faces. An upright one has none.
template <class Shape>
inline void touch_facet(const Shape& shape, Vec3 p, Vec3 q, Vec3 s, Touch& best) {
  const Vec3 e = q - p, f = s - p, n = cross(e, f);
  if (n.z == 0.0) return;
  const double gx = -n.x / n.z, gy = -n.y / n.z, g2 = gx * gx + gy * gy;
  const Peak peak = shape.on_plane(g2);
  const double away = g2 > 0.0 ? peak.away_mm / std::sqrt(g2) : 0.0;
  const double x = away * gx - p.x, y = away * gy - p.y;
  // Weights of q and s; with all of them in [0, 1] the height is one of the facet's, however
  // narrow it is.
  const double v = (x * f.y - y * f.x) / n.z, w = (e.x * y - e.y * x) / n.z;
  if (!(v >= 0.0 && w >= 0.0 && v + w <= 1.0)) return;
  const double tip = p.z + v * e.z + w * f.z - peak.rise_mm;
  if (tip > best.tip_mm) best = {tip, away * gx, away * gy};
}

template <class Shape>
inline void touch_triangle(const Shape& shape, Vec3 p, Vec3 q, Vec3 s, Touch& best) {
  touch_vertex(shape, p.x, p.y, p.z, best);
  touch_vertex(shape, q.x, q.y, q.z, best);
  touch_vertex(shape, s.x, s.y, s.z, best);
  touch_edge(shape, p, q, best);
  touch_edge(shape, q, s, best);
  touch_edge(shape, s, p, best);
  touch_facet(shape, p, q, s, best);
}

}  // namespace maquette::cnc
