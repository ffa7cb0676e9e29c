// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <optional>

#include "meshing/hollow.hpp"
#include "tools/jobs.hpp"

namespace maquette::tools {

/// A solid that is not plain below.
struct ShapedJob {
  fs::path design;
  std::optional<fs::path> stones;
  Millimetres base_thickness{10.0};
  std::optional<meshing::HollowOptions> hollow{};
};
/// The solid (PLY) and its certificate beside it, with what was shaped under "hollow". A mesh that
/// fails its checks is not written.
[[nodiscard]] Result<JobResult> shaped_job(const ShapedJob& job, const fs::path& out,
                                           const RunContext& run);

}  // namespace maquette::tools
