// SPDX-License-Identifier: GPL-3.0-or-later

// What is claimed in cnc/fewest_links.hpp and cnc/fit_lines.hpp, and how it is attacked:
//
//   inside, vertices at corners .... random tubes, each link at each station
//   fewest ......................... a parabola's closed form; on random tubes never more than a
//                                    search over all polylines with vertices on a fine grid
//   bounds of several lines ........ random samples parted into lines with steps of their own, at
//                                    samples, vertices and between; lines meet
//   nearly as few .................. moves written against links of the tube
// A single line is attacked in fit_moves_test.cpp.

#include "cnc/fit_lines.hpp"

#include <algorithm>
#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "cnc/fewest_links.hpp"
#include "core/check.hpp"
#include "core/random.hpp"

namespace maquette::cnc {
namespace {

void expect_inside(const std::vector<TubeStation>& tube, const std::vector<TubePoint>& path) {
  ASSERT_GE(path.size(), 2U);
  ASSERT_EQ(path.front().t, tube.front().t);
  ASSERT_EQ(path.back().t, tube.back().t);
  std::size_t v = 1;
  for (const TubeStation& s : tube) {
    while (path[v].t < s.t) ++v;
    const TubePoint &a = path[v - 1], &b = path[v];
    ASSERT_LE(a.t, b.t);
    const double z = b.t > a.t ? a.z + (s.t - a.t) / (b.t - a.t) * (b.z - a.z) : b.z;
    ASSERT_GE(z, s.low - 1e-8) << "at " << s.t;
    ASSERT_LE(z, s.high + 1e-8) << "at " << s.t;
    if (s.corner) {
      ASSERT_TRUE(path[v].t == s.t || path[v - 1].t == s.t) << "no vertex at the corner " << s.t;
    }
  }
}

TEST(FewestLinks, OneThroughAStraightTubeAndTwoRoundACorner) {
  std::vector<TubeStation> tube;
  for (int k = 0; k <= 20; ++k) tube.push_back({0.5 * k, 0.3 * k - 0.01, 0.3 * k + 0.01, false});
  EXPECT_EQ(fewest_links(tube).size(), 2U);
  for (int k = 21; k <= 40; ++k)
    tube.push_back({0.5 * k, 12.0 - 0.3 * k - 0.01, 12.0 - 0.3 * k + 0.01, false});
  const auto path = fewest_links(tube);
  ASSERT_EQ(path.size(), 3U);
  EXPECT_NEAR(path[1].t, 10.0, 0.04);
  EXPECT_NEAR(path[1].z, 6.0, 0.02);
  tube[10].corner = true;
  EXPECT_EQ(fewest_links(tube).size(), 4U);
  expect_inside(tube, fewest_links(tube));
  EXPECT_THROW((void)fewest_links(std::span(tube).first(1)), CheckFailed);
}

TEST(FewestLinks, AParabolaNeedsOneEveryFourRootsOfWidthOverCurvature) {
  // A chord from the lower side to itself that touches the upper one: c^2 k / 8 = 2 e.
  for (const double length : {7.9, 8.1, 39.0, 40.9}) {
    const double e = 0.01, curvature = 0.01, chord = 4.0 * std::sqrt(e / curvature);
    std::vector<TubeStation> tube;
    for (int k = 0; k <= 4000; ++k) {
      const double t = length * k / 4000.0, z = 0.5 * curvature * t * t;
      tube.push_back({t, z - e, z + e, false});
    }
    const auto path = fewest_links(tube);
    expect_inside(tube, path);
    EXPECT_EQ(path.size() - 1, static_cast<std::size_t>(std::ceil(length / chord))) << length;
  }
}

std::vector<TubeStation> random_tube(std::uint64_t seed, int stations) {
  std::vector<TubeStation> tube;
  double z = 0.0, slope = 0.0;
  for (int k = 0; k < stations; ++k) {
    const auto u = [&](std::uint64_t i) {
      return random_uniform(seed, 8 * static_cast<std::uint64_t>(k) + i);
    };
    slope += 1.6 * (u(0) - 0.5);
    z += slope;
    tube.push_back({static_cast<double>(k), z - 0.2 - u(1), z + 0.2 + 1.5 * u(2), u(3) < 0.04});
  }
  return tube;
}

/// Vertices at eighths between stations, heights at 25 levels there.
int links_by_search(const std::vector<TubeStation>& tube) {
  constexpr int kParts = 4, kLevels = 17;
  struct Place {
    double t, z;
  };
  std::vector<std::vector<Place>> columns;
  for (std::size_t k = 0; k + 1 < tube.size(); ++k)
    for (int i = 0; i < kParts; ++i) {
      const double q = i / double(kParts);
      const double low = tube[k].low + q * (tube[k + 1].low - tube[k].low);
      const double high = tube[k].high + q * (tube[k + 1].high - tube[k].high);
      std::vector<Place> column;
      for (int l = 0; l < kLevels; ++l)
        column.push_back({tube[k].t + q * (tube[k + 1].t - tube[k].t),
                          low + (high - low) * l / (kLevels - 1.0)});
      columns.push_back(column);
    }
  std::vector<Place> last;
  for (int l = 0; l < kLevels; ++l)
    last.push_back({tube.back().t,
                    tube.back().low + (tube.back().high - tube.back().low) * l / (kLevels - 1.0)});
  columns.push_back(last);
  std::vector<std::vector<int>> links(columns.size(), std::vector<int>(kLevels, 1 << 20));
  std::fill(links[0].begin(), links[0].end(), 0);
  for (std::size_t a = 0; a + 1 < columns.size(); ++a)
    for (std::size_t i = 0; i < kLevels; ++i) {
      if (links[a][i] >= 1 << 20) continue;
      const Place from = columns[a][i];
      double least = -INFINITY, most = INFINITY;  // slopes
      for (std::size_t b = a + 1; b < columns.size(); ++b) {
        for (std::size_t j = 0; j < kLevels; ++j) {
          const Place to = columns[b][j];
          const double slope = (to.z - from.z) / (to.t - from.t);
          if (slope >= least - 1e-12 && slope <= most + 1e-12)
            links[b][j] = std::min(links[b][j], links[a][i] + 1);
        }
        if (b % kParts == 0) {
          const TubeStation& s = tube[b / kParts];
          least = std::max(least, (s.low - from.z) / (s.t - from.t));
          most = std::min(most, (s.high - from.z) / (s.t - from.t));
          if (s.corner || least > most) break;
        }
      }
    }
  return *std::min_element(links.back().begin(), links.back().end());
}

TEST(FewestLinks, NoSearchFindsFewerOnRandomTubes) {
  int fewer = 0, all = 0;
  for (std::uint64_t seed = 1; seed <= 120; ++seed) {
    const auto tube = random_tube(seed, 24);
    const auto path = fewest_links(tube);
    expect_inside(tube, path);
    const int found = static_cast<int>(path.size()) - 1, searched = links_by_search(tube);
    EXPECT_LE(found, searched) << seed;
    fewer += searched - found;
    all += found;
  }
  EXPECT_LE(fewer, all / 10) << "the search is about as good, so the comparison tells something";
}

TEST(FewestLinks, WallsAndTubesOfNoWidth) {
  int none = 0;
  for (std::uint64_t seed = 1; seed <= 200; ++seed) {
    auto tube = random_tube(seed, 60);
    for (std::size_t k = 0; k < tube.size(); ++k) {
      tube[k].t = 100.0 + 0.002 * static_cast<double>(k);
      if (random_uniform(seed, 5000 + k) < 0.05) tube[k].high = tube[k].low + 2e-8;
      if (k > 30) {
        tube[k].low += 20.0;
        tube[k].high += 20.0;
      }
      tube[k].aim = 0.5 * (tube[k].low + tube[k].high);
    }
    const auto path = fewest_links(tube);
    if (path.empty())
      ++none;
    else
      expect_inside(tube, path);
  }
  EXPECT_LE(none, 10) << "of slopes up to 10^4 in a tube of 20 nm, rounding spoils a few";
}

// ---- fit_lines ------------------------------------------------------------------------------

struct Lines {
  std::vector<std::vector<PathSample>> samples;
  std::vector<double> steps;
  [[nodiscard]] std::vector<SampledLine> views() const {
    std::vector<SampledLine> views;
    for (std::size_t l = 0; l < samples.size(); ++l) views.push_back({samples[l], steps[l]});
    return views;
  }
};

Lines random_lines(std::uint64_t seed) {
  Lines lines;
  double z = 0.0, slope = 0.0, lift = 0.0;
  std::uint64_t n = 0;
  const auto next = [&] { return random_uniform(seed, n++); };
  const int count = 1 + static_cast<int>(12.0 * next());
  for (int l = 0; l < count; ++l) {
    const double step = 0.001 + 0.02 * next(), bend = next() - 0.6;
    const int size = 2 + static_cast<int>(20.0 * next());
    std::vector<PathSample> samples;
    std::int64_t place = static_cast<std::int64_t>(50.0 * next());
    if (next() < 0.4) slope = 1.2 * (next() - 0.5);
    for (int i = 0; i < size; ++i) {
      PathSample s;
      s.place = place;
      s.tip_mm = z + (i == 0 ? lift : 0.0);
      s.gouge_mm = 0.0018 * next();
      s.dip_mm = next() < 0.03 ? 0.03 * next() : 0.002 * next();
      if (i == 0) s.dip_mm += lift;
      samples.push_back(s);
      if (i + 1 == size) break;
      const auto steps = 1 + static_cast<std::int64_t>(0.15 * next() / step);
      place += steps;
      const double t = step * static_cast<double>(steps);
      z += slope * t + 0.5 * bend * t * t;
      slope += bend * t;
    }
    // The next line may have been lifted by a wall that this one does not know.
    lift = next() < 0.1 ? 0.02 * next() : 0.0;
    lines.samples.push_back(samples);
    lines.steps.push_back(step);
  }
  return lines;
}

TEST(FitLines, SeveralLinesStayInsideTheBoundsThatAreReportedAndMeet) {
  std::size_t moves_in_all = 0, links_in_all = 0;
  for (std::uint64_t seed = 1; seed <= 600; ++seed) {
    const Lines lines = random_lines(seed);
    FitLimits limits;
    if (seed % 3 == 1) limits = {0.0035, 0.004};
    std::vector<std::vector<FittedMove>> moves;
    const FitBounds bounds = fit_lines(lines.views(), limits, moves);
    ASSERT_LE(bounds.gouge_mm, limits.gouge_mm + 1e-12);
    ASSERT_EQ(moves.size(), lines.samples.size());
    double below = 0.0, above = 0.0;
    for (std::size_t l = 0; l < moves.size(); ++l) {
      const auto& samples = lines.samples[l];
      const auto& m = moves[l];
      ASSERT_GE(m.size(), 2U);
      ASSERT_EQ(m.front().place, samples.front().place);
      ASSERT_EQ(m.back().place, samples.back().place);
      if (l > 0) {
        ASSERT_EQ(m.front().z, moves[l - 1].back().z) << "lines meet";
      }
      std::size_t v = 1;
      for (std::size_t k = 0; k + 1 < samples.size(); ++k) {
        std::vector<double> places;
        const auto from = static_cast<double>(samples[k].place),
                   to = static_cast<double>(samples[k + 1].place);
        for (int i = 0; i <= 4; ++i) places.push_back(from + 0.25 * i * (to - from));
        for (const FittedMove& move : m)
          if (move.place > samples[k].place && move.place < samples[k + 1].place)
            places.push_back(static_cast<double>(move.place));
        std::sort(places.begin(), places.end());
        for (const double place : places) {
          while (static_cast<double>(m[v].place) < place) ++v;
          const auto a = static_cast<double>(m[v - 1].place), b = static_cast<double>(m[v].place);
          ASSERT_LT(a, b);
          const double za = mm_of_ticks(m[v - 1].z), zb = mm_of_ticks(m[v].z);
          const double path = za + (place - a) / (b - a) * (zb - za);
          const double q = (place - from) / (to - from);
          const double chord = samples[k].tip_mm + q * (samples[k + 1].tip_mm - samples[k].tip_mm);
          below = std::max(below, chord + samples[k].gouge_mm - path);
          above = std::max(above, path - chord + samples[k].dip_mm);
        }
      }
      moves_in_all += m.size() - 1;
    }
    ASSERT_LE(below, bounds.gouge_mm + 1e-12) << seed;
    ASSERT_LE(above, bounds.excess_mm + 1e-12) << seed;
    ASSERT_NEAR(mm_of_ticks(moves.front().front().z), lines.samples.front().front().tip_mm, 0.001);
    ASSERT_NEAR(mm_of_ticks(moves.back().back().z), lines.samples.back().back().tip_mm, 0.001);
    // Each line by itself, its ends at their own height, takes more.
    for (const SampledLine& line : lines.views()) {
      std::vector<std::vector<FittedMove>> alone;
      (void)fit_lines({&line, 1}, limits, alone);
      links_in_all += alone[0].size() - 1;
    }
  }
  EXPECT_LT(static_cast<double>(moves_in_all), 0.95 * static_cast<double>(links_in_all));
}

TEST(FitLines, WritesNearlyAsFewMovesAsTheTubeHasLinks) {
  // A rolling curve sampled every 0.1 mm, on a lattice with steps of 1 um and of 23 um. The tube is
  // what the limits leave beside 1 um between samples, less half a unit's share.
  const FitLimits limits;
  const double below = limits.gouge_mm - 0.0015, above = limits.excess_mm - 0.0015;
  for (const double step : {0.001, 0.023}) {
    std::vector<PathSample> samples;
    std::vector<TubeStation> tube;
    for (std::int64_t k = 0; k <= 4000; ++k) {
      const std::int64_t place = k * std::llround(0.092 / step);
      const double t = step * static_cast<double>(place);
      const double z = 0.4 * std::sin(1.1 * t) + 0.2 * std::sin(2.7 * t + 1.0);
      samples.push_back({place, z, 0.0, 0.001, 0.001});
      tube.push_back({t, z - below, z + above, false});
    }
    const SampledLine line{samples, step};
    std::vector<std::vector<FittedMove>> moves;
    const FitBounds bounds = fit_lines({&line, 1}, limits, moves);
    EXPECT_LE(bounds.gouge_mm, limits.gouge_mm);
    EXPECT_LE(bounds.excess_mm, limits.excess_mm);
    const auto links = static_cast<double>(fewest_links(tube).size() - 1);
    EXPECT_LE(static_cast<double>(moves[0].size() - 1), (step < 0.002 ? 1.04 : 1.18) * links);
  }
}

}  // namespace
}  // namespace maquette::cnc
