// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file find_stones.hpp
/// Where the stones really are: each stone's points are registered to its own mesh.
///
/// Points   of a stone are those over its footprint (and a margin) that stand above the ground by
///          more than five times the noise.
/// Pose     Gauss-Newton, point to triangle plane at the nearest point of the mesh, Huber, from
///          16 headings if the planned one does not fit. Covariance from the residuals; the
///          scan's own pose is added.
/// State    as planned or moved (beyond 99 % of its covariance), missing (over its middle the mean
///          height is below a quarter of the plan's, and below a half by more than three standard
///          deviations of that mean), swapped (another stone of the plan fits clearly better),
///          unclear (nothing fits), present (something as high stands there, with too few points
///          for a pose), unseen (too few points over its middle). A beam wider than a
///          stone shows it lower than it is: unclear or present, not missing.

#include <span>
#include <string_view>
#include <vector>

#include "heightmap/height_field.hpp"
#include "meshing/stones.hpp"
#include "scan/register.hpp"

namespace maquette::scan {

enum class StoneState { as_planned, moved, missing, swapped, unclear, present, unseen };
[[nodiscard]] std::string_view name_of(StoneState state);

struct StoneFinding {
  int number = 0;
  StoneState state = StoneState::unseen;
  int carries = 0;         ///< swapped: number of the stone that is there
  std::size_t points = 0;  ///< on the stone
  Vec3 shift_mm;           ///< of the middle of its mesh: actual minus planned
  Vec3 sigma_shift_mm;
  double turn_rad = 0.0, sigma_turn_rad = 0.0;  ///< about the vertical, counter-clockwise
  double tilt_rad = 0.0;                        ///< of its vertical
  double noise_mm = 0.0;                        ///< NMAD of the residuals
  double height_share = 0.0;           ///< of the planned height above ground that was measured
  RigidTransform actual_from_planned;  ///< model frame
};

/// @param points_mm     in the model frame
/// @param ground        the design without stones
/// @param noise_mm      of single points
/// @param registration  of the scan; null: the pose is known
[[nodiscard]] std::vector<StoneFinding> find_stones(std::span<const Vec3> points_mm,
                                                    const heightmap::ModelField& ground,
                                                    std::span<const meshing::PlacedStone> plan,
                                                    double noise_mm,
                                                    const Registration* registration);

}  // namespace maquette::scan
