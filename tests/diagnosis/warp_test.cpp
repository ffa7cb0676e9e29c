// SPDX-License-Identifier: GPL-3.0-or-later

// A block that bends and twists after it was cut, over a plane far below: the middles of the balls
// that cut it go with the material (support/zigzag_part.hpp), up by w and sideways by their height
// over that plane times the slope of w.

#include <cmath>

#include <gtest/gtest.h>

#include "diagnosis/diagnose.hpp"
#include "support/zigzag_part.hpp"

namespace maquette::diagnosis {
namespace {

using namespace zigzag_part;

TEST(Warp, OverAPlaneFarBelowIsNoScaleAndNoShear) {
  constexpr double kAlongX_mm = 0.06, kTwist_mm = -0.1, kDepth_mm = 25.0, kWhite_mm = 0.02;
  constexpr double kMiddle_mm = 0.5 * kSide_mm, kLevel_mm = 10.0;  // of the part's box
  constexpr std::uint64_t kSeed = 20'261'135;
  const auto passes = command();
  auto cut = passes;
  for (auto& pass : cut)
    for (Vec3& tip : pass) {
      const double x = (tip.x - kMiddle_mm) / kMiddle_mm, y = (tip.y - kMiddle_mm) / kMiddle_mm,
                   above = tip.z + kRadius_mm - (kLevel_mm - kDepth_mm);
      tip = tip + Vec3{-above * (2.0 * kAlongX_mm * x + kTwist_mm * y) / kMiddle_mm,
                       -above * kTwist_mm * x / kMiddle_mm, kAlongX_mm * x * x + kTwist_mm * x * y};
    }
  const auto c = only_cause(passes, cut, kWhite_mm, kSeed);
  ASSERT_TRUE(c.has_value());
  ASSERT_EQ(c->effect, "stock.warp");
  ASSERT_EQ(c->parameters.size(), 3U) << c->law;
  const double per_m = 1000.0 / (kMiddle_mm * kMiddle_mm);
  EXPECT_NEAR(c->parameters[0].value, kAlongX_mm * per_m, 4.0 * c->parameters[0].sigma);
  EXPECT_NEAR(c->parameters[1].value, 0.0, 4.0 * c->parameters[1].sigma);
  EXPECT_NEAR(c->parameters[2].value, kTwist_mm * per_m, 4.0 * c->parameters[2].sigma);
  EXPECT_LT(c->parameters[2].sigma, 0.03 * std::abs(kTwist_mm) * per_m);
  ASSERT_EQ(c->fixed.size(), 1U);
  EXPECT_NEAR(c->fixed[0].second, kDepth_mm, 3.0);
}

}  // namespace
}  // namespace maquette::diagnosis
