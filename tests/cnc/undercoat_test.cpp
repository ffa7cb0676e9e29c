// SPDX-License-Identifier: GPL-3.0-or-later
// What cnc/undercoat.hpp claims, and how each claim is attacked:
//
//   slopes ................ closed form: lower by t sqrt(1 + m^2); the coat brings it back
//   dome and bowl ......... closed form: spheres of radius R - t and R + t
//   ridge ................. closed form: what a coat rounds off a roof
//   rough ground .......... brute force over finely sampled facets
//   never nearer than t ... every node of the result to every sample of the design
//   errors ................ thickness, void, cancelled

#include "cnc/undercoat.hpp"

#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "cnc/mill.hpp"
#include "support/matchers.hpp"
#include "support/shapes.hpp"

namespace maquette::cnc {
namespace {

using heightmap::ModelField;
using testing_support::FailsWith;
using testing_support::random_terrain;
using testing_support::Succeeds;

template <class Height>
ModelField field_of(std::ptrdiff_t n, double spacing, Height height) {
  ModelField f{Grid<float>(n, n), Millimetres{spacing}, Millimetres{0}, Millimetres{0}};
  for (std::ptrdiff_t r = 0; r < n; ++r)
    for (std::ptrdiff_t c = 0; c < n; ++c)
      f.z_mm(r, c) = static_cast<float>(height(f.x_mm(c), f.y_mm(r)));
  return f;
}

constexpr double kFloat = 4e-6;  // half a step of a float below 64 mm, some of them added up

TEST(UndercoatTest, OfASlopeIsLowerByTheCoatAlongTheNormal) {
  for (const double m : {0.0, 0.5, 2.0})
    for (const double t : {0.05, 0.3, 1.1}) {
      const ModelField design = field_of(31, 0.5, [m](double x, double) { return m * x; });
      const auto under = undercoat(design, Millimetres{t});
      ASSERT_THAT(under, Succeeds());
      // At the outline, too.
      for (std::ptrdiff_t r = 0; r < 31; ++r)
        for (std::ptrdiff_t c = 0; c < 31; ++c)
          ASSERT_NEAR(static_cast<double>(under->surface.z_mm(r, c)),
                      m * design.x_mm(c) - t * std::sqrt(1.0 + m * m), kFloat);
      EXPECT_LE(under->max_missing_mm, kFloat);
      EXPECT_LE(under->max_excess_mm, kFloat);
    }
}

TEST(UndercoatTest, OfADomeAndABowlIsTheSphereBesideIt) {
  constexpr double kR = 20.0, kT = 0.4, kSpacing = 0.25;
  for (const double sign : {1.0, -1.0}) {  // dome, bowl
    const auto sphere = [sign](double radius) {
      return [=](double x, double y) {
        const double a = x - 6.0, b = y - 6.0;
        return sign * std::sqrt(radius * radius - a * a - b * b);
      };
    };
    const ModelField design = field_of(49, kSpacing, sphere(kR));
    const auto under = undercoat(design, Millimetres{kT});
    ASSERT_THAT(under, Succeeds());
    const auto beside = sphere(kR - sign * kT);
    // Facets lie inside of the sphere by up to d^2 / (8 R), d the diagonal. In the corner the
    // normal leans by 20.7 degrees: d is longer by 1 / cos, the height again: 1.22 in all.
    const double facets = 1.23 * 2.0 * kSpacing * kSpacing / (8.0 * kR);
    for (std::ptrdiff_t r = 4; r < 45; ++r)
      for (std::ptrdiff_t c = 4; c < 45; ++c)
        ASSERT_NEAR(static_cast<double>(under->surface.z_mm(r, c)),
                    beside(design.x_mm(c), design.y_mm(r)), facets + kFloat)
            << sign << " row " << r << " column " << c;
  }
}

TEST(UndercoatTest, SaysWhatACoatRoundsOffARidge) {
  constexpr double kM = 0.75, kT = 0.2;
  const ModelField design =
      field_of(41, 0.5, [](double x, double) { return 10.0 - kM * std::abs(x - 10.0); });
  const auto under = undercoat(design, Millimetres{kT});
  ASSERT_THAT(under, Succeeds());
  const double lower = kT * std::sqrt(1.0 + kM * kM);
  EXPECT_NEAR(static_cast<double>(under->surface.z_mm(20, 20)), 10.0 - lower, kFloat);
  // A ball on the new ridge stands kT above it.
  EXPECT_NEAR(under->max_missing_mm, lower - kT, kFloat);
  EXPECT_LE(under->max_excess_mm, kFloat);
  const ModelField valley =
      field_of(41, 0.5, [](double x, double) { return kM * std::abs(x - 10.0); });
  const auto in_valley = undercoat(valley, Millimetres{kT});
  ASSERT_THAT(in_valley, Succeeds());
  // Below the bottom the undercoat is a cylinder: its lowest line is kT below, and no more.
  EXPECT_NEAR(static_cast<double>(in_valley->surface.z_mm(20, 20)), -kT, kFloat);
}

class UndercoatOnTerrain : public testing::TestWithParam<std::uint64_t> {};

TEST_P(UndercoatOnTerrain, IsWhatBruteForceFindsAndNeverNearerThanTheCoat) {
  constexpr double kSpacing = 0.5;
  const ModelField design = random_terrain(GetParam(), 17, 19, kSpacing, 0.4, 0.05);
  for (const double t : {0.1, 0.7}) {
    const auto under = undercoat(design, Millimetres{t});
    ASSERT_THAT(under, Succeeds());
    const double step = t / 40.0;
    for (std::ptrdiff_t r = 2; r < 15; ++r)
      for (std::ptrdiff_t c = 2; c < 17; ++c) {
        const double x = design.x_mm(c), y = design.y_mm(r);
        const auto found = static_cast<double>(under->surface.z_mm(r, c));
        double highest = INFINITY, nearest = INFINITY;
        for (int i = -40; i <= 40; ++i)
          for (int j = -40; j <= 40; ++j) {
            const double u = step * i, v = step * j, left = t * t - u * u - v * v;
            if (left < 0.0) continue;
            const double z = heightmap::height_at(design, x + u, y + v);
            highest = std::fmin(highest, z - std::sqrt(left));
            nearest = std::fmin(nearest, std::sqrt(u * u + v * v + (z - found) * (z - found)));
          }
        // Never above. Samples miss a valley between facets by up to half a step, where slopes
        // turn by about a half.
        ASSERT_GE(found, highest - 0.25 * step - kFloat) << r << " " << c;
        ASSERT_LE(found, highest + kFloat);
        ASSERT_GE(nearest, t - kFloat);
      }
  }
}

INSTANTIATE_TEST_SUITE_P(Seeds, UndercoatOnTerrain, testing::Range<std::uint64_t>(1, 4));

TEST(UndercoatTest, RefusesWhatIsNoCoatAndStops) {
  const ModelField design = field_of(9, 0.5, [](double, double) { return 1.0; });
  for (const double t : {0.0, -0.1, 12.1, static_cast<double>(NAN)})
    EXPECT_THAT(undercoat(design, Millimetres{t}), FailsWith(kCoatThickness)) << t;
  ModelField holed = design;
  holed.z_mm(3, 4) = NAN;
  EXPECT_THAT(undercoat(holed, Millimetres{0.1}), FailsWith(kHeightNotFinite));
  RunContext run;
  std::stop_source stop;
  stop.request_stop();
  run.stop = stop.get_token();
  EXPECT_THAT(undercoat(design, Millimetres{0.1}, run), FailsWith(kCancelled));
}

}  // namespace
}  // namespace maquette::cnc
