// SPDX-License-Identifier: GPL-3.0-or-later
#include "export/lod_tile.hpp"

#include <algorithm>
#include <cmath>

#include "core/check.hpp"

namespace maquette::exporting {
namespace {

/// A tile while it grows.
class Builder {
 public:
  Builder(const LodPyramid& pyramid, const LodLattice& lattice, LodTileKey key)
      : pyramid_(pyramid), lattice_(lattice), key_(key) {
    tile_.key = key;
    const Grid<float>& z = pyramid.field().z_mm;
    const auto nodes_along = [&](std::ptrdiff_t nodes, std::ptrdiff_t tile) {
      std::vector<std::ptrdiff_t> along;
      const std::ptrdiff_t first = tile * lattice.tile_quads;
      const std::ptrdiff_t last =
          std::min(first + lattice.tile_quads, lod_nodes(nodes, key.level) - 1);
      for (std::ptrdiff_t i = first; i <= last; ++i) along.push_back(lod_node(nodes, key.level, i));
      return along;
    };
    tile_.cols = nodes_along(z.cols(), key.x);
    tile_.rows = nodes_along(z.rows(), key.y);
    MAQUETTE_CHECK(tile_.cols.size() >= 2 && tile_.rows.size() >= 2, "tile {} {} of level {}",
                   key.x, key.y, key.level);
    const bool coarse = key.level > 0;
    west_ = coarse && tile_.cols.front() > 0;
    south_ = coarse && tile_.rows.front() > 0;
    east_ = coarse && tile_.cols.back() < z.cols() - 1;
    north_ = coarse && tile_.rows.back() < z.rows() - 1;
  }

  LodTileMesh build() && {
    const std::size_t across = tile_.cols.size(), up = tile_.rows.size();
    for (std::size_t r = 0; r < up; ++r)
      for (std::size_t c = 0; c < across; ++c) add_node(r, c);
    for (std::size_t r = 0; r + 1 < up; ++r)
      for (std::size_t c = 0; c + 1 < across; ++c) {
        tile_.first_of_cell.push_back(static_cast<std::uint32_t>(tile_.triangles.size()));
        add_cell(r, c);
      }
    tile_.first_of_cell.push_back(static_cast<std::uint32_t>(tile_.triangles.size()));
    return std::move(tile_);
  }

 private:
  using Side = std::vector<std::uint32_t>;

  std::uint32_t add_vertex(std::ptrdiff_t row, std::ptrdiff_t col, float z_mm,
                           LodPyramid::Slope slope) {
    tile_.vertices.push_back(
        {static_cast<std::int32_t>(col), static_cast<std::int32_t>(row),
         static_cast<std::int32_t>(std::llround(static_cast<double>(z_mm) / lattice_.step_mm)),
         slope});
    return static_cast<std::uint32_t>(tile_.vertices.size() - 1);
  }
  /// A node of the field with its own height: the same in every tile that has it.
  std::uint32_t add_full(std::ptrdiff_t row, std::ptrdiff_t col, LodPyramid::Slope slope) {
    return add_vertex(row, col, pyramid_.field().z_mm(row, col), slope);
  }
  void add_node(std::size_t r, std::size_t c) {
    const auto row = static_cast<std::ptrdiff_t>(r) + key_.y * lattice_.tile_quads;
    const auto col = static_cast<std::ptrdiff_t>(c) + key_.x * lattice_.tile_quads;
    const LodPyramid::Slope slope = pyramid_.slope(key_.level, row, col);
    if ((west_ && c == 0) || (south_ && r == 0) || (east_ && c + 1 == tile_.cols.size()) ||
        (north_ && r + 1 == tile_.rows.size())) {
      add_full(tile_.rows[r], tile_.cols[c], slope);
      return;
    }
    add_vertex(tile_.rows[r], tile_.cols[c], pyramid_.heights_mm(key_.level)(row, col), slope);
  }
  [[nodiscard]] std::uint32_t node(std::size_t r, std::size_t c) const {
    return static_cast<std::uint32_t>(r * tile_.cols.size() + c);
  }
  void add_triangle(std::uint32_t a, std::uint32_t b, std::uint32_t c) {
    tile_.triangles.push_back({a, b, c});
  }

  /// From vertex a to b along a row or column, with all of the field's nodes between. Slopes go
  /// evenly from one end to the other, reckoned from the south or west whichever end a is: so the
  /// neighbour of the same level has the same bits.
  Side full_side(std::uint32_t a, std::uint32_t b) {
    const LodVertex from = tile_.vertices[a], to = tile_.vertices[b];
    const std::ptrdiff_t count = std::max(std::abs(to.col - from.col), std::abs(to.row - from.row));
    Side side{a};
    const bool forward = to.row + to.col > from.row + from.col;
    const LodVertex &low = forward ? from : to, &high = forward ? to : from;
    for (std::ptrdiff_t i = 1; i < count; ++i) {
      const auto t = static_cast<float>(forward ? i : count - i) / static_cast<float>(count);
      side.push_back(add_full(from.row + (to.row - from.row) / count * i,
                              from.col + (to.col - from.col) / count * i,
                              {(1.0F - t) * low.slope[0] + t * high.slope[0],
                               (1.0F - t) * low.slope[1] + t * high.slope[1]}));
    }
    side.push_back(b);
    return side;
  }

  /// One shared side, its ends a and b; the corners opposite, c behind b and d behind a
  /// (counter-clockwise a, b, c, d). The near half is a fan of d, the far one of c.
  void add_fans(const Side& side, std::uint32_t c, std::uint32_t d) {
    const std::size_t half = side.size() / 2;
    for (std::size_t i = 0; i + 1 <= half; ++i) add_triangle(side[i], side[i + 1], d);
    add_triangle(side[half], c, d);
    for (std::size_t i = half; i + 1 < side.size(); ++i) add_triangle(side[i], side[i + 1], c);
  }

  void add_cell(std::size_t r, std::size_t c) {
    // Counter-clockwise from the south-western corner; side k goes from corner k to the next.
    const std::array<std::uint32_t, 4> corner{node(r, c), node(r, c + 1), node(r + 1, c + 1),
                                              node(r + 1, c)};
    const std::array<bool, 4> shared{south_ && r == 0, east_ && c + 2 == tile_.cols.size(),
                                     north_ && r + 2 == tile_.rows.size(), west_ && c == 0};
    const auto count = std::count(shared.begin(), shared.end(), true);
    if (count == 0) {
      add_triangle(corner[0], corner[1], corner[2]);
      add_triangle(corner[0], corner[2], corner[3]);
      return;
    }
    for (std::size_t k = 0; k < 4; ++k) {
      if (!shared[k]) continue;
      const std::size_t next = (k + 1) % 4, opposite = (k + 2) % 4, last = (k + 3) % 4;
      if (count == 1) {
        add_fans(full_side(corner[k], corner[next]), corner[opposite], corner[last]);
        return;
      }
      // Two sides that meet: all of both is seen from the corner opposite to where they do. Sides
      // that face each other do not come, since a tile that is one cell wide ends on the outline.
      if (!shared[next]) continue;
      for (const Side& side :
           {full_side(corner[k], corner[next]), full_side(corner[next], corner[opposite])})
        for (std::size_t i = 0; i + 1 < side.size(); ++i)
          add_triangle(side[i], side[i + 1], corner[last]);
      return;
    }
    MAQUETTE_CHECK(false, "cell {} {} of tile {} {} of level {} has {} shared sides", r, c, key_.x,
                   key_.y, key_.level, count);
  }

  const LodPyramid& pyramid_;
  const LodLattice& lattice_;
  LodTileKey key_;
  LodTileMesh tile_;
  bool west_ = false, south_ = false, east_ = false, north_ = false;
};

}  // namespace

std::ptrdiff_t lod_tiles(std::ptrdiff_t nodes, const LodLattice& lattice, int level) {
  return (lod_nodes(nodes, level) - 2) / lattice.tile_quads + 1;
}

int lod_levels(const heightmap::ModelField& field, std::ptrdiff_t tile_quads) {
  int levels = 1;
  while (
      std::max(lod_nodes(field.z_mm.rows(), levels - 1), lod_nodes(field.z_mm.cols(), levels - 1)) -
          1 >
      tile_quads)
    ++levels;
  return levels;
}

LodTileMesh make_lod_tile(const LodPyramid& pyramid, const LodLattice& lattice, LodTileKey key) {
  return Builder(pyramid, lattice, key).build();
}

}  // namespace maquette::exporting
