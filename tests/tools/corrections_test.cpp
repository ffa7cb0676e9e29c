// SPDX-License-Identifier: GPL-3.0-or-later

// What is claimed in scan/fit_axis.hpp and tools/corrections_file.hpp:
//
//   line ...... exact stops, to rounding; noisy ones within three stated sigmas (chi-squared, 40
//   seeds) file ...... written and read, the same to the bit; faults named with line or key refused
//   ... two stops, all at one position, a word in the table

#include "tools/corrections_file.hpp"

#include <cmath>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/files.hpp"
#include "core/random.hpp"
#include "support/matchers.hpp"
#include "tools/schema.hpp"

namespace maquette::tools {
namespace {

using testing::HasSubstr;
using testing_support::FailsWith;
using testing_support::ScratchFolder;
using testing_support::Succeeds;

TEST(FitAxis, ExactStops) {
  const Vec3 along = normalized(Vec3{3, -1, 0.5});
  std::vector<scan::AxisStop> stops;
  for (const double s : {-100.0, 0.0, 250.0, 400.0})
    stops.push_back({s, Vec3{10, 20, 30} + 1.0005 * s * along});
  const auto f = scan::fit_axis(stops);
  ASSERT_THAT(f, Succeeds());
  EXPECT_LT(norm(f->origin_mm - Vec3{10, 20, 30}), 1e-10);
  EXPECT_LT(norm(f->direction - along), 1e-12);
  EXPECT_NEAR(f->scale, 1.0005, 1e-12);
  EXPECT_LT(f->straightness_mm, 1e-10);
}

TEST(FitAxis, StatesItsUncertainty) {
  double chi2 = 0.0, tilt2 = 0.0;
  for (std::uint64_t seed = 1; seed <= 40; ++seed) {
    std::vector<scan::AxisStop> stops;
    for (std::uint64_t k = 0; k < 12; ++k) {
      const double s = 50.0 * static_cast<double>(k);
      stops.push_back({s, Vec3{s, 0, 0} + 0.05 * Vec3{random_normal(seed, 3 * k),
                                                      random_normal(seed, 3 * k + 1),
                                                      random_normal(seed, 3 * k + 2)}});
    }
    const auto f = scan::fit_axis(stops);
    ASSERT_THAT(f, Succeeds());
    chi2 += std::pow(f->origin_mm.y / f->sigma_origin_mm.y, 2) +
            std::pow((f->scale - 1.0) / f->sigma_scale, 2);
    tilt2 += std::pow(f->direction.y / f->sigma_direction_rad, 2);
    EXPECT_NEAR(f->rms_mm, 0.05, 0.03);
  }
  EXPECT_NEAR(chi2, 80.0, 3.3 * std::sqrt(2.0 * 80.0));
  EXPECT_NEAR(tilt2, 40.0, 3.3 * std::sqrt(2.0 * 40.0));
}

TEST(FitAxis, RefusesWhatIsNoLine) {
  EXPECT_THAT(scan::fit_axis({}), FailsWith(scan::kAxis));
  const std::vector<scan::AxisStop> still{{5, {1, 0, 0}}, {5, {2, 0, 0}}, {5, {3, 0, 0}}};
  EXPECT_THAT(scan::fit_axis(still), FailsWith(scan::kAxis));
  const std::vector<scan::AxisStop> nan{{0, {1, 0, 0}}, {5, {NAN, 0, 0}}, {9, {3, 0, 0}}};
  EXPECT_THAT(scan::fit_axis(nan), FailsWith(scan::kAxis));
}

TEST(CorrectionsFile, ComesBackToTheBit) {
  const ScratchFolder scratch;
  Corrections c;
  c.actual_from_planned = {rotation_about(normalized(Vec3{1, 2, 3}), 0.0123),
                           {0.1, -7.0, 1.0 / 3.0}};
  c.sigma_translation_mm = 0.004;
  c.axes.push_back({"camera rail", {{1, 2, 3}, normalized(Vec3{1, 1, 0}), 1.0002, {1, 1, 1}}});
  ASSERT_TRUE(write_file(scratch / "c.toml", corrections_text(c)));
  const auto back = read_corrections(scratch / "c.toml");
  ASSERT_THAT(back, Succeeds());
  EXPECT_EQ(back->actual_from_planned, c.actual_from_planned);
  EXPECT_EQ(back->sigma_translation_mm, 0.004);
  ASSERT_EQ(back->axes.size(), 1U);
  EXPECT_EQ(back->axes[0].fit.direction, c.axes[0].fit.direction);
  EXPECT_EQ(back->axes[0].fit.scale, 1.0002);
  ASSERT_TRUE(
      write_file(scratch / "bad.toml", "[surface]\nrotation_wxyz = [1.0, 1.0, 0.0, 0.0]\n"));
  EXPECT_THAT(read_corrections(scratch / "bad.toml"), FailsWith(kConfigInvalid));
  ASSERT_TRUE(write_file(scratch / "typo.toml", "[surface]\ntranslaton_mm = [1.0, 1.0, 0.0]\n"));
  EXPECT_THAT(read_corrections(scratch / "typo.toml"), FailsWith(kConfigInvalid));
}

TEST(AxisStops, FromATable) {
  const ScratchFolder scratch;
  ASSERT_TRUE(
      write_file(scratch / "a.csv",
                 "position_mm,x_mm,y_mm,z_mm\n0,1,2,3\n100, 101.0, 2, 3\r\n200,201,2,3\n\n"));
  const auto f = read_axis_stops(scratch / "a.csv");
  ASSERT_THAT(f, Succeeds());
  EXPECT_NEAR(f->origin_mm.x, 1.0, 1e-12);
  ASSERT_TRUE(write_file(scratch / "b.csv", "position_mm,x_mm,y_mm,z_mm\n0,1,2,3\n100,x,2,3\n"));
  const auto bad = read_axis_stops(scratch / "b.csv");
  ASSERT_THAT(bad, FailsWith(kConfigInvalid));
  EXPECT_THAT(bad.error().message, HasSubstr("b.csv:3"));
}

}  // namespace
}  // namespace maquette::tools
