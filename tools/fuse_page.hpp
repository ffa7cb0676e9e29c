// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file fuse_page.hpp
/// What fuse.json and its pictures say, for the page of a run and for that of `maquette fuse`.

#include <filesystem>
#include <string>

#include <nlohmann/json_fwd.hpp>

#include "core/result.hpp"
#include "tools/site.hpp"

namespace maquette::tools {

/// Size and relief of a scale's surface.
[[nodiscard]] std::string surface_html(const nlohmann::json& fuse);

/// Table of the sources, what alignment left between them, uncertainty, most exact source and
/// artefacts as pictures, each with its scale of colours.
/// @param fuse    fuse.json of a scale
/// @param folder  where the pictures of that scale are
[[nodiscard]] std::string sources_html(const nlohmann::json& fuse,
                                       const std::filesystem::path& folder);

/// fuse.html of a site: the above with hillshades, for each of its scales.
/// @param out  folder that has one folder a scale
[[nodiscard]] Result<void> write_fuse_page(const Site& site, const std::filesystem::path& out);

}  // namespace maquette::tools
