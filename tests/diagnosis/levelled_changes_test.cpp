// SPDX-License-Identifier: GPL-3.0-or-later

// What a film or a spot makes of other causes' changes, against the mean of x cos(k x) under a
// Gaussian: exp(-k^2 s^2 / 2) (x cos(k x) - k s^2 sin(k x)).

#include <array>
#include <cmath>
#include <numbers>

#include <gtest/gtest.h>

#include "core/random.hpp"
#include "diagnosis/detail/levelled_changes.hpp"
#include "diagnosis/detail/smoothed.hpp"

namespace maquette::diagnosis::detail {
namespace {

constexpr double kHalf_mm = 50.0, kWave_mm = 12.5, kWidth_mm = 2.0, kShare = 0.5;
constexpr double k = 2.0 * std::numbers::pi / kWave_mm;

double change_at(double x) {
  return 1e-3 * x * std::cos(k * x);
}
double mean_at(double x) {
  const double s2 = kWidth_mm * kWidth_mm;
  return 1e-3 * std::exp(-0.5 * k * k * s2) * (x * std::cos(k * x) - k * s2 * std::sin(k * x));
}

/// Seen from above at places drawn evenly, two set-ups.
std::vector<Observation> flat(std::size_t points) {
  std::vector<Observation> all(points);
  for (std::size_t i = 0; i < points; ++i) {
    Observation& o = all[i];
    o.place = {kHalf_mm * (2.0 * random_uniform(11, 2 * i) - 1.0),
               kHalf_mm * (2.0 * random_uniform(11, 2 * i + 1) - 1.0), 0.0};
    o.normal = o.slope_normal = o.along = {0.0, 0.0, 1.0};
    o.beam = {0.0, 0.0, -1.0};
    o.has_station = true;
    o.set_up = static_cast<std::uint32_t>(i % 2);
  }
  return all;
}
std::vector<double> changes_of(const std::vector<Observation>& all) {
  std::vector<double> c;
  for (const Observation& o : all) c.push_back(change_at(o.place.x));
  return c;
}
LevellingTerm term(bool by_the_spot, double moved = 0.0) {
  return {{kWidth_mm, by_the_spot}, kShare, [moved](std::size_t) { return moved; }};
}

TEST(LevelledChanges, AreTheMeanLessTheChange) {
  const auto all = flat(200'000);
  for (const bool by_the_spot : {false, true}) {
    std::vector<double> added(all.size(), 0.0);
    add_levelled(all, changes_of(all), {term(by_the_spot)}, added);
    double squares = 0.0, together = 0.0, wanted_squares = 0.0;
    for (std::size_t i = 0; i < all.size(); ++i) {
      const double x = all[i].place.x;
      if (std::abs(x) > kHalf_mm - 4.0 * kWidth_mm) continue;  // where the mean has all its weight
      const double wanted = kShare * (mean_at(x) - change_at(x));
      squares += std::pow(added[i] - wanted, 2);
      together += added[i] * wanted;
      wanted_squares += wanted * wanted;
    }
    // In the mean: what cells of half the width blur by is allowed for in its variance, and of the
    // fourth order there are (k cell)^4 / 60 of it, 0.1 %. By places: ten points a cell lie off its
    // middle by 0.09 mm on slopes of 0.014, 4 % of what is wanted under a mean of 50 cells, and
    // between cells the chord is off by up to (k cell)^2 / 8, 3 % of the change, to either side.
    EXPECT_NEAR(together / wanted_squares, 1.0, 0.01) << by_the_spot;
    EXPECT_LT(std::sqrt(squares / wanted_squares), 0.1) << by_the_spot;
  }
}

TEST(LevelledChanges, LeaveARigidMotionAlone) {
  const auto all = flat(50'000);
  std::vector<double> change, added(all.size(), 0.0);
  for (const Observation& o : all) change.push_back(0.3 + 1e-3 * o.place.x - 2e-3 * o.place.y);
  add_levelled(all, change, {term(false)}, added);
  for (const double v : added) ASSERT_NEAR(v, 0.0, 1e-6);  // single precision of the sums
}

TEST(LevelledChanges, NeedPointsUnderTheMean) {
  const auto all = flat(400);  // half a point a set-up under each mean
  std::vector<double> added(all.size(), 0.0);
  add_levelled(all, changes_of(all), {term(false)}, added);
  for (const double v : added) ASSERT_EQ(v, 0.0);
}

// Against sums in double precision over the same nodes, with a hole and an edge that is not
// straight.
TEST(Smoothed, IsTheMeanOfWhatIsKnown) {
  constexpr std::ptrdiff_t kRows = 70, kCols = 101;
  constexpr double kSigma = 4.3;
  Grid<float> z(kRows, kCols);
  for (std::ptrdiff_t r = 0; r < kRows; ++r)
    for (std::ptrdiff_t c = 0; c < kCols; ++c) {
      const auto i = static_cast<std::uint64_t>(r * kCols + c);
      const bool hole = r > 12 && r < 66 && c > 20 && c < 75;
      const bool edge = c > 90 + r / 8;
      z(r, c) = hole || edge ? NAN : static_cast<float>(10.0 + random_normal(5, i));
    }
  // Means along rows, then of these along columns, each of what is known.
  const auto along = [](const Grid<float>& in, std::ptrdiff_t dr, std::ptrdiff_t dc) {
    Grid<float> out(kRows, kCols, NAN);
    const auto reach = static_cast<std::ptrdiff_t>(std::ceil(3.5 * kSigma));
    for (std::ptrdiff_t r = 0; r < kRows; ++r)
      for (std::ptrdiff_t c = 0; c < kCols; ++c) {
        double sum = 0.0, weight = 0.0;
        for (std::ptrdiff_t i = -reach; i <= reach; ++i) {
          if (!in.contains(r + i * dr, c + i * dc)) continue;
          const double v = in(r + i * dr, c + i * dc), u = static_cast<double>(i) / kSigma,
                       w = std::exp(-0.5 * u * u);
          if (std::isnan(v)) continue;
          sum += w * v;
          weight += w;
        }
        if (weight > 0.0) out(r, c) = static_cast<float>(sum / weight);
      }
    return out;
  };
  const auto wanted = along(along(z, 0, 1), 1, 0),
             found = smoothed(z, std::array{2.0, kSigma, 9.0})[1];
  std::size_t unknown = 0;
  for (std::ptrdiff_t r = 0; r < kRows; ++r)
    for (std::ptrdiff_t c = 0; c < kCols; ++c) {
      ASSERT_EQ(std::isnan(found(r, c)), std::isnan(wanted(r, c))) << r << ' ' << c;
      if (std::isnan(wanted(r, c))) {
        ++unknown;
        continue;
      }
      // Sums of some 31 floats of about 10, twice.
      ASSERT_NEAR(found(r, c), wanted(r, c), 2e-5);
    }
  EXPECT_GT(unknown, 100U) << "there is a hole wider than the kernel";
}

}  // namespace
}  // namespace maquette::diagnosis::detail
