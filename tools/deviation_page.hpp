// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file deviation_page.hpp
/// The page that workshop and customer read: what was made, where it differs, by how much, how
/// sure. One file, no network; the part can be turned with the deviation on it (WebGL).

#include <filesystem>
#include <string>

#include "core/result.hpp"
#include "heightmap/height_field.hpp"
#include "scan/deviate.hpp"

namespace maquette::tools {

/// @param summary_json  what deviate_job writes to summary.json
/// @param limit_mm      deviation of full colour
/// @param map_png, significant_png  deviation, and the same where it is significant
[[nodiscard]] Result<void> write_deviation_page(const scan::Deviation& deviation,
                                                const heightmap::ModelField& design,
                                                const std::string& summary_json, double limit_mm,
                                                const std::filesystem::path& map_png,
                                                const std::filesystem::path& significant_png,
                                                const std::filesystem::path& out);

}  // namespace maquette::tools
