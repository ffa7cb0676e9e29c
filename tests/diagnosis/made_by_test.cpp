// SPDX-License-Identifier: GPL-3.0-or-later

// Which pass made a place: the one whose ball touches it, or, of a much finer cutter, the one just
// above (diagnosis/case_input.hpp, MadeBy).
//
//   the place above ................... nearest of dense samples of the program in plan
//   lost motion of the passes above ... named, and that it is of the passes above
//   their controls .................... give the lost motion back with its size
//   the same, declared to be the ball's ... is not read as theirs

#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>

#include "core/random.hpp"
#include "diagnosis/controls.hpp"
#include "diagnosis/diagnose.hpp"
#include "support/zigzag_part.hpp"

namespace maquette::diagnosis {
namespace {

using namespace zigzag_part;

constexpr std::uint64_t kSeed = 20'261'130;

TEST(PlaceAbove, IsTheNearestInPlan) {
  const auto passes = command();
  const CutPath path = written(passes);
  for (std::uint64_t i = 0; i < 300; ++i) {
    const double x = kSide_mm * random_uniform(kSeed, 2 * i),
                 y = kSide_mm * random_uniform(kSeed, 2 * i + 1);
    const auto above = path.above(x, y);
    ASSERT_TRUE(above.has_value());
    double nearest = INFINITY;
    Vec3 tip;
    for (const auto& pass : passes)
      for (const Vec3& p : pass)
        if (const double d = std::hypot(p.x - x, p.y - y); d < nearest) {
          nearest = d;
          tip = p;
        }
    EXPECT_LE(std::hypot(above->tip.x - x, above->tip.y - y), nearest + 1e-4);
    // Half a sample along a pass of up to 80 degrees.
    EXPECT_LT(norm(above->tip - tip), 3.0 * kSample_mm) << x << ' ' << y;
  }
  EXPECT_FALSE(path.above(-3.0 * kRadius_mm, 0.0).has_value());
}

/// A part that lies as designed but for what `moves(state above)` moves of it.
template <class Moves>
Measurements literally(const Moves& moves, double white_mm) {
  const auto passes = command();
  const CutPath path = written(passes);
  auto m = part(path, passes, std::nullopt, 0.0, kSeed);
  for (std::size_t i = 0; i < m.observations.size(); ++i) {
    Observation& o = m.observations[i];
    const double above_mm = o.place.z - ground_mm(o.place.x, o.place.y);
    o.milled_minus_design_mm = o.normal.z * above_mm;
    const Vec3 moved = moves(*path.above(o.place.x, o.place.y));
    o.residual_mm = o.normal.z * (dot(o.slope_normal, moved) / o.slope_normal.z - above_mm) +
                    white_mm * random_normal(kSeed + 1, i);
  }
  return m;
}

Measurements shifted_by_direction() {
  return literally(
      [](const CutState& s) {
        return Vec3{s.feed.x > 0.0 ? 0.05 : -0.05, 0.0, 0.0};
      },
      0.02);
}

TEST(MadeByTip, LostMotionIsFound) {
  const auto d = diagnose(shifted_by_direction(), 1);
  ASSERT_TRUE(d.has_value());
  EXPECT_EQ(d->contact, MadeBy::tip);
  ASSERT_EQ(d->causes.size(), 1U);
  EXPECT_EQ(d->causes[0].effect, "machine.backlash_x");
  EXPECT_TRUE(d->causes[0].law.starts_with("overcompensation")) << d->causes[0].law;
  // Axes turn within a width of the ends alone; 2 % are far beyond what noise leaves.
  EXPECT_NEAR(d->causes[0].parameters.at(0).value, 0.1, 0.002);
  EXPECT_TRUE(std::ranges::any_of(
      d->notes, [](const auto& n) { return n.find("finer cutter") != std::string::npos; }));
}

TEST(MadeByTip, ItsControlsGiveItBack) {
  const auto m = shifted_by_direction();
  const auto d = diagnose(m, 1);
  ASSERT_TRUE(d.has_value());
  const auto c = controls(m, *d, 1);
  ASSERT_TRUE(c.has_value());
  EXPECT_EQ(c->null_verdict, "consistent");
  EXPECT_TRUE(c->false_claims.empty());
  ASSERT_EQ(c->recoveries.size(), 1U);
  EXPECT_EQ(c->recoveries[0].named_as, "machine.backlash_x");
  ASSERT_EQ(c->recoveries[0].sizes.size(), 1U);
  // As the found size above.
  EXPECT_NEAR(c->recoveries[0].sizes[0].found, c->recoveries[0].sizes[0].injected, 0.002);
}

TEST(MadeByTip, IsNotLookedForWhereTheCaseSaysOtherwise) {
  auto m = shifted_by_direction();
  m.contact = MadeBy::ball;
  const auto d = diagnose(std::move(m), 1);
  ASSERT_TRUE(d.has_value());
  EXPECT_EQ(d->contact, MadeBy::ball);
}

}  // namespace
}  // namespace maquette::diagnosis
