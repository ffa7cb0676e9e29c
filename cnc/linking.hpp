// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file linking.hpp
/// From where one cut ends to where the next begins, without touching anything: up, across at
/// the lowest safe height for the line actually flown, down, and the last piece at plunge feed.
///
/// Takes   two positions of the tip and what stands in the way: the design's surface, or the
///         stock as it is at that moment (roughing, rest finish), as a LinkSurface
/// Gives   moves appended to a Toolpath
///
/// Method. A cutter widened by half a step all around, at one place, contains the cutter at every
/// place within half a step. So the greatest of the widened cutter's tip heights, one a step along
/// the line, is a height at which the cutter touches nothing anywhere on the line: a bound, not a
/// sample. Being wider, it also keeps half a step off sideways.
///
/// Accuracy. The flown height is nowhere less than `clearance` above the exact cutter location
/// of the line; it is more by at most what the widening costs: on planes half a step times the
/// slope.
/// Rapids straight up are safe because nothing overhangs: surfaces here are height fields, or
/// meshes seen from above.
/// Cost. One cutter location a step.

#include <functional>
#include <memory>

#include "cnc/tool.hpp"
#include "cnc/toolpath.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::cnc {

/// What a rapid must not touch.
struct LinkSurface {
  double step_mm = 0.5;
  /// Height at or above which the tip clears everything while the axis is anywhere within
  /// step_mm / 2 of (x, y); -INFINITY where nothing is in reach. Need not be thread-safe.
  std::function<double(double x_mm, double y_mm)> tip_mm;
};

/// A cutter over a height field: the design or the stock. The surface is copied once; what
/// `for_thread` gives shares it, but has scratch space of its own.
class CutterClearance {
 public:
  /// @pre as for DropCutter; step > 0. The holder is not looked at.
  CutterClearance(const heightmap::ModelField& field, const Cutter& cutter, double step_mm = 0.5);
  ~CutterClearance();
  [[nodiscard]] LinkSurface for_thread() const;

 private:
  struct Shared;
  std::shared_ptr<const Shared> shared_;
};

/// Over a stock whose nodes may end short of the design's outline, such as cells' centres: what
/// stands there is as high as the nearest node within half a spacing of it, and beyond that as high
/// as the stock anywhere. Without that the cutter would come down on the block's rim.
/// @pre as above; both fields without voids
[[nodiscard]] CutterClearance stock_clearance(const heightmap::ModelField& stock,
                                              const heightmap::ModelField& design,
                                              const Cutter& cutter);

struct LinkOptions {
  double clearance_mm = 2.0;          ///< rapids across stay this far above everything
  double approach_mm = 1.0;           ///< rapids down end this far above what stands there
  double plunge_feed_mm_min = 600.0;  ///< from there on down
};

/// Upper bound of the cutter location along the straight line between two places, both ends
/// included; -INFINITY if nothing is in reach.
[[nodiscard]] double highest_tip(const LinkSurface& surface, double x0_mm, double y0_mm,
                                 double x1_mm, double y1_mm);

/// Appends up to four moves from the path's end to `to`: rapid up, rapid across, rapid down,
/// plunge. A piece of no length is left out; nothing at all where the path already ends there.
/// `to` may lie in stock: the plunge then starts above the stock.
/// @pre the path's end and `to` are known; clearance and approach >= 0, plunge feed > 0
void append_link(Toolpath& path, ToolPosition to, const LinkSurface& surface,
                 const LinkOptions& options);

/// Where the path ends.
[[nodiscard]] inline ToolPosition end_of(const Toolpath& path) {
  return path.moves.empty() ? path.start : path.moves.back().to;
}

}  // namespace maquette::cnc
