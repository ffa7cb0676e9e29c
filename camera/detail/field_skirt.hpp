// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file field_skirt.hpp
/// Walls and underside of a block whose upper face is a height field.

#include "core/tri_mesh.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::camera::detail {

/// From the border nodes down to `base_mm`; where a border node is void there is no wall.
/// Facing outward; without the upper face.
[[nodiscard]] TriMesh field_skirt(const heightmap::ModelField& field, double base_mm);

}  // namespace maquette::camera::detail
