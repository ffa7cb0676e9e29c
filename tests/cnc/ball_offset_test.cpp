// SPDX-License-Identifier: GPL-3.0-or-later

// cnc/ball_offset.hpp:
//   a plane moves along its normal ......... by hand, both ways, outline included
//   a sphere's radius grows and shrinks .... closed form, to the facets' sag
//   an edge becomes round, a crease sharp .. a roof's ridge outwards and its valley inwards, by
//   hand inwards, every point is far enough ..... random terrain: from each node to every facet
//   near,
//                                            and as far as that, not farther, where it is not round
//   outwards is inwards of what is below ... the same upside down, to the bit
//   CNC_OFFSET_DISTANCE, CNC_HEIGHT_NOT_FINITE ... no number, too far; a void

#include "cnc/ball_offset.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "cnc/mill.hpp"
#include "core/triangle_distance.hpp"
#include "support/matchers.hpp"
#include "support/shapes.hpp"
#include "support/terrain.hpp"

namespace maquette::cnc {
namespace {

using heightmap::ModelField;
using testing_support::FailsWith;
using testing_support::field_of;

TEST(BallOffset, MovesAPlaneAlongItsNormal) {
  const ModelField f =
      field_of(41, 51, 0.5, [](double x, double y) { return 3.0 + 0.75 * x - 0.5 * y; });
  const double steep = std::sqrt(1.0 + 0.5625 + 0.25);
  for (const double t : {2.0, -2.0, 0.3, -7.1, 0.0}) {
    const ModelField moved = offset_surface(f, Millimetres{t}).value();
    for (std::ptrdiff_t r = 0; r < 41; ++r)
      for (std::ptrdiff_t c = 0; c < 51; ++c)
        ASSERT_NEAR(moved.z_mm(r, c) - f.z_mm(r, c), t * steep, 1e-5) << t;
  }
}

TEST(BallOffset, ASphereGrowsAndShrinks) {
  const double R = 12.0;
  const auto sphere = [](double radius) {
    return [radius](double x, double y) {
      return std::sqrt(radius * radius - (x - 1.0) * (x - 1.0) - (y - 7.0) * (y - 7.0));
    };
  };
  const ModelField f = field_of(41, 41, 0.25, sphere(R));
  const double sag = 0.25 * 0.25 / (2.0 * R);  // of a cell's diagonal, and slopes up to 45 degrees
  for (const double t : {1.5, -1.5}) {
    const ModelField moved = offset_surface(f, Millimetres{t}).value();
    const ModelField known = field_of(41, 41, 0.25, sphere(R + t));
    for (std::ptrdiff_t r = 8; r < 33; ++r)
      for (std::ptrdiff_t c = 8; c < 33; ++c)
        ASSERT_NEAR(moved.z_mm(r, c), known.z_mm(r, c), 2.0 * sag);
  }
}

TEST(BallOffset, RidgesAndValleys) {
  // A valley of slope 1 along y at x = 1. Outwards it stays sharp; inwards its bottom is round.
  const ModelField f = field_of(21, 41, 0.25, [](double x, double) { return std::abs(x - 1.0); });
  const ModelField out = offset_surface(f, Millimetres{2.0}).value();
  const ModelField in = offset_surface(f, Millimetres{-2.0}).value();
  for (std::ptrdiff_t c = 0; c < 41; ++c) {
    const double x = std::abs(f.x_mm(c) - 1.0);
    EXPECT_NEAR(out.z_mm(10, c), x + 2.0 * std::sqrt(2.0), 1e-6);
    EXPECT_NEAR(in.z_mm(10, c),
                x < std::sqrt(2.0) ? -std::sqrt(4.0 - x * x) : x - 2.0 * std::sqrt(2.0), 1e-6);
  }
}

TEST(BallOffset, IsAsFarAsItSays) {
  const double t = 1.7;
  const ModelField f = testing_support::random_terrain(3, 61, 71, 0.5, 0.6, 0.03);
  const ModelField in = offset_surface(f, Millimetres{-t}).value();
  for (std::ptrdiff_t r = 6; r < 55; ++r)
    for (std::ptrdiff_t c = 6; c < 65; ++c) {
      const Vec3 p{f.x_mm(c), f.y_mm(r), static_cast<double>(in.z_mm(r, c))};
      double nearest = INFINITY;
      for (std::ptrdiff_t i = r - 5; i < r + 5; ++i)
        for (std::ptrdiff_t j = c - 5; j < c + 5; ++j) {
          const auto node = [&](std::ptrdiff_t a, std::ptrdiff_t b) {
            return Vec3{f.x_mm(b), f.y_mm(a), static_cast<double>(f.z_mm(a, b))};
          };
          const Vec3 far = node(i + 1, j + 1);
          nearest = std::fmin(nearest, triangle_distance2(p, node(i, j), node(i, j + 1), far));
          nearest = std::fmin(nearest, triangle_distance2(p, node(i, j), far, node(i + 1, j)));
        }
      ASSERT_NEAR(std::sqrt(nearest), t, 1e-5);
    }
  ModelField below = f;
  for (float& z : below.z_mm.cells()) z = -z;
  const ModelField out = offset_surface(below, Millimetres{t}).value();
  for (std::size_t i = 0; i < out.z_mm.cells().size(); ++i)
    ASSERT_EQ(out.z_mm.cells()[i], -in.z_mm.cells()[i]);
}

TEST(BallOffset, RefusesBadInput) {
  ModelField f = field_of(5, 5, 0.5, [](double, double) { return 1.0; });
  for (const double t : {50.1, -50.1, double{NAN}, double{INFINITY}})
    EXPECT_THAT(offset_surface(f, Millimetres{t}), FailsWith(kOffsetDistance));
  f.z_mm(2, 3) = NAN;
  EXPECT_THAT(offset_surface(f, Millimetres{1.0}), FailsWith(kHeightNotFinite));
}

}  // namespace
}  // namespace maquette::cnc
