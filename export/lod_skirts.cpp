// SPDX-License-Identifier: GPL-3.0-or-later
#include "export/lod_skirts.hpp"

#include <algorithm>
#include <cmath>
#include <map>

#include "core/check.hpp"

namespace maquette::exporting {

void add_skirts(LodTileMesh& tile, const heightmap::ModelField& field, std::int32_t depth) {
  MAQUETTE_CHECK(depth > 0, "a skirt of {} steps", depth);
  const Grid<float>& z = field.z_mm;
  const auto west = tile.cols.front(), east = tile.cols.back(), south = tile.rows.front(),
             north = tile.rows.back();
  std::map<std::uint32_t, std::uint32_t> foot;  // corners between two walls have one
  const auto foot_of = [&](std::uint32_t rim) {
    const auto [at, fresh] =
        foot.try_emplace(rim, static_cast<std::uint32_t>(tile.vertices.size()));
    if (fresh) {
      LodVertex below = tile.vertices[rim];
      below.height -= depth;
      tile.vertices.push_back(below);
    }
    return at->second;
  };
  const auto rim_vertices = static_cast<std::uint32_t>(tile.vertices.size());
  /// @param along  grows counter-clockwise seen from above
  const auto hang = [&](const auto& on_side, const auto& along) {
    std::vector<std::uint32_t> rim;
    for (std::uint32_t i = 0; i < rim_vertices; ++i)
      if (on_side(tile.vertices[i])) rim.push_back(i);
    std::sort(rim.begin(), rim.end(), [&](std::uint32_t a, std::uint32_t b) {
      return along(tile.vertices[a]) < along(tile.vertices[b]);
    });
    for (std::size_t i = 0; i + 1 < rim.size(); ++i) {
      const std::uint32_t a = rim[i], b = rim[i + 1], below_a = foot_of(a), below_b = foot_of(b);
      tile.triangles.push_back({b, a, below_a});
      tile.triangles.push_back({b, below_a, below_b});
    }
  };
  using V = const LodVertex&;
  if (south > 0) hang([&](V v) { return v.row == south; }, [](V v) { return v.col; });
  if (east < z.cols() - 1) hang([&](V v) { return v.col == east; }, [](V v) { return v.row; });
  if (north < z.rows() - 1) hang([&](V v) { return v.row == north; }, [](V v) { return -v.col; });
  if (west > 0) hang([&](V v) { return v.col == west; }, [](V v) { return -v.row; });
}

std::int32_t skirt_depth(const LodTileError& own, const LodTileError& coarser,
                         const LodLattice& lattice) {
  return static_cast<std::int32_t>(
             std::ceil((own.vertical_mm + coarser.vertical_mm) / lattice.step_mm)) +
         1;
}

}  // namespace maquette::exporting
