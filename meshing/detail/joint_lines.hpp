// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file joint_lines.hpp
/// Where joints go along one axis, by dynamic programming. Used by bands and tiles.

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace maquette::meshing::detail {

/// What lies at a line of nodes, to be minimised: 0 is free.
using LineCost = std::int64_t;

/// First line, joints, last line of parts of `least` to `most` cells. Of all such cuts those of the
/// least total cost of the joints, of these the fewest parts, of these the most even ones (least
/// sum of squared widths). Time goes with lines times `most`.
/// @param cost  of each line 0 .. n - 1; those of the first and last one say nothing
/// @return empty: there is no such cut
[[nodiscard]] std::vector<std::ptrdiff_t> best_lines(std::span<const LineCost> cost,
                                                     std::ptrdiff_t least, std::ptrdiff_t most);

/// The same for a number of parts, each joint less than half a part's even width from its even
/// place, so that no part is narrower than two cells; time goes with the square of the lines over
/// `parts`. @pre parts has at least two cells each
[[nodiscard]] std::vector<std::ptrdiff_t> best_lines_of(std::span<const LineCost> cost,
                                                        std::ptrdiff_t parts);

}  // namespace maquette::meshing::detail
