// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file cutter_reach.hpp
/// What a design asks of the cutter before there is any program: where the ball does not fit, how
/// steep it is, how deep.
///
/// Takes    ModelField, mm, no voids; the radius of the ball that finishes
/// Reach    What the ball leaves at each node wherever it is put (rest.hpp: the closing of the
///          surface by the ball). It is more than a threshold where the surface is hollow with a
///          smaller radius than the ball's, or at the foot of a crease.
/// Slope    Of the facets, exact up to the rounding of heights; a node has that of its steepest
///          facet. Shares are of the area in plan.
/// Depth    Highest less lowest height: what the block must be higher than its base, and the cutter
///          longer than its holder.
/// Cost     Of rest.hpp; 8 bytes a node.

#include "cnc/rest.hpp"
#include "cnc/tool.hpp"
#include "core/grid.hpp"
#include "core/result.hpp"
#include "core/run_context.hpp"
#include "core/units.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::cnc {

struct SlopeMap {
  Grid<float> steepest_deg;  ///< of the facets that hold a node, from level
  double highest_deg = 0.0;
  double highest_x_mm = 0.0, highest_y_mm = 0.0;  ///< middle of that facet's cell
  double share_above = 0.0;                       ///< of the plan, steeper than the limit
};

/// @param limit_deg  90: nothing is above
/// @pre at least 2 x 2 nodes, none void
[[nodiscard]] SlopeMap map_slope(const heightmap::ModelField& design, double limit_deg);

struct CutterReach {
  RestMap rest;
  double unreached_share = 0.0;                   ///< of the plan, more than the threshold stays
  double deepest_x_mm = 0.0, deepest_y_mm = 0.0;  ///< where most of it stays
  SlopeMap slope;
  double relief_mm = 0.0;
};

/// @param threshold  that the ball may leave
/// @return errors of map_rest()
[[nodiscard]] Result<CutterReach> map_cutter_reach(const heightmap::ModelField& design,
                                                   BallNose ball, Millimetres threshold,
                                                   double slope_limit_deg,
                                                   const RunContext& run = {});

}  // namespace maquette::cnc
