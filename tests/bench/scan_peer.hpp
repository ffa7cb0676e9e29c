// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>

namespace maquette::scan {

/// Registration and signed distances of `points` points to 2 (nodes - 1)^2 triangles over 2 m x 2
/// m, ours and CloudCompare's (as `tools/setup --peers` or the system has it) on the same files: a
/// table of CPU seconds, errors and ratios. Says so where CloudCompare is missing.
/// @param sampled  points of each of its iterations, stop at 1e-10, and nothing else of it; 0: its
///                 distances, and its ICP as it is
void beside_cloudcompare(std::ptrdiff_t nodes, std::size_t points, std::size_t sampled = 0);

}  // namespace maquette::scan
