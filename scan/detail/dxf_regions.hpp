// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file dxf_regions.hpp
/// read_regions() for drawings.

#include <filesystem>
#include <vector>

#include "scan/regions.hpp"

namespace maquette::scan::detail {

[[nodiscard]] Result<std::vector<Region>> read_dxf_regions(const std::filesystem::path& path);

}  // namespace maquette::scan::detail
