// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file report.hpp
/// Pages that carry everything inside: pictures as data, no network.

#include <filesystem>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "core/result.hpp"
#include "tools/pipeline.hpp"
#include "tools/site.hpp"

namespace maquette::tools {

/// A whole page round a body.
[[nodiscard]] std::string page(const std::string& title, const std::string& body);

/// A picture with its caption, as data; where the file is missing, words that say so.
/// @param legend  markup between the two
[[nodiscard]] std::string picture_html(const std::filesystem::path& png, const std::string& caption,
                                       int width, const std::string& legend = "");
/// A figure as a person reads it: six digits, escaped.
[[nodiscard]] std::string number_html(const nlohmann::json& value);
/// Rows of those figures that are present and not null, in this order.
[[nodiscard]] std::string figure_table_html(
    const nlohmann::json& figures, const std::vector<std::pair<const char*, const char*>>& rows);

/// report.html of a run: for each scale hillshade, mesh and toolpath figures, the paths in three
/// dimensions, machining time, picture, deviation map and histogram. `folder` is the run's, with
/// one folder a scale.
/// @param view  file beside it that holds the page of `maquette view`; empty: there is none
[[nodiscard]] Result<void> write_run_page(const Site& site, std::span<const UnitRecord> records,
                                          const std::filesystem::path& folder,
                                          const std::filesystem::path& out,
                                          const std::string& view);

/// manifest.json: versions, parameters, inputs and outputs with SHA-256, seconds,
/// memory and figures of every unit.
[[nodiscard]] Result<void> write_manifest(const SiteFile& site, std::span<const UnitRecord> records,
                                          const std::filesystem::path& site_path,
                                          const std::filesystem::path& out);

/// Name of a scale's folder: "s1000".
[[nodiscard]] std::string scale_folder(double scale);

}  // namespace maquette::tools
