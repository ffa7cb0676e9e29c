// SPDX-License-Identifier: GPL-3.0-or-later

// What crests keep of a spray, where geometry says it.
//
//   behind a wall ......... dark as far as its height over the tangent of the spray's elevation,
//                           half of it at that line, all of it beyond
//   a plain, a void ....... nothing is dark
//   one direction again ... the same shadow, not another

#include <cmath>
#include <numbers>

#include <gtest/gtest.h>

#include "diagnosis/cast_shadow.hpp"

namespace maquette::diagnosis {
namespace {

constexpr double kSide_mm = 80.0, kSpacing_mm = 0.5, kWall_mm = 40.0;

/// Ground at 3 mm, from kWall_mm on in x higher.
heightmap::ModelField terrace(double height_mm) {
  const auto n = static_cast<std::ptrdiff_t>(kSide_mm / kSpacing_mm) + 1;
  heightmap::ModelField f{Grid<float>(n, n, 3.0F), Millimetres{kSpacing_mm}, Millimetres{0.0},
                          Millimetres{0.0}};
  for (std::ptrdiff_t r = 0; r < n; ++r)
    for (std::ptrdiff_t c = 0; c < n; ++c)
      if (f.x_mm(c) >= kWall_mm) f.z_mm(r, c) += static_cast<float>(height_mm);
  return f;
}

Vec3 towards(double azimuth_deg, double elevation_deg) {
  const double a = azimuth_deg * std::numbers::pi / 180.0,
               h = elevation_deg * std::numbers::pi / 180.0;
  return {std::cos(h) * std::cos(a), std::cos(h) * std::sin(a), std::sin(h)};
}

class BehindAWall : public testing::TestWithParam<double> {};
INSTANTIATE_TEST_SUITE_P(Elevation_deg, BehindAWall, testing::Values(15.0, 30.0, 60.0));

TEST_P(BehindAWall, ItIsDarkAsFarAsItsHeightSays) {
  constexpr double kHeight_mm = 5.0;
  const double elevation_deg = GetParam();
  const auto shadow = cast_shadows(terrace(kHeight_mm))(towards(0.0, elevation_deg));
  const double end_mm = kWall_mm - kHeight_mm / std::tan(elevation_deg * std::numbers::pi / 180.0);
  const auto reached = [&](double x) { return shadow->at(x, 0.5 * kSide_mm); };
  // The edge is a Gaussian's integral; nodes are 0.7 mm apart and the wall as wide.
  EXPECT_GT(reached(end_mm - 3.5 * kShadowEdge_mm), 0.99);
  EXPECT_GT(reached(end_mm - kShadowEdge_mm), 0.6);
  EXPECT_LT(reached(end_mm + kShadowEdge_mm), 0.4);
  if (kWall_mm - end_mm > 8.0 * kShadowEdge_mm) {
    EXPECT_LT(reached(0.5 * (end_mm + kWall_mm)), 0.01);
  }
  EXPECT_GT(reached(kWall_mm + 4.0), 0.99) << "on the terrace";
  EXPECT_NEAR(shadow->share, (kWall_mm - end_mm) / kSide_mm, 0.8 / kSide_mm);
}

TEST(CastShadow, IsNoneOnThePlainOrFromBehind) {
  const auto plain = cast_shadows(terrace(0.0));
  EXPECT_EQ(plain(towards(70.0, 20.0))->share, 0.0);
  EXPECT_LT(cast_shadows(terrace(5.0))(towards(180.0, 20.0))->share, 0.02);
  auto voided = terrace(5.0);
  for (std::ptrdiff_t r = 0; r < voided.z_mm.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < voided.z_mm.cols(); ++c)
      if (voided.x_mm(c) >= kWall_mm) voided.z_mm(r, c) = NAN;
  const auto beside = cast_shadows(voided)(towards(0.0, 20.0));
  EXPECT_EQ(beside->share, 0.0);
  EXPECT_EQ(beside->at(60.0, 40.0), 1.0) << "over the void";
  EXPECT_EQ(beside->at(-50.0, 400.0), 1.0) << "beside the part";
}

TEST(CastShadow, IsKept) {
  const auto shadow = cast_shadows(terrace(5.0));
  EXPECT_EQ(shadow(towards(10.0, 20.0)), shadow(towards(10.0, 20.0)));
  EXPECT_NE(shadow(towards(10.0, 20.0)), shadow(towards(10.0, 21.0)));
}

}  // namespace
}  // namespace maquette::diagnosis
