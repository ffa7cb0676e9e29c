// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file view_export.hpp
/// The page of `maquette view` with its data inside: one file that opens from a disk or a mail,
/// asks nothing of any network and needs no server.
///
/// What it carries, until it weighs what it may:
///   stones' plans, scene cameras; pictures and programs, as long as they fit in their shares
///   tiles     all levels from the coarsest to the finest that fits
///   rasters   all thinned to at most N nodes a side, the most of kExportSides that fits: heights
///             as the surface is there, deviations as means (view_fields.hpp)
/// What does not fit or cannot be read is left out whole and named: the page says so, and the
/// result.
///
/// Heights of rasters are rounded to kHeightStep_mm (or 1/65534 of their range, if that is more).
/// How far the carried surface is from the file's is measured at all its nodes and said beside it.
///
/// In the file, behind the page's own text:
///   <script id="carried-index" type="application/json">   {"made_by", "left_out", "damaged",
///   "entries": {NAME:
///       {"at", "size", "coding", "grid"}}}; NAME is "maquette.json", "files/PATH", "grid/PATH" or
///       "page/" and a decoder's name; coding "plain", "deflate" (zlib) or "grid"
///       (packed_grid.hpp)
///   <script id="carried" type="text/plain">               all entries' bytes as one base64

#include <array>
#include <filesystem>
#include <span>

#include "core/result.hpp"
#include "core/run_context.hpp"
#include "tools/pipeline.hpp"
#include "tools/view/view_page.hpp"

namespace maquette::tools {

inline constexpr ErrorCode kViewExportSmall{"TOOLS_VIEW_EXPORT_SMALL"};

inline constexpr std::array<std::ptrdiff_t, 11> kExportSides{51,  101, 151, 201, 251, 334,
                                                             401, 501, 668, 801, 1001};
inline constexpr double kHeightStep_mm = 0.002;

/// Writes `out`, whole or not at all.
/// @param page     view_page()
/// @param most_mb  that `out` may weigh, 10^6 bytes
/// @return view_contents_json's errors; TOOLS_VIEW_EXPORT_SMALL with the MB that would do;
///         errors of the files
[[nodiscard]] Result<JobResult> view_export_job(const std::filesystem::path& folder,
                                                const std::filesystem::path& out,
                                                std::span<const PageFile> page, double most_mb,
                                                const RunContext& run = {});

}  // namespace maquette::tools
