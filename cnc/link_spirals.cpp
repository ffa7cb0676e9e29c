// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>
#include <optional>
#include <unordered_map>

#include <oneapi/tbb/parallel_for.h>

#include "cnc/level_curves.hpp"

namespace maquette::cnc {
namespace {

constexpr std::uint32_t kNone = ~std::uint32_t{0};

struct Vec2 {
  double x, y;
};
Vec2 of(PlanPlace p) {
  return {static_cast<double>(p.x), static_cast<double>(p.y)};
}
Vec2 between(Vec2 a, Vec2 b, double t) {
  return {a.x + t * (b.x - a.x), a.y + t * (b.y - a.y)};
}
double apart(Vec2 a, Vec2 b) {
  return std::hypot(b.x - a.x, b.y - a.y);
}

/// Segment i of a closed curve goes from place i to the next.
Vec2 segment_start(const LevelCurve& c, std::size_t i) {
  return of(c.places[i]);
}
Vec2 segment_end(const LevelCurve& c, std::size_t i) {
  return of(c.places[i + 1 < c.places.size() ? i + 1 : 0]);
}

/// A place on a closed curve.
struct OnCurve {
  std::uint32_t curve = kNone;
  std::size_t segment = 0;
  double share = 0.0;
  Vec2 at{0.0, 0.0};
};

/// Finds the nearest place of closed curves by square buckets as wide as the reach.
class NearestPlace {
 public:
  explicit NearestPlace(double reach) : reach_(reach) {}

  void add(const LevelCurve& curve, std::uint32_t name) {
    for (std::size_t i = 0; i < curve.places.size(); ++i) {
      const Vec2 a = segment_start(curve, i), b = segment_end(curve, i);
      const auto pieces = static_cast<int>(std::ceil(apart(a, b) / reach_)) + 1;
      std::uint64_t last = ~std::uint64_t{0};
      for (int k = 0; k <= pieces; ++k) {
        const Vec2 p = between(a, b, static_cast<double>(k) / pieces);
        const std::uint64_t key = bucket(cell(p.x), cell(p.y));
        if (key != last) buckets_[key].push_back({&curve, name, i});
        last = key;
      }
    }
  }

  [[nodiscard]] OnCurve find(Vec2 p) const {
    OnCurve best;
    double least = reach_;
    for (std::int64_t dy = -1; dy <= 1; ++dy)
      for (std::int64_t dx = -1; dx <= 1; ++dx) {
        const auto found = buckets_.find(bucket(cell(p.x) + dx, cell(p.y) + dy));
        if (found == buckets_.end()) continue;
        for (const Entry& e : found->second) {
          const Vec2 a = segment_start(*e.curve, e.segment), b = segment_end(*e.curve, e.segment);
          const double ux = b.x - a.x, uy = b.y - a.y, length2 = ux * ux + uy * uy;
          const double t =
              length2 > 0.0 ? std::clamp(((p.x - a.x) * ux + (p.y - a.y) * uy) / length2, 0.0, 1.0)
                            : 0.0;
          const Vec2 q = between(a, b, t);
          const double off = apart(p, q);
          if (off < least || (off == least && e.segment < best.segment && e.name == best.curve)) {
            least = off;
            best = {e.name, e.segment, t, q};
          }
        }
      }
    return best;
  }

 private:
  struct Entry {
    const LevelCurve* curve;
    std::uint32_t name;
    std::size_t segment;
  };
  [[nodiscard]] std::int64_t cell(double v) const {
    return static_cast<std::int64_t>(std::floor(v / reach_));
  }
  [[nodiscard]] static std::uint64_t bucket(std::int64_t x, std::int64_t y) {
    return static_cast<std::uint64_t>(x) << 32 ^ (static_cast<std::uint64_t>(y) & 0xffffffffU);
  }
  double reach_;
  std::unordered_map<std::uint64_t, std::vector<Entry>> buckets_;
};

/// Once round from `start`, both ends included, in steps of at most `step`.
std::vector<Vec2> round_trip(const LevelCurve& curve, const OnCurve& start, double step) {
  std::vector<Vec2> way{start.at};
  const std::size_t n = curve.places.size();
  const auto go = [&](Vec2 to) {
    const Vec2 from = way.back();
    const auto pieces = static_cast<int>(std::ceil(apart(from, to) / step));
    for (int k = 1; k <= pieces; ++k)
      way.push_back(between(from, to, static_cast<double>(k) / pieces));
  };
  for (std::size_t k = 1; k <= n; ++k) go(of(curve.places[(start.segment + k) % n]));
  go(start.at);
  return way;
}

PlanPlace rounded(Vec2 p) {
  return {static_cast<std::int32_t>(std::lround(p.x)), static_cast<std::int32_t>(std::lround(p.y))};
}

class Chain {
 public:
  Chain(double reach, double tolerance_mm) : reach_(reach), tolerance_mm_(tolerance_mm) {}

  /// Starts with curve `outer`, in full.
  void start(const LevelCurve& outer) {
    at_ = {0, 0, 0.0, of(outer.places.front())};
    way_ = round_trip(outer, at_, reach_);
    current_.places.clear();
    current_.turns = 1;
    append(way_);
  }
  /// @return false if the next curve is out of reach somewhere
  bool step(const LevelCurve& inner) {
    NearestPlace places(reach_);
    places.add(inner, 1);
    double length = 0.0;
    for (std::size_t i = 1; i < way_.size(); ++i) length += apart(way_[i - 1], way_[i]);
    std::vector<Vec2> turn;
    double gone = 0.0;
    OnCurve end;
    for (std::size_t i = 0; i < way_.size(); ++i) {
      if (i > 0) gone += apart(way_[i - 1], way_[i]);
      const OnCurve q = places.find(way_[i]);
      if (q.curve == kNone) return false;
      turn.push_back(between(way_[i], q.at, std::min(1.0, gone / length)));
      end = q;
    }
    append(turn);
    at_ = end;
    way_ = round_trip(inner, at_, reach_);
    ++current_.turns;
    return true;
  }
  PlanCurve finish() {
    if (current_.turns > 1) append(way_);
    return std::move(current_);
  }

 private:
  /// Reduced turn by turn: of a whole spiral that would take the square of its turns.
  void append(const std::vector<Vec2>& way) {
    std::vector<PlanPlace> turn;
    turn.reserve(way.size());
    for (const Vec2& p : way) turn.push_back(rounded(p));
    reduce_to_chords(turn, tolerance_mm_);
    for (const PlanPlace& p : turn)
      if (current_.places.empty() || !(current_.places.back() == p)) current_.places.push_back(p);
  }
  double reach_, tolerance_mm_;
  OnCurve at_;
  std::vector<Vec2> way_;
  PlanCurve current_;
};

}  // namespace

std::vector<PlanCurve> link_spirals(const std::vector<LevelCurve>& curves, double reach_mm,
                                    double tolerance_mm) {
  const double reach = 1000.0 * reach_mm;
  // Which curve of the level below each one lies in, and how many lie in each.
  std::vector<std::size_t> first_of;  // of each level
  for (std::size_t i = 0; i < curves.size(); ++i)
    while (first_of.size() <= curves[i].level) first_of.push_back(i);
  first_of.push_back(curves.size());
  std::vector<std::uint32_t> outer(curves.size(), kNone), children(curves.size(), 0),
      only_child(curves.size(), kNone);
  if (first_of.size() > 2)
    oneapi::tbb::parallel_for(std::size_t{1}, first_of.size() - 1, [&](std::size_t level) {
      NearestPlace places(reach);
      for (std::size_t i = first_of[level - 1]; i < first_of[level]; ++i)
        if (curves[i].closed) places.add(curves[i], static_cast<std::uint32_t>(i));
      for (std::size_t i = first_of[level]; i < first_of[level + 1]; ++i)
        if (curves[i].closed) outer[i] = places.find(of(curves[i].places.front())).curve;
    });
  for (std::size_t i = 0; i < curves.size(); ++i)
    if (outer[i] != kNone) {
      ++children[outer[i]];
      only_child[outer[i]] = static_cast<std::uint32_t>(i);
    }

  std::vector<PlanCurve> ways;
  std::vector<bool> done(curves.size(), false);
  for (std::size_t i = 0; i < curves.size(); ++i) {
    if (done[i]) continue;
    if (!curves[i].closed) {
      ways.push_back({curves[i].places, 1});
      continue;
    }
    Chain chain(reach, tolerance_mm);
    chain.start(curves[i]);
    for (std::size_t at = i;;) {
      done[at] = true;
      if (children[at] != 1) break;
      const std::uint32_t inner = only_child[at];
      if (done[inner] || !chain.step(curves[inner])) break;
      at = inner;
    }
    ways.push_back(chain.finish());
  }
  return ways;
}

}  // namespace maquette::cnc
