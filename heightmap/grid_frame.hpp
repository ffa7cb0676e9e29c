// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file grid_frame.hpp
/// Where the nodes of a raster in the model frame are, without reading its values.

#include <filesystem>
#include <string>

#include "core/result.hpp"
#include "core/units.hpp"

namespace maquette::heightmap {

struct GridFrame {
  std::ptrdiff_t rows = 0, cols = 0;
  Millimetres spacing{1.0}, x0{0.0}, y0{0.0};  ///< x0, y0: the south-western node
  std::string unit;                            ///< of the values as the file says, may be empty
};

/// @return the frame, or of read_model_field's errors (heightmap/field_io.hpp)
///   CORE_FILE_NOT_FOUND, HEIGHTMAP_RASTER_NOT_READABLE, HEIGHTMAP_RASTER_SHAPE
[[nodiscard]] Result<GridFrame> read_grid_frame(const std::filesystem::path& path);

}  // namespace maquette::heightmap
