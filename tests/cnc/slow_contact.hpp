// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file slow_contact.hpp
/// What one triangle asks of a cutter's tip, by other means than the library's: facets and a
/// ball's edges by vectors in space, other edges by halving. Shares no code with it.

#include <algorithm>
#include <cmath>
#include <utility>

#include "cnc/tool.hpp"
#include "core/vec.hpp"

namespace maquette::cnc {

/// Tip of the cutter on one feature; -inf if out of reach. a: radius of the flat end.
struct Slow {
  double R, rc, a = R - rc;
  explicit Slow(const Cutter& c) : R(c.radius_mm), rc(c.corner_radius_mm) {}

  [[nodiscard]] double rise(double r) const {  // of the underside
    return r <= a ? 0.0 : rc - std::sqrt((rc - (r - a)) * (rc + (r - a)));
  }
  [[nodiscard]] double on_vertex(Vec3 v, double x, double y) const {
    const double r = std::hypot(v.x - x, v.y - y);
    return r <= R ? v.z - rise(r) : -INFINITY;
  }
  [[nodiscard]] double on_edge(Vec3 p, Vec3 q, double x, double y) const {
    if (a == 0.0) return on_edge_of_ball(p, q, x, y);
    // Halving the derivative's sign change of z - rise along the part within reach.
    using Real = long double;
    const Real ex = q.x - p.x, ey = q.y - p.y, length = std::hypot(ex, ey);
    if (length == 0) return -INFINITY;  // its upper end is higher
    const Real foot = ((x - p.x) * ex + (y - p.y) * ey) / length;
    const Real h = std::abs((x - p.x) * ey - (y - p.y) * ex) / length;
    if (h > R) return -INFINITY;
    const Real m = (q.z - p.z) / length, half = std::sqrt((R - h) * (R + h));
    Real low = std::max(Real{0}, foot - half), high = std::min(length, foot + half);
    if (low > high) return -INFINITY;
    const auto climbs = [&](Real s) {
      const Real r = std::hypot(s - foot, h), t = r - a;
      if (t <= 0) return m > 0;
      if (t >= rc) return s < foot;
      return m > t / std::sqrt((rc - t) * (rc + t)) * (s - foot) / r;
    };
    if (rc == 0.0) return static_cast<double>(p.z + std::max(m * low, m * high));
    for (int i = 0; i < 64; ++i) (climbs(0.5L * (low + high)) ? low : high) = 0.5L * (low + high);
    const Real s = 0.5L * (low + high);
    const Real t = std::hypot(s - foot, h) - a;
    const Real up = t <= 0 ? Real{0} : t >= rc ? Real{rc} : rc - std::sqrt((rc - t) * (rc + t));
    return static_cast<double>(p.z + m * s - up);
  }
  [[nodiscard]] double on_edge_of_ball(Vec3 p, Vec3 q, double x, double y) const {
    // The ball touches the line where a cylinder around it meets the vertical axis.
    const Vec3 e = normalized(q - p);
    const Vec3 o{x, y, 0.0}, up{0.0, 0.0, 1.0};
    const Vec3 f = cross(e, up), g = cross(e, o - p);  // |g + t f| = R
    const double A = dot(f, f), B = dot(f, g), C = dot(g, g) - R * R;
    const double disc = B * B - A * C;
    if (A == 0.0 || disc < 0.0) return -INFINITY;
    const double t = (-B + std::sqrt(disc)) / A;
    const double s = dot(Vec3{x, y, t} - p, e);
    return s >= 0.0 && s <= norm(q - p) ? t - R : -INFINITY;
  }
  [[nodiscard]] double on_facet(Vec3 p, Vec3 q, Vec3 s, double x, double y) const {
    Vec3 n = normalized(cross(q - p, s - p));
    if (n.z < 0.0) n = -n;
    // Centre of the corner's circle on the uphill side; the contact is rc along -n from it.
    const double slope = std::hypot(n.x, n.y);
    const Vec3 side = slope > 0.0 ? Vec3{-n.x / slope * a, -n.y / slope * a, 0.0} : Vec3{};
    const double cx = x + side.x, cy = y + side.y;
    const double t = p.z + (rc - n.x * (cx - p.x) - n.y * (cy - p.y)) / n.z;
    const Vec3 c = Vec3{cx, cy, t} - rc * n;
    const auto left = [&](Vec3 u, Vec3 v) {
      return (v.x - u.x) * (c.y - u.y) - (v.y - u.y) * (c.x - u.x);
    };
    const double s1 = left(p, q), s2 = left(q, s), s3 = left(s, p);
    const bool inside = (s1 >= 0 && s2 >= 0 && s3 >= 0) || (s1 <= 0 && s2 <= 0 && s3 <= 0);
    return inside ? t - rc : -INFINITY;
  }
  double operator()(Vec3 p, Vec3 q, Vec3 s, double x, double y) const {
    return std::max({on_vertex(p, x, y), on_vertex(q, x, y), on_vertex(s, x, y),
                     on_edge(p, q, x, y), on_edge(q, s, x, y), on_edge(s, p, x, y),
                     on_facet(p, q, s, x, y)});
  }
};

/// The same by search alone: height above the underside is concave on the triangle.
inline double tip_by_search(const Slow& tool, Vec3 a, Vec3 b, Vec3 c, double x, double y) {
  const auto value = [&](double u, double v) {
    const Vec3 q = a + u * (b - a) + (u * v) * (c - b);
    const double r = std::hypot(q.x - x, q.y - y);
    // Out of reach: a steep cone that leads the search back.
    return r <= tool.R ? q.z - tool.rise(r) : -1e6 * r;
  };
  const auto search = [](auto&& f) {
    constexpr double kGolden = 0.61803398874989485;
    double low = 0.0, high = 1.0;
    for (int i = 0; i < 75; ++i) {
      const double p = high - kGolden * (high - low), q = low + kGolden * (high - low);
      (f(p) < f(q) ? low : high) = f(p) < f(q) ? p : q;
    }
    return std::max({f(0.0), f(1.0), f(0.5 * (low + high))});
  };
  const double best =
      search([&](double u) { return search([&](double v) { return value(u, v); }); });
  return best < -1e3 ? -INFINITY : best;
}

/// Tip at which one part touches one triangle: along each edge by halving, on the facet uphill at
/// the radii where the underside bends.
inline double slow_part(const HolderPart& part, Vec3 p, Vec3 q, Vec3 s, double x, double y) {
  const double a = part.bottom_radius_mm, R = std::max(a, part.top_radius_mm);
  const double slope = R > a ? part.height_mm / (R - a) : 0.0;
  const auto rise = [&](double r) { return r > a ? (r - a) * slope : 0.0; };
  double best = -INFINITY;
  for (const auto& [u, v] : {std::pair{p, q}, {q, s}, {s, p}}) {
    const double ex = v.x - u.x, ey = v.y - u.y, length = std::hypot(ex, ey);
    if (length == 0.0) continue;  // a vertex is higher, and others meet there
    const double foot = ((x - u.x) * ex + (y - u.y) * ey) / length;
    const double h = std::abs((x - u.x) * ey - (y - u.y) * ex) / length;
    if (h > R) continue;
    const double half = std::sqrt((R - h) * (R + h)), m = (v.z - u.z) / length;
    double low = std::max(0.0, foot - half), high = std::min(length, foot + half);
    if (low > high) continue;
    for (int i = 0; i < 64; ++i) {
      const double t = 0.5 * (low + high), r = std::hypot(t - foot, h);
      (m > (r > a ? slope * (t - foot) / r : 0.0) ? low : high) = t;
    }
    for (const double t : {low, high})
      best = std::max(best, u.z + m * t - rise(std::hypot(t - foot, h)));
  }
  const Vec3 n = cross(q - p, s - p);
  const double g = std::hypot(n.x, n.y) / std::abs(n.z);
  for (const double r : {0.0, a, R}) {
    const double sign = n.z < 0.0 ? 1.0 : -1.0, size = std::hypot(n.x, n.y);
    if (size == 0.0 && r > 0.0) continue;
    const Vec3 c{x + (r > 0.0 ? sign * n.x / size * r : 0.0),
                 y + (r > 0.0 ? sign * n.y / size * r : 0.0), 0.0};
    const auto left = [&](Vec3 u, Vec3 v) {
      return (v.x - u.x) * (c.y - u.y) - (v.y - u.y) * (c.x - u.x);
    };
    const double s1 = left(p, q), s2 = left(q, s), s3 = left(s, p);
    if (!((s1 >= 0 && s2 >= 0 && s3 >= 0) || (s1 <= 0 && s2 <= 0 && s3 <= 0))) continue;
    const double under = p.z - (n.x * (x - p.x) + n.y * (y - p.y)) / n.z;
    best = std::max(best, under + g * r - rise(r));
  }
  return best - part.bottom_mm;
}

}  // namespace maquette::cnc
