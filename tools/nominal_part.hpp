// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file nominal_part.hpp
/// What scans are compared with: the part as a case file says it should be.

#include <memory>
#include <optional>
#include <vector>

#include "core/result.hpp"
#include "core/run_context.hpp"
#include "core/tri_mesh.hpp"
#include "heightmap/height_field.hpp"
#include "meshing/stones.hpp"
#include "scan/mesh_distance.hpp"
#include "tools/scene_file.hpp"

namespace maquette::tools {

/// What the part should be: as designed, and as it must come out when nothing goes wrong.
struct NominalPart {
  heightmap::ModelField design;                  ///< with stones
  std::optional<heightmap::ModelField> ground;   ///< without
  std::vector<meshing::PlacedStone> stone_plan;  ///< only beside a ground
  /// Design and ground with what the program leaves and the coat.
  std::optional<heightmap::ModelField> expected, expected_ground;
  std::optional<TriMesh> mesh;  ///< the design as triangles; `design` is then its upper envelope
  std::unique_ptr<scan::MeshDistance> to_mesh;
  [[nodiscard]] const heightmap::ModelField& to_meet() const {
    return expected ? *expected : design;
  }
};

/// The search tree points at the mesh beside it: a part stays where it was read.
/// @return TOOLS_CONFIG_INVALID where keys of the case do not go together, errors of reading
[[nodiscard]] Result<void> read_nominal(NominalPart& part, const Case& input,
                                        const RunContext& run);

}  // namespace maquette::tools
