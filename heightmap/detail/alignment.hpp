// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file alignment.hpp
/// Layers brought onto each other, by pairs (coregister.hpp), all at once (joint_adjustment.hpp) or
/// as they lay in a surface that is enlarged; and what the sources' reports say of it.

#include <vector>

#include "core/grid.hpp"
#include "core/result.hpp"
#include "core/run_context.hpp"
#include "heightmap/detail/layer.hpp"

namespace maquette::heightmap::detail {

/// Says which sources count their heights from elsewhere than the base. A base whose pixels are
/// wider than the site cannot tell.
/// @return HEIGHTMAP_DATUM_DIFFERS where a source may not be moved
[[nodiscard]] Result<void> check_datums(const FuseRequest& request,
                                        const std::vector<ReadSource>& read,
                                        const FusedSurface& surface, const NodeGrid& nodes,
                                        const RunContext& run);

/// True if sources are to be aligned all at once.
[[nodiscard]] bool wants_joint(const FuseRequest& request);

/// Brings all layers that pairs tie to the base onto each other and reports how.
[[nodiscard]] Result<void> align_jointly(const FuseRequest& request, std::vector<ReadSource>& read,
                                         const SiteFrame& site, const NodeGrid& nodes,
                                         FusedSurface& surface, const RunContext& run);

/// Brings a layer onto the surface below it and reports how.
/// @return HEIGHTMAP_NOT_ALIGNED where that is required and relief does not tell
[[nodiscard]] Result<void> align(Layer& layer, SourceReport& report, const Source& source,
                                 const DemReader& dem, const SiteFrame& site, const NodeGrid& nodes,
                                 const Grid<float>& below, double lower_pixel_m,
                                 const RunContext& run);

/// Moves a layer as it lay in the surface that is enlarged.
[[nodiscard]] Result<void> move_as_reported(Layer& layer, const DemReader& dem,
                                            const SiteFrame& site, const NodeGrid& nodes,
                                            const SourceReport& report, const Source& source,
                                            const RunContext& run);

/// Pixel of the source that most of what lies below a layer comes from, m.
[[nodiscard]] double pixel_below(const Grid<std::uint8_t>& source, const Grid<float>& layer,
                                 const std::vector<SourceReport>& reports);

}  // namespace maquette::heightmap::detail
