// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file fit_lines.hpp
/// Samples of the exact cutter location along one line or along several that follow each other
/// -> nearly as few straight moves as the tolerance allows.
///
/// Method. Around the samples the tolerance leaves a tube, above narrower by what the path between
/// samples may dip, below by what it may gouge. Its path of fewest links (fewest_links.hpp; a
/// vertex wherever the plan turns) has vertices at any height and place; these are put, one after
/// the other, on the nearest place that can be written from which the link before them and the link
/// after them stay inside. The tube is narrower than the tolerance by half a unit of writing for
/// that; where it does not help, a vertex is added at a sample.
///
/// Accuracy. As of fit_moves.hpp: bounds are of the moves as written. Cost. 0.3 us a sample.

#include <span>
#include <vector>

#include "cnc/fit_moves.hpp"

namespace maquette::cnc {

/// A line's samples; the next line begins where this one ends.
struct SampledLine {
  std::span<const PathSample> samples;  ///< at least two
  double step_mm = 0.0;
};

/// Moves of each line, as of fit_moves. Both ends of the whole are at their samples' own height,
/// rounded up; between lines the path may pass anywhere within the tolerance, but where they
/// meet the last move of one ends at the height at which the next begins.
/// @pre as of fit_moves
[[nodiscard]] FitBounds fit_lines(std::span<const SampledLine> lines, const FitLimits& limits,
                                  std::vector<std::vector<FittedMove>>& moves);

}  // namespace maquette::cnc
