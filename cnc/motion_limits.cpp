// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/motion_limits.hpp"

#include <algorithm>
#include <array>
#include <numbers>

#include "cnc/arc_geometry.hpp"

namespace maquette::cnc {
namespace {

const double kAcross = std::sqrt(0.75);  ///< share of the acceleration that turning may take
constexpr double kKinkShare = 0.1;       ///< share that a jump of the velocity may take
/// Cosine of the sharpest turn that is not a reversal: 178 degrees.
const double kReversal = std::cos(178.0 * std::numbers::pi / 180.0);

/// Largest multiple of u that stays inside the box; u is a unit vector.
double within(Vec3 box, Vec3 u) {
  constexpr double kNone = 1e-12;
  return std::min({box.x / std::fmax(std::fabs(u.x), kNone),
                   box.y / std::fmax(std::fabs(u.y), kNone),
                   box.z / std::fmax(std::fabs(u.z), kNone)});
}

/// Radius of the largest circle with unit normal n inside the box.
double circle_within(Vec3 box, Vec3 n) {
  const auto extent = [](double c) { return std::sqrt(std::fmax(1.0 - c * c, 1e-12)); };
  return std::min({box.x / extent(n.x), box.y / extent(n.y), box.z / extent(n.z)});
}

std::array<double, 3> coordinates(Vec3 v) {
  return {v.x, v.y, v.z};
}

MoveLimits line_limits(const Machine& machine, const Motion& motion) {
  const Vec3 d = motion.to_mm - motion.from_mm;
  MoveLimits m;
  m.rapid = motion.kind == Motion::Kind::rapid;
  m.length_mm = norm(d);
  m.start = m.end = (1.0 / m.length_mm) * d;
  m.axis_speed_mm_s =
      within(m.rapid ? machine.rapid_mm_min : machine.max_feed_mm_min, m.start) / 60.0;
  m.speed_mm_s =
      m.rapid ? m.axis_speed_mm_s : std::fmin(m.axis_speed_mm_s, motion.feed_mm_min / 60.0);
  m.acceleration_mm_s2 = m.along_mm_s2 = within(machine.acceleration_mm_s2, m.start);
  m.jerk_mm_s3 = within(machine.jerk_mm_s3, m.start);
  m.blend_in_mm = m.blend_out_mm = 0.5 * m.length_mm;
  return m;
}

MoveLimits arc_limits(const Machine& machine, const Motion& motion) {
  const auto [first, second, third] = axes_of(motion.plane);
  const auto a = coordinates(motion.from_mm), b = coordinates(motion.to_mm),
             c = coordinates(motion.centre_mm), feed = coordinates(machine.max_feed_mm_min),
             acceleration = coordinates(machine.acceleration_mm_s2),
             jerk = coordinates(machine.jerk_mm_s3);
  const double r0 = std::hypot(a[first] - c[first], a[second] - c[second]);
  const double r1 = std::hypot(b[first] - c[first], b[second] - c[second]);
  const double radius = std::fmin(r0, r1), sweep = std::fabs(motion.sweep_rad);
  const double flat = std::hypot(0.5 * (r0 + r1) * sweep, r1 - r0), rise = b[third] - a[third];
  MoveLimits m;
  m.curved = true;
  m.length_mm = std::hypot(flat, rise);
  const double flat_share = flat / m.length_mm, rise_share = std::fabs(rise) / m.length_mm;

  // In the plane, then along the path of a helix, whose third axis has limits of its own.
  const double a_plane = std::fmin(acceleration[first], acceleration[second]);
  const double v_plane =
      std::fmin(std::fmin(feed[first], feed[second]) / 60.0, std::sqrt(kAcross * a_plane * radius));
  m.axis_speed_mm_s = v_plane / flat_share;
  m.acceleration_mm_s2 = a_plane / flat_share;
  m.jerk_mm_s3 = std::fmin(jerk[first], jerk[second]) / flat_share;
  if (rise_share > 0.0) {
    m.axis_speed_mm_s = std::fmin(m.axis_speed_mm_s, feed[third] / 60.0 / rise_share);
    m.acceleration_mm_s2 = std::fmin(m.acceleration_mm_s2, acceleration[third] / rise_share);
    m.jerk_mm_s3 = std::fmin(m.jerk_mm_s3, jerk[third] / rise_share);
  }
  m.speed_mm_s = std::fmin(m.axis_speed_mm_s, motion.feed_mm_min / 60.0);
  // At the speed of the axes, not the feed: an override may raise the feed on the way.
  const double v_flat = m.axis_speed_mm_s * flat_share;
  const double across = v_flat * v_flat / std::fmax(radius * a_plane, 1e-12);
  m.along_mm_s2 = m.acceleration_mm_s2 * std::sqrt(std::fmax(0.25, 1.0 - across * across));

  // The radius changes evenly, so rounded centres show as small corners.
  const auto tangent = [&](const std::array<double, 3>& p, double r) {
    const double u = (p[first] - c[first]) / r, v = (p[second] - c[second]) / r;
    std::array<double, 3> t{};
    t[first] = (r1 - r0) * u - r * motion.sweep_rad * v;
    t[second] = (r1 - r0) * v + r * motion.sweep_rad * u;
    t[third] = rise;
    return normalized(Vec3{t[0], t[1], t[2]});
  };
  m.start = tangent(a, r0);
  m.end = tangent(b, r1);
  m.blend_in_mm = m.length_mm / 3.0;
  m.blend_out_mm = 2.0 * m.blend_in_mm;
  m.radius_mm = radius;
  m.sweep_rad = sweep;
  const auto inward = [&](const std::array<double, 3>& p, double r) {
    std::array<double, 3> n{};
    n[first] = (c[first] - p[first]) / r;
    n[second] = (c[second] - p[second]) / r;
    return Vec3{n[0], n[1], n[2]};
  };
  m.bend_start = inward(a, r0);
  m.bend_end = inward(b, r1);
  return m;
}

}  // namespace

MoveLimits move_limits(const Machine& machine, const Motion& motion) {
  return motion.kind == Motion::Kind::arc ? arc_limits(machine, motion)
                                          : line_limits(machine, motion);
}

Corner corner(const Machine& machine, const PathControl& control, const MoveLimits& before,
              const MoveLimits& after) {
  Corner out;
  if (before.rapid != after.rapid || control.mode == PathControl::Mode::exact_stop) return out;
  const double cosine = dot(before.end, after.start);
  if (cosine < kReversal) return out;
  const Vec3 jump = after.start - before.end;
  const double slower = std::fmin(before.speed_mm_s, after.speed_mm_s);

  // As it is.
  const double rate = slower / machine.cycle_s + after.acceleration_mm_s2;
  double share = std::fmax(std::fabs(jump.x) / machine.acceleration_mm_s2.x,
                           std::fmax(std::fabs(jump.y) / machine.acceleration_mm_s2.y,
                                     std::fabs(jump.z) / machine.acceleration_mm_s2.z)) *
                 rate;
  if (before.curved || after.curved) share *= 2.0;
  out.speed_mm_s = slower;
  out.lost_share = share;
  if (share < kKinkShare) return out;
  if (control.mode == PathControl::Mode::exact_path) return {};
  out.speed_mm_s = slower * kKinkShare / share;
  out.lost_share = kKinkShare;

  // By an arc.
  const bool point = machine.corner == "point";
  double tolerance = point ? machine.corner_tolerance_mm : control.tolerance_mm;
  const double quarter = 0.25 * std::fmin(before.length_mm, after.length_mm);
  if (tolerance == 0.0 || (!point && tolerance > quarter)) tolerance = quarter;
  // Arcs that bend as the corner does, by their secants.
  double half = std::asin(std::fmin(0.5 * norm(jump), 1.0)), room_before = before.blend_out_mm,
         room_after = after.blend_in_mm;
  const double upright = 0.5 * std::numbers::pi - half;
  double secant = 0.0;
  if (!point && before.curved && dot(after.start, before.bend_end) > 0.0) {
    const double part = std::fmin(before.sweep_rad * 2.0 / 3.0, upright);
    secant = 0.25 * part;
    room_before = before.radius_mm * std::sin(0.25 * part);
  }
  if (!point && after.curved && dot(before.end, after.bend_start) < 0.0) {
    const double part = std::fmin(after.sweep_rad / 3.0, upright);
    secant = std::fmax(secant, 0.25 * part);
    room_after = after.radius_mm * std::sin(0.25 * part);
  }
  half = std::fmin(half + secant, 0.49 * std::numbers::pi);
  const double h = std::sin(half), c = std::cos(half), turn = 2.0 * half;
  double d = tolerance * (1.0 + c) / h;
  if (!point) d = std::min({d, room_before, room_after});
  const Vec3 across = cross(before.end, after.start);
  const double sine = norm(across);
  if (!(sine > 1e-9)) return out;
  const Vec3 normal = (1.0 / sine) * across;
  const double a = circle_within(machine.acceleration_mm_s2, normal);
  const double widest = d * c / h, a_across = point ? a : kAcross * a;
  double v = std::sqrt(a_across * widest);
  v = std::fmin(v, point ? slower : std::fmax(before.speed_mm_s, after.speed_mm_s));
  if (!point) {
    // Directions between the two may be slower than both: the circle that every direction of
    // the plane allows, or for two lines the chord between what they allow.
    const Vec3 box = before.rapid ? machine.rapid_mm_min : machine.max_feed_mm_min;
    double fastest = circle_within(box, normal) / 60.0;
    if (!before.curved && !after.curved) {
      const double flat = std::cos(std::fmin(turn, 1.54));
      const double v1 = std::fmin(before.axis_speed_mm_s, after.axis_speed_mm_s / flat);
      const double v2 = std::fmin(after.axis_speed_mm_s, before.axis_speed_mm_s / flat);
      fastest = std::fmax(fastest, v1 * v2 * sine / norm(v2 * after.start - v1 * before.end));
    }
    v = std::fmin(v, fastest);
  }
  if (v <= out.speed_mm_s) return out;
  out.speed_mm_s = v;
  out.lost_share = 0.0;
  if (point) return out;
  // No wider than a parabola of half the acceleration would be: short moves are used up by
  // it, long ones only as far as the speed needs.
  const double along = v * std::fmin(std::sqrt(a * d), v) / (0.5 * a);
  out.radius_mm = std::fmax(v * v / a_across, std::fmin(along / turn, widest));
  out.trim_mm = out.radius_mm * h / c;
  out.length_mm = out.radius_mm * turn;
  const double used = v * v / (out.radius_mm * a);
  out.along_mm_s2 = a * std::sqrt(std::fmax(0.25, 1.0 - used * used));
  return out;
}

Motion motion_of(const ToolPosition& from, const PathMove& move) {
  Motion m;
  m.kind = move.kind == PathMove::Kind::rapid  ? Motion::Kind::rapid
           : move.kind == PathMove::Kind::line ? Motion::Kind::line
                                               : Motion::Kind::arc;
  m.plane = move.plane;
  m.from_mm = {mm_of_ticks(from.x), mm_of_ticks(from.y), mm_of_ticks(from.z)};
  m.to_mm = {mm_of_ticks(move.to.x), mm_of_ticks(move.to.y), mm_of_ticks(move.to.z)};
  m.feed_mm_min = move.feed_mm_min;
  if (m.kind != Motion::Kind::arc) return m;
  const auto [first, second, third] = axes_of(m.plane);
  std::array<double, 3> centre = coordinates(m.from_mm);
  const PlanePoint arm = arm_of(from, move);
  centre[first] += kTick_mm * arm.u;
  centre[second] += kTick_mm * arm.v;
  m.centre_mm = {centre[0], centre[1], centre[2]};
  const auto a = coordinates(m.from_mm - m.centre_mm), b = coordinates(m.to_mm - m.centre_mm);
  m.sweep_rad = sweep_rad({a[first], a[second]}, {b[first], b[second]}, move.counter_clockwise);
  if (m.sweep_rad == 0.0) m.sweep_rad = 2.0 * std::numbers::pi;
  if (!move.counter_clockwise) m.sweep_rad = -m.sweep_rad;
  return m;
}

}  // namespace maquette::cnc
