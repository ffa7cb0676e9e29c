// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file mask.hpp
/// Grids of 0 and 1.

#include <cstddef>
#include <cstdint>

#include "core/grid.hpp"

namespace maquette {

/// Everything within `reach` rows and columns of a 1 becomes 1: a square about each.
/// Cost  three times through memory, row by row, whatever the reach.
/// @pre cells are 0 or 1; reach >= 0
void widen(Grid<std::uint8_t>& mask, std::ptrdiff_t reach);

}  // namespace maquette
