// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file plain_greedy.hpp
/// Greedy insertion as the textbook has it (Garland and Heckbert 1995), for comparison: no first
/// grid, no fit, no turned edges.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <queue>
#include <utility>
#include <vector>

#include "core/grid.hpp"

namespace maquette::meshing {

/// A corner over a grid, in nodes.
struct GridCorner {
  double row = 0.0, col = 0.0, z = 0.0;
};

/// visit(row, col, height of the triangle) for each node under it, those on its edges too.
/// @pre counter-clockwise seen from above, not degenerate
template <class Visit>
void each_node_under(const std::array<GridCorner, 3>& t, Visit visit) {
  const auto& [a, b, c] = t;
  const auto area = [](const GridCorner& p, const GridCorner& q, double r, double k) {
    return (q.col - p.col) * (r - p.row) - (q.row - p.row) * (k - p.col);
  };
  const double whole = area(a, b, c.row, c.col);
  const auto last = static_cast<int>(std::max({a.row, b.row, c.row}));
  for (int r = static_cast<int>(std::ceil(std::min({a.row, b.row, c.row}))); r <= last; ++r) {
    // Along a row the three weights are linear: where none is negative.
    double from = std::ceil(std::min({a.col, b.col, c.col})), to = std::max({a.col, b.col, c.col});
    for (const auto& [p, q] : {std::pair{a, b}, std::pair{b, c}, std::pair{c, a}}) {
      const double rate = -(q.row - p.row), start = area(p, q, r, 0);
      if (rate > 0) from = std::fmax(from, std::ceil(-start / rate - 1e-7));
      if (rate < 0) to = std::fmin(to, std::floor(-start / rate + 1e-7));
    }
    for (int k = static_cast<int>(from); k <= static_cast<int>(to); ++k) {
      const double wa = area(b, c, r, k) / whole, wb = area(c, a, r, k) / whole;
      visit(r, k, wa * a.z + wb * b.z + (1.0 - wa - wb) * c.z);
    }
  }
}

/// Triangles in a heap by their worst node, each new node splits its triangle, edges are turned
/// until all circles are empty.
class PlainGreedy {
 public:
  explicit PlainGreedy(const Grid<float>& z) : z_(z) {
    const auto r = static_cast<int>(z.rows() - 1), c = static_cast<int>(z.cols() - 1);
    at_ = {{0, 0}, {0, c}, {r, c}, {r, 0}};
    add({0, 1, 2}, {-1, 1, -1});
    add({0, 2, 3}, {-1, -1, 0});
    rate(0);
    rate(1);
  }
  void refine(std::size_t triangles) {
    while (t_.size() + 2 <= triangles && !heap_.empty()) {
      const auto [error, t, age] = heap_.top();
      heap_.pop();
      if (t_[t].age != age || error <= 0.0) continue;
      insert(t);
    }
  }
  [[nodiscard]] std::size_t size() const { return t_.size(); }
  /// Places of the corners on the grid, with its heights.
  [[nodiscard]] std::vector<std::array<GridCorner, 3>> triangles() const {
    std::vector<std::array<GridCorner, 3>> all;
    all.reserve(t_.size());
    for (const Tri& t : t_) {
      auto& corners = all.emplace_back();
      for (std::size_t k = 0; k < 3; ++k) {
        const Node n = at_[static_cast<std::size_t>(t.v[k])];
        corners[k] = {static_cast<double>(n.r), static_cast<double>(n.c),
                      static_cast<double>(z_(n.r, n.c))};
      }
    }
    return all;
  }

 private:
  struct Node {
    int r, c;
  };
  struct Tri {
    std::array<int, 3> v, n;
    Node worst{0, 0};
    std::uint32_t age = 0;
  };
  struct Entry {
    double error;
    std::size_t t;
    std::uint32_t age;
    bool operator<(const Entry& o) const { return error < o.error; }
  };
  [[nodiscard]] double area(Node a, Node b, Node c) const {
    return static_cast<double>(b.c - a.c) * (c.r - a.r) -
           static_cast<double>(b.r - a.r) * (c.c - a.c);
  }
  std::size_t add(std::array<int, 3> v, std::array<int, 3> n) {
    t_.push_back({v, n});
    return t_.size() - 1;
  }
  template <class Visit>
  void each_node(std::size_t t, Visit visit) const {
    std::array<GridCorner, 3> corners{};
    for (std::size_t k = 0; k < 3; ++k) {
      const Node n = at_[static_cast<std::size_t>(t_[t].v[k])];
      corners[k] = {static_cast<double>(n.r), static_cast<double>(n.c),
                    static_cast<double>(z_(n.r, n.c))};
    }
    each_node_under(corners, [&](int r, int c, double z) {
      visit(r, c, std::abs(z - static_cast<double>(z_(r, c))));
    });
  }
  void rate(std::size_t t) {
    double worst = 1e-9;
    Node at{-1, -1};
    each_node(t, [&](int r, int c, double off) {
      if (off > worst) {
        worst = off;
        at = {r, c};
      }
    });
    t_[t].worst = at;
    ++t_[t].age;
    if (at.r >= 0) heap_.push({worst, t, t_[t].age});
  }
  void relink(int of, int from, int to) {
    if (of < 0) return;
    for (int& n : t_[static_cast<std::size_t>(of)].n)
      if (n == from) {
        n = to;
        return;
      }
  }
  void insert(std::size_t t) {
    const Node node = t_[t].worst;
    at_.push_back(node);
    const int p = static_cast<int>(at_.size() - 1);
    for (std::size_t i = 0; i < 3; ++i)
      if (area(at_[static_cast<std::size_t>(t_[t].v[(i + 1) % 3])],
               at_[static_cast<std::size_t>(t_[t].v[(i + 2) % 3])], node) == 0) {
        split_edge(t, i, p);
        return settle();
      }
    const auto [a, b, c] = t_[t].v;
    const auto [na, nb, nc] = t_[t].n;
    const int me = static_cast<int>(t);
    const int t1 = static_cast<int>(add({p, c, a}, {nb, me + 0, me}));
    const int t2 = static_cast<int>(add({p, a, b}, {nc, me, t1}));
    t_[t].v = {p, b, c};
    t_[t].n = {na, t1, t2};
    t_[static_cast<std::size_t>(t1)].n = {nb, t2, me};
    relink(nb, me, t1);
    relink(nc, me, t2);
    todo_ = {me, t1, t2};
    settle();
  }
  void split_edge(std::size_t t, std::size_t i, int p) {
    const int a = t_[t].v[i], b = t_[t].v[(i + 1) % 3], c = t_[t].v[(i + 2) % 3];
    const int u = t_[t].n[i], nb = t_[t].n[(i + 1) % 3], nc = t_[t].n[(i + 2) % 3];
    const int me = static_cast<int>(t);
    const int t1 = static_cast<int>(add({p, a, b}, {nc, -1, me}));
    t_[t].v = {p, c, a};
    t_[t].n = {nb, t1, -1};
    relink(nc, me, t1);
    todo_ = {me, t1};
    if (u < 0) return;
    auto& other = t_[static_cast<std::size_t>(u)];
    std::size_t j = 0;
    while (other.n[j] != me) ++j;
    const int d = other.v[j], to_b = other.n[(j + 1) % 3], to_c = other.n[(j + 2) % 3];
    const int u1 = static_cast<int>(add({p, b, d}, {to_b, u, t1}));
    auto& far = t_[static_cast<std::size_t>(u)];
    far.v = {p, d, c};
    far.n = {to_c, me, u1};
    t_[t].n[2] = u;
    t_[static_cast<std::size_t>(t1)].n[1] = u1;
    relink(to_b, u, u1);
    todo_.insert(todo_.end(), {u, u1});
  }
  void settle() {
    std::vector<int> changed = todo_;
    while (!todo_.empty()) {
      const int t = todo_.back();
      todo_.pop_back();
      auto& near = t_[static_cast<std::size_t>(t)];
      const int u = near.n[0];
      if (u < 0) continue;
      auto& far = t_[static_cast<std::size_t>(u)];
      std::size_t j = 0;
      while (far.n[j] != t) ++j;
      if (!in_circle(near, at_[static_cast<std::size_t>(far.v[j])])) continue;
      const int p = near.v[0], b = near.v[1], c = near.v[2], q = far.v[j];
      const int past_b = far.n[(j + 1) % 3], past_c = far.n[(j + 2) % 3];
      const int before_c = near.n[1], before_b = near.n[2];
      near.v = {p, b, q};
      near.n = {past_b, u, before_b};
      far.v = {p, q, c};
      far.n = {past_c, before_c, t};
      relink(past_b, u, t);
      relink(before_c, t, u);
      todo_.insert(todo_.end(), {t, u});
      changed.insert(changed.end(), {t, u});
    }
    std::sort(changed.begin(), changed.end());
    changed.erase(std::unique(changed.begin(), changed.end()), changed.end());
    for (const int t : changed) rate(static_cast<std::size_t>(t));
  }
  [[nodiscard]] bool in_circle(const Tri& t, Node q) const {
    const auto from = [&](int v) {
      const Node n = at_[static_cast<std::size_t>(v)];
      const double x = n.c - q.c, y = n.r - q.r;
      return std::array{x, y, x * x + y * y};
    };
    const auto a = from(t.v[0]), b = from(t.v[1]), c = from(t.v[2]);
    const auto minor = [](const auto& s, const auto& w) { return s[0] * w[1] - s[1] * w[0]; };
    return a[2] * minor(b, c) + b[2] * minor(c, a) + c[2] * minor(a, b) > 0;
  }
  const Grid<float>& z_;
  std::vector<Node> at_;
  std::vector<Tri> t_;
  std::vector<int> todo_;
  std::priority_queue<Entry> heap_;
};

}  // namespace maquette::meshing
