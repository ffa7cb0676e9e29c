// SPDX-License-Identifier: GPL-3.0-or-later

// Claims of to_model, hillshade (heightmap/fuse.hpp), body.hpp and how each is attacked
//   metres become millimetres by the scale, heights     1:2500 with exaggeration 2, where nothing
//     by scale and exaggeration, lowest = floor           is right by accident; 1:1000 and 1:200
//   lower-left node at (0, 0) exactly; voids stay       site frame with odd origin
//   shade is Lambert's cosine                           planes of known slope, all four sides
//   body names are found in any case                    names that are and are not there

#include <cmath>

#include <gtest/gtest.h>

#include "heightmap/fuse.hpp"

namespace maquette::heightmap {
namespace {

struct ScaleCase {
  double denominator, exaggeration, spacing_mm, step_mm;
};
class ToModel : public ::testing::TestWithParam<ScaleCase> {};
INSTANTIATE_TEST_SUITE_P(Scales, ToModel,
                         ::testing::Values(ScaleCase{2500, 2, 0.2, 2.4}, ScaleCase{1000, 1, 0.5, 3},
                                           ScaleCase{200, 1, 2.5, 15}));

TEST_P(ToModel, ScalesLengthsAndHeights) {
  PlanetField field{Grid<float>(5, 7, -4450.0F), Metres{0.5}, Metres{-123.4}, Metres{-77.7}};
  field.z_m(2, 3) = -4447.0F;
  field.z_m(4, 6) = NAN;
  const ModelField model = to_model(
      field, ModelScale(GetParam().denominator, GetParam().exaggeration), Millimetres{10.0});
  EXPECT_DOUBLE_EQ(model.spacing.value(), GetParam().spacing_mm);
  EXPECT_EQ(model.x0.value(), 0.0);
  EXPECT_EQ(model.y0.value(), 0.0);
  EXPECT_EQ(model.z_mm(0, 0), 10.0F);
  EXPECT_FLOAT_EQ(model.z_mm(2, 3), static_cast<float>(10.0 + GetParam().step_mm));
  EXPECT_TRUE(std::isnan(model.z_mm(4, 6)));
}

ModelField plane(double slope_x, double slope_y) {
  ModelField f{Grid<float>(9, 9), Millimetres{0.5}, {}, {}};
  for (std::ptrdiff_t r = 0; r < 9; ++r)
    for (std::ptrdiff_t c = 0; c < 9; ++c)
      f.z_mm(r, c) = static_cast<float>(
          0.5 * (slope_x * static_cast<double>(c) + slope_y * static_cast<double>(r)));
  return f;
}

TEST(Hillshade, IsLambertsCosine) {
  EXPECT_EQ(hillshade(plane(0, 0))(4, 4), std::lround(255 * std::sqrt(0.5)));
  // Falls towards the north-west at 45 degrees: faces the sun.
  const double s = std::sqrt(0.5);
  EXPECT_EQ(hillshade(plane(s, -s))(4, 4), 255);
  EXPECT_EQ(hillshade(plane(s, -s))(0, 0), 255) << "one-sided at the border";
  EXPECT_EQ(hillshade(plane(-2, 2))(4, 4), 0) << "turned away";
  // Sun in the east, on the horizon: a slope that rises to the west by 30 degrees.
  const auto east = hillshade(plane(-std::tan(std::numbers::pi / 6), 0), degrees(90), degrees(0));
  EXPECT_EQ(east(4, 4), std::lround(255 * 0.5));
}

TEST(Hillshade, VoidsAreBlackAndSpoilNobody) {
  ModelField f = plane(0, 0);
  f.z_mm(4, 4) = NAN;
  const auto shade = hillshade(f);
  EXPECT_EQ(shade(4, 4), 0);
  EXPECT_EQ(shade(4, 5), shade(0, 0));
}

TEST(BodyByName, KnowsMoonAndMars) {
  ASSERT_TRUE(body_by_name("Moon"));
  EXPECT_EQ(body_by_name("Moon")->equatorial_radius_m, 1737400.0);
  EXPECT_EQ(body_by_name("mars")->equatorial_radius_m, 3396190.0);
  EXPECT_EQ(body_by_name("MARS")->polar_radius_m, 3376200.0);
  EXPECT_FALSE(body_by_name("earth"));
  EXPECT_FALSE(body_by_name(""));
}

}  // namespace
}  // namespace maquette::heightmap
