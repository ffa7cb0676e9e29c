// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file path_filter.hpp
/// Samples of the exact cutter location -> fewer straight moves inside a tolerance.
///
/// Greedy: from each vertex the cone of slopes that pass every following sample within
/// its own tolerance band is narrowed until it closes; the last sample at which it was open
/// becomes the next vertex. Every sample is checked, never only the middle of a run, and the
/// band of a sample is what the bounds between samples leave of the tolerance. Linear time.
/// The cone method is that of J. Sklansky, V. Gonzalez, "Fast polygonal approximation of
/// digitized curves", Pattern Recognition 12, 1980, doi:10.1016/0031-3203(80)90031-X.

#include <cstdint>
#include <vector>

#include "cnc/pass_sampler.hpp"

namespace maquette::cnc {

struct PathVertex {
  std::int64_t along = 0, z = 0;  ///< ticks
  friend bool operator==(const PathVertex&, const PathVertex&) = default;
};

/// The written path lies at most `tolerance_mm` below the exact cutter location (the
/// ball cuts no deeper than that, measured vertically) and, where no wall forced a lift or an
/// unresolved dip, at most as much above. Both ends are at their samples' own height.
/// @pre samples are in order of tick, their gouge below tolerance / 2
/// @param vertices  replaced
/// @return bound on the gouge of the written path, from the written numbers
[[nodiscard]] double filter_path(const std::vector<PathSample>& samples, double tolerance_mm,
                                 std::vector<PathVertex>& vertices);

}  // namespace maquette::cnc
