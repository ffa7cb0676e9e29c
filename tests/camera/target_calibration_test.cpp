// SPDX-License-Identifier: GPL-3.0-or-later

// camera/target_calibration.hpp, camera/vignetting_fit.hpp. Points are projected by formulas
// written out here (OpenCV's for Brown and Conrady; X_R = X_C + (X_i - X_C) / L(r)), noise is
// std::'s:
//   exact points ......... every parameter back; the distorted grid to 1e-4 px (goal 0.01)
//   noisy points ......... the grid all over the picture within the noise of one point
//   uncertainties ........ 200 calibrations: deviations over stated uncertainties scatter by 1
//   both laws, plane targets and points in space, a poor start, skew and aspect
//   mismatched points .... left out and named; others not
//   what is not determined names itself; bad input
//   vignetting ........... polynomial and barrel from blocks with noise; slopes of the light;
//                          coverage

#include "camera/target_calibration.hpp"

#include <cmath>
#include <random>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "camera/vignetting_fit.hpp"
#include "support/matchers.hpp"
#include "support/shots.hpp"

namespace maquette::camera {
namespace {

using testing::HasSubstr;
using testing_support::FailsWith;
using testing_support::Succeeds;

/// What is hidden from the calibration.
struct Truth {
  double fx = 4100.0, fy = 4100.0, cx = 2140.0, cy = 1400.0, skew = 0.0;
  bool quotient = false;
  std::vector<double> k{-0.08, 0.05, 4e-4, -3e-4, 0.0};
};

Vec2 seen_by(const Truth& t, Vec3 p) {
  const double x = p.x / p.z, y = p.y / p.z;
  const auto k = [&](std::size_t i) { return i < t.k.size() ? t.k[i] : 0.0; };
  double u = 0.0, v = 0.0;
  if (t.quotient) {
    const double r = std::sqrt(x * x + y * y);
    double l = 1.0;
    for (std::size_t i = 0; i < t.k.size(); ++i) l += t.k[i] * std::pow(r, double(i + 1));
    u = x / l, v = y / l;
  } else {
    const double r2 = x * x + y * y;
    const double g = 1.0 + k(0) * r2 + k(1) * r2 * r2 + k(4) * r2 * r2 * r2;
    u = x * g + 2.0 * k(2) * x * y + k(3) * (r2 + 2.0 * x * x);
    v = y * g + k(2) * (r2 + 2.0 * y * y) + 2.0 * k(3) * x * y;
  }
  return {t.fx * u + t.skew * v + t.cx, t.fy * v + t.cy};
}

/// A board of 9 x 7 points, 40 mm apart, at several angles; or points in a cube.
std::vector<TargetPoint> pictures(const Truth& t, int views, double noise_px, unsigned seed,
                                  bool in_space = false) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  std::vector<TargetPoint> points;
  for (int view = 0; view < views; ++view) {
    const double turn_x = 0.5 * std::cos(2.4 * view), turn_y = 0.5 * std::sin(2.4 * view);
    const Quaternion q = rotation_about({0, 0, 1}, 0.4 * view) * rotation_about({1, 0, 0}, turn_x) *
                         rotation_about({0, 1, 0}, turn_y);
    const Vec3 shift{50.0 * uniform(random), 40.0 * uniform(random), 480.0 + 60.0 * (view % 3)};
    for (int i = 0; i < 63; ++i) {
      Vec3 p{40.0 * (i % 9) + 1000.0, 40.0 * double(i / 9) - 500.0, 25.0};
      if (in_space)
        p = {1160.0 + 150.0 * uniform(random), -380.0 + 110.0 * uniform(random),
             25.0 + 80.0 * uniform(random)};
      const Vec3 at = rotate(q, p - Vec3{1160.0, -380.0, 25.0}) + shift;
      Vec2 px = seen_by(t, at);
      px.x += noise_px * normal(random), px.y += noise_px * normal(random);
      if (px.x > 0.0 && px.x < 4256.0 && px.y > 0.0 && px.y < 2832.0)
        points.push_back({p, px, view});
    }
  }
  return points;
}

Intrinsics start_at(double f_px) {
  Intrinsics k;
  k.width_px = 4256, k.height_px = 2832, k.fx_px = k.fy_px = f_px;
  k.cx_px = 2128.0, k.cy_px = 1416.0;
  return k;
}

/// The farthest that a grid of field angles all over the picture lies off, pixels, after the turn
/// of the camera (radians) that fits best, if `turned`: a shift of the principal point is all but a
/// turn, which the poses take up.
double grid_error(const Truth& t, const TargetCalibration& c, bool turned = false) {
  std::vector<Vec3> rays;
  for (int i = 0; i <= 20; ++i)
    for (int j = 0; j <= 14; ++j) rays.push_back({-0.45 + 0.045 * i, -0.3 + 0.3 / 7.0 * j, 1.0});
  const auto off = [&](Vec3 ray, Vec3 turn) {
    const Vec3 to = ray + cross(turn, ray);
    const Vec2 found = pixel(c.intrinsics, distorted(c.distortion, {to.x / to.z, to.y / to.z}, 1));
    const Vec2 truth = seen_by(t, ray);
    return Vec2{found.x - truth.x, found.y - truth.y};
  };
  Vec3 turn;
  for (int round = 0; turned && round < 30; ++round)
    // One angle after the other: they are all but independent.
    for (double Vec3::*axis : {&Vec3::x, &Vec3::y, &Vec3::z}) {
      double slope = 0.0, square = 0.0;
      for (const Vec3& ray : rays) {
        constexpr double kStep = 1e-6;
        Vec3 more = turn;
        more.*axis += kStep;
        const Vec2 at = off(ray, turn), next = off(ray, more);
        const double du = (next.x - at.x) / kStep, dv = (next.y - at.y) / kStep;
        slope += du * at.x + dv * at.y, square += du * du + dv * dv;
      }
      turn.*axis -= slope / square;
    }
  double worst = 0.0;
  for (const Vec3& ray : rays) {
    const Vec2 d = off(ray, turn);
    worst = std::max(worst, std::hypot(d.x, d.y));
  }
  return worst;
}

struct Case {
  const char* name;
  bool quotient, in_space, aspect, skew;
  double start;
};
class ExactPoints : public testing::TestWithParam<Case> {};

TEST_P(ExactPoints, GiveTheCameraBack) {
  const Case& p = GetParam();
  Truth t;
  if (p.quotient) t.quotient = true, t.k = {0.02, 0.06};
  if (p.aspect) t.fy = 4080.0;
  if (p.skew) t.skew = 3.0;
  TargetOptions o;
  o.distortion = p.quotient ? "quotient" : "brown_conrady";
  o.coefficients = p.quotient ? 2 : 5;
  o.aspect = p.aspect, o.skew = p.skew;
  const auto c = calibrate_targets(pictures(t, 8, 0.0, 5, p.in_space), start_at(p.start), o);
  ASSERT_THAT(c, Succeeds());
  EXPECT_NEAR(c->focal_px.value, t.fx, 1e-4);
  EXPECT_NEAR(c->cx_px.value, t.cx, 1e-4);
  EXPECT_NEAR(c->cy_px.value, t.cy, 1e-4);
  EXPECT_NEAR(c->aspect.value, t.fy / t.fx, 1e-8);
  EXPECT_NEAR(c->skew_px.value, t.skew, 1e-4);
  for (std::size_t i = 0; i < c->coefficients.size(); ++i)
    EXPECT_NEAR(c->coefficients[i].value, t.k[i], 1e-6) << i;
  EXPECT_LT(grid_error(t, *c), 1e-4);
}
INSTANTIATE_TEST_SUITE_P(Cameras, ExactPoints,
                         testing::Values(Case{"Plane", false, false, false, false, 4000.0},
                                         Case{"Space", false, true, false, false, 4000.0},
                                         Case{"QuotientPlane", true, false, false, false, 4000.0},
                                         Case{"QuotientSpace", true, true, false, false, 4500.0},
                                         Case{"AspectAndSkew", false, false, true, true, 4000.0},
                                         Case{"PoorStart", false, false, false, false, 1800.0},
                                         Case{"PoorStartFar", false, true, false, false, 9000.0}),
                         [](const auto& p) { return p.param.name; });

TEST(TargetCalibrationOf, KeepsTheGridOfNoisyPoints) {
  // 0.03 px a coordinate, as circles are found, in 60 pictures. The grid reaches beyond what the
  // boards cover: 0.013 px at its worst, with the noise of one coordinate as bound.
  const Truth t;
  const auto c = calibrate_targets(pictures(t, 60, 0.03, 11), start_at(4000.0), {});
  ASSERT_THAT(c, Succeeds());
  EXPECT_NEAR(c->noise_px, 0.03, 0.001);
  EXPECT_NEAR(c->cx_px.value, t.cx, 4.0 * c->cx_px.u);
  const double error = grid_error(t, *c, true);
  RecordProperty("grid_error_px", fmt::format("{:.4f}", error));
  RecordProperty("with_turn_px", fmt::format("{:.4f}", grid_error(t, *c)));
  EXPECT_LT(error, 0.03);  // the noise of one coordinate
}

TEST(TargetCalibrationOf, StatesUncertaintiesThatHold) {
  // 200 sets of pictures: root mean square of (value - truth) / u is 1 +- 0.05.
  const Truth t;
  std::vector<double> square;
  constexpr int kSets = 200;
  std::vector<std::string> names;
  for (int i = 0; i < kSets; ++i) {
    const auto c = calibrate_targets(pictures(t, 6, 0.1, static_cast<unsigned>(100 + i)),
                                     start_at(4000.0), {});
    ASSERT_THAT(c, Succeeds());
    std::vector<std::pair<Measured, double>> all{
        {c->focal_px, t.fx}, {c->cx_px, t.cx}, {c->cy_px, t.cy}};
    for (std::size_t k = 0; k < 5; ++k) all.emplace_back(c->coefficients[k], t.k[k]);
    square.resize(all.size(), 0.0);
    for (std::size_t k = 0; k < all.size(); ++k)
      square[k] += std::pow((all[k].first.value - all[k].second) / all[k].first.u, 2.0) / kSets;
    names = c->names;
  }
  for (std::size_t k = 0; k < square.size(); ++k) {
    RecordProperty(names[k], fmt::format("{:.3f}", std::sqrt(square[k])));
    EXPECT_GT(std::sqrt(square[k]), 0.8) << names[k];  // four of 0.05
    EXPECT_LT(std::sqrt(square[k]), 1.2) << names[k];
  }
}

TEST(TargetCalibrationOf, LeavesMismatchedPointsOut) {
  const Truth t;
  auto points = pictures(t, 8, 0.05, 21);
  const std::vector<std::size_t> wrong{17, 100, 255, 301};
  for (const std::size_t i : wrong) points[i].seen_px.x += 3.0, points[i].seen_px.y -= 40.0;
  const auto c = calibrate_targets(points, start_at(4000.0), {});
  ASSERT_THAT(c, Succeeds());
  std::vector<std::size_t> left;
  for (const auto& r : c->residuals)
    if (r.left_out) left.push_back(r.point);
  EXPECT_EQ(left, wrong);
  EXPECT_NEAR(c->focal_px.value, t.fx, 4.0 * c->focal_px.u);
}

TEST(TargetCalibrationOf, RefusesWhatDoesNotSayIt) {
  const Truth t;
  const auto fails = [&](const std::vector<TargetPoint>& points, const char* says,
                         const TargetOptions& o = {}) {
    const auto c = calibrate_targets(points, start_at(4000.0), o);
    EXPECT_THAT(c, FailsWith(kCalibrationTargets)) << says;
    if (!c) {
      EXPECT_THAT(c.error().message, HasSubstr(says));
    }
  };
  fails({}, "no points");
  fails(pictures(t, 1, 0.0, 1), "cannot be told apart");
  auto points = pictures(t, 4, 0.0, 1);
  points[3].seen_px.x = NAN;
  fails(points, "not finite");
  points = pictures(t, 4, 0.0, 1);
  auto few = points;
  std::erase_if(few, [](const TargetPoint& p) { return p.view == 2 && p.target_mm.x > 1010.0; });
  std::erase_if(few, [](const TargetPoint& p) { return p.view == 2 && p.target_mm.y > -410.0; });
  fails(few, "at least 4");
  auto line = points;
  std::erase_if(line, [](const TargetPoint& p) { return p.view == 2 && p.target_mm.x > 1010.0; });
  fails(line, "on one line");
  std::vector<TargetPoint> little;
  for (const std::size_t i : {0U, 8U, 54U, 62U, 31U}) little.push_back(points[i]);
  for (const std::size_t i : {63U, 71U, 117U, 125U}) little.push_back(points[i]);
  fails(little, "unknowns");
  // Looking straight at a plane from one distance: focal length and distance are one.
  std::vector<TargetPoint> straight;
  for (int view = 0; view < 4; ++view)
    for (int i = 0; i < 63; ++i) {
      const Vec3 p{40.0 * (i % 9), 40.0 * double(i / 9), 0.0};
      straight.push_back({p, seen_by(t, p + Vec3{-160.0 + 5.0 * view, -120.0, 500.0}), view});
    }
  fails(straight, "do not say what");
  // Any order of places: no camera.
  auto shuffled = points;
  std::mt19937_64 random(2);
  for (auto& p : shuffled)
    p.seen_px = {4000.0 * std::uniform_real_distribution<double>()(random),
                 2800.0 * std::uniform_real_distribution<double>()(random)};
  EXPECT_FALSE(calibrate_targets(shuffled, start_at(4000.0), {}));
  TargetOptions o;
  o.coefficients = 9;
  EXPECT_THAT(calibrate_targets(points, start_at(4000.0), o), FailsWith(kEffectOutOfRange));
  o = {};
  o.distortion = "division";
  EXPECT_THAT(calibrate_targets(points, start_at(4000.0), o), FailsWith(kEffectOutOfRange));
}

/// Blocks of flats whose law is written out here.
template <class Law>
std::vector<FlatBlock> flats(const Shot& shot, const Law& law, double noise, unsigned seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  std::vector<FlatBlock> blocks;
  const auto& k = shot.intrinsics;
  for (int flat = 0; flat < 2; ++flat)
    for (int plane = 0; plane < 2; ++plane)
      for (int y = 16; y < k.height_px; y += 32)
        for (int x = 16; x < k.width_px; x += 32) {
          const double r = std::hypot(x - k.cx_px, y - k.cy_px);
          const double slope = flat == 0 ? 0.04 * (double(x) / k.width_px - 0.5) : 0.0;
          blocks.push_back({flat,
                            plane,
                            {double(x), double(y)},
                            (3000.0 + 2000.0 * plane) * (1.0 + slope) * law(r) *
                                (1.0 + noise * normal(random))});
        }
  return blocks;
}

TEST(VignettingFitOf, FindsThePolynomial) {
  const Shot shot = testing_support::shot_of(1200, 800, 10.0);
  const double f = shot.intrinsics.fx_px, half = 0.5 * std::hypot(1200.0, 800.0);
  const auto law = [&](double r) {
    const double q2 = r * r / (half * half);
    return std::pow(std::cos(std::atan(r / f)), 4.0) * (1.0 - 0.2 * q2 + 0.05 * q2 * q2);
  };
  std::array<double, 3> square{};
  constexpr int kSets = 30;
  for (int i = 0; i < kSets; ++i) {
    const auto v = fit_vignetting(flats(shot, law, 1e-3, static_cast<unsigned>(i + 1)), shot,
                                  "polynomial", 4.0);
    ASSERT_THAT(v, Succeeds());
    const std::array<double, 3> truth{-0.2, 0.05, 0.0};
    for (std::size_t k = 0; k < 3; ++k)
      square[k] += std::pow((v->parameters[k].value - truth[k]) / v->parameters[k].u, 2.0) / kSets;
    EXPECT_NEAR(v->slopes[0].x, 0.04, 1e-3);
    EXPECT_NEAR(v->slopes[1].x, 0.0, 1e-3);
    EXPECT_NEAR(v->rms, 1e-3, 1e-4);
    for (const double r : {0.0, 300.0, 700.0})  // what matters: the law itself
      EXPECT_NEAR(fall_of_light(v->vignetting, shot, {600.0 + r, 400.0}), law(r), 2e-4);
  }
  for (const double s : square) {  // 30 sets: 1 +- 0.13
    EXPECT_GT(std::sqrt(s), 0.5);
    EXPECT_LT(std::sqrt(s), 1.5);
  }
}

TEST(VignettingFitOf, FindsTheBarrel) {
  const Shot shot = testing_support::shot_of(1200, 800, 10.0);
  const double f = shot.intrinsics.fx_px, ratio = 1.2, shift = 0.9;
  // Two discs' common area by summing up, not by the room's formula.
  const auto law = [&](double r) {
    const double d = shift * r / f;
    double open = 0.0;
    constexpr int kSteps = 4000;
    for (int i = 0; i < kSteps; ++i) {
      const double x = -1.0 + 2.0 * (i + 0.5) / kSteps;
      const double a = std::sqrt(1.0 - x * x);
      const double b2 = ratio * ratio - (x - d) * (x - d);
      open += 2.0 * std::min(a, b2 > 0.0 ? std::sqrt(b2) : 0.0) * 2.0 / kSteps;
    }
    return std::pow(1.0 + r * r / (f * f), -2.0) * open / std::numbers::pi;
  };
  const auto v = fit_vignetting(flats(shot, law, 1e-3, 4), shot, "barrel", 4.0);
  ASSERT_THAT(v, Succeeds());
  EXPECT_NEAR(v->parameters[0].value, ratio, 4.0 * v->parameters[0].u + 1e-4);
  EXPECT_NEAR(v->parameters[1].value, shift, 4.0 * v->parameters[1].u + 1e-4);
  EXPECT_LT(v->parameters[0].u, 0.01);
}

TEST(VignettingFitOf, RefusesFlatsThatAreNone) {
  const Shot shot = testing_support::shot_of(1200, 800, 10.0);
  const auto blocks = flats(
      shot, [](double) { return 1.0; }, 1e-3, 1);
  EXPECT_THAT(fit_vignetting({blocks.begin(), blocks.begin() + 20}, shot, "polynomial", 4.0),
              FailsWith(kCalibrationFrames));
  EXPECT_THAT(fit_vignetting(blocks, shot, "window", 4.0), FailsWith(kEffectOutOfRange));
  FrameSeries burnt;
  Grid<float> frame(64, 64, 255.0F);
  add_frame(burnt, frame, 255.0);
  EXPECT_THAT(flat_blocks(burnt, nullptr, 0.0, 0, 32), FailsWith(kCalibrationFrames));
  FrameSeries dark;
  add_frame(dark, Grid<float>(64, 64, 10.0F), 255.0);
  EXPECT_THAT(flat_blocks(dark, nullptr, 20.0, 0, 32), FailsWith(kCalibrationFrames));
}

}  // namespace
}  // namespace maquette::camera
