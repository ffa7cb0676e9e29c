// SPDX-License-Identifier: GPL-3.0-or-later
#include "challenge/photo_relief.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace challenge {
namespace {

constexpr int kTile = 4;  // cells
constexpr double kNever = std::numeric_limits<double>::infinity();

/// First root of a + b s + q s^2 in (0, end], a > 0; -1: none.
double first_root(double a, double b, double q, double end) {
  // Above at both ends, and no valley between: nothing, as nearly always.
  if (a + end * (b + q * end) > 0 && (q <= 0 || b >= 0 || -b >= 2 * q * end)) return -1;
  const double disc = b * b - 4 * q * a;
  if (disc < 0) return -1;
  const double w = -0.5 * (b + (b < 0 ? -1.0 : 1.0) * std::sqrt(disc));
  double best = kNever;
  if (q != 0) {
    const double s = w / q;
    if (s > 0) best = std::min(best, s);
  }
  if (w != 0) {
    const double s = a / w;
    if (s > 0) best = std::min(best, s);
  }
  return best <= end ? best : -1;
}

}  // namespace

struct Relief::Ray {
  double u, v, z;     // start, cells and mm
  double du, dv, dz;  // for one t
};

Relief::Relief(Field nodes, Between between)
    : nodes_(std::move(nodes)), between_(between), tiles_((nodes_.n - 2) / kTile + 1) {
  top_ = *std::max_element(nodes_.z.begin(), nodes_.z.end());
  tile_top_.assign(static_cast<std::size_t>(tiles_) * static_cast<std::size_t>(tiles_), -kNever);
  for (int r = 0; r < tiles_; ++r)
    for (int c = 0; c < tiles_; ++c)
      for (int i = r * kTile; i <= std::min(nodes_.n - 1, (r + 1) * kTile); ++i)
        for (int j = c * kTile; j <= std::min(nodes_.n - 1, (c + 1) * kTile); ++j) {
          double& highest = tile_top_[static_cast<std::size_t>(r * tiles_ + c)];
          highest = std::max(highest, nodes_.at(i, j));
        }
  if (between_ != Between::smooth) return;
  slope_x_ = slope_y_ = make_field(nodes_.n, nodes_.step);
  for (int r = 0; r < nodes_.n; ++r)
    for (int c = 0; c < nodes_.n; ++c) {
      const int c0 = std::max(0, c - 1), c1 = std::min(nodes_.n - 1, c + 1),
                r0 = std::max(0, r - 1), r1 = std::min(nodes_.n - 1, r + 1);
      slope_x_.at(r, c) = (nodes_.at(r, c1) - nodes_.at(r, c0)) / ((c1 - c0) * nodes_.step);
      slope_y_.at(r, c) = (nodes_.at(r1, c) - nodes_.at(r0, c)) / ((r1 - r0) * nodes_.step);
    }
}

double Relief::height(double x, double y) const {
  if (between_ != Between::triangles) return nodes_.height(x, y);
  const double u = std::clamp(x / nodes_.step, 0.0, nodes_.n - 1.0),
               v = std::clamp(y / nodes_.step, 0.0, nodes_.n - 1.0);
  const int c = std::min(static_cast<int>(u), nodes_.n - 2),
            r = std::min(static_cast<int>(v), nodes_.n - 2);
  const double a = u - c, b = v - r;
  const double z00 = nodes_.at(r, c), z11 = nodes_.at(r + 1, c + 1);
  return a >= b ? z00 + a * (nodes_.at(r, c + 1) - z00) + b * (z11 - nodes_.at(r, c + 1))
                : z00 + a * (z11 - nodes_.at(r + 1, c)) + b * (nodes_.at(r + 1, c) - z00);
}

Vec3 Relief::normal(double x, double y) const {
  double gx, gy;
  if (between_ == Between::smooth) {
    gx = slope_x_.height(x, y);
    gy = slope_y_.height(x, y);
  } else {
    const double u = std::clamp(x / nodes_.step, 0.0, nodes_.n - 1.0),
                 v = std::clamp(y / nodes_.step, 0.0, nodes_.n - 1.0);
    const int c = std::min(static_cast<int>(u), nodes_.n - 2),
              r = std::min(static_cast<int>(v), nodes_.n - 2);
    const double a = u - c, b = v - r;
    const double south = nodes_.at(r, c + 1) - nodes_.at(r, c),
                 north = nodes_.at(r + 1, c + 1) - nodes_.at(r + 1, c),
                 west = nodes_.at(r + 1, c) - nodes_.at(r, c),
                 east = nodes_.at(r + 1, c + 1) - nodes_.at(r, c + 1);
    if (between_ == Between::triangles) {
      gx = a >= b ? south : north;
      gy = a >= b ? east : west;
    } else {
      gx = (1 - b) * south + b * north;
      gy = (1 - a) * west + a * east;
    }
    gx /= nodes_.step;
    gy /= nodes_.step;
  }
  const double k = 1.0 / std::sqrt(gx * gx + gy * gy + 1);
  return {-gx * k, -gy * k, k};
}

double Relief::in_cell(const Ray& ray, int c, int r, double ta, double tb) const {
  const double z00 = nodes_.at(r, c), z01 = nodes_.at(r, c + 1), z10 = nodes_.at(r + 1, c),
               z11 = nodes_.at(r + 1, c + 1);
  const double u = ray.u + ta * ray.du - c, v = ray.v + ta * ray.dv - r, z = ray.z + ta * ray.dz;
  const double end = tb - ta;
  if (between_ != Between::triangles) {
    const double b = z01 - z00, a = z10 - z00, e = z11 - z01 - z10 + z00;
    const double gap = z - (z00 + b * u + a * v + e * u * v);
    if (gap <= 0) return ta;
    const double s =
        first_root(gap, ray.dz - b * ray.du - a * ray.dv - e * (u * ray.dv + v * ray.du),
                   -e * ray.du * ray.dv, end);
    return s < 0 ? -1 : ta + s;
  }
  // Over the diagonal u = v from one plane to the other.
  const double across = v - u, turn = ray.dv - ray.du;
  const double change = turn != 0 ? -across / turn : -1;
  const auto plane = [&](bool lower, double from, double to) {
    const double gu = lower ? z01 - z00 : z11 - z10, gv = lower ? z11 - z01 : z10 - z00;
    const double gap =
        z + from * ray.dz - (z00 + gu * (u + from * ray.du) + gv * (v + from * ray.dv));
    if (gap <= 0) return ta + from;
    const double fall = gu * ray.du + gv * ray.dv - ray.dz;
    return fall > 0 && gap <= fall * (to - from) ? ta + from + gap / fall : -1.0;
  };
  const bool split = change > 0 && change < end;
  const double middle = split ? change : end;
  const bool lower = across + 0.5 * middle * turn <= 0;
  const double t = plane(lower, 0, middle);
  return t < 0 && split ? plane(!lower, middle, end) : t;
}

double Relief::in_tile(const Ray& ray, int tile_c, int tile_r, double ta, double tb) const {
  const int c0 = tile_c * kTile, c1 = std::min(c0 + kTile, nodes_.n - 1) - 1, r0 = tile_r * kTile,
            r1 = std::min(r0 + kTile, nodes_.n - 1) - 1;
  int c = std::clamp(static_cast<int>(ray.u + ta * ray.du), c0, c1),
      r = std::clamp(static_cast<int>(ray.v + ta * ray.dv), r0, r1);
  const int step_c = ray.du > 0 ? 1 : -1, step_r = ray.dv > 0 ? 1 : -1;
  const double each_c = ray.du != 0 ? std::abs(1 / ray.du) : kNever,
               each_r = ray.dv != 0 ? std::abs(1 / ray.dv) : kNever;
  double next_c = ray.du != 0 ? (c + (ray.du > 0) - ray.u) / ray.du : kNever,
         next_r = ray.dv != 0 ? (r + (ray.dv > 0) - ray.v) / ray.dv : kNever;
  for (double t = ta;;) {
    const double leave = std::min({next_c, next_r, tb});
    if (leave > t) {
      const double found = in_cell(ray, c, r, t, leave);
      if (found >= 0) return found;
      t = leave;
    }
    if (leave >= tb) return -1;
    if (next_c <= next_r) {
      c += step_c;
      next_c += each_c;
      if (c < c0 || c > c1) return -1;
    } else {
      r += step_r;
      next_r += each_r;
      if (r < r0 || r > r1) return -1;
    }
  }
}

double Relief::meet(Vec3 from, Vec3 along, double longest) const {
  double t0 = 0, t1 = longest;
  const auto clip = [&](double o, double d, double low, double high) {
    if (d == 0) {
      if (o < low || o > high) t1 = -1;
      return;
    }
    const double a = (low - o) / d, b = (high - o) / d;
    t0 = std::max(t0, std::min(a, b));
    t1 = std::min(t1, std::max(a, b));
  };
  clip(from.x, along.x, 0, side());
  clip(from.y, along.y, 0, side());
  clip(from.z, along.z, -1e9, top_);
  if (t0 >= t1) return -1;
  const Vec3 in = from + t0 * along;
  if (in.z < height(in.x, in.y)) return -1;  // through a side
  const Ray ray{from.x / nodes_.step,  from.y / nodes_.step,  from.z,
                along.x / nodes_.step, along.y / nodes_.step, along.z};
  int c = std::clamp(static_cast<int>(in.x / (kTile * nodes_.step)), 0, tiles_ - 1),
      r = std::clamp(static_cast<int>(in.y / (kTile * nodes_.step)), 0, tiles_ - 1);
  const int step_c = ray.du > 0 ? 1 : -1, step_r = ray.dv > 0 ? 1 : -1;
  const double each_c = ray.du != 0 ? std::abs(kTile / ray.du) : kNever,
               each_r = ray.dv != 0 ? std::abs(kTile / ray.dv) : kNever;
  double next_c = ray.du != 0 ? ((c + (ray.du > 0)) * kTile - ray.u) / ray.du : kNever,
         next_r = ray.dv != 0 ? ((r + (ray.dv > 0)) * kTile - ray.v) / ray.dv : kNever;
  for (double t = t0; t < t1;) {
    const double leave = std::min({next_c, next_r, t1});
    if (leave > t) {
      const double lowest = from.z + along.z * (along.z < 0 ? leave : t);
      if (lowest <= tile_top_[static_cast<std::size_t>(r * tiles_ + c)]) {
        const double found = in_tile(ray, c, r, t, leave);
        if (found >= 0) return found;
      }
      t = leave;
    }
    if (leave >= t1) return -1;
    if (next_c <= next_r) {
      c += step_c;
      next_c += each_c;
      if (c < 0 || c >= tiles_) return -1;
    } else {
      r += step_r;
      next_r += each_r;
      if (r < 0 || r >= tiles_) return -1;
    }
  }
  return -1;
}

}  // namespace challenge
