// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/detail/box_tree.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numeric>
#include <tuple>
#include <utility>

namespace maquette::camera::detail {
namespace {

/// A direction whose part along an axis may be smaller than this says nothing about when a box is
/// entered along it.
constexpr double kAcross = 1e-9;

std::array<double, 3> axes(Vec3 v) {
  return {v.x, v.y, v.z};
}

void hold(Box3& box, const Box3& part) {
  box.add(part.min);
  box.add(part.max);
}

/// Parts of nearly the same size, neighbours together.
using Part = std::span<std::uint32_t>;
void halve(std::span<const Box3> boxes, Part part, int times, std::vector<Part>& parts) {
  if (times == 0 || part.size() < 2) {
    if (!part.empty()) parts.push_back(part);
    return;
  }
  Box3 middles;
  for (const std::uint32_t i : part) middles.add(0.5 * (boxes[i].min + boxes[i].max));
  const auto size = axes(middles.max - middles.min);
  const auto axis =
      static_cast<std::size_t>(std::max_element(size.begin(), size.end()) - size.begin());
  const auto place = [&](std::uint32_t i) {
    return axes(boxes[i].min)[axis] + axes(boxes[i].max)[axis];
  };
  const std::size_t half = part.size() / 2;
  std::nth_element(part.begin(), part.begin() + static_cast<std::ptrdiff_t>(half), part.end(),
                   [&](std::uint32_t a, std::uint32_t b) {
                     return place(a) != place(b) ? place(a) < place(b) : a < b;
                   });
  halve(boxes, part.first(half), times - 1, parts);
  halve(boxes, part.subspan(half), times - 1, parts);
}

}  // namespace

BoxTree::Bundle::Bundle(const RayLanes& rays) {
  using Four = double __attribute__((vector_size(32)));
  static_assert(RayLanes::kCount == 16);
  const auto ends = [](const RayLanes::Lane& lane, double& least, double& most) {
    std::array<Four, 4> v;
    std::memcpy(v.data(), lane.data(), sizeof v);
    const auto less = [](Four x, Four y) { return x < y ? x : y; };
    const auto more = [](Four x, Four y) { return x > y ? x : y; };
    const Four low = less(less(v[0], v[1]), less(v[2], v[3]));
    const Four high = more(more(v[0], v[1]), more(v[2], v[3]));
    least = std::min(std::min(low[0], low[1]), std::min(low[2], low[3]));
    most = std::max(std::max(high[0], high[1]), std::max(high[2], high[3]));
  };
  ends(rays.origin_x, least_origin_[0], most_origin_[0]);
  ends(rays.origin_y, least_origin_[1], most_origin_[1]);
  ends(rays.origin_z, least_origin_[2], most_origin_[2]);
  ends(rays.way_x, least_way_[0], most_way_[0]);
  ends(rays.way_y, least_way_[1], most_way_[1]);
  ends(rays.way_z, least_way_[2], most_way_[2]);
  double shortest = 0.0;
  ends(rays.length, shortest, length_);
}

void BoxTree::Bundle::add(Vec3 origin, Vec3 direction, double length) {
  const auto o = axes(origin), d = axes(direction);
  for (std::size_t k = 0; k < 3; ++k) {
    least_origin_[k] = o[k] < least_origin_[k] ? o[k] : least_origin_[k];
    most_origin_[k] = o[k] > most_origin_[k] ? o[k] : most_origin_[k];
    least_way_[k] = d[k] < least_way_[k] ? d[k] : least_way_[k];
    most_way_[k] = d[k] > most_way_[k] ? d[k] : most_way_[k];
  }
  length_ = length > length_ ? length : length_;
}

BoxTree::Node::Node() {
  for (std::size_t k = 0; k < 3; ++k) {
    low[k].fill(std::numeric_limits<double>::infinity());
    high[k].fill(-std::numeric_limits<double>::infinity());
  }
}

BoxTree::BoxTree(std::span<const Box3> boxes) {
  std::vector<std::uint32_t> order(boxes.size());
  std::iota(order.begin(), order.end(), 0U);
  if (!boxes.empty()) build(boxes, order);
}

std::int32_t BoxTree::build(std::span<const Box3> boxes, std::span<std::uint32_t> order) {
  constexpr int kHalvings = 3;  // 2^3 parts
  static_assert(kBranch == 1U << kHalvings);
  const auto number = static_cast<std::int32_t>(nodes_.size());
  nodes_.emplace_back();
  std::vector<Part> parts;
  if (order.size() <= kBranch) {
    for (std::size_t i = 0; i < order.size(); ++i) parts.push_back(order.subspan(i, 1));
  } else {
    halve(boxes, order, kHalvings, parts);
  }
  for (std::size_t i = 0; i < parts.size(); ++i) {
    Box3 box;
    for (const std::uint32_t b : parts[i]) hold(box, boxes[b]);
    const std::int32_t child = parts[i].size() == 1 ? 0 : build(boxes, parts[i]);
    Node& node = nodes_[static_cast<std::size_t>(number)];
    const auto low = axes(box.min), high = axes(box.max);
    for (std::size_t k = 0; k < 3; ++k) node.low[k][i] = low[k], node.high[k][i] = high[k];
    node.child[i] = child;
  }
  return number;
}

bool BoxTree::may_meet(const Bundle& rays) const {
  if (nodes_.empty() || rays.empty()) return false;
  /// What is asked of the boxes along an axis, which is turned so that all rays go upwards.
  struct Axis {
    bool across = false, turned = false;
    double low = 0.0, high = 0.0;               ///< of origins; of all places, if across
    double by_fastest = 0.0, by_slowest = 0.0;  ///< one by the ends of the directions
  };
  std::array<Axis, 3> asked;
  for (std::size_t k = 0; k < 3; ++k) {
    Axis& a = asked[k];
    double slow = rays.least_way_[k], fast = rays.most_way_[k];
    a.low = rays.least_origin_[k], a.high = rays.most_origin_[k];
    if (slow < kAcross && fast > -kAcross) {
      a.across = true;
      if (slow < 0.0) a.low += slow * rays.length_;
      if (fast > 0.0) a.high += fast * rays.length_;
      continue;
    }
    if (fast < 0.0) {
      a.turned = true;
      std::tie(slow, fast) = std::pair{-fast, -slow};
      std::tie(a.low, a.high) = std::pair{-a.high, -a.low};
    }
    a.by_fastest = 1.0 / fast, a.by_slowest = 1.0 / slow;
  }
  std::array<std::int32_t, 128> open;  // seven wait on each of at most twelve levels
  std::size_t count = 0;
  open[count++] = 0;
  while (count > 0) {
    const Node& node = nodes_[static_cast<std::size_t>(open[--count])];
    Eight enter, leave;
    enter.fill(0.0);
    leave.fill(rays.length_);
    for (std::size_t k = 0; k < 3; ++k) {
      const Axis& a = asked[k];
      const double *low = node.low[k].data(), *high = node.high[k].data();
      if (a.across) {
        for (std::size_t i = 0; i < kBranch; ++i)
          leave[i] = low[i] <= a.high && high[i] >= a.low ? leave[i] : -1.0;
        continue;
      }
      const double sign = a.turned ? -1.0 : 1.0;
      if (a.turned) std::swap(low, high);
      for (std::size_t i = 0; i < kBranch; ++i) {
        const double to = sign * low[i] - a.high, past = sign * high[i] - a.low;
        const double to_fast = to * a.by_fastest, to_slow = to * a.by_slowest;
        const double past_fast = past * a.by_fastest, past_slow = past * a.by_slowest;
        const double first = to_fast < to_slow ? to_fast : to_slow;
        const double last = past_fast > past_slow ? past_fast : past_slow;
        enter[i] = first > enter[i] ? first : enter[i];
        leave[i] = last < leave[i] ? last : leave[i];
      }
    }
    for (std::size_t i = 0; i < kBranch; ++i) {
      if (!(enter[i] <= leave[i])) continue;
      if (node.child[i] == 0) return true;
      open[count++] = node.child[i];
    }
  }
  return false;
}

}  // namespace maquette::camera::detail
