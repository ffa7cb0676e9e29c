// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file blend.hpp
/// Lays one source over what is there, without a seam and without loss of its detail.
///
/// Method. q is what the two say differently of the waves that both resolve: the finer one averaged
/// over the coarser one's pixel, less the coarser one, then smoothed by a Gaussian half a
/// pixel wide over the nodes that have both. Inside, z = layer - (1 - s) q; at the border that
/// becomes what is below within a few of the finer pixels. s rises from 0 at the border to t over a
/// wide ramp: so datums and long errors of the two meet gently, while detail is whole nearly to the
/// border. (Burt and Adelson 1983, doi:10.1145/245.247, blend every octave over its own wavelength;
/// here detail does not give way to a source that has none.) t is the layer's share of the long
/// waves: by inverse variances of both over one coarse pixel.

#include <cstdint>

#include "core/grid.hpp"

namespace maquette::heightmap::detail {

struct BlendScales {
  double below_pixel = 1.0, layer_pixel = 1.0;      ///< nodes
  double below_sigma_m = 1.0, layer_sigma_m = 1.0;  ///< of one pixel
  double ramp = 2.0;                                ///< nodes from the border to the whole layer
};

/// @param z, sigma_m, source  what is there, without voids; where the layer is at least half,
/// `source`
///   becomes `index`
/// @param layer  on the same nodes, void NaN. The grid's own edge is no border of the layer.
/// Same result for any number of threads.
void blend(Grid<float>& z, Grid<float>& sigma_m, Grid<std::uint8_t>& source,
           const Grid<float>& layer, const BlendScales& scales, std::uint8_t index);

}  // namespace maquette::heightmap::detail
