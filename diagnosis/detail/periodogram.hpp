// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>

#include "core/grid.hpp"

namespace maquette::diagnosis::detail {

/// Squared amplitudes of the waves in a map (row: waves down, column: waves along, both modulo
/// their number), the map continued by zeros to rows x cols. @param map  NaN: nothing known, as 0
[[nodiscard]] Grid<double> periodogram(const Grid<double>& map, std::ptrdiff_t rows,
                                       std::ptrdiff_t cols);

}  // namespace maquette::diagnosis::detail
