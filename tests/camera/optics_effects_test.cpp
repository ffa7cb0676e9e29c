// SPDX-License-Identifier: GPL-3.0-or-later

// camera/effects, from the scene to the sensor, each against its closed form:
//   intrinsics ....... K with skew there and back; field of view
//   distortion ....... pictures of dots: centroids against the formula, all models, each band, 0.01
//                      px; there and back 1e-9; a fold is refused; depth goes along
//   motion ........... flow against displaced points of space; a dot's streak; rows at their times
//   depth of field ... the circle's diameter by hand; a point's second moment and light; a blurred
//                      edge before and behind against rays through the lens; blades
//   vignetting ....... cos^4, polynomial, overlap of discs against counting
//   diffraction ...... Airy's formula and its dark rings; light kept; blades' rays; a point's
//   picture
//                      against the figure, far part included
//   veiling glare .... share in the dark; mean kept
//   sampling ......... quadratics exactly; places together as one by one, to the bit

#include <cmath>
#include <numbers>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "camera/effects/sampling.hpp"
#include "camera/stack.hpp"
#include "core/random.hpp"
#include "support/matchers.hpp"
#include "support/shots.hpp"

namespace maquette::camera {
namespace {

using testing::HasSubstr;
using testing_support::FailsWith;
using testing_support::flat;
using testing_support::second_moment_of_opening;
using testing_support::shot_of;
using testing_support::Succeeds;

/// A round dot, sigma 2 pixels: wide enough for any sampling.
void add_dot(Grid<float>& g, Vec2 at) {
  for (std::ptrdiff_t r = 0; r < g.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < g.cols(); ++c) {
      const double dx = static_cast<double>(c) + 0.5 - at.x,
                   dy = static_cast<double>(r) + 0.5 - at.y;
      if (std::abs(dx) < 14.0 && std::abs(dy) < 14.0)
        g(r, c) += static_cast<float>(std::exp(-(dx * dx + dy * dy) / 8.0));
    }
}

/// Where the Gaussian dot near `at` lies: iterated, weighted with the same Gaussian, so that the
/// window cuts nothing off.
Vec2 centroid(const Grid<float>& g, Vec2 at) {
  for (int i = 0; i < 20; ++i) {
    double sum = 0.0, x = 0.0, y = 0.0;
    for (int dy = -12; dy <= 12; ++dy)
      for (int dx = -12; dx <= 12; ++dx) {
        const auto c = static_cast<std::ptrdiff_t>(std::floor(at.x)) + dx;
        const auto r = static_cast<std::ptrdiff_t>(std::floor(at.y)) + dy;
        if (!g.contains(r, c)) continue;
        const double px = static_cast<double>(c) + 0.5 - at.x,
                     py = static_cast<double>(r) + 0.5 - at.y;
        const double w = std::exp(-(px * px + py * py) / 8.0) * static_cast<double>(g(r, c));
        sum += w, x += w * px, y += w * py;
      }
    at = {at.x + 2.0 * x / sum, at.y + 2.0 * y / sum};  // equal widths halve the way
  }
  return at;
}

TEST(Intrinsics, GoThereAndBack) {
  const Intrinsics k{1000, 800, 1200.0, 1150.0, 510.0, 390.0, 7.0};
  const Vec2 t = tangents(k, {130.0, 700.0});
  EXPECT_NEAR(t.y, 310.0 / 1150.0, 1e-15);
  EXPECT_NEAR(t.x, (130.0 - 510.0 - 7.0 * t.y) / 1200.0, 1e-15);
  const Vec2 back = pixel(k, t);
  EXPECT_NEAR(back.x, 130.0, 1e-10);
  EXPECT_NEAR(back.y, 700.0, 1e-10);
  // FOV = 2 atan(r d / 2 f): 4256 pixels of 8.45 um at 34.542 mm are 55 degrees.
  EXPECT_NEAR(field_of_view_rad(4256, 8.45, 34.54232) * 180.0 / std::numbers::pi, 55.0, 1e-3);
}

TEST(Sampling, IsExactForQuadratics) {
  Grid<float> g(9, 9);
  const auto f = [](double x, double y) {
    return 3.0 + 0.5 * x + 0.25 * y + 0.125 * x * x + 0.25 * x * y;
  };
  for (std::ptrdiff_t r = 0; r < 9; ++r)
    for (std::ptrdiff_t c = 0; c < 9; ++c)
      g(r, c) = static_cast<float>(f(static_cast<double>(c) + 0.5, static_cast<double>(r) + 0.5));
  for (int i = 0; i < 100; ++i) {
    const double x = 2.0 + 5.0 * random_uniform(1, static_cast<std::uint64_t>(i));
    const double y = 2.0 + 5.0 * random_uniform(2, static_cast<std::uint64_t>(i));
    ASSERT_NEAR(static_cast<double>(bicubic(g, static_cast<float>(x), static_cast<float>(y))),
                f(x, y), 2e-5);
  }
  EXPECT_EQ(bilinear(g, -3.0F, -3.0F), g(0, 0));
  EXPECT_EQ(bilinear(g, 4.5F, 4.5F), g(4, 4));
}

TEST(Sampling, IsTheSameForPlacesTogether) {
  Grid<float> g(40, 60);
  std::uint64_t draw = 0;
  const auto uniform = [&](double lo, double hi) {
    return static_cast<float>(lo + (hi - lo) * random_uniform(12, draw++));
  };
  for (float& v : g.cells()) v = uniform(-0.2, 1.0);
  for (int i = 0; i < 4000; ++i) {
    // Side by side, hardly scaled, across rows, all over the picture and beyond it.
    const float x0 = uniform(-2.0, 55.0), y0 = uniform(-2.0, 42.0);
    const float dx = i % 4 == 0 ? 1.0F : uniform(0.9, 1.1),
                dy = i % 3 == 0 ? 0.0F : uniform(-0.1, 0.1);
    std::array<float, kSampleLanes> x, y, together;
    for (std::size_t l = 0; l < kSampleLanes; ++l) {
      x[l] = i % 5 == 4 ? uniform(-2.0, 62.0) : x0 + dx * static_cast<float>(l);
      y[l] = y0 + dy * static_cast<float>(l);
    }
    bicubic_lanes(g, x.data(), y.data(), together.data());
    for (std::size_t l = 0; l < kSampleLanes; ++l)
      ASSERT_EQ(together[l], bicubic(g, x[l], y[l])) << x[l] << ", " << y[l];
  }
}

class DistortionModels : public testing::TestWithParam<Distortion> {};

TEST_P(DistortionModels, MoveDotsAsTheFormulaSays) {
  const Distortion e = GetParam();
  Shot shot = shot_of(640, 480, 4.0);  // 68 degrees across
  shot.intrinsics.skew_px = 2.0;
  shot.intrinsics.cx_px += 11.0;
  ASSERT_THAT(check(e, shot), Succeeds());
  Frame frame = flat(640, 480, 0.0, 3);
  std::vector<Vec2> dots;
  for (int i = 0; i < 5; ++i)
    for (int j = 0; j < 7; ++j) dots.push_back({45.3 + 91.0 * j, 40.7 + 99.0 * i});
  for (auto& band : frame.bands)
    for (const Vec2 dot : dots) add_dot(band, dot);
  apply(e, shot, frame);
  double worst = 0.0, moved = 0.0;
  for (std::size_t b = 0; b < 3; ++b)
    for (const Vec2 dot : dots) {
      const Vec2 t = distorted(e, tangents(shot.intrinsics, dot), b);
      const Vec2 expected = pixel(shot.intrinsics, t);
      if (expected.x < 20 || expected.y < 20 || expected.x > 620 || expected.y > 460) continue;
      const Vec2 found = centroid(frame.bands[b], expected);
      // A dot that is stretched has its middle moved by sigma^2 / 2 times the map's curvature:
      // worked out from the formula by differences.
      const auto at = [&](double dx, double dy) {
        return pixel(shot.intrinsics,
                     distorted(e, tangents(shot.intrinsics, {dot.x + dx, dot.y + dy}), b));
      };
      double bend_x = 0.0, bend_y = 0.0;
      for (const auto& [dx, dy] : {std::pair{4.0, 0.0}, {0.0, 4.0}}) {
        const Vec2 p = at(dx, dy), m = at(-dx, -dy), o = at(0, 0);
        bend_x += (p.x + m.x - 2 * o.x) / 16.0, bend_y += (p.y + m.y - 2 * o.y) / 16.0;
      }
      // The centroid's window is as wide as the dot: half of that shift is seen, within a third.
      worst = std::max(worst, std::hypot(found.x - expected.x, found.y - expected.y) -
                                  4.0 * std::hypot(bend_x, bend_y));
      moved = std::max(moved, std::hypot(expected.x - dot.x, expected.y - dot.y));
    }
  EXPECT_LT(worst, 0.01);
  EXPECT_GT(moved, 1.0);
}

TEST_P(DistortionModels, GoThereAndBack) {
  const Distortion e = GetParam();
  for (int i = 0; i < 200; ++i) {
    const Vec2 t{1.2 * random_uniform(3, static_cast<std::uint64_t>(i)) - 0.6,
                 0.9 * random_uniform(4, static_cast<std::uint64_t>(i)) - 0.45};
    for (std::size_t b = 0; b < 3; ++b) {
      const auto back = undistorted(e, distorted(e, t, b), b);
      ASSERT_TRUE(back);
      ASSERT_NEAR(back->x, t.x, 1e-9);
      ASSERT_NEAR(back->y, t.y, 1e-9);
    }
  }
}
INSTANTIATE_TEST_SUITE_P(
    All, DistortionModels,
    testing::Values(
        Distortion{"brown_conrady", {-0.12, 0.03, 0.001, -0.0007, 0.002}, {0.0}, {}, {}},
        Distortion{"brown_conrady",
                   {0.2, 0.1, 0.0, 0.0, 0.0, 0.3, 0.05, 0.01},
                   {2e-3, 0.0, -3e-3},
                   {},
                   {}},
        Distortion{"quotient", {0.02, 0.08, 0.01}, {0.0}, {}, {}},
        Distortion{"division", {0.01, -0.1}, {0.0}, {0.012, -0.11}, {0.008, -0.09}}));

TEST(DistortionEffect, FollowsBothFormulasLiterally) {
  // X_R = X_C + (X_i - X_C) / L(r), r = 0.5: L = 1 + 0.1 * 0.5 + 0.2 * 0.25 = 1.1
  const Distortion quotient{"quotient", {0.1, 0.2}, {0.0}, {}, {}};
  EXPECT_NEAR(distorted(quotient, {0.3, 0.4}, 1).x, 0.3 / 1.1, 1e-12);
  const Distortion division{"division", {0.1, 0.2}, {0.0}, {}, {}};
  EXPECT_NEAR(undistorted(division, {0.3, 0.4}, 1)->y, 0.4 / 1.1, 1e-12);
  // OpenCV's order k1 k2 p1 p2 k3, by hand at (0.3, 0.4), r2 = 0.25.
  const Distortion brown{"brown_conrady", {0.1, -0.05, 0.01, 0.02, 0.3}, {0.0}, {}, {}};
  const double radial = 1.0 + 0.1 * 0.25 - 0.05 * 0.0625 + 0.3 * 0.015625;
  EXPECT_NEAR(distorted(brown, {0.3, 0.4}, 1).x,
              0.3 * radial + 2 * 0.01 * 0.12 + 0.02 * (0.25 + 0.18), 1e-12);
  EXPECT_NEAR(distorted(brown, {0.3, 0.4}, 1).y,
              0.4 * radial + 0.01 * (0.25 + 0.32) + 2 * 0.02 * 0.12, 1e-12);
}

TEST(DistortionEffect, TakesDepthAlongAndRefusesFolds) {
  Shot shot = shot_of(200, 160, 2.0);
  Frame frame = flat(200, 160, 1.0);
  frame.depth_mm = Grid<float>(160, 200, 1000.0F);
  frame.depth_mm(20, 20) = 7.0F;
  const Distortion e{"quotient", {0.0, 0.2}, {0.0}, {}, {}};
  apply(e, shot, frame);
  const Vec2 goal =
      pixel(shot.intrinsics, distorted(e, tangents(shot.intrinsics, {20.5, 20.5}), 1));
  EXPECT_EQ(
      frame.depth_mm(static_cast<std::ptrdiff_t>(goal.y), static_cast<std::ptrdiff_t>(goal.x)),
      7.0F);
  const auto fold = check(Distortion{"brown_conrady", {-3.0}, {0.0}, {}, {}}, shot);
  ASSERT_THAT(fold, FailsWith(kEffectOutOfRange));
  EXPECT_THAT(fold.error().message, HasSubstr("folds"));
  EXPECT_THAT(check(Distortion{"fisheye", {}, {0.0}, {}, {}}, shot), FailsWith(kEffectOutOfRange));
  EXPECT_THAT(check(Distortion{"quotient", {NAN}, {0.0}, {}, {}}, shot),
              FailsWith(kEffectOutOfRange));
}

TEST(ImageMotion, IsThatOfPointsInSpace) {
  Shot shot = shot_of(640, 480, 4.0);
  shot.intrinsics.skew_px = 3.0;
  shot.velocity_mm_s = {30.0, -20.0, 50.0};
  shot.angular_rate_rad_s = {0.02, -0.03, 0.05};
  const Vec2 px{500.0, 90.0};
  const double depth = 900.0;
  // The point in camera coordinates (y up, z backwards), then the camera moved by dt.
  const Vec2 t = tangents(shot.intrinsics, px);
  const Vec3 p = depth * normalized(Vec3{t.x, -t.y, -1.0});
  const double dt = 1e-4;
  const auto seen = [&](double time) {
    const Vec3 w = shot.angular_rate_rad_s;
    const Vec3 moved = p - time * shot.velocity_mm_s;
    const Vec3 turned = moved - time * cross(w, moved);  // first order in time
    return pixel(shot.intrinsics, {turned.x / -turned.z, -turned.y / -turned.z});
  };
  const Vec2 a = seen(-dt), b = seen(dt), flow = image_motion(shot, px, depth);
  EXPECT_NEAR(flow.x, (b.x - a.x) / (2 * dt), 1e-3 * std::abs(flow.x));
  EXPECT_NEAR(flow.y, (b.y - a.y) / (2 * dt), 1e-3 * std::abs(flow.y));
}

TEST(MotionEffects, DrawStreaksAndShearRows) {
  Shot shot = shot_of(200, 160);
  shot.exposure_s = 0.1;
  shot.angular_rate_rad_s = {0.0, 0.05, 0.0};  // about the vertical, to the left
  const double flow = image_motion(shot, {100.5, 80.5}, INFINITY).x;  // px / s
  EXPECT_NEAR(flow, shot.intrinsics.fx_px * 0.05, 0.01);
  Frame frame = flat(200, 160, 0.0);
  add_dot(frame.bands[0], {100.5, 80.5});
  Frame rows = frame;
  ASSERT_THAT(apply(MotionBlur{}, shot, frame), Succeeds());
  double sum = 0.0, square = 0.0, across = 0.0;
  for (std::ptrdiff_t r = 0; r < 160; ++r)
    for (std::ptrdiff_t c = 0; c < 200; ++c) {
      const double v = static_cast<double>(frame.bands[0](r, c)),
                   d = static_cast<double>(c) - 100.0;
      sum += v, square += v * d * d;
      across += v * std::pow(static_cast<double>(r) - 80.0, 2.0);
    }
  const double length = flow * 0.1;
  // A streak adds length^2 / 12; the bilinear samples 1 / 6 at most, the edge of the window
  // nothing.
  EXPECT_NEAR(square / sum, 4.0 + length * length / 12.0, 0.2);
  EXPECT_NEAR(across / sum, 4.0, 0.2);
  EXPECT_NEAR(sum, 8.0 * std::numbers::pi, 0.05);

  ASSERT_THAT(apply(RollingShutter{1e-3}, shot, rows), Succeeds());
  const Vec2 still = centroid(rows.bands[0], {100.5, 80.5});
  EXPECT_NEAR(still.x, 100.5 + 0.5e-3 * flow, 0.01);  // the row just below the middle
  Frame low = flat(200, 160, 0.0);
  add_dot(low.bands[0], {100.5, 130.5});
  ASSERT_THAT(apply(RollingShutter{1e-3}, shot, low), Succeeds());
  EXPECT_NEAR(centroid(low.bands[0], {100.5 + 0.0505 * flow, 130.5}).x, 100.5 + 0.0505 * flow,
              0.02);
  shot.velocity_mm_s.x = 1.0;
  EXPECT_THAT(apply(MotionBlur{}, shot, low), FailsWith(kFrame));
}

TEST(CircleOfConfusion, IsTheThinLensFormula) {
  // f = 50, F/2.8, focus 2 m, z = 3 m: A = 17.857, c = 17.857 * 50 * 1000 / (3000 * 1950)
  EXPECT_NEAR(circle_of_confusion_mm(50.0, 2.8, 2000.0, 3000.0), 0.152625, 1e-6);
  EXPECT_NEAR(circle_of_confusion_mm(50.0, 2.8, 2000.0, 1500.0), -0.152625, 1e-6);
  EXPECT_NEAR(circle_of_confusion_mm(50.0, 2.8, 2000.0, INFINITY), 50.0 / 2.8 * 50.0 / 1950.0,
              1e-9);
  EXPECT_NEAR(circle_of_confusion_mm(50.0, 2.8, INFINITY, 5000.0), -50.0 / 2.8 * 50.0 / 5000.0,
              1e-9);
  EXPECT_EQ(circle_of_confusion_mm(50.0, 2.8, 2000.0, 2000.0), 0.0);
}

class Blades : public testing::TestWithParam<int> {};

TEST_P(Blades, SpreadAPointOverTheAperturesPicture) {
  Shot shot = shot_of(121, 121, 50.0);
  shot.f_number = 2.8;
  // Depth along each ray so that all lie in one plane.
  Frame frame = flat(121, 121, 0.0);
  frame.depth_mm = Grid<float>(121, 121);
  for (std::ptrdiff_t r = 0; r < 121; ++r)
    for (std::ptrdiff_t c = 0; c < 121; ++c) {
      const Vec2 t =
          tangents(shot.intrinsics, {static_cast<double>(c) + 0.5, static_cast<double>(r) + 0.5});
      frame.depth_mm(r, c) = static_cast<float>(3000.0 * std::sqrt(1.0 + t.x * t.x + t.y * t.y));
    }
  frame.bands[0](60, 60) = 1000.0F;
  const int blades = GetParam();
  ASSERT_THAT(apply(DepthOfField{2000.0, blades, 10.0}, shot, frame), Succeeds());
  const double radius = 0.5 * circle_of_confusion_mm(50.0, 2.8, 2000.0, 3000.0) / 8.45e-3;  // 9.03
  double sum = 0.0, square = 0.0;
  int lit = 0;
  for (std::ptrdiff_t r = 0; r < 121; ++r)
    for (std::ptrdiff_t c = 0; c < 121; ++c) {
      const double v = static_cast<double>(frame.bands[0](r, c));
      sum += v, square += v * (std::pow(static_cast<double>(r) - 60.0, 2.0) +
                               std::pow(static_cast<double>(c) - 60.0, 2.0));
      lit += v > 0.5 * 1000.0 / (std::numbers::pi * radius * radius) ? 1 : 0;
    }
  EXPECT_NEAR(sum, 1000.0, 1e-2);
  // Pixels add 1/6.
  EXPECT_NEAR(square / sum / second_moment_of_opening(radius, blades), 1.0, 0.02);
  EXPECT_NEAR(lit / (std::numbers::pi * radius * radius), 1.0, 0.03);
}
INSTANTIATE_TEST_SUITE_P(All, Blades, testing::Values(0, 5, 6, 9));

/// Two planes, an edge between them at column 0: what each pixel sees of them by rays through a
/// square raster of points of the lens. @param near_left  the left one is the nearer
double through_the_lens(const Shot& shot, double focus, double z_left, double z_right,
                        double value_left, double value_right, double column_px) {
  // A ray from the lens at (u, v) to the point in focus for this pixel crosses depth z at
  // x = X (z / s) + u (1 - z / s); the edge at depth z lies at image column 0: x_edge = 0.
  const double radius = 0.5 * shot.focal_length_mm / shot.f_number;
  // Image distance for focus s: pixels' tangents refer to the focal length; thin lens keeps rays
  // through its middle straight.
  const double x_focus = column_px / shot.intrinsics.fx_px * focus;
  double sum = 0.0;
  int count = 0;
  const double z_near = std::min(z_left, z_right), z_far = std::max(z_left, z_right);
  const bool near_is_left = z_left < z_right;
  for (int i = 0; i < 200; ++i)
    for (int j = 0; j < 200; ++j) {
      const double u = radius * (2.0 * (j + 0.5) / 200.0 - 1.0);
      const double v = radius * (2.0 * (i + 0.5) / 200.0 - 1.0);
      if (u * u + v * v > radius * radius) continue;
      const auto x_at = [&](double z) { return x_focus * z / focus + u * (1.0 - z / focus); };
      const bool hits_near = (x_at(z_near) < 0.0) == near_is_left;
      sum += hits_near ? (near_is_left ? value_left : value_right)
                       : (near_is_left ? value_right : value_left);
      (void)z_far;  // the far plane goes on behind the near one
      ++count;
    }
  return sum / count;
}

TEST(DepthOfFieldEffect, IsThatOfRaysThroughTheLens) {
  Shot shot = shot_of(160, 40, 50.0);
  shot.f_number = 2.8;
  const double focus = 2000.0;
  const auto with = [&](double z_left, double z_right) {
    Frame frame = flat(160, 40, 0.0);
    frame.depth_mm = Grid<float>(40, 160);
    for (std::ptrdiff_t r = 0; r < 40; ++r)
      for (std::ptrdiff_t c = 0; c < 160; ++c) {
        const Vec2 t =
            tangents(shot.intrinsics, {static_cast<double>(c) + 0.5, static_cast<double>(r) + 0.5});
        frame.depth_mm(r, c) = static_cast<float>((c < 80 ? z_left : z_right) *
                                                  std::sqrt(1.0 + t.x * t.x + t.y * t.y));
        frame.bands[0](r, c) = c < 80 ? 1.0F : 0.2F;
      }
    EXPECT_THAT(apply(DepthOfField{focus}, shot, frame), Succeeds());
    return frame;
  };
  struct Case {
    double left, right, worst;
  };
  // A pixel of edge is 0.8 / (2 R) high with R = 9 pixels: the bound is one pixel's worth of it.
  // Where the background is hidden and blurred it is an approximation: three pixels' worth.
  for (const auto& [left, right, worst] :
       {Case{1500.0, 2000.0, 0.045}, Case{2000.0, 3000.0, 0.02}, Case{1500.0, 3000.0, 0.13}}) {
    const Frame frame = with(left, right);
    for (std::ptrdiff_t c = 45; c < 115; ++c) {
      const double expected =
          through_the_lens(shot, focus, left, right, 1.0, 0.2, static_cast<double>(c) + 0.5 - 80.0);
      EXPECT_NEAR(static_cast<double>(frame.bands[0](20, c)), expected, worst)
          << left << " " << right << " column " << c;
    }
  }
}

TEST(DepthOfFieldEffect, SaysWhatItNeeds) {
  Shot shot = shot_of(20, 20, 50.0);
  Frame frame = flat(20, 20, 1.0);
  EXPECT_THAT(apply(DepthOfField{1000.0}, shot, frame), FailsWith(kFrame));
  frame.depth_mm = Grid<float>(20, 20, 1000.0F);
  Frame same = frame;
  ASSERT_THAT(apply(DepthOfField{0.0}, shot, same), Succeeds());
  EXPECT_EQ(same.bands, frame.bands);
  shot.f_number = 0.7;
  EXPECT_THAT(apply(DepthOfField{60.0}, shot, frame), FailsWith(kEffectOutOfRange));
  EXPECT_THAT(check(DepthOfField{40.0}, shot), FailsWith(kEffectOutOfRange));
  EXPECT_THAT(check(DepthOfField{100.0, 2}, shot), FailsWith(kEffectOutOfRange));
}

TEST(VignettingEffect, IsCosineBarrelAndPolynomial) {
  Shot shot = shot_of(400, 300, 4.0);
  Vignetting e;
  e.polynomial = {-0.2, 0.03, 0.0};
  Frame frame = flat(400, 300, 1.0, 3);
  const RowFunction f = rows(e, shot, frame);
  for (std::ptrdiff_t r = 0; r < 300; ++r)
    f(r, {frame.bands[0].row(r), frame.bands[1].row(r), frame.bands[2].row(r)});
  for (const auto& [r, c] : {std::pair{0, 0}, {150, 200}, {299, 399}, {10, 330}}) {
    const double x = (c + 0.5 - 200.0), y = (r + 0.5 - 150.0), q2 = (x * x + y * y) / 62500.0;
    const double cosine = 1.0 / std::sqrt(1.0 + (x * x + y * y) * std::pow(8.45e-3 / 4.0, 2.0));
    EXPECT_NEAR(static_cast<double>(frame.bands[1](r, c)),
                std::pow(cosine, 4.0) * (1.0 - 0.2 * q2 + 0.03 * q2 * q2), 2e-6);
  }
  for (const auto& [ratio, shift] :
       {std::pair{1.2, 0.9}, {1.0, 0.5}, {2.0, 2.5}, {1.5, 0.2}, {1.0, 3.0}}) {
    int open = 0, all = 0;
    for (int i = 0; i < 2000; ++i)
      for (int j = 0; j < 2000; ++j) {
        const double x = (j + 0.5) / 1000.0 - 1.0, y = (i + 0.5) / 1000.0 - 1.0;
        if (x * x + y * y > 1.0) continue;
        ++all;
        open += std::hypot(x - shift, y) <= ratio ? 1 : 0;
      }
    EXPECT_NEAR(disc_overlap(ratio, shift), static_cast<double>(open) / all, 2e-4);
  }
  e.barrel_ratio = 0.5;
  EXPECT_THAT(check(e, shot), FailsWith(kEffectOutOfRange));
}

TEST(DiffractionEffect, OfARoundApertureIsAirys) {
  const double f_number = 16.0, lambda_nm = 550.0;
  const FineFigure fine = fine_figure(Diffraction{}, f_number, lambda_nm, 8.45);
  const std::ptrdiff_t m = fine.irradiance.rows() / 2;
  double worst = 0.0, dark = 1.0, dark_at = 0.0;
  for (std::ptrdiff_t i = 0; i < 60; ++i) {
    const double r_um = static_cast<double>(i) * fine.spacing_um;
    const double v = std::numbers::pi * r_um / (lambda_nm * 1e-3 * f_number);
    const double airy = i == 0 ? 1.0 : std::pow(2.0 * std::cyl_bessel_j(1.0, v) / v, 2.0);
    for (const double found : {fine.irradiance(m, m + i), fine.irradiance(m - i, m)})
      worst = std::max(worst, std::abs(found - airy));
    if (r_um < 13.0 && fine.irradiance(m, m + i) < dark)
      dark = fine.irradiance(m, m + i), dark_at = r_um;
  }
  EXPECT_LT(worst, 2e-3);                    // the aperture's edge is made of 246 samples
  EXPECT_NEAR(dark_at, 1.2197 * 8.8, 0.55);  // half a sample
  EXPECT_LT(dark, 2e-3);
}

TEST(DiffractionEffect, KeepsLightAndHasTheEncircledEnergy) {
  for (const int blades : {0, 5, 6}) {
    const Grid<double> figure = point_figure(Diffraction{blades, 5.0, 60.0}, 16.0, 550.0, 8.45);
    double sum = 0.0, inside = 0.0;
    for (std::ptrdiff_t i = 0; i < figure.rows(); ++i)
      for (std::ptrdiff_t j = 0; j < figure.cols(); ++j) {
        sum += figure(i, j);
        if (std::abs(i - 60) <= 8 && std::abs(j - 60) <= 8) inside += figure(i, j);
      }
    EXPECT_NEAR(sum, 1.0, 1e-12);
    // 1 - E(r) = J0^2(v) + J1^2(v) ~ 2 / (pi v): with v = 25.6 at 8.5 pixels, and the mean of the
    // larger of cosine and sine (0.900) for the square, 2.24 % lie outside; 0.31 % of the light,
    // beyond 60.5 pixels, are put in the middle; as much may be folded back by the transform.
    if (blades == 0) {
      EXPECT_NEAR(1.0 - inside, 0.0193, 0.0031);
    }
  }
}

TEST(DiffractionEffect, ThrowsRaysFromStraightBlades) {
  // Light on a ring, by direction: one ray for each blade if even, two if odd.
  for (const auto& [blades, rays] : {std::pair{6, 6}, {5, 10}, {8, 8}}) {
    const Grid<double> figure = point_figure(Diffraction{blades, 7.0, 100.0}, 16.0, 550.0, 8.45);
    std::vector<double> ring(360, 0.0);
    for (std::ptrdiff_t i = -90; i <= 90; ++i)
      for (std::ptrdiff_t j = -90; j <= 90; ++j) {
        const double r = std::hypot(i, j);
        if (r < 50 || r > 90) continue;
        const double angle =
            std::atan2(static_cast<double>(i), static_cast<double>(j)) * 180.0 / std::numbers::pi;
        ring[static_cast<std::size_t>(static_cast<int>(angle + 720.0) % 360)] +=
            figure(i + 100, j + 100) * r;
      }
    // Steps of 360 / rays: the sum over one ray's width against that between the rays.
    double on = 0.0, off = 0.0;
    for (int k = 0; k < 360; ++k) {
      const double from_ray = std::abs(std::remainder(k + 0.5 - 7.0, 360.0 / rays));
      (from_ray < 3.0 ? on : off) += ring[static_cast<std::size_t>(k)];
    }
    EXPECT_GT(on / (6.0 * rays), 4.0 * off / (360.0 - 6.0 * rays)) << blades;
  }
}

TEST(DiffractionEffect, DrawsThePointsFigure) {
  Shot shot = shot_of(161, 161);
  shot.f_number = 22.0, shot.wavelength_nm = {550.0}, shot.quantum_efficiency = {0.5};
  const Diffraction e{0, 0.0, 60.0};
  Frame frame = flat(161, 161, 0.0);
  frame.bands[0](80, 80) = 1e6F;
  apply(e, shot, frame);
  const Grid<double> figure = point_figure(e, 22.0, 550.0, 8.45);
  double sum = 0.0, far = 0.0, far_expected = 0.0;
  for (const float v : frame.bands[0].cells()) sum += static_cast<double>(v);
  EXPECT_NEAR(sum / 1e6, 1.0, 1e-4);
  for (std::ptrdiff_t i = -60; i <= 60; ++i)
    for (std::ptrdiff_t j = -60; j <= 60; ++j) {
      const double found = static_cast<double>(frame.bands[0](80 + i, 80 + j)) / 1e6;
      if (std::abs(i) <= 2 && std::abs(j) <= 2) {
        EXPECT_NEAR(found, figure(60 + i, 60 + j), 2e-3) << i << " " << j;
      }
      if (std::hypot(i, j) > 24.0) far += found, far_expected += figure(60 + i, 60 + j);
    }
  // Blocks widen the figure by 6.7 square pixels along each axis; r^-3 then has 6.7 / 2 * 9 / r^2
  // more: 5 % at 24 pixels, less beyond.
  EXPECT_NEAR(far / far_expected, 1.0, 0.05);
  // An even picture stays.
  Frame even = flat(50, 41, 0.7);
  apply(e, shot, even);
  for (const float v : even.bands[0].cells()) ASSERT_NEAR(static_cast<double>(v), 0.7, 1e-4);
}

TEST(VeilingGlareEffect, SpreadsItsShareEvenly) {
  const Shot shot = shot_of(100, 80);
  Frame frame = flat(100, 80, 0.0);
  for (std::ptrdiff_t r = 0; r < 40; ++r)
    for (std::ptrdiff_t c = 0; c < 100; ++c) frame.bands[0](r, c) = 1.0F;
  apply(VeilingGlare{0.04}, shot, frame);
  EXPECT_NEAR(static_cast<double>(frame.bands[0](70, 3)), 0.02, 1e-7);
  EXPECT_NEAR(static_cast<double>(frame.bands[0](3, 3)), 0.98, 1e-7);
  EXPECT_THAT(check(VeilingGlare{1.5}, shot), FailsWith(kEffectOutOfRange));
}

}  // namespace
}  // namespace maquette::camera
