// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file path_under.hpp
/// Which pass has made the surface at a place: how far along the program it was, which way it went
/// and how fast.

#include <filesystem>
#include <span>
#include <vector>

#include "core/result.hpp"
#include "core/run_context.hpp"
#include "core/vec.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::tools {

struct PathUnder {
  std::vector<float> order_m;        ///< metres of cutting path before; NaN: no pass
  std::vector<float> direction_deg;  ///< of the feed, 0 along x, counter-clockwise, -180 .. 180
  std::vector<float> feed_mm_min;
};

/// For each point the pass of the ball nearest above it, in cells of a spacing: the last of those
/// whose tip is within `reach_mm` of the design's height (links and approaches are higher).
/// Memory: 12 bytes a node of the design. Speed: 4 M blocks a second.
/// @return cnc::read_gcode's errors
[[nodiscard]] Result<PathUnder> path_under(std::span<const std::filesystem::path> programs,
                                           const heightmap::ModelField& design, double reach_mm,
                                           std::span<const Vec3> points_mm, const RunContext& run);

}  // namespace maquette::tools
