// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file surface_path.hpp
/// Ways in plan -> moves of a ball nose along its exact cutter location, with bounds.
///
/// Each straight piece of a way becomes lines on lattices (aimed_line.hpp; one, if the way was made
/// writable), so that every sample is exactly on a line that a program can write. Along it the
/// cutter location is sampled and fitted (pass_sampler.hpp, fit_lines.hpp); pieces meet within the
/// tolerance. Ways less than `kLongestCutLink_mm` apart are joined over the surface, others by
/// rapids at the lowest safe height (linking.hpp).

#include <cstdint>
#include <span>

#include "cnc/aimed_line.hpp"
#include "cnc/fit_moves.hpp"
#include "cnc/level_curves.hpp"
#include "cnc/mill.hpp"
#include "cnc/path_figures.hpp"

namespace maquette::cnc {

struct SurfacePathOptions {
  BallNose tool;
  Millimetres tolerance{0.01};
  FeedRate feed{3000.0}, plunge_feed{600.0};
  Millimetres clearance{5.0};
  Millimetres stock_allowance{NAN};  ///< as in GeodesicPassOptions
};

inline constexpr double kLongestCutLink_mm = 2.0;

struct SurfacePathReport {
  PathFigures figures;
  FitBounds bounds;
  std::uint64_t points_sampled = 0, links_cut = 0, links_flown = 0;
};

/// Cuts the ways in order; each from whichever of its ends is nearer, the next being the one with
/// the end nearest to where the cutter is. Ways are cut back to the design's outline.
/// @pre design and options as checked by check_mill; at least one way with two places
/// @return figures; the sink's error; CORE_CANCELLED
[[nodiscard]] Result<SurfacePathReport> cut_along(const heightmap::ModelField& design,
                                                  std::span<const PlanCurve> ways,
                                                  const SurfacePathOptions& options,
                                                  const ToolpathSink& sink, const RunContext& run);

}  // namespace maquette::cnc
