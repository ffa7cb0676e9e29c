// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/mesh_cutter.hpp"

#include <algorithm>
#include <array>
#include <vector>

#include "cnc/contact.hpp"
#include "cnc/lanes.hpp"
#include "cnc/triangle_bound.hpp"
#include "cnc/triangle_tree.hpp"
#include "core/check.hpp"

namespace maquette::cnc {
namespace {

/// Largest float not above v.
float float_below(double v) {
  const auto f = static_cast<float>(v);
  return static_cast<double>(f) <= v ? f : std::nextafter(f, -INFINITY);
}

/// One drop: goes down the tree, highest bound first. The vertices met there raise what a bound
/// must beat; the other contacts are worked out at the end, of the few triangles that still do.
template <class Shape>
class Descent {
 public:
  Descent(const TriMesh& mesh, const TriangleTree& tree, const Shape& shape, double x_mm,
          double y_mm, Touch& best)
      : mesh_(mesh),
        tree_(tree),
        shape_(shape),
        rise_(shape),
        bound_(shape),
        R_(static_cast<float>(shape.R)),
        x_(x_mm),
        y_(y_mm),
        best_(best) {}

  void run() {
    visit(tree_.levels() - 1, 0);
    while (waiting_ > 0) {
      const Box box = stack_[--waiting_];
      if (box.bound <= limit()) continue;
      if (box.level == 0)
        work_out(box.index);
      else
        visit(box.level - 1, box.index);
    }
    settle();
  }

 private:
  struct Box {
    float bound;
    std::uint32_t level, index;  // level 0: a group of triangles; n: a node of level n - 1
  };

  /// What a bound must exceed to matter.
  [[nodiscard]] float limit() const { return float_below(best_.tip_mm); }

  /// Puts a node's boxes on the stack, the best on top.
  void visit(std::size_t level, std::size_t i) {
    const TriangleTree::Node& node = tree_.node(level, i);
    const float x = static_cast<float>(x_), y = static_cast<float>(y_);
    const auto gap = [&](const std::array<float, kLanes>& low,
                         const std::array<float, kLanes>& high, float at) {
      const Lanes away = larger(load(low.data()) - at, at - load(high.data()));
      // The position was rounded, then the difference.
      return larger(away * (1.0F - 1e-6F) - 0x1p-23F * std::abs(at), Lanes{});
    };
    const Lanes dx = gap(node.x0, node.x1, x), dy = gap(node.y0, node.y1, y);
    const Lanes top = load(node.top.data());
    const Lanes bound = top - rise_(dx * dx + dy * dy) + 1e-6F * (magnitude(top) + R_);
    std::array<Box, kLanes> found;
    std::size_t n = 0;
    // Empty boxes are infinitely deep, which may have become NaN: the index tells.
    for (unsigned mask = beats(bound, limit()); mask != 0; mask &= mask - 1) {
      const int k = __builtin_ctz(mask);
      if (!(bound[k] > kNoContact)) continue;
      Box box{bound[k], static_cast<std::uint32_t>(level),
              static_cast<std::uint32_t>(i * kLanes + static_cast<std::size_t>(k))};
      std::size_t at = n++;
      for (; at > 0 && found[at - 1].bound > box.bound; --at) found[at] = found[at - 1];
      found[at] = box;
    }
    std::copy_n(found.begin(), n, stack_.begin() + static_cast<std::ptrdiff_t>(waiting_));
    waiting_ += n;
  }

  void work_out(std::size_t group) {
    const auto triangles = tree_.group(group);
    const double base = best_.tip_mm > -INFINITY ? best_.tip_mm : 0.0;
    TriangleLanes lanes;
    for (std::size_t k = 0; k < kLanes; ++k) {
      const auto [p, q, s] = corners(triangles[std::min(k, triangles.size() - 1)]);
      lanes.p.set(k, {p.x, p.y, p.z - base});
      lanes.pq.set(k, q - p);
      lanes.ps.set(k, s - p);
      lanes.qs.set(k, s - q);
    }
    const Lanes bound = bound_(lanes);
    std::size_t top = 0;
    for (std::size_t k = 1; k < triangles.size(); ++k)
      if (!(bound[k] <= bound[top])) top = k;
    if (static_cast<double>(bound[top]) + base <= best_.tip_mm) return;
    for (const Vec3& v : corners(triangles[top])) touch_vertex(shape_, v.x, v.y, v.z, best_);
    for (std::size_t k = 0; k < triangles.size(); ++k) {
      const double b = static_cast<double>(bound[k]) + base;
      if (b <= best_.tip_mm) continue;
      if (promising_ == candidates_.size()) settle();
      candidates_[promising_++] = {b, triangles[k]};
    }
  }

  void settle() {
    while (promising_ > 0) {
      std::size_t top = 0;
      for (std::size_t i = 1; i < promising_; ++i)
        if (candidates_[i].bound > candidates_[top].bound) top = i;
      const Candidate best = candidates_[top];
      if (best.bound <= best_.tip_mm) break;
      candidates_[top] = candidates_[--promising_];
      const auto [p, q, s] = corners(best.triangle);
      touch_triangle(shape_, p, q, s, best_);
    }
    promising_ = 0;
  }

  /// Relative to the axis.
  [[nodiscard]] std::array<Vec3, 3> corners(std::uint32_t triangle) const {
    std::array<Vec3, 3> result;
    for (std::size_t c = 0; c < 3; ++c) {
      const Vec3& v = mesh_.vertices_mm[mesh_.triangles[triangle][c]];
      result[c] = {v.x - x_, v.y - y_, v.z};
    }
    return result;
  }

  struct Candidate {
    double bound;
    std::uint32_t triangle;
  };
  const TriMesh& mesh_;
  const TriangleTree& tree_;
  const Shape& shape_;
  RiseBelow rise_;
  TriangleBound<Shape> bound_;
  float R_;
  double x_, y_;
  Touch& best_;
  std::array<Box, 128> stack_;  // 8 a level; 2^32 triangles have 11 levels
  std::size_t waiting_ = 0;
  std::array<Candidate, 128> candidates_;
  std::size_t promising_ = 0;
};

}  // namespace

struct MeshCutter::State {
  struct Part {
    double bottom_mm;
    ConeShape shape;
  };
  const TriMesh& mesh;
  TriangleTree tree;
  CutterShape shape;
  std::vector<Part> holder;

  template <class Shape>
  void drop(const Shape& body, double x_mm, double y_mm, Touch& best) const {
    if (std::isfinite(x_mm) && std::isfinite(y_mm))
      Descent<Shape>(mesh, tree, body, x_mm, y_mm, best).run();
  }
};

MeshCutter::MeshCutter(const TriMesh& mesh, const Cutter& tool) {
  check_cutter(tool);
  std::vector<State::Part> holder;
  for (const HolderPart& part : tool.holder) holder.push_back({part.bottom_mm, cone_of(part)});
  state_ = std::make_shared<const State>(
      State{mesh, TriangleTree(mesh), shape_of(tool), std::move(holder)});
}

CutterContact MeshCutter::drop(double x_mm, double y_mm, CutterContact so_far) const {
  Touch best{so_far.tip_mm, so_far.dx_mm, so_far.dy_mm};
  std::visit([&](const auto& shape) { state_->drop(shape, x_mm, y_mm, best); }, state_->shape);
  return {best.tip_mm, best.dx_mm, best.dy_mm};
}

CutterContact MeshCutter::drop_holder(double x_mm, double y_mm, CutterContact so_far) const {
  for (const State::Part& part : state_->holder) {
    Touch best{so_far.tip_mm + part.bottom_mm, so_far.dx_mm, so_far.dy_mm};
    const double before = best.tip_mm;
    state_->drop(part.shape, x_mm, y_mm, best);
    if (best.tip_mm > before) so_far = {best.tip_mm - part.bottom_mm, best.dx_mm, best.dy_mm};
  }
  return so_far;
}

std::size_t MeshCutter::bytes() const {
  return state_->tree.bytes();
}

}  // namespace maquette::cnc
