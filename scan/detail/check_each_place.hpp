// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include "core/result.hpp"
#include "scan/cloud.hpp"

namespace maquette::scan {

/// Calls `check(place_mm, first, n)` for each scanner whose place is known, with the points it saw.
/// @return the first failure
template <class Check>
[[nodiscard]] Result<void> check_each_place(const Cloud& cloud, const Check& check) {
  if (cloud.station_mm) return check(*cloud.station_mm, std::size_t{0}, cloud.points_mm.size());
  std::size_t first = 0;
  for (const ScanStation& s : cloud.stations) {
    if (s.position_mm) {
      MAQUETTE_TRY_VOID(check(*s.position_mm, first, s.points));
    }
    first += s.points;
  }
  return {};
}

}  // namespace maquette::scan
