// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file semi_finish.hpp
/// Takes the steps of the roughing levels off, so that the finishing ball finds even stock.
///
/// Method. The finishing passes (mill.hpp) of a ball larger by the allowance, raised by it. Its
/// centre runs at the distance radius + allowance from the design, so the ball itself leaves the
/// allowance everywhere, in space, exactly as the finish is exact; nothing is offset or
/// approximated (cutter_shape.hpp).

#include "cnc/mill.hpp"

namespace maquette::cnc {

/// Options, pieces and figures as of mill_passes(), all for the ball that cuts: heights, scallops
/// and their limit are its own; the bounds are against the surface that is left, which
/// stands the allowance outside the design. Predicted scallops are those of the larger ball times
/// (radius + allowance) / radius, right to first order. `options.stock` are heights before this
/// pass.
/// @return as mill_passes; CNC_MILL_OPTION_OUT_OF_RANGE also for an allowance beyond 0 .. 50 mm
[[nodiscard]] Result<MillReport> semi_finish(const heightmap::ModelField& design,
                                             const MillOptions& options, Millimetres allowance,
                                             const ToolpathSink& sink, const RunContext& run = {});

}  // namespace maquette::cnc
