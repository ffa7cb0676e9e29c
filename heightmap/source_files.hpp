// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file source_files.hpp
/// Which files a product consists of, so that a change in any of them is noticed.

#include <filesystem>
#include <vector>

#include "core/result.hpp"

namespace maquette::heightmap {

/// The file itself and what it refers to (image of a detached label, rasters behind a
/// VRT), sorted. Opens the product, so what `fuse` would refuse at once is refused here.
/// @return CORE_FILE_NOT_FOUND, HEIGHTMAP_RASTER_NOT_READABLE
[[nodiscard]] Result<std::vector<std::filesystem::path>> source_files(
    const std::filesystem::path& path);

}  // namespace maquette::heightmap
