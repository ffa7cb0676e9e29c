// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

// Points for choosing among causes.
//
// While causes are chosen, confirmed and named hundreds of models are cut anew at all points. They
// differ by far more than that needs: two scans of 300 000 points on 160 mm x 160 mm have 20 points
// a square millimetre, a ball that steps over by half a millimetre leaves nothing finer than 5
// would show, and a rough coat makes neighbours agree. So of denser points some are drawn for that;
// what remains, sizes and poses are of all of them.

#include <vector>

#include "diagnosis/detail/sums.hpp"

namespace maquette::diagnosis::detail {

/// Those that choose, drawn by their number; empty: there are hardly more than these.
[[nodiscard]] std::vector<Observation> thinned(const std::vector<Observation>& observations,
                                               const Layout& layout);

}  // namespace maquette::diagnosis::detail
