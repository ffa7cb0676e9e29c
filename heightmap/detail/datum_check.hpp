// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file datum_check.hpp
/// Do two products of the same ground count heights from the same surface?

#include <optional>
#include <string>

#include "core/grid.hpp"
#include "heightmap/body.hpp"

namespace maquette::heightmap::detail {

/// Heights of both on the same nodes, voids NaN. Their differences are judged by their median and
/// spread (NMAD): a datum moves all of them alike.
/// @return nothing, or a sentence: how far apart they are, and what on this body is as far
[[nodiscard]] std::optional<std::string> datum_doubt(const Grid<float>& below,
                                                     const Grid<float>& layer, double sigma_m,
                                                     const Body& body);

}  // namespace maquette::heightmap::detail
