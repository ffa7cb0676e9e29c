// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file level_curves.hpp
/// Curves of equal value of a field on a grid, chained, and chains of neighbouring closed curves
/// joined into spirals.
///
/// Each cell is cut along the diagonal whose ends are higher together: a field of distances is
/// concave across its ridges, and a surface through its values lies below it the less. On the
/// triangles curves are exact, then reduced to chords (D. Douglas, T.
/// Peucker, "Algorithms for the reduction of the number of points required to represent a
/// digitized line", Cartographica 10, 1973, doi:10.3138/FM57-6770-U75U-7727) and rounded to 0.001
/// mm. Higher values lie to the left.

#include <cstdint>
#include <vector>

#include "core/run_context.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::cnc {

/// 0.001 mm of the model frame.
struct PlanPlace {
  std::int32_t x = 0, y = 0;
  friend bool operator==(const PlanPlace&, const PlanPlace&) = default;
};

struct LevelCurve {
  std::uint32_t level = 0;  ///< value is first + level * step
  bool closed = false;      ///< the last place joins the first, which is not repeated
  std::vector<PlanPlace> places;
};

/// All curves at first, first + step, ... in ascending order of level, within a level in the
/// order of their first place on the grid. Values may be INFINITY where no curve shall be.
/// Memory: 4 bytes a grid edge crossed, of some levels at a time, beside the result.
/// @pre step > 0, fewer than 2^30 nodes. Curves shorter than `least_mm` are left out. A run that
///      is stopped returns what there is.
[[nodiscard]] std::vector<LevelCurve> level_curves(const heightmap::ModelField& value, double first,
                                                   double step, double tolerance_mm,
                                                   double least_mm, const RunContext& run = {});

/// A way to go; ends apart.
struct PlanCurve {
  std::vector<PlanPlace> places;
  std::uint32_t turns = 1;  ///< level curves it stands for
};

/// Closed curves that each surround just one other of the next level, nowhere more than `reach_mm`
/// away from it in plan, become one spiral: the outermost in full, then from each to the next
/// little by little within one turn, the innermost in full. Of the others closed ones come back to
/// their first place; open ones stay.
[[nodiscard]] std::vector<PlanCurve> link_spirals(const std::vector<LevelCurve>& curves,
                                                  double reach_mm, double tolerance_mm);

/// Leaves out places that lie within `tolerance` of the chords between those that stay; both ends
/// stay.
void reduce_to_chords(std::vector<PlanPlace>& places, double tolerance_mm);

}  // namespace maquette::cnc
