// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/thinned.hpp"

#include <unordered_set>

#include "core/random.hpp"

namespace maquette::diagnosis::detail {
namespace {

/// Points in plan that choose.
constexpr double kPerMm2 = 5.0;
/// Where fewer would be left out a second set of sums is not worth its time.
constexpr double kWorthIt = 1.5;

/// Of the cells that have points.
double area_mm2(const std::vector<Observation>& all, const Layout& layout) {
  std::unordered_set<std::ptrdiff_t> cells;
  for (const Observation& o : all) cells.insert(layout.cell_of(o.place.x, o.place.y));
  return static_cast<double>(cells.size()) * layout.cell_mm * layout.cell_mm;
}

}  // namespace

std::vector<Observation> thinned(const std::vector<Observation>& observations,
                                 const Layout& layout) {
  constexpr std::uint64_t kStream = 20'261'201;
  const double share =
      kPerMm2 * area_mm2(observations, layout) / static_cast<double>(observations.size());
  if (share * kWorthIt > 1.0) return {};
  std::vector<Observation> few;
  for (std::size_t i = 0; i < observations.size(); ++i)
    if (random_uniform(kStream, i) < share) few.push_back(observations[i]);
  return few;
}

}  // namespace maquette::diagnosis::detail
