// SPDX-License-Identifier: GPL-3.0-or-later
#include "meshing/detail/surface_triangulation.hpp"

#include <algorithm>
#include <bit>

#include "core/check.hpp"

namespace maquette::meshing::detail {

SurfaceTriangulation::SurfaceTriangulation(const heightmap::ModelField& field, bool locked)
    : field_(field),
      last_row_(static_cast<std::int32_t>(field.z_mm.rows() - 1)),
      last_col_(static_cast<std::int32_t>(field.z_mm.cols() - 1)),
      head_(256U << kMantissaBits, kNone),
      locked_(locked) {
  for (const auto& [r, c] :
       {std::array{0, 0}, {0, last_col_}, {last_row_, last_col_}, {last_row_, 0}})
    vertices_.push({r, c, field.z_mm(r, c)});
  add(0, 1, 2);
  add(0, 2, 3);
  triangles_[0].n = {kNone, 1, kNone};
  triangles_[1].n = {kNone, kNone, 0};
}

std::uint32_t SurfaceTriangulation::list_of(float error_mm) {
  return std::bit_cast<std::uint32_t>(error_mm) >> (23 - kMantissaBits);
}

std::uint32_t SurfaceTriangulation::add(std::uint32_t a, std::uint32_t b, std::uint32_t c) {
  Triangle t;
  t.v = {a, b, c};
  return triangles_.push(t);
}

void SurfaceTriangulation::relink_neighbour(std::uint32_t of, std::uint32_t from,
                                            std::uint32_t to) {
  if (of == kNone) return;
  for (std::uint32_t& n : triangles_[of].n)
    if (n == from) {
      n = to;
      return;
    }
}

/// t becomes (p, b, c); p is inside.
void SurfaceTriangulation::split_inside(std::uint32_t t, std::uint32_t p) {
  const auto [a, b, c] = triangles_[t].v;
  const auto [na, nb, nc] = triangles_[t].n;
  const std::uint32_t t1 = add(p, c, a), t2 = add(p, a, b);
  triangles_[t].v = {p, b, c};
  triangles_[t].n = {na, t1, t2};
  triangles_[t1].n = {nb, t2, t};
  triangles_[t2].n = {nc, t, t1};
  relink_neighbour(nb, t, t1);
  relink_neighbour(nc, t, t2);
  stack_.insert(stack_.end(), {t, t1, t2});
}

/// p is on the edge opposite of corner `edge`: two triangles become four, at the rim one two.
void SurfaceTriangulation::split_edge(std::uint32_t t, std::size_t edge, std::uint32_t p) {
  const std::uint32_t a = triangles_[t].v[edge], b = triangles_[t].v[(edge + 1) % 3],
                      c = triangles_[t].v[(edge + 2) % 3];
  const std::uint32_t u = triangles_[t].n[edge], nb = triangles_[t].n[(edge + 1) % 3],
                      nc = triangles_[t].n[(edge + 2) % 3];
  const std::uint32_t t1 = add(p, a, b);
  triangles_[t].v = {p, c, a};
  triangles_[t].n = {nb, t1, kNone};
  triangles_[t1].n = {nc, kNone, t};
  relink_neighbour(nc, t, t1);
  stack_.insert(stack_.end(), {t, t1});
  if (u == kNone) return;
  std::size_t j = 0;
  while (triangles_[u].n[j] != t) ++j;
  const std::uint32_t d = triangles_[u].v[j];  // u is (d, c, b)
  const std::uint32_t to_b = triangles_[u].n[(j + 1) % 3], to_c = triangles_[u].n[(j + 2) % 3];
  const std::uint32_t u1 = add(p, b, d);
  triangles_[u].v = {p, d, c};
  triangles_[u].n = {to_c, t, u1};
  triangles_[u1].n = {to_b, u, t1};
  triangles_[t].n[2] = u;
  triangles_[t1].n[1] = u1;
  relink_neighbour(to_b, u, u1);
  stack_.insert(stack_.end(), {u, u1});
}

bool SurfaceTriangulation::in_circle(const Triangle& t, const Vertex& q) const {
  // Exact for triangles up to 2^15 nodes across: products of four differences.
  const auto from = [&](std::uint32_t v) {
    const std::int64_t x = vertices_[v].col - q.col, y = vertices_[v].row - q.row;
    return std::array{x, y, x * x + y * y};
  };
  const auto a = from(t.v[0]), b = from(t.v[1]), c = from(t.v[2]);
  __extension__ using Wide = __int128;
  const auto minor = [](const auto& s, const auto& w) { return s[0] * w[1] - s[1] * w[0]; };
  return static_cast<Wide>(a[2]) * minor(b, c) + static_cast<Wide>(b[2]) * minor(c, a) +
             static_cast<Wide>(c[2]) * minor(a, b) >
         0;
}

/// Every triangle on the stack has the new vertex first: the edge opposite of it is turned where
/// the circle is not empty (Lawson 1977).
void SurfaceTriangulation::legalise() {
  while (!stack_.empty()) {
    const std::uint32_t t = stack_.back();
    stack_.pop_back();
    const std::uint32_t u = triangles_[t].n[0];
    if (u == kNone) continue;
    Triangle &near = triangles_[t], &far = triangles_[u];
    std::size_t j = 0;
    while (far.n[j] != t) ++j;
    const std::uint32_t q = far.v[j];
    if (!in_circle(near, vertices_[q])) continue;
    unlink(u);
    const std::uint32_t p = near.v[0], b = near.v[1], c = near.v[2];
    const std::uint32_t past_b = far.n[(j + 1) % 3], past_c = far.n[(j + 2) % 3];
    const std::uint32_t before_c = near.n[1], before_b = near.n[2];
    near.v = {p, b, q};
    near.n = {past_b, u, before_b};
    far.v = {p, q, c};
    far.n = {past_c, before_c, t};
    relink_neighbour(past_b, u, t);
    relink_neighbour(before_c, t, u);
    stack_.push_back(t);
    stack_.push_back(u);
  }
}

std::uint32_t SurfaceTriangulation::insert_into(std::uint32_t t, std::int32_t row,
                                                std::int32_t col) {
  const Vertex at{row, col, field_.z_mm(row, col)};
  const std::uint32_t p = vertices_.push(at);
  const Triangle& in = triangles_[t];
  std::size_t edge = 3;
  for (std::size_t i = 0; i < 3; ++i)
    if (detail::doubled_area(vertices_[in.v[(i + 1) % 3]], vertices_[in.v[(i + 2) % 3]], at) == 0)
      edge = i;
  unlink(t);
  if (edge == 3) {
    split_inside(t, p);
  } else {
    if (triangles_[t].n[edge] != kNone) unlink(triangles_[t].n[edge]);
    split_edge(t, edge, p);
  }
  legalise();
  return t;  // keeps the new vertex as its first corner
}

std::uint32_t SurfaceTriangulation::insert(std::int32_t row, std::int32_t col, std::uint32_t hint) {
  const Vertex at{row, col, 0.0F};
  for (;;) {  // Delaunay: a walk that crosses edges towards the place does not turn in circles
    const Triangle& t = triangles_[hint];
    std::size_t i = 0;
    while (i < 3 &&
           detail::doubled_area(vertices_[t.v[(i + 1) % 3]], vertices_[t.v[(i + 2) % 3]], at) >= 0)
      ++i;
    if (i == 3) break;
    hint = t.n[i];
    MAQUETTE_CHECK(hint != kNone, "row {}, column {} is not on the field", row, col);
  }
  for (const std::uint32_t v : triangles_[hint].v)
    if (vertices_[v].row == row && vertices_[v].col == col) return hint;
  return insert_into(hint, row, col);
}

/// All triangles around the first corner of t.
template <class Do>
void SurfaceTriangulation::star(std::uint32_t t, Do act) const {
  std::uint32_t at = t;
  do {
    act(at);
    at = triangles_[at].n[1];
  } while (at != t && at != kNone);
  if (at == t) return;
  for (at = triangles_[t].n[2]; at != kNone; at = triangles_[at].n[2]) act(at);
}

void SurfaceTriangulation::link(std::uint32_t t) {
  Triangle& triangle = triangles_[t];
  if (!waits(triangle)) return;
  const std::uint32_t list = list_of(triangle.wait.error_mm);
  triangle.wait.before = kNone;
  triangle.wait.after = head_[list];
  if (head_[list] != kNone) triangles_[head_[list]].wait.before = t;
  head_[list] = t;
  top_ = std::max(top_, list);
}

void SurfaceTriangulation::unlink(std::uint32_t t) {
  Triangle& triangle = triangles_[t];
  if (!waits(triangle)) return;
  const auto [node, error, before, after] = triangle.wait;
  if (before != kNone)
    triangles_[before].wait.after = after;
  else
    head_[list_of(error)] = after;
  if (after != kNone) triangles_[after].wait.before = before;
  triangle.wait = {node, 0.0F, kNone, kNone};
}

/// The node of the triangle farthest from it. Vertices have their node's height, so that theirs
/// is rounding.
void SurfaceTriangulation::scan(std::uint32_t t) {
  Triangle& triangle = triangles_[t];
  // Distance and node as one number: its maximum needs no branch, and no order of the nodes.
  std::uint64_t worst = 0;
  const auto cols = static_cast<std::uint32_t>(last_col_ + 1);
  for_rows(triangle, false,
           [&](std::int32_t r, std::int32_t from, std::int32_t to, double z, double per_col) {
             if (locked_) {
               if (r == 0 || r == last_row_) return;
               from = std::max(from, 1);
               to = std::min(to, last_col_ - 1);
             }
             const float* height = field_.z_mm.row(r).data();
             const std::uint32_t row_start = static_cast<std::uint32_t>(r) * cols;
             for (std::int32_t k = from; k <= to; ++k) {
               const auto off =
                   static_cast<float>(std::abs(z + per_col * k - static_cast<double>(height[k])));
               const std::uint64_t both = std::uint64_t{std::bit_cast<std::uint32_t>(off)} << 32U |
                                          (row_start + static_cast<std::uint32_t>(k));
               worst = std::max(worst, both);
             }
           });
  const auto off = std::bit_cast<float>(static_cast<std::uint32_t>(worst >> 32U));
  // Rounding of the plane: below 1e-12 of the heights.
  const float step = 1e-12F * (1.0F + std::abs(vertices_[triangle.v[0]].z_mm));
  triangle.wait = {kNone, 0.0F, kNone, kNone};
  if (!(off > step)) return;
  // The next float, so that a bound in double holds.
  triangle.wait = {static_cast<std::uint32_t>(worst),
                   std::nextafter(off, std::numeric_limits<float>::max()), kNone, kNone};
}

void SurfaceTriangulation::scan_all(double error_mm) {
  least_mm_ = error_mm;
  std::fill(head_.begin(), head_.end(), kNone);
  top_ = 0;
  // The last one first: lists are taken from the front.
  for (std::uint32_t t = triangles_.size(); t-- > 0;) {
    scan(t);
    link(t);
  }
}

double SurfaceTriangulation::worst_mm() const {
  float worst = 0.0F;
  for (std::uint32_t t = 0; t < triangles_.size(); ++t)
    worst = std::max(worst, triangles_[t].wait.error_mm);
  return static_cast<double>(worst);
}

void SurfaceTriangulation::refine(std::uint64_t most_triangles, const RunContext& run) {
  const auto cols = static_cast<std::uint32_t>(last_col_ + 1);
  const std::uint64_t nearly = most_triangles - most_triangles / kStopEarly;
  std::uint32_t lowest = top_;
  for (std::uint64_t done = 0; triangles_.size() + 2 <= most_triangles; ++done) {
    if (done % 4096 == 0 && run.stopped()) return;
    while (top_ > 0 && head_[top_] == kNone) --top_;
    const std::uint32_t t = head_[top_];
    if (t == kNone) return;
    // A new vertex can make its neighbours worse for a while: not the moment to stop.
    lowest = std::min(lowest, top_);
    if (triangles_.size() >= nearly && top_ == lowest) return;
    const std::uint32_t node = triangles_[t].wait.worst_node;
    const std::uint32_t first = insert_into(t, static_cast<std::int32_t>(node / cols),
                                            static_cast<std::int32_t>(node % cols));
    star(first, [this](std::uint32_t s) {
      scan(s);
      link(s);
    });
  }
}

}  // namespace maquette::meshing::detail
