// SPDX-License-Identifier: GPL-3.0-or-later

// Programs that other software wrote, each cut in simulation out of the block its header or its
// project file names. They are no part of the project: what is not in MAQUETTE_DATA/gcode, else
// shared/data/gcode beside the checkout, is skipped, and the test says so.
//
//   a relief, metric, G1 only ............... cuts to its stated depth, no rapid through material
//   parameters and expressions .............. chips, 10 mm ball, block 100 x 100 x 50
//   arcs by radius, inches, lower case ...... a flat groove that spirals out
//   inches, no tool, no depth ............... 1000 moves at z = 0: cuts when the stock is higher,
//                                             and says so when it is not
//   any of them, damaged .................... a certificate or an error with file and line

#include <filesystem>
#include <fstream>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "cnc/verify.hpp"
#include "core/files.hpp"
#include "support/folders.hpp"
#include "support/matchers.hpp"
#include "support/mutations.hpp"
#include "support/terrain.hpp"

namespace maquette::cnc {
namespace {

using heightmap::ModelField;
using testing::AnyOf;
using testing::HasSubstr;
using testing_support::FailsWith;
using testing_support::flat_field;
using testing_support::ScratchFolder;
using testing_support::Succeeds;

/// A flat design of the block's outline, `floor` high: what stays of it is the floor or higher.
ModelField block(double x0, double x1, double y0, double y1, double floor) {
  constexpr double kSpacing = 0.5;
  ModelField f = flat_field(static_cast<std::ptrdiff_t>(std::lround((y1 - y0) / kSpacing)) + 1,
                            static_cast<std::ptrdiff_t>(std::lround((x1 - x0) / kSpacing)) + 1,
                            kSpacing, static_cast<float>(floor));
  f.x0 = Millimetres{x0};
  f.y0 = Millimetres{y0};
  return f;
}

class ProgramsOfOthers : public testing::Test {
 protected:
  /// Null: not here.
  static std::optional<std::filesystem::path> program(const std::string& name) {
    const auto path = testing_support::data_folder() / "gcode" / name;
    return std::filesystem::exists(path) ? std::optional(path) : std::nullopt;
  }
  static VerifyOptions options(double ball_mm, double top_mm, double cell_mm) {
    VerifyOptions o;
    o.ball_diameter = Millimetres{ball_mm};
    o.stock_top = Millimetres{top_mm};
    o.cell = Millimetres{cell_mm};
    return o;
  }
};
#define PROGRAM_OR_SKIP(name)                         \
  const auto found = program(name);                   \
  if (!found) GTEST_SKIP() << name << " is not here"; \
  const std::filesystem::path& file = *found;

constexpr double kRounding_mm = 2e-5;

TEST_F(ProgramsOfOthers, ReliefOfACameo) {
  PROGRAM_OR_SKIP("cameo.nc");
  const auto v =
      verify(std::span(&file, 1), block(-82.5, 82.5, -105, 105, -6), options(2.0, 0.0, 0.25));
  ASSERT_THAT(v, Succeeds());
  EXPECT_EQ(v->certificate.rapid_collisions, 0U);
  EXPECT_EQ(heightmap::height_range(v->as_milled.z_mm).min, -6.0F) << "its roughing depth";
  EXPECT_NEAR(v->certificate.max_gouge_mm, 0.0, kRounding_mm);
  EXPECT_GT(v->certificate.engagement.removed_mm3, 10000.0);
}

TEST_F(ProgramsOfOthers, ReliefWithParameters) {
  PROGRAM_OR_SKIP("3D_Chips.ngc");
  const auto v = verify(std::span(&file, 1), block(-50, 50, -50, 50, -50), options(10.0, 0.0, 0.5));
  ASSERT_THAT(v, Succeeds());
  const auto range = heightmap::height_range(v->as_milled.z_mm);
  EXPECT_NEAR(v->certificate.max_gouge_mm, 0.0, kRounding_mm) << "the block is 50 mm thick";
  EXPECT_GT(range.min, -50.0F);
  EXPECT_LT(range.min, -20.0F) << "its first plunge goes to -27.372";
  EXPECT_LT(range.max, 0.0F) << "all of the block's top is milled";
  EXPECT_GT(v->certificate.engagement.removed_mm3, 1e4);
}

TEST_F(ProgramsOfOthers, SpiralOfArcsByRadius) {
  PROGRAM_OR_SKIP("arcspiral.ngc");
  // z -0.1 inch all the way; radii of 0 to 2 inches about the origin.
  const auto v =
      verify(std::span(&file, 1), block(-60, 60, -60, 60, -2.54), options(3.0, 0.0, 0.25));
  ASSERT_THAT(v, Succeeds());
  EXPECT_NEAR(v->certificate.max_gouge_mm, 0.0, kRounding_mm);
  EXPECT_NEAR(v->certificate.travel.min.z, -2.54, 1e-9);
  for (std::ptrdiff_t r = 0; r < v->as_milled.z_mm.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < v->as_milled.z_mm.cols(); ++c) {
      if (!(std::hypot(v->as_milled.x_mm(c), v->as_milled.y_mm(r)) > 2.0 * 25.4 + 1.5)) continue;
      ASSERT_EQ(v->as_milled.z_mm(r, c), 0.0F) << "nothing is cut beyond the largest radius";
    }
}

TEST_F(ProgramsOfOthers, ZigzagWithoutDepth) {
  PROGRAM_OR_SKIP("zigzag_0.002_0.001.ngc");
  const auto v = verify(std::span(&file, 1), block(0, 102, -3, 3, 0), options(3.0, 1.0, 0.1));
  ASSERT_THAT(v, Succeeds());
  EXPECT_NEAR(v->certificate.max_gouge_mm, 0.0, kRounding_mm);
  EXPECT_EQ(v->certificate.moves, 2001U);
  EXPECT_THAT(verify(std::span(&file, 1), block(0, 102, -3, 3, -1), options(3.0, 0.0, 0.1)),
              FailsWith(kGcodeNoCut));
}

TEST_F(ProgramsOfOthers, DamagedOnesGiveAResultOrAPlace) {
  int files = 0;
  const ScratchFolder folder;
  for (const char* name : {"cameo.nc", "3D_Chips.ngc", "arcspiral.ngc", "zigzag_0.002_0.001.ngc"}) {
    const auto file = program(name);
    if (!file) continue;
    ++files;
    std::string text = *read_file(*file);
    text = text.substr(0, text.find('\n', 3000) + 1) + "M2\n";
    testing_support::Mutator damage(static_cast<std::uint64_t>(files));
    int refused = 0;
    for (int i = 0; i < 60; ++i) {
      ASSERT_THAT(write_file(folder / "damaged.ngc", damage(text)), Succeeds());
      const std::filesystem::path damaged = folder / "damaged.ngc";
      const auto v =
          verify(std::span(&damaged, 1), block(-60, 60, -60, 60, -6), options(4.0, 0.0, 0.5));
      if (v) continue;
      ++refused;
      EXPECT_THAT(v.error().message,
                  v.error().code == kGcodeNoCut
                      ? testing::Matcher<std::string>(HasSubstr("damaged.ngc: nothing is cut"))
                      : testing::ContainsRegex("damaged.ngc:[0-9]+:[0-9]+: "));
    }
    EXPECT_GT(refused, 5) << name;
  }
  if (files == 0) GTEST_SKIP() << "no programs are here";
}

}  // namespace
}  // namespace maquette::cnc
