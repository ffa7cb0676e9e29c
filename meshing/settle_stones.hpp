// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file settle_stones.hpp
/// Stones that rest: each is dropped and turns about what it touches until it lies on three
/// contacts that hold its centre of mass.
///
/// Room   meshing:  plan of stones, model surface -> [settle_stones] -> placed stones
/// Takes  stones in metres of the site, a height field in millimetres
/// Gives  poses in the model frame, millimetres
///
/// Method. Quasi-static, one stone after the other. A stone begins as lay_stones would lay it, its
/// base along the ground, and comes straight down until it touches. Then, as long as the vertical
/// through its centre of mass (of one density) misses the polygon of its contacts, it turns about
/// that polygon's edge or corner that lets the centre of mass down fastest, and only as far as
/// nothing goes into the ground; contacts do not slip. Ground and stone are both taken as the
/// triangles that they are (detail/stone_clearance.hpp).
///
/// Accuracy. Nothing is deeper in the ground than kSunken_mm, and what counts as contact is not
/// farther from it than kContact_mm; both before the stone is sunk.
///
/// Not modelled: speed (a stone never jumps), rolling friction, and forces between stones.
/// Cost. 0.015 CPU s a stone of 5120 triangles that is 3 to 10 nodes wide, 0.03 of 15 to 35 nodes.

#include <cstdint>
#include <span>
#include <vector>

#include "core/result.hpp"
#include "core/run_context.hpp"
#include "core/units.hpp"
#include "heightmap/height_field.hpp"
#include "meshing/stones.hpp"

namespace maquette::meshing {

inline constexpr ErrorCode kStoneSlides{"MESHING_STONE_SLIDES"};
inline constexpr ErrorCode kStoneDoesNotRest{"MESHING_STONE_DOES_NOT_REST"};

inline constexpr double kContact_mm = 1e-3;
inline constexpr double kSunken_mm = 1e-6;

struct SettleOptions {
  double embedded_share = 0.25;        ///< of the stone's height at rest, straight down
  Radians repose = degrees(35);        ///< friction angle: on steeper ground a stone slides
  std::uint64_t seed = 1;              ///< says where a stone falls that stands on its tip
  double farthest = 20.0;              ///< diameters that it may roll and slide from its place
  int other_places = 200;              ///< that are tried where the one of the plan does not do
  std::span<const StoneDisc> taken{};  ///< by stones that lie already
};

/// Where it rests, a stone lies on ground that is not steeper than `repose` (the plane that fits
/// the nodes under its footprint best), keeps to its square (keeps_to_its_square) and to itself:
/// the circumscribed spheres of stones do not overlap. A stone on steeper ground is moved down it
/// by quarters of its diameter and dropped again. Where that does not lead to rest, a drawn stone
/// is tried in other places (draw_other_place); a stone whose place the user says is refused, also
/// if it would roll from there by more than its diameter. Places are given away in the order of
/// numbers, the user's first.
/// A stone that stands with its centre of mass above fewer than three contacts falls over to a side
/// that the seed says, unless it can fall to none: it stays.
/// Stones that the plan has beyond this surface, and those of the user that do not lie on it as a
/// whole, are left out. Same stones, surface and seed: same bits for any number of threads.
/// MESHING_STONE_SLIDES: only steeper ground was found; MESHING_STONE_DOES_NOT_REST: wedged,
/// rolling on, or no free place; both with number, place and slope. CORE_CANCELLED.
/// @param request  what `stones` were planned by
/// @pre as lay_stones; repose above 0
[[nodiscard]] Result<std::vector<PlacedStone>> settle_stones(std::span<const SiteStone> stones,
                                                             const SitePlanRequest& request,
                                                             const StoneGround& ground,
                                                             const SettleOptions& options = {},
                                                             const RunContext& run = {});

}  // namespace maquette::meshing
