// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file engrave.hpp
/// Seats of the planned stones: where each goes, marked by an engraved outline or milled
/// as a pocket with a flat floor.
///
/// Takes   ModelField (the surface without stones), placed stones (meshing/stones.hpp)
/// Gives   seats; the outlines as a Toolpath; the surface with the pockets, and what they take out
///         as a RestMap, so that rest_finish() mills them layer by layer
///
/// A seat. The part of the stone that is under the surface, seen from above: the convex hull of
/// those vertices, wider by `gap` all around. Its floor is level, at the stone's lowest point less
/// the bed for the glue. A round cutter leaves its radius in the pocket's corner: take a gap of at
/// least that for a stone with a sharp rim.
///
/// An outline is cut by a ball along the seat's border, `depth` below the surface: raised by depth
/// its path is made of exact cutter locations no farther apart, in space, than `chord_mm`; a ball
/// that is free at both ends of such a chord is pierced no deeper than R - sqrt(R^2 - chord^2 / 4)
/// between (docs/derivations/waterline.md, which holds for chords of any direction where both ends
/// are above what they touch). At walls no chord follows, the outline is what it is: a mark.

#include <array>
#include <span>
#include <vector>

#include "cnc/rest.hpp"
#include "meshing/stones.hpp"

namespace maquette::cnc {

inline constexpr ErrorCode kEngraveOptionOutOfRange{"CNC_ENGRAVE_OPTION_OUT_OF_RANGE"};

struct Seat {
  int stone = 0;                                 ///< its number
  std::vector<std::array<double, 2>> border_mm;  ///< convex, counter-clockwise, not closed
  double floor_mm = 0.0;
};

/// Stones that touch the surface nowhere have no seat. The border may reach beyond the outline.
/// @pre gap, bed >= 0
[[nodiscard]] std::vector<Seat> stone_seats(const heightmap::ModelField& surface,
                                            std::span<const meshing::PlacedStone> stones,
                                            double gap_mm, double bed_mm);

/// The surface, no higher than the floor at the nodes inside a seat.
[[nodiscard]] heightmap::ModelField with_seats(const heightmap::ModelField& surface,
                                               std::span<const Seat> seats);

/// What stands on `seated` where `surface` has been finished: what rest_finish() takes away.
/// @pre of the same size
[[nodiscard]] RestMap seat_map(const heightmap::ModelField& surface,
                               const heightmap::ModelField& seated);

struct EngraveOptions {
  double ball_radius_mm = 0.5;
  double depth_mm = 0.3;  ///< at most the radius
  double chord_mm = 0.05;
  double feed_mm_min = 1000.0, plunge_feed_mm_min = 300.0;
  double clearance_mm = 2.0;
};

/// Along the border of each seat, the nearest next; parts outside the outline are left out.
/// Without moves if there are no seats.
/// @return CNC_ENGRAVE_OPTION_OUT_OF_RANGE with option, value and range; CNC_HEIGHT_NOT_FINITE
[[nodiscard]] Result<Toolpath> engrave_outlines(const heightmap::ModelField& surface,
                                                std::span<const Seat> seats,
                                                const EngraveOptions& options);

}  // namespace maquette::cnc
