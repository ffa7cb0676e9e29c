// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file small_relief.hpp
/// Relief below the pixel of the finest source, made up: nobody measured it. It
/// continues the roughness that the source shows at a few pixels as a power law.

#include <cstdint>

#include "core/grid.hpp"
#include "core/result.hpp"
#include "core/run_context.hpp"
#include "heightmap/dem_reader.hpp"
#include "heightmap/detail/node_map.hpp"

namespace maquette::heightmap::detail {

/// Mean squared height difference over a distance L is coefficient * L^(2 hurst).
struct Roughness {
  double hurst = 0.5;
  double coefficient = 0.0;
};

/// From second differences at 1, 2 and 4 pixels beyond the first: slopes of the site
/// do not count as roughness. Coefficient 0 if there are too few pixels.
[[nodiscard]] Roughness measure_roughness(const PixelWindow& window, const PixelSize& pixel);

/// Adds octaves of noise between the wavelengths 2 pixel_m and 2 spacing, each a cubic
/// B-spline over high-passed random normals, so that hardly anything is added to what
/// the source resolves. The value at a point depends on seed and position in the site
/// alone. Counters: (octave, lattice row, lattice column) from the site's centre.
/// @return standard deviation of what was added, or CORE_CANCELLED
[[nodiscard]] Result<double> add_small_relief(Grid<float>& z, const NodeGrid& nodes,
                                              const Roughness& roughness, double pixel_m,
                                              double strength, std::uint64_t seed,
                                              const RunContext& run);

}  // namespace maquette::heightmap::detail
