// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file void_fill.hpp
/// Distances to voids and smooth filling of small ones.

#include "core/grid.hpp"

namespace maquette::heightmap::detail {

/// Distance in nodes from each node that `is_target` does not name (in cells, row-major)
/// to the nearest one it names; 0 on those, infinity if there is none. Two-pass chamfer
/// with steps 1 and sqrt(2): at most 8 % too long (Borgefors 1986,
/// doi:10.1016/S0734-189X(86)80047-0).
[[nodiscard]] Grid<float> distance_to(const Grid<float>& z, bool to_voids);

/// Fills voids from ever coarser means of what surrounds them (pull, then push with
/// bilinear interpolation; Gortler et al. 1996, doi:10.1145/237170.237200). Other nodes
/// keep their value.
/// @return number of nodes filled
/// @pre at least one node is not void
std::ptrdiff_t fill_voids(Grid<float>& z);

}  // namespace maquette::heightmap::detail
