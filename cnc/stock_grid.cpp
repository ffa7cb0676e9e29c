// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/stock_grid.hpp"

#include <algorithm>
#include <cmath>

#include "cnc/cutter_shape.hpp"

namespace maquette::cnc {
namespace {

float float_above(double v) {
  const auto f = static_cast<float>(v);
  return static_cast<double>(f) < v ? std::nextafter(f, INFINITY) : f;
}

}  // namespace

StockGrid::StockGrid(const CellGrid& grid, const Cutter& cutter)
    : grid_(grid), cutter_(cutter), top_(grid.rows, grid.cols, -INFINITY) {
  const double side = grid.side_mm(), rho = grid.half_diagonal_mm();
  // A place is taken for the nearest centre (rho), the axis may be half a side off it, a point
  // half a diagonal off its cell's centre.
  const double slack = 2.0 * rho + 0.5 * side;
  const int n = static_cast<int>((cutter.radius_mm + slack) / side) + 1;
  for (int r = -n; r <= n; ++r)
    for (int c = -n; c <= n; ++c) {
      const double d = side * std::hypot(r, c);
      const double far = underside_mm(cutter, d + rho + kWithinCells * side);
      const double near = underside_mm(cutter, std::max(0.0, d - slack));
      if (std::isfinite(far)) shrunk_.push_back({r, c, float_above(far)});
      if (std::isfinite(near)) widened_.push_back({r, c, -float_above(-near)});
    }
  const auto nearer = [](const Reach& a, const Reach& b) {
    return a.row * a.row + a.col * a.col < b.row * b.row + b.col * b.col;
  };
  std::stable_sort(shrunk_.begin(), shrunk_.end(), nearer);
  std::stable_sort(widened_.begin(), widened_.end(), nearer);
}

void StockGrid::add(const StockBox& box) {
  const double half = 0.5 * grid_.side_mm();
  for (std::ptrdiff_t r = 0; r < grid_.rows; ++r) {
    const double y = grid_.y_mm(r);
    if (y + half <= box.y0_mm || y - half >= box.y1_mm) continue;
    for (std::ptrdiff_t c = 0; c < grid_.cols; ++c) {
      const double x = grid_.x_mm(c);
      if (x + half <= box.x0_mm || x - half >= box.x1_mm) continue;
      top_(r, c) = std::max(top_(r, c), float_above(box.top_mm));
    }
  }
}

void StockGrid::add(const heightmap::ModelField& field) {
  const double d = field.spacing.value(), half = 0.5 * grid_.side_mm();
  // Nodes whose squares overlap the interval around `centre`.
  const auto span = [&](double centre, double origin, std::ptrdiff_t n) {
    const double from = (centre - half - origin) / d, to = (centre + half - origin) / d;
    const auto first = static_cast<std::ptrdiff_t>(std::floor(from + 0.5 + 1e-9));
    const auto last = static_cast<std::ptrdiff_t>(std::ceil(to - 0.5 - 1e-9));
    return std::pair{std::max<std::ptrdiff_t>(0, first), std::min(n - 1, last)};
  };
  const std::ptrdiff_t rows = field.z_mm.rows(), cols = field.z_mm.cols();
  for (std::ptrdiff_t r = 0; r < grid_.rows; ++r) {
    const auto [r0, r1] = span(grid_.y_mm(r), field.y0.value(), rows);
    for (std::ptrdiff_t c = 0; c < grid_.cols; ++c) {
      const auto [c0, c1] = span(grid_.x_mm(c), field.x0.value(), cols);
      for (std::ptrdiff_t i = r0; i <= r1; ++i)
        for (std::ptrdiff_t j = c0; j <= c1; ++j)  // a void compares false
          if (field.z_mm(i, j) > top_(r, c)) top_(r, c) = field.z_mm(i, j);
    }
  }
}

void StockGrid::cut(Cell from, Cell to, double z_mm) {
  const double side = grid_.side_mm(), rho = grid_.half_diagonal_mm();
  const double reach = cutter_.radius_mm - rho;
  if (reach < 0.0) return;
  const auto n = static_cast<std::ptrdiff_t>(reach / side);
  const auto bound = [](std::ptrdiff_t v, std::ptrdiff_t end) {
    return std::clamp<std::ptrdiff_t>(v, 0, end - 1);
  };
  const std::ptrdiff_t r0 = bound(std::min(from.row, to.row) - n, grid_.rows);
  const std::ptrdiff_t r1 = bound(std::max(from.row, to.row) + n, grid_.rows);
  const std::ptrdiff_t c0 = bound(std::min(from.col, to.col) - n, grid_.cols);
  const std::ptrdiff_t c1 = bound(std::max(from.col, to.col) + n, grid_.cols);
  const double ur = to.row - from.row, uc = to.col - from.col, u2 = ur * ur + uc * uc;
  const double flat = (cutter_.radius_mm - cutter_.corner_radius_mm - rho) / side;
  const double flat2 = flat < 0.0 ? -1.0 : flat * flat, reach2 = reach * reach / (side * side);
  const float floor = float_above(z_mm);
  for (std::ptrdiff_t r = r0; r <= r1; ++r)
    for (std::ptrdiff_t c = c0; c <= c1; ++c) {
      float& top = top_(r, c);
      if (top <= floor) continue;
      const auto vr = static_cast<double>(r - from.row), vc = static_cast<double>(c - from.col);
      const double t = u2 > 0.0 ? std::clamp((vr * ur + vc * uc) / u2, 0.0, 1.0) : 0.0;
      const double er = vr - t * ur, ec = vc - t * uc, e2 = er * er + ec * ec;
      if (e2 > reach2) continue;
      if (e2 <= flat2) {
        top = floor;
      } else {
        top = std::min(top, float_above(z_mm + underside_mm(cutter_, side * std::sqrt(e2) + rho)));
      }
    }
}

bool StockGrid::engaged(Cell at, double z_mm, double least_mm) const {
  const auto above = static_cast<float>(z_mm + least_mm);
  for (const Reach& q : shrunk_) {
    const std::ptrdiff_t r = at.row + q.row, c = at.col + q.col;
    if (grid_.contains(r, c) && top_(r, c) > above + q.cap) return true;
  }
  return false;
}

double StockGrid::clear_height(double x_mm, double y_mm) const {
  const auto row =
      static_cast<std::ptrdiff_t>(std::llround((y_mm - grid_.y_mm(0)) / grid_.side_mm()));
  const auto col =
      static_cast<std::ptrdiff_t>(std::llround((x_mm - grid_.x_mm(0)) / grid_.side_mm()));
  double highest = -INFINITY;
  for (const Reach& q : widened_) {
    const std::ptrdiff_t r = row + q.row, c = col + q.col;
    if (grid_.contains(r, c))
      highest = std::max(highest, static_cast<double>(top_(r, c)) - static_cast<double>(q.cap));
  }
  return highest;
}

LinkSurface StockGrid::link_surface() const {
  return {grid_.side_mm(), [this](double x, double y) { return clear_height(x, y); }};
}

heightmap::ModelField StockGrid::field() const {
  std::ptrdiff_t r0 = grid_.rows, r1 = -1, c0 = grid_.cols, c1 = -1;  // where there is stock
  for (std::ptrdiff_t r = 0; r < grid_.rows; ++r)
    for (std::ptrdiff_t c = 0; c < grid_.cols; ++c) {
      if (std::isinf(top_(r, c))) continue;
      r0 = std::min(r0, r), r1 = std::max(r1, r);
      c0 = std::min(c0, c), c1 = std::max(c1, c);
    }
  if (r1 < 0) return {{}, Millimetres{grid_.side_mm()}};
  heightmap::ModelField field{Grid<float>(r1 - r0 + 1, c1 - c0 + 1), Millimetres{grid_.side_mm()},
                              Millimetres{grid_.x_mm(c0)}, Millimetres{grid_.y_mm(r0)}};
  for (std::ptrdiff_t r = r0; r <= r1; ++r)
    for (std::ptrdiff_t c = c0; c <= c1; ++c)
      field.z_mm(r - r0, c - c0) = std::isinf(top_(r, c)) ? NAN : top_(r, c);
  return field;
}

heightmap::ModelField surface_over(const heightmap::ModelField& squares) {
  heightmap::ModelField over = squares;
  const std::ptrdiff_t rows = squares.z_mm.rows(), cols = squares.z_mm.cols();
  const float lowest = heightmap::height_range(squares.z_mm).min;
  for (std::ptrdiff_t r = 0; r < rows; ++r)
    for (std::ptrdiff_t c = 0; c < cols; ++c) {
      float z = lowest;
      for (std::ptrdiff_t i = std::max<std::ptrdiff_t>(0, r - 1); i <= std::min(rows - 1, r + 1);
           ++i)
        for (std::ptrdiff_t j = std::max<std::ptrdiff_t>(0, c - 1); j <= std::min(cols - 1, c + 1);
             ++j)
          if (squares.z_mm(i, j) > z) z = squares.z_mm(i, j);
      over.z_mm(r, c) = z;
    }
  return over;
}

}  // namespace maquette::cnc
