// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file layer.hpp
/// One source on the site's nodes: read, cleaned, laid, and moved to where it belongs.

#include <cstddef>
#include <functional>
#include <optional>

#include "core/grid.hpp"
#include "core/result.hpp"
#include "core/run_context.hpp"
#include "heightmap/dem_reader.hpp"
#include "heightmap/detail/clean_layer.hpp"
#include "heightmap/detail/node_map.hpp"
#include "heightmap/detail/roughness.hpp"
#include "heightmap/detail/site_frame.hpp"
#include "heightmap/fuse.hpp"

namespace maquette::heightmap::detail {

struct Layer {
  Grid<float> z_m;
  PixelWindow window;
  PixelSize pixel;
  std::ptrdiff_t covered = 0;
  Clean clean = Clean::off;
  double widest_void_m = 0.0;  ///< of those that are filled from its own relief
  LayerMarks marks;
  bool adjusted = false;  ///< in its place by the joint adjustment
};

/// A source with its layer.
struct ReadSource {
  DemReader dem;
  Layer layer;
  Roughness roughness;
};

/// Pixels of the file along the side of a cell of the window: white noise is as much lower.
[[nodiscard]] double pixels_across(const PixelWindow& window);

/// Reads what the nodes need; artefacts go into `report`, and are said.
/// @param pixel_below_m  narrowest of the sources before it; 0: there are none
/// @return HEIGHTMAP_NO_OVERLAP, HEIGHTMAP_ALL_VOID, the reader's errors, CORE_CANCELLED
[[nodiscard]] Result<Layer> read_layer(const FuseRequest& request, const Source& source,
                                       double pixel_below_m, const DemReader& dem,
                                       const SiteFrame& site, const NodeGrid& nodes,
                                       SourceReport& report, const RunContext& run);

/// A source that lies outside the enlargement of a surface that it was part of.
[[nodiscard]] Layer nothing_of(const DemReader& dem, const SiteFrame& site, const NodeGrid& nodes);

/// Takes a layer's heights from elsewhere (nothing: from where they are) and raises them by
/// raised_m(x, y) at each node; what it covers may change a little.
[[nodiscard]] Result<void> move(Layer& layer, const DemReader& dem, const SiteFrame& site,
                                const NodeGrid& nodes, const std::optional<Origin>& origin,
                                const RunContext& run,
                                const std::function<double(double x_m, double y_m)>& raised_m);

}  // namespace maquette::heightmap::detail
