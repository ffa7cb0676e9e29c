// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file engagement.hpp
/// How much the cutter has to do: removed volume per millimetre of path, and how much of the path
/// removes nothing.
///
/// Volumes are sums over cells inside the design's outline of what each cutting move lowered
/// them by: exact but for the cells at the edge of a cut (an area of half a cell along it).
/// Air is a cutting move that lowers no cell at all; moves shorter than a cell may fall
/// between cell centres and count as air.

#include <array>
#include <cstdint>

namespace maquette::cnc {

struct EngagementFigures {
  double cutting_length_mm = 0.0;
  double air_length_mm = 0.0;
  double removed_mm3 = 0.0;  ///< rapids included
  double largest_mm2 = 0.0;  ///< removed volume per mm of path, of moves longer than a cell
  double largest_rate_mm3_min = 0.0;
  /// Length of path whose engagement is from 0 (air apart), 0.01, 0.03, 0.1, ... 30 mm^2 upwards.
  static constexpr std::array<double, 9> kFrom_mm2{0.0, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0};
  std::array<double, 9> length_by_class_mm{};

  /// One cutting move. @param removed_mm3 0: air
  void add(double length_mm, double removed_volume_mm3, double feed_mm_min, double cell_mm);
};

}  // namespace maquette::cnc
