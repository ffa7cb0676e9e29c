// SPDX-License-Identifier: GPL-3.0-or-later

// meshing/dowels.hpp:
//   a bored tile is a solid ............... CGAL: closed, manifold, outward, does not cut itself
//   volumes add up ........................ whole = tiles + all half holes, to 1e-9
//   neighbours have the same wall ......... triangles in the joint's plane, to the bit, turned
//   round holes are where they are said to be ... ring of 32 corners on both sides, a pin of the
//   dowel's
//                                           size touches no vertex or facet
//   a pin ................................. CGAL; volume of prism and two frusta; goes into a hole
//   wall around them ...................... distance of every hole from every other surface
//   a ring's triangles .................... area = outer - hole; no corner twice; random outlines
//   MESHING_DOWEL_DOES_NOT_FIT ............ thin base, small tile, senseless lengths

#include "meshing/dowels.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <set>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/random.hpp"
#include "meshing/mesh_checks.hpp"
#include "meshing/shaped_solid.hpp"
#include "support/matchers.hpp"
#include "support/mesh_properties.hpp"
#include "support/shapes.hpp"

namespace maquette::meshing {
namespace {

using heightmap::ModelField;
using testing::HasSubstr;
using testing_support::collected;
using testing_support::FailsWith;
using testing_support::in_plane;
using testing_support::random_terrain;

constexpr Millimetres kThickness{10.0};

/// 150 x 120 mm in staggered tiles, at an odd place.
struct Part {
  ModelField field = random_terrain(3, 241, 301, 0.5, 0.25, 0.05);
  std::vector<Tile> tiles;
  Millimetres base_z{0.0};
  DowelOptions options{.diameter_mm = 4.0, .depth_mm = 8.0, .spacing_mm = 25.0};
  std::vector<Dowel> dowels;
  Part() {
    field.x0 = Millimetres{17.25};
    field.y0 = Millimetres{-3.1};
    tiles = {{1, 1, 1, {0, 110, 0, 140}},
             {2, 1, 2, {0, 110, 140, 300}},
             {3, 2, 1, {110, 240, 0, 210}},
             {4, 2, 2, {110, 240, 210, 300}}};
    base_z = Millimetres{static_cast<double>(heightmap::height_range(field.z_mm).min)} - kThickness;
    dowels = place_dowels(field, tiles, base_z, kThickness, options).value();
  }
  [[nodiscard]] TriMesh solid(const Tile& t) const {
    const NodeWindow& w = t.nodes;
    const Shaping shaping{.underside = plain_underside(window_field(field, w), base_z),
                          .walls = bored_walls(field, t, base_z, dowels, options)};
    return collected(ShapedSolid::create(field, w, {.base_z = base_z}, shaping).value());
  }
};

TEST(BoredSolid, IsASolidAndAddsUp) {
  const Part part;
  ASSERT_GE(part.dowels.size(), 8U);
  const auto whole = GridSolidStream::create(part.field, {.base_z = part.base_z}).value();
  const double known = whole.certify(CoordinateRounding::none).value().volume_mm3;
  double sum = 2.0 * static_cast<double>(part.dowels.size()) * hole_volume_mm3(part.options);
  for (const Tile& t : part.tiles) {
    const auto c = check_mesh(part.solid(t)).value();
    EXPECT_TRUE(c.passed()) << to_json(c);
    EXPECT_TRUE(c.self_intersection_checked);
    EXPECT_EQ(c.euler_number, 2);
    EXPECT_EQ(c.shells, 1U);
    sum += c.volume_mm3;
  }
  EXPECT_NEAR(sum, known, 1e-9 * known);
  // The same by the thought-of hole: round, as wide as dowel and play.
  EXPECT_NEAR(hole_volume_mm3(part.options), 3.14159265 * 2.1 * 2.1 * 8.0, 0.01 * 110);
}

TEST(BoredSolid, HasTheSameWallAsItsNeighbour) {
  const Part part;
  // Tiles 1 and 2 share all of their joint, and no other tile touches it.
  const double x = part.field.x_mm(140);
  const auto west = in_plane(part.solid(part.tiles[0]), true, x, false);
  const auto east = in_plane(part.solid(part.tiles[1]), true, x, true);
  EXPECT_GT(west.size(), 2U * 110U);
  EXPECT_TRUE(west == east);
  // The joint between the strips: both sides have two tiles.
  const double y = part.field.y_mm(110);
  auto south = in_plane(part.solid(part.tiles[0]), false, y, false);
  south.merge(in_plane(part.solid(part.tiles[1]), false, y, false));
  auto north = in_plane(part.solid(part.tiles[2]), false, y, true);
  north.merge(in_plane(part.solid(part.tiles[3]), false, y, true));
  EXPECT_GT(south.size(), 2U * 300U);
  EXPECT_TRUE(south == north);
}

TEST(BoredSolid, TakesThePinAndKeepsItsWalls) {
  const Part part;
  std::map<int, TriMesh> solids;
  for (const Tile& t : part.tiles) solids[t.number] = part.solid(t);
  for (const Dowel& d : part.dowels)
    for (const std::size_t side : {0U, 1U}) {
      const double inward = side == 1 ? 1.0 : -1.0;
      // Depth along the axis, distance from it.
      const auto seen = [&](Vec3 v) {
        const Vec3 p = v - d.centre_mm;
        return d.along_x ? std::pair{inward * p.x, std::hypot(p.y, p.z)}
                         : std::pair{inward * p.y, std::hypot(p.x, p.z)};
      };
      const TriMesh& m = solids[d.tiles[side]];
      int rim = 0, bottom = 0;
      for (const Vec3& v : m.vertices_mm) {
        const auto [depth, off] = seen(v);
        if (std::abs(off - hole_radius_mm(part.options)) < 1e-9) {
          rim += std::abs(depth) < 1e-9;
          bottom += std::abs(depth - 8.0) < 1e-9;
        } else if (depth < 8.0 + part.options.wall_mm) {
          EXPECT_GT(off, hole_radius_mm(part.options) + part.options.wall_mm - 1e-9);
        }
      }
      EXPECT_EQ(rim, kDowelSides);
      EXPECT_EQ(bottom, kDowelSides);
      for (const auto& t : m.triangles) {  // flats of the prism are what the pin comes nearest to
        const Vec3 middle =
            (1.0 / 3.0) * (m.vertices_mm[t[0]] + m.vertices_mm[t[1]] + m.vertices_mm[t[2]]);
        const auto [depth, off] = seen(middle);
        if (depth > -1e-9 && depth < 8.0 - 1e-9) {
          EXPECT_GT(off, 2.1 - 1e-9);
        }
      }
    }
}

TEST(DowelPin, IsASolidThatGoesIntoTwoHoles) {
  for (const auto& [diameter, depth] : {std::pair{4.0, 10.0}, {1.5, 2.0}, {12.0, 3.0}}) {
    const DowelOptions o{.diameter_mm = diameter, .depth_mm = depth};
    const TriMesh pin = dowel_pin(o);
    const auto certificate = check_mesh(pin);
    ASSERT_TRUE(certificate.has_value());
    EXPECT_TRUE(certificate->passed());
    // Prism and two frusta over a regular polygon.
    const double r = 0.5 * diameter, length = pin_length_mm(o);
    const double c = std::min(0.1 * diameter, 0.25 * length), s = r - c;
    const double unit = 32.0 * std::sin(2.0 * std::numbers::pi / 64.0);
    const double volume =
        unit * (r * r * (length - 2.0 * c) + 2.0 / 3.0 * c * (r * r + r * s + s * s));
    EXPECT_NEAR(certificate->volume_mm3, volume, 1e-9 * volume);
    const Box3 box = pin.bounds();
    EXPECT_NEAR(box.max.z - box.min.z, length, 1e-12);
    EXPECT_LT(length, 2.0 * depth);
    EXPECT_GT(length, 1.8 * depth);
    EXPECT_NEAR(box.max.x, r, 1e-12);
    EXPECT_LT(r, hole_radius_mm(o) * std::cos(std::numbers::pi / kDowelSides))
        << "flats of the hole are nearer than its corners";
  }
}

TEST(PlaceDowels, PutsTwoOrMoreInEachJoint) {
  const Part part;
  std::map<std::array<int, 2>, int> count;
  for (const Dowel& d : part.dowels) ++count[d.tiles];
  EXPECT_EQ(count.size(), 5U) << "1-2, 3-4, 1-3, 2-4, and 2-3 where the bricks overlap";
  EXPECT_GE((count[{1, 3}]), 2);
  EXPECT_GE((count[{1, 2}]), 2);
  for (const Dowel& d : part.dowels) EXPECT_NEAR(d.centre_mm.z - part.base_z.value(), 5.0, 1e-12);
  EXPECT_TRUE(place_dowels(part.field, std::span(part.tiles).first(1), part.base_z, kThickness,
                           part.options)
                  ->empty());
}

TEST(PlaceDowels, SaysWhatDoesNotFit) {
  const Part part;
  DowelOptions thick = part.options;
  thick.diameter_mm = 8.0;
  const auto thin = place_dowels(part.field, part.tiles, part.base_z, kThickness, thick);
  ASSERT_THAT(thin, FailsWith(kDowelDoesNotFit));
  EXPECT_THAT(thin.error().message, testing::AllOf(HasSubstr("12.24"), HasSubstr("10 mm")));
  DowelOptions deep = part.options;
  deep.depth_mm = 30.0;
  const auto small = place_dowels(part.field, part.tiles, part.base_z, kThickness, deep);
  ASSERT_THAT(small, FailsWith(kDowelDoesNotFit));
  EXPECT_THAT(small.error().message, testing::AllOf(HasSubstr("tile 1"), HasSubstr("62 mm")));
  for (const double bad : {0.0, -3.0, static_cast<double>(NAN)}) {
    DowelOptions o = part.options;
    o.diameter_mm = bad;
    EXPECT_THAT(place_dowels(part.field, part.tiles, part.base_z, kThickness, o),
                FailsWith(kDowelDoesNotFit));
  }
}

TEST(TriangulateRing, CoversWhatIsBetween) {
  for (std::uint64_t seed = 1; seed <= 30; ++seed) {
    std::vector<detail::Flat> outer, hole;
    for (int i = 0; i <= 20; ++i) outer.push_back({0.5 * i, 0.0});
    for (int i = 20; i >= 0; --i)
      outer.push_back({0.5 * i, 6.0 + 8.0 * random_uniform(seed, static_cast<std::uint64_t>(i))});
    for (int k = 0; k < 16; ++k)
      hole.push_back({5.0 + 1.5 * std::cos(0.3927 * k), 3.0 + 1.5 * std::sin(0.3927 * k)});
    const auto area = [](const std::vector<detail::Flat>& ring) {
      double twice = 0.0;
      for (std::size_t i = 0; i < ring.size(); ++i) {
        const auto &a = ring[i], &b = ring[(i + 1) % ring.size()];
        twice += a.s * b.z - a.z * b.s;
      }
      return 0.5 * twice;
    };
    auto all = outer;
    all.insert(all.end(), hole.begin(), hole.end());
    double sum = 0.0;
    for (const auto& [a, b, c] : detail::triangulate_ring(outer, hole)) {
      const double one = area({all[a], all[b], all[c]});
      EXPECT_GT(one, 0.0);
      sum += one;
    }
    EXPECT_NEAR(sum, area(outer) - area(hole), 1e-9);
  }
}

}  // namespace
}  // namespace maquette::meshing
