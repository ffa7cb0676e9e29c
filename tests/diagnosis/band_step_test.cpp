// SPDX-License-Identifier: GPL-3.0-or-later

// Two bands that do not meet in height, the second higher or deeper than the first, on a surface
// that is the least of dense samples of the balls (support/zigzag_part.hpp).
//
//   no noise ................. places beside the border move as predicted within 4 %; to first
//       order more than a fifth of what they move is missed
//   beside a bent guide ...... both are named, the step with its height
//   0.5 mm aside ............. measured within 3 %, from its moment on

#include <algorithm>
#include <cmath>
#include <optional>

#include <gtest/gtest.h>

#include "diagnosis/detail/forms.hpp"
#include "diagnosis/diagnose.hpp"
#include "diagnosis/effect.hpp"
#include "support/zigzag_part.hpp"

namespace maquette::diagnosis {
namespace {

using namespace zigzag_part;

/// Of 121 passes, from y = 30 mm on: in the middle of the part, where blocks of sets might end.
constexpr std::size_t kFirstOfBand = 60;

Passes stepped(Passes passes, double step_mm) {
  for (std::size_t k = kFirstOfBand; k < passes.size(); ++k)
    for (Vec3& tip : passes[k]) tip.z += step_mm;
  return passes;
}

/// A guide that is bent: Legendre's polynomial of degree 4 along y, upright.
Passes bent(Passes passes, double size_mm) {
  for (auto& pass : passes)
    for (Vec3& tip : pass) tip.z += size_mm * detail::legendre(4, 2.0 * tip.y / kSide_mm - 1.0);
  return passes;
}

class BandStep : public testing::TestWithParam<double> {};
INSTANTIATE_TEST_SUITE_P(Step_mm, BandStep, testing::Values(0.09, -0.09));

TEST_P(BandStep, IsSeenWhereTheDeeperBallReaches) {
  const double step_mm = GetParam();
  const auto passes = command();
  const CutPath path = written(passes, {kFirstOfBand});
  const Measurements m = part(path, stepped(passes, step_mm), std::nullopt, 0.0, 1);
  ASSERT_EQ(m.scene.section_starts.size(), 1U);
  const auto step = [&](double size_mm) {
    return detail::step_after(2, m.scene.section_starts[0], "step_mm", size_mm, kRadius_mm);
  };
  const Column first_order = step(0.0), as_is = step(step_mm);
  double moved = 0.0, missed = 0.0, left = 0.0;
  for (const Observation& o : m.observations) {
    // 3 mm times the sine of the steepest slope and what a ball reaches over.
    if (std::abs(o.place.y - 30.0) > 3.0) continue;
    const double off_mm = step_mm * as_is.value(o) - o.residual_mm,
                 first_mm = step_mm * first_order.value(o) - o.residual_mm;
    moved += o.residual_mm * o.residual_mm;
    left += off_mm * off_mm;
    missed += first_mm * first_mm;
  }
  EXPECT_LT(std::sqrt(left / moved), 0.04);
  EXPECT_GT(std::sqrt(missed / moved), 0.2);
}

TEST_P(BandStep, IsFoundInTheMiddleOfThePartBesideABentGuide) {
  const double step_mm = GetParam();
  constexpr double kBent_mm = 0.05, kWhite_mm = 0.03;
  constexpr std::uint64_t kSeed = 20'261'128;
  const auto passes = command();
  const CutPath path = written(passes, {kFirstOfBand});
  const auto d = diagnose(
      part(path, stepped(bent(passes, kBent_mm), step_mm), std::nullopt, kWhite_mm, kSeed), 1);
  ASSERT_TRUE(d.has_value());
  EXPECT_EQ(d->verdict, "explained");
  ASSERT_EQ(d->causes.size(), 2U) << "seed " << kSeed;
  const auto named = [&](const char* effect) {
    return std::find_if(d->causes.begin(), d->causes.end(),
                        [&](const Cause& c) { return c.effect == effect; });
  };
  ASSERT_TRUE(named("process.band_step") != d->causes.end());
  EXPECT_TRUE(named("machine.straightness_y") != d->causes.end());
  const Estimate& size = named("process.band_step")->parameters[0];
  EXPECT_NEAR(size.value, step_mm, 4.0 * size.sigma);
  EXPECT_LT(size.sigma, 0.05 * std::abs(step_mm));
}

// On slopes of 0.6 a ball 0.5 mm aside is 0.3 mm deeper and reaches over the border by four passes:
// to first order the border seems to be there, and what lies between contradicts the step.
TEST(StepAside, IsMeasuredFromItsMomentOn) {
  constexpr double kStep_mm = 0.5, kWhite_mm = 0.03, kStretch = 4.0;
  constexpr std::size_t kFirstAside = 71;
  constexpr std::uint64_t kSeed = 20'261'129;
  const auto passes = command(kStretch);
  auto cut = passes;
  for (std::size_t k = kFirstAside; k < cut.size(); ++k)
    for (Vec3& tip : cut[k]) tip.x += kStep_mm;
  const CutPath path = written(passes);
  const auto d = diagnose(part(path, cut, std::nullopt, kWhite_mm, kSeed, kStretch), 1);
  ASSERT_TRUE(d.has_value());
  EXPECT_EQ(d->verdict, "explained");
  ASSERT_EQ(d->causes.size(), 1U) << "seed " << kSeed;
  EXPECT_EQ(d->causes[0].effect, "machine.step_loss_x");
  const Estimate& size = d->causes[0].parameters[0];
  EXPECT_NEAR(size.value, kStep_mm, 0.03 * kStep_mm);
  EXPECT_LT(size.sigma, 0.02 * kStep_mm);
}

}  // namespace
}  // namespace maquette::diagnosis
