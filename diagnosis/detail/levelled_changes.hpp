// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

// What a film that levels, or a spot's mean, makes of the other causes: both are means of the
// surface, h + share (mean of h - h), so of a surface that others have changed by c they level c,
// too. Without that a part that has grown under a film that has run looks grown by less across
// than upwards, for its slopes are less than the design's.

#include <functional>
#include <vector>

#include "diagnosis/effect.hpp"

namespace maquette::diagnosis::detail {

struct LevellingTerm {
  Levels levels;
  double coefficient = 0.0;                     ///< share of the mean
  std::function<double(std::size_t)> moved_mm;  ///< what it moves itself, of each residual
};

/// Adds share (mean of c - c) to `to`, the film's first, then the spot's of what the film has left.
/// Each set-up by itself: what its scanner does is in c, too. What of c is a rigid motion of the
/// set-up is left out, for poses are not known (a range too long by a share is one of a metre, and
/// the rest). Where points are too few for a mean nothing is added.
/// @param change  c as it shows in the residuals, mm
void add_levelled(const std::vector<Observation>& all, std::vector<double> change,
                  const std::vector<LevellingTerm>& terms, std::vector<double>& to);

}  // namespace maquette::diagnosis::detail
