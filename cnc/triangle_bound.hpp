// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file triangle_bound.hpp
/// Upper bounds, in single precision, of what boxes and triangles can ask of a cutter's tip, eight
/// at once. Tips are less a base height near to them, so that rounding is of differences.
///
/// Boxes       top - rise at the nearest point of the outline
/// Triangles   the same of their own box; under a ball also the contacts with vertices, edges and
///             facet, widened as in ball_bound.hpp. Coordinates are differences taken in double,
///             so that sides are known to 2^-24 of their length; the normal's upright part is
///             wrong by 2^-22 |e| |f| and less, which for a narrow triangle says nothing: there,
///             and where the triangle is much larger than the ball, the box alone counts.

#include <algorithm>
#include <array>
#include <type_traits>

#include "cnc/contact.hpp"
#include "cnc/lanes.hpp"
#include "core/vec.hpp"

namespace maquette::cnc {

inline constexpr float kNoContact = -1e30F;

/// Not more than the underside's rise where the distance from the axis is not less than sqrt(r2);
/// kOut where that is out of reach.
class RiseBelow {
 public:
  explicit RiseBelow(const BallShape& s) : RiseBelow(0.0, s.R, s.R) {}
  explicit RiseBelow(const FlatShape& s) : RiseBelow(s.R, 0.0, s.R) {}
  explicit RiseBelow(const BullShape& s) : RiseBelow(s.a, s.rc, s.R) {}
  explicit RiseBelow(const ConeShape& s) : RiseBelow(s.a, 0.0, s.R) {
    slope_ = static_cast<float>(s.slope * (1.0 - 1e-5));
  }
  static constexpr float kOut = 2e30F;

  [[nodiscard]] Lanes operator()(Lanes r2) const {
    const Lanes t = larger(root(r2) - a_, Lanes{});
    // Under the root a difference that cancels near the rim; more of it is less rise.
    const Lanes under = larger((rc_ - t) * (rc_ + t), Lanes{}) + kPad * rc_ * rc_;
    const Lanes corner = t * t / (rc_ + root(under) + kTiny);
    const Lanes rise = slope_ * t + (rc_ > 0.0F ? smaller(corner, Lanes{} + rc_) * kLess : Lanes{});
    return r2 <= reach2_ ? rise : Lanes{} + kOut;
  }

 private:
  static constexpr float kTiny = 1e-30F, kPad = 1e-6F, kLess = 1.0F - 1e-5F;
  RiseBelow(double flat, double corner, double reach)
      : a_(static_cast<float>(flat * (1.0 + 1e-6))),
        rc_(static_cast<float>(corner)),
        reach2_(static_cast<float>(reach * reach * (1.0 + 1e-5))) {}
  float a_, rc_, reach2_, slope_ = 0.0F;
};

/// First corner relative to the axis and the base; sides p to q, p to s, q to s.
struct TriangleLanes {
  struct Vector {
    std::array<float, kLanes> x, y, z;
    void set(std::size_t k, Vec3 v) {
      x[k] = static_cast<float>(v.x);
      y[k] = static_cast<float>(v.y);
      z[k] = static_cast<float>(v.z);
    }
  };
  Vector p, pq, ps, qs;
};

template <class Shape>
class TriangleBound {
 public:
  explicit TriangleBound(const Shape& shape) : rise_(shape), R_(static_cast<float>(shape.R)) {}

  [[nodiscard]] Lanes operator()(const TriangleLanes& t) const {
    const Corner p(t.p), e(t.pq), f(t.ps);
    const Lanes none{};
    const auto gap = [&](Lanes a, Lanes b, Lanes c) {
      const Lanes low = smaller(a, a + smaller(b, c)), high = larger(a, a + larger(b, c));
      const Lanes away = larger(larger(low, -high), none) - kSum * (magnitude(a) + R_);
      return larger(away, none);
    };
    const Lanes dx = gap(p.x, e.x, f.x), dy = gap(p.y, e.y, f.y);
    const Lanes top = larger(p.z, p.z + larger(e.z, f.z));
    const Lanes height = magnitude(p.z) + magnitude(e.z) + magnitude(f.z);
    const Lanes by_box = top - rise_(dx * dx + dy * dy) + kSum * (height + R_);
    if constexpr (std::is_same_v<Shape, BallShape>)
      return smaller(by_box, contacts(p, e, f, Corner(t.qs), height));
    else
      return by_box;
  }

 private:
  static constexpr float kSquare = 1e-5F, kBeside = 4e-3F, kSum = 4e-6F;
  static constexpr float kNormal = 0x1p-22F, kNarrow = 1e-3F, kLarge = 8.0F, kWide = 1e30F;
  struct Corner {
    Corner(Lanes x_, Lanes y_, Lanes z_) : x(x_), y(y_), z(z_) {}
    explicit Corner(const TriangleLanes::Vector& v)
        : x(load(v.x.data())), y(load(v.y.data())), z(load(v.z.data())) {}
    Lanes x, y, z;
  };

  [[nodiscard]] float square() const { return R_ * R_ * (1.0F + kSquare); }

  // Of the ball's centre.
  [[nodiscard]] Lanes vertex(const Corner& p) const {
    const Lanes q = square() - p.x * p.x - p.y * p.y;
    return q >= 0.0F ? p.z + root(larger(q, Lanes{})) : Lanes{} + kNoContact;
  }
  /// Raises `slope` to the line's if it counts.
  [[nodiscard]] Lanes edge(const Corner& p, const Corner& e, Lanes& slope) const {
    const Lanes length = root(e.x * e.x + e.y * e.y + 1e-30F);
    const Lanes m = e.z / length, along = -(p.x * e.x + p.y * e.y) / length;
    const Lanes aside = (p.x * e.y - p.y * e.x) / length;
    const Lanes q = square() - aside * aside, m2 = 1.0F + m * m;
    const Lanes k = root(larger(q, Lanes{}) * m2), s = along + m * k / m2;
    const auto on_it = (q >= 0.0F) & (s >= -beside()) & (s <= length + beside());
    slope = larger(slope, on_it ? magnitude(m) : Lanes{});
    return on_it ? p.z + m * along + k : Lanes{} + kNoContact;
  }
  [[nodiscard]] Lanes contacts(const Corner& p, const Corner& e, const Corner& f,
                               const Corner& side, Lanes height) const {
    const Corner q{p.x + e.x, p.y + e.y, p.z + e.z}, s{p.x + f.x, p.y + f.y, p.z + f.z};
    const auto extent = [](const Corner& v) { return magnitude(v.x) + magnitude(v.y); };
    Lanes slope{};
    Lanes best = larger(larger(vertex(p), vertex(q)), vertex(s));
    best = larger(best, larger(edge(p, e, slope), edge(p, f, slope)));
    best = larger(best, edge(q, side, slope));

    const Lanes nx = e.y * f.z - e.z * f.y, ny = e.z * f.x - e.x * f.z;
    const Lanes nz = e.x * f.y - e.y * f.x;
    const Lanes size = extent(e) + extent(f), square_size = extent(e) * extent(f);
    const auto unclear = (magnitude(nz) <= kNarrow * square_size) | (size > kLarge * R_);
    const Lanes per_nz = 1.0F / (unclear ? Lanes{} + 1.0F : nz);
    const Lanes gx = -nx * per_nz, gy = -ny * per_nz, t = root(1.0F + gx * gx + gy * gy);
    const Lanes x = gx * (R_ / t) - p.x, y = gy * (R_ / t) - p.y;
    // Distances of the contact from the sides, times the sides' lengths.
    const Lanes turn = nz < 0.0F ? Lanes{} - 1.0F : Lanes{} + 1.0F;
    const Lanes a = (e.x * y - e.y * x) * turn, b = (x * f.y - y * f.x) * turn;
    const Lanes c = nz * turn - a - b;
    const auto in_it = (a >= -beside() * extent(e)) & (b >= -beside() * extent(f)) &
                       (c >= -beside() * extent(side));
    best = larger(best, in_it ? p.z - gx * p.x - gy * p.y + R_ * t : Lanes{} + kNoContact);
    const Lanes steep = in_it ? magnitude(gx) + magnitude(gy) : Lanes{};
    // The gradient's error times the way from the corner to the contact.
    const Lanes doubt = 4.0F * kNormal * square_size * magnitude(per_nz) * steep * (size + R_);
    const Lanes sums = kSum * (height + (larger(slope, steep) + 1.0F) * (2.0F * R_ + size));
    return unclear ? Lanes{} + kWide : best - R_ + doubt + sums;
  }
  [[nodiscard]] float beside() const { return kBeside * R_; }

  RiseBelow rise_;
  float R_;
};

}  // namespace maquette::cnc
