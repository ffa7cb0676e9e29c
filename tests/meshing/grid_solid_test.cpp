// SPDX-License-Identifier: GPL-3.0-or-later
// What meshing/solid.hpp claims of grid_solid, and how each claim is attacked:
//
//   closed, outward, no degenerate triangle .. counted by hand; CGAL's certificate
//   top vertices are the nodes, bit for bit ... compared with ==
//   the field's own diagonals ................. height_at at random points of triangles
//   exact walls and base ...................... every other vertex lies on them
//   volume .................................... closed form for prisms, sum of columns
//   independent of thread count ............... compared with ==
//   every documented error .................... one case per code

#include "meshing/solid.hpp"

#include <limits>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <oneapi/tbb/global_control.h>
#include <oneapi/tbb/task_arena.h>

#include "meshing/mesh_checks.hpp"
#include "support/matchers.hpp"
#include "support/shapes.hpp"

namespace maquette::meshing {
namespace {

using heightmap::ModelField;
using testing_support::FailsWith;
using testing_support::random_terrain;
using testing_support::Succeeds;

ModelField level(std::ptrdiff_t rows, std::ptrdiff_t cols, float z, double spacing) {
  return {Grid<float>(rows, cols, z), Millimetres{spacing}, Millimetres{3}, Millimetres{-2}};
}

TEST(GridSolid, OfOneCellIsABoxOfKnownVolume) {
  const auto solid = grid_solid(level(2, 2, 1.0F, 4.0), {.base_z = Millimetres{-7}});
  ASSERT_THAT(solid, Succeeds());
  EXPECT_EQ(solid->vertices_mm.size(), 4U + 4U + 1U);
  EXPECT_EQ(solid->triangles.size(), 2U + 8U + 4U);
  const auto certificate = check_mesh(*solid);
  ASSERT_THAT(certificate, Succeeds());
  EXPECT_TRUE(certificate->passed()) << to_json(*certificate);
  EXPECT_DOUBLE_EQ(certificate->volume_mm3, 4.0 * 4.0 * 8.0);
  EXPECT_DOUBLE_EQ(certificate->area_mm2, 2 * 16.0 + 4 * 32.0);
}

TEST(GridSolid, RefusesVoidsAndSaysWhereTheFirstIs) {
  ModelField field = level(5, 6, 0.0F, 1.0);
  field.z_mm(3, 1) = std::numeric_limits<float>::quiet_NaN();
  field.z_mm(2, 4) = std::numeric_limits<float>::quiet_NaN();
  const auto solid = grid_solid(field);
  ASSERT_THAT(solid, FailsWith(kSurfaceHasVoids));
  EXPECT_THAT(solid.error().message, testing::HasSubstr("row 2, column 4"));
}

TEST(GridSolid, WantsOneMillimetreUnderTheLowestNode) {
  ModelField field = level(5, 6, 0.0F, 1.0);
  field.z_mm(4, 5) = -2.0F;
  EXPECT_THAT(grid_solid(field, {.base_z = Millimetres{-3}}), Succeeds());
  EXPECT_THAT(grid_solid(field, {.base_z = Millimetres{-2.999}}), FailsWith(kBaseTooThin));
  EXPECT_THAT(grid_solid(field, {.base_z = Millimetres{NAN}}), FailsWith(kBaseTooThin));
}

TEST(GridSolid, StopsWhenAsked) {
  std::stop_source stop;
  stop.request_stop();
  RunContext run;
  run.stop = stop.get_token();
  EXPECT_THAT(grid_solid(level(9, 9, 0.0F, 1.0), {}, run), FailsWith(kCancelled));
}

class GridSolidOnTerrain : public testing::TestWithParam<std::uint64_t> {
 protected:
  const std::ptrdiff_t rows = 2 + static_cast<std::ptrdiff_t>(random_bits(GetParam(), 1) % 90);
  const std::ptrdiff_t cols = 2 + static_cast<std::ptrdiff_t>(random_bits(GetParam(), 2) % 90);
  // 0.3 is no binary fraction: coordinates must be made as x_mm() makes them.
  const ModelField field = random_terrain(GetParam(), rows, cols, 0.3, 0.3, 0.05);
};

TEST_P(GridSolidOnTerrain, IsClosedOrientedAndOfTheRightSize) {
  const auto solid = grid_solid(field, {.base_z = Millimetres{-20}});
  ASSERT_THAT(solid, Succeeds());
  const auto c = check_mesh(*solid, &field);
  ASSERT_THAT(c, Succeeds());
  EXPECT_TRUE(c->passed()) << to_json(*c);
  EXPECT_TRUE(c->self_intersection_checked);
  EXPECT_EQ(c->shells, 1U);
  EXPECT_EQ(c->euler_number, 2);
  // Rounding of x / spacing only; heights are below 10 mm.
  EXPECT_LT(c->max_vertical_error_mm, 1e-13);
  EXPECT_EQ(c->vertices_compared, static_cast<std::uint64_t>((rows - 2) * (cols - 2)));
  double volume = 0.0;  // columns under triangles: mean height x area
  for (std::ptrdiff_t r = 0; r + 1 < rows; ++r)
    for (std::ptrdiff_t k = 0; k + 1 < cols; ++k) {
      const double z00 = field.z_mm(r, k), z11 = field.z_mm(r + 1, k + 1);
      volume += 0.045 * ((z00 + z11 + static_cast<double>(field.z_mm(r, k + 1))) / 3.0 + 20.0);
      volume += 0.045 * ((z00 + z11 + static_cast<double>(field.z_mm(r + 1, k))) / 3.0 + 20.0);
    }
  EXPECT_NEAR(c->volume_mm3, volume, 1e-9 * volume);
}

TEST_P(GridSolidOnTerrain, HasTheNodesBitForBitAndTheFieldsDiagonals) {
  const auto solid = grid_solid(field, {.base_z = Millimetres{-20}});
  ASSERT_THAT(solid, Succeeds());
  for (std::ptrdiff_t r = 0; r < rows; ++r)
    for (std::ptrdiff_t c = 0; c < cols; ++c)
      ASSERT_EQ(solid->vertices_mm[static_cast<std::size_t>(r * cols + c)],
                (Vec3{field.x_mm(c), field.y_mm(r), static_cast<double>(field.z_mm(r, c))}));
  for (std::size_t v = static_cast<std::size_t>(rows * cols); v < solid->vertices_mm.size(); ++v)
    ASSERT_EQ(solid->vertices_mm[v].z, -20.0);
  std::uint64_t draw = 0;
  for (const auto& t : solid->triangles) {
    const Vec3 &a = solid->vertices_mm[t[0]], &b = solid->vertices_mm[t[1]],
               &c = solid->vertices_mm[t[2]];
    if (a.z == -20.0 || b.z == -20.0 || c.z == -20.0) continue;
    const double u = 0.1 + 0.4 * random_uniform(GetParam(), ++draw);
    const double v = 0.1 + 0.4 * random_uniform(GetParam(), ++draw);
    const Vec3 p = u * a + v * b + (1 - u - v) * c;
    ASSERT_NEAR(p.z, heightmap::height_at(field, p.x, p.y), 1e-12);
  }
}

TEST_P(GridSolidOnTerrain, IsTheSameForAnyNumberOfThreads) {
  // Four workers even where there are fewer cores.
  const tbb::global_control four(tbb::global_control::max_allowed_parallelism, 4);
  const auto with_threads = [this](int threads) {
    tbb::task_arena arena(threads);
    return arena.execute([this] { return grid_solid(field, {.base_z = Millimetres{-20}}); });
  };
  const auto many = with_threads(4);
  const auto single = with_threads(1);
  ASSERT_THAT(many, Succeeds());
  ASSERT_THAT(single, Succeeds());
  EXPECT_TRUE(many->vertices_mm == single->vertices_mm);
  EXPECT_TRUE(many->triangles == single->triangles);
}

INSTANTIATE_TEST_SUITE_P(Seeds, GridSolidOnTerrain, testing::Range<std::uint64_t>(1, 9));

}  // namespace
}  // namespace maquette::meshing
