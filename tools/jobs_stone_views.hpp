// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file jobs_stone_views.hpp
/// Stones on the terrain as pictures: all of them from afar, and close up where most lie.

#include <filesystem>

#include "core/result.hpp"
#include "core/run_context.hpp"
#include "tools/pipeline.hpp"
#include "tools/site.hpp"

namespace maquette::tools {

/// stones_far.png and stones_close.png with the scenes that `render` makes them of
/// (stones_far.toml, stones_close.toml), under the site's lamp and with its reflectance; none
/// without stones. The close one looks at the densest place: that where most of the stones' area
/// lies within twice the largest one's diameter.
[[nodiscard]] Result<JobResult> stone_views_job(const Site& site,
                                                const std::filesystem::path& design,
                                                const std::filesystem::path& stones,
                                                const std::filesystem::path& folder,
                                                const RunContext& run);

}  // namespace maquette::tools
