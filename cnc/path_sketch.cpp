// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/path_sketch.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "core/check.hpp"

namespace maquette::cnc {
namespace {

constexpr double kBehind = 4.0;             // cells of way after which path is earlier path
constexpr double kFineShare = 1.0 / 500.0;  // of the cell
constexpr std::size_t kLongestRun = 4096;   // raw points

std::uint64_t box_of(std::int64_t x, std::int64_t y, std::int64_t z) {
  constexpr std::int64_t kHalf = std::int64_t{1} << 20, kMask = (std::int64_t{1} << 21) - 1;
  return static_cast<std::uint64_t>((x + kHalf) & kMask) << 42 |
         static_cast<std::uint64_t>((y + kHalf) & kMask) << 21 |
         static_cast<std::uint64_t>((z + kHalf) & kMask);
}

double distance_mm(Vec3 p, Vec3 a, Vec3 b) {
  const Vec3 d = b - a, v = p - a;
  const double dd = dot(d, d);
  const double t = dd > 0.0 ? std::clamp(dot(v, d) / dd, 0.0, 1.0) : 0.0;
  return norm(v - t * d);
}

/// Douglas and Peucker; spans longer than `longest` are halved too. No recursion: runs are long.
template <class Point>
std::vector<Point> simplified(const std::vector<Point>& points, double deviation_mm,
                              double longest_mm) {
  if (points.size() < 3) return points;
  std::vector<char> stays(points.size(), 0);
  stays.front() = stays.back() = 1;
  std::vector<std::pair<std::size_t, std::size_t>> open{{0, points.size() - 1}};
  while (!open.empty()) {
    const auto [i, j] = open.back();
    open.pop_back();
    if (j < i + 2) continue;
    double most = -1.0;
    std::size_t split = i + 1;
    for (std::size_t k = i + 1; k < j; ++k) {
      const double d = distance_mm(points[k].at_mm, points[i].at_mm, points[j].at_mm);
      if (d > most) {
        most = d;
        split = k;
      }
    }
    if (most <= deviation_mm) {
      const double length = points[j].length - points[i].length;
      if (length <= longest_mm) continue;
      const auto middle = std::partition_point(
          points.begin() + static_cast<std::ptrdiff_t>(i) + 1,
          points.begin() + static_cast<std::ptrdiff_t>(j) - 1,
          [&](const Point& p) { return p.length < points[i].length + 0.5 * length; });
      split = static_cast<std::size_t>(middle - points.begin());
    }
    stays[split] = 1;
    open.emplace_back(i, split);
    open.emplace_back(split, j);
  }
  std::vector<Point> result;
  for (std::size_t k = 0; k < points.size(); ++k)
    if (stays[k] != 0) result.push_back(points[k]);
  return result;
}

}  // namespace

PathSketch::PathSketch(const SketchOptions& options)
    : o_(options), fine_mm_(kFineShare * options.cell_mm) {
  MAQUETTE_CHECK(o_.cell_mm > 0.0 && o_.most_points >= 2 && o_.longest_mm > 0.0,
                 "cells of {} mm, {} points, segments of {} mm", o_.cell_mm, o_.most_points,
                 o_.longest_mm);
}

bool PathSketch::is_new(Vec3 at, bool rapid) {
  const auto index = [](double mm, double size) {
    return static_cast<std::int64_t>(std::floor(std::clamp(mm / size, -1e6, 1e6)));
  };
  const std::int64_t x = index(at.x, o_.cell_mm), y = index(at.y, o_.cell_mm),
                     z = index(at.z, 0.5 * o_.cell_mm);
  const std::uint64_t box = box_of(x, y, z);
  if (box == last_box_ && rapid == last_rapid_)
    return last_new_ = last_new_ && travelled_ - last_first_ <= kBehind * o_.cell_mm;
  auto& first = rapid ? first_rapid_ : first_cut_;
  bool fresh = true;
  for (const std::int64_t dz : {-1, 1})
    if (const auto known = first.find(box_of(x, y, z + dz)); known != first.end())
      fresh = fresh && travelled_ - known->second <= kBehind * o_.cell_mm;
  if (const auto known = first.find(box); known != first.end()) {
    fresh = fresh && travelled_ - known->second <= kBehind * o_.cell_mm;
    last_first_ = known->second;
  } else if (fresh) {  // what is not kept stands in nobody's way
    first.emplace(box, travelled_);
    last_first_ = travelled_;
  }
  last_box_ = box;
  last_rapid_ = rapid;
  return last_new_ = fresh;
}

void PathSketch::close() {
  if (open_.points.size() >= 2) {
    const double longest = open_.rapid ? INFINITY : o_.longest_mm;
    kept_.push_back({open_.rapid, simplified(open_.points, fine_mm_, longest)});
    kept_.back().points.shrink_to_fit();
  }
  open_.points.clear();
}

void PathSketch::add(const Motion& motion, double removed_mm3) {
  const bool rapid = motion.kind == Motion::Kind::rapid;
  const double whole = length_mm(motion);
  const double engagement = whole > 0.0 && !rapid ? removed_mm3 / whole : 0.0;
  if (!open_.points.empty() &&
      (open_.rapid != rapid || !(open_.points.back().at_mm == motion.from_mm)))
    close();
  for_each_chord(motion, fine_mm_, [&](Vec3 from, Vec3 to) {
    const double chord = norm(to - from);
    const double pieces = std::clamp(std::ceil(chord / (0.5 * o_.cell_mm)), 1.0, 1e7);
    const double piece = chord / pieces;
    for (double k = 1.0; k <= pieces; k += 1.0) {
      const Vec3 begin = from + (k - 1.0) / pieces * (to - from);
      const Vec3 end = k == pieces ? to : from + k / pieces * (to - from);
      const bool keep = is_new(0.5 * (begin + end), rapid);
      travelled_ += piece;
      if (!keep) {
        close();
        continue;
      }
      if (open_.points.empty()) {
        open_.rapid = rapid;
        open_.points.push_back({begin, 0.0, 0.0, 0.0});
      }
      const Raw& last = open_.points.back();
      open_.points.push_back({end, last.length + piece,
                              last.feed_length + piece * motion.feed_mm_min,
                              last.volume + piece * engagement});
      if (open_.points.size() < kLongestRun) continue;
      const Raw here = open_.points.back();
      close();
      open_.points.push_back({here.at_mm, 0.0, 0.0, 0.0});
    }
  });
}

Sketch PathSketch::finish() {
  close();
  const auto count = [](const std::vector<Kept>& runs) {
    return std::accumulate(runs.begin(), runs.end(), std::size_t{0},
                           [](std::size_t n, const Kept& run) { return n + run.points.size(); });
  };
  Sketch sketch;
  sketch.cell_mm = o_.cell_mm;
  // Arcs became chords within fine_mm_ of them before the first simplification.
  sketch.deviation_mm = 2.0 * fine_mm_;
  std::vector<Kept> runs = kept_;
  double longest = o_.longest_mm;
  for (double deviation = fine_mm_; count(runs) > o_.most_points && deviation <= o_.cell_mm;) {
    deviation *= 1.4;
    longest *= 1.1;
    for (std::size_t i = 0; i < runs.size(); ++i)
      runs[i].points = simplified(kept_[i].points, deviation, runs[i].rapid ? INFINITY : longest);
    sketch.deviation_mm = 2.0 * fine_mm_ + deviation;
  }
  if (std::size_t points = count(runs); points > o_.most_points) {
    std::vector<std::size_t> order(runs.size());
    std::iota(order.begin(), order.end(), std::size_t{0});
    std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
      return runs[a].points.back().length < runs[b].points.back().length;
    });
    for (const std::size_t i : order) {
      if (points <= o_.most_points) break;
      points -= runs[i].points.size();
      sketch.left_out_mm += runs[i].points.back().length;
      runs[i].points.clear();
    }
  }
  for (const Kept& run : runs) {
    if (run.points.empty()) continue;
    SketchRun out{run.rapid, {}};
    for (std::size_t k = 0; k < run.points.size(); ++k) {
      SketchPoint p{run.points[k].at_mm, 0.0, 0.0};
      if (k > 0) {
        const Raw &a = run.points[k - 1], &b = run.points[k];
        if (const double length = b.length - a.length; length > 0.0) {
          p.feed_mm_min = (b.feed_length - a.feed_length) / length;
          p.engagement_mm2 = (b.volume - a.volume) / length;
        }
      }
      out.points.push_back(p);
    }
    sketch.points += out.points.size();
    sketch.runs.push_back(std::move(out));
  }
  return sketch;
}

}  // namespace maquette::cnc
