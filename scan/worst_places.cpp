// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/worst_places.hpp"

#include <algorithm>
#include <cmath>

namespace maquette::scan {

std::vector<WorstPlace> worst_places(const CellMap& map, std::size_t most, double apart_mm,
                                     std::span<const Finding> findings) {
  struct Entry {
    float beyond_mm;
    std::ptrdiff_t r, c;
  };
  std::vector<Entry> cells;
  for (std::ptrdiff_t r = 0; r < map.mean_mm.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < map.mean_mm.cols(); ++c)
      if (const float m = map.mean_mm(r, c); !std::isnan(m))
        cells.push_back({std::abs(m) - map.lod_mm(r, c), r, c});
  std::sort(cells.begin(), cells.end(), [](const Entry& a, const Entry& b) {
    return a.beyond_mm != b.beyond_mm ? a.beyond_mm > b.beyond_mm
                                      : (a.r != b.r ? a.r < b.r : a.c < b.c);
  });
  std::vector<WorstPlace> places;
  for (const Entry& e : cells) {
    if (places.size() == most) break;
    const Vec3 at{map.x0_mm + (static_cast<double>(e.c) + 0.5) * map.cell_mm,
                  map.y0_mm + (static_cast<double>(e.r) + 0.5) * map.cell_mm, 0.0};
    if (std::any_of(places.begin(), places.end(),
                    [&](const WorstPlace& p) { return norm(p.at_mm - at) < apart_mm; }))
      continue;
    const bool in_finding = std::any_of(findings.begin(), findings.end(), [&](const Finding& f) {
      return !f.whole_part && at.x > f.min_mm.x && at.x < f.max_mm.x && at.y > f.min_mm.y &&
             at.y < f.max_mm.y;
    });
    places.push_back({at, static_cast<double>(map.mean_mm(e.r, e.c)),
                      static_cast<double>(map.lod_mm(e.r, e.c)),
                      in_finding || map.significant(e.r, e.c) != 0});
  }
  return places;
}

}  // namespace maquette::scan
