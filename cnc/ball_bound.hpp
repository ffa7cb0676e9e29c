// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file ball_bound.hpp
/// For single cells of a height grid an upper bound of the ball's contacts that is near to them:
/// the contacts themselves (cell_contact.hpp) in single precision, eight cells at once, widened by
/// what rounding can have taken. On gentle ground the bound is within 1e-4 mm, so that of the cells
/// in reach hardly ever more than one must be worked out in double.
///
/// Widening. With u = 2^-24: squares of distances are wrong by less than 40 u R^2, which kSquare
/// covers; under a root that may be sqrt(kSquare) R, and so may the place of a contact, which
/// kBeside covers: contacts that far outside their edge or facet still count, which can only raise
/// the bound. Sums of heights are wrong by less than 16 u times the terms that they are made of.

#include <algorithm>
#include <array>
#include <cstdint>

#include "cnc/lanes.hpp"
#include "cnc/reach_window.hpp"

namespace maquette::cnc {

class BallBound {
 public:
  /// @param z       first node of the window
  /// @param px, py  the axis, from the window's first node
  BallBound(double radius_mm, double spacing_mm, const float* z, std::ptrdiff_t stride, double px,
            double py)
      : R_(static_cast<float>(radius_mm)),
        d_(static_cast<float>(spacing_mm)),
        per_d_(static_cast<float>(1.0 / spacing_mm)),
        px_(static_cast<float>(px)),
        py_(static_cast<float>(py)),
        z_(z),
        stride_(stride) {}

  /// bound[i] of the tip over cells[i], less `base_mm`; bound has room for whole registers.
  void operator()(const WindowCell* cells, std::size_t n, float base_mm, float* bound) const {
    for (std::size_t i = 0; i < n; i += kLanes) store(bound + i, eight(cells, i, n, base_mm));
  }

 private:
  static constexpr float kSquare = 1e-5F, kBeside = 4e-3F, kSum = 4e-6F;
  static constexpr float kNone = ReachWindows::kOutOfReach;
  static constexpr float kHalf = 0.70710678F;

  struct Cells {
    Lanes x, y, z;  // the axis from the first node; its height
  };

  [[nodiscard]] Lanes eight(const WindowCell* cells, std::size_t i, std::size_t n,
                            float base_mm) const {
    alignas(32) std::array<float, kLanes> x, y, z00, z10, z01, z11;
    for (std::size_t k = 0; k < kLanes; ++k) {
      const WindowCell& c = cells[std::min(i + k, n - 1)];
      const float* z0 = z_ + c.row * stride_ + c.col;
      const float* z1 = z0 + stride_;
      x[k] = px_ - d_ * static_cast<float>(c.col);
      y[k] = py_ - d_ * static_cast<float>(c.row);
      z00[k] = z0[0];
      z10[k] = z0[1];
      z01[k] = z1[0];
      z11[k] = z1[1];
    }
    const Cells at{load(x.data()), load(y.data()), load(z00.data()) - base_mm};
    const Lanes low_x = (load(z10.data()) - load(z00.data())) * per_d_;
    const Lanes low_y = (load(z11.data()) - load(z10.data())) * per_d_;
    const Lanes up_x = (load(z11.data()) - load(z01.data())) * per_d_;
    const Lanes up_y = (load(z01.data()) - load(z00.data())) * per_d_;

    const Lanes u = (at.x + at.y) * kHalf, v = (at.y - at.x) * kHalf;
    Lanes best = vertex(at);
    best = larger(best, edge(at.z, low_x, at.x, at.y, d_));
    best = larger(best, edge(at.z, up_y, at.y, at.x, d_));
    best = larger(best, edge(at.z, (low_x + low_y) * kHalf, u, v, d_ / kHalf));
    best = larger(best, facet(at, low_x, low_y, [&](Lanes a, Lanes b) {
                    return (b >= -beside()) & (a <= d_ + beside()) & (b <= a + beside());
                  }));
    best = larger(best, facet(at, up_x, up_y, [&](Lanes a, Lanes b) {
                    return (a >= -beside()) & (b <= d_ + beside()) & (b >= a - beside());
                  }));
    const Lanes slopes = magnitude(low_x) + magnitude(low_y) + magnitude(up_x) + magnitude(up_y);
    return best - R_ + kSum * (magnitude(at.z) + (slopes + 1.0F) * (2.0F * R_));
  }

  [[nodiscard]] float beside() const { return kBeside * R_; }
  [[nodiscard]] float square() const { return R_ * R_ * (1.0F + kSquare); }

  // Of the ball's centre.
  [[nodiscard]] Lanes vertex(const Cells& at) const {
    const Lanes q = square() - at.x * at.x - at.y * at.y;
    return q >= 0.0F ? at.z + root(larger(q, Lanes{})) : Lanes{} + kNone;
  }
  [[nodiscard]] Lanes edge(Lanes z, Lanes m, Lanes along, Lanes aside, float length) const {
    const Lanes q = square() - aside * aside, m2 = 1.0F + m * m;
    const Lanes k = root(larger(q, Lanes{}) * m2), s = along + m * k / m2;
    const auto on_it = (q >= 0.0F) & (s >= -beside()) & (s <= length + beside());
    return on_it ? z + m * along + k : Lanes{} + kNone;
  }
  template <class Inside>
  [[nodiscard]] Lanes facet(const Cells& at, Lanes gx, Lanes gy, Inside&& inside) const {
    const Lanes t = root(1.0F + gx * gx + gy * gy), w = R_ / t;
    const auto in_it = inside(at.x + w * gx, at.y + w * gy);
    return in_it ? at.z + gx * at.x + gy * at.y + R_ * t : Lanes{} + kNone;
  }

  float R_, d_, per_d_, px_, py_;
  const float* z_;
  std::ptrdiff_t stride_;
};

}  // namespace maquette::cnc
