// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include "heightmap/height_field.hpp"

namespace maquette::meshing {

/// Columns a CPU second: straight from the grid, and by OpenVDB's meshToLevelSet of the grid's
/// solid; how far the two differ where both are known.
void level_set_case(const heightmap::ModelField& field, double voxel_mm, bool with_peer);

/// Stones laid on the field and united with it: time, memory, errors against the exact surfaces.
void volume_case(const heightmap::ModelField& field, int stones);

/// A plan fitted and settled: time, memory, how far apart.
void settle_case(const heightmap::ModelField& field, int stones);

}  // namespace maquette::meshing
