// SPDX-License-Identifier: GPL-3.0-or-later

// Tiles that are hollow, engraved and bored for dowels and magnets, all at once (dowels.hpp,
// engraving.hpp, hollow.hpp, shaped_solid.hpp over a window):
//   each is a solid ....................... CGAL: closed, manifold, outward, does not cut itself;
//                                           the proven certificate says the same
//   volumes add up ........................ whole = tiles + pockets + grooves + holes, to 1e-9
//   neighbours have the same wall ......... triangles in the joint's plane, to the bit, turned,
//                                           though coordinates of a part by itself would round
//                                           otherwise
//   material behind holes ................. no pocket nearer to a hole than the wall
//   magnets stand between dowels .......... in the middle, in the joint; none where room lacks
//   a label keeps off holes ............... begins behind the first, or is refused

#include <map>
#include <set>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "cnc/ball_offset.hpp"
#include "meshing/dowels.hpp"
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
using testing_support::Succeeds;

constexpr Millimetres kThickness{12.0};

/// 150 x 120 mm in staggered tiles; neither the place nor the spacing is a binary fraction.
struct Part {
  ModelField field = random_terrain(3, 201, 251, 0.6, 0.25, 0.05);
  std::vector<Tile> tiles{{1, 1, 1, {0, 90, 0, 120}},
                          {2, 1, 2, {0, 90, 120, 250}},
                          {3, 2, 1, {90, 200, 0, 170}},
                          {4, 2, 2, {90, 200, 170, 250}}};
  Millimetres base_z{0.0};
  DowelOptions of_dowels{.diameter_mm = 4.0, .depth_mm = 6.0, .spacing_mm = 30.0};
  DowelOptions of_magnets{.diameter_mm = 5.0, .depth_mm = 2.2, .wall_mm = 1.0};
  HollowOptions hollow{
      .wall = Millimetres{1.5}, .rib = Millimetres{1.2}, .pocket = Millimetres{15}};
  EngravingStyle style{.side = WallSide::west, .letter = Millimetres{4.0}};
  std::vector<Dowel> dowels, magnets;

  Part() {
    field.spacing = Millimetres{0.6};
    field.x0 = Millimetres{17.1};
    field.y0 = Millimetres{-3.7};
    base_z = Millimetres{static_cast<double>(heightmap::height_range(field.z_mm).min)} - kThickness;
    of_dowels.between_mm = room_along_mm(field, of_magnets);
    dowels = place_dowels(field, tiles, base_z, kThickness, of_dowels).value();
    magnets = place_between(field, dowels, of_dowels, of_magnets);
  }
  [[nodiscard]] std::vector<EngravedWall> holes(const Tile& t) const {
    auto walls = bored_walls(field, t, base_z, dowels, of_dowels);
    for (auto& w : bored_walls(field, t, base_z, magnets, of_magnets)) walls.push_back(w);
    return walls;
  }
  [[nodiscard]] Shaping shaping(const Tile& t, bool with_label) const {
    Shaping s{.underside = {}, .walls = holes(t)};
    HollowOptions o = hollow;
    for (std::size_t side = 0; side < 4; ++side)
      o.cut[side] = std::max(bored_depth(t, dowels, static_cast<WallSide>(side), of_dowels),
                             bored_depth(t, magnets, static_cast<WallSide>(side), of_magnets));
    if (with_label) {
      o.cut[3] = std::max(o.cut[3], style.depth);
      const std::vector marks{text_mark("N", style).value()};
      const auto grooves = engrave_wall(field, t.nodes, base_z, marks, style, s.walls).value();
      s.walls.insert(s.walls.end(), grooves.begin(), grooves.end());
    }
    const ModelField piece = window_field(field, t.nodes);
    const auto roof = cnc::offset_surface(piece, Millimetres{-o.wall.value()}).value();
    s.underside = hollow_underside(piece, roof, base_z, o).value();
    return s;
  }
  [[nodiscard]] ShapedSolid solid(const Tile& t, const Shaping& s) const {
    return ShapedSolid::create(field, t.nodes, {.base_z = base_z}, s).value();
  }
};

TEST(ShapedTiles, AreSolidsAndAddUp) {
  const Part part;
  ASSERT_GE(part.dowels.size(), 8U);
  ASSERT_GE(part.magnets.size(), 4U);
  const auto whole = GridSolidStream::create(part.field, {.base_z = part.base_z}).value();
  const double known = whole.certify(CoordinateRounding::none).value().volume_mm3;
  double sum = 2.0 * static_cast<double>(part.dowels.size()) * hole_volume_mm3(part.of_dowels) +
               2.0 * static_cast<double>(part.magnets.size()) * hole_volume_mm3(part.of_magnets);
  for (const Tile& t : part.tiles) {
    const Shaping shaping = part.shaping(t, true);
    const ShapedSolid solid = part.solid(t, shaping);
    const auto proven = solid.certify().value();
    const auto found = check_mesh(collected(solid)).value();
    EXPECT_TRUE(found.passed()) << to_json(found);
    EXPECT_TRUE(found.self_intersection_checked);
    EXPECT_EQ(found.euler_number, 2);
    EXPECT_EQ(found.shells, 1U);
    EXPECT_EQ(found.triangles, proven.triangles);
    EXPECT_NEAR(found.volume_mm3, proven.volume_mm3, 1e-9 * found.volume_mm3);
    EXPECT_NEAR(found.area_mm2, proven.area_mm2, 1e-9 * found.area_mm2);
    EXPECT_GT(shaping.underside.volume_mm3, 0.1 * found.volume_mm3) << "hollow";
    sum += found.volume_mm3 + shaping.underside.volume_mm3 + shaping.walls.back().volume_mm3;
  }
  EXPECT_NEAR(sum, known, 1e-9 * known);
}

TEST(ShapedTiles, ShareTheirWalls) {
  const Part part;
  // A part by itself would have other coordinates, or this test says nothing.
  const ModelField alone = window_field(part.field, part.tiles[3].nodes);
  bool differs = false;
  for (std::ptrdiff_t c = 0; c <= 80; ++c)
    differs = differs || alone.x_mm(c) != part.field.x_mm(170 + c);
  EXPECT_TRUE(differs);
  std::map<int, TriMesh> solids;
  for (const Tile& t : part.tiles)
    solids[t.number] = collected(part.solid(t, part.shaping(t, false)));
  const double x = part.field.x_mm(120), y = part.field.y_mm(90);
  const auto west = in_plane(solids[1], true, x, false);
  EXPECT_GT(west.size(), 2U * 90U);
  EXPECT_TRUE(west == in_plane(solids[2], true, x, true));
  auto south = in_plane(solids[1], false, y, false), north = in_plane(solids[3], false, y, true);
  south.merge(in_plane(solids[2], false, y, false));
  north.merge(in_plane(solids[4], false, y, true));
  EXPECT_GT(south.size(), 2U * 250U);
  EXPECT_TRUE(south == north);
}

TEST(ShapedTiles, KeepMaterialBehindHoles) {
  const Part part;
  for (const Tile& t : part.tiles) {
    const Underside u = part.shaping(t, true).underside;
    for (const auto* kind : {&part.dowels, &part.magnets}) {
      const DowelOptions& o = kind == &part.dowels ? part.of_dowels : part.of_magnets;
      for (const Dowel& d : *kind)
        for (const std::size_t side : {0U, 1U}) {
          if (d.tiles[side] != t.number) continue;
          for (std::size_t i = u.rim_vertices; i < u.mesh.vertices_mm.size(); ++i) {
            const Vec3 p = u.mesh.vertices_mm[i] - d.centre_mm;
            const double depth = (side == 1 ? 1.0 : -1.0) * (d.along_x ? p.x : p.y);
            ASSERT_GE(depth, o.depth_mm + part.hollow.wall.value() - 1e-9);
          }
        }
    }
  }
}

TEST(PlaceBetween, PutsMagnetsInTheMiddle) {
  const Part part;
  for (const Dowel& m : part.magnets) {
    int nearest = 0;
    for (std::size_t i = 0; i + 1 < part.dowels.size(); ++i) {
      const Dowel &a = part.dowels[i], &b = part.dowels[i + 1];
      if (a.tiles != m.tiles || b.tiles != m.tiles) continue;
      const double off = norm(0.5 * (a.centre_mm + b.centre_mm) - m.centre_mm);
      if (off > 1e-9) continue;
      ++nearest;
      EXPECT_EQ(m.along_x ? m.centre_mm.x : m.centre_mm.y,
                a.along_x ? a.centre_mm.x : a.centre_mm.y);
      EXPECT_GE(norm(a.centre_mm - m.centre_mm), hole_radius_mm(part.of_dowels) +
                                                     hole_radius_mm(part.of_magnets) +
                                                     part.of_dowels.wall_mm);
    }
    EXPECT_EQ(nearest, 1) << m.number;
  }
  // Dowels that were placed as if alone may leave no room.
  DowelOptions dense = part.of_dowels, wide = part.of_magnets;
  dense.between_mm = 0.0;
  dense.spacing_mm = 8.0;
  wide.diameter_mm = 9.0;
  const auto close = place_dowels(part.field, part.tiles, part.base_z, kThickness, dense).value();
  EXPECT_TRUE(place_between(part.field, close, dense, wide).empty());
  EXPECT_THAT(place_dowels(part.field, part.tiles, part.base_z, kThickness,
                           {.between_mm = static_cast<double>(NAN)}),
              FailsWith(kDowelDoesNotFit));
}

TEST(EngraveWall, KeepsOffHoles) {
  const Part part;
  const Tile& t = part.tiles[1];  // holes in its western wall
  const auto taken = part.holes(t);
  for (const bool at_right : {false, true}) {
    auto mark = text_mark("N", part.style).value();
    mark.at_right = at_right;
    const auto with =
        engrave_wall(part.field, t.nodes, part.base_z, {mark}, part.style, taken).value().front();
    for (const EngravedWall& hole : taken)
      EXPECT_TRUE(with.first_edge + with.edges <= hole.first_edge ||
                  hole.first_edge + hole.edges <= with.first_edge);
  }
  // Longer than any stretch between two holes, but not than the wall.
  const auto no_room =
      engrave_wall(part.field, t.nodes, part.base_z, {text_mark("N 123456789", part.style).value()},
                   part.style, taken);
  ASSERT_THAT(no_room, FailsWith(kLabelDoesNotFit));
  EXPECT_THAT(no_room.error().message, HasSubstr("between the holes of the western wall"));
  EXPECT_THAT(engrave_wall(part.field, t.nodes, part.base_z,
                           {text_mark("N 123456789", part.style).value()}, part.style, {}),
              Succeeds());
}

}  // namespace
}  // namespace maquette::meshing
