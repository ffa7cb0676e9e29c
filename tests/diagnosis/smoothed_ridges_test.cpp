// SPDX-License-Identifier: GPL-3.0-or-later

// A part that lies as it was designed, without the ridges that the simulated cut leaves between
// passes: a scanner whose spot is wider than a stepover sees none.
//
//   a scale that moves passes by half a stepover ... the only cause, with its size; ridges that are
//       not there are nowhere else when the part moves

#include <gtest/gtest.h>

#include "diagnosis/diagnose.hpp"
#include "support/zigzag_part.hpp"

namespace maquette::diagnosis {
namespace {

using namespace zigzag_part;

TEST(SmoothedRidges, AreNowhereElseWhenThePartMoves) {
  constexpr double kScale = 0.009, kWhite_mm = 0.01, kMiddle_mm = 0.5 * kSide_mm;
  constexpr std::uint64_t kSeed = 20'261'130;
  const auto passes = command();
  auto m = part(written(passes), passes, std::nullopt, 0.0, kSeed);
  for (std::size_t i = 0; i < m.observations.size(); ++i) {
    Observation& o = m.observations[i];
    const auto above_mm = [&](double x) { return o.place.z - ground_mm(x, o.place.y); };
    o.milled_minus_design_mm = o.normal.z * above_mm(o.place.x);
    // Where the ball's tip would have been that has cut the place.
    double from = o.place.x;
    for (int k = 0; k < 8; ++k)
      from =
          o.place.x - kScale * (from + kRadius_mm * slope_normal(from, o.place.y).x - kMiddle_mm);
    o.residual_mm = -o.normal.z * above_mm(from) + kWhite_mm * random_normal(kSeed + 1, i);
  }
  const auto d = diagnose(std::move(m), 1);
  ASSERT_TRUE(d.has_value());
  EXPECT_EQ(d->verdict, "explained");
  ASSERT_EQ(d->causes.size(), 1U) << d->causes.back().effect << ": " << d->causes.back().law;
  const Cause& c = d->causes[0];
  EXPECT_EQ(c.effect, "machine.scale_x") << c.law;
  // A scale is taken where the part is seen, not where it was before: 0.9 %, and its own error.
  EXPECT_NEAR(c.parameters.at(0).value, 1e6 * kScale,
              0.009 * 1e6 * kScale + 3.0 * c.parameters.at(0).sigma);
}

}  // namespace
}  // namespace maquette::diagnosis
