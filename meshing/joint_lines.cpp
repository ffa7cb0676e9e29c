// SPDX-License-Identifier: GPL-3.0-or-later
#include "meshing/detail/joint_lines.hpp"

#include <algorithm>
#include <limits>
#include <tuple>

#include "core/check.hpp"

namespace maquette::meshing::detail {
namespace {

/// Of the best cut that ends at a line.
struct Best {
  LineCost cost = std::numeric_limits<LineCost>::max();
  std::ptrdiff_t parts = 0;
  double squares = 0.0;
  std::ptrdiff_t before = -1;
  [[nodiscard]] bool reached() const { return cost != std::numeric_limits<LineCost>::max(); }
  friend bool operator<(const Best& a, const Best& b) {
    return std::tie(a.cost, a.parts, a.squares) < std::tie(b.cost, b.parts, b.squares);
  }
};

Best beyond(const Best& from, std::ptrdiff_t j, std::ptrdiff_t i, LineCost cost) {
  const auto cells = static_cast<double>(i - j);
  return {from.cost + cost, from.parts + 1, from.squares + cells * cells, j};
}

}  // namespace

std::vector<std::ptrdiff_t> best_lines(std::span<const LineCost> cost, std::ptrdiff_t least,
                                       std::ptrdiff_t most) {
  const auto lines = static_cast<std::ptrdiff_t>(cost.size());
  MAQUETTE_CHECK(lines >= 2 && least >= 1 && most >= least, "{} {} {}", lines, least, most);
  std::vector<Best> best(cost.size());
  best[0].cost = 0;
  for (std::ptrdiff_t i = least; i < lines; ++i) {
    const auto k = static_cast<std::size_t>(i);
    const LineCost here = i + 1 < lines ? cost[k] : 0;
    for (std::ptrdiff_t j = std::max<std::ptrdiff_t>(0, i - most); j <= i - least; ++j) {
      const Best& from = best[static_cast<std::size_t>(j)];
      if (!from.reached()) continue;
      if (const Best next = beyond(from, j, i, here); next < best[k]) best[k] = next;
    }
  }
  std::vector<std::ptrdiff_t> cut;
  if (!best.back().reached()) return cut;
  for (std::ptrdiff_t i = lines - 1; i >= 0; i = best[static_cast<std::size_t>(i)].before)
    cut.push_back(i);
  std::reverse(cut.begin(), cut.end());
  return cut;
}

std::vector<std::ptrdiff_t> best_lines_of(std::span<const LineCost> cost, std::ptrdiff_t parts) {
  const auto cells = static_cast<std::ptrdiff_t>(cost.size()) - 1;
  MAQUETTE_CHECK(parts >= 1 && cells >= 2 * parts, "{} parts of {} cells", parts, cells);
  struct Place {
    std::ptrdiff_t line;
    Best best;
  };
  // Joints of neighbouring windows are at least two cells apart.
  const std::ptrdiff_t reach = (cells / parts - 2) / 2;
  std::vector<std::vector<Place>> places(static_cast<std::size_t>(parts) + 1);
  places[0].push_back({0, {0, 0, 0.0, -1}});
  for (std::ptrdiff_t p = 1; p <= parts; ++p) {
    auto& here = places[static_cast<std::size_t>(p)];
    const std::ptrdiff_t even = p * cells / parts, side = p < parts ? reach : 0;
    for (std::ptrdiff_t i = even - side; i <= even + side; ++i) {
      Place place{i, {}};
      const auto& before = places[static_cast<std::size_t>(p) - 1];
      for (std::size_t j = 0; j < before.size(); ++j) {
        Best next = beyond(before[j].best, before[j].line, i,
                           p < parts ? cost[static_cast<std::size_t>(i)] : 0);
        next.before = static_cast<std::ptrdiff_t>(j);
        if (next < place.best) place.best = next;
      }
      here.push_back(place);
    }
  }
  std::vector<std::ptrdiff_t> cut;
  std::ptrdiff_t at = 0;
  for (std::ptrdiff_t p = parts; p >= 0; --p) {
    const Place& place = places[static_cast<std::size_t>(p)][static_cast<std::size_t>(at)];
    cut.push_back(place.line);
    at = place.best.before;
  }
  std::reverse(cut.begin(), cut.end());
  return cut;
}

}  // namespace maquette::meshing::detail
