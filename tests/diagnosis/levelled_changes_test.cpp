// SPDX-License-Identifier: GPL-3.0-or-later

// What a film or a spot makes of other causes' changes, against the mean of x cos(k x) under a
// Gaussian: exp(-k^2 s^2 / 2) (x cos(k x) - k s^2 sin(k x)).

#include <cmath>
#include <numbers>

#include <gtest/gtest.h>

#include "core/random.hpp"
#include "diagnosis/detail/levelled_changes.hpp"

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

}  // namespace
}  // namespace maquette::diagnosis::detail
