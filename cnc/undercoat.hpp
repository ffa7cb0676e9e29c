// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file undercoat.hpp
/// The surface to be milled, so that with a coat of even thickness on it the part is the design.
///
/// Takes   ModelField without voids; thickness in mm
/// Gives   ModelField of the same nodes, offset inwards along the normal: the highest surface whose
///         every point is at least the thickness away from the design's (the erosion of the solid
///         by a ball); and where no undercoat can make up for the coat
///
/// Method. The highest centre of a ball that lies under the surface is, turned upside down, the
/// lowest of a ball cutter above it: DropCutter, exact over facets, edges and vertices. The coat
/// put back on is the ball rolled over the result. What the design then lacks are ridges and peaks
/// sharper than the ball: they come out rounded.
///
/// Accuracy at the nodes: float. Between nodes facets join them: on slopes exact, on a sphere of
/// radius R the facets' own s^2 / (8 R). At the outline the slopes of the last cells are
/// continued; walls are not offset.
/// Cost as DropCutter, twice.

#include "core/result.hpp"
#include "core/run_context.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::cnc {

inline constexpr ErrorCode kCoatThickness{"CNC_COAT_THICKNESS"};

struct Undercoat {
  heightmap::ModelField surface;
  /// The design less the undercoat with its coat, at the nodes: ridges that come out lower. The
  /// other way round it is nothing but facets.
  double max_missing_mm = 0.0, rms_missing_mm = 0.0;
  double max_excess_mm = 0.0;
};

/// CNC_COAT_THICKNESS: not positive, or above 24 cells of the design; CNC_HEIGHT_NOT_FINITE: a
/// void; CORE_CANCELLED. @pre at least 2 x 2 nodes
[[nodiscard]] Result<Undercoat> undercoat(const heightmap::ModelField& design,
                                          Millimetres thickness, const RunContext& run = {});

}  // namespace maquette::cnc
