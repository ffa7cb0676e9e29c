// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file waterline.hpp
/// Passes at constant height where the surface is steep, with a ball nose: there parallel
/// passes lie far apart on the surface, and these do not.
///
/// Takes   ModelField, mm, no voids; ball, allowance
/// Gives   Toolpath, level by level from the top, to a sink; within a level the nearest contour
///         next; closed contours closed
///
/// Method. The exact cutter location at the nodes says which edges of the grid a level passes
/// (level_contours.hpp); on each of them, and between them, the place where the cutter just does
/// not touch is found to 0.001 mm by exact cutter locations. Contours keep where the contact is
/// steeper than `least_slope`, and `overlap` farther. The surface lies to the right: climb
/// milling with a clockwise spindle.
///
/// Accuracy. A ball that is free at both ends of a level chord of length h is pierced by no point
/// of the surface deeper than R - sqrt(R^2 - h^2 / 4): squared distances to a point along a
/// straight line exceed the interpolated ones by at most h^2 / 4 less. Measured vertically
///     gouge <= w - sqrt(w^2 - h^2 / 4)       w: least depth of a contact below the ball's centre
/// (steepness.hpp; w > h / 2). Chords are halved, each new vertex on the exact contour, until
/// this is at most `tolerance`, for chords above 0.01 mm; below, what is reached is reported.
/// Where the contour turns away from a chord by more than the tolerance, the chord is
/// halved too, but for kinks that no vertex on its middle line meets. Contours smaller than the
/// spacing may be missed: material stays there, for the passes over the shallow parts. Derivation:
/// docs/derivations/waterline.md Cost. One cutter location a node, some ten each 0.1 to 0.2 mm of
/// contour.

#include <cmath>
#include <cstdint>

#include "cnc/mill.hpp"
#include "core/result.hpp"
#include "core/run_context.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::cnc {

inline constexpr ErrorCode kWaterlineOptionOutOfRange{"CNC_WATERLINE_OPTION_OUT_OF_RANGE"};

struct WaterlineOptions {
  double ball_radius_mm = 3.0;
  double allowance_mm = 0.0;  ///< distance kept from the design, in space
  double step_mm = 0.5;       ///< between levels
  double least_slope_deg = 55.0;
  double overlap_mm = 2.0;      ///< along the contour, beyond where it is steep
  double tolerance_mm = 0.002;  ///< gouge and deviation between vertices
  double feed_mm_min = 3000.0, plunge_feed_mm_min = 600.0;
  double clearance_mm = 2.0;  ///< of rapids over everything
  /// What stands before this pass, as a surface; nullptr: no more than the allowance.
  const heightmap::ModelField* stock = nullptr;
};

struct WaterlineReport {
  int levels = 0;
  std::uint64_t contours = 0, points = 0;
  double cutting_length_mm = 0.0;
  double certified_gouge_mm = 0.0;         ///< bound, vertically
  double certified_normal_gouge_mm = 0.0;  ///< bound, in space
};

/// One piece for each level on which something is steep; the first starts above everything, and
/// the last ends there. Same moves for any number of threads.
/// @pre design, and stock if given, have at least 2 x 2 nodes
/// @return CNC_WATERLINE_OPTION_OUT_OF_RANGE with option, value and range; CNC_HEIGHT_NOT_FINITE;
///         the sink's error; CORE_CANCELLED
[[nodiscard]] Result<WaterlineReport> waterline(const heightmap::ModelField& design,
                                                const WaterlineOptions& options,
                                                const ToolpathSink& sink,
                                                const RunContext& run = {});

}  // namespace maquette::cnc
