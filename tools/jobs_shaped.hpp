// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <optional>

#include "meshing/engraving.hpp"
#include "meshing/hollow.hpp"
#include "tools/jobs.hpp"

namespace maquette::tools {

/// Which of the bands that a design is split into (meshing/bands.hpp, along y), from 0.
struct BandOf {
  Millimetres max_width{INFINITY};
  std::size_t index = 0;
};

/// A solid that is not plain below or at its sides.
struct ShapedJob {
  fs::path design;
  std::optional<fs::path> stones{};
  Millimetres base_thickness{10.0};  ///< under the lowest point of the whole design
  std::optional<BandOf> band{};      ///< that band alone; without stones
  std::optional<meshing::HollowOptions> hollow{};
  std::string label{};             ///< engraved in a wall; empty: nothing
  double scale_denominator = 0.0;  ///< of a scale bar in the same wall; 0: none
  meshing::EngravingStyle engraving{};
  [[nodiscard]] bool plain() const { return !hollow && !engraves(); }
  [[nodiscard]] bool engraves() const { return !label.empty() || scale_denominator != 0.0; }
};
/// The solid (PLY) and its certificate beside it, with what was shaped under "hollow" and
/// "engraved". A mesh that fails its checks is not written. @pre not plain
[[nodiscard]] Result<JobResult> shaped_job(const ShapedJob& job, const fs::path& out,
                                           const RunContext& run);

}  // namespace maquette::tools
