// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <optional>

#include "tools/jobs.hpp"

namespace maquette::tools {

/// Either of the two.
struct SimplifyJob {
  fs::path mesh;
  std::optional<std::uint64_t> triangles{};
  std::optional<Millimetres> max_deviation{};
};

/// A body with fewer triangles (meshing/simplify.hpp) as PLY, its certificate beside it.
[[nodiscard]] Result<JobResult> simplify_job(const SimplifyJob& job, const fs::path& out,
                                             const RunContext& run);

}  // namespace maquette::tools
