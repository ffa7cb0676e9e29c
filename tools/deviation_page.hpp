// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file deviation_page.hpp
/// What workshop and customer read and sign: what was made, where it differs, by how much, how
/// sure. As a page (one file, no network; the part can be turned with the deviation on it, WebGL)
/// and as a PDF.

#include <array>
#include <filesystem>
#include <string>
#include <utility>

#include "core/result.hpp"
#include "heightmap/height_field.hpp"
#include "scan/deviate.hpp"

namespace maquette::tools {

/// The figures that a person asks for first: key in summary.json, words for it.
inline constexpr std::array<std::pair<const char*, const char*>, 14> kDeviationFigures{
    {{"points", "points on the part"},
     {"off_part", "points off the part"},
     {"at_rim", "points left out at the rim"},
     {"under_overhangs", "points left out under overhangs of stones"},
     {"coverage", "share of nodes measured"},
     {"mean_mm", "mean, mm"},
     {"rms_mm", "RMS, mm"},
     {"sigma_mm", "standard deviation, mm"},
     {"median_mm", "median, mm"},
     {"nmad_mm", "NMAD, mm"},
     {"p05_mm", "5th percentile, mm"},
     {"p95_mm", "95th percentile, mm"},
     {"min_mm", "lowest, mm"},
     {"max_mm", "highest, mm"}}};

/// report.html and report.pdf: the same blocks, but for the view that only a browser can turn.
/// @param summary_json  what deviate_job writes to summary.json
/// @param limit_mm      deviation of full colour
/// @param map_png, significant_png  deviation, and the same where it is significant
[[nodiscard]] Result<void> write_deviation_report(const scan::Deviation& deviation,
                                                  const heightmap::ModelField& design,
                                                  const std::string& summary_json, double limit_mm,
                                                  const std::filesystem::path& map_png,
                                                  const std::filesystem::path& significant_png,
                                                  const std::filesystem::path& html,
                                                  const std::filesystem::path& pdf);

}  // namespace maquette::tools
