// SPDX-License-Identifier: GPL-3.0-or-later

// What is claimed in scan/register.hpp, and how each claim is attacked:
//
//   finds the pose ................... exact points: to the rounding of the design's floats
//   captures 20 mm and 5 degrees ..... 12 seeds on 1 m, from the pose given alone
//   any pose ......................... 12 seeds: any turn and shift, upside down, half a
//                                      part, with and without station
//   states its covariance truly ...... 120 seeds: errors scaled by it are chi-squared, with
//                                      independent noise and with correlated roughness
//   below 1/50 of the point spacing .. the same seeds, and 3 sigma along each unknown
//   names what relief leaves free .... plane, tilted plane, ridge, cylinder, sphere; nothing
//                                      else moves
//   estimates scale .................. a scan grown by 0.1 %
//   resists outliers ................. 5 % of points off by millimetres
//   absorbs a constant offset ........ a lifted cloud registers back onto the design: the
//                                      trap that deviate.hpp states
//   refuses .......................... too few points, wrong unit, a line of points, false
//                                      minima, mirrored, other parts, cancelled
//   same bits for any threads ........ one against many
//   pose columns ..................... against finite differences of deviations

#include <cmath>
#include <numbers>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <oneapi/tbb/global_control.h>
#include <Eigen/Dense>

#include "scan/deviate.hpp"
#include "scan/register.hpp"
#include "support/matchers.hpp"
#include "support/scan_terrain.hpp"

namespace maquette::scan {
namespace {

using heightmap::ModelField;
using testing_support::FailsWith;
using testing_support::points_on;
using testing_support::random_pose;
using testing_support::rough_part;
using testing_support::seen_from;
using testing_support::Succeeds;

constexpr double kDegree = std::numbers::pi / 180.0;

RegisterOptions near_only() {
  RegisterOptions options;
  options.anywhere = false;
  return options;
}

/// How far the found pose takes points from where they belong.
double worst_error(const Cloud& truth, const Cloud& seen, const RigidTransform& found) {
  double worst = 0.0;
  for (std::size_t i = 0; i < truth.points_mm.size(); ++i)
    worst = std::max(worst, norm(found.point(seen.points_mm[i]) - truth.points_mm[i]));
  return worst;
}

class RegisterSeeded : public testing::TestWithParam<int> {
 protected:
  [[nodiscard]] std::uint64_t seed() const { return static_cast<std::uint64_t>(GetParam()); }
};
INSTANTIATE_TEST_SUITE_P(Seed, RegisterSeeded, testing::Range(1, 13));

TEST_P(RegisterSeeded, CapturesTwentyMillimetresAndFiveDegrees) {
  // A part of 1 m with 2.5 mm nodes, 0.05 mm noise; the rim starts up to 64 mm off.
  const ModelField part = rough_part(seed(), 401, 401, 2.5);
  const Cloud truth = points_on(part, 40'000, seed(), 0.05);
  const RigidTransform pose = random_pose(seed(), {500.0, 500.0, 10.0}, 5.0 * kDegree, 20.0);
  const Cloud seen = seen_from(truth, pose);
  const auto found = register_scan(seen, part, near_only());
  ASSERT_THAT(found, Succeeds());
  EXPECT_FALSE(found->found_anywhere);
  EXPECT_TRUE(found->free_directions.empty());
  EXPECT_LE(found->last_step_sigmas, 0.25);
  // 4 standard deviations of the stated covariance at the rim.
  EXPECT_LT(worst_error(truth, seen, found->model_from_scan),
            4.0 * (found->sigma_translation_mm + 710.0 * found->sigma_rotation_rad));
  // Residuals are along the normal: below the vertical noise by the mean cosine of slope.
  EXPECT_NEAR(found->rms_after_mm, 0.049, 0.002);
  EXPECT_GT(found->rms_before_mm, 0.5);
  EXPECT_NEAR(found->noise_mm, 0.049, 0.002);
  EXPECT_GT(found->overlap, 0.99);
  EXPECT_NEAR(found->likeness, 1.0, 0.01);
}

TEST_P(RegisterSeeded, FindsAnyPose) {
  const ModelField part = rough_part(seed() + 50, 251, 301, 2.0);
  Cloud truth = points_on(part, 30'000, seed(), 0.1);
  if (seed() % 3 == 0)  // a station that saw half of it
    std::erase_if(truth.points_mm, [](Vec3 p) { return p.x > 330.0; });
  // Without a station above and below must be found from the relief.
  if (seed() % 2 == 0) truth.station_mm = Vec3{300.0, -800.0, 900.0};
  const RigidTransform pose = random_pose(seed(), {300.0, 250.0, 10.0},
                                          std::numbers::pi * random_uniform(seed(), 77), 5000.0);
  const Cloud seen = seen_from(truth, pose);
  const auto found = register_scan(seen, part);
  ASSERT_THAT(found, Succeeds());
  EXPECT_TRUE(found->found_anywhere);
  EXPECT_LT(worst_error(truth, seen, found->model_from_scan),
            4.0 * (found->sigma_translation_mm + 400.0 * found->sigma_rotation_rad));
}

TEST(Register, SeesOverRidgesFromCoarseLevels) {
  // Waves of equal height from 240 down to 6 mm, and 15 mm off: on the full design alone
  // most of these end in a neighbouring valley.
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    const ModelField part = rough_part(seed, 201, 241, 1.0, 0.2, 0.0);
    const Cloud truth = points_on(part, 30'000, seed, 0.05);
    const Cloud seen =
        seen_from(truth, random_pose(seed, {120.0, 100.0, 10.0}, 2.0 * kDegree, 15.0));
    const auto found = register_scan(seen, part);
    ASSERT_THAT(found, Succeeds()) << "seed " << seed;
    EXPECT_LT(worst_error(truth, seen, found->model_from_scan), 0.02) << "seed " << seed;
  }
}

TEST(Register, FindsExactPointsExactly) {
  const ModelField part = rough_part(3, 151, 181, 1.0);
  const Cloud truth = points_on(part, 20'000, 4);
  const Cloud seen = seen_from(truth, random_pose(5, {90.0, 75.0, 10.0}, 1.0 * kDegree, 2.0));
  const auto found = register_scan(seen, part);
  ASSERT_THAT(found, Succeeds());
  // The surface that the points lie on is the very surface of the design; what remains
  // is where the iteration comes to rest (1e-6 mm) times a few.
  EXPECT_LT(worst_error(truth, seen, found->model_from_scan), 1e-5);
  EXPECT_LT(found->rms_after_mm, 1e-5);
}

TEST(Register, ThePoseInTheFileMayBeRightAlready) {
  const ModelField part = rough_part(3, 101, 101, 1.0);
  const auto found = register_scan(points_on(part, 5'000, 4, 0.02), part);
  ASSERT_THAT(found, Succeeds());
  EXPECT_LT(norm(found->model_from_scan.translation_mm), 0.02);
}

/// The error of a pose as motion of the model: translation of the centre, rotation about it.
Eigen::Matrix<double, 6, 1> error_of(const Registration& found, const RigidTransform& truth) {
  const RigidTransform error = found.model_from_scan * truth;
  const Vec3 shift = error.point(found.centre_mm) - found.centre_mm;
  Eigen::Matrix<double, 6, 1> e;
  e << shift.x, shift.y, shift.z, 2.0 * error.rotation.x, 2.0 * error.rotation.y,
      2.0 * error.rotation.z;
  return e;
}

struct Calibration {
  double chi2 = 0.0;
  int beyond = 0;  ///< unknowns off by more than three standard deviations
  double worst_share_of_spacing = 0.0, effective_share = 0.0;
};

/// @param roughness_mm  of waves of some 12 mm that the part has and the design has not
Calibration calibrate(int runs, double roughness_mm) {
  Calibration c;
  for (int k = 0; k < runs; ++k) {
    const auto seed = static_cast<std::uint64_t>(100 + k);
    const ModelField part = rough_part(seed, 201, 201, 1.0);
    Cloud truth = points_on(part, 40'000, seed, 0.02);
    if (roughness_mm > 0.0) {
      const ModelField rough = rough_part(seed + 1000, 101, 101, 2.0, 1.0, 0.0);
      // Only its short waves: the difference from what is left after smoothing over 20 mm.
      for (Vec3& p : truth.points_mm) {
        double mean = 0.0;
        for (int i = -2; i <= 2; ++i)
          for (int j = -2; j <= 2; ++j)
            mean += heightmap::height_at(rough, std::clamp(p.x + 5.0 * i, 0.0, 200.0),
                                         std::clamp(p.y + 5.0 * j, 0.0, 200.0)) /
                    25.0;
        p.z += roughness_mm * (heightmap::height_at(rough, p.x, p.y) - mean);
      }
    }
    const RigidTransform pose = random_pose(seed, {100.0, 100.0, 10.0}, 0.2 * kDegree, 0.5);
    const auto found = register_scan(seen_from(truth, pose), part);
    EXPECT_THAT(found, Succeeds()) << "seed " << seed;
    if (!found) continue;
    const auto e = error_of(*found, pose);
    const Eigen::Matrix<double, 6, 6> covariance =
        Eigen::Map<const Eigen::Matrix<double, 6, 6>>(found->covariance.data());
    c.chi2 += e.dot(covariance.ldlt().solve(e));
    for (Eigen::Index i = 0; i < 6; ++i)
      if (std::abs(e(i)) > 3.0 * std::sqrt(covariance(i, i))) ++c.beyond;
    c.worst_share_of_spacing = std::max(c.worst_share_of_spacing, e.head<3>().norm() / 1.0);
    c.effective_share += found->effective_points / 40'000.0 / runs;
  }
  return c;
}

TEST(Register, StatesItsCovarianceTruly) {
  // Sum over 60 seeds of e' C^-1 e, six unknowns each: chi-squared with 360 degrees of
  // freedom, standard deviation 27; four of them to either side. Points are 1 mm apart.
  const Calibration c = calibrate(60, 0.0);
  RecordProperty("chi2", std::to_string(c.chi2));
  EXPECT_GT(c.chi2, 360.0 - 4.0 * 27.0);
  EXPECT_LT(c.chi2, 360.0 + 4.0 * 27.0);
  EXPECT_LE(c.beyond, 4) << "of 360, 1 is expected";
  EXPECT_LT(c.worst_share_of_spacing, 1.0 / 50.0);
  EXPECT_GT(c.effective_share, 0.9);
}

TEST(Register, CountsCorrelatedRoughnessAsTheFewerObservationsItIs) {
  // Taken as independent, the errors would be many times their stated deviations. Blocks are
  // few and hold some 95 % of the correlation, so that the chi-squared may be half as large again.
  const Calibration c = calibrate(60, 0.02);
  RecordProperty("chi2", std::to_string(c.chi2));
  EXPECT_LT(c.chi2, 1.5 * 360.0);
  EXPECT_GT(c.chi2, 0.4 * 360.0);
  EXPECT_LE(c.beyond, 8);
  EXPECT_LT(c.effective_share, 0.3);
}

TEST(Register, EstimatesScaleWhereAsked) {
  const ModelField part = rough_part(3, 201, 201, 1.0);
  Cloud grown = points_on(part, 40'000, 4, 0.02);
  for (Vec3& p : grown.points_mm) p = 1.001 * p;
  RegisterOptions options;
  options.scale = true;
  const auto found = register_scan(grown, part, options);
  ASSERT_THAT(found, Succeeds());
  EXPECT_NEAR(1.0 / found->scale, 1.001, 5.0 * found->sigma_scale);
  EXPECT_LT(found->sigma_scale, 2e-5);
  EXPECT_GT(found->sigma_scale, 0.0);
  const auto rigid = register_scan(grown, part);
  ASSERT_THAT(rigid, Succeeds());
  EXPECT_EQ(rigid->scale, 1.0);
  EXPECT_GT(rigid->noise_mm, found->noise_mm);
}

// A least sum of squares shrinks a scan and its noise: by the noise's variance over that of the
// columns, here 7e-4, five to ten of the stated deviations.
TEST(Register, EstimatesScaleWithoutThePullOfNoise) {
  constexpr int kRuns = 40;
  double square = 0.0, sum = 0.0;
  for (std::uint64_t seed = 1; seed <= kRuns; ++seed) {
    const ModelField part = rough_part(seed, 151, 151, 1.0);
    Cloud grown = points_on(part, 20'000, seed, 0.3);
    for (Vec3& p : grown.points_mm) p = 1.001 * p;
    RegisterOptions options;
    options.scale = true;
    const auto found = register_scan(grown, part, options);
    ASSERT_THAT(found, Succeeds()) << "seed " << seed;
    const double e = (1.001 * found->scale - 1.0) / found->sigma_scale;
    sum += e;
    square += e * e;
  }
  RecordProperty("chi2", std::to_string(square));
  // 40 degrees of freedom: 0.1 % beyond 73.4, and below 17.9; a mean of more than four of its
  // deviations is no chance.
  EXPECT_LT(square, 73.4);
  EXPECT_GT(square, 17.9);
  EXPECT_LT(std::abs(sum / kRuns), 4.0 / std::sqrt(kRuns));
}

TEST(Register, PoseColumnsAreTheDerivativesOfDeviations) {
  const Vec3 p{30.0, -20.0, 7.0}, centre{5.0, 6.0, 1.0};
  const Vec3 n = normalized(Vec3{0.2, -0.3, 0.9});
  const auto j = pose_columns(p, n, centre);
  const double h = 1e-6;
  const Vec3 axes[3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  for (std::size_t k = 0; k < 3; ++k) {
    EXPECT_NEAR(j[k], dot(axes[k], n), 1e-12);
    const Vec3 turned = centre + rotate(rotation_about(axes[k], h), p - centre);
    EXPECT_NEAR(j[3 + k], dot(turned - p, n) / h, 1e-4);
  }
  EXPECT_NEAR(j[6], dot((1.0 + h) * (p - centre) + centre - p, n) / h, 1e-6);
  Registration r;
  r.centre_mm = centre;
  r.covariance[0] = 0.04;          // x, 0.2 mm
  r.covariance[6 * 5 + 5] = 1e-6;  // about z, 1 mrad
  EXPECT_NEAR(pose_sigma_mm(r, p, n), std::hypot(0.2 * j[0], 1e-3 * j[5]), 1e-12);
}

TEST(Register, ResistsOutliers) {
  const ModelField part = rough_part(7, 151, 151, 1.0);
  Cloud truth = points_on(part, 20'000, 8, 0.03);
  const Cloud clean = truth;
  for (std::size_t i = 0; i < truth.points_mm.size(); i += 20)
    truth.points_mm[i].z += 3.0 + 4.0 * random_uniform(9, i);
  const RigidTransform pose = random_pose(10, {75.0, 75.0, 10.0}, 1.0 * kDegree, 3.0);
  const auto found = register_scan(seen_from(truth, pose), part);
  ASSERT_THAT(found, Succeeds());
  // One-sided outliers of share q shift Huber's estimate by up to 1.345 sigma q / (1 - q),
  // here about 0.002 mm; least squares would be 0.25 mm off.
  EXPECT_LT(worst_error(clean, seen_from(clean, pose), found->model_from_scan), 0.02);
}

TEST(Register, AbsorbsAConstantOffset) {
  // Stated as a trap in the header: 0.3 mm of coating on a gentle part goes into the pose.
  const ModelField part = rough_part(11, 151, 151, 1.0, 0.2);
  Cloud coated = points_on(part, 20'000, 12, 0.01);
  for (Vec3& p : coated.points_mm) p.z += 0.3;
  const auto found = register_scan(coated, part);
  ASSERT_THAT(found, Succeeds());
  EXPECT_NEAR(found->model_from_scan.translation_mm.z, -0.3, 0.02);
  const auto with = deviate(coated, found->model_from_scan, part);
  const auto without = deviate(coated, {}, part);
  ASSERT_THAT(with, Succeeds());
  ASSERT_THAT(without, Succeeds());
  EXPECT_NEAR(with->statistics.mean_mm, 0.0, 0.005);
  EXPECT_NEAR(without->statistics.mean_mm, 0.3, 0.005);
  EXPECT_THAT(to_json(with->statistics, &*found), testing::HasSubstr("absorbs constant offsets"));
  EXPECT_THAT(to_json(without->statistics, nullptr), testing::Not(testing::HasSubstr("absorbs")));
}

// ---- what relief leaves free -----------------------------------------------

ModelField shaped(double (*height)(double, double)) {
  ModelField f{Grid<float>(101, 121), Millimetres{1.0}};
  for (std::ptrdiff_t r = 0; r < 101; ++r)
    for (std::ptrdiff_t c = 0; c < 121; ++c)
      f.z_mm(r, c) = static_cast<float>(height(f.x_mm(c), f.y_mm(r)));
  return f;
}

TEST(RegisterFree, APlaneLeavesThreeDirections) {
  const ModelField plane = shaped([](double, double) { return 5.0; });
  Cloud cloud = points_on(plane, 5'000, 1, 0.02);
  // Lifted by 1 mm and tilted by 0.01 rad about x; both must come back.
  for (Vec3& p : cloud.points_mm) p.z += 1.0 + 0.01 * (p.y - 50.0);
  const auto found = register_scan(cloud, plane);
  ASSERT_THAT(found, Succeeds());
  EXPECT_THAT(found->free_directions,
              testing::ElementsAre("translation x", "translation y", "rotation z"));
  EXPECT_LT(found->rms_after_mm, 0.022);
  EXPECT_NEAR(found->model_from_scan.rotation.z, 0.0, 1e-6) << "held, not wandering";
  EXPECT_NEAR(found->model_from_scan.point({60.0, 50.0, 6.0}).x, 60.0, 0.02);
}

TEST(RegisterFree, ATiltedPlaneLeavesItsOwnDirections) {
  const ModelField plane = shaped([](double x, double) { return 0.5 * x; });
  const auto found = register_scan(points_on(plane, 5'000, 1, 0.02), plane);
  ASSERT_THAT(found, Succeeds());
  EXPECT_THAT(found->free_directions,
              testing::ElementsAre("translation along (0.89, 0.00, 0.45)", "translation y",
                                   "rotation about (-0.45, 0.00, 0.89)"));
}

TEST(RegisterFree, ARidgeLeavesItsLength) {
  const ModelField ridge =
      shaped([](double x, double) { return 8.0 * std::exp(-(x - 60.0) * (x - 60.0) / 200.0); });
  const auto found = register_scan(points_on(ridge, 5'000, 1, 0.02), ridge);
  ASSERT_THAT(found, Succeeds());
  EXPECT_THAT(found->free_directions, testing::ElementsAre("translation y"));
}

TEST(RegisterFree, ACylinderLeavesItsAxis) {
  const ModelField cylinder =
      shaped([](double, double y) { return std::sqrt(80.0 * 80.0 - (y - 50.0) * (y - 50.0)); });
  const auto found = register_scan(points_on(cylinder, 20'000, 1, 0.02), cylinder);
  ASSERT_THAT(found, Succeeds());
  ASSERT_EQ(found->free_directions.size(), 2U);
  EXPECT_EQ(found->free_directions[0], "translation x");
  EXPECT_THAT(found->free_directions[1], testing::StartsWith("rotation about x through ("));
  EXPECT_THAT(found->free_directions[1], testing::HasSubstr(", 50.0, 0.0)"));
}

TEST(RegisterFree, ASphereLeavesTurnsAboutItsCentre) {
  const ModelField cap = shaped([](double x, double y) {
    return std::sqrt(90.0 * 90.0 - (x - 60.0) * (x - 60.0) - (y - 50.0) * (y - 50.0)) - 20.0;
  });
  const auto found = register_scan(points_on(cap, 20'000, 1, 0.02), cap);
  ASSERT_THAT(found, Succeeds());
  ASSERT_EQ(found->free_directions.size(), 3U);
  for (const std::string& name : found->free_directions)
    EXPECT_THAT(name, testing::HasSubstr("through (60.0, 50.0, -20."));
}

TEST(RegisterFree, APlaneIsNeverSaidToBeKnown) {
  // Whatever the noise: covariance is zero along what is held, and the list is not empty.
  for (const double sigma : {0.0, 0.001, 0.5}) {
    const ModelField plane = shaped([](double, double) { return 5.0; });
    const auto found = register_scan(points_on(plane, 2'000, 2, sigma), plane);
    ASSERT_THAT(found, Succeeds());
    EXPECT_EQ(found->free_directions.size(), 3U) << sigma;
    EXPECT_NEAR(found->covariance[0], 0.0, 1e-20);
  }
}

// ---- refusals --------------------------------------------------------------

TEST(RegisterRefuses, TooFewPoints) {
  const ModelField part = rough_part(1, 51, 51, 1.0);
  EXPECT_THAT(register_scan(points_on(part, 29, 1), part), FailsWith(kTooFewPoints));
  Cloud aside = points_on(part, 1'000, 1);
  for (Vec3& p : aside.points_mm) p.x += 100.0;
  EXPECT_THAT(register_scan(aside, part, near_only()), FailsWith(kTooFewPoints));
}

TEST(RegisterRefuses, TheWrongUnitAndSaysWhich) {
  const ModelField part = rough_part(1, 101, 101, 1.0);
  const Cloud good = points_on(part, 1'000, 1);
  for (const auto& [factor, name] : std::vector<std::pair<double, const char*>>{
           {1e-3, "metres"}, {1.0 / 25.4, "inches"}, {1e3, "micrometres"}}) {
    Cloud slipped = good;
    for (Vec3& p : slipped.points_mm) p = factor * p;
    slipped.points_mm[17] = {1e5, 1e5, 1e5};  // a stray point must not hide it
    const auto found = register_scan(slipped, part);
    ASSERT_THAT(found, FailsWith(kUnitSlip));
    EXPECT_THAT(found.error().message, testing::HasSubstr(name));
  }
  // A scan of a tenth of the part is just that.
  Cloud corner;
  for (const Vec3& p : good.points_mm)
    if (p.x < 30.0 && p.y < 30.0) corner.points_mm.push_back(p);
  EXPECT_THAT(register_scan(corner, part), Succeeds());
}

TEST(RegisterRefuses, PointsOnALine) {
  const ModelField part = rough_part(1, 101, 101, 1.0);
  Cloud line;
  for (int i = 0; i < 1'000; ++i) {
    const double x = 1.0 + 0.09 * i;
    line.points_mm.push_back({x, 50.0, heightmap::height_at(part, x, 50.0)});
  }
  const ModelField plane = shaped([](double, double) { return 5.0; });
  for (Vec3& p : line.points_mm) p.z = 5.0;
  const auto found = register_scan(line, plane, near_only());
  ASSERT_THAT(found, FailsWith(kUnderDetermined));
  EXPECT_THAT(found.error().message, testing::HasSubstr("rotation x"));
}

TEST(RegisterRefuses, AnotherPart) {
  // Same kind of ground, other seed: there is a best place, and it means nothing.
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    const ModelField part = rough_part(seed, 151, 151, 1.0);
    const ModelField other = rough_part(seed + 100, 151, 151, 1.0);
    EXPECT_THAT(register_scan(points_on(other, 10'000, 1, 0.02), part), FailsWith(kPoorFit))
        << "seed " << seed;
  }
}

TEST(RegisterRefuses, AMirroredScanAndSaysSo) {
  for (std::uint64_t seed = 1; seed <= 2; ++seed) {
    const ModelField part = rough_part(seed, 151, 151, 1.0);
    Cloud cloud = seen_from(points_on(part, 20'000, seed, 0.02),
                            random_pose(seed, {75.0, 75.0, 10.0}, 1.0, 300.0));
    if (seed % 2 == 0) cloud.station_mm = Vec3{0.0, 0.0, 5000.0};
    for (Vec3& p : cloud.points_mm) p.y = -p.y;
    if (cloud.station_mm)  // where the scanner stood, in the same wrong frame
      cloud.station_mm = [&] {
        Vec3 s = random_pose(seed, {75.0, 75.0, 10.0}, 1.0, 300.0).point({75.0, 75.0, 900.0});
        s.y = -s.y;
        return s;
      }();
    EXPECT_THAT(register_scan(cloud, part), FailsWith(kMirrored)) << "seed " << seed;
  }
}

TEST(RegisterRefuses, FalseMinimaFarFromThePose) {
  // 80 mm off on waves of equal height: wherever it comes to rest, it must be the truth or
  // a refusal, never a wrong pose that is said to have converged.
  int refused = 0;
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    const ModelField part = rough_part(seed, 201, 241, 1.0, 0.2, 0.0);
    const Cloud truth = points_on(part, 20'000, seed, 0.05);
    const Cloud seen =
        seen_from(truth, random_pose(seed, {120.0, 100.0, 10.0}, 2.0 * kDegree, 80.0));
    const auto found = register_scan(seen, part, near_only());
    if (!found) {
      EXPECT_THAT(found, testing::AnyOf(FailsWith(kPoorFit), FailsWith(kTooFewPoints)));
      ++refused;
      continue;
    }
    EXPECT_LT(worst_error(truth, seen, found->model_from_scan), 0.05) << "seed " << seed;
  }
  EXPECT_GE(refused, 2);
}

TEST(RegisterRefuses, ButNotNoiseOrMissingStones) {
  // Relief of 0.05 mm under 0.2 mm of noise, and a stone of the design that fell off.
  ModelField part = rough_part(9, 151, 151, 1.0, 0.05);
  const Cloud cloud = points_on(part, 50'000, 3, 0.2);
  for (std::ptrdiff_t r = 60; r < 75; ++r)
    for (std::ptrdiff_t c = 60; c < 75; ++c) part.z_mm(r, c) += 12.0F;
  const auto found = register_scan(cloud, part);
  EXPECT_THAT(found, Succeeds()) << (found ? "" : found.error().message);
}

TEST(RegisterRefuses, AHalfTurnIfItMayOnlyLookNear) {
  const ModelField part = rough_part(5, 151, 151, 1.0);
  const RigidTransform turned{rotation_about({0.0, 0.0, 1.0}, std::numbers::pi),
                              {150.0, 150.0, 0.0}};
  const Cloud truth = points_on(part, 10'000, 1, 0.02), seen = seen_from(truth, turned);
  EXPECT_THAT(register_scan(seen, part, near_only()), FailsWith(kPoorFit));
  const auto found = register_scan(seen, part);
  ASSERT_THAT(found, Succeeds());
  EXPECT_LT(worst_error(truth, seen, found->model_from_scan), 0.02);
}

TEST(RegisterRefuses, ToCallAPoseFoundThatStillMoves) {
  const ModelField part = rough_part(3, 151, 151, 1.0);
  const Cloud seen =
      seen_from(points_on(part, 40'000, 4, 0.05), random_pose(5, {75.0, 75.0, 10.0}, 0.01, 2.0));
  RegisterOptions once;
  once.most_iterations = 1;
  const auto found = register_scan(seen, part, once);
  ASSERT_THAT(found, FailsWith(kNotConverged));
  EXPECT_THAT(found.error().message, testing::HasSubstr("after 1 iterations"));
}

TEST(RegisterRefuses, ToGoOnWhenStopped) {
  const ModelField part = rough_part(1, 51, 51, 1.0);
  std::stop_source stop;
  stop.request_stop();
  RunContext run;
  run.stop = stop.get_token();
  EXPECT_THAT(register_scan(points_on(part, 1'000, 1), part, {}, run), FailsWith(kCancelled));
}

TEST(Register, GivesTheSameBitsForAnyNumberOfThreads) {
  const ModelField part = rough_part(6, 151, 151, 1.0);
  const Cloud seen =
      seen_from(points_on(part, 60'000, 7, 0.05), random_pose(8, {75, 75, 10}, 0.01, 1.0));
  const auto with_threads = [&](std::size_t n) {
    const oneapi::tbb::global_control limit(oneapi::tbb::global_control::max_allowed_parallelism,
                                            n);
    return register_scan(seen, part);
  };
  const auto one = with_threads(1), four = with_threads(4);
  ASSERT_THAT(one, Succeeds());
  ASSERT_THAT(four, Succeeds());
  EXPECT_EQ(one->model_from_scan, four->model_from_scan);
  EXPECT_EQ(one->covariance, four->covariance);
}

// Noise along the normal that grows eightfold with range and incidence, as behind a low scanner:
// with the scanner's place known the pose is better, and its covariance stays true.
TEST(RegisterWeights, CountPointsByTheirNoise) {
  double plain2 = 0.0, weighted2 = 0.0, chi2 = 0.0;
  constexpr int kRuns = 24;
  for (std::uint64_t seed = 1; seed <= kRuns; ++seed) {
    const ModelField part = rough_part(seed, 201, 201, 1.0);
    Cloud truth = points_on(part, 30'000, seed);
    const Vec3 station{100.0, -60.0, 60.0};
    for (std::size_t i = 0; i < truth.points_mm.size(); ++i) {
      Vec3& p = truth.points_mm[i];
      const double range = norm(station - p);
      p.z += 0.02 * std::pow(range / 100.0, 2.0) * random_normal(seed + 9, i);
    }
    const RigidTransform pose = random_pose(seed, {100.0, 100.0, 10.0}, 0.02, 3.0);
    Cloud seen = seen_from(truth, pose);
    const auto plain = register_scan(seen, part);
    seen.station_mm = pose.point(station);
    const auto weighted = register_scan(seen, part);
    ASSERT_THAT(plain, Succeeds());
    ASSERT_THAT(weighted, Succeeds());
    const auto off2 = [&](const Registration& r) {
      double sum = 0.0;
      for (std::size_t i = 0; i < truth.points_mm.size(); i += 100) {
        const Vec3 e = r.model_from_scan.point(seen.points_mm[i]) - truth.points_mm[i];
        sum += dot(e, e);
      }
      return sum;
    };
    plain2 += off2(*plain);
    weighted2 += off2(*weighted);
    const RigidTransform error = weighted->model_from_scan * pose;
    const Vec3 shift = error.point(weighted->centre_mm) - weighted->centre_mm;
    Eigen::Matrix<double, 6, 1> e;
    e << shift.x, shift.y, shift.z, 2.0 * error.rotation.x, 2.0 * error.rotation.y,
        2.0 * error.rotation.z;
    chi2 += e.dot(
        Eigen::Map<const Eigen::Matrix<double, 6, 6>>(weighted->covariance.data()).ldlt().solve(e));
  }
  EXPECT_LT(std::sqrt(weighted2 / plain2), 0.8);
  // 144 degrees of freedom: 0.1 % beyond 202.
  EXPECT_LT(chi2, 202.0);
  EXPECT_GT(chi2, 95.0);
}

}  // namespace
}  // namespace maquette::scan
