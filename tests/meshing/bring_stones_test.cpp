// SPDX-License-Identifier: GPL-3.0-or-later

// meshing/bring_stones.hpp:
//   the same pose on the planet ............. every vertex in metres of the site, exaggerated 2,
//   heights
//                                             that begin at different zeros
//   there and back ........................ the same pose
//   not all over the other ground ........... left out
//   discs ................................... farthest vertex from the place

#include "meshing/bring_stones.hpp"

#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "meshing/settle_stones.hpp"

namespace maquette::meshing {
namespace {

using heightmap::ModelField;

/// A site's ground in metres.
double height_m(double east, double north) {
  return -2100.0 + 0.05 * east - 0.02 * north + 0.2 * std::sin(0.3 * east) +
         0.1 * std::cos(0.4 * north);
}

struct Model {
  ModelField field;
  ModelScale scale;
  double half_m, zero_m;

  Model(double denominator, double half, double spacing, double z_zero)
      : scale(denominator, 2.0), half_m(half), zero_m(z_zero) {
    const double side_mm = scale.horizontal(Metres{2 * half}).value();
    const auto nodes = static_cast<std::ptrdiff_t>(std::lround(side_mm / spacing)) + 1;
    field = {.z_mm = Grid<float>(nodes, nodes), .spacing = Millimetres{spacing}};
    for (std::ptrdiff_t r = 0; r < nodes; ++r)
      for (std::ptrdiff_t c = 0; c < nodes; ++c) {
        const Vec3 m = site_m({field.x_mm(c), field.y_mm(r), 0});
        field.z_mm(r, c) =
            static_cast<float>(scale.vertical(Metres{height_m(m.x, m.y) - zero_m}).value());
      }
  }
  [[nodiscard]] Vec3 site_m(Vec3 p) const {
    return {scale.unscale_horizontal(Millimetres{p.x}).value() - half_m,
            scale.unscale_horizontal(Millimetres{p.y}).value() - half_m,
            scale.unscale_vertical(Millimetres{p.z}).value() + zero_m};
  }
  [[nodiscard]] StoneGround ground() const { return {field, scale, -half_m, -half_m, zero_m}; }
};

TEST(BringStones, TheSamePoseOnThePlanet) {
  const Model small(1000, 100, 0.5, -2110.25), large(200, 20, 0.5, -2105.5);
  const SitePlanRequest request{
      .count = 4, .inner_share = 1.0, .half_width = Metres{100}, .inner_half_width = Metres{20}};
  const auto plan = plan_stones(request).value();
  const auto fitted = lay_stones(plan, large.field, large.scale, -20, -20);
  const auto settled = settle_stones(plan, request, large.ground()).value();
  for (const auto& near : {fitted, settled}) {
    ASSERT_EQ(near.size(), 4u);
    const auto far = bring_stones(near, large.ground(), small.ground());
    ASSERT_EQ(far.size(), 4u);
    for (std::size_t i = 0; i < 4; ++i) {
      EXPECT_EQ(far[i].number, near[i].number);
      EXPECT_TRUE(same_shape(far[i], near[i]));
      EXPECT_EQ(far[i].model_from_stone.rotation, near[i].model_from_stone.rotation);
      const TriMesh a = stone_mesh(far[i]), b = stone_mesh(near[i]);
      double lowest = INFINITY, depth = NAN;
      for (std::size_t v = 0; v < a.vertices_mm.size(); ++v) {
        // 0.01 mm of the smaller model is what the workshop sees; rounding is far below.
        const Vec3 off = small.site_m(a.vertices_mm[v]) - large.site_m(b.vertices_mm[v]);
        EXPECT_LT(norm(off), 1e-8) << "metres";
        const Vec3 p = a.vertices_mm[v];
        if (p.z < lowest) lowest = p.z, depth = heightmap::height_at(small.field, p.x, p.y) - p.z;
      }
      EXPECT_NEAR(far[i].embedded_depth_mm, depth, 1e-9);
    }
    const auto back = bring_stones(far, small.ground(), large.ground());
    ASSERT_EQ(back.size(), 4u);
    for (std::size_t i = 0; i < 4; ++i)
      EXPECT_LT(
          norm(back[i].model_from_stone.translation_mm - near[i].model_from_stone.translation_mm),
          1e-7);
  }
}

TEST(BringStones, LeavesOutWhatIsNotOnTheOtherGround) {
  const Model small(1000, 100, 0.5, -2110.25), large(200, 20, 0.5, -2105.5);
  std::vector<SiteStone> stones;
  for (const double east : {0.0, 19.5, 50.0})
    stones.push_back(
        {.number = static_cast<int>(stones.size()) + 1, .diameter = Metres{3.0}, .east_m = east});
  const auto far = lay_stones(stones, small.field, small.scale, -100, -100);
  ASSERT_EQ(far.size(), 3u);
  const auto near = bring_stones(far, small.ground(), large.ground());
  ASSERT_EQ(near.size(), 1u);
  EXPECT_EQ(near[0].number, 1);

  const auto discs = discs_of(far, small.ground());
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_NEAR(discs[i].east_m, stones[i].east_m, 1e-9);
    EXPECT_NEAR(discs[i].north_m, 0.0, 1e-9);
    EXPECT_NEAR(discs[i].radius_m, 3.0 * circumscribed_radius(stones[i]), 1e-9);
  }
}

}  // namespace
}  // namespace maquette::meshing
