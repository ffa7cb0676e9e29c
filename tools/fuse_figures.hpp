// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file fuse_figures.hpp
/// What fuse.json says, and read back what an enlargement needs of it.

#include <nlohmann/json_fwd.hpp>

#include "heightmap/composite.hpp"

namespace maquette::tools {

[[nodiscard]] nlohmann::json figures_of(const heightmap::SourceReport& source);
[[nodiscard]] nlohmann::json figures_of(const heightmap::ImageReport& image);
[[nodiscard]] nlohmann::json figures_of(const heightmap::CompositeMatch& match);

/// @throws nlohmann::json::exception where a figure is missing or of another kind
[[nodiscard]] heightmap::SourceReport source_report(const nlohmann::json& figures);
[[nodiscard]] heightmap::CompositeMatch composite_match(const nlohmann::json& figures);

}  // namespace maquette::tools
