// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file straight_lines.hpp
/// Exact distances near a source, along straight lines over unfolded triangles
/// (corner_surface.hpp), which go on from saddle vertices and inward corners of the rim in all
/// directions. `known` is asked and told: known.value(v), and known.seed(v, distance), the
/// length of a real way, so never too short.
///
/// Windows of edges as in J. Chen, Y. Han, "Shortest paths on a polyhedron", SoCG 1990,
/// doi:10.1145/98524.98601, dropped where a way over an end of the edge is shorter: S.-Q. Xin,
/// G.-J. Wang, "Improving Chen and Han's algorithm on the discrete geodesic problem", ACM Trans.
/// Graph. 28, 2009, doi:10.1145/1559755.1559761.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <numbers>
#include <queue>
#include <utility>
#include <vector>

#include "core/vec.hpp"

namespace maquette::meshing::detail {

struct Plane2 {
  double x = 0.0, y = 0.0;
  friend Plane2 operator-(Plane2 a, Plane2 b) { return {a.x - b.x, a.y - b.y}; }
  friend Plane2 operator+(Plane2 a, Plane2 b) { return {a.x + b.x, a.y + b.y}; }
  friend Plane2 operator*(double k, Plane2 a) { return {k * a.x, k * a.y}; }
};
[[nodiscard]] inline double cross(Plane2 a, Plane2 b) {
  return a.x * b.y - a.y * b.x;
}
[[nodiscard]] inline double dot(Plane2 a, Plane2 b) {
  return a.x * b.x + a.y * b.y;
}

template <class Surface, class Known>
class StraightLines {
 public:
  using Corner = typename Surface::Corner;
  StraightLines(const Surface& surface, Known& known) : s_(surface), known_(known) {}

  /// From a point of the triangle of corner c; weights as in SurfacePoint.
  void from_point(Corner c, double u, double v, double radius) {
    std::array<Plane2, 3> at = layout(c);
    const Plane2 source = u * at[1] + v * at[2];
    const std::array<Corner, 3> corner{c, s_.next(c), s_.prev(c)};
    radius_ = radius;
    base_ = 0.0;
    for (std::size_t i = 0; i < 3; ++i) {
      at[i] = at[i] - source;
      reach(s_.vertex(corner[i]), std::sqrt(dot(at[i], at[i])));
    }
    for (std::size_t i = 0; i < 3; ++i) open(corner[i], at[(i + 1) % 3], at[(i + 2) % 3]);
    follow();
  }

  /// Every value up to here is exact if all sources had at least this radius; INFINITY unless
  /// some source had more than kMostWindows or kMostWindowsPerVertex.
  [[nodiscard]] double complete_up_to() const { return complete_; }

  void from_vertex(std::uint32_t v, double radius) {
    radius_ = radius;
    base_ = 0.0;
    known_.seed(v, 0.0);
    star(v);
    follow();
  }

  /// From a segment of the triangle of corner c: its corners and those beyond its edges.
  void from_segment(Corner c, Plane2 weights0, Plane2 weights1) {
    const std::array<Plane2, 3> at = layout(c);
    const Plane2 a = weights0.x * at[1] + weights0.y * at[2];
    const Plane2 b = weights1.x * at[1] + weights1.y * at[2];
    const auto nearest = [&](Plane2 p) {
      const double length2 = dot(b - a, b - a);
      const double t = length2 > 0.0 ? std::clamp(dot(p - a, b - a) / length2, 0.0, 1.0) : 0.0;
      return a + t * (b - a);
    };
    const std::array<Corner, 3> corner{c, s_.next(c), s_.prev(c)};
    for (std::size_t i = 0; i < 3; ++i) {
      const Plane2 off = at[i] - nearest(at[i]);
      known_.seed(s_.vertex(corner[i]), std::sqrt(dot(off, off)));
      const Corner apex = s_.opposite(corner[i]);
      if (!s_.exists(apex)) continue;
      const Plane2 p = at[(i + 1) % 3], q = at[(i + 2) % 3];
      const Plane2 d = unfold(apex, corner[i], p, q), from = nearest(d);
      // The line must pass between the edge's ends.
      if (cross(p - from, d - from) >= 0.0 && cross(d - from, q - from) >= 0.0)
        known_.seed(s_.vertex(apex), std::sqrt(dot(d - from, d - from)));
    }
  }

 private:
  /// An edge seen from the origin between the directions `right` and `left`, with its ends;
  /// `apex` is the corner beyond, `before` the one on this side.
  struct Window {
    Corner apex, before;
    Plane2 p, q, right, left;
    double base;  ///< distance of the origin
  };
  static constexpr double kTie = 1.0 + 1e-6;  // values are kept in single precision
  // Of one source: 4 million, or 64 for each vertex there is. Slivers can ask for more.
  static constexpr std::size_t kMostWindows = 1U << 22, kMostWindowsPerVertex = 64;

  /// Corners of c's triangle in the plane: c at the origin, the next on the x axis, the third
  /// to its left.
  [[nodiscard]] std::array<Plane2, 3> layout(Corner c) const {
    const Vec3 at = s_.point(c), a = s_.point(s_.next(c)) - at, b = s_.point(s_.prev(c)) - at;
    const double length = norm(a);
    if (!(length > 0.0)) return {Plane2{}, Plane2{}, Plane2{norm(b), 0.0}};
    const double along = maquette::dot(a, b) / length;
    const double up = norm(maquette::cross(a, b)) / length;
    return {Plane2{}, Plane2{length, 0.0}, Plane2{along, up}};
  }

  /// Place of the apex beyond the edge from p (corner next of `before`) to q (corner prev), on
  /// its right.
  [[nodiscard]] Plane2 unfold(Corner apex, Corner before, Plane2 p, Plane2 q) const {
    const Vec3 from = s_.point(s_.next(before)), edge = s_.point(s_.prev(before)) - from;
    const Vec3 to = s_.point(apex) - from;
    const double length2 = maquette::dot(edge, edge);
    const double along = maquette::dot(to, edge) / length2;
    const double off = std::sqrt(std::max(0.0, maquette::dot(to, to) / length2 - along * along));
    const Plane2 e = q - p;
    return {p.x + along * e.x + off * e.y, p.y + along * e.y - off * e.x};
  }

  void star(std::uint32_t v) {
    s_.for_each_corner(v, [&](Corner c) {
      const std::array<Plane2, 3> at = layout(c);
      reach(s_.vertex(s_.next(c)), std::sqrt(dot(at[1], at[1])));
      reach(s_.vertex(s_.prev(c)), std::sqrt(dot(at[2], at[2])));
      open(c, at[1], at[2]);
    });
  }

  /// Straight ways end at vertices; from some of them others go on.
  void reach(std::uint32_t v, double distance) {
    const double value = base_ + distance;
    if (!(value < known_.value(v))) return;
    known_.seed(v, value);
    if (value < radius_ && bends_ways(v)) turns_.emplace(value, v);
  }

  /// More than a full turn of triangles around v, or at the rim more than half a turn.
  [[nodiscard]] bool bends_ways(std::uint32_t v) const {
    double angle = 0.0;
    bool rim = false;
    s_.for_each_corner(v, [&](Corner c) {
      const Vec3 at = s_.point(c), a = s_.point(s_.next(c)) - at, b = s_.point(s_.prev(c)) - at;
      angle += std::atan2(norm(maquette::cross(a, b)), maquette::dot(a, b));
      rim = rim || !s_.exists(s_.opposite(s_.next(c))) || !s_.exists(s_.opposite(s_.prev(c)));
    });
    return angle > (rim ? 1.0 : 2.0) * std::numbers::pi + 1e-9;
  }

  void open(Corner before, Plane2 p, Plane2 q) { open(before, p, q, p, q); }

  void open(Corner before, Plane2 p, Plane2 q, Plane2 right, Plane2 left) {
    const Corner apex = s_.opposite(before);
    if (!s_.exists(apex)) return;
    const Plane2 e = q - p;
    const double length2 = dot(e, e);
    if (!(length2 > 0.0)) return;
    const Plane2 nearest = p + std::clamp(-dot(p, e) / length2, 0.0, 1.0) * e;
    const double reach = std::max(0.0, radius_ - base_);
    if (dot(nearest, nearest) > reach * reach) return;
    const Window w{apex, before, p, q, right, left, base_};
    if (!needed(w)) return;
    std::uint32_t at;
    if (free_.empty()) {
      at = static_cast<std::uint32_t>(windows_.size());
      windows_.push_back(w);
    } else {
      at = free_.back();
      free_.pop_back();
      windows_[at] = w;
    }
    queue_.emplace(base_ + std::sqrt(dot(nearest, nearest)), at);
  }

  /// No way over an end of the edge is shorter to all that lies behind the window.
  [[nodiscard]] bool needed(const Window& w) const {
    const Plane2 e = w.q - w.p;
    // Shares of the edge, from p, where the window starts and ends.
    const double per_right = cross(w.right, e), per_left = cross(w.left, e);
    const double from =
        per_right > 0.0 ? std::clamp(-cross(w.right, w.p) / per_right, 0.0, 1.0) : 0.0;
    const double to = per_left > 0.0 ? std::clamp(-cross(w.left, w.p) / per_left, 0.0, 1.0) : 1.0;
    const Plane2 a = w.p + from * e, b = w.p + to * e;
    const double length = std::sqrt(dot(e, e));
    const double at_p = known_.value(s_.vertex(s_.next(w.before)));
    const double at_q = known_.value(s_.vertex(s_.prev(w.before)));
    return w.base + std::sqrt(dot(b, b)) <= (at_p + to * length) * kTie &&
           w.base + std::sqrt(dot(a, a)) <= (at_q + (1.0 - from) * length) * kTie;
  }

  /// The nearest first, so that what is farther finds out early that it is not needed.
  void follow() {
    const std::size_t most = std::max(kMostWindows, kMostWindowsPerVertex * s_.vertices());
    std::size_t count = 0;
    for (; count < most && !(queue_.empty() && turns_.empty()); ++count) {
      if (queue_.empty() || (!turns_.empty() && turns_.top().first < queue_.top().first)) {
        const auto [value, v] = turns_.top();
        turns_.pop();
        if (value > known_.value(v) * kTie) continue;  // found a shorter way since
        base_ = value;
        star(v);
      } else {
        const std::uint32_t at = queue_.top().second;
        queue_.pop();
        const Window w = windows_[at];
        free_.push_back(at);
        base_ = w.base;
        if (needed(w)) cross_triangle(w);
      }
    }
    if (!queue_.empty()) complete_ = std::min(complete_, queue_.top().first);
    if (!turns_.empty()) complete_ = std::min(complete_, turns_.top().first);
    windows_.clear();
    free_.clear();
    queue_ = {};
    turns_ = {};
  }

  void cross_triangle(const Window& w) {
    const Plane2 d = unfold(w.apex, w.before, w.p, w.q);
    const double distance = std::sqrt(dot(d, d));
    const double from_right = cross(w.right, d), from_left = cross(d, w.left);
    // Lines through vertices are the rule on regular grids: rounding must not lose them.
    const double slack = 1e-9 * distance;
    if (from_right >= -slack * std::sqrt(dot(w.right, w.right)) &&
        from_left >= -slack * std::sqrt(dot(w.left, w.left)))
      reach(s_.vertex(w.apex), distance);
    // The apex' triangle has the edge the other way round.
    if (s_.vertex(s_.next(w.apex)) != s_.vertex(s_.prev(w.before))) return;  // turned round
    if (from_right > 0.0) open(s_.next(w.apex), w.p, d, w.right, from_left > 0.0 ? d : w.left);
    if (from_left > 0.0) open(s_.prev(w.apex), d, w.q, from_right > 0.0 ? d : w.right, w.left);
  }

  /// Least distance, and which.
  using Turn = std::pair<double, std::uint32_t>;
  const Surface& s_;
  Known& known_;
  double radius_ = 0.0, base_ = 0.0, complete_ = INFINITY;
  std::vector<Window> windows_;
  std::vector<std::uint32_t> free_;                                     // places in windows_
  std::priority_queue<Turn, std::vector<Turn>, std::greater<>> queue_;  // windows
  std::priority_queue<Turn, std::vector<Turn>, std::greater<>> turns_;  // vertices to go on from
};

}  // namespace maquette::meshing::detail
