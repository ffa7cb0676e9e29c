// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file cast_shadow.hpp
/// How much of a spray from afar reaches a place, crests being in the way.
///
/// Method. Rays from the nodes of a coarse copy of the relief towards the gun, each blocked or
/// free, levelled by a Gaussian of kShadowEdge_mm: a gun is no point and moves.
/// Cost: 0.2 us of one core a node, at most 800 x 800; a byte a node for each direction asked for.

#include <cstdint>
#include <functional>
#include <memory>

#include "core/grid.hpp"
#include "core/vec.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::diagnosis {

/// Standard deviation of a shadow's edge in plan.
inline constexpr double kShadowEdge_mm = 1.0;

/// Of one direction.
struct CastShadow {
  Grid<std::uint8_t> reached;  ///< share of the spray, 255: all
  double x0_mm = 0.0, y0_mm = 0.0, spacing_mm = 1.0;
  double share = 0.0;  ///< of the part that is in shadow

  /// Share of the spray that reaches (x, y), 0 to 1; beside the relief that of its border.
  [[nodiscard]] double at(double x_mm, double y_mm) const;
};

/// Shadows of a relief by the unit direction towards the gun; worked out where first asked for,
/// then kept. Thread-safe.
[[nodiscard]] std::function<std::shared_ptr<const CastShadow>(Vec3 towards)> cast_shadows(
    const heightmap::ModelField& relief);

}  // namespace maquette::diagnosis
