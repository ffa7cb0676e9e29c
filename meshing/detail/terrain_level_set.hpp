// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file terrain_level_set.hpp
/// A narrow band of distances straight from heights. Includes OpenVDB: for .cpp files that are
/// compiled one at a time.

#include <openvdb/openvdb.h>

#include "core/vec.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::meshing::detail {

/// Half of the band's width: more than the fillet between stones and terrain reaches.
inline constexpr float kBandVoxels = 4.0F;

/// The lattice: node n stands at origin + voxel n, n from (0, 0, 0) to `nodes` less one.
struct LatticeBox {
  Vec3 origin_mm;
  openvdb::Coord nodes;
};

/// Height of the surface; it goes on level beyond the field's outline.
[[nodiscard]] double clamped_height(const heightmap::ModelField& field, double x_mm, double y_mm);

/// Signed distance to the terrain to first order, negative inside: the height difference over
/// sqrt(1 + slope^2), the slope by central differences over two voxels. Active are values within
/// the band; whole leaves below it are inner tiles. Leaf by leaf: heights of its columns once, only
/// leaves that the band can reach. Same values for any number of threads (there is one).
[[nodiscard]] openvdb::FloatGrid::Ptr terrain_level_set(const heightmap::ModelField& field,
                                                        const LatticeBox& box, double voxel_mm);

}  // namespace maquette::meshing::detail
