// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file fast_marching.hpp
/// The march of geodesic.hpp on a surface of corner_surface.hpp.

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <span>
#include <vector>

#include "core/run_context.hpp"
#include "core/vec.hpp"

namespace maquette::meshing::detail {

/// Least first; entries are never removed when they grow stale, the receiver tells by the key.
/// Four children a node: half the levels of a binary heap, and children share a cache line.
class FrontHeap {
 public:
  /// @pre distance >= 0, whose bits are then in the order of the numbers
  void push(float distance, std::uint32_t vertex) {
    const std::uint64_t item =
        static_cast<std::uint64_t>(std::bit_cast<std::uint32_t>(distance)) << 32 | vertex;
    std::size_t hole = items_.size();
    items_.push_back(item);
    while (hole > 0) {
      const std::size_t parent = (hole - 1) / 4;
      if (items_[parent] <= item) break;
      items_[hole] = items_[parent];
      hole = parent;
    }
    items_[hole] = item;
  }
  [[nodiscard]] bool empty() const { return items_.empty(); }
  [[nodiscard]] float distance() const {
    return std::bit_cast<float>(static_cast<std::uint32_t>(items_.front() >> 32));
  }
  [[nodiscard]] std::uint32_t vertex() const { return static_cast<std::uint32_t>(items_.front()); }
  void pop() {
    const std::uint64_t item = items_.back();
    items_.pop_back();
    const std::size_t size = items_.size();
    if (size == 0) return;
    std::size_t hole = 0;
    for (;;) {
      const std::size_t child = 4 * hole + 1;
      if (child >= size) break;
      std::size_t least = child;
      for (std::size_t k = child + 1; k < std::min(child + 4, size); ++k)
        if (items_[k] < items_[least]) least = k;
      if (items_[least] >= item) break;
      items_[hole] = items_[least];
      hole = least;
    }
    items_[hole] = item;
  }

 private:
  std::vector<std::uint64_t> items_;
};

/// Distance at C of the plane wave of slowness w through the values at A and B, relative to a's;
/// INFINITY if it does not come through the triangle. p, q, r: products AA, AB, BB of the edge
/// vectors from C. With the gradient g in the plane, the rows (a - c, b - c) = w-scaled
/// products of g with the edges, and |g| = w, gives (p + r - 2 q) x^2 - 2 (p - q) s x + p s^2
/// = w^2 (p r - q^2) for x = c - a, s = b - a.
[[nodiscard]] inline double plane_wave(double p, double q, double r, double a, double b, double w) {
  const double det = p * r - q * q;
  const double facing = p + r - 2.0 * q;  // squared length of AB
  const double s = b - a;
  const double root2 = det * (facing * w * w - s * s);
  if (!(root2 > 0.0)) return INFINITY;
  const double x = ((p - q) * s + std::sqrt(root2)) / facing;
  // The wave's direction lies between the two edges, and it reaches neither end after C.
  if (x * (r - q) + q * s < 0.0 || x * (p - q) < p * s || x < 0.0 || x < s) return INFINITY;
  return a + x;
}

/// The same of a round wave of slowness 1: its centre lies where the triangle's plane, beyond AB,
/// has the distances a and b from A and B. Exact for one point on developable surfaces.
[[nodiscard]] inline double round_wave(double p, double q, double r, double a, double b) {
  const double facing = p + r - 2.0 * q, length = std::sqrt(facing);
  // From A along AB and, the centre below, C above it.
  const double sx = (facing + a * a - b * b) / (2.0 * length), sy2 = a * a - sx * sx;
  const double cx = (p - q) / length, cy2 = p - cx * cx;
  if (!(sy2 >= 0.0 && cy2 > 0.0)) return INFINITY;
  const double sy = std::sqrt(sy2), cy = std::sqrt(cy2);
  const double crossing = sx * cy + cx * sy, height = sy + cy;
  if (crossing < 0.0 || crossing > length * height) return INFINITY;
  const double d = std::sqrt((cx - sx) * (cx - sx) + height * height);
  return d < a || d < b ? INFINITY : d;
}

template <class Surface>
class FastMarching {
 public:
  /// @param distance  one a vertex, all INFINITY; filled
  /// @param slowness  one a vertex, or empty
  FastMarching(const Surface& surface, std::span<const float> slowness, std::span<float> distance)
      : s_(surface), slowness_(slowness), u_(distance) {}

  /// A value that vertex v has at most.
  void seed(std::uint32_t v, double value) { offer(v, value); }

  /// Values up to here are exact; the march only adds the others. Where two waves meet it would
  /// take them for one and come out too short.
  void keep_up_to(double distance) { exact_up_to_ = static_cast<float>(distance); }

  /// Waves are round, as from points; else plane, as from lines.
  void round_waves(bool round) { round_ = round; }

  [[nodiscard]] double value(std::uint32_t v) const { return static_cast<double>(u_[v]); }

  /// @return false if the run was stopped
  bool run(double max_distance, const RunContext& run) {
    if (slowness_.empty()) return march<false>(max_distance, run);
    return march<true>(max_distance, run);
  }

 private:
  using Corner = typename Surface::Corner;
  static constexpr int kMostHops = 16;

  void offer(std::uint32_t v, double value) {
    const auto rounded = static_cast<float>(value);
    if (!(rounded < u_[v]) || u_[v] <= exact_up_to_) return;
    u_[v] = rounded;
    heap_.push(rounded, v);
  }

  /// At C through the triangle, as in plane_wave.
  [[nodiscard]] double wave(double p, double q, double r, double a, double b, double w) const {
    return round_ ? round_wave(p, q, r, a, b) : plane_wave(p, q, r, a, b, w);
  }

  template <bool kWeighted>
  [[nodiscard]] double weight(std::uint32_t v) const {
    if constexpr (kWeighted) return static_cast<double>(slowness_[v]);
    return 1.0;
  }

  template <bool kWeighted>
  bool march(double max_distance, const RunContext& run) {
    constexpr std::uint64_t kVerticesPerLook = std::uint64_t{1} << 16;
    std::uint64_t looked = 0;
    while (!heap_.empty()) {
      const float key = heap_.distance();
      const std::uint32_t v = heap_.vertex();
      heap_.pop();
      if (key > u_[v]) continue;
      if (static_cast<double>(key) > max_distance) break;
      if (++looked % kVerticesPerLook == 0) {
        if (run.stopped()) return false;
        run.progress(
            std::min(1.0, static_cast<double>(looked) / static_cast<double>(s_.vertices())));
      }
      taken_ = std::max(taken_, key);
      s_.for_each_corner(v, [&](Corner c) { pass_on<kWeighted>(c, key); });
    }
    if (max_distance < INFINITY)
      for (float& u : u_)
        if (static_cast<double>(u) > max_distance) u = INFINITY;
    return true;
  }

  /// From the vertex of c, whose value u is taken, to the rest of its triangle and beyond it. Each
  /// wave is tried once, when the later of the two values it comes through is taken.
  template <bool kWeighted>
  void pass_on(Corner c, float u) {
    const Corner ca = s_.next(c), cb = s_.prev(c);
    const std::uint32_t a = s_.vertex(ca), b = s_.vertex(cb);
    const float ua = u_[a], ub = u_[b];
    const bool to_a = ua > u, to_b = ub > u;
    if (to_a || to_b) {
      const Vec3 at = s_.point(c);
      if (to_a) {
        const Vec3 edge = at - s_.point(ca);
        offer(a, static_cast<double>(u) + weight<kWeighted>(a) * norm(edge));
      }
      // The other triangle at this edge has done so if there is one.
      if (to_b && !s_.exists(s_.opposite(ca))) {
        const Vec3 edge = at - s_.point(cb);
        offer(b, static_cast<double>(u) + weight<kWeighted>(b) * norm(edge));
      }
      if (to_a) update<kWeighted>(ca, From::prev);
      if (to_b) update<kWeighted>(cb, From::next);
    }
    const Corner beyond = s_.opposite(c);
    if (s_.exists(beyond) && u_[s_.vertex(beyond)] > u) update<kWeighted>(beyond, From::beyond);
  }

  /// Whose value has just been taken, seen from a corner: another of its triangle, or the one
  /// beyond the edge that faces it.
  enum class From : std::uint8_t { next, prev, beyond };

  /// The vertex of c from what lies at and beyond the facing edge.
  template <bool kWeighted>
  void update(Corner c, From from) {
    const Corner ca = s_.next(c), cb = s_.prev(c);
    const bool has_a = u_[s_.vertex(ca)] <= taken_, has_b = u_[s_.vertex(cb)] <= taken_;
    const Corner apex = s_.opposite(c);
    const bool has_d = s_.exists(apex) && u_[s_.vertex(apex)] <= taken_;
    if (!has_a && !has_b) return;
    const Vec3 at = s_.point(c), ea = s_.point(ca) - at, eb = s_.point(cb) - at;
    const double p = dot(ea, ea), q = dot(ea, eb), r = dot(eb, eb);
    const double w = weight<kWeighted>(s_.vertex(c));
    if (q < 0.0 && update_unfolded(c, p, q, r, w)) return;
    if (has_a && has_b && from != From::beyond)
      offer(s_.vertex(c), wave(p, q, r, static_cast<double>(u_[s_.vertex(ca)]),
                               static_cast<double>(u_[s_.vertex(cb)]), w));
    if (q < 0.0 || !has_d) return;
    update_beyond(c, p, q, r, w, has_a && from != From::prev, has_b && from != From::next);
  }

  struct Flat {
    double x, y;
  };

  /// A splitting vertex beyond the first triangle that gets its value after A and B comes too
  /// late; measured on slivers of 170 degrees, that costs 1e-4 of the distance.
  /// @return false if no vertex splits the angle
  bool update_unfolded(Corner c, double p, double q, double r, double w) {
    // In the plane: C at the origin, A on the x axis, B to its left.
    const double ax = std::sqrt(p), bx = q / ax, by2 = r - bx * bx;
    if (!(by2 > 1e-12 * r)) return false;
    const Flat a{ax, 0.0}, b{bx, std::sqrt(by2)};
    Flat left = b, right = a;
    Corner cl = s_.prev(c), cr = s_.next(c), apex = s_.opposite(c);
    for (int hop = 0; hop < kMostHops && s_.exists(apex); ++hop) {
      const Flat d = unfolded(cr, cl, apex, right, left);
      const bool near_a = d.x >= 0.0, near_b = d.x * b.x + d.y * b.y >= 0.0;
      const std::uint32_t vd = s_.vertex(apex);
      if (near_a && near_b) {
        split(c, a, b, d, vd, w, true, true);
        return true;
      }
      // On through the edge that the right angles from both sides still pass.
      const std::uint32_t kept = s_.vertex(near_a ? cl : cr);
      const Corner same = s_.vertex(s_.next(apex)) == kept ? s_.next(apex) : s_.prev(apex);
      const Corner left_behind = s_.vertex(s_.next(apex)) == kept ? s_.prev(apex) : s_.next(apex);
      if (near_a) {
        right = d;
        cr = apex;
        cl = same;
      } else {
        left = d;
        cl = apex;
        cr = same;
      }
      apex = s_.opposite(left_behind);
    }
    return false;
  }

  /// Straight from the vertex beyond the facing edge, and waves between that and A or B: what one
  /// triangle takes for a bend of the front may be a bend of the surface.
  void update_beyond(Corner c, double p, double q, double r, double w, bool by_a, bool by_b) {
    const double ax = std::sqrt(p), bx = q / ax, by2 = r - bx * bx;
    if (!(by2 > 1e-12 * r)) return;
    const Flat a{ax, 0.0}, b{bx, std::sqrt(by2)};
    const Flat d = unfolded(s_.next(c), s_.prev(c), s_.opposite(c), a, b);
    if (d.y < 0.0 || d.x * b.y - d.y * b.x < 0.0) return;
    split(c, a, b, d, s_.vertex(s_.opposite(c)), w, by_a, by_b);
  }

  /// Beyond the edge between cr and cl, which lie at `right` and `left`.
  [[nodiscard]] Flat unfolded(Corner cr, Corner cl, Corner apex, Flat right, Flat left) const {
    const Vec3 from = s_.point(cr), edge = s_.point(cl) - from, to = s_.point(apex) - from;
    const double length2 = dot(edge, edge);
    const double along = dot(to, edge) / length2;
    const double off = std::sqrt(std::max(0.0, dot(to, to) / length2 - along * along));
    const Flat e{left.x - right.x, left.y - right.y};
    return {right.x + along * e.x + off * e.y, right.y + along * e.y - off * e.x};
  }

  void split(Corner c, Flat a, Flat b, Flat d, std::uint32_t vd, double w, bool by_a, bool by_b) {
    const std::uint32_t v = s_.vertex(c);
    const float u = u_[v], ua = u_[s_.vertex(s_.next(c))], ub = u_[s_.vertex(s_.prev(c))];
    const float ud = u_[vd];
    if (!(ud < u)) return;
    const double dd = d.x * d.x + d.y * d.y, from_d = static_cast<double>(ud);
    offer(v, from_d + w * std::sqrt(dd));
    if (by_a && ua < u)
      offer(v, wave(a.x * a.x, a.x * d.x, dd, static_cast<double>(ua), from_d, w));
    if (by_b && ub < u)
      offer(v, wave(dd, d.x * b.x + d.y * b.y, b.x * b.x + b.y * b.y, from_d,
                    static_cast<double>(ub), w));
  }

  const Surface& s_;
  std::span<const float> slowness_;
  std::span<float> u_;
  float exact_up_to_ = -1.0F;
  float taken_ = -1.0F;  // the largest so far: values up to it are
  bool round_ = false;
  FrontHeap heap_;
};

}  // namespace maquette::meshing::detail
