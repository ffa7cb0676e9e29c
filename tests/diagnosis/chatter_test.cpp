// SPDX-License-Identifier: GPL-3.0-or-later

// A cutter that swings, on a surface that is the least of dense samples of the balls
// (support/zigzag_part.hpp).
//
//   for a while ...... the only cause, with its size and the moments of both ends; not steps at
//       these beside a wave of a fifth of its size; consistent once it is known
//   all the while .... the only cause; no lag beside it, though its crests curve as the ball does

#include <cmath>
#include <numbers>
#include <utility>

#include <gtest/gtest.h>

#include "diagnosis/diagnose.hpp"
#include "support/zigzag_part.hpp"

namespace maquette::diagnosis {
namespace {

using namespace zigzag_part;

constexpr double kSize_mm = 0.08, kWave_mm = 3.3, kWhite_mm = 0.02;

/// Tips that swing upright, by the way along the path.
Passes swinging(Passes passes, std::size_t first, std::size_t last) {
  double way_mm = 0.0;
  Vec3 before = passes[0][0];
  for (std::size_t k = 0; k < passes.size(); ++k)
    for (Vec3& tip : passes[k]) {
      way_mm += norm(tip - std::exchange(before, tip));
      if (k >= first && k < last)
        tip.z += kSize_mm * std::sin(2.0 * std::numbers::pi * way_mm / kWave_mm + 0.7);
    }
  return passes;
}

double size_mm(const Cause& chatter) {
  return std::hypot(chatter.parameters.at(0).value, chatter.parameters.at(1).value);
}

TEST(Chatter, ForAWhileIsOneCause) {
  constexpr std::size_t kFirst = 37, kLast = 86;
  constexpr std::uint64_t kSeed = 20'261'140;
  const auto passes = command();
  const auto c = only_cause(passes, swinging(passes, kFirst, kLast), kWhite_mm, kSeed);
  ASSERT_TRUE(c.has_value());
  EXPECT_EQ(c->effect, "process.chatter") << c->law;
  // A fit comes to rest within a few hundredths of a size that answers to a fifth of itself.
  EXPECT_NEAR(size_mm(*c), kSize_mm, 0.1 * kSize_mm);
  const auto count = static_cast<double>(passes.size());
  const double duration_min = written(passes).duration_min();
  ASSERT_EQ(c->fixed.size(), 3U) << c->law;
  EXPECT_EQ(c->fixed[1].first, "from_min");
  EXPECT_EQ(c->fixed[2].first, "to_min");
  EXPECT_NEAR(c->fixed[1].second / duration_min, kFirst / count, 1.0 / count);
  EXPECT_NEAR(c->fixed[2].second / duration_min, kLast / count, 1.0 / count);
  // Once it is known it is cut as it was found.
  auto rest =
      part(written(passes), swinging(passes, kFirst, kLast), std::nullopt, kWhite_mm, kSeed);
  ASSERT_TRUE(take_off({as_known(*c)}, rest));
  const auto again = diagnose(std::move(rest), 1);
  ASSERT_TRUE(again.has_value());
  EXPECT_EQ(again->verdict, "consistent") << (again->causes.empty() ? "" : again->causes[0].law);
}

TEST(Chatter, AllTheWhileHasNoLagBesideIt) {
  constexpr std::uint64_t kSeed = 20'261'141;
  const auto passes = command();
  const auto c = only_cause(passes, swinging(passes, 0, passes.size()), kWhite_mm, kSeed);
  ASSERT_TRUE(c.has_value());
  EXPECT_EQ(c->effect, "process.chatter") << c->law;
  EXPECT_NEAR(size_mm(*c), kSize_mm, 0.1 * kSize_mm);
}

}  // namespace
}  // namespace maquette::diagnosis
