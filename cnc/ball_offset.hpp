// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file ball_offset.hpp
/// A surface moved along its normal, either way.
///
/// Takes   ModelField without voids; by how much, mm
/// Gives   ModelField of the same nodes: outwards the upper envelope of balls with their middle
///         on the surface, inwards the highest surface whose every point is at least that far
///         below the surface (the solid's dilation and erosion by a ball)
///
/// Method. The lowest centre of a ball that lies above the surface is what a ball cutter finds;
/// inwards the same upside down. DropCutter: exact over facets, edges and vertices.
///
/// Accuracy at the nodes: float. Between nodes facets join them: on slopes exact, on a sphere of
/// radius R the facets' own s^2 / (8 R). At the outline the slopes of the last cells are
/// continued; walls are not offset.
/// Outwards and back is not where one came from: hollows sharper than the ball stay filled
/// (fillet.hpp); inwards and back ridges sharper than it stay rounded off.
/// Cost as DropCutter; balls above 24 cells take a slower way.

#include "core/result.hpp"
#include "core/run_context.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::cnc {

inline constexpr ErrorCode kOffsetDistance{"CNC_OFFSET_DISTANCE"};

/// @param distance  outwards; negative: inwards; 0: the surface itself
/// CNC_OFFSET_DISTANCE: no number, or above 100 cells either way; CNC_HEIGHT_NOT_FINITE: a void;
/// CORE_CANCELLED. @pre at least 2 x 2 nodes
[[nodiscard]] Result<heightmap::ModelField> offset_surface(const heightmap::ModelField& surface,
                                                           Millimetres distance,
                                                           const RunContext& run = {});

namespace detail {

/// CNC_HEIGHT_NOT_FINITE with the place.
[[nodiscard]] Result<void> check_heights(const heightmap::ModelField& surface);
/// Lowest centre of a ball of this radius above the surface, at every node. Empty-handed where it
/// was stopped.
[[nodiscard]] heightmap::ModelField rolled(const heightmap::ModelField& surface, double radius_mm,
                                           const RunContext& run);
/// With `more` nodes around it that continue the slopes of the last cells, so that the ball finds
/// at the outline what it would find inside.
[[nodiscard]] heightmap::ModelField continued(const heightmap::ModelField& field,
                                              std::ptrdiff_t more);
/// The nodes that `field` has.
[[nodiscard]] heightmap::ModelField cropped(const heightmap::ModelField& wider,
                                            const heightmap::ModelField& field,
                                            std::ptrdiff_t more);
[[nodiscard]] heightmap::ModelField upside_down(heightmap::ModelField field);

}  // namespace detail
}  // namespace maquette::cnc
