// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file swept_cutter.hpp
/// Underside of a cutter on its way, in closed form, over blocks of 8 x 8 cells. Used by
/// milling_sim only.
///
/// d: distance across the way, s: along it, rho^2 = R^2 - d^2; tip on a line of rise m per mm
/// from A, length L; k = m / sqrt(1 + m^2).
///   ball, line          t = clamp(s - k rho, 0, L):  A.z + m t + R - sqrt(rho^2 - (s - t)^2);
///                       the sum is convex in t, so the clamped t is its minimum
///   ball, vertical arc  of radius r about (c, z_c). The ball's section across is a disc of radius
///                       rho, and where it touches its envelope, envelope, disc and arc have one
///                       centre line: (t - c) / r = (t - s) / rho above the centre, and
///                       (t - c) / r = (s - t) / rho below, so t = c + r (s - c) / (r -+ rho). The
///                       derivative in t changes its sign once, upwards, if rho < r or the arc
///                       is below its centre: clamp t as above. Else (a ball larger than the
///                       hill it rolls over) the lowest is at an end.
///   any cutter, level   the profile at the distance to the nearest point of line or arc
///   flat, line          the lower end of the part of the line within R
///   bull nose, line     a convex function of t, by bracketed Newton steps, until convexity
///                       itself says that less than kSolved_mm is left
///
/// Places are taken in double relative to the point of the way nearest the block, so what
/// a block gets does not depend on tiles, threads or bands.

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "cnc/path_pieces.hpp"
#include "cnc/tool.hpp"

namespace maquette::cnc::swept {

inline constexpr int kBlock = 8;  // cells along a block's side: one AVX register of floats
/// Bull noses on slopes: the underside is never lower than computed by more than this.
inline constexpr double kSolved_mm = 1e-6;
/// Single precision only for ways less steep than this: a place in single precision times a slope
/// would show in the height.
inline constexpr double kSteepestSingle = 8.0;
inline constexpr double kSteepestSingleArc =
    1.5;  ///< radius over the ends' least height from the centre
/// What an arc in single precision may be off, in half units of the last digit of a length.
inline constexpr double kArcRoundings = 16.0;

template <class T>
inline constexpr T kNothing = std::numeric_limits<T>::max();

template <class T>
T clamped(T t, T lo, T hi) {
  t = t > lo ? t : lo;
  return t < hi ? t : hi;
}

// ---- profiles: height of the underside by squared distance from the axis -----

template <class T>
struct BallProfile {
  T centre, r2;  // height of the centre
  T operator()(T dist2) const {
    const T q = r2 - dist2;
    const T under = centre - std::sqrt(q > T{0} ? q : T{0});
    return q > T{0} ? under : kNothing<T>;
  }
};
template <class T>
struct BullProfile {
  T tip, r2, flat, corner;  // flat: radius of the level part; corner 0: all is level
  T operator()(T dist2) const {
    const T out = std::sqrt(dist2) - flat;
    const T e = out > T{0} ? out : T{0};
    const T q = corner * corner - e * e;
    const T under = tip + corner - std::sqrt(q > T{0} ? q : T{0});
    return dist2 < r2 ? under : kNothing<T>;
  }
};

// ---- ways: arguments are a cell's place relative to the functor's origin -----

template <class T>
struct BallAlongLine {
  T ux, uy, rise, k, t1, t2, base, r2;  // base: height of the centre at t = 0
  T operator()(T dx, T dy) const {
    const T s = dx * ux + dy * uy, d = dx * uy - dy * ux;
    const T rho2 = r2 - d * d;
    const T rho = std::sqrt(rho2 > T{0} ? rho2 : T{0});
    const T t = clamped(s - k * rho, t1, t2);
    const T w = s - t, q = rho2 - w * w;
    const T under = base + rise * t - std::sqrt(q > T{0} ? q : T{0});
    return q > T{0} ? under : kNothing<T>;
  }
};

/// kAlongX: the arc lies along x. kUpper: above its centre. kThin: upper and r < R. All is relative
/// to a place of the arc near the block, so that its radius costs no digits: with q and i below and
/// e(t)^2 = 1 - (i t - q)^2, the arc rises from there by +-t (2 q - i t) / (e(t) + e(0)), and the
/// ball's place is t = (s -+ q rho) / (1 -+ i rho).
template <class T, bool kAlongX, bool kUpper, bool kThin>
struct BallAlongArc {
  T q, i;                  // place of the arc's centre, along, over its radius; one over its radius
  T e0, t1, t2, base, r2;  // e(0); base: height of the ball's centre at t = 0
  T operator()(T dx, T dy) const {
    const T s = kAlongX ? dx : dy, d = kAlongX ? dy : dx;
    const T rho2 = r2 - d * d;
    const T rho = std::sqrt(rho2 > T{0} ? rho2 : T{0});
    const T place = kUpper ? (s - q * rho) / (T{1} - i * rho) : (s + q * rho) / (T{1} + i * rho);
    T under = at(clamped(place, t1, t2), s, rho2);
    if constexpr (kThin) {
      const T first = at(t1, s, rho2), second = at(t2, s, rho2);
      under = under < first ? under : first;
      under = under < second ? under : second;
    }
    return under;
  }
  T at(T t, T s, T rho2) const {
    const T it = i * t, u = it - q, e2 = T{1} - u * u;
    // Not 0 / 0 where the arc is vertical.
    const T e = std::sqrt(e2 > std::numeric_limits<T>::min() ? e2 : std::numeric_limits<T>::min());
    const T up = t * (T{2} * q - it) / (e + e0);
    const T w = s - t, h2 = rho2 - w * w;
    const T under = base + (kUpper ? up : -up) - std::sqrt(h2 > T{0} ? h2 : T{0});
    return h2 > T{0} ? under : kNothing<T>;
  }
};

template <class T, class Profile>
struct AlongLevelLine {
  T ux, uy, t1, t2;
  Profile profile;
  T operator()(T dx, T dy) const {
    const T s = dx * ux + dy * uy, d = dx * uy - dy * ux;
    const T w = s - clamped(s, t1, t2);
    return profile(w * w + d * d);
  }
};

/// Relative to the centre; counter-clockwise from (ax, ay) to (bx, by), less than half a turn.
template <class Profile>
struct AlongLevelArc {
  double ax, ay, bx, by, r;
  Profile profile;
  double operator()(double px, double py) const {
    const double off = std::sqrt(px * px + py * py) - r;
    const double to_a = (px - ax) * (px - ax) + (py - ay) * (py - ay);
    const double to_b = (px - bx) * (px - bx) + (py - by) * (py - by);
    const double to_end = to_a < to_b ? to_a : to_b;
    const bool beside = (ax * py - ay * px >= 0.0) & (px * by - py * bx >= 0.0);
    return profile(beside ? off * off : to_end);
  }
};

template <class T>
struct FlatAlongLine {
  T ux, uy, rise, t1, t2, base, r2;
  T operator()(T dx, T dy) const {
    const T s = dx * ux + dy * uy, d = dx * uy - dy * ux;
    const T rho2 = r2 - d * d;
    const T rho = std::sqrt(rho2 > T{0} ? rho2 : T{0});
    const T lo = s - rho > t1 ? s - rho : t1, hi = s + rho < t2 ? s + rho : t2;
    const T under = base + rise * (rise > T{0} ? lo : hi);
    return (rho2 > T{0}) & (lo <= hi) ? under : kNothing<T>;
  }
};

struct BullAlongLine {
  double ux, uy, rise, t1, t2, base, radius, corner;
  double operator()(double dx, double dy) const {
    const double s = dx * ux + dy * uy, d = dx * uy - dy * ux;
    const double rho2 = radius * radius - d * d;
    if (!(rho2 > 0.0)) return kNothing<double>;
    const double rho = std::sqrt(rho2), flat = radius - corner;
    double lo = std::max(t1, s - rho), hi = std::min(t2, s + rho);
    if (!(lo <= hi)) return kNothing<double>;
    const auto height = [&](double t) {
      const double e = std::max(0.0, std::sqrt((s - t) * (s - t) + d * d) - flat);
      return base + rise * t + corner - std::sqrt(std::max(0.0, corner * corner - e * e));
    };
    // Derivative of the height, and of that, in t.
    const auto slope = [&](double t, double& second) {
      const double w = t - s, n = std::sqrt(w * w + d * d), e = n - flat;
      second = 0.0;
      if (!(e > 0.0)) return rise;
      const double root = std::sqrt(std::max(corner * corner - e * e, 1e-18));
      const double steep = e / root;
      second =
          corner * corner / (root * root * root) * w * w / (n * n) + steep * d * d / (n * n * n);
      return rise + steep * w / n;
    };
    // At the lower end, if it is no longer uphill from there.
    double second = 0.0;
    const double low = rise > 0.0 ? lo : hi;
    if (slope(low, second) * rise >= 0.0) return height(low);
    // Where the corner's circle is as steep as the way, were the axis as far as there.
    const double k = rise / std::sqrt(1.0 + rise * rise), n = flat + std::abs(k) * corner;
    const double w = std::sqrt(std::max(n * n - d * d, 0.0));
    double t = clamped(rise > 0.0 ? s - w : s + w, lo, hi);
    for (int i = 0; i < 80; ++i) {
      const double g = slope(t, second);
      (g > 0.0 ? hi : lo) = t;
      if (g == 0.0 || std::abs(g) * (hi - lo) <= kSolved_mm) break;
      // Every third step halves: next to the rim Newton's steps are as good as none.
      const double newton = second > 0.0 && i % 3 != 2 ? t - g / second : INFINITY;
      t = newton > lo && newton < hi ? newton : 0.5 * (lo + hi);
    }
    return std::min(height(t), std::min(height(lo), height(hi)));
  }
};

// ---- one block ---------------------------------------------------------------

struct BlockCut {
  float highest = 0.0F;  // of the block's cells now
  double deepest = 0.0;  // by how much one cell fell at most
  double removed = 0.0;  // sum of what all cells fell by
};

/// Lowers cells to `under`; the first cell is at (x, y) relative to its origin.
template <class T, class Under>
BlockCut cut_block(float* z, std::ptrdiff_t stride, T x, T y, T cell, const Under& under) {
  std::array<T, kBlock> highest, deepest, removed;
  highest.fill(-kNothing<T>);
  deepest.fill(T{0});
  removed.fill(T{0});
  for (int r = 0; r < kBlock; ++r) {
    const T dy = y + static_cast<T>(r) * cell;
    float* row = z + r * stride;
    for (int c = 0; c < kBlock; ++c) {
      const auto i = static_cast<std::size_t>(c);
      const T low = under(x + static_cast<T>(c) * cell, dy);
      const T old = static_cast<T>(row[c]);
      const T now = low < old ? low : old;
      const T fell = old - now;
      row[c] = static_cast<float>(now);
      highest[i] = highest[i] > now ? highest[i] : now;
      deepest[i] = deepest[i] > fell ? deepest[i] : fell;
      removed[i] += fell;
    }
  }
  BlockCut cut{static_cast<float>(highest[0]), static_cast<double>(deepest[0]),
               static_cast<double>(removed[0])};
  for (std::size_t i = 1; i < kBlock; ++i) {
    cut.highest = std::max(cut.highest, static_cast<float>(highest[i]));
    cut.deepest = std::max(cut.deepest, static_cast<double>(deepest[i]));
    cut.removed += static_cast<double>(removed[i]);
  }
  return cut;
}

/// True if a cell of the block stands above `under` by more than `tolerance`.
template <class Under>
bool touches_block(const float* z, std::ptrdiff_t stride, double x, double y, double cell,
                   const Under& under, double tolerance) {
  bool touched = false;
  for (int r = 0; r < kBlock; ++r)
    for (int c = 0; c < kBlock; ++c)
      touched |= static_cast<double>(z[r * stride + c]) - tolerance >
                 under(x + static_cast<double>(c) * cell, y + static_cast<double>(r) * cell);
  return touched;
}

// ---- a way and its cutter ------------------------------------------------------

/// What of a way is the same for all blocks. Keeps a reference to its cutter.
struct Way {
  Way(const PathPiece& p, const Cutter& tool);

  /// Cuts the block of `z` whose first cell is at (x, y).
  BlockCut cut(float* z, std::ptrdiff_t stride, double x, double y, double cell) const;

  PathPiece piece;
  const Cutter& cutter;
  double length = 0.0;        // horizontal, of the chord
  double ux = 1.0, uy = 0.0;  // its direction
  double rise = 0.0;          // mm per horizontal mm
  Vec3 start;                 // of the chord, lower end of a vertical one
  double sag = 0.0;           // how far the way may lie below or beside the chord
  bool single = true;         // precision
};

}  // namespace maquette::cnc::swept
