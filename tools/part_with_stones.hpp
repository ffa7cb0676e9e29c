// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file part_with_stones.hpp
/// A design, a band or a tile of it with the stones that stand on it as one solid, for whoever
/// mills, casts or sinters them with the ground instead of gluing them on.

#include <filesystem>
#include <span>
#include <vector>

#include "core/result.hpp"
#include "core/run_context.hpp"
#include "core/tri_mesh.hpp"
#include "heightmap/height_field.hpp"
#include "meshing/grid_stream.hpp"
#include "meshing/mesh_checks.hpp"
#include "meshing/shaped_solid.hpp"
#include "meshing/solid.hpp"
#include "meshing/stones.hpp"

namespace maquette::tools {

/// The stones whose middle lies over the window. Each is in one part: of a joint's two sides the
/// eastern and northern one has what stands exactly on it, and parts at the design's outline have
/// what lies beyond.
[[nodiscard]] std::vector<meshing::PlacedStone> stones_over(
    const heightmap::ModelField& design, const meshing::NodeWindow& window,
    std::span<const meshing::PlacedStone> stones);

[[nodiscard]] std::vector<int> numbers_of(std::span<const meshing::PlacedStone> stones);

struct PartWithStones {
  TriMesh mesh;  ///< frame of the whole; plain walls to neighbours are theirs to the bit
  meshing::MeshCertificate certificate;
};

/// Terrain over the window and stones united (volume_solid), then shaped: hollow, engraved, bored.
/// CGAL looks at what comes out, and its top is measured against terrain and stones; where it does
/// not pass, its certificate is written beside `out` as NAME.refused.json. Errors of volume_solid,
/// among these MESHING_NOT_A_SOLID where a stone sticks out of a wall: joints have to keep off it
/// (band_joints.hpp, tiles.hpp); TOOLS_MESH_CHECK_FAILED, TOOLS_SOLID_INEXACT.
/// @param shaping  of the window (shape_part)
/// @param out  the file that the part is for; not written here
[[nodiscard]] Result<PartWithStones> part_with_stones(
    const heightmap::ModelField& design, const meshing::NodeWindow& window,
    std::span<const meshing::PlacedStone> stones, const meshing::SolidOptions& options,
    const meshing::Shaping& shaping, const std::filesystem::path& out, const RunContext& run);

}  // namespace maquette::tools
