// SPDX-License-Identifier: GPL-3.0-or-later

// Controls of a diagnosis: simulated noise has the variances that were fitted, scale by scale; a
// cause that is there comes back, one that is too small to be found is said to be lost.

#include <cmath>

#include <gtest/gtest.h>

#include "core/random.hpp"
#include "diagnosis/controls.hpp"

namespace maquette::diagnosis {
namespace {

/// Two set-ups of some points on a wavy part of 160 mm, without residuals.
Measurements places(std::uint64_t seed, std::size_t points) {
  Measurements m;
  m.scene.box.add({0, 0, 0});
  m.scene.box.add({160, 160, 20});
  m.scene.has_station = {true, true};
  m.scene.stations = {{80, -900, 900}, {980, 80, 900}};
  for (std::uint32_t s = 0; s < 2; ++s) {
    SetUp set_up;
    set_up.name = "scan";
    set_up.centre_mm = {80, 80, 10};
    m.set_ups.push_back(set_up);
    for (std::uint64_t i = 0; i < points; ++i) {
      Observation o;
      const std::uint64_t k = i + points * s;
      const double x = 2.0 + 156.0 * random_uniform(seed, 2 * k),
                   y = 2.0 + 156.0 * random_uniform(seed, 2 * k + 1);
      o.place = {x, y, 10.0 + 2.45 * std::sin(x / 7.0) - 2.7 * std::cos(y / 9.0)};
      o.normal = o.along = o.slope_normal =
          normalized(Vec3{-0.35 * std::cos(x / 7.0), -0.3 * std::sin(y / 9.0), 1.0});
      o.tip = o.place + 3.0 * (o.normal - Vec3{0, 0, 1});
      o.set_up = s;
      const Vec3 v = o.place - m.scene.stations[s];
      o.has_station = true;
      o.range_mm = norm(v);
      o.beam = (1.0 / o.range_mm) * v;
      m.observations.push_back(o);
    }
  }
  return m;
}

void set_residuals(Measurements& m, const std::vector<double>& noise, double scale_um_per_m) {
  for (std::size_t i = 0; i < m.observations.size(); ++i) {
    Observation& o = m.observations[i];
    o.residual_mm = noise[i] + 1e-6 * scale_um_per_m * o.along.x * (o.tip.x - 80.0);
  }
}

/// Coarse details far above points, as rough coats make them, and a smooth process.
FittedNoise rough() {
  FittedNoise n;
  n.cell_mm = 160.0 / 24.0;
  n.point_mm2 = 0.05 * 0.05;
  n.own_mm2 = {1.5 * n.point_mm2, 1.3 * n.point_mm2, 1.1 * n.point_mm2};
  n.common_mm2 = {4.0 * n.point_mm2, 3.0 * n.point_mm2, 2.0 * n.point_mm2};
  n.common = {5.0 * n.point_mm2, 0.006 * 0.006, 25.0, true};
  n.own = {1.6 * n.point_mm2, 0.0, 10.0, true};
  return n;
}

TEST(Controls, NoiseHasTheFittedVariances) {
  const FittedNoise wanted = rough();
  Measurements m = places(1, 60'000);
  set_residuals(m, simulated_noise(m.observations, 2, m.scene.box, wanted, 1.0, 7), 0.0);
  const auto d = diagnose(m, 1);
  ASSERT_TRUE(d.has_value());
  EXPECT_EQ(d->verdict, "consistent");
  const FittedNoise& got = d->noise;
  // Squares of few points have more than their share: a third.
  EXPECT_NEAR(got.point_mm2 / wanted.point_mm2, 1.0, 0.1);
  for (std::size_t s = 0; s < 3; ++s) {
    EXPECT_NEAR(got.common_mm2[s] / wanted.common_mm2[s], 1.0, 0.33) << "scale " << s;
    EXPECT_NEAR(got.own_mm2[s] / wanted.own_mm2[s], 1.0, 0.33) << "scale " << s;
  }
  // A sixth of the points, each for six: coarse details are known nearly as well as before.
  Measurements few = m;
  few.observations.clear();
  for (std::size_t i = 0; i < m.observations.size(); i += 6)
    few.observations.push_back(m.observations[i]);
  set_residuals(few, simulated_noise(few.observations, 2, m.scene.box, wanted, 6.0, 8), 0.0);
  const auto thin = diagnose(few, 1);
  ASSERT_TRUE(thin.has_value());
  EXPECT_EQ(thin->verdict, "consistent");
  for (const std::size_t s : {0U, 1U})
    EXPECT_NEAR(6.0 * thin->noise.common_mm2[s] / wanted.common_mm2[s], 1.3, 0.4) << s;
}

TEST(Controls, BringBackWhatIsThereAndSayWhatIsLost) {
  Measurements m = places(2, 20'000);
  set_residuals(m, simulated_noise(m.observations, 2, m.scene.box, rough(), 6.0, 8), 2000.0);
  auto d = diagnose(m, 1);
  ASSERT_TRUE(d.has_value());
  ASSERT_EQ(d->causes.size(), 1U);
  ASSERT_EQ(d->causes[0].effect, "machine.scale_x");
  const auto good = controls(m, *d, 1);
  ASSERT_TRUE(good.has_value());
  EXPECT_TRUE(good->passed());
  EXPECT_EQ(good->null_verdict, "consistent");
  ASSERT_EQ(good->recoveries.size(), 1U);
  EXPECT_EQ(good->recoveries[0].named_as, "machine.scale_x");
  ASSERT_EQ(good->recoveries[0].sizes.size(), 1U);
  const auto& size = good->recoveries[0].sizes[0];
  EXPECT_EQ(size.injected, d->causes[0].parameters[0].value);
  EXPECT_NEAR(size.found, size.injected, 4.0 * size.sigma);
  // A name that the data could not have shown is not confirmed by its control.
  d->causes[0].parameters[0].value *= 0.03;
  const auto lost = controls(m, *d, 1);
  ASSERT_TRUE(lost.has_value());
  EXPECT_FALSE(lost->passed());
  EXPECT_TRUE(lost->recoveries.at(0).named_as.empty());
  // Nor one that stands for something else.
  d->causes[0] = {
      "stock.swelling", "isotropic", {{"growth_um_per_m", 900.0, 50.0}}, {}, 1.0, 1e-9, {}, ""};
  const auto other = controls(m, *d, 1);
  ASSERT_TRUE(other.has_value());
  EXPECT_EQ(other->recoveries.at(0).named_as, "stock.swelling");
}

}  // namespace
}  // namespace maquette::diagnosis
