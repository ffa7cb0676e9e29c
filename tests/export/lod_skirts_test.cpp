// SPDX-License-Identifier: GPL-3.0-or-later

// export/lod_skirts.hpp:
//   what was there stays ...... vertices and triangles first, as they are
//   walls ..................... along shared sides only: with them each edge of such a side has two
//                               triangles, once each way; upright, looking outwards, `depth` high
//   depth ..................... not less than the errors of a level and the next coarser one
// export/lod_set.hpp with skirts:
//   off by default, errors are those without, boxes hold the feet, other options make tiles again

#include <map>
#include <set>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "export/cad.hpp"
#include "export/lod_set.hpp"
#include "export/lod_skirts.hpp"
#include "support/matchers.hpp"

namespace maquette::exporting {
namespace {

using heightmap::ModelField;
using nlohmann::json;
using testing_support::ScratchFolder;
using testing_support::Succeeds;

ModelField waves(std::ptrdiff_t rows, std::ptrdiff_t cols) {
  ModelField f{Grid<float>(rows, cols), Millimetres{0.5}, {}, {}};
  for (std::ptrdiff_t r = 0; r < rows; ++r)
    for (std::ptrdiff_t c = 0; c < cols; ++c)
      f.z_mm(r, c) = static_cast<float>(2.0 * std::sin(0.11 * static_cast<double>(c)) +
                                        0.7 * std::cos(0.31 * static_cast<double>(r + c)));
  return f;
}

LodSetOptions small_tiles(bool skirts) {
  LodSetOptions options;
  options.tile_quads = 16;
  options.skirts = skirts;
  return options;
}

std::multiset<std::array<std::uint32_t, 2>> edges(
    const std::vector<std::array<std::uint32_t, 3>>& triangles) {
  std::multiset<std::array<std::uint32_t, 2>> all;
  for (const auto& t : triangles)
    for (std::size_t k = 0; k < 3; ++k) all.insert({t[k], t[(k + 1) % 3]});
  return all;
}

TEST(LodSkirts, HangFromSharedSidesOnly) {
  constexpr std::int32_t kDepth = 7;
  for (const auto& [rows, cols] :
       {std::pair<std::ptrdiff_t, std::ptrdiff_t>{65, 65}, {50, 83}, {17, 40}, {17, 17}}) {
    const ModelField f = waves(rows, cols);
    const LodLattice lattice = lod_lattice(f, small_tiles(true)).value();
    const auto pyramid = LodPyramid::create(f, lod_levels(f, 16)).value();
    for (int level = 0; level < pyramid.levels(); ++level)
      for (std::ptrdiff_t y = 0; y < lod_tiles(rows, lattice, level); ++y)
        for (std::ptrdiff_t x = 0; x < lod_tiles(cols, lattice, level); ++x) {
          const LodTileMesh before = make_lod_tile(pyramid, lattice, {level, x, y});
          LodTileMesh tile = before;
          add_skirts(tile, f, kDepth);
          ASSERT_GE(tile.vertices.size(), before.vertices.size());
          for (std::size_t i = 0; i < before.vertices.size(); ++i) {
            EXPECT_EQ(tile.vertices[i].col, before.vertices[i].col);
            EXPECT_EQ(tile.vertices[i].row, before.vertices[i].row);
            EXPECT_EQ(tile.vertices[i].height, before.vertices[i].height);
          }
          EXPECT_TRUE(
              std::equal(before.triangles.begin(), before.triangles.end(), tile.triangles.begin()));
          const auto west = tile.cols.front(), east = tile.cols.back(), south = tile.rows.front(),
                     north = tile.rows.back();
          const auto shared = [&](const LodVertex& a, const LodVertex& b) {
            return (a.col == b.col &&
                    ((a.col == west && west > 0) || (a.col == east && east < cols - 1))) ||
                   (a.row == b.row &&
                    ((a.row == south && south > 0) || (a.row == north && north < rows - 1)));
          };
          const auto all = edges(tile.triangles), own = edges(before.triangles);
          std::size_t rim = 0;
          for (const auto& [a, b] : own) {
            if (all.count({a, b}) != 1) ADD_FAILURE() << "an edge twice";
            const bool open = own.count({b, a}) == 0;
            if (!open) continue;
            const bool wall = all.count({b, a}) == 1;
            EXPECT_EQ(wall, shared(tile.vertices[a], tile.vertices[b]));
            rim += wall ? 1 : 0;
          }
          EXPECT_EQ(tile.triangles.size() - before.triangles.size(), 2 * rim);
          const double middle_x = 0.5 * static_cast<double>(west + east),
                       middle_y = 0.5 * static_cast<double>(south + north);
          for (std::size_t i = before.triangles.size(); i < tile.triangles.size(); ++i) {
            const auto at = [&](std::size_t k) {
              const LodVertex& v = tile.vertices[tile.triangles[i][k]];
              return Vec3{static_cast<double>(v.col), static_cast<double>(v.row),
                          static_cast<double>(v.height)};
            };
            const Vec3 n = cross(at(1) - at(0), at(2) - at(0));
            EXPECT_EQ(n.z, 0.0);
            EXPECT_GT(n.x * (at(0).x - middle_x) + n.y * (at(0).y - middle_y), 0.0);
          }
          std::map<std::pair<std::int32_t, std::int32_t>, std::int32_t> top;
          for (const LodVertex& v : before.vertices) top[{v.col, v.row}] = v.height;
          for (std::size_t i = before.vertices.size(); i < tile.vertices.size(); ++i) {
            const LodVertex& foot = tile.vertices[i];
            EXPECT_EQ(foot.height, top.at({foot.col, foot.row}) - kDepth);
          }
        }
  }
}

TEST(LodSkirts, AreAsDeepAsTheErrorsThatMeet) {
  const LodLattice lattice{.step_mm = 0.25, .steps_per_quad = 2, .tile_quads = 16};
  // 0.3 + 1.1 mm are 5.6 steps: six, and one.
  EXPECT_EQ(skirt_depth({.vertical_mm = 0.3}, {.vertical_mm = 1.1}, lattice), 7);
  EXPECT_EQ(skirt_depth({}, {}, lattice), 1);
}

TEST(LodSkirts, OfASetAreAnOption) {
  const ModelField f = waves(70, 90);
  const ScratchFolder scratch;
  EXPECT_FALSE(LodSetOptions{}.skirts);
  const auto bare = write_lod_set(f, {}, small_tiles(false), scratch.path());
  ASSERT_THAT(bare, Succeeds());
  const auto skirted = write_lod_set(f, {}, small_tiles(true), scratch.path());
  ASSERT_THAT(skirted, Succeeds());
  ASSERT_EQ(skirted->tiles.size(), bare->tiles.size());
  ASSERT_GE(skirted->levels.size(), 3U);
  for (std::size_t level = 0; level < skirted->levels.size(); ++level) {
    const auto error = [&](std::size_t l) {
      return bare->levels[std::min(l, bare->levels.size() - 1)].error.vertical_mm;
    };
    EXPECT_EQ(bare->levels[level].skirt_mm, 0.0);
    EXPECT_EQ(skirted->levels[level].error.vertical_mm, error(level));
    EXPECT_GT(skirted->levels[level].skirt_mm, error(level) + error(level + 1));
    EXPECT_LE(skirted->levels[level].skirt_mm,
              error(level) + error(level + 1) + 2.001 * bare->lattice.step_mm);
  }
  for (std::size_t i = 0; i < bare->tiles.size(); ++i) {
    const LodTileReport &without = bare->tiles[i], &with = skirted->tiles[i];
    EXPECT_FALSE(with.kept);
    EXPECT_EQ(with.highest, without.highest);
    EXPECT_GE(with.lowest, without.lowest - with.skirt);
    const bool alone = without.key.level + 1 == static_cast<int>(bare->levels.size());
    EXPECT_EQ(with.triangles == without.triangles, alone);
    EXPECT_LE(with.lowest, without.lowest);
  }
  const json lod = json::parse(read_file(scratch.path() / "lod.json").value());
  EXPECT_EQ(lod["levels"][1]["skirt_mm"].get<double>(), skirted->levels[1].skirt_mm);
}

}  // namespace
}  // namespace maquette::exporting
