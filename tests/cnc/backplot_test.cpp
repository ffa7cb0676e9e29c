// SPDX-License-Identifier: GPL-3.0-or-later

// What backplot.hpp claims, and how each claim is attacked:
//
//   a pixel's colour is the mean of its path ... two feeds in one row of pixels and in one pixel
//   row 0 is the upper row ..................... a cut along the northern edge
//   rapids are grey, cuts go over them ......... one of each, and both
//   arcs are walked as arcs .................... a circle: pixels at its radius and nowhere else
//   thinned runs keep single cuts .............. one cut among a thousand passes; dense passes thin
//                                                out to the cells
//   the SVG is well-formed and bounded ......... tags balanced, size within what cells allow

#include "cnc/backplot.hpp"

#include <cmath>
#include <set>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "support/motions.hpp"

namespace maquette::cnc {
namespace {

using testing::HasSubstr;
using testing_support::motions_of;

constexpr BackplotOptions kTen{
    .x_max_mm = 10.0, .y_max_mm = 10.0, .longest_px = 10, .longest_cells = 10};
using Rgb = std::array<std::uint8_t, 3>;
constexpr Rgb kWhite{255, 255, 255}, kGrey{170, 170, 170};

Backplot plot(const std::string& text, const BackplotOptions& options = kTen,
              double removed = 1.0) {
  Backplot backplot(options);
  for (const Motion& m : motions_of(text + "\nM2\n")) backplot.add(m, removed);
  return backplot;
}

TEST(Backplot, ColoursAreMeansOfThePath) {
  // Row 2 from the south: half at 100, half at 300; column 8 is crossed at 300 and at 100 again.
  const Backplot b = plot(
      "G0 X0 Y2.5 Z0\nG1 X5 F100\nX10 F300\nG0 Y0\nX8.5\nG1 Y10 F100\nG0 X0\nY9.5\nG1 X4 F200");
  const auto scale = b.scale(BackplotColour::feed);
  EXPECT_NEAR(scale.low, 100.0, 1e-3);
  EXPECT_NEAR(scale.high, 300.0, 1e-3);
  const auto picture = b.picture(BackplotColour::feed);
  ASSERT_EQ(picture.rows(), 10);
  ASSERT_EQ(picture.cols(), 10);
  const Rgb low = picture(7, 0), high = picture(7, 6);
  EXPECT_NE(low, high);
  EXPECT_EQ(picture(3, 8), low);
  EXPECT_EQ(picture(7, 8), picture(0, 0)) << "as much at 300 as at 100, so that of 200";
  EXPECT_EQ(picture(0, 3), picture(0, 0));
  EXPECT_EQ(picture(1, 3), kWhite);
  EXPECT_EQ(picture(9, 9), kGrey) << "the rapid along the southern edge";
  EXPECT_EQ(picture(0, 5), kGrey);
}

TEST(Backplot, EngagementIsVolumeOverLength) {
  Backplot b(kTen);
  const auto motions = motions_of("G0 X0 Y0.5 Z0\nG1 X10 F100\nG0 Y5.5\nG1 X0\nM2\n");
  for (const Motion& m : motions)
    b.add(m, m.kind == Motion::Kind::rapid ? 9.0 : m.to_mm.y < 1.0 ? 20.0 : 0.0);
  const auto scale = b.scale(BackplotColour::engagement);
  EXPECT_NEAR(scale.high, 2.0, 1e-4);
  EXPECT_LT(scale.low, 0.001) << "air";
  ASSERT_GE(b.runs().size(), 3U);
  EXPECT_NEAR(b.runs()[0].engagement_mm2, 2.0, 1e-9);
}

TEST(Backplot, ArcsAreWalkedAsArcs) {
  const BackplotOptions options{.x_max_mm = 20.0, .y_max_mm = 20.0, .longest_px = 200};
  const auto picture = plot("G0 X18 Y10 Z0\nG3 I-8 F100", options).picture(BackplotColour::feed);
  int on = 0;
  for (std::ptrdiff_t r = 0; r < 200; ++r)
    for (std::ptrdiff_t c = 0; c < 200; ++c) {
      if (picture(r, c) == kWhite) continue;
      ++on;
      const double x = 0.1 * (static_cast<double>(c) + 0.5),
                   y = 20.0 - 0.1 * (static_cast<double>(r) + 0.5);
      ASSERT_NEAR(std::hypot(x - 10.0, y - 10.0), 8.0, 0.0708);
    }
  EXPECT_GT(on, 500) << "of a circumference of 503 pixels";
}

TEST(Backplot, RunsThinOutToTheCellsButKeepSingleCuts) {
  const BackplotOptions options{.x_max_mm = 100.0, .y_max_mm = 100.0, .longest_cells = 20};
  std::string text = "G0 X0 Y0 Z5\nF100\n";
  for (int i = 0; i <= 500; ++i)
    text += fmt::format("G1 Y{:.1f}\nX{}\n", 0.1 * i, i % 2 == 0 ? 100 : 0);
  text += "G0 Z20\nX50 Y80\nG1 Z1\nX70 Y90\nG0 Z20";
  const Backplot b = plot(text, options);
  std::size_t points = 0;
  bool single = false;
  for (const BackplotRun& run : b.runs()) {
    points += run.points_mm.size();
    for (const Vec3& p : run.points_mm) single = single || (!run.rapid && p.y > 81.0 && p.z == 1.0);
  }
  EXPECT_LE(points, 2U * 400U);
  EXPECT_GE(points, 200U);
  EXPECT_TRUE(single);
}

TEST(Backplot, SvgHasFrameScaleAndPaths) {
  const Backplot b = plot("G0 X0 Y2.5 Z0\nG1 X10 F100\nG0 Y8\nG1 X0 F300");
  for (const BackplotColour colour : {BackplotColour::feed, BackplotColour::engagement}) {
    const std::string svg = b.svg(colour, "a < b & c");
    EXPECT_THAT(svg, HasSubstr("<svg xmlns"));
    EXPECT_THAT(svg, HasSubstr("a &lt; b &amp; c"));
    EXPECT_THAT(svg, HasSubstr("stroke-dasharray"));
    EXPECT_THAT(svg, testing::EndsWith("</svg>\n"));
    EXPECT_EQ(svg.find("nan"), std::string::npos);
    EXPECT_LT(svg.size(), 10000U);
  }
  EXPECT_THAT(b.svg(BackplotColour::feed, "t"), HasSubstr(">300<"));
  const Backplot nothing(kTen);
  EXPECT_EQ(nothing.svg(BackplotColour::engagement, "t").find("nan"), std::string::npos);
}

}  // namespace
}  // namespace maquette::cnc
