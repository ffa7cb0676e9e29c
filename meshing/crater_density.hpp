// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file crater_density.hpp
/// Rock fields: denser around craters, by travel distance along the surface.
///
/// Room   craters, model surface -> [travel_from_rims] -> [density_around] -> plan of stones
/// Takes  craters in metres of the site, a height field in millimetres
/// Gives  SitePlanRequest::density
///
/// Method. What a crater has thrown out lies at its rim and thins out from there. The distance is
/// travelled over the relief (geodesic.hpp): each metre of ground whose slope is a counts as
/// 1 + slope_slowness tan a, so that fields reach far over level ground and end at steep walls. The
/// density is far_share + (1 - far_share) exp(-travel / decay), at most 1. Accuracy of the travel
/// distance: as geodesic.hpp says of segments and slowness. Cost: that of one geodesic field.

#include <functional>
#include <span>

#include "core/result.hpp"
#include "core/run_context.hpp"
#include "core/units.hpp"
#include "heightmap/height_field.hpp"
#include "meshing/stones.hpp"

namespace maquette::meshing {

inline constexpr ErrorCode kNoRimOnSite{"MESHING_NO_RIM_ON_SITE"};

struct Crater {
  double east_m = 0.0, north_m = 0.0;  ///< of its middle, site frame
  Metres diameter{0.0};                ///< of its rim
};

/// Travel distance from the nearest rim in model millimetres, at the nodes of the surface. Rims are
/// circles; of one that is partly beyond the surface the part on it counts.
/// MESHING_NO_RIM_ON_SITE: there is no such part; those of geodesic_distance
/// @pre diameters above 0, slope_slowness >= 0, at least one crater
[[nodiscard]] Result<heightmap::ModelField> travel_from_rims(std::span<const Crater> craters,
                                                             const StoneGround& ground,
                                                             double slope_slowness,
                                                             const RunContext& run = {});

/// @param travel  what travel_from_rims gave of that ground; beyond it the density is far_share
/// @pre decay > 0, far_share within 0 .. 1
[[nodiscard]] std::function<double(double east_m, double north_m)> density_around(
    heightmap::ModelField travel, const StoneGround& ground, Metres decay, double far_share);

}  // namespace maquette::meshing
