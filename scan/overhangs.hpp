// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file overhangs.hpp
/// Points that heights cannot judge.
///
/// A scanner sees under the overhang of a stone, where the upper envelope of terrain and stones
/// runs far above what it sees; and beside a steep side, which between two nodes of the envelope is
/// a ramp. Compared with the envelope such a point lies deep below the part, though it is where it
/// should be. It is found by the distance to the part itself, terrain and stones as meshes.
///
/// A point is one of these if it lies on the part (within three standard deviations of its
/// noise) but the envelope says something else (by more than a quarter of it). So what is
/// really missing or too much stays, whatever its shape. Nine balls that overhang, ten points a
/// mm^2: of 116 findings in four scans one is left, where the envelope's nodes cut a ball short by
/// less than that quarter.

#include <cstdint>
#include <span>
#include <vector>

#include "core/tri_mesh.hpp"
#include "core/vec.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::scan {

/// @param points_mm  in the surface's frame
/// @param envelope   what points are compared with
/// @param ground     the same without stones
/// @param stones     closed, where they should be
/// @param coat_mm    on the stones, contained in envelope and ground
/// @param noise_mm   of single points
/// @return 1 for each point that heights cannot judge
[[nodiscard]] std::vector<std::uint8_t> beyond_heights(std::span<const Vec3> points_mm,
                                                       const heightmap::ModelField& envelope,
                                                       const heightmap::ModelField& ground,
                                                       std::span<const TriMesh> stones,
                                                       double coat_mm, double noise_mm);

}  // namespace maquette::scan
