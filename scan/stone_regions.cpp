// SPDX-License-Identifier: GPL-3.0-or-later

// Outlines of planned stones as regions.

#include <algorithm>
#include <array>
#include <string>

#include "scan/regions.hpp"

namespace maquette::scan {
namespace {

using Place = std::array<double, 2>;

/// Convex hull, counter-clockwise: A. M. Andrew, "Another efficient algorithm for convex hulls in
/// two dimensions", 1979, doi:10.1016/0020-0190(79)90072-3.
std::vector<Place> hull_of(std::vector<Place> places) {
  std::sort(places.begin(), places.end());
  const auto turns_right = [](const Place& a, const Place& b, const Place& c) {
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) <= 0.0;
  };
  std::vector<Place> hull;
  const auto side = [&](const auto& from, const auto& to) {
    const std::size_t begun = hull.size();
    for (auto p = from; p != to; ++p) {
      while (hull.size() >= begun + 2 && turns_right(hull[hull.size() - 2], hull.back(), *p))
        hull.pop_back();
      hull.push_back(*p);
    }
    hull.pop_back();  // the next side begins there
  };
  side(places.begin(), places.end());
  side(places.rbegin(), places.rend());
  return hull;
}

}  // namespace

std::vector<Region> stone_regions(std::span<const meshing::PlacedStone> plan) {
  std::vector<Region> regions;
  for (const meshing::PlacedStone& stone : plan) {
    std::vector<Place> places;
    for (const Vec3& v : meshing::stone_mesh(stone).vertices_mm) places.push_back({v.x, v.y});
    Region& r = regions.emplace_back();
    r.name = "stone " + std::to_string(stone.number);
    if (places.size() >= 3) r.rings_mm.push_back(hull_of(std::move(places)));
  }
  return regions;
}

}  // namespace maquette::scan
