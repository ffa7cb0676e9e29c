// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

// Points for choosing among causes.
//
// While causes are chosen hundreds of models are cut anew at all points of a third of the blocks.
// They differ by far more than a choice needs: two scans of 300 000 points on 160 mm x 160 mm have
// 20 points a square millimetre, a ball that steps over by half a millimetre leaves nothing finer
// than 5 would show, and a rough coat makes neighbours agree. So of denser points some are drawn
// for choosing; what is confirmed, named and sized is at all of them.

#include <vector>

#include "diagnosis/detail/sums.hpp"

namespace maquette::diagnosis::detail {

/// In -2 log likelihood of the choosing blocks: what a model gains from which on fewer points
/// choose as well. Less is told by so few that each counts: of 450, with a third of the points, a
/// scale and a warp were two lost steps more, and none held.
inline constexpr double kToldByFew = 3000.0;

/// Those that choose, drawn by their number; empty: there are hardly more than these.
[[nodiscard]] std::vector<Observation> thinned(const std::vector<Observation>& observations,
                                               const Layout& layout);

}  // namespace maquette::diagnosis::detail
