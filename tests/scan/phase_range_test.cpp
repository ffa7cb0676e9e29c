// SPDX-License-Identifier: GPL-3.0-or-later

// What is claimed in scan/phase_range.hpp, and how each claim is attacked:
//
//   sum of phasors ....... two surfaces: the triangle's angle by the law of sines, not by complex
//                          numbers; steps below and above half an interval
//   coarse to fine ....... single surfaces over the whole range; beyond the coarsest it wraps
//   the mean suffices .... just below and above the limit of the spread both agree within the
//                          claim; amplitudes of any unit

#include "scan/phase_range.hpp"

#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/random.hpp"

namespace maquette::scan {
namespace {

constexpr std::array kIntervals{79'000.0, 9'875.0, 1'234.375};

TEST(PhaseRange, FindsOneSurfaceAtAnyRange) {
  // Three returns at a spread that keeps the phasors busy: symmetric, so the middle is exact.
  for (std::uint64_t i = 0; i < 2000; ++i) {
    const double r = 20.0 + 78'900.0 * random_uniform(1, i);
    const std::array returns{BeamReturn{r - 8.0, 0.3}, BeamReturn{r, 0.4},
                             BeamReturn{r + 8.0, 0.3}};
    EXPECT_NEAR(phase_range(returns, kIntervals).range_mm, r, 1e-6 + 1e-12 * r);
    const std::array one{BeamReturn{r, 2.0}};
    EXPECT_NEAR(phase_range(one, kIntervals).range_mm, r, 1e-9);
    EXPECT_EQ(phase_range(one, kIntervals).amplitude, 2.0);
  }
  const std::array beyond{BeamReturn{79'000.0 + 1234.0, 1.0}};
  EXPECT_NEAR(phase_range(beyond, kIntervals).range_mm, 1234.0, 1e-9);
  const std::array none{BeamReturn{5.0, 0.0}};
  EXPECT_EQ(phase_range(none, kIntervals).amplitude, 0.0);
}

TEST(PhaseRange, OfTwoSurfacesIsTheAngleOfTheTriangle) {
  const double u = kIntervals.back();
  for (const double step : {10.0, 50.0, 200.0, 500.0, 600.0})
    for (const double share : {0.05, 0.25, 0.5, 0.75, 0.95}) {
      // Of the far surface's phasor against the near one's: law of sines and cosines.
      const double turn = 2.0 * std::numbers::pi * step / u;
      const double length = std::sqrt(share * share + (1 - share) * (1 - share) +
                                      2 * share * (1 - share) * std::cos(turn));
      double angle = std::asin(share * std::sin(turn) / length);
      if ((1 - share) + share * std::cos(turn) < 0.0) angle = std::numbers::pi - angle;
      const std::array returns{BeamReturn{2000.0, 7.0 * (1 - share)},
                               BeamReturn{2000.0 + step, 7.0 * share}};
      const PhaseRange found = phase_range(returns, kIntervals);
      EXPECT_NEAR(found.range_mm, 2000.0 + u * angle / (2.0 * std::numbers::pi), 1e-6)
          << step << " " << share;
      EXPECT_NEAR(found.amplitude, 7.0 * length, 1e-9);
    }
}

TEST(PhaseRange, LeavesTheTwoSurfacesWhereTheStepIsMoreThanHalfAnInterval) {
  // 1000 of 1234 mm: by the fine phase the far one seems 234 mm in front of the near one, and
  // the coarser ones say which multiple: the mixed pixel may lie in front.
  const std::array returns{BeamReturn{2000.0, 0.6}, BeamReturn{3000.0, 0.4}};
  const double r = phase_range(returns, kIntervals).range_mm;
  EXPECT_FALSE(r > 2000.0 && r < 2450.0) << "the mean by energy is 2400";
}

TEST(PhaseRange, TakesTheMeanOnlyWhereItIsGoodEnough) {
  const double limit = kIntervals.back() / 200.0;
  for (const double share : {0.1, 0.21, 0.5, 0.8}) {
    const auto both = [&](double spread) {
      const std::array returns{BeamReturn{1500.0, 1 - share}, BeamReturn{1500.0 + spread, share}};
      return phase_range(returns, kIntervals).range_mm - 1500.0 - share * spread;
    };
    EXPECT_NEAR(both(0.999 * limit), 0.0, 1e-9);
    EXPECT_LE(std::abs(both(1.001 * limit)), 4.2e-5 * limit);
  }
}

}  // namespace
}  // namespace maquette::scan
