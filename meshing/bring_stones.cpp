// SPDX-License-Identifier: GPL-3.0-or-later
#include "meshing/bring_stones.hpp"

#include <cmath>

#include "core/check.hpp"

namespace maquette::meshing {
namespace {

/// Model height of the site's height 0.
double zero_mm(const StoneGround& ground) {
  return -ground.scale.vertical(Metres{ground.height_of_z0_m}).value();
}

}  // namespace

std::vector<PlacedStone> bring_stones(std::span<const PlacedStone> stones, const StoneGround& from,
                                      const StoneGround& to) {
  MAQUETTE_CHECK(from.scale.exaggeration() == to.scale.exaggeration(), "{}, {}",
                 from.scale.exaggeration(), to.scale.exaggeration());
  const double ratio = from.scale.denominator() / to.scale.denominator();
  const Vec3 shift{to.scale.horizontal(Metres{from.east_of_x0_m - to.east_of_x0_m}).value(),
                   to.scale.horizontal(Metres{from.north_of_y0_m - to.north_of_y0_m}).value(),
                   zero_mm(to) - ratio * zero_mm(from)};
  std::vector<PlacedStone> all;
  for (PlacedStone stone : stones) {
    stone.scale_mm *= ratio;
    Vec3& at = stone.model_from_stone.translation_mm;
    at = ratio * at + shift;
    Vec3 lowest{0, 0, INFINITY};
    bool over = true;
    for (const Vec3& v : stone_mesh(stone).vertices_mm) {
      over = over && !std::isnan(heightmap::height_at(to.surface, v.x, v.y));
      if (v.z < lowest.z) lowest = v;
    }
    if (!over) continue;
    stone.embedded_depth_mm = heightmap::height_at(to.surface, lowest.x, lowest.y) - lowest.z;
    all.push_back(std::move(stone));
  }
  return all;
}

std::vector<StoneDisc> discs_of(std::span<const PlacedStone> stones, const StoneGround& ground) {
  const auto metres = [&](double mm) {
    return ground.scale.unscale_horizontal(Millimetres{mm}).value();
  };
  std::vector<StoneDisc> discs;
  for (const PlacedStone& s : stones) {
    const double radius = circumscribed_radius({.shape = s.shape, .body = s.body});
    const Vec3 at = s.model_from_stone.translation_mm;
    discs.push_back({ground.east_of_x0_m + metres(at.x), ground.north_of_y0_m + metres(at.y),
                     metres(radius * s.scale_mm)});
  }
  return discs;
}

}  // namespace maquette::meshing
