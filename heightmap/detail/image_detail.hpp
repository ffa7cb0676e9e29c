// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file image_detail.hpp
/// An image on the nodes of a fused surface, and the detail that its shading adds
/// (photoclinometry.hpp).

#include "heightmap/detail/node_map.hpp"
#include "heightmap/detail/roughness.hpp"
#include "heightmap/fuse.hpp"

namespace maquette::heightmap::detail {

/// Adds detail to surface.field and lowers surface.sigma_m where the image shows ground.
/// @param dem_pixel_m  of the finest elevation product in the surface
/// @return what happened, or the errors of fuse() about files and places; HEIGHTMAP_IMAGE_NOT_FINER
[[nodiscard]] Result<ImageReport> add_image_detail(FusedSurface& surface, const ImageSource& image,
                                                   const Body& body, double latitude_deg,
                                                   double longitude_deg, const NodeGrid& nodes,
                                                   double dem_pixel_m, const Roughness& relief,
                                                   const RunContext& run);

}  // namespace maquette::heightmap::detail
