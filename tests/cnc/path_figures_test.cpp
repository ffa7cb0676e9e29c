// SPDX-License-Identifier: GPL-3.0-or-later

// What is claimed in cnc/path_figures.hpp, and how it is attacked: travel is that of the tip on
// rapids, lines and arcs' bulges, each axis by itself; closed forms of a triangle and a half
// circle.

#include "cnc/path_figures.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "support/matchers.hpp"

namespace maquette::cnc {
namespace {

using testing::HasSubstr;
using testing_support::FailsWith;
using testing_support::Succeeds;

constexpr std::int64_t mm(std::int64_t v) {
  return 10000 * v;
}

/// From (0, 0, 9) down to z = 5 and a half circle in G18 below it to x = 8: z to 1.
PathFigures half_circle() {
  Toolpath path;
  path.start = {0, 0, mm(9)};
  PathMove move;
  move.kind = PathMove::Kind::rapid;
  move.to = {0, mm(3), mm(5)};
  path.moves.push_back(move);
  move.kind = PathMove::Kind::arc;
  move.plane = ArcPlane::zx;
  move.to = {mm(8), mm(3), mm(5)};
  move.i = mm(4);
  move.counter_clockwise = false;
  move.feed_mm_min = 100.0;
  path.moves.push_back(move);
  PathFigures figures;
  figures.add(path);
  return figures;
}

TEST(Travel, IsThatOfRapidsAndOfArcsBulges) {
  const PathFigures figures = half_circle();
  ASSERT_EQ(figures.low.z, mm(1));  // clockwise towards +x in G18 goes below
  ASSERT_EQ(figures.high.z, mm(9));
  const Box3 box = figures.extent_mm();
  EXPECT_NEAR(box.max.x - box.min.x, 8.0, 1e-9);
  EXPECT_NEAR(box.max.y - box.min.y, 3.0, 1e-9);
  EXPECT_NEAR(box.max.z - box.min.z, 8.0, 1e-9);
  EXPECT_TRUE(PathFigures{}.extent_mm().empty());
}

}  // namespace
}  // namespace maquette::cnc
