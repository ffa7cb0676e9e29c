// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file model_frame.hpp
/// How raster files name the model frame: a local engineering CRS in millimetres (OGC WKT 1).

namespace maquette::heightmap {

inline constexpr const char* kModelFrameWkt =
    "LOCAL_CS[\"maquette model frame\",UNIT[\"millimetre\",0.001],AXIS[\"x\",EAST],"
    "AXIS[\"y\",NORTH]]";

}  // namespace maquette::heightmap
