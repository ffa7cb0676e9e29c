// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file disc_filter.hpp
/// Round means at every place and of every width: what fixed cells miss because it lies across four
/// of them.
///
/// Filter   Of all filters for a patch of one height in noise that is independent from point to
///          point its own shape is the best (matched filter: North 1943, reprinted 1963,
///          doi:10.1109/PROC.1963.2383). Discs of 2 to 11 cells of the finest map and of 8 and 11
///          cells of the others, so widths a factor of 1.3 to 1.5 apart, stand at every cell.
/// Level    Bonferroni: the level is divided by the number of all discs. They overlap, so fewer are
///          independent; that costs 0.3 of the 6 standard deviations.
/// Noise    As points scatter within cells, beside what is typical: a patch adds to it at its edge
///          alone, while steep places keep their own.
/// Limit    A patch of width w that stands h out of its surroundings is found with 95 % if
///          h o / a >= z sigma + 1.645 s, a: the area of a disc, o: what it has in common with the
///          patch where the cells lie worst, sigma: what is stated of the disc's mean, s: how it
///          scatters, with the number of points that happen to lie in the patch; the least h over
///          all discs.

#include <span>
#include <vector>

#include "scan/detail/patches.hpp"

namespace maquette::scan::detail {

struct Disc {
  double x_mm = 0.0, y_mm = 0.0, width_mm = 0.0;
  double z = 0.0;          ///< its mean in standard deviations
  double inflation = 1.0;  ///< what correlation between points makes of them
};

struct DiscSearch {
  std::vector<Disc> found;  ///< beyond the threshold, most certain first
  double threshold = 0.0;   ///< in standard deviations
  std::vector<DetectionLimit> limits;
};

/// @param layers  finest first, each of half the cells a side of the one before
/// @param typical_variance  of one point
/// @param level   probability that anything is found where there is nothing
/// @param pose    is the pose's error one of the means?
[[nodiscard]] DiscSearch search_discs(std::span<const Layer> layers, double typical_variance,
                                      double level, bool pose);

}  // namespace maquette::scan::detail
