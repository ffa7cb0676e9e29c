// SPDX-License-Identifier: GPL-3.0-or-later

// meshing/height_spline.hpp:
//   a cubic is met everywhere .............. between nodes and at the border, with the fewest knots
//   the tolerance holds at every node ...... evaluated apart (height_of), rough and smooth terrain
//   no wider knots would have done ......... smooth terrain has few poles, rough has one a node
//   least squares .......................... residuals are orthogonal to every pole's function
//   one pole a node interpolates ........... noise, 4 x 4 to 40 x 23 nodes
//   x is its own parameter ................. Greville places: a straight line by its poles
//   MESHING_SURFACE_HAS_VOIDS .............. row and column

#include "meshing/height_spline.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/random.hpp"
#include "meshing/solid.hpp"
#include "support/matchers.hpp"
#include "support/shapes.hpp"

namespace maquette::meshing {
namespace {

using heightmap::ModelField;
using testing_support::FailsWith;
using testing_support::random_terrain;

template <class Height>
ModelField field(std::ptrdiff_t rows, std::ptrdiff_t cols, Height height) {
  ModelField f{Grid<float>(rows, cols), Millimetres{0.5}, Millimetres{3.0}, Millimetres{-2.0}};
  for (std::ptrdiff_t r = 0; r < rows; ++r)
    for (std::ptrdiff_t c = 0; c < cols; ++c)
      f.z_mm(r, c) = static_cast<float>(height(f.x_mm(c), f.y_mm(r)));
  return f;
}

TEST(HeightSpline, MeetsACubicEverywhere) {
  const auto cubic = [](double x, double y) {
    return 0.001 * x * x * x - 0.02 * x * y * y + 0.3 * y + 0.0005 * x * x * x * y * y * y / 1000;
  };
  const ModelField f = field(81, 129, cubic);
  const HeightSpline s = fit_height_spline(f, Millimetres{1e-3}).value();
  EXPECT_EQ(s.knots_x_mm.size(), 5U) << "128 cells by 32";
  EXPECT_EQ(s.poles_mm.cols(), 7);
  EXPECT_EQ(s.poles_mm.rows(), static_cast<std::ptrdiff_t>(s.knots_y_mm.size()) + 2);
  // Heights of up to 600 are rounded to float: 3e-5 each.
  for (double x = 3.0; x <= 67.0; x += 0.37)
    for (double y = -2.0; y <= 38.0; y += 0.41) EXPECT_NEAR(height_of(s, x, y), cubic(x, y), 1e-4);
  EXPECT_NEAR(height_of(s, 67.0, 38.0), cubic(67.0, 38.0), 1e-4);
}

class Terrain : public testing::TestWithParam<std::uint64_t> {};
INSTANTIATE_TEST_SUITE_P(Seeds, Terrain, testing::Values(1, 2, 3));

TEST_P(Terrain, KeepsTheToleranceAtEveryNode) {
  const ModelField f = random_terrain(GetParam(), 150, 131, 0.5, 0.3, 0.002);
  std::ptrdiff_t last = 0;
  for (const double tolerance : {0.5, 0.05, 0.004, 1e-6}) {
    const HeightSpline s = fit_height_spline(f, Millimetres{tolerance}).value();
    double most = 0.0, squares = 0.0, between = 0.0;
    for (std::ptrdiff_t r = 0; r < 150; ++r)
      for (std::ptrdiff_t c = 0; c < 131; ++c) {
        const double e = height_of(s, f.x_mm(c), f.y_mm(r)) - static_cast<double>(f.z_mm(r, c));
        most = std::fmax(most, std::abs(e));
        squares += e * e;
        if (r == 149 || c == 130) continue;
        const double x = f.x_mm(c) + 0.25, y = f.y_mm(r) + 0.25;
        between = std::fmax(between, std::abs(height_of(s, x, y) - heightmap::height_at(f, x, y)));
      }
    EXPECT_LE(most, tolerance);
    EXPECT_NEAR(s.max_error_mm, most, 1e-9);
    EXPECT_NEAR(s.rms_error_mm, std::sqrt(squares / (150 * 131)), 1e-9);
    EXPECT_NEAR(s.max_between_mm, between, 1e-9);
    const auto poles = static_cast<std::ptrdiff_t>(s.poles_mm.cells().size());
    EXPECT_GE(poles, last) << "a tighter tolerance takes more poles";
    last = poles;
  }
  EXPECT_EQ(last, 150 * 131) << "noise below the tolerance is met by interpolation alone";
}

TEST_P(Terrain, IsLeastSquares) {
  const ModelField f = random_terrain(GetParam(), 65, 90, 0.5, 0.3, 0.05);
  HeightSpline s = fit_height_spline(f, Millimetres{0.6}).value();
  ASSERT_LT(s.poles_mm.cells().size(), 3000U);
  const auto sum_of_squares = [&] {
    double squares = 0.0;
    for (std::ptrdiff_t r = 0; r < 65; ++r)
      for (std::ptrdiff_t c = 0; c < 90; ++c)
        squares +=
            std::pow(height_of(s, f.x_mm(c), f.y_mm(r)) - static_cast<double>(f.z_mm(r, c)), 2.0);
    return squares;
  };
  const double best = sum_of_squares();
  for (std::uint64_t i = 0; i < 12; ++i) {
    double& pole =
        s.poles_mm(static_cast<std::ptrdiff_t>(random_bits(GetParam(), 2 * i) %
                                               static_cast<std::uint64_t>(s.poles_mm.rows())),
                   static_cast<std::ptrdiff_t>(random_bits(GetParam(), 2 * i + 1) %
                                               static_cast<std::uint64_t>(s.poles_mm.cols())));
    const double keep = pole;
    pole = keep + 1e-3;
    const double up = sum_of_squares();
    pole = keep - 1e-3;
    const double down = sum_of_squares();
    pole = keep;
    EXPECT_GT(up, best);
    EXPECT_GT(down, best);
    EXPECT_NEAR(up, down, 1e-3 * (up - best) + 1e-12) << "the bottom of a parabola";
  }
}

TEST(HeightSpline, InterpolatesSmallFields) {
  for (const auto& [rows, cols] : {std::pair{4, 4}, {4, 9}, {5, 6}, {40, 23}}) {
    const ModelField f = random_terrain(9, rows, cols, 0.5, 0.1, 1.0);
    const HeightSpline s = fit_height_spline(f, Millimetres{1e-9}).value();
    EXPECT_EQ(s.poles_mm.rows(), rows);
    EXPECT_EQ(s.poles_mm.cols(), cols);
    EXPECT_LT(s.max_error_mm, 1e-11);
  }
}

TEST(HeightSpline, HasItsPlaceAsParameter) {
  const ModelField f = field(60, 70, [](double x, double y) { return 2.0 * x - 3.0 * y; });
  const HeightSpline s = fit_height_spline(f, Millimetres{1e-3}).value();
  const auto x = greville_places(s.knots_x_mm), y = greville_places(s.knots_y_mm);
  ASSERT_EQ(static_cast<std::ptrdiff_t>(x.size()), s.poles_mm.cols());
  for (std::size_t j = 0; j < y.size(); ++j)
    for (std::size_t i = 0; i < x.size(); ++i)
      EXPECT_NEAR(s.poles_mm(static_cast<std::ptrdiff_t>(j), static_cast<std::ptrdiff_t>(i)),
                  2.0 * x[i] - 3.0 * y[j], 2e-4);
}

TEST(HeightSpline, NamesAVoid) {
  ModelField f = field(9, 9, [](double, double) { return 0.0; });
  f.z_mm(5, 7) = NAN;
  const auto s = fit_height_spline(f, Millimetres{0.1});
  ASSERT_THAT(s, FailsWith(kSurfaceHasVoids));
  EXPECT_THAT(s.error().message, testing::HasSubstr("row 5, column 7"));
}

}  // namespace
}  // namespace maquette::meshing
