// SPDX-License-Identifier: GPL-3.0-or-later

// What meshing/band_joints.hpp claims, and how it is attacked:
//
//   even bands stay where they meet nothing ... compared with split_into_bands
//   joints keep off stones .................... distance to every vertex of every stone, both axes
//   fewest met, fewest bands, most even ....... all cuts of short lines tried, by width and number
//   what cannot keep off is named ............. stones in a row: joint, place, number
//   known joints are the same bands ........... through split_of, and refused of another surface
//   errors .................................... clearance, width

#include "meshing/band_joints.hpp"

#include <array>
#include <cmath>
#include <functional>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/random.hpp"
#include "support/matchers.hpp"
#include "support/shapes.hpp"

namespace maquette::meshing {
namespace {

using heightmap::ModelField;
using testing::ElementsAre;
using testing::IsEmpty;
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

std::vector<PlacedStone> draw_stones(std::uint64_t seed, int count, double x_mm, double y_mm) {
  std::vector<PlacedStone> stones;
  for (int i = 0; i < count; ++i) {
    const auto draw = [&](std::uint64_t k) {
      return random_uniform(seed, 100 + 3 * static_cast<std::uint64_t>(i) + k);
    };
    stones.push_back(stone_at(i + 1, x_mm * draw(0), y_mm * draw(1), 1.0 + 2.0 * draw(2)));
  }
  return stones;
}

double along(const ModelField& f, BandAxis axis, std::ptrdiff_t line) {
  return axis == BandAxis::x ? f.x_mm(line) : f.y_mm(line);
}

/// What a stone's own vertices take of the axis.
std::array<double, 2> taken(const PlacedStone& stone, BandAxis axis) {
  std::array<double, 2> range{INFINITY, -INFINITY};
  for (const Vec3& v : stone_mesh(stone).vertices_mm) {
    const double at = axis == BandAxis::x ? v.x : v.y;
    range = {std::fmin(range[0], at), std::fmax(range[1], at)};
  }
  return range;
}

std::size_t stones_met(const ModelField& f, BandAxis axis, std::ptrdiff_t line,
                       const std::vector<PlacedStone>& stones, double clearance_mm) {
  std::size_t met = 0;
  for (const auto& s : stones) {
    const auto [from, to] = taken(s, axis);
    const double at = along(f, axis, line);
    met += at >= from - clearance_mm && at <= to + clearance_mm ? 1 : 0;
  }
  return met;
}

class BandsBesideStones : public testing::TestWithParam<std::tuple<BandAxis, std::uint64_t>> {
 protected:
  const BandAxis axis = std::get<0>(GetParam());
  const std::uint64_t seed = std::get<1>(GetParam());
  const ModelField field = random_terrain(seed, 201, 201, 0.3, 0.1);
};
INSTANTIATE_TEST_SUITE_P(Both, BandsBesideStones,
                         testing::Combine(testing::Values(BandAxis::x, BandAxis::y),
                                          testing::Range<std::uint64_t>(1, 9)));

TEST_P(BandsBesideStones, KeepOffThem) {
  const auto stones = draw_stones(seed, 9, 60.0, 60.0);
  for (const BandSplit& split : {BandSplit{.axis = axis, .max_width = Millimetres{16.0}},
                                 BandSplit{.axis = axis, .count = 4}}) {
    const auto layout = split_beside_stones(field, split, stones, Millimetres{0.5});
    ASSERT_THAT(layout, Succeeds());
    EXPECT_EQ(layout->even_bands, 4U);
    std::ptrdiff_t at = 0;
    std::vector<int> kept;
    for (const auto& k : layout->kept) kept.push_back(k.joint);
    for (const Band& b : layout->bands) {
      EXPECT_EQ(b.axis, axis);
      EXPECT_EQ(b.first, at);
      EXPECT_GE(b.last - b.first, 2);
      if (split.count == 0) {
        EXPECT_LE(static_cast<double>(b.last - b.first) * 0.3, 16.0 + 1e-9);
      }
      at = b.last;
      if (b.number == 1) continue;
      // Named exactly where its own vertices say so.
      const bool named = std::find(kept.begin(), kept.end(), b.number - 1) != kept.end();
      EXPECT_EQ(stones_met(field, axis, b.first, stones, 0.5) > 0, named) << b.number;
    }
    EXPECT_EQ(at, 200);
    if (split.count > 0) {
      EXPECT_EQ(layout->bands.size(), 4U);
    }
  }
}

TEST_P(BandsBesideStones, AreTheBestOfAllCuts) {
  const ModelField small = random_terrain(seed, 25, 25, 1.0, 0.1);
  const auto stones = draw_stones(seed, 6, 24.0, 24.0);
  constexpr double kClear = 0.2;
  struct Cut {
    std::size_t through, near, bands;
    double squares;
    auto operator<=>(const Cut&) const = default;
  };
  std::array<std::size_t, 25> through{}, near{};
  for (std::ptrdiff_t line = 0; line < 25; ++line) {
    through[static_cast<std::size_t>(line)] = stones_met(small, axis, line, stones, 0.0);
    near[static_cast<std::size_t>(line)] = stones_met(small, axis, line, stones, kClear);
  }
  const auto measured = [&](const std::vector<std::ptrdiff_t>& joints) {
    Cut cut{0, 0, joints.size() + 1, 0.0};
    std::ptrdiff_t before = 0;
    for (std::size_t i = 0; i <= joints.size(); ++i) {
      const std::ptrdiff_t line = i < joints.size() ? joints[i] : 24;
      cut.squares += static_cast<double>((line - before) * (line - before));
      before = line;
      if (i == joints.size()) break;
      cut.through += through[static_cast<std::size_t>(line)];
      // Through one, it is too near to it as well.
      cut.near += near[static_cast<std::size_t>(line)];
    }
    return cut;
  };
  // All cuts into bands of 2 to 7 cells.
  Cut best{SIZE_MAX, 0, 0, 0.0};
  std::vector<std::ptrdiff_t> joints;
  const std::function<void(std::ptrdiff_t)> search = [&](std::ptrdiff_t from) {
    if (24 - from <= 7) best = std::min(best, measured(joints));
    for (std::ptrdiff_t next = from + 2; next <= from + 7 && next <= 22; ++next) {
      joints.push_back(next);
      search(next);
      joints.pop_back();
    }
  };
  search(0);
  const auto layout = split_beside_stones(small, {.axis = axis, .max_width = Millimetres{7.0}},
                                          stones, Millimetres{kClear});
  ASSERT_THAT(layout, Succeeds());
  const Cut made = measured(*split_of(*layout).joints);
  EXPECT_EQ(made.through, best.through);
  EXPECT_EQ(made.near, best.near);
  EXPECT_EQ(made.bands, best.bands);
  EXPECT_DOUBLE_EQ(made.squares, best.squares);

  // Three bands of eight cells: each joint within three cells of its even place.
  best = {SIZE_MAX, 0, 0, 0.0};
  for (std::ptrdiff_t a = 5; a <= 11; ++a)
    for (std::ptrdiff_t b = 13; b <= 19; ++b) best = std::min(best, measured({a, b}));
  const auto three =
      split_beside_stones(small, {.axis = axis, .count = 3}, stones, Millimetres{kClear});
  ASSERT_THAT(three, Succeeds());
  const Cut of_three = measured(*split_of(*three).joints);
  EXPECT_EQ(of_three.through, best.through);
  EXPECT_EQ(of_three.near, best.near);
  EXPECT_EQ(of_three.bands, 3U);
  EXPECT_DOUBLE_EQ(of_three.squares, best.squares);
}

TEST(BandJoints, StayEvenWhereTheyMeetNothing) {
  const ModelField field = random_terrain(1, 101, 41, 1.0, 0.1);
  const BandSplit split{.max_width = Millimetres{40.0}};
  const auto even = split_into_bands(field, split);
  const std::vector<PlacedStone> beside{stone_at(1, 20.0, 20.0, 3.0), stone_at(2, 20.0, 50.0, 3.0)};
  for (const auto& stones : {std::vector<PlacedStone>{}, beside}) {
    const auto layout = split_beside_stones(field, split, stones, Millimetres{1.0});
    ASSERT_THAT(layout, Succeeds());
    ASSERT_EQ(layout->bands.size(), even->size());
    for (std::size_t b = 0; b < even->size(); ++b)
      EXPECT_EQ(layout->bands[b].last, (*even)[b].last);
    EXPECT_THAT(layout->kept, IsEmpty());
  }
}

TEST(BandJoints, TakeOneBandMoreWhereTheWidthLeavesNoOther) {
  const ModelField field = random_terrain(1, 101, 41, 1.0, 0.1);
  const std::vector<PlacedStone> stones{stone_at(7, 20.0, 50.0, 3.0)};
  const auto layout =
      split_beside_stones(field, {.max_width = Millimetres{50.0}}, stones, Millimetres{1.0});
  ASSERT_THAT(layout, Succeeds());
  EXPECT_EQ(layout->even_bands, 2U);
  EXPECT_EQ(layout->bands.size(), 3U);
  EXPECT_THAT(layout->kept, IsEmpty());
}

TEST(BandJoints, NameWhatTheyCannotKeepOff) {
  const ModelField field = random_terrain(1, 101, 41, 1.0, 0.1);
  // A stone as wide as the surface but for its borders, beside a second one near the north.
  std::vector<PlacedStone> stones{stone_at(7, 20.0, 50.0, 98.0), stone_at(9, 20.0, 85.0, 20.0)};
  const auto layout =
      split_beside_stones(field, {.max_width = Millimetres{60.0}}, stones, Millimetres{1.0});
  ASSERT_THAT(layout, Succeeds());
  ASSERT_EQ(layout->kept.size(), 1U);
  EXPECT_EQ(layout->kept[0].joint, 1);
  EXPECT_EQ(layout->kept[0].at_mm, 50.0);
  EXPECT_THAT(layout->kept[0].through, ElementsAre(7));
  EXPECT_THAT(layout->kept[0].near, IsEmpty());
}

TEST(BandJoints, AreTheSameWhenTheyAreKnown) {
  const ModelField field = random_terrain(1, 101, 41, 1.0, 0.1);
  const std::vector<PlacedStone> stones{stone_at(7, 20.0, 50.0, 3.0)};
  const auto layout = split_beside_stones(field, {.count = 2}, stones, Millimetres{1.0});
  ASSERT_THAT(layout, Succeeds());
  const auto again = split_into_bands(field, split_of(*layout));
  ASSERT_THAT(again, Succeeds());
  ASSERT_EQ(again->size(), 2U);
  EXPECT_EQ((*again)[0].last, layout->bands[0].last);
  EXPECT_NE((*again)[0].last, 50);
  EXPECT_EQ((*again)[1].last, 100);
  BandSplit wrong{};
  wrong.joints = {{40, 40}};
  EXPECT_THAT(split_into_bands(field, wrong), FailsWith(kBandsDegenerate));
  wrong.joints = {{100}};
  EXPECT_THAT(split_into_bands(field, wrong), FailsWith(kBandsDegenerate));
}

TEST(BandJoints, RefuseWhatCannotBe) {
  const ModelField field = random_terrain(1, 101, 41, 1.0, 0.1);
  EXPECT_THAT(split_beside_stones(field, {.count = 2}, {}, Millimetres{-1.0}),
              FailsWith(kBandsDegenerate));
  EXPECT_THAT(split_beside_stones(field, {.max_width = Millimetres{1.0}}, {}, Millimetres{1.0}),
              FailsWith(kBandsDegenerate));
}

}  // namespace
}  // namespace maquette::meshing
