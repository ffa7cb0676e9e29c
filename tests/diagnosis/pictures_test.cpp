// SPDX-License-Identifier: GPL-3.0-or-later
// Truth: moments of a bright point that is spread are those of what spreads it, in closed form.
#include "diagnosis/detail/pictures.hpp"

#include <cmath>
#include <numbers>

#include <gtest/gtest.h>

namespace maquette::diagnosis::detail {
namespace {

constexpr std::ptrdiff_t kSide = 31, kMiddle = 15;
/// Light is not negative: cubics that swing below 0 are cut off there, above this they are not.
constexpr float kGround = 0.25F;

Grid<float> point_of_light() {
  Grid<float> g(kSide, kSide, kGround);
  g(kMiddle, kMiddle) += 1.0F;
  return g;
}

struct Moments {
  double all = 0.0, along_cols = 0.0, both = 0.0, along_rows = 0.0;
};
Moments moments(const Grid<float>& g) {
  Moments m;
  for (std::ptrdiff_t r = 0; r < g.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < g.cols(); ++c) {
      const auto v = static_cast<double>(g(r, c) - kGround);
      const auto dr = static_cast<double>(r - kMiddle), dc = static_cast<double>(c - kMiddle);
      m.all += v;
      m.along_cols += v * dc * dc;
      m.both += v * dr * dc;
      m.along_rows += v * dr * dr;
    }
  return m;
}

// A Gaussian that is cut at four standard deviations lacks 0.11 % of its variance; one that is
// sampled at pixels has 0.2 % less where it is narrowest (Poisson's sum: 8 pi^2 v exp(-2 pi^2 v)).
constexpr double kOfAGaussian = 0.0035;
constexpr double kOfFloats = 1e-4;
// Sums of a thousand floats near 0.25 times up to 15 squared: 0.25 * 6e-8 * 60 * sqrt(1000).
constexpr double kOfFloatsTimesSquares = 1e-3;

TEST(Pictures, BlurHasTheVarianceThatIsAskedFor) {
  for (const double v : {0.02, 0.1, 0.27, 0.48, 0.49, 0.8, 2.0, 6.0}) {
    auto g = point_of_light();
    blur(g, v);
    const Moments m = moments(g);
    EXPECT_NEAR(m.all, 1.0, kOfFloats) << v;
    EXPECT_NEAR(m.along_cols, v, kOfAGaussian * v + kOfFloatsTimesSquares) << v;
    EXPECT_NEAR(m.along_rows, v, kOfAGaussian * v + kOfFloatsTimesSquares) << v;
    EXPECT_NEAR(m.both, 0.0, kOfFloatsTimesSquares) << v;
  }
}

TEST(Pictures, BlurByPlaceIsBlurWhereTheVarianceIsTheSame) {
  auto picture = point_of_light();
  picture(3, 7) = 2.0F;
  picture(25, 0) = 3.0F;  // at the edge, which goes on
  for (const double v : {0.2, 1.5}) {
    auto by_place = picture, all = picture;
    blur_by_place(by_place, Grid<float>(kSide, kSide, static_cast<float>(v)));
    blur(all, v);
    for (std::ptrdiff_t r = 0; r < kSide; ++r)
      for (std::ptrdiff_t c = 0; c < kSide; ++c) ASSERT_NEAR(by_place(r, c), all(r, c), 1e-6);
  }
}

TEST(Pictures, BlurByPlaceLeavesWhereThereIsNone) {
  auto picture = point_of_light();
  Grid<float> variance(kSide, kSide, 2.0F);
  variance(kMiddle, kMiddle) = 0.0F;
  blur_by_place(picture, variance);
  EXPECT_EQ(picture(kMiddle, kMiddle), 1.0F + kGround);
  EXPECT_GT(picture(kMiddle, kMiddle + 1), 1.05F * kGround);
}

TEST(Pictures, SmearHasTheTensorThatIsAskedFor) {
  for (const double length : {0.6, 1.0, 3.0, 9.0})
    for (const double degrees : {0.0, 30.0, 90.0, 135.0})
      for (const double across : {0.0, 0.3}) {
        const double a = degrees * std::numbers::pi / 180.0,
                     along = length * length / 12.0 + across;
        const double cc = along * std::cos(a) * std::cos(a) + across * std::sin(a) * std::sin(a),
                     rr = along * std::sin(a) * std::sin(a) + across * std::cos(a) * std::cos(a),
                     cr = (along - across) * std::sin(a) * std::cos(a);
        auto g = point_of_light();
        smear(g, {cc, cr, rr}, [](std::ptrdiff_t, std::ptrdiff_t) { return true; });
        const Moments m = moments(g);
        EXPECT_NEAR(m.all, 1.0, kOfFloats);
        EXPECT_NEAR(m.along_cols, cc, kOfAGaussian * along + kOfFloatsTimesSquares)
            << length << ' ' << degrees;
        EXPECT_NEAR(m.along_rows, rr, kOfAGaussian * along + kOfFloatsTimesSquares)
            << length << ' ' << degrees;
        EXPECT_NEAR(m.both, cr, kOfAGaussian * along + kOfFloatsTimesSquares)
            << length << ' ' << degrees;
      }
}

TEST(Pictures, SmearStaysWhereItIsNotWanted) {
  auto g = point_of_light();
  smear(g, {3.0, 0.0, 0.0}, [](std::ptrdiff_t, std::ptrdiff_t c) { return c < kMiddle; });
  EXPECT_EQ(g(kMiddle, kMiddle), 1.0F + kGround);
  EXPECT_GT(g(kMiddle, kMiddle - 1), 1.05F * kGround);
}

TEST(Pictures, ValuesBetweenNodesAreThoseOfPolynomialsThatTheKernelKeeps) {
  Grid<float> g(9, 9, 0.0F);
  const auto f = [](double r, double c) { return 20.0 + 0.5 * r - 0.25 * c + 0.125 * r * c; };
  const auto q = [](double r, double c) { return 0.25 * r * r - 0.5 * c * c; };
  for (std::ptrdiff_t r = 0; r < 9; ++r)
    for (std::ptrdiff_t c = 0; c < 9; ++c)
      g(r, c) = static_cast<float>(f(static_cast<double>(r), static_cast<double>(c)));
  EXPECT_NEAR(bilinear(g, 3.3, 4.7), f(3.3, 4.7), 1e-5);
  for (std::ptrdiff_t r = 0; r < 9; ++r)
    for (std::ptrdiff_t c = 0; c < 9; ++c)
      g(r, c) += static_cast<float>(q(static_cast<double>(r), static_cast<double>(c)));
  EXPECT_NEAR(cubic(g, 3.3, 4.7), f(3.3, 4.7) + q(3.3, 4.7), 1e-5);
}

}  // namespace
}  // namespace maquette::diagnosis::detail
