// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file vec.hpp
/// Points, directions and rigid transforms of the model frame: millimetres,
/// right-handed, x east, y north, z up. Plain doubles, so that a kernel may
/// memcpy them; the unit is in the name of whatever holds them.

#include <array>
#include <cmath>

namespace maquette {

struct Vec3 {
  double x = 0.0, y = 0.0, z = 0.0;
  friend constexpr bool operator==(const Vec3&, const Vec3&) = default;
  friend constexpr Vec3 operator+(Vec3 a, Vec3 b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
  friend constexpr Vec3 operator-(Vec3 a, Vec3 b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
  friend constexpr Vec3 operator-(Vec3 a) { return {-a.x, -a.y, -a.z}; }
  friend constexpr Vec3 operator*(double k, Vec3 a) { return {k * a.x, k * a.y, k * a.z}; }
  friend constexpr Vec3 operator*(Vec3 a, double k) { return k * a; }
  constexpr Vec3& operator+=(Vec3 b) { return *this = *this + b; }
};

[[nodiscard]] constexpr double dot(Vec3 a, Vec3 b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}
[[nodiscard]] constexpr Vec3 cross(Vec3 a, Vec3 b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
[[nodiscard]] inline double norm(Vec3 a) {
  return std::sqrt(dot(a, a));
}
/// @pre norm(a) > 0
[[nodiscard]] inline Vec3 normalized(Vec3 a) {
  return (1.0 / norm(a)) * a;
}

/// Rotation as a unit quaternion w + xi + yj + zk.
struct Quaternion {
  double w = 1.0, x = 0.0, y = 0.0, z = 0.0;
  friend constexpr bool operator==(const Quaternion&, const Quaternion&) = default;
  /// The rotation "first b, then a".
  friend constexpr Quaternion operator*(Quaternion a, Quaternion b) {
    return {a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z,
            a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y,
            a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x,
            a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w};
  }
  [[nodiscard]] constexpr Quaternion conjugate() const { return {w, -x, -y, -z}; }
};

[[nodiscard]] inline Quaternion normalized(Quaternion q) {
  const double k = 1.0 / std::sqrt(q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z);
  return {k * q.w, k * q.x, k * q.y, k * q.z};
}

/// @param axis  unit vector
[[nodiscard]] inline Quaternion rotation_about(Vec3 axis, double angle_rad) {
  const double s = std::sin(0.5 * angle_rad);
  return {std::cos(0.5 * angle_rad), s * axis.x, s * axis.y, s * axis.z};
}

/// @pre q is a unit quaternion
[[nodiscard]] constexpr Vec3 rotate(Quaternion q, Vec3 v) {
  const Vec3 u{q.x, q.y, q.z};
  const Vec3 t = 2.0 * cross(u, v);
  return v + q.w * t + cross(u, t);
}

/// Name variables destination first: `model_from_scan` maps scan coordinates to
/// model coordinates.
struct RigidTransform {
  Quaternion rotation;
  Vec3 translation_mm;
  friend constexpr bool operator==(const RigidTransform&, const RigidTransform&) = default;

  [[nodiscard]] constexpr Vec3 point(Vec3 p) const { return rotate(rotation, p) + translation_mm; }
  [[nodiscard]] constexpr Vec3 direction(Vec3 d) const { return rotate(rotation, d); }
  [[nodiscard]] constexpr RigidTransform inverse() const {
    const Quaternion back = rotation.conjugate();
    return {back, -rotate(back, translation_mm)};
  }
  /// a_from_c = a_from_b * b_from_c
  friend constexpr RigidTransform operator*(const RigidTransform& a, const RigidTransform& b) {
    return {a.rotation * b.rotation, a.point(b.translation_mm)};
  }
};

/// Axis-aligned box; empty until something is added.
struct Box3 {
  Vec3 min{INFINITY, INFINITY, INFINITY};
  Vec3 max{-INFINITY, -INFINITY, -INFINITY};
  void add(Vec3 p) {
    min = {std::fmin(min.x, p.x), std::fmin(min.y, p.y), std::fmin(min.z, p.z)};
    max = {std::fmax(max.x, p.x), std::fmax(max.y, p.y), std::fmax(max.z, p.z)};
  }
  [[nodiscard]] constexpr bool empty() const { return min.x > max.x; }
};

}  // namespace maquette
