// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

// Which pixels stones have a part in.

#include <cstdint>
#include <vector>

#include "core/grid.hpp"
#include "diagnosis/photo_chain.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::diagnosis::detail {

/// Pixels that show a stone or stand in the shadow of one, and those within so many rows and
/// columns of them: what a lens spreads, a lamp's penumbra, and a pose or a lamp a little
/// elsewhere. As declared: rays through the middles of pixels to the design, from there to the
/// lamp.
/// @param design,ground  with and without the stones, of the same nodes
/// @return by photograph, 1 where a pixel is to be left out; shape as the picture
[[nodiscard]] std::vector<Grid<std::uint8_t>> pixels_of_stones(const PhotoScene& scene,
                                                               const heightmap::ModelField& design,
                                                               const heightmap::ModelField& ground,
                                                               std::ptrdiff_t margin_px);

}  // namespace maquette::diagnosis::detail
