// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file small_relief.hpp
/// Relief below the pixel of the finest source, made up: nobody measured it. It
/// continues the power law that the source shows at a few pixels (roughness.hpp).

#include <cstdint>

#include "core/grid.hpp"
#include "core/result.hpp"
#include "core/run_context.hpp"
#include "heightmap/detail/node_map.hpp"
#include "heightmap/detail/roughness.hpp"

namespace maquette::heightmap::detail {

/// Variance of relief with this roughness between two radial frequencies, 1/m.
[[nodiscard]] double relief_variance_m2(const Roughness& roughness, double f_low, double f_high);

/// Adds octaves of noise between the wavelengths 2 pixel_m and 2 spacing, each a cubic
/// B-spline over high-passed random normals, so that hardly anything is added to what
/// the source resolves, of the same variance everywhere. The value at a point depends on seed and
/// position in the site alone. Counters: (octave, lattice row, lattice column) from the site's
/// centre.
/// @return standard deviation of what was added, or CORE_CANCELLED
[[nodiscard]] Result<double> add_small_relief(Grid<float>& z, const NodeGrid& nodes,
                                              const Roughness& roughness, double pixel_m,
                                              double strength, std::uint64_t seed,
                                              const RunContext& run);

}  // namespace maquette::heightmap::detail
