// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file cover_gaps.hpp
/// How far the cutter location surface lies from a path on it, the ridge that this leaves, and
/// strokes where it is too far: kinks and ends of level curves, places where fronts meet, pits.
///
/// A ball at distance v (in space, along the surface of its centres) from where it should have
/// been leaves v^2 (1 + R kappa) / (2 R) there, kappa > 0 the curvature of that surface where it is
/// hollow: between two paths D apart on a plane R - sqrt(R^2 - D^2 / 4), more in a hollow, nothing
/// more on a dome. kappa is taken from second differences of the tips.
///
/// v is sampled every `sampling_mm` in plan, half of which is added to it in the ridge: a
/// prediction, not a bound. Strokes are straight lines that a program can write (aimed_line.hpp),
/// each through the place that is farthest from the path, the way in which it leaves least undone,
/// until no sample is farther than allowed.

#include <cstdint>
#include <span>
#include <vector>

#include "cnc/level_curves.hpp"
#include "cnc/scallop.hpp"
#include "core/run_context.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::cnc {

struct GapLimits {
  double distance_mm = 0.3;  ///< v is nowhere more; in hollows less, if they count
  double sampling_mm = 0.04;
  bool hollows_count = false;
  double most_hollow = 9.0;  ///< hollow factor from which on a hollow counts no more
  double ridge_mm = 0.011;   ///< the share of the surface above it is counted
};

struct GapReport {
  std::vector<PlanCurve> strokes;
  ScallopMap scallop;  ///< with the strokes cut
};

/// 1 + R kappa at a node, at least 1.
[[nodiscard]] double hollow_factor(const heightmap::ModelField& tips, std::ptrdiff_t row,
                                   std::ptrdiff_t col, double radius_mm);

/// @param tips  height of the tip at each node; the path lies inside
/// The same for any number of threads. A run that is stopped returns what there is.
[[nodiscard]] GapReport cover_gaps(const heightmap::ModelField& tips, BallNose tool,
                                   std::span<const PlanCurve> path, const GapLimits& limits,
                                   const RunContext& run = {});

}  // namespace maquette::cnc
