// SPDX-License-Identifier: GPL-3.0-or-later
// What meshing/tiles.hpp and the windows of meshing/grid_stream.hpp claim, and how it is attacked:
//
//   tiles cover the surface once ............. every cell counted
//   joints keep off stones ................... distance to every vertex of every stone
//   fewest, then most even ................... all cuts of short lines tried
//   joined again they are the whole .......... walls cancel triangle by triangle, to the bit; what
//                                              is left is the whole's top, walls; no vertex inside
//                                              an edge; volumes add up to 1e-9; spacing 0.3 mm
//   each is a closed solid ................... CGAL
//   errors ................................... stones in a row; too narrow; clearance

#include "meshing/tiles.hpp"

#include <array>
#include <map>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "meshing/mesh_checks.hpp"
#include "support/matchers.hpp"
#include "support/mesh_properties.hpp"
#include "support/shapes.hpp"

namespace maquette::meshing {
namespace {

using heightmap::ModelField;
using testing_support::collected;
using testing_support::FailsWith;
using testing_support::random_terrain;
using testing_support::Succeeds;

PlacedStone stone_at(int number, double x, double y, double diameter_mm) {
  PlacedStone stone;
  stone.number = number;
  stone.shape.seed = static_cast<std::uint64_t>(number);
  stone.shape.subdivisions = 2;
  stone.scale_mm = diameter_mm;
  stone.model_from_stone.translation_mm = {x, y, 0.0};
  return stone;
}

class TilesWithStones : public testing::TestWithParam<std::uint64_t> {
 protected:
  TilesWithStones() {
    for (int i = 0; i < 12; ++i) {
      const auto draw = [&](std::uint64_t k) {
        return random_uniform(GetParam(), 100 + 3 * static_cast<std::uint64_t>(i) + k);
      };
      stones.push_back(
          stone_at(i + 1, 2.0 + 56.0 * draw(0), 2.0 + 41.0 * draw(1), 1.0 + 2.0 * draw(2)));
    }
  }
  // Rounding of 0.3 n differs with where one starts to count.
  const ModelField field = random_terrain(GetParam(), 151, 201, 0.3, 0.3, 0.05);
  std::vector<PlacedStone> stones;
  const TileOptions options{.max_width = Millimetres{22.0},
                            .max_length = Millimetres{18.0},
                            .clearance = Millimetres{0.5}};
};

TEST_P(TilesWithStones, CoverTheSurfaceOnceAndKeepOffStones) {
  const auto tiles = split_into_tiles(field, stones, options);
  ASSERT_THAT(tiles, Succeeds());
  EXPECT_GE(tiles->size(), 9U);
  Grid<int> covered(150, 200, 0);
  std::vector<Box3> boxes;
  for (const PlacedStone& stone : stones) boxes.push_back(stone_mesh(stone).bounds());
  for (const Tile& t : *tiles) {
    EXPECT_LE(t.nodes.cols() - 1, 73);  // 22 mm of 0.3 mm
    EXPECT_LE(t.nodes.rows() - 1, 60);
    for (std::ptrdiff_t r = t.nodes.row0; r < t.nodes.row1; ++r)
      for (std::ptrdiff_t c = t.nodes.col0; c < t.nodes.col1; ++c) ++covered(r, c);
    // A joint is a side of the tile that is not the outline; a stone is left of it or right.
    for (const PlacedStone& stone : stones) {
      const Box3& box = boxes[static_cast<std::size_t>(stone.number - 1)];
      const double west = field.x_mm(t.nodes.col0), east = field.x_mm(t.nodes.col1);
      const double south = field.y_mm(t.nodes.row0), north = field.y_mm(t.nodes.row1);
      const auto beside = [](double line, double from, double to) {
        return line <= from - 0.5 + 1e-9 || line >= to + 0.5 - 1e-9;
      };
      const bool in_strip = box.max.y >= south && box.min.y <= north;
      const bool in_place = box.max.x >= west && box.min.x <= east;
      EXPECT_TRUE(t.nodes.col0 == 0 || !in_strip || beside(west, box.min.x, box.max.x));
      EXPECT_TRUE(t.nodes.row0 == 0 || !in_place || beside(south, box.min.y, box.max.y));
    }
  }
  for (const int n : covered.cells()) ASSERT_EQ(n, 1);
}

using Corner = std::array<double, 3>;
using Face = std::array<Corner, 3>;

/// From its lowest corner on, so that equal faces are equal.
Face face(const MeshStream::Corners& at, bool reversed) {
  Face f;
  for (std::size_t i = 0; i < 3; ++i) {
    const Vec3 v = at[reversed ? 2 - i : i];
    f[i] = {v.x, v.y, v.z};
  }
  std::rotate(f.begin(), std::min_element(f.begin(), f.end()), f.end());
  return f;
}

TEST_P(TilesWithStones, JoinedAgainAreTheWhole) {
  const SolidOptions base{.base_z = Millimetres{-20.1}};
  const auto tiles = split_into_tiles(field, stones, options);
  ASSERT_THAT(tiles, Succeeds());
  std::map<Face, int> faces;
  double volume = 0.0;
  const auto is_base = [](const MeshStream::Corners& c) {
    return c[0].z == -20.1 && c[1].z == -20.1 && c[2].z == -20.1;
  };
  const auto add = [&](const GridSolidStream& solid, int sign) {
    std::vector<MeshStream::Corners> corners(solid.triangle_count());
    solid.corners(0, corners);
    for (const auto& c : corners) {
      if (is_base(c)) continue;
      if (const auto back = faces.find(face(c, true)); back != faces.end() && sign > 0) {
        if (--back->second == 0) faces.erase(back);  // two sides of one wall
        continue;
      }
      int& n = faces[face(c, false)];
      n += sign;
      if (n == 0) faces.erase(face(c, false));
    }
  };
  for (const Tile& t : *tiles) {
    const auto solid = GridSolidStream::create(field, t.nodes, base);
    ASSERT_THAT(solid, Succeeds());
    const auto proven = solid->certify(CoordinateRounding::none);
    ASSERT_THAT(proven, Succeeds());
    volume += proven->volume_mm3;
    if (t.number % 4 == 1) {
      const auto found = check_mesh(collected(*solid));
      ASSERT_THAT(found, Succeeds());
      EXPECT_TRUE(found->passed() && found->self_intersection_checked) << to_json(*found);
      EXPECT_NEAR(found->volume_mm3, proven->volume_mm3, 1e-12 * found->volume_mm3);
      EXPECT_NEAR(found->area_mm2, proven->area_mm2, 1e-12 * found->area_mm2);
    }
    add(*solid, 1);
  }
  const auto whole = GridSolidStream::create(field, base);
  ASSERT_THAT(whole, Succeeds());
  const double whole_volume = whole->certify(CoordinateRounding::none)->volume_mm3;
  EXPECT_NEAR(volume, whole_volume, 1e-12 * whole_volume);
  add(*whole, -1);
  EXPECT_TRUE(faces.empty()) << faces.size() << " faces are of the tiles or the whole only";
}

INSTANTIATE_TEST_SUITE_P(Seeds, TilesWithStones, testing::Range<std::uint64_t>(1, 6));

TEST(SplitIntoTiles, TakesTheFewestAndOfThoseTheMostEven) {
  for (std::uint64_t seed = 1; seed <= 40; ++seed) {
    constexpr int kCells = 12;
    ModelField field{Grid<float>(3, kCells + 1), Millimetres{1.0}, Millimetres{0}, Millimetres{0}};
    std::vector<PlacedStone> stones;
    const int count = static_cast<int>(random_bits(seed, 0) % 4);
    for (int i = 0; i < count; ++i)
      stones.push_back(stone_at(
          i + 1, 1.0 + 10.0 * random_uniform(seed, 1 + static_cast<std::uint64_t>(i)), 1.0, 0.9));
    const int most = 2 + static_cast<int>(random_bits(seed, 9) % 5);
    std::vector<Box3> boxes;
    for (const PlacedStone& s : stones) boxes.push_back(stone_mesh(s).bounds());
    // All subsets of the eleven inner lines.
    int fewest = 99;
    double least = INFINITY;
    for (unsigned chosen = 0; chosen < (1U << (kCells - 1)); ++chosen) {
      int last = 0, parts = 0;
      double squares = 0.0;
      bool fits = true;
      for (int i = 1; i <= kCells; ++i) {
        if (i < kCells && !((chosen >> (i - 1)) & 1U)) continue;
        for (const Box3& box : boxes)
          fits = fits && (i == kCells || i < box.min.x || i > box.max.x);
        fits = fits && i - last <= most;
        squares += (i - last) * (i - last);
        last = i;
        ++parts;
      }
      if (!fits || parts > fewest || (parts == fewest && squares >= least)) continue;
      fewest = parts;
      least = squares;
    }
    const auto tiles = split_into_tiles(
        field, stones, {.max_width = Millimetres{1.0 * most}, .clearance = Millimetres{0}});
    ASSERT_EQ(tiles.has_value(), fewest < 99) << seed;
    if (!tiles) continue;
    double squares = 0.0;
    for (const Tile& t : *tiles)
      squares += static_cast<double>((t.nodes.cols() - 1) * (t.nodes.cols() - 1));
    EXPECT_EQ(static_cast<int>(tiles->size()), fewest) << seed;
    EXPECT_EQ(squares, least) << seed;
  }
}

TEST(SplitIntoTiles, SaysWhichStonesLeaveNoPlaceAndWhatWouldDo) {
  const ModelField field{Grid<float>(41, 101), Millimetres{0.5}, Millimetres{0}, Millimetres{0}};
  std::vector<PlacedStone> stones;
  for (int i = 0; i < 5; ++i) stones.push_back(stone_at(i + 1, 15.0 + 2.0 * i, 10.0, 3.0));
  const auto none = split_into_tiles(field, stones, {.max_width = Millimetres{8.0}});
  ASSERT_THAT(none, FailsWith(kJointMeetsStones));
  EXPECT_THAT(none.error().message, testing::HasSubstr("number 1, 2, 3"));
  double width = 0.0;
  const std::string& message = none.error().message;
  ASSERT_EQ(std::sscanf(message.c_str() + message.find("tiles of"), "tiles of %lf", &width), 1);
  EXPECT_THAT(split_into_tiles(field, stones, {.max_width = Millimetres{width}}), Succeeds());
  EXPECT_THAT(split_into_tiles(field, stones, {.max_width = Millimetres{width - 0.5}}),
              FailsWith(kJointMeetsStones));
  EXPECT_THAT(split_into_tiles(field, stones, {.max_width = Millimetres{0.9}}),
              FailsWith(kBandsDegenerate));
  EXPECT_THAT(split_into_tiles(field, stones, {.clearance = Millimetres{-1.0}}),
              FailsWith(kBandsDegenerate));
  EXPECT_THAT(split_into_tiles({Grid<float>(1, 5), Millimetres{1}}, stones, {}),
              FailsWith(kBandsDegenerate));
}

}  // namespace
}  // namespace maquette::meshing
