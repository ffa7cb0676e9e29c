// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file clean_layer.hpp
/// A source's window before it is laid on the site's nodes: artefacts found and dealt with, small
/// voids filled, and where all this is, on the nodes.

#include <string>

#include "core/grid.hpp"
#include "core/result.hpp"
#include "core/run_context.hpp"
#include "heightmap/artefacts.hpp"
#include "heightmap/dem_reader.hpp"
#include "heightmap/detail/node_map.hpp"

namespace maquette::heightmap::detail {

/// On the site's nodes; each empty where there is nothing to mark.
struct LayerMarks {
  Grid<std::uint8_t> artefacts;  ///< bits of Artefact
  Grid<float> doubt_m;           ///< standard uncertainty beside the source's own, 0 where none
  Grid<std::uint8_t> made;       ///< 1: the height is made up, like what is around
};

struct CleanedLayer {
  LayerMarks marks;
  ArtefactReport report;
  double filled_share = 0.0;  ///< of the window's pixels: voids that were filled
};

/// Changes the window's heights. Voids that nothing but their own source could fill, because they
/// are at most `widest_void_m` wide and within it, get relief like that around (void_fill.hpp).
/// @return CORE_CANCELLED
[[nodiscard]] Result<CleanedLayer> clean_layer(PixelWindow& window, const PixelSize& pixel,
                                               const NodeMap& map, Clean what, double widest_void_m,
                                               const RunContext& run);

/// "3 spikes, a box of 1.2 m, ..."; empty if there are none.
[[nodiscard]] std::string in_words(const ArtefactReport& report, double pixel_m);

}  // namespace maquette::heightmap::detail
