// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/engagement.hpp"

#include <algorithm>
#include <cmath>

namespace maquette::cnc {

void EngagementFigures::add(double length_mm, double removed_volume_mm3, double feed_mm_min,
                            double cell_mm) {
  cutting_length_mm += length_mm;
  removed_mm3 += removed_volume_mm3;
  if (!(removed_volume_mm3 > 0.0)) {
    air_length_mm += length_mm;
    return;
  }
  if (!(length_mm > 0.0)) return;
  const double area = removed_volume_mm3 / length_mm;
  const auto above = std::upper_bound(kFrom_mm2.begin(), kFrom_mm2.end(), area);
  length_by_class_mm[static_cast<std::size_t>(above - kFrom_mm2.begin() - 1)] += length_mm;
  if (length_mm < cell_mm) return;
  largest_mm2 = std::fmax(largest_mm2, area);
  largest_rate_mm3_min = std::fmax(largest_rate_mm3_min, area * feed_mm_min);
}

}  // namespace maquette::cnc
