// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file residual_map.hpp
/// What is left between a source and those before it, place by place.

#include "core/grid.hpp"
#include "heightmap/detail/node_map.hpp"
#include "heightmap/fuse.hpp"

namespace maquette::heightmap::detail {

/// Lower less upper as alignment compares them (surface_pair.hpp): three cells to a pixel of the
/// coarser, both as that pixel sees them; as they are in a site of few such pixels. NaN where one
/// of them has no height, and at spikes.
/// @param lower, upper  on the same nodes, voids NaN
[[nodiscard]] ResidualMap residual_map(const Grid<float>& lower, const Grid<float>& upper,
                                       const NodeGrid& nodes, double lower_pixel_m,
                                       double upper_pixel_m, std::size_t source);

}  // namespace maquette::heightmap::detail
