// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include "tools/jobs.hpp"

namespace maquette::tools {

/// Terrain and stones as one surface, seen from above (meshing::with_stones): what a cutter on
/// three axes can make of both, with undercuts filled. A model field; what is rounded or moved
/// (below) then is what stones and terrain have in common, edges where they meet included. A facet
/// that spans a stone's outline lies beside it by a cell at most. MESHING_NOT_A_SOLID: a stone
/// sticks out of the design's outline.
[[nodiscard]] Result<JobResult> relief_job(const fs::path& design, const fs::path& stones,
                                           const fs::path& out, const RunContext& run);

/// The design moved along its normal, outwards where positive (cnc/ball_offset.hpp), a model field.
[[nodiscard]] Result<JobResult> offset_job(const fs::path& design, Millimetres distance,
                                           const fs::path& out, const RunContext& run);

/// The design with concave edges rounded to the radius (cnc/fillet.hpp), a model field.
[[nodiscard]] Result<JobResult> fillet_job(const fs::path& design, Millimetres radius,
                                           const fs::path& out, const RunContext& run);

}  // namespace maquette::tools
