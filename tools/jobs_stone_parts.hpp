// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file jobs_stone_parts.hpp
/// maquette stone-parts: everything that the workshop needs to make the stones and put them where
/// they go.

#include <filesystem>
#include <optional>
#include <string>

#include "core/run_context.hpp"
#include "core/units.hpp"
#include "export/pack_builds.hpp"
#include "meshing/bands.hpp"
#include "meshing/stones.hpp"
#include "tools/pipeline.hpp"

namespace maquette::tools {

struct StonePartsJob {
  std::filesystem::path stones;               ///< stones.json
  std::filesystem::path design;               ///< model field that they lie on
  Millimetres clearance{0.1};                 ///< parts are smaller by that on every side
  Millimetres wall{1.0};                      ///< least one of the sintering process
  exporting::BuildVolume volume{};            ///< of the machine
  std::string paper = "a4";                   ///< or a3
  std::optional<meshing::BandSplit> bands{};  ///< whose joints are on the template
  bool thin_is_unmet = true;                  ///< parts that lack the wall; else they are warned of
  std::string name = "placing plan";          ///< on every sheet of the template
};

/// How a stone lies, in numbers for people.
struct StoneLie {
  double heading_deg = 0.0;         ///< of the long axis seen from above, from x towards y
  double tilt_deg = 0.0;            ///< of the stone's upright axis off the vertical
  double tilt_direction_deg = 0.0;  ///< where it leans, from x towards y
};
/// The three give the rotation back as long as the long axis is not upright. A tilt of 0 has
/// direction 0.
[[nodiscard]] StoneLie lie_of(const Quaternion& model_from_stone);

/// parts/S001.3mf, .stl, .certificate.json of each distinct stone; build_01.3mf ... and builds.csv;
/// placing.csv, placing.pdf, placing.dxf; stone_parts.json, the list of all with figures and
/// SHA-256. Unmet, or warned of, where a part stands out of what the least wall can make by more
/// than half of it. MESHING_STONE_VANISHES, EXPORT_PART_TOO_LARGE name the part; CORE_CANCELLED,
/// and what the readers and writers say.
[[nodiscard]] Result<JobResult> stone_parts_job(const StonePartsJob& job,
                                                const std::filesystem::path& folder,
                                                const RunContext& run);

}  // namespace maquette::tools
