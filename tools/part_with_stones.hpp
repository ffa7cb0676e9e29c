// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file part_with_stones.hpp
/// A band or a tile with the stones that stand on it as one solid, for whoever mills, casts or
/// sinters them with the ground instead of gluing them on.

#include <filesystem>
#include <span>
#include <vector>

#include "core/result.hpp"
#include "core/run_context.hpp"
#include "core/tri_mesh.hpp"
#include "heightmap/height_field.hpp"
#include "meshing/bands.hpp"
#include "meshing/grid_stream.hpp"
#include "meshing/mesh_checks.hpp"
#include "meshing/solid.hpp"
#include "meshing/stones.hpp"
#include "tools/pipeline.hpp"

namespace maquette::tools {

struct PartWithStones {
  TriMesh mesh;  ///< frame of the whole; walls to neighbours are theirs to the bit
  meshing::MeshCertificate certificate;
  std::vector<int> stones;  ///< numbers of those that are in it
};

/// The stones whose middle lies over the window are united with it (volume_solid), checked by CGAL
/// and measured against terrain and stones. Errors of volume_solid, among these
/// MESHING_NOT_A_SOLID where a stone sticks out of a wall: joints have to keep off it
/// (band_joints.hpp, tiles.hpp); TOOLS_MESH_CHECK_FAILED, TOOLS_SOLID_INEXACT.
[[nodiscard]] Result<PartWithStones> part_with_stones(const heightmap::ModelField& design,
                                                      const meshing::NodeWindow& window,
                                                      std::span<const meshing::PlacedStone> stones,
                                                      const meshing::SolidOptions& options,
                                                      const RunContext& run);

/// One band of a split (PLY), with its certificate beside it, in which "stones" lists their
/// numbers.
[[nodiscard]] Result<JobResult> band_with_stones_job(const std::filesystem::path& design,
                                                     const std::filesystem::path& stones,
                                                     const meshing::BandSplit& split,
                                                     std::size_t band, Millimetres base_thickness,
                                                     const std::filesystem::path& out,
                                                     const RunContext& run);

}  // namespace maquette::tools
