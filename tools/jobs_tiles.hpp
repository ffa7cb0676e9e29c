// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <optional>

#include "meshing/tiles.hpp"
#include "tools/jobs.hpp"
#include "tools/jobs_shaped.hpp"
#include "tools/joint_holes.hpp"

namespace maquette::tools {

struct TilesJob {
  fs::path design;
  std::optional<fs::path> stones;  ///< joints keep off them
  meshing::TileOptions options;
  Millimetres base_thickness{10.0};
  bool own_frame = false;  ///< each with its south-western corner and base at the origin
  InJoints in_joints{};
  Shape shape{};             ///< of each tile; its number is added to the label
  bool with_stones = false;  ///< united with the tiles that they stand on
};
/// tile_01.ply with certificate ..., tiles.json (place, origin, volume, dowels, magnets), tiles.svg
/// (plan from above with stones, 1:1), exploded.svg and exploded.png (tiles moved apart). What an
/// earlier run has left of tiles beyond these is set aside (set_aside.hpp).
[[nodiscard]] Result<JobResult> tiles_job(const TilesJob& job, const fs::path& folder,
                                          const RunContext& run);

}  // namespace maquette::tools
