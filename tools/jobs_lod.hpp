// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include "export/lod_set.hpp"
#include "tools/jobs.hpp"

namespace maquette::tools {

struct LodJob {
  fs::path design;                 ///< model field
  std::optional<fs::path> stones;  ///< stones.json
  exporting::LodSetOptions options;
};
/// Tiles in levels of detail with their tilesets and lod.json (export/lod_set.hpp); with stones
/// stones.glb and, for the page, stones.json.
[[nodiscard]] Result<JobResult> lod_job(const LodJob& job, const fs::path& folder,
                                        const RunContext& run);

}  // namespace maquette::tools
