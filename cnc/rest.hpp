// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file rest.hpp
/// Where a ball leaves material because it does not fit, before anything is cut; and the
/// passes of a smaller ball there and only there.
///
/// Takes   ModelField, mm, no voids; the ball that finishes, the ball that follows
/// Gives   a field of what stays above the design, with its area and volume; a Toolpath
///
/// The map. What a ball leaves at node x is the least of tip(p) + R - sqrt(R^2 - |x - p|^2) over
/// the places p within R of x, minus the design: the morphological closing of the surface by the
/// ball. First over the grid's nodes; where that leaves more than the threshold, p is improved by
/// a compass search with exact cutter locations down to a sixteenth of the spacing. Any p gives an
/// upper bound, so nothing that stays is missed; on a slope of angle t the search ends within
/// (spacing / 16)^2 / (2 R cos^3 t) of the truth, which is how much may be mapped too much.
///
/// The passes. Rows along x; each over every node within (smaller radius + overlap) of one where
/// more than the threshold stays: nothing outside that reach can take material there. On the exact
/// cutter location, sampled and fitted as the finish is (pass_sampler.hpp, fit_moves.hpp), so
/// with its bounds. Where more than `depth` stays, layers `depth` apart come first: the same path
/// raised, clipped to where something is left for them. Neighbouring rows are joined along the
/// surface, others by links over what the first ball left.
///
/// Cost. A cutter location and (R / spacing)^2 comparisons a node, some hundred cutter
/// locations a node where more may stay; memory 13 bytes a node.

#include <cstdint>

#include "cnc/mill.hpp"
#include "cnc/tool.hpp"
#include "core/result.hpp"
#include "core/run_context.hpp"
#include "core/units.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::cnc {

inline constexpr ErrorCode kRestOptionOutOfRange{"CNC_REST_OPTION_OUT_OF_RANGE"};

struct RestMap {
  heightmap::ModelField remaining;  ///< mm above the design at its nodes, >= 0; the upper bound
  double threshold_mm = 0.0;
  double area_mm2 = 0.0;    ///< in plan, of what is above the threshold
  double volume_mm3 = 0.0;  ///< of it
  double highest_mm = 0.0;
};

/// @pre design has at least 2 x 2 nodes
/// @return CNC_REST_OPTION_OUT_OF_RANGE, CNC_HEIGHT_NOT_FINITE, CORE_CANCELLED
[[nodiscard]] Result<RestMap> map_rest(const heightmap::ModelField& design, BallNose ball,
                                       Millimetres threshold = Millimetres{0.05},
                                       const RunContext& run = {});

struct RestOptions {
  double ball_radius_mm = 1.5;  ///< of the smaller ball
  double stepover_mm = 0.2;
  double overlap_mm = 0.5;
  double depth_mm = 2.0;       ///< that the smaller ball may take in one go
  double tolerance_mm = 0.01;  ///< as the finish shares it (share_tolerance)
  bool arcs = true;
  double feed_mm_min = 2000.0, plunge_feed_mm_min = 400.0;
  double clearance_mm = 2.0;
};

struct RestReport {
  int layers = 0;
  std::uint64_t passes = 0, links_cut = 0, links_flown = 0, moves = 0;
  double cutting_length_mm = 0.0;  ///< chords of arcs
  double certified_gouge_mm = 0.0;
};

/// Pieces as of mill_passes(): unbroken, from above everything to above everything. Nothing is
/// given if nothing remains. Same moves for any number of threads.
/// @pre the map is of this design
/// @return CNC_REST_OPTION_OUT_OF_RANGE with option, value and range; CNC_HEIGHT_NOT_FINITE; the
///         sink's error; CORE_CANCELLED
[[nodiscard]] Result<RestReport> rest_finish(const heightmap::ModelField& design,
                                             const RestMap& map, const RestOptions& options,
                                             const ToolpathSink& sink, const RunContext& run = {});

}  // namespace maquette::cnc
