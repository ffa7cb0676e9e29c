// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/linking.hpp"

#include <algorithm>
#include <cmath>

#include "cnc/cutter_location.hpp"
#include "core/check.hpp"

namespace maquette::cnc {
namespace {

std::int64_t tick_above(double mm) {
  return static_cast<std::int64_t>(std::ceil(mm / kTick_mm));
}

}  // namespace

struct CutterClearance::Shared {
  DropCutter widened;
  double step_mm;
};

CutterClearance::CutterClearance(const heightmap::ModelField& field, const Cutter& cutter,
                                 double step_mm) {
  MAQUETTE_CHECK(step_mm > 0.0, "step {} mm", step_mm);
  const Cutter widened = Cutter::bull(cutter.radius_mm + 0.5 * step_mm, cutter.corner_radius_mm);
  shared_ = std::make_shared<const Shared>(Shared{DropCutter(field, widened), step_mm});
}
CutterClearance::~CutterClearance() = default;

LinkSurface CutterClearance::for_thread() const {
  auto cutter = std::make_shared<DropCutter>(shared_->widened);
  return {shared_->step_mm, [cutter](double x, double y) { return cutter->drop(x, y).tip_mm; }};
}

CutterClearance stock_clearance(const heightmap::ModelField& stock,
                                const heightmap::ModelField& design, const Cutter& cutter) {
  const double d = stock.spacing.value();
  const std::ptrdiff_t rows = stock.z_mm.rows(), cols = stock.z_mm.cols();
  const double missing =
      std::max({stock.x0.value() - design.x0.value(), stock.y0.value() - design.y0.value(),
                design.x_mm(design.z_mm.cols() - 1) - stock.x_mm(cols - 1),
                design.y_mm(design.z_mm.rows() - 1) - stock.y_mm(rows - 1)});
  if (missing <= 0.0) return {stock, cutter};
  const auto ring = static_cast<std::ptrdiff_t>(std::ceil(missing / d));
  const bool nodes_are_squares = missing <= 0.5 * d * (1.0 + 1e-9);
  const float highest = heightmap::height_range(stock.z_mm).max;
  heightmap::ModelField wider = stock;
  wider.x0 = Millimetres{stock.x0.value() - d * static_cast<double>(ring)};
  wider.y0 = Millimetres{stock.y0.value() - d * static_cast<double>(ring)};
  wider.z_mm = Grid<float>(rows + 2 * ring, cols + 2 * ring, highest);
  for (std::ptrdiff_t r = 0; r < wider.z_mm.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < wider.z_mm.cols(); ++c) {
      const std::ptrdiff_t from_r = std::clamp<std::ptrdiff_t>(r - ring, 0, rows - 1),
                           from_c = std::clamp<std::ptrdiff_t>(c - ring, 0, cols - 1);
      if (nodes_are_squares || (from_r == r - ring && from_c == c - ring))
        wider.z_mm(r, c) = stock.z_mm(from_r, from_c);
    }
  return {wider, cutter};
}

double highest_tip(const LinkSurface& surface, double x0_mm, double y0_mm, double x1_mm,
                   double y1_mm) {
  const double length = std::hypot(x1_mm - x0_mm, y1_mm - y0_mm);
  const auto steps = std::max<std::int64_t>(
      1, static_cast<std::int64_t>(std::ceil(length / surface.step_mm * (1.0 - 1e-12))));
  double highest = -INFINITY;
  for (std::int64_t k = 0; k < steps; ++k) {  // the middle of each step
    const double t = (static_cast<double>(k) + 0.5) / static_cast<double>(steps);
    highest =
        std::max(highest, surface.tip_mm(x0_mm + t * (x1_mm - x0_mm), y0_mm + t * (y1_mm - y0_mm)));
  }
  return highest;
}

void append_link(Toolpath& path, ToolPosition to, const LinkSurface& surface,
                 const LinkOptions& options) {
  constexpr auto kUnknown = ToolPosition::kUnknown;
  const ToolPosition from = end_of(path);
  MAQUETTE_CHECK(from.x != kUnknown && from.y != kUnknown && from.z != kUnknown &&
                     to.x != kUnknown && to.y != kUnknown && to.z != kUnknown,
                 "a link needs two known positions");
  MAQUETTE_CHECK(
      options.clearance_mm >= 0.0 && options.approach_mm >= 0.0 && options.plunge_feed_mm_min > 0.0,
      "clearance {} mm, approach {} mm, plunge feed {} mm/min", options.clearance_mm,
      options.approach_mm, options.plunge_feed_mm_min);
  ToolPosition at = from;
  const auto go = [&](PathMove::Kind kind, ToolPosition target) {
    if (target == at) return;
    PathMove move;
    move.kind = kind;
    move.to = target;
    if (kind == PathMove::Kind::line) move.feed_mm_min = options.plunge_feed_mm_min;
    path.moves.push_back(move);
    at = target;
  };
  const double x = mm_of_ticks(to.x), y = mm_of_ticks(to.y);
  const double standing = surface.tip_mm(x, y);
  std::int64_t above = to.z;  // where the rapid down ends
  if (std::isfinite(standing))
    above = std::max(to.z, tick_above(std::max(standing, mm_of_ticks(to.z)) + options.approach_mm));
  if (from.x == to.x && from.y == to.y) {
    if (to.z < from.z) go(PathMove::Kind::rapid, {to.x, to.y, std::min(from.z, above)});
    if (to.z > at.z) go(PathMove::Kind::rapid, to);  // straight up
    go(PathMove::Kind::line, to);
    return;
  }
  const double highest = highest_tip(surface, mm_of_ticks(from.x), mm_of_ticks(from.y), x, y);
  std::int64_t across = std::max(from.z, above);
  if (std::isfinite(highest)) across = std::max(across, tick_above(highest + options.clearance_mm));
  go(PathMove::Kind::rapid, {from.x, from.y, across});
  go(PathMove::Kind::rapid, {to.x, to.y, across});
  go(PathMove::Kind::rapid, {to.x, to.y, above});
  go(PathMove::Kind::line, to);
}

}  // namespace maquette::cnc
