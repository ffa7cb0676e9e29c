// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include "export/heightmap_pyramid.hpp"
#include "tools/jobs.hpp"

namespace maquette::tools {

struct LodJob {
  fs::path design;                 ///< model field
  std::optional<fs::path> stones;  ///< stones.json
  exporting::LodSetOptions options;
  std::optional<std::ptrdiff_t> heightmap_quads;  ///< heightmaps/ with tiles as wide, too
};
/// Tiles in levels of detail with their tilesets and lod.json (export/lod_set.hpp); with stones
/// stones/ and, for the page, stones.json; heightmaps/ (export/heightmap_pyramid.hpp) if wanted.
[[nodiscard]] Result<JobResult> lod_job(const LodJob& job, const fs::path& folder,
                                        const RunContext& run);

}  // namespace maquette::tools
