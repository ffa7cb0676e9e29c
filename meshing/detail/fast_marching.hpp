// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file fast_marching.hpp
/// The march of geodesic.hpp on a surface of corner_surface.hpp.

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <span>
#include <utility>
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

/// A place in the plane of unfolded triangles.
struct Flat {
  double x, y;
};
[[nodiscard]] inline double crossed(Flat a, Flat b) {
  return a.x * b.y - a.y * b.x;
}

/// What comes to a vertex C through an edge: how far from, and `back`: towards where from.
struct Wave {
  bool comes = false;
  double distance2 = INFINITY;  ///< squared
  Flat back{0.0, 0.0};
};

/// Through the edge from P to Q, C at the origin on its left, and between the directions `right`
/// and `left`: round, of slowness 1, about the place beyond the edge that has the distances a and b
/// from P and Q. Exact for one point on developable surfaces.
[[nodiscard, gnu::always_inline]] inline Wave round_wave(Flat p, Flat q, double a, double b,
                                                         Flat right, Flat left) {
  const Flat e{q.x - p.x, q.y - p.y};
  const double per = 1.0 / (e.x * e.x + e.y * e.y);
  // The centre along PQ and beyond it, in lengths of PQ.
  const double t = 0.5 + 0.5 * (a * a - b * b) * per, h2 = a * a * per - t * t;
  if (!(h2 >= 0.0)) return {};
  const double h = std::sqrt(h2);
  const Flat centre{p.x + t * e.x + h * e.y, p.y + t * e.y - h * e.x};
  if (crossed(right, centre) < 0.0 || crossed(centre, left) < 0.0) return {};
  return {true, centre.x * centre.x + centre.y * centre.y, centre};
}

/// The same of a plane wave of slowness w: its gradient has the values a and b at P and Q.
[[nodiscard]] inline Wave plane_wave(Flat p, Flat q, double a, double b, double w, Flat right,
                                     Flat left) {
  const Flat e{q.x - p.x, q.y - p.y};
  const double per = 1.0 / (e.x * e.x + e.y * e.y), t = (b - a) / w * per, h2 = per - t * t;
  if (!(h2 >= 0.0)) return {};
  const double h = std::sqrt(h2);
  const Flat back{h * e.y - t * e.x, -h * e.x - t * e.y};  // unit
  if (crossed(right, back) < 0.0 || crossed(back, left) < 0.0) return {};
  const double d = a + w * (p.x * back.x + p.y * back.y);
  if (d < a || d < b) return {};
  return {true, d * d, back};
}

template <class Surface>
class FastMarching {
 public:
  /// @param distance  one a vertex; filled by run()
  /// @param slowness  one a vertex, or empty
  FastMarching(const Surface& surface, std::span<const float> slowness, std::span<float> distance)
      : s_(surface), slowness_(slowness), u_(distance), seeded_(distance.size()) {
    std::fill(u_.begin(), u_.end(), -INFINITY);
  }

  /// A value that vertex v has at most: the length of a real way.
  void seed(std::uint32_t v, double value) {
    seeded_[v] = true;
    seeds_.emplace_back(v, static_cast<float>(value));
    offer(v, value);
  }

  /// Values up to here are exact; the march only adds the others. Where two waves meet it would
  /// take them for one and come out too short.
  void keep_up_to(double distance) { exact_up_to_ = static_cast<float>(distance); }

  /// Waves are round, as from points; else plane, as from lines.
  void round_waves(bool round) { round_ = round; }

  [[nodiscard]] double value(std::uint32_t v) const { return std::abs(static_cast<double>(u_[v])); }

  /// @return false if the run was stopped
  bool run(double max_distance, const RunContext& run) {
    std::sort(seeds_.begin(), seeds_.end());
    if (!slowness_.empty()) return march<true, false>(max_distance, run);
    return round_ ? march<false, true>(max_distance, run) : march<false, false>(max_distance, run);
  }

 private:
  using Corner = typename Surface::Corner;
  static constexpr int kMostHops = 16;
  /// Triangles that a line is followed back through. An error of a value along the edge where it
  /// ends is made once for all of them. Measured where facets turn by 33 degrees: with 0, 2, 5 and
  /// 16 at worst 1.4, 1.3, 0.8 and 0.8 %.
  static constexpr int kLookBack = 5;

  /// Values that stay are positive, guesses negative; exact ones stay from the beginning.
  [[nodiscard]] bool known(std::uint32_t v) const { return u_[v] >= -exact_up_to_; }

  void offer(std::uint32_t v, double value) {
    const auto rounded = static_cast<float>(value);
    if (!(rounded < -u_[v]) || -u_[v] <= exact_up_to_) return;
    u_[v] = -rounded;
    heap_.push(rounded, v);
  }

  [[nodiscard]] static double distance(const Wave& wave) { return std::sqrt(wave.distance2); }

  template <bool kWeighted>
  [[nodiscard]] double weight(std::uint32_t v) const {
    if constexpr (kWeighted) return static_cast<double>(slowness_[v]);
    return 1.0;
  }
  template <bool kRound>
  [[nodiscard]] static Wave wave(Flat p, Flat q, double a, double b, double w, Flat right,
                                 Flat left) {
    if constexpr (kRound) return round_wave(p, q, a, b, right, left);
    return plane_wave(p, q, a, b, w, right, left);
  }

  template <bool kWeighted, bool kRound>
  bool march(double max_distance, const RunContext& run) {
    constexpr std::uint64_t kVerticesPerLook = std::uint64_t{1} << 16;
    std::uint64_t looked = 0;
    while (!heap_.empty()) {
      const float guess = heap_.distance();
      const std::uint32_t v = heap_.vertex();
      heap_.pop();
      if (guess != -u_[v]) continue;
      if (static_cast<double>(guess) > max_distance) break;
      if (++looked % kVerticesPerLook == 0) {
        if (run.stopped()) return false;
        run.progress(
            std::min(1.0, static_cast<double>(looked) / static_cast<double>(s_.vertices())));
      }
      u_[v] = guess > exact_up_to_ ? settled<kWeighted, kRound>(v, guess) : guess;
      const float u = u_[v];
      s_.for_each_corner(v, [&](Corner c) { pass_on<kWeighted, kRound>(c, u); });
    }
    for (float& u : u_)
      if (std::signbit(u) || static_cast<double>(u) > max_distance) u = INFINITY;
    return true;
  }

  // ---- guesses: when a vertex gets its turn -------------------------------------------------

  /// From the vertex of c, whose value is u, to the rest of its triangle.
  template <bool kWeighted, bool kRound>
  void pass_on(Corner c, float u) {
    const Corner ca = s_.next(c), cb = s_.prev(c);
    const std::uint32_t a = s_.vertex(ca), b = s_.vertex(cb);
    const bool to_a = !known(a), to_b = !known(b);
    if (!to_a || !to_b) {  // what an obtuse angle beyond the facing edge waits for may be this
      const Corner beyond = s_.opposite(c);
      if (s_.exists(beyond) && !known(s_.vertex(beyond))) guess<kWeighted, kRound>(beyond, false);
    }
    if (!to_a && !to_b) return;
    const Vec3 at = s_.point(c);
    if (to_a) {
      along_edge(a, u, at - s_.point(ca), weight<kWeighted>(a));
      guess<kWeighted, kRound>(ca, !to_b);
    }
    if (to_b) {
      along_edge(b, u, at - s_.point(cb), weight<kWeighted>(b));
      guess<kWeighted, kRound>(cb, !to_a);
    }
  }

  /// Both triangles of an edge say the same; the second time costs no root.
  void along_edge(std::uint32_t to, float from, Vec3 edge, double w) {
    const double u = static_cast<double>(from), room = value(to) - u;
    const double length2 = w * w * dot(edge, edge);
    if (room * room > length2) offer(to, u + std::sqrt(length2));
  }

  /// The vertex of c from what lies at and beyond the facing edge. @param both  ends of it are
  /// known
  template <bool kWeighted, bool kRound>
  void guess(Corner c, bool both) {
    const Corner ca = s_.next(c), cb = s_.prev(c);
    const Vec3 at = s_.point(c), ea = s_.point(ca) - at, eb = s_.point(cb) - at;
    const double q = dot(ea, eb);
    if (!both && q >= 0.0) return;
    const std::uint32_t v = s_.vertex(c);
    if (kRound && !kWeighted && q >= 0.0) {
      guess_round(v, dot(ea, ea), q, dot(eb, eb), value(s_.vertex(ca)), value(s_.vertex(cb)));
      return;
    }
    Flat a, b;
    if (!lay_out(dot(ea, ea), q, dot(eb, eb), a, b)) return;
    const double w = weight<kWeighted>(v);
    if (q < 0.0 && split_obtuse<kRound>(c, a, b, w)) return;
    if (both)
      offer(v, distance(wave<kRound>(a, b, value(s_.vertex(ca)), value(s_.vertex(cb)), w, a, b)));
  }

  /// The same where no angle is obtuse and the wave is round, by squares and products of the edges
  /// from C alone: in the plane of the triangle A at 0, B at e, C at (X, p) / e and the centre at
  /// (S, -q) / e, where the line between them must cross AB.
  void guess_round(std::uint32_t v, double aa, double ab, double bb, double ua, double ub) {
    const double e2 = aa + bb - 2.0 * ab, x = aa - ab, p2 = aa * bb - ab * ab;
    const double s = 0.5 * ((ua - ub) * (ua + ub) + e2), q2 = ua * ua * e2 - s * s;
    if (!(p2 > 1e-12 * aa * bb) || !(q2 >= 0.0)) return;
    const double p = std::sqrt(p2), q = std::sqrt(q2);
    if (s * p + x * q < 0.0 || (e2 - s) * p + (e2 - x) * q < 0.0) return;
    const double d2 = aa + ua * ua + 2.0 * (p * q - x * s) / e2, now = value(v);
    if (d2 < now * now) offer(v, std::sqrt(d2));
  }

  /// C at the origin, A on the x axis, B to its left, by the products AA, AB, BB of the edge
  /// vectors from C. @return false for a triangle without area
  [[nodiscard]] static bool lay_out(double aa, double ab, double bb, Flat& a, Flat& b) {
    const double ax = std::sqrt(aa), bx = ab / ax, by2 = bb - bx * bx;
    if (!(by2 > 1e-12 * bb)) return false;
    a = {ax, 0.0};
    b = {bx, std::sqrt(by2)};
    return true;
  }

  /// A vertex beyond the facing edge that splits an obtuse angle, and what comes from it. If it
  /// gets its value after A and B it comes too late; measured on slivers of 170 degrees, that costs
  /// 1e-4 of the distance. @return false if there is none
  template <bool kRound>
  bool split_obtuse(Corner c, Flat a, Flat b, double w) {
    Flat left = b, right = a;
    Corner cl = s_.prev(c), cr = s_.next(c), apex = s_.opposite(c);
    for (int hop = 0; hop < kMostHops && s_.exists(apex); ++hop) {
      const Flat d = unfolded(cr, cl, apex, right, left);
      const bool near_a = d.x >= 0.0, near_b = d.x * b.x + d.y * b.y >= 0.0;
      const std::uint32_t vd = s_.vertex(apex);
      if (near_a && near_b) {
        const std::uint32_t v = s_.vertex(c), va = s_.vertex(s_.next(c)),
                            vb = s_.vertex(s_.prev(c));
        const double ud = value(vd);
        double least = ud + w * std::sqrt(d.x * d.x + d.y * d.y);
        if (known(va))
          least = std::min(least, distance(wave<kRound>(a, d, value(va), ud, w, a, d)));
        if (known(vb))
          least = std::min(least, distance(wave<kRound>(d, b, ud, value(vb), w, d, b)));
        offer(v, least);
        return true;
      }
      // On through the edge that the right angles from both sides still pass.
      const Edge on = beyond(apex, near_a ? cl : cr);
      (near_a ? right : left) = d;
      cr = near_a ? apex : on.kept;
      cl = near_a ? on.kept : apex;
      apex = on.apex;
    }
    return false;
  }

  // ---- values: along lines that are followed back -------------------------------------------

  /// Guesses of round waves do not count here: they take two fronts for one wave.
  template <bool kWeighted, bool kRound>
  [[nodiscard]] float settled(std::uint32_t v, float guess) const {
    const double w = weight<kWeighted>(v);
    double least = seeded_[v] ? seed_of(v) : INFINITY;
    bool waits_for_one = false;  // an obtuse angle of which one side has no value yet
    s_.for_each_corner(v, [&](Corner c) {
      const Corner ca = s_.next(c), cb = s_.prev(c);
      const std::uint32_t va = s_.vertex(ca), vb = s_.vertex(cb);
      const bool has_a = known(va), has_b = known(vb);
      if (!has_a && !has_b) return;
      const Vec3 at = s_.point(c), ea = s_.point(ca) - at, eb = s_.point(cb) - at;
      const double aa = dot(ea, ea), ab = dot(ea, eb), bb = dot(eb, eb);
      Flat a, b;
      if (!has_a || !has_b)
        waits_for_one |= ab < 0.0;
      else if (lay_out(aa, ab, bb, a, b))
        least = std::min(least, followed_back<kWeighted, kRound>(
                                    {ca, cb, s_.opposite(c), a, b, a, b, value(va), value(vb)}, w));
      if (has_a) lower(least, value(va), w * w * aa);
      if (has_b) lower(least, value(vb), w * w * bb);
    });
    // Seeds beside a segment are nearest to a piece of it; the guess knows its neighbours. Obtuse
    // angles may be split by a vertex that is not followed here.
    bool keep_guess = (!kRound && seeded_[v]) || !(least < INFINITY);
    if (waits_for_one && static_cast<double>(guess) < least)
      s_.for_each_corner(
          v, [&](Corner c) { keep_guess |= !through_one_side<kWeighted, kRound>(c, w, least); });
    if (keep_guess) least = std::min(least, static_cast<double>(guess));
    return static_cast<float>(least);
  }

  [[nodiscard]] double seed_of(std::uint32_t v) const {
    const auto least = std::lower_bound(seeds_.begin(), seeds_.end(), std::pair{v, 0.0F});
    return static_cast<double>(least->second);
  }

  /// To what comes straight from a place of value u.
  static void lower(double& least, double u, double length2) {
    const double room = least - u;
    if (room > 0.0 && room * room > length2) least = u + std::sqrt(length2);
  }

  /// Between P and Q, the edge that a line to C at the origin crosses: their corners in the
  /// triangle on C's side, the corner beyond, and the directions between which C sees the edge.
  struct Strip {
    Corner cr, cl, apex;
    Flat p, q, right, left;
    double up, uq;
  };
  /// On over the edge from P or, if not `by_right`, from Q to the apex beyond, D, of value ud.
  void cross_triangle(Strip& s, Flat d, double ud, bool by_right) const {
    const Edge on = beyond(s.apex, by_right ? s.cr : s.cl);
    if (by_right) {
      if (crossed(d, s.left) >= 0.0) s.left = d;
      s.q = d;
      s.uq = ud;
      s.cl = s.apex;
      s.cr = on.kept;
    } else {
      if (crossed(s.right, d) >= 0.0) s.right = d;
      s.p = d;
      s.up = ud;
      s.cr = s.apex;
      s.cl = on.kept;
    }
    s.apex = on.apex;
  }

  /// At C: the wave through the last edge that its line crosses, so far as values are known, and
  /// what comes straight from vertices that the line passes.
  template <bool kWeighted, bool kRound>
  [[nodiscard]] double followed_back(Strip s, double w) const {
    Wave from = wave<kRound>(s.p, s.q, s.up, s.uq, w, s.right, s.left);
    double direct = INFINITY;
    // Plane waves are exact where round ones have to be found out; slowness is that of C.
    for (int hop = 0; hop < (kRound ? kLookBack : 1) && from.comes && s_.exists(s.apex); ++hop) {
      if (!known(s_.vertex(s.apex))) break;
      const double ud = value(s_.vertex(s.apex));
      const Flat d = unfolded(s.cr, s.cl, s.apex, s.p, s.q);
      const bool seen_r = crossed(s.right, d) >= 0.0, seen_l = crossed(d, s.left) >= 0.0;
      if (seen_r && seen_l) lower(direct, ud, w * w * (d.x * d.x + d.y * d.y));
      const auto through = [&](bool by_right) {
        if (by_right)
          return seen_r ? wave<kRound>(s.p, d, s.up, ud, w, s.right, seen_l ? d : s.left) : Wave{};
        return seen_l ? wave<kRound>(d, s.q, ud, s.uq, w, seen_r ? d : s.right, s.left) : Wave{};
      };
      bool by_right = crossed(from.back, d) >= 0.0;  // where the line has passed D
      Wave next = through(by_right);
      if (!next.comes) {
        by_right = !by_right;
        next = through(by_right);
      }
      if (!next.comes) {
        // Where it comes through neither side right beyond AB, A and B have it from two fronts.
        // Farther back that is as often an error of the values: to take none of these makes more
        // too long than it saves from being too short.
        if (hop == 0) return direct;
        break;
      }
      from = next;
      cross_triangle(s, d, ud, by_right);
    }
    return std::min(distance(from), direct);
  }

  /// Lowers `least` where the angle at C is obtuse and only A or only B has its value: by what
  /// comes through AB from the edge between that one and the apex beyond.
  /// @return false if that apex splits the angle into no two that are not obtuse
  template <bool kWeighted, bool kRound>
  bool through_one_side(Corner c, double w, double& least) const {
    const Corner ca = s_.next(c), cb = s_.prev(c), apex = s_.opposite(c);
    const bool has_a = known(s_.vertex(ca)), has_b = known(s_.vertex(cb));
    if (has_a == has_b || !s_.exists(apex) || !known(s_.vertex(apex))) return true;
    const Vec3 at = s_.point(c), ea = s_.point(ca) - at, eb = s_.point(cb) - at;
    const double ab = dot(ea, eb);
    Flat a, b;
    if (ab >= 0.0 || !lay_out(dot(ea, ea), ab, dot(eb, eb), a, b)) return true;
    const double ud = value(s_.vertex(apex));
    const Flat d = unfolded(ca, cb, apex, a, b);
    if (d.x < 0.0 || d.x * b.x + d.y * b.y < 0.0) return false;
    lower(least, ud, w * w * (d.x * d.x + d.y * d.y));
    Strip s{ca, cb, apex, a, b, a, b, value(s_.vertex(ca)), value(s_.vertex(cb))};
    cross_triangle(s, d, ud, has_a);
    least = std::min(least, followed_back<kWeighted, kRound>(s, w));
    return true;
  }

  // ---- unfolding ----------------------------------------------------------------------------

  /// Of a triangle entered over the edge that faces `apex`: the edge on from its apex to an end of
  /// that edge, that end's corner in it, and the corner beyond.
  struct Edge {
    Corner kept, apex;
  };
  [[nodiscard, gnu::always_inline]] Edge beyond(Corner apex, Corner end) const {
    const Corner next = s_.next(apex), prev = s_.prev(apex);
    const bool is_next = s_.vertex(next) == s_.vertex(end);
    return {is_next ? next : prev, s_.opposite(is_next ? prev : next)};
  }

  /// The apex beyond the edge between cr and cl, which lie at `right` and `left`.
  [[nodiscard, gnu::always_inline]] Flat unfolded(Corner cr, Corner cl, Corner apex, Flat right,
                                                  Flat left) const {
    const Vec3 from = s_.point(cr), edge = s_.point(cl) - from, to = s_.point(apex) - from;
    const double per = 1.0 / dot(edge, edge);
    const double along = dot(to, edge) * per;
    const double off = std::sqrt(std::max(0.0, dot(to, to) * per - along * along));
    const Flat e{left.x - right.x, left.y - right.y};
    return {right.x + along * e.x + off * e.y, right.y + along * e.y - off * e.x};
  }

  const Surface& s_;
  std::span<const float> slowness_;
  std::span<float> u_;
  std::vector<bool> seeded_;
  std::vector<std::pair<std::uint32_t, float>> seeds_;  // by vertex, the least first
  float exact_up_to_ = 0.0F;
  bool round_ = false;
  FrontHeap heap_;
};

}  // namespace maquette::meshing::detail
