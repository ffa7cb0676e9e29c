// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file find_objects.hpp
/// What stands on the part and is in no plan: a clamp, a chip, a stone that was laid elsewhere.
///
/// Points   that stand above what the part should be by more than five times the noise, in cells
/// with
///          some six points each; cells of which half of the points do so belong to an object with
///          those they touch, corners included. Within the footprint of a planned stone and a
///          margin nothing is sought: find_stones.hpp says what is there.
/// Accepted with twelve points or more: noise alone reaches five standard deviations once in
///          three million points, and never twelve times side by side.
/// Size     Of the cells, by principal axes; the height above the expected surface is the 95th
///          percentile of the points', with the noise's standard deviation.

#include <span>
#include <vector>

#include "heightmap/height_field.hpp"
#include "meshing/stones.hpp"

namespace maquette::scan {

struct ExtraObject {
  Vec3 centre_mm;  ///< x, y: mean of its points; z: of the surface under it
  double height_mm = 0.0, sigma_height_mm = 0.0;
  double length_mm = 0.0, width_mm = 0.0;
  double volume_mm3 = 0.0;  ///< between its upper side and the surface
  std::size_t points = 0;
  /// Number of a stone of the plan that is of its size to a fifth, and missing where it belongs; 0:
  /// none. Two that fit: the nearer in height.
  int resembles = 0;
};

/// @param points_mm  in the model frame, also those that are off the part for their height
/// @param expected   what the part should be, without stones
/// @param plan       stones, which need not be there
/// @param missing    numbers of those that are not
/// @param noise_mm   of single points
/// @return the largest volume first
[[nodiscard]] std::vector<ExtraObject> find_objects(std::span<const Vec3> points_mm,
                                                    const heightmap::ModelField& expected,
                                                    std::span<const meshing::PlacedStone> plan,
                                                    std::span<const int> missing, double noise_mm);

}  // namespace maquette::scan
