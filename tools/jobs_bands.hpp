// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file jobs_bands.hpp
/// Where the joints of strips lie, before any of them is made: bands.json, which whatever makes or
/// mills them reads, and what they look like.

#include <filesystem>
#include <optional>
#include <vector>

#include "core/result.hpp"
#include "core/run_context.hpp"
#include "core/units.hpp"
#include "meshing/band_joints.hpp"
#include "meshing/bands.hpp"
#include "tools/joint_holes.hpp"
#include "tools/pipeline.hpp"

namespace maquette::tools {

struct ExplodedView;

struct BandLayoutJob {
  std::filesystem::path design;
  std::optional<std::filesystem::path> stones{};  ///< joints keep off them; on the picture
  bool avoid_stones = true;                       ///< false: even bands, stones are but drawn
  meshing::BandSplit split{};
  Millimetres clearance{1.0};  ///< from joints to stones
  Millimetres base_thickness{10.0};
  InJoints in_joints{};
  bool with_stones = false;    ///< bands will be of one piece with them: a note under the picture
  std::size_t most_bands = 0;  ///< as there are work offsets; 0: any number
};

/// bands.json (bands, joints, stones that these meet), exploded.svg and exploded.png; what an
/// earlier run has left of bands beyond these is set aside (set_aside.hpp). A joint that meets a
/// stone is warned of by name, and by stone. MESHING_BANDS_DEGENERATE as split_beside_stones, and
/// if there are more bands than `most_bands`.
[[nodiscard]] Result<JobResult> band_layout_job(const BandLayoutJob& job,
                                                const std::filesystem::path& folder,
                                                const RunContext& run);

/// The joints of a bands.json, for the design that it was written of.
/// CORE_FILE_NOT_FOUND; TOOLS_CONFIG_SYNTAX with line and column, TOOLS_CONFIG_INVALID with the
/// path of the key.
[[nodiscard]] Result<meshing::BandSplit> read_band_layout(const std::filesystem::path& path);

/// The two pictures of parts that have been moved apart, appended to `outputs`.
[[nodiscard]] Result<void> write_exploded(const heightmap::ModelField& design,
                                          const ExplodedView& view,
                                          const std::filesystem::path& folder,
                                          std::vector<std::filesystem::path>& outputs);

}  // namespace maquette::tools
