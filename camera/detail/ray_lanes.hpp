// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file ray_lanes.hpp
/// Up to sixteen rays side by side, so that what is done to all of them is done at once.

#include <array>
#include <cstddef>

#include "core/vec.hpp"

namespace maquette::camera::detail {

struct RayLanes {
  static constexpr std::size_t kCount = 16;
  using Lane = std::array<double, kCount>;
  Lane origin_x, origin_y, origin_z, way_x, way_y, way_z;
  Lane length;  ///< times the way

  [[nodiscard]] Vec3 origin(std::size_t i) const { return {origin_x[i], origin_y[i], origin_z[i]}; }
  [[nodiscard]] Vec3 way(std::size_t i) const { return {way_x[i], way_y[i], way_z[i]}; }
  void put(std::size_t i, Vec3 origin, Vec3 way, double far) {
    origin_x[i] = origin.x, origin_y[i] = origin.y, origin_z[i] = origin.z;
    way_x[i] = way.x, way_y[i] = way.y, way_z[i] = way.z;
    length[i] = far;
  }
  /// Lane `to` becomes as lane `from`.
  void repeat(std::size_t from, std::size_t to) { put(to, origin(from), way(from), length[from]); }
};

}  // namespace maquette::camera::detail
