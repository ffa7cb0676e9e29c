// SPDX-License-Identifier: GPL-3.0-or-later

// Claims of heightmap/artefacts.hpp and how each is attacked, on ground made here (power law by
// Fourier synthesis, 256 or 512 pixels of one metre) with 0.1 m of white noise
//   clean ground changes by < 2 % of its noise    smooth, rough, very rough, dunes, boulders and a
//                                                   straight scarp; ten seeds each
//   95 % of boxes >= 0.5 m found                  300 boxes of 6 to 40 pixels, 0.5 to 2 m, either
//                                                   sign; what is found beside them; craters of
//                                                   one pixel's walls are none
//   spikes                                        one pixel and 2 x 2, either sign; boulders stay
//   seams                                         place, step, sigma; moved back; one whose step
//                                                   grows is shown and left
//   ripples, stripes                              direction, band; what is left of them, and what
//                                                   else is gone
//   detect leaves heights, off looks for nothing  mask, uncertainty

#include <cmath>
#include <functional>
#include <numbers>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/random.hpp"
#include "heightmap/detail/artefact_finders.hpp"
#include "support/fusion_trial.hpp"

namespace maquette::heightmap::detail {
namespace {

using testing_support::Complex;

constexpr double kNoise_m = 0.1;
constexpr double kPi = std::numbers::pi;

/// Power law with mean squared steps of `step_m`^2 over a pixel, roughly; the window is an eighth
/// cut out of a periodic surface, so its edges do not meet.
Grid<double> relief(std::ptrdiff_t n, std::uint64_t seed, double hurst, double step_m) {
  std::ptrdiff_t m = 1;
  while (m < n + n / 2) m *= 2;
  Grid<Complex> g(m, m);
  for (std::ptrdiff_t r = 0; r < m; ++r)
    for (std::ptrdiff_t c = 0; c < m; ++c) {
      const auto i = static_cast<std::uint64_t>(r * m + c);
      const double fy = static_cast<double>(r < m / 2 ? r : r - m) / static_cast<double>(m);
      const double fx = static_cast<double>(c < m / 2 ? c : c - m) / static_cast<double>(m);
      const double f = std::hypot(fx, fy);
      g(r, c) = f == 0.0 ? 0.0
                         : std::pow(f, -hurst - 1.0) *
                               Complex(random_normal(seed, 2 * i), random_normal(seed, 2 * i + 1));
    }
  testing_support::fft2(g, true);
  double square = 0.0;
  for (std::ptrdiff_t r = 0; r < m; ++r)
    for (std::ptrdiff_t c = 1; c < m; ++c)
      square += std::pow(g(r, c).real() - g(r, c - 1).real(), 2.0);
  const double scale = step_m / std::sqrt(square / static_cast<double>(m * (m - 1)));
  Grid<double> out(n, n);
  for (std::ptrdiff_t r = 0; r < n; ++r)
    for (std::ptrdiff_t c = 0; c < n; ++c) out(r, c) = -2000.0 + scale * g(r, c).real();
  return out;
}

using Added = std::function<double(double r, double c)>;

Grid<float> seen(const Grid<double>& ground, std::uint64_t seed, const Added& added = {}) {
  Grid<float> out(ground.rows(), ground.cols());
  for (std::ptrdiff_t r = 0; r < out.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < out.cols(); ++c)
      out(r, c) = static_cast<float>(
          ground(r, c) + (added ? added(static_cast<double>(r), static_cast<double>(c)) : 0.0) +
          kNoise_m * random_normal(500 + seed, static_cast<std::uint64_t>(r * out.cols() + c)));
  return out;
}

double rms_between(const Grid<float>& a, const Grid<float>& b) {
  double sum = 0.0;
  for (std::size_t i = 0; i < a.cells().size(); ++i)
    sum += std::pow(static_cast<double>(a.cells()[i]) - static_cast<double>(b.cells()[i]), 2.0);
  return std::sqrt(sum / static_cast<double>(a.cells().size()));
}

std::string said(const ArtefactReport& report) {
  std::string text;
  for (const SeamArtefact& s : report.seams)
    text += fmt::format("seam{} at {:.1f} slant {:.3f} step {:.3f} +- {:.3f}{}\n",
                        s.level ? " level" : "", s.at, s.slant, s.step_m, s.sigma_m,
                        s.separable ? " separable" : "");
  for (const WaveArtefact& w : report.waves)
    text +=
        fmt::format("waves towards {:.1f}, {:.1f} to {:.1f} pixels, rms {:.3f}, alike {:.2f}{}\n",
                    w.towards_deg, w.shortest_pixels, w.longest_pixels, w.rms_m, w.alike,
                    w.separable ? " separable" : "");
  return text;
}

struct Ground {
  const char* name;
  double hurst, step_m;
  Added added;
};

/// Crests 10 to 30 pixels apart within 25 degrees, which begin, wander and end: noise through a
/// sector of the spectrum. Of 0.2 m rms.
Grid<double> dunes(std::ptrdiff_t n, std::uint64_t seed) {
  Grid<Complex> g(2 * n, 2 * n);
  for (std::ptrdiff_t r = 0; r < 2 * n; ++r)
    for (std::ptrdiff_t c = 0; c < 2 * n; ++c) {
      const auto i = static_cast<std::uint64_t>(r * 2 * n + c);
      const auto side = static_cast<double>(2 * n);
      const double fy = static_cast<double>(r < n ? r : r - 2 * n) / side;
      const double fx = static_cast<double>(c < n ? c : c - 2 * n) / side;
      const double length = 1.0 / std::max(1e-9, std::hypot(fx, fy));
      const double off = std::atan2(fy, fx) - 0.7;
      const bool in = length > 10.0 && length < 30.0 && std::abs(off) < 0.22;
      g(r, c) = in ? Complex(random_normal(80 + seed, 2 * i), random_normal(80 + seed, 2 * i + 1))
                   : Complex(0.0);
    }
  testing_support::fft2(g, true);
  double square = 0.0;
  for (const Complex& v : g.cells()) square += v.real() * v.real();
  const double scale = 0.2 / std::sqrt(square / static_cast<double>(4 * n * n));
  Grid<double> out(n, n);
  for (std::ptrdiff_t r = 0; r < n; ++r)
    for (std::ptrdiff_t c = 0; c < n; ++c) out(r, c) = scale * g(r, c).real();
  return out;
}

double boulders(double r, double c) {
  double z = 0.0;
  for (std::uint64_t i = 0; i < 60; ++i) {
    const double far = std::hypot(r - 256.0 * random_uniform(32, 3 * i),
                                  c - 256.0 * random_uniform(32, 3 * i + 1));
    if (far < 12.0) z += 2.5 * std::exp(-0.5 * std::pow(far / 1.6, 2.0));
  }
  return z;
}

/// Four metres down over six pixels, straight through.
double scarp(double r, double c) {
  return 4.0 / (1.0 + std::exp((c - 120.0 - 0.1 * r) / 1.5));
}

const std::vector<Ground> kGrounds{{"smooth", 0.9, 0.02, {}},         {"rough", 0.7, 0.1, {}},
                                   {"very rough", 0.4, 0.3, {}},      {"dunes", 0.7, 0.05, {}},
                                   {"boulders", 0.7, 0.05, boulders}, {"scarp", 0.7, 0.05, scarp}};

class CleanGround : public ::testing::TestWithParam<std::size_t> {};
INSTANTIATE_TEST_SUITE_P(Grounds, CleanGround, ::testing::Range(std::size_t{0}, kGrounds.size()));

TEST_P(CleanGround, StaysAsItIs) {
  const Ground& ground = kGrounds[GetParam()];
  double worst = 0.0;
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    Grid<double> truth = relief(256, seed, ground.hurst, ground.step_m);
    if (ground.name == std::string("dunes")) {
      const Grid<double> crests = dunes(256, seed);
      for (std::size_t i = 0; i < truth.cells().size(); ++i) truth.cells()[i] += crests.cells()[i];
    }
    const Grid<float> before = seen(truth, seed, ground.added);
    Grid<float> after = before;
    const Cleaned found = clean(after, Clean::remove);
    worst = std::max(worst, rms_between(before, after));
    EXPECT_TRUE(found.report.seams.empty()) << ground.name << " " << said(found.report);
    EXPECT_TRUE(found.report.boxes.empty()) << ground.name << " " << seed;
    EXPECT_LE(found.report.spikes, 1) << ground.name << " " << seed;
    EXPECT_LT(rms_between(before, after), 0.02 * kNoise_m) << seed << "\n" << said(found.report);
  }
  RecordProperty("change_over_noise", std::to_string(worst / kNoise_m));
  EXPECT_LT(worst, 0.02 * kNoise_m) << ground.name;
}

TEST(Boxes, AreFound) {
  int injected = 0, found = 0, beside = 0, lowest_found = 0, lowest = 0;
  double off = 0.0;
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    std::vector<BoxArtefact> boxes;
    for (std::uint64_t k = 0; boxes.size() < 30; ++k) {
      const auto draw = [&](std::uint64_t i) { return random_uniform(700 + seed, 6 * k + i); };
      BoxArtefact b{static_cast<std::ptrdiff_t>(4 + 450 * draw(0)),
                    static_cast<std::ptrdiff_t>(4 + 450 * draw(1)),
                    static_cast<std::ptrdiff_t>(6 + 35 * draw(2)),
                    static_cast<std::ptrdiff_t>(6 + 35 * draw(3)),
                    (0.5 + 1.5 * draw(4)) * (draw(5) < 0.5 ? -1.0 : 1.0)};
      const bool free = std::none_of(boxes.begin(), boxes.end(), [&](const BoxArtefact& o) {
        return b.row <= o.row + o.rows + 3 && o.row <= b.row + b.rows + 3 &&
               b.col <= o.col + o.cols + 3 && o.col <= b.col + b.cols + 3;
      });
      if (free) boxes.push_back(b);
    }
    Grid<float> h = seen(relief(512, seed, 0.7, 0.05), seed, [&](double r, double c) {
      for (const BoxArtefact& b : boxes)
        if (r >= static_cast<double>(b.row) && r < static_cast<double>(b.row + b.rows) &&
            c >= static_cast<double>(b.col) && c < static_cast<double>(b.col + b.cols))
          return b.offset_m;
      return 0.0;
    });
    const Cleaned cleaned = clean(h, Clean::detect);
    EXPECT_LE(cleaned.report.box_limit_m, 0.7);
    std::vector<bool> meant(cleaned.report.boxes.size(), false);
    for (const BoxArtefact& b : boxes) {
      bool hit = false;
      for (std::size_t i = 0; i < meant.size(); ++i) {
        const BoxArtefact& f = cleaned.report.boxes[i];
        const double both =
            static_cast<double>(std::max<std::ptrdiff_t>(
                0, std::min(b.row + b.rows, f.row + f.rows) - std::max(b.row, f.row))) *
            static_cast<double>(std::max<std::ptrdiff_t>(
                0, std::min(b.col + b.cols, f.col + f.cols) - std::max(b.col, f.col)));
        const double either = static_cast<double>(b.rows * b.cols + f.rows * f.cols) - both;
        if (both / either < 0.7) continue;
        meant[i] = hit = true;
        off += std::pow(f.offset_m - b.offset_m, 2.0);
      }
      ++injected;
      found += hit ? 1 : 0;
      if (std::abs(b.offset_m) < 0.7) {
        ++lowest;
        lowest_found += hit ? 1 : 0;
      }
    }
    beside += static_cast<int>(std::count(meant.begin(), meant.end(), false));
  }
  RecordProperty("injected", injected);
  RecordProperty("found", found);
  RecordProperty("below_0.7_m", lowest);
  RecordProperty("below_0.7_m_found", lowest_found);
  RecordProperty("beside", beside);
  RecordProperty("rms_of_heights_m", std::to_string(std::sqrt(off / found)));
  EXPECT_GE(found, 0.95 * injected);
  EXPECT_GE(lowest_found, 0.9 * lowest);
  EXPECT_LE(beside, 3);
}

/// Level floors behind walls of one pixel, 4 to 14 pixels wide, over ground that is itself above
/// all noise: as products of large pixels show craters.
TEST(Boxes, AreNotCraters) {
  int found = 0;
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    Grid<double> ground = relief(384, seed, 0.5, 1.0);
    for (std::uint64_t k = 0; k < 250; ++k) {
      const auto draw = [&](std::uint64_t i) { return random_uniform(900 + seed, 4 * k + i); };
      const double row = 384.0 * draw(0), col = 384.0 * draw(1), radius = 2.0 + 5.0 * draw(2);
      const double depth = 5.0 * draw(3);
      for (std::ptrdiff_t r = 0; r < 384; ++r)
        for (std::ptrdiff_t c = 0; c < 384; ++c)
          if (std::hypot(static_cast<double>(r) - row, static_cast<double>(c) - col) < radius)
            ground(r, c) -= depth;
    }
    Grid<float> h = seen(ground, seed);
    found += static_cast<int>(clean(h, Clean::detect).report.boxes.size());
  }
  RecordProperty("boxes", found);
  EXPECT_LE(found, 5) << "of 1500 craters: 3 measured, 21 if only noise counted";
}

TEST(Boxes, GiveWayToReliefLikeThatAround) {
  const Grid<double> ground = relief(256, 3, 0.7, 0.05);
  const Grid<float> without = seen(ground, 3);
  Grid<float> h = seen(ground, 3, [](double r, double c) {
    return r >= 60 && r < 75 && c >= 100 && c < 120 ? 1.5 : 0.0;
  });
  const Cleaned cleaned = clean(h, Clean::remove);
  ASSERT_EQ(cleaned.report.boxes.size(), 1U);
  EXPECT_EQ(cleaned.mask(67, 110), kBox | kTakenAway);
  EXPECT_EQ(cleaned.made(67, 110), 1);
  EXPECT_EQ(cleaned.mask(30, 30), 0);
  double square = 0.0, stated = 0.0;
  for (std::ptrdiff_t r = 0; r < 256; ++r)
    for (std::ptrdiff_t c = 0; c < 256; ++c) {
      if (r < 60 || r >= 75 || c < 100 || c >= 120) {
        ASSERT_EQ(h(r, c), without(r, c));
        continue;
      }
      square += std::pow(static_cast<double>(h(r, c) - without(r, c)), 2.0) / 300.0;
      stated += std::pow(static_cast<double>(cleaned.doubt_m(r, c)), 2.0) / 300.0;
    }
  EXPECT_LT(std::sqrt(square), 0.5);
  EXPECT_NEAR(std::sqrt(square / stated), 1.0, 0.6);  // one hole: a few independent errors
}

TEST(Spikes, AreFoundAndBouldersAreNot) {
  int found = 0, injected = 0;
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    Grid<float> h = seen(relief(256, seed, 0.7, 0.05), seed, boulders);
    std::vector<std::pair<std::ptrdiff_t, std::ptrdiff_t>> at;
    for (std::uint64_t k = 0; k < 40; ++k) {
      // Off the boulders; a quarter of them 2 x 2.
      const auto r = static_cast<std::ptrdiff_t>(5 + 240 * random_uniform(40 + seed, 2 * k));
      const auto c = static_cast<std::ptrdiff_t>(5 + 240 * random_uniform(40 + seed, 2 * k + 1));
      bool alone = boulders(static_cast<double>(r), static_cast<double>(c)) < 0.01;
      for (const auto& [i, j] : at) alone = alone && std::max(std::abs(i - r), std::abs(j - c)) > 4;
      if (!alone) continue;
      const float height = (k % 2 == 0 ? 1.0F : -1.0F) * (2.0F + 0.1F * static_cast<float>(k));
      for (std::ptrdiff_t i = 0; i < (k % 4 == 0 ? 2 : 1); ++i)
        for (std::ptrdiff_t j = 0; j < (k % 4 == 0 ? 2 : 1); ++j) {
          h(r + i, c + j) += height;
          at.emplace_back(r + i, c + j);
        }
    }
    const auto spikes = find_spikes(h);
    injected += static_cast<int>(at.size());
    for (const auto& [r, c] : at)
      found += static_cast<int>(std::count_if(
          spikes.begin(), spikes.end(), [&](const Spike& s) { return s.row == r && s.col == c; }));
    EXPECT_LE(spikes.size(), at.size() + 1) << "boulders are no spikes";
  }
  RecordProperty("injected", injected);
  RecordProperty("found", found);
  EXPECT_GE(found, 0.95 * injected);
}

TEST(Seams, AreFoundAndMovedBack) {
  for (const double step_m : {0.25, -0.6}) {
    for (std::uint64_t seed = 1; seed <= 4; ++seed) {
      const Grid<double> ground = relief(256, seed, 0.7, 0.05);
      const auto past = [](double r, double c) {
        return c >= 140.0 + std::round(0.07 * (r - 127.5));
      };
      Grid<float> h =
          seen(ground, seed, [&](double r, double c) { return past(r, c) ? step_m : 0.0; });
      const Grid<float> without = seen(ground, seed);
      const Cleaned cleaned = clean(h, Clean::remove);
      ASSERT_EQ(cleaned.report.seams.size(), 1U) << seed;
      const SeamArtefact& seam = cleaned.report.seams[0];
      EXPECT_FALSE(seam.level);
      EXPECT_TRUE(seam.separable);
      EXPECT_NEAR(seam.at, 140.0, 1.0);
      EXPECT_NEAR(seam.slant, 0.07, 2.0 / 256.0);
      EXPECT_NEAR(seam.step_m, step_m, 4.0 * seam.sigma_m);
      EXPECT_LT(seam.sigma_m, 0.05);
      EXPECT_NE(
          cleaned.mask(20, static_cast<std::ptrdiff_t>(std::lround(140 + 0.07 * -107.5))) & kSeam,
          0);
      // Beyond it less before it, of what differs from ground without a seam.
      double beyond = 0.0, before = 0.0, n = 0.0, m = 0.0;
      for (std::ptrdiff_t r = 0; r < 256; ++r)
        for (std::ptrdiff_t c = 0; c < 256; ++c) {
          const double d = static_cast<double>(h(r, c) - without(r, c));
          if (past(static_cast<double>(r), static_cast<double>(c))) {
            beyond += d;
            n += 1.0;
          } else {
            before += d;
            m += 1.0;
          }
        }
      EXPECT_LT(std::abs(beyond / n - before / m), 0.2 * std::abs(step_m));
    }
  }
}

TEST(Seams, ThatChangeAreShownAndLeft) {
  Grid<float> h = seen(relief(256, 2, 0.7, 0.05), 2,
                       [](double r, double c) { return c >= 100.0 ? 0.15 + r / 256.0 : 0.0; });
  const Grid<float> before = h;
  const Cleaned cleaned = clean(h, Clean::remove);
  ASSERT_EQ(cleaned.report.seams.size(), 1U);
  EXPECT_FALSE(cleaned.report.seams[0].separable);
  EXPECT_EQ(cleaned.mask(128, 100) & (kSeam | kTakenAway), kSeam);
  EXPECT_GT(cleaned.doubt_m(128, 100), 0.2F);
  EXPECT_LT(rms_between(h, before), 0.02 * kNoise_m);
}

// Tiles of a mosaic that meet for a part of the way, as in the mosaic of Gale.
TEST(Seams, ThatEndAreShownAndLeft) {
  Grid<float> h = seen(relief(256, 6, 0.7, 0.05), 6,
                       [](double r, double c) { return r >= 90.0 && c >= 128.0 ? 0.6 : 0.0; });
  const Grid<float> before = h;
  const Cleaned cleaned = clean(h, Clean::remove);
  const auto level = std::find_if(cleaned.report.seams.begin(), cleaned.report.seams.end(),
                                  [](const SeamArtefact& s) { return s.level; });
  ASSERT_NE(level, cleaned.report.seams.end());
  EXPECT_FALSE(level->separable);
  EXPECT_NEAR(level->at, 90.0, 1.0);
  EXPECT_NEAR(level->step_m, 0.6, 4.0 * level->sigma_m);
  EXPECT_NEAR(level->from, 0.5, 0.13);
  EXPECT_EQ(level->to, 1.0);
  EXPECT_NE(cleaned.mask(90, 200) & kSeam, 0);
  EXPECT_EQ(cleaned.mask(90, 60) & kSeam, 0);
  EXPECT_LT(rms_between(h, before), 0.02 * kNoise_m);
}

// As in the mosaic of Gale: tiles that differ by another height everywhere along their border.
TEST(Seams, OfEitherSignAreShown) {
  Grid<float> h = seen(relief(256, 7, 0.7, 0.05), 7, [](double r, double c) {
    return r >= 140.0 ? 0.8 * std::sin(c / 11.0) : 0.0;
  });
  const Grid<float> before = h;
  const Cleaned cleaned = clean(h, Clean::remove);
  ASSERT_EQ(cleaned.report.seams.size(), 1U) << said(cleaned.report);
  EXPECT_TRUE(cleaned.report.seams[0].level);
  EXPECT_FALSE(cleaned.report.seams[0].separable);
  EXPECT_NEAR(cleaned.report.seams[0].at, 140.0, 1.0);
  EXPECT_NE(cleaned.mask(140, 100) & kSeam, 0);
  EXPECT_LT(rms_between(h, before), 0.02 * kNoise_m);
}

struct Waved {
  const char* name;
  Added added;
  /// Share of the rms that may differ from ground without them. Relief has a mean along the crests
  /// too, which goes with them, and the longest and shortest waves stay.
  double left;
};

/// Jitter: 24 pixels, wandering a little in phase along the way, alike along the crests.
double ripples(double r, double c) {
  const double t = r * std::cos(0.14) + c * std::sin(0.14);
  return 0.14 * std::sin(2.0 * kPi * t / 24.0 + 0.8 * std::sin(t / 60.0));
}

/// Tracks seven pixels apart, two wide, each off by its own height.
double tracks(double r, double c) {
  const double t = c * std::cos(0.47) + r * std::sin(0.47) + 1000.0;
  const double track = std::floor(t / 7.0), in = t - 7.0 * track;
  const double shape = std::exp(-0.5 * std::pow((in - 3.5) / 1.2, 2.0));
  return 0.4 * random_normal(61, static_cast<std::uint64_t>(track)) * shape;
}

TEST(Waves, OfOneDirectionAreTakenAway) {
  for (const Waved& w : {Waved{"ripples", ripples, 0.45}, Waved{"tracks", tracks, 0.55}}) {
    double left = 0.0, rms = 0.0;
    for (std::uint64_t seed = 1; seed <= 4; ++seed) {
      const Grid<double> ground = relief(256, seed, 0.7, 0.05);
      const Grid<float> without = seen(ground, seed);
      Grid<float> h = seen(ground, seed, w.added);
      rms += rms_between(h, without) / 4.0;
      const Cleaned cleaned = clean(h, Clean::remove);
      ASSERT_FALSE(cleaned.report.waves.empty()) << w.name << " " << seed;
      EXPECT_TRUE(cleaned.report.waves[0].separable) << said(cleaned.report);
      left += rms_between(h, without) / 4.0;
    }
    RecordProperty(std::string(w.name) + "_rms_m", std::to_string(rms));
    RecordProperty(std::string(w.name) + "_left", std::to_string(left / rms));
    EXPECT_LT(left, w.left * rms) << w.name;
  }
}

TEST(Waves, AreSaidWithDirectionAndLength) {
  Grid<float> h = seen(relief(256, 1, 0.7, 0.05), 1, ripples);
  const Cleaned cleaned = clean(h, Clean::detect);
  ASSERT_FALSE(cleaned.report.waves.empty());
  const WaveArtefact& w = cleaned.report.waves[0];
  EXPECT_NEAR(w.towards_deg, 90.0 - 0.14 * 180.0 / kPi, 1.0);
  EXPECT_LT(w.shortest_pixels, 24.0);
  EXPECT_GT(w.longest_pixels, 24.0);
  EXPECT_LT(w.longest_pixels / w.shortest_pixels, 3.0);
  EXPECT_NEAR(w.rms_m, 0.1, 0.03);
  EXPECT_GT(w.alike, 0.8);
}

TEST(Clean, DetectLeavesHeightsAndOffLooksForNothing) {
  Grid<float> h = seen(relief(256, 5, 0.7, 0.05), 5, [](double r, double c) {
    return ripples(r, c) + (r >= 60 && r < 75 && c >= 100 && c < 120 ? 1.5 : 0.0);
  });
  h(200, 30) += 5.0F;
  h(10, 10) = NAN;
  const Grid<float> before = h;
  const Cleaned detected = clean(h, Clean::detect);
  for (std::size_t i = 0; i < h.cells().size(); ++i)
    if (i != 10 * 256 + 10) {
      ASSERT_EQ(h.cells()[i], before.cells()[i]);
    }
  EXPECT_TRUE(std::isnan(h(10, 10)));
  EXPECT_TRUE(detected.made.empty());
  EXPECT_EQ(detected.mask(200, 30) & (kSpike | kTakenAway), kSpike);
  EXPECT_NEAR(detected.doubt_m(200, 30), 5.0, 0.6);
  EXPECT_EQ(detected.mask(67, 110) & (kBox | kTakenAway), kBox);
  EXPECT_NEAR(detected.doubt_m(67, 110), 1.5, 0.2);
  EXPECT_FALSE(detected.report.waves.empty());
  const Cleaned off = clean(h, Clean::off);
  EXPECT_TRUE(off.mask.empty());
  EXPECT_EQ(off.report.spikes, 0);
  const Cleaned removed = clean(h, Clean::remove);
  EXPECT_TRUE(std::isnan(h(10, 10))) << "voids stay voids";
  EXPECT_EQ(removed.mask(200, 30) & (kSpike | kTakenAway), kSpike | kTakenAway);
}

}  // namespace
}  // namespace maquette::heightmap::detail
