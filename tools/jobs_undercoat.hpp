// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include "tools/jobs.hpp"

namespace maquette::tools {

/// The design less a coat of this thickness along its normal (cnc/undercoat.hpp), a model field.
[[nodiscard]] Result<JobResult> undercoat_job(const fs::path& design, Millimetres thickness,
                                              const fs::path& out, const RunContext& run);

}  // namespace maquette::tools
