// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file synthetic.hpp
/// All detail that nobody measured: relief that continues the sources' power law (small_relief.hpp)
/// and craters (craters.hpp), below the pixel of the finest source.
///
/// The law is that of all relief, craters included. So relief is lowered by what the craters have:
/// variances from a pixel down to a thirty-second of it are compared, at every scale the same.
/// Craters are as wide as a pixel at most and as narrow as a node.

#include "core/grid.hpp"
#include "core/result.hpp"
#include "core/run_context.hpp"
#include "heightmap/detail/node_map.hpp"
#include "heightmap/detail/roughness.hpp"
#include "heightmap/fuse.hpp"

namespace maquette::heightmap::detail {

/// Adds it to the surface's heights and uncertainty, marks where it was added, counts the craters.
/// A warning says if there is none to add.
/// @return CORE_CANCELLED
[[nodiscard]] Result<void> add_synthetic(FusedSurface& surface, const FuseRequest& request,
                                         const NodeGrid& nodes, const Roughness& roughness,
                                         double pixel_m, const RunContext& run);

}  // namespace maquette::heightmap::detail
