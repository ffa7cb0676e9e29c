// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/swept_cutter.hpp"

#include <algorithm>

namespace maquette::cnc::swept {
namespace {

/// Where the way is nearest to a block, and the block seen from there.
struct Near {
  double t;       // along the chord
  double x, y;    // of the block's first cell, relative
  double t1, t2;  // the part of the way that can matter, relative to t
  double tip;     // height of the chord at t
};

Near near_line(const Way& w, double x, double y, double cell) {
  const double half = 0.5 * (kBlock - 1) * cell;
  const double cx = x + half - w.start.x, cy = y + half - w.start.y;
  const double t = clamped(cx * w.ux + cy * w.uy, 0.0, w.length);
  const double reach = w.cutter.radius_mm + 1.5 * kBlock * cell;
  return {t,
          x - (w.start.x + t * w.ux),
          y - (w.start.y + t * w.uy),
          std::max(-t, -reach),
          std::min(w.length - t, reach),
          w.start.z + t * w.rise};
}

template <class T>
BlockCut ball_line(const Way& w, const Near& n, float* z, std::ptrdiff_t stride, double cell) {
  const double R = w.cutter.radius_mm;
  const BallAlongLine<T> under{
      static_cast<T>(w.ux),      static_cast<T>(w.uy),
      static_cast<T>(w.rise),    static_cast<T>(w.rise / std::sqrt(1.0 + w.rise * w.rise)),
      static_cast<T>(n.t1),      static_cast<T>(n.t2),
      static_cast<T>(n.tip + R), static_cast<T>(R * R)};
  return cut_block<T>(z, stride, static_cast<T>(n.x), static_cast<T>(n.y), static_cast<T>(cell),
                      under);
}

template <class T, bool kAlongX, bool kUpper, bool kThin>
BlockCut ball_arc(const Way& w, float* z, std::ptrdiff_t stride, double x, double y, double cell) {
  const PathPiece& p = w.piece;
  const double R = w.cutter.radius_mm, half = 0.5 * (kBlock - 1) * cell;
  const double a = kAlongX ? p.from_mm.x : p.from_mm.y, b = kAlongX ? p.to_mm.x : p.to_mm.y;
  const double lo = std::min(a, b), hi = std::max(a, b);
  const double origin = clamped((kAlongX ? x : y) + half, lo, hi);
  const double q = ((kAlongX ? p.centre_mm.x : p.centre_mm.y) - origin) / p.radius_mm;
  const double e0 = std::sqrt(std::max(0.0, 1.0 - q * q));
  const BallAlongArc<T, kAlongX, kUpper, kThin> under{
      static_cast<T>(q),
      static_cast<T>(1.0 / p.radius_mm),
      static_cast<T>(e0),
      static_cast<T>(lo - origin),
      static_cast<T>(hi - origin),
      static_cast<T>(p.centre_mm.z + (kUpper ? e0 : -e0) * p.radius_mm + R),
      static_cast<T>(R * R)};
  return cut_block<T>(z, stride, static_cast<T>(x - (kAlongX ? origin : p.from_mm.x)),
                      static_cast<T>(y - (kAlongX ? p.from_mm.y : origin)), static_cast<T>(cell),
                      under);
}

template <class T, bool kAlongX>
BlockCut ball_arc(const Way& w, float* z, std::ptrdiff_t stride, double x, double y, double cell) {
  if (!w.piece.upper) return ball_arc<T, kAlongX, false, false>(w, z, stride, x, y, cell);
  return w.piece.radius_mm < w.cutter.radius_mm
             ? ball_arc<T, kAlongX, true, true>(w, z, stride, x, y, cell)
             : ball_arc<T, kAlongX, true, false>(w, z, stride, x, y, cell);
}

template <class Profile>
BlockCut level_arc(const Way& w, const Profile& profile, float* z, std::ptrdiff_t stride, double x,
                   double y, double cell) {
  const PathPiece& p = w.piece;
  double ax = p.from_mm.x - p.centre_mm.x, ay = p.from_mm.y - p.centre_mm.y;
  double bx = p.to_mm.x - p.centre_mm.x, by = p.to_mm.y - p.centre_mm.y;
  if (ax * by - ay * bx < 0.0) {
    std::swap(ax, bx);
    std::swap(ay, by);
  }
  const AlongLevelArc<Profile> under{ax, ay, bx, by, p.radius_mm, profile};
  return cut_block<double>(z, stride, x - p.centre_mm.x, y - p.centre_mm.y, cell, under);
}

}  // namespace

Way::Way(const PathPiece& p, const Cutter& tool) : piece(p), cutter(tool), start(p.from_mm) {
  const double dx = p.to_mm.x - p.from_mm.x, dy = p.to_mm.y - p.from_mm.y,
               dz = p.to_mm.z - p.from_mm.z;
  length = std::sqrt(dx * dx + dy * dy);
  // A vertical move leaves what its lower end leaves; shorter than a nanometre is vertical.
  if (length < 1e-6) {
    if (dz < 0.0) start = p.to_mm;
    length = 0.0;
    piece.kind = PathPiece::Kind::line;
  } else {
    ux = dx / length;
    uy = dy / length;
    rise = dz / length;
  }
  single = std::abs(rise) <= kSteepestSingle;
  if (piece.kind == PathPiece::Kind::line) return;
  const double half = 0.5 * norm(p.to_mm - p.from_mm), r = p.radius_mm;
  sag = r - std::sqrt(std::max(0.0, r * r - half * half));
  if (piece.kind == PathPiece::Kind::vertical_arc) {
    if (piece.upper) sag = 0.0;  // the path is above its chord
    const double least =
        std::min(std::abs(p.from_mm.z - p.centre_mm.z), std::abs(p.to_mm.z - p.centre_mm.z));
    single = kSteepestSingleArc * least >= r;
  }
}

BlockCut Way::cut(float* z, std::ptrdiff_t stride, double x, double y, double cell) const {
  const double R = cutter.radius_mm, corner = cutter.corner_radius_mm;
  if (cutter.is_ball()) {
    switch (piece.kind) {
      case PathPiece::Kind::line: {
        const Near n = near_line(*this, x, y, cell);
        return single ? ball_line<float>(*this, n, z, stride, cell)
                      : ball_line<double>(*this, n, z, stride, cell);
      }
      case PathPiece::Kind::vertical_arc:
        if (piece.from_mm.y == piece.to_mm.y)
          return single ? ball_arc<float, true>(*this, z, stride, x, y, cell)
                        : ball_arc<double, true>(*this, z, stride, x, y, cell);
        return single ? ball_arc<float, false>(*this, z, stride, x, y, cell)
                      : ball_arc<double, false>(*this, z, stride, x, y, cell);
      case PathPiece::Kind::level_arc:
        return level_arc(*this, BallProfile<double>{start.z + R, R * R}, z, stride, x, y, cell);
    }
  }
  if (piece.kind == PathPiece::Kind::level_arc)
    return level_arc(*this, BullProfile<double>{start.z, R * R, R - corner, corner}, z, stride, x,
                     y, cell);
  const Near n = near_line(*this, x, y, cell);
  if (rise == 0.0) {
    const BullProfile<float> profile{static_cast<float>(n.tip), static_cast<float>(R * R),
                                     static_cast<float>(R - corner), static_cast<float>(corner)};
    const AlongLevelLine<float, BullProfile<float>> under{
        static_cast<float>(ux), static_cast<float>(uy), static_cast<float>(n.t1),
        static_cast<float>(n.t2), profile};
    return cut_block<float>(z, stride, static_cast<float>(n.x), static_cast<float>(n.y),
                            static_cast<float>(cell), under);
  }
  if (corner == 0.0)
    return cut_block<double>(z, stride, n.x, n.y, cell,
                             FlatAlongLine<double>{ux, uy, rise, n.t1, n.t2, n.tip, R * R});
  return cut_block<double>(z, stride, n.x, n.y, cell,
                           BullAlongLine{ux, uy, rise, n.t1, n.t2, n.tip, R, corner});
}

}  // namespace maquette::cnc::swept
