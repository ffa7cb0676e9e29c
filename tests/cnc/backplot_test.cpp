// SPDX-License-Identifier: GPL-3.0-or-later

// What backplot.hpp claims, and how each claim is attacked:
//
//   a pixel's colour is the mean of its path ... two feeds in one row of pixels and in one pixel
//   row 0 is the upper row ..................... a cut along the northern edge
//   rapids are pink, cuts go over them ......... one of each, and both
//   arcs are walked as arcs .................... a circle: pixels at its radius and nowhere else
//   height and engagement ...................... a ramp; volume over length
//   the scale tells a constant from a range .... one feed, two feeds, one pixel of another
//   where cuts begin ........................... once a square, however many passes
//   no share of a colour is out of range ....... nothing at all, values far outside

#include "cnc/backplot.hpp"

#include <cmath>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "support/motions.hpp"

namespace maquette::cnc {
namespace {

using testing_support::motions_of;

constexpr BackplotOptions kTen{.x_max_mm = 10.0, .y_max_mm = 10.0, .longest_px = 10};

Backplot plot(const std::string& text, const BackplotOptions& options = kTen,
              double removed = 1.0) {
  Backplot backplot(options);
  for (const Motion& m : motions_of(text + "\nM2\n")) backplot.add(m, removed);
  return backplot;
}

Grid<Rgb> picture(const Backplot& b, BackplotColour colour) {
  return b.picture(colour, b.scale(colour));
}

TEST(Backplot, ColoursAreMeansOfThePath) {
  // Row 2 from the south: half at 100, half at 300; column 8 is crossed at 300 and at 100 again.
  const Backplot b = plot(
      "G0 X0 Y2.5 Z0\nG1 X5 F100\nX10 F300\nG0 Y0\nX8.5\nG1 Y10 F100\nG0 X0\nY9.5\nG1 X4 F200");
  const BackplotScale scale = b.scale(BackplotColour::feed);
  EXPECT_NEAR(scale.low, 100.0, 1e-3);
  EXPECT_NEAR(scale.high, 300.0, 1e-3);
  EXPECT_FALSE(scale.constant);
  EXPECT_NEAR(scale.share(200.0), 0.5, 1e-6);
  const auto drawn = picture(b, BackplotColour::feed);
  ASSERT_EQ(drawn.rows(), 10);
  ASSERT_EQ(drawn.cols(), 10);
  const Rgb low = drawn(7, 0), high = drawn(7, 6);
  EXPECT_EQ(low, backplot_colour(0.0));
  EXPECT_EQ(high, backplot_colour(1.0));
  EXPECT_EQ(drawn(3, 8), low);
  EXPECT_EQ(drawn(7, 8), drawn(0, 0)) << "as much at 300 as at 100, so that of 200";
  EXPECT_EQ(drawn(0, 3), drawn(0, 0));
  EXPECT_EQ(drawn(1, 3), drawn(0, 3)) << "few cuts are three pixels wide";
  EXPECT_EQ(drawn(2, 3), kPaperColour);
  EXPECT_EQ(drawn(9, 9), kRapidColour) << "the rapid along the southern edge";
  EXPECT_EQ(drawn(9, 5), kPaperColour);
  EXPECT_EQ(drawn(0, 5), kRapidColour);
  EXPECT_TRUE(b.begins_mm() == (Vec3{0, 2.5, 0}));
  EXPECT_TRUE(b.ends_mm() == (Vec3{4, 9.5, 0}));
}

TEST(Backplot, EngagementIsVolumeOverLength) {
  Backplot b(kTen);
  const auto motions = motions_of("G0 X0 Y0.5 Z0\nG1 X10 F100\nG0 Y5.5\nG1 X0\nM2\n");
  for (const Motion& m : motions)
    b.add(m, m.kind == Motion::Kind::rapid ? 9.0 : m.to_mm.y < 1.0 ? 20.0 : 0.0);
  const BackplotScale scale = b.scale(BackplotColour::engagement);
  EXPECT_NEAR(scale.high, 2.0, 1e-4);
  EXPECT_EQ(scale.low, kLeastEngagement_mm2) << "air";
  EXPECT_TRUE(scale.logarithmic);
  EXPECT_NEAR(scale.share(std::sqrt(scale.low * scale.high)), 0.5, 1e-9);
}

TEST(Backplot, HeightIsThatOfTheTip) {
  const Backplot b = plot("G0 X0 Y0.5 Z0\nG1 X10 Z10 F100");
  const BackplotScale scale = b.scale(BackplotColour::height);
  // A step is half a pixel and may lie on its border.
  EXPECT_NEAR(scale.low, 0.5, 0.25);
  EXPECT_NEAR(scale.high, 8.5, 0.25) << "ten values; the 98th percentile is the ninth";
}

TEST(Backplot, ArcsAreWalkedAsArcs) {
  const BackplotOptions options{.x_max_mm = 20.0, .y_max_mm = 20.0, .longest_px = 200};
  const auto drawn = picture(plot("G0 X18 Y10 Z0\nG3 I-8 F100", options), BackplotColour::feed);
  int on = 0;
  for (std::ptrdiff_t r = 0; r < 200; ++r)
    for (std::ptrdiff_t c = 0; c < 200; ++c) {
      if (drawn(r, c) == kPaperColour) continue;
      ++on;
      const double x = 0.1 * (static_cast<double>(c) + 0.5),
                   y = 20.0 - 0.1 * (static_cast<double>(r) + 0.5);
      // Half a pixel's diagonal, a pixel for width, and a thousandth for the chords.
      ASSERT_NEAR(std::hypot(x - 10.0, y - 10.0), 8.0, 0.0708 + 0.1 + 1e-4);
    }
  EXPECT_GT(on, 500) << "of a circumference of 503 pixels";
}

TEST(Backplot, AScaleTellsAConstantFromARange) {
  const auto scale_of = [](const std::string& text) {
    return plot(text).scale(BackplotColour::feed);
  };
  const BackplotScale one = scale_of("G0 X0 Y0 Z0\nG1 X10 F100\nY5\nX0");
  EXPECT_TRUE(one.constant);
  EXPECT_NEAR(one.high, 100.0, 1e-3);
  EXPECT_LE(one.share(100.0), 1.0);
  EXPECT_FALSE(scale_of("G0 X0 Y0 Z0\nG1 X10 F100\nY5\nX0 F101").constant);
  // One pixel of 101 lies beyond the percentiles.
  std::string text = "G0 X0 Y0.5 Z0\nF100\n";
  for (int i = 0; i < 10; ++i) text += fmt::format("G1 Y{}.5\nX{}\n", i, i % 2 == 0 ? 10 : 0);
  const BackplotScale single = scale_of(text + "X0.5 F20");
  EXPECT_FALSE(single.constant);
  EXPECT_TRUE(single.all);
  EXPECT_LT(single.low, 80.0);
  EXPECT_NEAR(single.high, 100.0, 1e-3);
}

TEST(Backplot, EntriesAreOnceASquare) {
  const BackplotOptions options{.x_max_mm = 10.0, .y_max_mm = 10.0, .longest_px = 80};  // 1 mm
  std::string text = "F100\n";
  for (int i = 0; i <= 100; ++i) text += fmt::format("G0 Z5\nX0.5 Y{:.1f}\nG1 Z0\nX9\n", 0.1 * i);
  const Backplot b = plot(text, options);
  EXPECT_EQ(b.entries_mm().size(), 10U);
  for (const Vec3& at : b.entries_mm()) EXPECT_EQ(at.z, 5.0) << "where the rapid ended";
}

TEST(Backplot, NothingHasAPictureToo) {
  const Backplot nothing(kTen);
  EXPECT_TRUE(nothing.empty());
  for (const auto colour :
       {BackplotColour::feed, BackplotColour::engagement, BackplotColour::height}) {
    const BackplotScale scale = nothing.scale(colour);
    EXPECT_TRUE(std::isfinite(scale.share(scale.low)) && std::isfinite(scale.share(scale.high)));
    EXPECT_EQ(nothing.picture(colour, scale)(3, 3), kPaperColour);
  }
  EXPECT_EQ(backplot_colour(-7.0), backplot_colour(0.0));
  EXPECT_EQ(backplot_colour(99.0), backplot_colour(1.0));
}

}  // namespace
}  // namespace maquette::cnc
