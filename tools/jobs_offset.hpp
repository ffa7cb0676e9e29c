// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include "tools/jobs.hpp"

namespace maquette::tools {

/// The design moved along its normal, outwards where positive (cnc/ball_offset.hpp), a model field.
[[nodiscard]] Result<JobResult> offset_job(const fs::path& design, Millimetres distance,
                                           const fs::path& out, const RunContext& run);

/// The design with concave edges rounded to the radius (cnc/fillet.hpp), a model field.
[[nodiscard]] Result<JobResult> fillet_job(const fs::path& design, Millimetres radius,
                                           const fs::path& out, const RunContext& run);

}  // namespace maquette::tools
