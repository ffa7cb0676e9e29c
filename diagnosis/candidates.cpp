// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "diagnosis/detail/forms.hpp"
#include "diagnosis/detail/model_search.hpp"

namespace maquette::diagnosis::detail {

std::vector<Column> nuisances_of(const Measurements& m) {
  std::vector<Column> all;
  const double half = m.scene.half_mm();
  for (std::uint32_t s = 0; s < m.set_ups.size(); ++s) {
    const Vec3 c = m.set_ups[s].centre_mm;
    for (int k = 0; k < 6; ++k)
      all.push_back(moving_column(
          fmt::format("pose{}_{}", s, k), {"", 1.0, INFINITY}, [=](const Observation& o) {
            const Vec3 e = along_axis(k % 3, 1.0);
            return o.set_up != s ? Vec3{} : k < 3 ? e : (1.0 / half) * cross(e, o.place - c);
          }));
  }
  if (m.scene.has_path)
    all.push_back(column(kMilledMinusDesign, {"", 1.0, INFINITY}, [](const Observation& o) {
      return o.on_surface ? o.milled_minus_design_mm : 0.0;
    }));
  // Nobody declares whether a film follows the ridges between passes or levels over them.
  if (m.scene.has_path && m.scene.coat_mm > 0.0)
    all.push_back(column("film_over_ridges", {"", 1.0, INFINITY},
                         [coat = m.scene.coat_mm](const Observation& o) {
                           return o.on_surface ? coat * (film(o) - dot(o.along, o.normal)) : 0.0;
                         }));
  return all;
}

std::vector<Candidate> candidates_of(const Scene& scene, std::vector<std::string>& untestable) {
  std::vector<Candidate> all;
  const bool any_station =
      std::any_of(scene.has_station.begin(), scene.has_station.end(), [](bool b) { return b; });
  for (const Effect& e : library()) {
    if (!e.forms) continue;
    if ((e.needs == Needs::path && !scene.has_path) ||
        (e.needs == Needs::station && !any_station)) {
      untestable.push_back(e.name);
      continue;
    }
    all.push_back({&e, e.forms(scene)});
  }
  return all;
}

std::vector<Column> all_columns(const std::vector<Candidate>& candidates) {
  std::vector<Column> columns;
  for (const Candidate& c : candidates)
    for (const Form& f : c.forms) columns.insert(columns.end(), f.columns.begin(), f.columns.end());
  return columns;
}

}  // namespace maquette::diagnosis::detail
