// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/show.hpp"

#include <algorithm>
#include <cmath>

namespace maquette::diagnosis::detail {

Map draw(const std::vector<Observation>& all, const std::vector<double>& before,
         const std::vector<double>& after, const Box3& box) {
  Map map;
  const double wide = box.max.x - box.min.x, high = box.max.y - box.min.y;
  map.cell_mm = std::fmax(wide, high) / 120.0;
  map.x0_mm = box.min.x;
  map.y0_mm = box.min.y;
  const auto rows = static_cast<std::ptrdiff_t>(std::ceil(high / map.cell_mm)),
             cols = static_cast<std::ptrdiff_t>(std::ceil(wide / map.cell_mm));
  Grid<double> b(rows, cols, 0.0), a(rows, cols, 0.0), n(rows, cols, 0.0);
  for (std::size_t i = 0; i < all.size(); ++i) {
    const auto c = std::clamp<std::ptrdiff_t>(
        static_cast<std::ptrdiff_t>((all[i].place.x - map.x0_mm) / map.cell_mm), 0, cols - 1);
    const auto r = std::clamp<std::ptrdiff_t>(
        static_cast<std::ptrdiff_t>((all[i].place.y - map.y0_mm) / map.cell_mm), 0, rows - 1);
    b(r, c) += before[i];
    a(r, c) += after[i];
    n(r, c) += 1.0;
  }
  map.before = Grid<float>(rows, cols, NAN);
  map.after = Grid<float>(rows, cols, NAN);
  for (std::size_t i = 0; i < n.cells().size(); ++i)
    if (n.cells()[i] > 0.0) {
      map.before.cells()[i] = static_cast<float>(b.cells()[i] / n.cells()[i]);
      map.after.cells()[i] = static_cast<float>(a.cells()[i] / n.cells()[i]);
    }
  return map;
}

std::vector<Dependence> dependences(const std::vector<Observation>& all,
                                    const std::vector<double>& before,
                                    const std::vector<double>& after) {
  std::vector<Dependence> shown;
  struct Covariate {
    const char* name;
    double (*value)(const Observation&);
  };
  for (const Covariate c :
       {Covariate{"slope, degrees",
                  [](const Observation& o) {
                    return std::acos(std::fmin(1.0, o.normal.z)) * 57.29577951308232;
                  }},
        Covariate{"share of the program's time", [](const Observation& o) { return o.path_share; }},
        Covariate{"x, mm", [](const Observation& o) { return o.place.x; }},
        Covariate{"y, mm", [](const Observation& o) { return o.place.y; }},
        Covariate{"incidence, degrees",
                  [](const Observation& o) {
                    return o.has_station
                               ? std::acos(std::clamp(-dot(o.beam, o.normal), -1.0, 1.0)) *
                                     57.29577951308232
                               : NAN;
                  }},
        Covariate{"range, mm",
                  [](const Observation& o) { return o.has_station ? o.range_mm : NAN; }},
        Covariate{"rise of the feed", [](const Observation& o) { return o.feed.z; }}}) {
    double low = INFINITY, high = -INFINITY;
    for (const Observation& o : all) {
      const double v = c.value(o);
      if (!std::isfinite(v)) continue;
      low = std::fmin(low, v);
      high = std::fmax(high, v);
    }
    if (!(high > low)) continue;
    constexpr std::size_t kClasses = 24;
    std::vector<double> n(kClasses, 0.0), b(kClasses, 0.0), a(kClasses, 0.0), q(kClasses, 0.0);
    for (std::size_t i = 0; i < all.size(); ++i) {
      const double v = c.value(all[i]);
      if (!std::isfinite(v)) continue;
      const auto k =
          std::min(kClasses - 1, static_cast<std::size_t>((v - low) / (high - low) * kClasses));
      n[k] += 1.0;
      b[k] += before[i];
      a[k] += after[i];
      q[k] += after[i] * after[i];
    }
    Dependence p;
    p.covariate = c.name;
    for (std::size_t k = 0; k < kClasses; ++k)
      if (n[k] >= 20.0) {
        p.at.push_back(low + (static_cast<double>(k) + 0.5) * (high - low) / kClasses);
        p.before.push_back(b[k] / n[k]);
        p.after.push_back(a[k] / n[k]);
        p.sigma.push_back(std::sqrt(q[k]) / n[k]);
      }
    shown.push_back(std::move(p));
  }
  return shown;
}

}  // namespace maquette::diagnosis::detail
