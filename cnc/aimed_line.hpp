// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file aimed_line.hpp
/// Lines in any direction that a program can write exactly: all their places lie on a lattice of
/// whole steps of 0.001 mm, none coarser than 32 um along an axis.
///
/// Of the directions (p, q), p <= 32, the one that gets farthest towards an aim before it is 14 um
/// beside: by Dirichlet's approximation some q <= 32 is off by less than 1 / (32 q), so lines reach
/// 0.45 mm at worst, some millimetres on average.

#include <cstdint>
#include <limits>
#include <span>

#include "cnc/level_curves.hpp"
#include "cnc/pass_sampler.hpp"

namespace maquette::cnc {

/// 0.001 mm, limits included.
struct PlanBox {
  std::int32_t left = std::numeric_limits<std::int32_t>::min();
  std::int32_t right = std::numeric_limits<std::int32_t>::max();
  std::int32_t bottom = left, top = right;
};
/// The field's outline, rounded inwards.
[[nodiscard]] PlanBox box_within(const heightmap::ModelField& field);

/// Step in x and y at most 32 um, beside the way to its aim at most 14 um.
struct AimedLine {
  LatticeLine line;
  std::int64_t steps = 0;
  [[nodiscard]] PlanPlace end() const {
    return {static_cast<std::int32_t>((line.x + steps * line.dx) / kResolution),
            static_cast<std::int32_t>((line.y + steps * line.dy) / kResolution)};
  }
};
/// The farthest line from `from` towards `to`, all the way where that can be written; it stays in
/// the box if both places do. @pre the two differ
[[nodiscard]] AimedLine aim(PlanPlace from, PlanPlace to, const PlanBox& box = {});

/// The way as lines one after the other, each aimed from where the one before ended: its places are
/// their ends. Nearer than kNear_mm to a place of the way they go on to the next, so the result
/// stays within kBesideWay_mm of the way.
[[nodiscard]] PlanCurve writable(const PlanCurve& way, const PlanBox& box = {});

inline constexpr double kNear_mm = 0.032, kBesideWay_mm = 0.046;

}  // namespace maquette::cnc
