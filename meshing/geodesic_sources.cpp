// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include <fmt/format.h>

#include "meshing/detail/corner_surface.hpp"
#include "meshing/geodesic.hpp"

namespace maquette::meshing {
namespace {

using heightmap::ModelField;

constexpr double kSharpTurn_rad = 20.0 / 180.0 * std::numbers::pi;

/// Position in cells from the field's first node.
struct GridPoint {
  double x, y;
};

class Cutter {
 public:
  Cutter(GeodesicSources& sources, const ModelField& field)
      : sources_(sources), cols_(field.z_mm.cols() - 1), rows_(field.z_mm.rows() - 1) {}

  void point(GridPoint p) const {
    const std::uint64_t t = triangle_at(p);
    const auto [u, v] = weights(t, p);
    sources_.points.push_back({t, u, v});
  }

  /// Parts at the grid's lines and diagonals.
  void segment(GridPoint a, GridPoint b) {
    cuts_.assign({0.0, 1.0});
    cut(a.x, b.x);
    cut(a.y, b.y);
    cut(a.y - a.x, b.y - b.x);
    std::sort(cuts_.begin(), cuts_.end());
    const auto at = [&](double t) {
      return GridPoint{a.x + t * (b.x - a.x), a.y + t * (b.y - a.y)};
    };
    for (std::size_t i = 0; i + 1 < cuts_.size(); ++i) {
      if (!(cuts_[i + 1] > cuts_[i])) continue;
      const std::uint64_t t = triangle_at(at(0.5 * (cuts_[i] + cuts_[i + 1])));
      const auto [u0, v0] = weights(t, at(cuts_[i]));
      const auto [u1, v1] = weights(t, at(cuts_[i + 1]));
      sources_.segments.push_back({t, u0, v0, u1, v1});
    }
  }

 private:
  void cut(double from, double to) {
    if (from == to) return;
    const double low = std::min(from, to), high = std::max(from, to);
    for (double k = std::floor(low) + 1.0; k < high; k += 1.0)
      cuts_.push_back((k - from) / (to - from));
  }

  [[nodiscard]] std::uint64_t triangle_at(GridPoint p) const {
    const double c = std::clamp(std::floor(p.x), 0.0, static_cast<double>(cols_ - 1));
    const double r = std::clamp(std::floor(p.y), 0.0, static_cast<double>(rows_ - 1));
    const auto cell = static_cast<std::uint64_t>(r) * static_cast<std::uint64_t>(cols_) +
                      static_cast<std::uint64_t>(c);
    return 2 * cell + (p.y - r > p.x - c ? 1 : 0);
  }

  /// Clamped, since a cut lies on a line of the grid only up to rounding.
  [[nodiscard]] std::array<double, 2> weights(std::uint64_t triangle, GridPoint p) const {
    const std::uint64_t cell = triangle / 2;
    const double x = p.x - static_cast<double>(cell % static_cast<std::uint64_t>(cols_));
    const double y = p.y - static_cast<double>(cell / static_cast<std::uint64_t>(cols_));
    double u, v;
    if (triangle % 2 == 0) {  // corners (0, 0), (1, 0), (1, 1) as x, y
      u = x - y;
      v = y;
    } else {  // (0, 0), (1, 1), (0, 1)
      u = x;
      v = y - x;
    }
    u = std::clamp(u, 0.0, 1.0);
    return {u, std::clamp(v, 0.0, 1.0 - u)};
  }

  GeodesicSources& sources_;
  std::ptrdiff_t cols_, rows_;
  std::vector<double> cuts_;
};

double turn(GridPoint a, GridPoint b, GridPoint c) {
  const double ux = b.x - a.x, uy = b.y - a.y, vx = c.x - b.x, vy = c.y - b.y;
  return std::abs(std::atan2(ux * vy - uy * vx, ux * vx + uy * vy));
}

}  // namespace

Result<void> add_polyline(GeodesicSources& sources, const ModelField& field,
                          std::span<const PlanPoint> line) {
  const auto last_col = static_cast<double>(field.z_mm.cols() - 1);
  const auto last_row = static_cast<double>(field.z_mm.rows() - 1);
  std::vector<GridPoint> at;
  for (std::size_t i = 0; i < line.size(); ++i) {
    GridPoint p{(line[i].x_mm - field.x0.value()) / field.spacing.value(),
                (line[i].y_mm - field.y0.value()) / field.spacing.value()};
    constexpr double kSlack = 1e-6;
    if (!(p.x >= -kSlack && p.x <= last_col + kSlack && p.y >= -kSlack && p.y <= last_row + kSlack))
      return fail(kGeodesicSource,
                  fmt::format("point {} of the line, ({}, {}) mm, lies off the field, x {} .. {}, "
                              "y {} .. {} mm",
                              i, line[i].x_mm, line[i].y_mm, field.x0.value(),
                              field.x_mm(field.z_mm.cols() - 1), field.y0.value(),
                              field.y_mm(field.z_mm.rows() - 1)));
    p = {std::clamp(p.x, 0.0, last_col), std::clamp(p.y, 0.0, last_row)};
    if (at.empty() || p.x != at.back().x || p.y != at.back().y) at.push_back(p);
  }
  Cutter cutter(sources, field);
  if (at.empty()) return {};
  if (at.size() == 1) {
    cutter.point(at.front());
    return {};
  }
  const bool closed = at.front().x == at.back().x && at.front().y == at.back().y;
  for (std::size_t i = 0; i + 1 < at.size(); ++i) {
    cutter.segment(at[i], at[i + 1]);
    const GridPoint before = i > 0 ? at[i - 1] : at[at.size() - 2];
    if (i == 0 && !closed)
      cutter.point(at[0]);
    else if (turn(before, at[i], at[i + 1]) > kSharpTurn_rad)
      cutter.point(at[i]);
  }
  if (!closed) cutter.point(at.back());
  return {};
}

void add_outline(GeodesicSources& sources, const ModelField& field) {
  Cutter cutter(sources, field);
  const auto right = static_cast<double>(field.z_mm.cols() - 1);
  const auto top = static_cast<double>(field.z_mm.rows() - 1);
  cutter.segment({0.0, 0.0}, {right, 0.0});
  cutter.segment({right, 0.0}, {right, top});
  cutter.segment({right, top}, {0.0, top});
  cutter.segment({0.0, top}, {0.0, 0.0});
}

void add_boundary(GeodesicSources& sources, const TriMesh& mesh) {
  const detail::MeshSurface surface(mesh);
  std::vector<bool> on_rim(mesh.vertices_mm.size(), false);
  for (std::uint64_t t = 0; t < surface.triangles(); ++t)
    for (std::uint32_t i = 0; i < 3; ++i) {
      const auto c = surface.corner(t) + i;
      if (surface.triangles_at_edge(c) != 1) continue;
      // The edge from corner i + 1 to i + 2, as weights of corners 1 and 2.
      constexpr double kU[3] = {0.0, 1.0, 0.0}, kV[3] = {0.0, 0.0, 1.0};
      const std::uint32_t from = (i + 1) % 3, to = (i + 2) % 3;
      sources.segments.push_back({t, kU[from], kV[from], kU[to], kV[to]});
      on_rim[surface.vertex(surface.next(c))] = true;
      on_rim[surface.vertex(surface.prev(c))] = true;
    }
  for (std::uint32_t v = 0; v < on_rim.size(); ++v) {
    if (!on_rim[v]) continue;
    double angle = 0.0;
    surface.for_each_corner(v, [&](detail::MeshSurface::Corner c) {
      const Vec3 at = surface.point(c), a = surface.point(surface.next(c)) - at,
                 b = surface.point(surface.prev(c)) - at;
      angle += std::atan2(norm(cross(a, b)), dot(a, b));
    });
    if (angle > std::numbers::pi + kSharpTurn_rad) sources.vertices.push_back(v);
  }
}

}  // namespace maquette::meshing
