// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/triangle_tree.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/parallel_sort.h>

#include "core/check.hpp"

namespace maquette::cnc {
namespace {

struct Outline {  // seen from above
  double x0 = INFINITY, x1 = -INFINITY, y0 = INFINITY, y1 = -INFINITY, top = -INFINITY;
  void add(const Vec3& v) {
    x0 = std::min(x0, v.x);
    x1 = std::max(x1, v.x);
    y0 = std::min(y0, v.y);
    y1 = std::max(y1, v.y);
    top = std::max(top, v.z);
  }
};

float rounded_down(double v) {
  const auto f = static_cast<float>(v);
  return static_cast<double>(f) <= v ? f : std::nextafter(f, -INFINITY);
}
float rounded_up(double v) {
  const auto f = static_cast<float>(v);
  return static_cast<double>(f) >= v ? f : std::nextafter(f, INFINITY);
}

std::uint32_t spread(std::uint32_t v) {  // bit i to bit 2 i, of 14 bits
  v = (v | v << 8) & 0x00ff00ffU;
  v = (v | v << 4) & 0x0f0f0f0fU;
  v = (v | v << 2) & 0x33333333U;
  return (v | v << 1) & 0x55555555U;
}

constexpr TriangleTree::Node empty_node() {
  TriangleTree::Node node{};
  for (std::size_t k = 0; k < kLanes; ++k) {
    node.x0[k] = node.y0[k] = std::numeric_limits<float>::infinity();
    node.x1[k] = node.y1[k] = node.top[k] = -std::numeric_limits<float>::infinity();
  }
  return node;
}

}  // namespace

TriangleTree::TriangleTree(const TriMesh& mesh) {
  const std::size_t n = mesh.triangles.size();
  MAQUETTE_CHECK(n > 0 && n < std::numeric_limits<std::uint32_t>::max(), "{} triangles", n);
  const auto outline = [&](std::uint32_t t) {
    Outline box;
    for (const std::uint32_t v : mesh.triangles[t]) box.add(mesh.vertices_mm[v]);
    return box;
  };
  Outline whole;
  for (const Vec3& v : mesh.vertices_mm) whole.add(v);
  const double width = std::max({whole.x1 - whole.x0, whole.y1 - whole.y0, 1e-300});
  // Large triangles (bases, walls) apart from small ones, whose boxes they would blow up.
  const double usual = width / std::sqrt(static_cast<double>(n));

  constexpr double kPlaces = 16383.0;
  std::vector<std::uint64_t> keys(n);
  oneapi::tbb::parallel_for(std::size_t{0}, n, [&](std::size_t t) {
    const Outline box = outline(static_cast<std::uint32_t>(t));
    const double size = std::max(box.x1 - box.x0, box.y1 - box.y0) / usual;
    const std::uint64_t rank = size < 8.0 ? 0 : size < 64.0 ? 1 : size < 512.0 ? 2 : 3;
    const auto place = [&](double a, double b, double from) {
      return spread(static_cast<std::uint32_t>((0.5 * (a + b) - from) / width * kPlaces));
    };
    const std::uint64_t curve = place(box.x0, box.x1, whole.x0) | place(box.y0, box.y1, whole.y0)
                                                                      << 1;
    keys[t] = (rank << 28 | curve) << 32 | t;
  });
  oneapi::tbb::parallel_sort(keys.begin(), keys.end());
  order_.resize(n);
  for (std::size_t i = 0; i < n; ++i) order_[i] = static_cast<std::uint32_t>(keys[i]);
  keys = {};

  const std::size_t groups = (n + kLanes - 1) / kLanes;
  levels_.emplace_back((groups + kLanes - 1) / kLanes, empty_node());
  oneapi::tbb::parallel_for(std::size_t{0}, levels_[0].size(), [&](std::size_t i) {
    for (std::size_t k = 0; k < kLanes && i * kLanes + k < groups; ++k) {
      Outline box;
      for (const std::uint32_t t : group(i * kLanes + k))
        for (const std::uint32_t v : mesh.triangles[t]) box.add(mesh.vertices_mm[v]);
      Node& node = levels_[0][i];
      node.x0[k] = rounded_down(box.x0);
      node.x1[k] = rounded_up(box.x1);
      node.y0[k] = rounded_down(box.y0);
      node.y1[k] = rounded_up(box.y1);
      node.top[k] = rounded_up(box.top);
    }
  });
  while (levels_.back().size() > 1) {
    const std::vector<Node>& below = levels_.back();
    std::vector<Node> level((below.size() + kLanes - 1) / kLanes, empty_node());
    for (std::size_t i = 0; i < below.size(); ++i) {
      Node& node = level[i / kLanes];
      const std::size_t k = i % kLanes;
      node.x0[k] = *std::min_element(below[i].x0.begin(), below[i].x0.end());
      node.x1[k] = *std::max_element(below[i].x1.begin(), below[i].x1.end());
      node.y0[k] = *std::min_element(below[i].y0.begin(), below[i].y0.end());
      node.y1[k] = *std::max_element(below[i].y1.begin(), below[i].y1.end());
      node.top[k] = *std::max_element(below[i].top.begin(), below[i].top.end());
    }
    levels_.push_back(std::move(level));
  }
}

std::size_t TriangleTree::bytes() const {
  std::size_t sum = order_.size() * sizeof(std::uint32_t);
  for (const auto& level : levels_) sum += level.size() * sizeof(Node);
  return sum;
}

}  // namespace maquette::cnc
