// SPDX-License-Identifier: GPL-3.0-or-later

// meshing/hollow.hpp and meshing/shaped_solid.hpp:
//   volumes of boxes with pockets .......... flat surface: whole less pockets, by hand
//   widths are met exactly ................. walls, ribs and pockets in plan, by hand, spacing 0.3
//   on a slope the wall is met ............. thickness along the normal, to float
//   nowhere thinner than the wall .......... random terrain, rough, wavy and with cliffs: distance
//   of
//                                            points all over the ceilings from every facet near
//   a hollow solid is a solid .............. CGAL: closed, manifold, outward, Euler 2, does not cut
//                                            itself; the certificate says what CGAL finds
//   the top is as it was ................... nodes and triangles to the bit; any piece of the
//   stream with stones ............................ CGAL; volume less by the pockets
//   MESHING_HOLLOW_DOES_NOT_FIT ............ thin base, narrow part, senseless lengths; the base
//   that
//                                            is said to do does

#include "meshing/hollow.hpp"

#include <regex>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "cnc/ball_offset.hpp"
#include "core/random.hpp"
#include "core/triangle_distance.hpp"
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
using testing_support::random_terrain;
using testing_support::Succeeds;

ModelField plane(std::ptrdiff_t rows, std::ptrdiff_t cols, double spacing, double height,
                 double along_x = 0.0, double along_y = 0.0) {
  ModelField f{Grid<float>(rows, cols), Millimetres{spacing}, Millimetres{17.25},
               Millimetres{-3.5}};
  for (std::ptrdiff_t r = 0; r < rows; ++r)
    for (std::ptrdiff_t c = 0; c < cols; ++c)
      f.z_mm(r, c) = static_cast<float>(height + along_x * spacing * static_cast<double>(c) +
                                        along_y * spacing * static_cast<double>(r));
  return f;
}

ModelField roof_of(const ModelField& f, const HollowOptions& o) {
  return cnc::offset_surface(f, Millimetres{-o.wall.value()}).value();
}

Result<Underside> hollowed(const ModelField& f, double base, const HollowOptions& o) {
  return hollow_underside(f, roof_of(f, o), Millimetres{base}, o);
}

double lowest(const ModelField& f) {
  return static_cast<double>(heightmap::height_range(f.z_mm).min);
}

TEST(Hollow, BoxWithPockets) {
  // 100 x 60 mm, 22 high. Walls of 3: 94 x 54 inside. Pockets of 20 at most and ribs of 2 make 5
  // in x of 17.2 and 3 in y of 50 / 3; 19 deep.
  const ModelField f = plane(121, 201, 0.5, 12.0);
  const HollowOptions o{.wall = Millimetres{3}, .rib = Millimetres{2}, .pocket = Millimetres{20}};
  const auto u = hollowed(f, -10.0, o);
  ASSERT_THAT(u, Succeeds());
  EXPECT_EQ(u->pockets_x, 5);
  EXPECT_EQ(u->pockets_y, 3);
  EXPECT_NEAR(u->pocket_x_mm, 17.2, 1e-12);
  EXPECT_NEAR(u->pocket_y_mm, 50.0 / 3.0, 1e-12);
  EXPECT_NEAR(u->lowest_ceiling_mm, 9.0, 1e-5);
  EXPECT_LE(u->highest_ceiling_mm, 9.0);
  EXPECT_NEAR(u->volume_mm3, 5.0 * 17.2 * 50.0 * 19.0, 0.1);  // 1e-5 mm of 4300 mm^2
  const auto solid = ShapedSolid::create(f, {.base_z = Millimetres{-10.0}}, {*u}).value();
  const auto c = solid.certify().value();
  EXPECT_NEAR(c.volume_mm3, 100.0 * 60.0 * 22.0 - u->volume_mm3, 1e-6);
  // Outside, underside and pockets' walls.
  const double walls = 5.0 * 3.0 * 2.0 * (17.2 + 50.0 / 3.0) * 19.0;
  EXPECT_NEAR(c.area_mm2, 2.0 * 100.0 * 60.0 + 2.0 * 160.0 * 22.0 + walls, 0.1);
}

TEST(Hollow, WidthsAreMetWhereverNodesLie) {
  // Walls that end between nodes of 0.3 mm; a side is engraved.
  const ModelField f = plane(151, 201, 0.3, 9.0);
  HollowOptions o{.wall = Millimetres{2.2}, .rib = Millimetres{1.3}, .pocket = Millimetres{12}};
  o.cut[1] = Millimetres{0.7};
  const auto u = hollowed(f, -5.0, o).value();
  std::vector<double> x, y;
  for (const Vec3& v : u.mesh.vertices_mm)
    if (v.z > -4.0) {
      x.push_back(v.x);
      y.push_back(v.y);
    }
  EXPECT_NEAR(*std::min_element(x.begin(), x.end()), 17.25 + 2.2, 1e-12);
  EXPECT_NEAR(*std::max_element(x.begin(), x.end()), 17.25 + 60.0 - 2.9, 1e-12);
  EXPECT_NEAR(*std::min_element(y.begin(), y.end()), -3.5 + 2.2, 1e-12);
  EXPECT_NEAR(*std::max_element(y.begin(), y.end()), -3.5 + 45.0 - 2.2, 1e-12);
  EXPECT_NEAR(u.pockets_x * u.pocket_x_mm + (u.pockets_x - 1) * 1.3, 60.0 - 5.1, 1e-12);
  EXPECT_LE(u.pocket_x_mm, 12.0);
  EXPECT_GT((60.0 - 5.1 + 1.3) / (u.pockets_x - 1) - 1.3, 12.0);  // one fewer would be wider
}

TEST(Hollow, OnASlopeTheWallIsMet) {
  const ModelField f = plane(101, 121, 0.5, 30.0, 0.6, -0.3);
  const HollowOptions o{.wall = Millimetres{2.5}, .pocket = Millimetres{25}};
  const auto u = hollowed(f, lowest(f) - 12.0, o).value();
  EXPECT_LT(u.most_excess_mm, 1e-4);
  const double steep = std::sqrt(1.0 + 0.36 + 0.09);
  for (const Vec3& v : u.mesh.vertices_mm) {
    const double above = heightmap::height_at(f, v.x, v.y) - v.z;
    if (v.z > lowest(f) - 11.9) {
      EXPECT_NEAR(above / steep, 2.5, 1e-4);
    }
  }
}

struct Terrain {
  std::string name;
  ModelField field;
  double wall, step;
};

/// Long waves under close nodes: what ceilings have to give way to are their own chords.
ModelField long_waves() {
  ModelField f = plane(201, 241, 0.125, 0.0);
  for (std::ptrdiff_t r = 0; r < 201; ++r)
    for (std::ptrdiff_t c = 0; c < 241; ++c)
      f.z_mm(r, c) =
          static_cast<float>(2.5 * std::sin(f.x_mm(c) / 5.0) + 2.0 * std::cos(f.y_mm(r) / 4.0));
  return f;
}

ModelField with_cliffs(ModelField f) {
  for (std::ptrdiff_t r = 0; r < f.z_mm.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < f.z_mm.cols(); ++c)
      if ((r / 23 + c / 31) % 2 == 0) f.z_mm(r, c) += 4.0F;
  return f;
}

class HollowTerrain : public testing::TestWithParam<int> {
 protected:
  static Terrain terrain(int kind) {
    switch (kind) {
      case 0:
        return {"gentle", random_terrain(11, 111, 141, 0.5, 0.3), 2.0, 0.0};
      case 1:
        return {"steep", random_terrain(12, 111, 141, 0.5, 0.9), 2.0, 1.7};
      case 2:
        return {"rough", random_terrain(13, 111, 141, 0.5, 0.4, 0.05), 1.5, 3.0};
      case 3:
        return {"cliffs", with_cliffs(random_terrain(14, 111, 141, 0.5, 0.2)), 2.0, 2.3};
      case 4:
        return {"long waves", long_waves(), 1.2, 3.0};
      default:
        return {"few nodes", random_terrain(15, 29, 33, 2.0, 0.4), 3.0, 0.7};
    }
  }
};

TEST_P(HollowTerrain, IsNowhereThinnerThanTheWallAndASolid) {
  const Terrain t = terrain(GetParam());
  const ModelField& f = t.field;
  const HollowOptions o{.wall = Millimetres{t.wall},
                        .rib = Millimetres{1.1},
                        .pocket = Millimetres{14.0},
                        .step = Millimetres{t.step}};
  const double base = lowest(f) - 15.0;
  const auto u = hollowed(f, base, o);
  ASSERT_THAT(u, Succeeds());
  RecordProperty("mean_excess_um", static_cast<int>(1e3 * u->mean_excess_mm));
  RecordProperty("most_excess_um", static_cast<int>(1e3 * u->most_excess_mm));

  // Points all over each ceiling triangle against every facet whose plan is within the wall.
  const double d = f.spacing.value();
  double nearest = INFINITY;
  std::uint64_t points = 0;
  for (const auto& tri : u->mesh.triangles) {
    const Vec3 a = u->mesh.vertices_mm[tri[0]], b = u->mesh.vertices_mm[tri[1]],
               c = u->mesh.vertices_mm[tri[2]];
    const bool ceiling = a.z > base && b.z > base && c.z > base;
    if (!ceiling) continue;
    for (int k = 0; k < 18; ++k) {
      // Corners and middles, then anywhere.
      double v = 0.5 * k, w = 0.0;
      if (k > 2) {
        v = random_uniform(77, points);
        w = random_uniform(78, points) * (1.0 - v);
      }
      const Vec3 p = a + v * (b - a) + w * (c - a);
      ++points;
      const auto cell = [&](double mm, double from) {
        return static_cast<std::ptrdiff_t>(std::floor((mm - from) / d));
      };
      const std::ptrdiff_t reach = static_cast<std::ptrdiff_t>(std::ceil(t.wall / d)) + 1;
      const std::ptrdiff_t row = cell(p.y, f.y0.value()), col = cell(p.x, f.x0.value());
      for (std::ptrdiff_t r = std::max<std::ptrdiff_t>(0, row - reach);
           r <= std::min(f.z_mm.rows() - 2, row + reach); ++r)
        for (std::ptrdiff_t q = std::max<std::ptrdiff_t>(0, col - reach);
             q <= std::min(f.z_mm.cols() - 2, col + reach); ++q) {
          const auto node = [&](std::ptrdiff_t i, std::ptrdiff_t j) {
            return Vec3{f.x_mm(j), f.y_mm(i), static_cast<double>(f.z_mm(i, j))};
          };
          nearest = std::fmin(
              nearest, triangle_distance2(p, node(r, q), node(r, q + 1), node(r + 1, q + 1)));
          nearest = std::fmin(
              nearest, triangle_distance2(p, node(r, q), node(r + 1, q + 1), node(r + 1, q)));
        }
    }
  }
  EXPECT_GT(points, 2000U);
  EXPECT_GE(std::sqrt(nearest), t.wall - 1e-9) << t.name;
  EXPECT_LT(std::sqrt(nearest), 1.25 * t.wall) << t.name;

  const auto solid = ShapedSolid::create(f, {.base_z = Millimetres{base}}, {*u}).value();
  const TriMesh mesh = collected(solid);
  const auto said = solid.certify().value();
  const auto found = check_mesh(mesh).value();
  EXPECT_TRUE(found.passed()) << to_json(found);
  EXPECT_TRUE(found.self_intersection_checked);
  EXPECT_EQ(found.euler_number, 2);
  EXPECT_EQ(found.shells, 1U);
  EXPECT_TRUE(said.passed());
  EXPECT_EQ(said.euler_number, 2);
  EXPECT_EQ(said.vertices, found.vertices);
  EXPECT_EQ(said.triangles, found.triangles);
  EXPECT_NEAR(said.volume_mm3, found.volume_mm3, 1e-9 * found.volume_mm3);
  EXPECT_NEAR(said.area_mm2, found.area_mm2, 1e-9 * found.area_mm2);

  // The top, to the bit; and pieces from the middle.
  const auto plain = collected(GridSolidStream::create(f, {.base_z = Millimetres{base}}).value());
  const auto nodes = f.z_mm.rows() * f.z_mm.cols();
  const auto top = 2 * (f.z_mm.rows() - 1) * (f.z_mm.cols() - 1);
  EXPECT_TRUE(std::equal(plain.vertices_mm.begin(), plain.vertices_mm.begin() + nodes,
                         mesh.vertices_mm.begin()));
  EXPECT_TRUE(
      std::equal(plain.triangles.begin(), plain.triangles.begin() + top, mesh.triangles.begin()));
  std::vector<Vec3> some(1000);
  solid.vertices(static_cast<std::uint64_t>(nodes) - 300, some);
  EXPECT_TRUE(std::equal(some.begin(), some.end(), mesh.vertices_mm.begin() + nodes - 300));
  std::vector<MeshStream::Corners> corners(500);
  solid.corners(static_cast<std::uint64_t>(top) - 200, corners);
  for (std::size_t i = 0; i < corners.size(); ++i)
    for (std::size_t k = 0; k < 3; ++k)
      ASSERT_EQ(corners[i][k],
                mesh.vertices_mm[mesh.triangles[static_cast<std::size_t>(top) - 200 + i][k]]);
}
INSTANTIATE_TEST_SUITE_P(Kinds, HollowTerrain, testing::Range(0, 6));

TEST(Hollow, WithStones) {
  const ModelField f = random_terrain(21, 81, 101, 0.5, 0.2);
  const std::vector<TriMesh> stones{
      testing_support::random_rock(5, {17.0, 21.0, heightmap::height_at(f, 17.0, 21.0)}, 2.5),
      testing_support::random_rock(6, {33.0, 12.0, heightmap::height_at(f, 33.0, 12.0)}, 1.5)};
  const SolidOptions options{.base_z = Millimetres{lowest(f) - 9.0}};
  const TriMesh full = volume_solid(f, stones, options).value();
  const double volume = check_mesh(full).value().volume_mm3;
  const HollowOptions o{
      .wall = Millimetres{2.0}, .rib = Millimetres{2.0}, .pocket = Millimetres{15}};
  const auto u = hollowed(f, options.base_z.value(), o).value();
  const TriMesh hollow = shaped(full, f, {u});
  const auto c = check_mesh(hollow).value();
  EXPECT_TRUE(c.passed()) << to_json(c);
  EXPECT_EQ(c.euler_number, 2);
  EXPECT_NEAR(c.volume_mm3, volume - u.volume_mm3, 1e-9 * volume);
  // What is above stays as it was, stones as well: all but the plain base's middle and triangles.
  EXPECT_TRUE(
      std::equal(full.vertices_mm.begin(), full.vertices_mm.end() - 1, hollow.vertices_mm.begin()));
  const auto top = static_cast<std::ptrdiff_t>(full.triangles.size() - 3 * u.rim_vertices);
  EXPECT_TRUE(
      std::equal(full.triangles.begin(), full.triangles.begin() + top, hollow.triangles.begin()));
  // Heights are compared of the top alone, whatever is below it.
  EXPECT_EQ(top_triangles(full, f), static_cast<std::uint64_t>(top));
  const auto whole = check_mesh(full, &f, {.stones = stones}).value();
  const auto above =
      check_mesh(hollow, &f, {.top_triangles = static_cast<std::uint64_t>(top), .stones = stones})
          .value();
  EXPECT_TRUE(above.passed()) << to_json(above);
  EXPECT_EQ(above.vertices_compared, whole.vertices_compared);
  EXPECT_EQ(above.vertices_above_surface, whole.vertices_above_surface);
  EXPECT_EQ(above.max_vertical_error_mm, whole.max_vertical_error_mm);
  EXPECT_EQ(above.max_union_error_mm, whole.max_union_error_mm);
  EXPECT_GT(check_mesh(hollow, &f, {.stones = stones})->max_union_error_mm, 1.5);
  const auto terrain =
      check_mesh(hollow, &f, {.top_triangles = static_cast<std::uint64_t>(top)}).value();
  EXPECT_LE(terrain.max_vertical_error_mm, 0.05);  // what is higher is taken for a stone
  EXPECT_GT(check_mesh(hollow, &f)->max_vertical_error_mm, 1.5);
}

TEST(Hollow, RefusesWhatDoesNotFit) {
  const ModelField f = random_terrain(31, 61, 81, 0.5, 0.2);
  const auto with = [&](double base_mm, HollowOptions o) {
    return hollow_underside(f, roof_of(f, o), Millimetres{lowest(f) - base_mm}, o);
  };
  const auto thin = with(3.0, {.wall = Millimetres{3.0}});
  ASSERT_THAT(thin, FailsWith(kHollowDoesNotFit));
  EXPECT_THAT(thin.error().message, HasSubstr("walls of 3 mm leave pockets of less than 1 mm"));
  std::smatch match;
  ASSERT_TRUE(
      std::regex_search(thin.error().message, match, std::regex("a base of ([0-9.]+) mm or")));
  EXPECT_THAT(with(std::stod(match[1]), {.wall = Millimetres{3.0}}), Succeeds());

  const auto narrow = with(30.0, {.wall = Millimetres{14.8}});  // of 30 x 40 mm
  ASSERT_THAT(narrow, FailsWith(kHollowDoesNotFit));
  EXPECT_THAT(narrow.error().message, HasSubstr("0.4 mm are left in y"));
  EXPECT_THAT(with(10.0, {.rib = Millimetres{20.0}, .pocket = Millimetres{3.0}}),
              FailsWith(kHollowDoesNotFit));
  for (const double bad : {0.0, -1.0, double{NAN}, double{INFINITY}}) {
    const HollowOptions sound;
    const ModelField roof = roof_of(f, sound);
    HollowOptions o = sound;
    o.wall = Millimetres{bad};
    EXPECT_THAT(hollow_underside(f, roof, Millimetres{-20}, o), FailsWith(kHollowDoesNotFit));
    o = sound;
    o.rib = Millimetres{bad};
    EXPECT_THAT(hollow_underside(f, roof, Millimetres{-20}, o), FailsWith(kHollowDoesNotFit));
    o = sound;
    o.pocket = Millimetres{bad};
    EXPECT_THAT(hollow_underside(f, roof, Millimetres{-20}, o), FailsWith(kHollowDoesNotFit));
  }
}

}  // namespace
}  // namespace maquette::meshing
