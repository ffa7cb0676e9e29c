// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file disc_samples.hpp
/// Points spread evenly over a disc: a jittered grid of the square, in an order of
/// its own for every pixel, mapped so that neighbours stay neighbours.

#include <cstdint>
#include <vector>

namespace maquette::camera {

struct DiscPoint {
  double x = 0.0, y = 0.0;  ///< in the unit disc
};

/// Square [0, 1)^2 to unit disc, areas kept: Shirley and Chiu 1997,
/// doi:10.1080/10867651.1997.10487479.
[[nodiscard]] DiscPoint concentric_disc(double u, double v);

/// `count` points, one in each cell of a grid of a x b = count cells with a and b
/// as near as the divisors of count allow (a square number is best), shuffled.
/// A pure function of (count, stream).
void stratified_disc(int count, std::uint64_t stream, std::vector<DiscPoint>& points);

}  // namespace maquette::camera
