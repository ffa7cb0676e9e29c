// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/speed_plan.hpp"

#include <algorithm>
#include <cmath>

namespace maquette::cnc {
namespace {

constexpr std::size_t kWindow = 4096;
/// A window that never meets a limit is given out by half as if it ended at rest.
constexpr std::size_t kLargestWindow = std::size_t{1} << 18;
/// Speeds this close, and a corner no slower, do not interrupt the acceleration (jerk only).
constexpr double kSameSpeed = 0.98;

double ramp_seconds(double dv, const SpeedPiece& p) {
  const double a = p.acceleration_mm_s2, j = p.jerk_mm_s3;
  return dv * j >= a * a ? dv / a + a / j : 2.0 * std::sqrt(dv / j);
}

double ramp_mm(double v0, double v1, const SpeedPiece& p) {
  return 0.5 * (v0 + v1) * ramp_seconds(std::fabs(v1 - v0), p);
}

/// Largest v in [low, high] with f(v) <= target, f increasing and f(low) <= target, to 1e-12 of
/// the target: false position with the weight of an end halved when it stays (Illinois).
template <class F>
double largest(double low, double high, double target, F f) {
  double over = f(high) - target, under = f(low) - target;
  if (over <= 0.0) return high;
  int stayed = 0;
  for (int i = 0; i < 60 && under < 0.0; ++i) {
    const double v = (low * over - high * under) / (over - under);
    const double off = f(v) - target;
    if (std::fabs(off) <= 1e-12 * target) return v;
    if (off > 0.0) {
      high = v, over = off;
      if (stayed == 1) under *= 0.5;
      stayed = 1;
    } else {
      low = v, under = off;
      if (stayed == -1) over *= 0.5;
      stayed = -1;
    }
  }
  return low;
}

}  // namespace

/// Highest speed at the one end of a piece for the speed at the other.
double SpeedPlan::reach(double from, const SpeedPiece& p) const {
  if (p.jerk_mm_s3 == 0.0) return std::sqrt(from * from + 2.0 * p.acceleration_mm_s2 * p.length_mm);
  if (from >= p.speed_mm_s) return from;
  return largest(from, p.speed_mm_s, p.length_mm, [&](double v) { return ramp_mm(from, v, p); });
}

PlannedPiece SpeedPlan::run(double u, double w, const SpeedPiece& p) const {
  PlannedPiece out{p, u, 0.0, w, 0.0};
  const double length = p.length_mm, v = std::fmax(p.speed_mm_s, std::fmax(u, w));
  if (p.jerk_mm_s3 == 0.0) {
    const double a = p.acceleration_mm_s2;
    const double peak2 = 0.5 * (u * u + w * w) + a * length;
    if (peak2 <= v * v) {
      out.top_mm_s = std::fmax(std::sqrt(peak2), std::fmax(u, w));
      out.seconds = (2.0 * out.top_mm_s - u - w) / a;
    } else {
      out.top_mm_s = v;
      out.seconds = (2.0 * v - u - w) / a +
                    std::fmax(0.0, length - (2.0 * v * v - u * u - w * w) / (2.0 * a)) / v;
    }
    return out;
  }
  const double top = largest(std::fmax(u, w), v, length,
                             [&](double t) { return ramp_mm(u, t, p) + ramp_mm(w, t, p); });
  out.top_mm_s = top;
  out.seconds = ramp_seconds(top - u, p) + ramp_seconds(top - w, p) +
                std::fmax(0.0, length - ramp_mm(u, top, p) - ramp_mm(w, top, p)) / top;
  return out;
}

void SpeedPlan::add(const SpeedPiece& piece) {
  if (piece.jerk_mm_s3 > 0.0 && !pieces_.empty()) {
    SpeedPiece& last = pieces_.back();
    const double slow = std::fmin(last.speed_mm_s, piece.speed_mm_s);
    const double fast = std::fmax(last.speed_mm_s, piece.speed_mm_s);
    if (std::fmin(slow, piece.entry_mm_s) >= kSameSpeed * fast) {
      last.length_mm += piece.length_mm;
      last.speed_mm_s = std::fmin(slow, piece.entry_mm_s);
      last.acceleration_mm_s2 = std::fmin(last.acceleration_mm_s2, piece.acceleration_mm_s2);
      last.jerk_mm_s3 = std::fmin(last.jerk_mm_s3, piece.jerk_mm_s3);
      last.moves_ended += piece.moves_ended;
      return;
    }
  }
  pieces_.push_back(piece);
  if (plan_at_ == 0) plan_at_ = kWindow;
  if (pieces_.size() >= plan_at_) plan(false);
}

void SpeedPlan::rest() {
  plan(true);
}

void SpeedPlan::plan(bool to_the_end) {
  const std::size_t n = pieces_.size();
  if (n == 0) return;
  limit_.resize(n + 1);
  stopping_.resize(n + 1);
  // Backwards. `settled`: the last place before which nothing depends on what comes later.
  limit_[n] = 0.0;
  stopping_[n] = 0.0;
  std::size_t settled = to_the_end ? n : 0;
  for (std::size_t k = n; k-- > 0;) {
    const SpeedPiece& p = pieces_[k];
    const bool jerk = p.jerk_mm_s3 > 0.0;
    double v = std::fmin(p.speed_mm_s,
                         k > 0 ? std::fmin(p.entry_mm_s, pieces_[k - 1].speed_mm_s) : p.speed_mm_s);
    const double reached = reach(limit_[k + 1], p);
    const std::size_t ahead = std::min(n, k + look_ahead_);
    if (reached >= v && settled == 0) settled = k;
    v = std::fmin(v, reached);
    stopping_[k] =
        stopping_[k + 1] + (jerk ? p.length_mm : 2.0 * p.acceleration_mm_s2 * p.length_mm);
    if (look_ahead_ > 0 && ahead < n) {
      const double room = stopping_[k] - stopping_[ahead];
      if (jerk) {
        SpeedPiece all = p;
        all.length_mm = room;
        v = std::fmin(v, std::fmax(reach(0.0, all), limit_[k + 1]));
      } else {
        v = std::fmin(v, std::sqrt(room));
      }
    }
    limit_[k] = v;
  }
  if (settled == 0 && !to_the_end) {
    if (n < kLargestWindow) {
      plan_at_ = 2 * n;
      return;
    }
    settled = n / 2;
  }
  // Forwards.
  for (std::size_t k = 0; k < settled; ++k) {
    const SpeedPiece& p = pieces_[k];
    const double exit = std::fmin(limit_[k + 1], reach(speed_, p));
    sink_(run(speed_, exit, p));
    speed_ = exit;
  }
  pieces_.erase(pieces_.begin(), pieces_.begin() + static_cast<std::ptrdiff_t>(settled));
  plan_at_ = pieces_.size() + kWindow;
}

}  // namespace maquette::cnc
