// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file place_reference.hpp
/// The plane of a place on a body as rasters name it.

#include <ogr_spatialref.h>

#include "export/lod_set.hpp"

namespace maquette::exporting::detail {

/// Orthographic about the place, metres: its plane is the tileset's x and y (lod_tileset.hpp), 0 in
/// the middle of the site.
void set_place(OGRSpatialReference& frame, const LodPlace& place);

}  // namespace maquette::exporting::detail
