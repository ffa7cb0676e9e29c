// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

// Which pixels stones and other bodies have a part in.

#include <cstdint>
#include <vector>

#include "core/grid.hpp"
#include "core/result.hpp"
#include "core/run_context.hpp"
#include "diagnosis/case_input.hpp"
#include "diagnosis/photo_chain.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::diagnosis::detail {

struct BodyPixels {
  /// By photograph, 1 where a pixel is to be left out; shape as the picture.
  std::vector<Grid<std::uint8_t>> left_out;
  std::vector<std::size_t> pixels;  ///< by body: that show it, in all photographs
};

/// Pixels that show a stone or a body or stand in the shadow of one, and those within so many rows
/// and columns of them: what a lens spreads, and a pose or a lamp a little elsewhere. As declared:
/// rays through the middles of pixels to the design and the bodies, from there to the lamp; where
/// bodies stand also to its rim, for a tall one's penumbra is wider than the margin.
/// @param ground  the design without its stones, of the same nodes; null: it has none
/// @return errors of the meshes' reader, CORE_CANCELLED
[[nodiscard]] Result<BodyPixels> pixels_of_bodies(const PhotoScene& scene,
                                                  const heightmap::ModelField& design,
                                                  const heightmap::ModelField* ground,
                                                  const std::vector<Body>& bodies,
                                                  std::ptrdiff_t margin_px, const RunContext& run);

}  // namespace maquette::diagnosis::detail
