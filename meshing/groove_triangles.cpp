// SPDX-License-Identifier: GPL-3.0-or-later
#include "meshing/detail/groove_triangles.hpp"

#include <CGAL/Constrained_Delaunay_triangulation_2.h>
#include <CGAL/Exact_predicates_exact_constructions_kernel.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Triangulation_face_base_with_info_2.h>
#include <CGAL/Triangulation_vertex_base_with_info_2.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

namespace maquette::meshing::detail {
namespace {

using Exact = CGAL::Exact_predicates_exact_constructions_kernel;
using Rounded = CGAL::Exact_predicates_inexact_constructions_kernel;
/// Of a vertex; the crossing of constraints makes some without.
struct Number {
  std::uint32_t value = UINT32_MAX;
};
enum class Region : char { unknown, outside, wall, floor };
using Vertices = CGAL::Triangulation_vertex_base_with_info_2<Number, Exact>;
using Faces = CGAL::Constrained_triangulation_face_base_2<
    Exact, CGAL::Triangulation_face_base_with_info_2<Region, Exact>>;
using Plane = CGAL::Constrained_Delaunay_triangulation_2<
    Exact, CGAL::Triangulation_data_structure_2<Vertices, Faces>, CGAL::Exact_intersections_tag>;

constexpr int kEndSides = 16;
/// Corners lie on a lattice, so that edges which nearly coincide are the same or well apart.
constexpr double kLattice_mm = 1.0 / 1024.0;

Exact::Point_2 point(const FlatPoint& p) {
  return {p[0], p[1]};
}

struct Stroke {
  std::vector<Exact::Point_2> corners;
  double x0 = INFINITY, x1 = -INFINITY, y0 = INFINITY, y1 = -INFINITY;

  explicit Stroke(const std::vector<FlatPoint>& outline) {
    for (const FlatPoint& p : outline) {
      corners.push_back(point(p));
      x0 = std::fmin(x0, p[0]);
      x1 = std::fmax(x1, p[0]);
      y0 = std::fmin(y0, p[1]);
      y1 = std::fmax(y1, p[1]);
    }
  }
  [[nodiscard]] bool contains(const Exact::Point_2& p) const {
    const double x = CGAL::to_double(p.x()), y = CGAL::to_double(p.y());
    // What rounds to the outside of the box is outside or on its border, and no middle is on that.
    if (x < x0 || x > x1 || y < y0 || y > y1) return false;
    for (std::size_t i = 0; i < corners.size(); ++i)
      if (CGAL::right_turn(corners[i], corners[(i + 1) % corners.size()], p)) return false;
    return true;
  }
};

std::vector<Plane::Vertex_handle> insert_ring(Plane& plane, std::span<const FlatPoint> ring) {
  std::vector<Plane::Vertex_handle> handles;
  for (const FlatPoint& p : ring) handles.push_back(plane.insert(point(p)));
  for (std::size_t i = 0; i < handles.size(); ++i)
    if (handles[i] != handles[(i + 1) % handles.size()])
      plane.insert_constraint(handles[i], handles[(i + 1) % handles.size()]);
  return handles;
}

/// What cannot be reached from infinity without crossing a constraint is wall or floor.
void sort_out(Plane& plane, const std::vector<Stroke>& strokes) {
  for (const Plane::Face_handle f : plane.all_face_handles()) f->info() = Region::unknown;
  std::vector<Plane::Face_handle> open{plane.infinite_face()};
  while (!open.empty()) {
    const Plane::Face_handle f = open.back();
    open.pop_back();
    if (f->info() == Region::outside) continue;
    f->info() = Region::outside;
    for (int i = 0; i < 3; ++i)
      if (!plane.is_constrained({f, i})) open.push_back(f->neighbor(i));
  }
  for (const Plane::Face_handle f : plane.finite_face_handles()) {
    if (f->info() == Region::outside) continue;
    const Exact::Point_2 middle = CGAL::centroid(plane.triangle(f));
    const bool in_any = std::any_of(strokes.begin(), strokes.end(),
                                    [&](const Stroke& s) { return s.contains(middle); });
    f->info() = in_any ? Region::floor : Region::wall;
  }
}

/// Two borders of floor and wall at most meet in each vertex.
bool is_manifold(const Plane& plane) {
  for (const Plane::Vertex_handle v : plane.finite_vertex_handles()) {
    int changes = 0;
    auto face = plane.incident_faces(v);
    const auto first = face;
    do {
      const Region here = face->info();
      const auto next = std::next(face);
      changes += (here == Region::floor) != (next->info() == Region::floor);
    } while (++face != first);
    if (changes > 2) return false;
  }
  return true;
}

}  // namespace

std::vector<std::vector<FlatPoint>> stroke_outlines(std::span<const std::vector<FlatPoint>> lines,
                                                    double width) {
  const auto snapped = [](double mm) { return kLattice_mm * std::round(mm / kLattice_mm); };
  std::array<FlatPoint, kEndSides> corner;
  for (std::size_t k = 0; k < corner.size(); ++k) {
    const double turn = 2.0 * std::numbers::pi * static_cast<double>(k) / kEndSides;
    corner[k] = {snapped(0.5 * width * std::cos(turn)), snapped(0.5 * width * std::sin(turn))};
  }
  std::vector<std::vector<FlatPoint>> outlines;
  const auto add = [&](FlatPoint a, FlatPoint b) {
    const FlatPoint t{b[0] - a[0], b[1] - a[1]};
    // Farthest to the left and to the right of the line.
    std::size_t left = 0, right = 0;
    const auto off = [&](std::size_t k) { return t[0] * corner[k][1] - t[1] * corner[k][0]; };
    for (std::size_t k = 0; k < corner.size(); ++k) {
      if (off(k) > off(left)) left = k;
      if (off(k) < off(right)) right = k;
    }
    std::vector<FlatPoint> outline;
    const auto push = [&](FlatPoint p, std::size_t k) {
      outline.push_back({p[0] + corner[k][0], p[1] + corner[k][1]});
    };
    for (std::size_t k = 0; k < corner.size(); ++k) {
      const double ahead = t[0] * corner[k][0] + t[1] * corner[k][1];
      if (k == left) {
        push(b, k);
        push(a, k);
      } else if (k == right) {
        push(a, k);
        push(b, k);
      } else {
        push(ahead > 0.0 ? b : a, k);
      }
    }
    outlines.push_back(std::move(outline));
  };
  for (const auto& line : lines) {
    std::vector<FlatPoint> at;
    for (const FlatPoint& p : line) at.push_back({snapped(p[0]), snapped(p[1])});
    for (std::size_t i = 0; i + 1 < at.size(); ++i)
      if (at[i] != at[i + 1]) add(at[i], at[i + 1]);
    if (at.size() == 1) outlines.emplace_back();
    if (at.size() == 1)
      for (const FlatPoint& c : corner)
        outlines.back().push_back({at[0][0] + c[0], at[0][1] + c[1]});
  }
  return outlines;
}

std::optional<Grooves> groove_triangles(std::span<const FlatPoint> outline,
                                        std::span<const std::vector<FlatPoint>> strokes) {
  Plane plane;
  const auto rim = insert_ring(plane, outline);
  for (std::size_t i = 0; i < rim.size(); ++i) rim[i]->info().value = static_cast<std::uint32_t>(i);
  std::vector<Stroke> bodies;
  for (const auto& s : strokes) {
    insert_ring(plane, s);
    bodies.emplace_back(s);
  }
  Grooves g;
  std::vector<Plane::Vertex_handle> inner;
  for (const Plane::Vertex_handle v : plane.finite_vertex_handles())
    if (v->info().value == Number{}.value) inner.push_back(v);
  // CGAL's own order goes by addresses.
  std::sort(inner.begin(), inner.end(), [](auto a, auto b) { return a->point() < b->point(); });
  for (const Plane::Vertex_handle v : inner) {
    v->info().value = static_cast<std::uint32_t>(outline.size() + g.points.size());
    g.points.push_back({CGAL::to_double(v->point().x()), CGAL::to_double(v->point().y())});
  }
  sort_out(plane, bodies);
  if (!is_manifold(plane)) return std::nullopt;
  const auto rounded = [&](std::uint32_t i) {
    const FlatPoint& p = i < outline.size() ? outline[i] : g.points[i - outline.size()];
    return Rounded::Point_2(p[0], p[1]);
  };
  for (const Plane::Face_handle f : plane.finite_face_handles()) {
    if (f->info() == Region::outside) continue;
    std::array<std::uint32_t, 3> t{f->vertex(0)->info().value, f->vertex(1)->info().value,
                                   f->vertex(2)->info().value};
    if (!CGAL::left_turn(rounded(t[0]), rounded(t[1]), rounded(t[2]))) return std::nullopt;
    std::rotate(t.begin(), std::min_element(t.begin(), t.end()), t.end());
    (f->info() == Region::floor ? g.floor : g.wall).push_back(t);
  }
  std::sort(g.wall.begin(), g.wall.end());
  std::sort(g.floor.begin(), g.floor.end());
  return g;
}

}  // namespace maquette::meshing::detail
