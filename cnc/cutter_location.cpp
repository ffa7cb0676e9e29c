// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/cutter_location.hpp"

#include <algorithm>
#include <array>
#include <optional>
#include <type_traits>
#include <vector>

#include "cnc/ball_bound.hpp"
#include "cnc/cell_contact.hpp"
#include "cnc/height_tiles.hpp"
#include "cnc/padded_heights.hpp"
#include "cnc/reach_window.hpp"
#include "core/check.hpp"

namespace maquette::cnc {
namespace {

double furthest_from_zero(const heightmap::ModelField& field) {
  float furthest = 0.0F;
  for (const float z : field.z_mm.cells()) furthest = std::max(furthest, std::abs(z));
  return static_cast<double>(furthest);
}

std::optional<ReachWindows> windows_of(const heightmap::ModelField& field, const Cutter& tool) {
  if (!ReachWindows::fits(tool, field.spacing.value())) return std::nullopt;
  return ReachWindows(tool, field.spacing.value(), furthest_from_zero(field));
}

}  // namespace

struct DropCutter::Surface {
  Surface(const heightmap::ModelField& field, const Cutter& tool)
      : shape(shape_of(tool)),
        windows(windows_of(field, tool)),
        heights(field, std::max(HeightTiles::kMargin, windows ? windows->margin_rows() : 0),
                std::max(HeightTiles::kMargin, windows ? windows->margin_cols() : 0)) {
    for (const HolderPart& part : tool.holder) holder.push_back({part.bottom_mm, cone_of(part)});
    if (!windows || !holder.empty()) tiles.emplace(heights);
  }

  struct Part {
    double bottom_mm;
    ConeShape shape;
  };
  CutterShape shape;
  std::vector<Part> holder;
  std::optional<ReachWindows> windows;  // of cutters that are not too wide for them
  PaddedHeights heights;
  std::optional<HeightTiles> tiles;

  template <class Shape>
  void drop(const Shape& body, double x_mm, double y_mm, Touch& best) const;
};

namespace {

const heightmap::ModelField& checked(const heightmap::ModelField& field, const Cutter& tool) {
  check_cutter(tool);
  MAQUETTE_CHECK(field.z_mm.rows() >= 2 && field.z_mm.cols() >= 2, "{} x {} nodes",
                 field.z_mm.rows(), field.z_mm.cols());
  MAQUETTE_CHECK(field.spacing.value() > 0.0, "spacing {} mm", field.spacing.value());
  return field;
}

}  // namespace

DropCutter::DropCutter(const heightmap::ModelField& field, const Cutter& tool)
    : surface_(std::make_shared<const Surface>(checked(field, tool), tool)) {}

template <class Shape>
void DropCutter::Surface::drop(const Shape& body, double x_mm, double y_mm, Touch& best) const {
  const PaddedHeights& h = heights;
  const double tx = (x_mm - h.x0) * h.per_d, ty = (y_mm - h.y0) * h.per_d;
  if (!windows->reaches(tx, h.cols) || !windows->reaches(ty, h.rows)) return;
  const WindowPlace place = windows->at(tx, ty);
  const float* z = h.node(place.row, place.col);

  std::array<float, ReachWindows::kMostCells + kLanes> bound;
  std::array<WindowCell, ReachWindows::kMostCells> cells;
  const float low = windows->bounds(place, z, h.stride, bound.data());
  const CellContact<Shape> contact(body, h.d);
  const auto work_out = [&](WindowCell cell) {
    const std::ptrdiff_t row = place.row + cell.row, col = place.col + cell.col;
    if (row < 0 || col < 0 || row >= h.rows || col >= h.cols) return;
    contact.touch(h.corners(row, col, x_mm, y_mm), best);
  };

  const std::size_t n = windows->collect(place, low, bound.data(), cells.data());
  float base = 0.0F;
  if constexpr (std::is_same_v<Shape, BallShape>) {
    if (low > kNoSurface) base = low;
    const BallBound sharper(body.R, h.d, z, h.stride, (tx - static_cast<double>(place.col)) * h.d,
                            (ty - static_cast<double>(place.row)) * h.d);
    sharper(cells.data(), n, base, bound.data());
  }
  if (n > 0) {
    // The most promising cell first, so that few others beat what it gives.
    const auto top =
        static_cast<std::size_t>(std::max_element(bound.data(), bound.data() + n) - bound.data());
    work_out(cells[top]);
    for (std::size_t i = 0; i < n; ++i)
      if (i != top && !(static_cast<double>(bound[i]) + static_cast<double>(base) <= best.tip_mm))
        work_out(cells[i]);
  }
  // Under a flat end bounds are exact, and the node that gave the lower one need not beat it.
  if (best.tip_mm < static_cast<double>(low)) {
    windows->bounds(place, z, h.stride, bound.data());
    const std::size_t m =
        windows->collect(place, std::nextafter(low, kNoSurface), bound.data(), cells.data());
    for (std::size_t i = 0; i < m && best.tip_mm < static_cast<double>(low); ++i)
      work_out(cells[i]);
  }
}

CutterContact DropCutter::drop(double x_mm, double y_mm) const {
  Touch best;
  std::visit(
      [&](const auto& shape) {
        if (surface_->windows)
          surface_->drop(shape, x_mm, y_mm, best);
        else
          surface_->tiles->drop(surface_->heights, shape, x_mm, y_mm, best);
      },
      surface_->shape);
  return {best.tip_mm, best.dx_mm, best.dy_mm};
}

CutterContact DropCutter::drop_holder(double x_mm, double y_mm) const {
  CutterContact highest;
  for (const Surface::Part& part : surface_->holder) {
    Touch best;
    if (highest.tip_mm > -INFINITY) best.tip_mm = highest.tip_mm + part.bottom_mm;
    const double before = best.tip_mm;
    surface_->tiles->drop(surface_->heights, part.shape, x_mm, y_mm, best);
    if (best.tip_mm > before) highest = {best.tip_mm - part.bottom_mm, best.dx_mm, best.dy_mm};
  }
  return highest;
}

}  // namespace maquette::cnc
