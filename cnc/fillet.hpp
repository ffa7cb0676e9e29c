// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file fillet.hpp
/// Concave edges and hollows rounded to a cutter's radius, so that the design is what the cutter
/// can make.
///
/// Takes   ModelField without voids; the cutter's radius
/// Gives   ModelField of the same nodes: the closing of the surface by the ball, the lowest surface
/// that
///         is nowhere below the design and that the ball can touch everywhere
///
/// Method. What the ball leaves at each node wherever it is put (rest.hpp: exact cutter locations,
/// compass search), added where it is more than the tolerance. At the outline the slopes of
/// the last cells are continued, as in ball_offset.hpp, so that the ball finds room beyond it.
///
/// Accuracy. Nodes where the ball fits stay to the bit, and so do those that it leaves less on than
/// the tolerance. Others are too high by at most (spacing / 16)^2 / (2 R cos^3 t) on slopes of
/// angle t, or a fifth of the tolerance, and by float; where the ball rests on two sides at once
/// and its places make a kink, by up to the tolerance (0.011 mm beside a ball on a plane). Between
/// nodes facets join them: the ball enters a round of its own radius by s^2 / (8 R). Cost    of
/// rest.hpp

#include "core/result.hpp"
#include "core/run_context.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::cnc {

struct Fillet {
  heightmap::ModelField surface;
  double area_mm2 = 0.0;    ///< in plan, of what rose
  double volume_mm3 = 0.0;  ///< that was added
  double highest_mm = 0.0;  ///< that a node rose
};

/// CNC_REST_OPTION_OUT_OF_RANGE: a radius outside 0.05 to 100 mm, no tolerance;
/// CNC_HEIGHT_NOT_FINITE; CORE_CANCELLED. @pre at least 2 x 2 nodes
[[nodiscard]] Result<Fillet> fillet_surface(const heightmap::ModelField& design, Millimetres radius,
                                            Millimetres tolerance = Millimetres{0.02},
                                            const RunContext& run = {});

}  // namespace maquette::cnc
