// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file worst_places.hpp
/// Where a part is farthest from its design, significant or not.

#include <cstddef>
#include <span>
#include <vector>

#include "core/vec.hpp"
#include "scan/significance.hpp"

namespace maquette::scan {

struct WorstPlace {
  Vec3 at_mm;                ///< middle of the cell; z: 0
  double mean_mm = 0.0;      ///< of the cell
  double lod_mm = 0.0;       ///< level of detection there, 95 %
  bool significant = false;  ///< the cell is, or it lies in a finding
};

/// Cells whose mean is farthest beyond its level of detection, the farthest first: of what is
/// hardly known, at a rim for example, the largest values are the least certain.
/// @param most      how many at most
/// @param apart_mm  none is nearer to one before it: a wide patch is one place
/// @param findings  of all sizes of cells: of a patch of many cells none need be certain alone
[[nodiscard]] std::vector<WorstPlace> worst_places(const CellMap& map, std::size_t most,
                                                   double apart_mm,
                                                   std::span<const Finding> findings = {});

}  // namespace maquette::scan
