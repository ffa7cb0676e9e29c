// SPDX-License-Identifier: GPL-3.0-or-later

// meshing/stones.hpp, files:
//   stones.json round trip to the bit ....... awkward doubles, random bit patterns, 64-bit seed
//   same stones, same bytes ................. compared
//   MESHING_STONE_PLAN_FORMAT names file,
//   line and column, or key ................. one case per kind of mistake
//   whatever the bytes, stones or an error .. random changes of a valid file
//   stones.csv .............................. line by line

#include <bit>
#include <cmath>
#include <fstream>
#include <limits>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/check.hpp"
#include "core/files.hpp"
#include "core/random.hpp"
#include "meshing/stones.hpp"
#include "support/matchers.hpp"

namespace maquette::meshing {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using testing_support::FailsWith;
using testing_support::ScratchFolder;
using testing_support::Succeeds;

PlacedStone awkward_stone() {
  return {.number = 7,
          .shape = {.angularity = 0.1 + 0.2,
                    .flatness = std::nextafter(1.0, 0.0),
                    .elongation = 1.0 / 1.5,
                    .roughness = std::numeric_limits<double>::denorm_min(),
                    .seed = std::numeric_limits<std::uint64_t>::max(),
                    .subdivisions = 5},
          .scale_mm = 4.9e-324,
          .model_from_stone = {.rotation = {0.5, -0.5, 0.5, 0.5},
                               .translation_mm = {-0.0, 1e300, 100.0 / 3.0}},
          .embedded_depth_mm = -std::numbers::pi};
}

/// Any finite double but of any exponent.
double any_double(std::uint64_t seed, std::uint64_t i) {
  double x = NAN;
  while (!std::isfinite(x)) x = std::bit_cast<double>(random_bits(seed, i++ * 1000003));
  return x;
}

TEST(StonePlan, RoundTripIsExactToTheBit) {
  const ScratchFolder folder;
  std::vector<PlacedStone> stones{awkward_stone()};
  for (std::uint64_t i = 0; i < 500; ++i) {
    PlacedStone s = awkward_stone();
    s.number = static_cast<int>(i) + 8;
    s.shape.angularity = random_uniform(1, i);
    s.model_from_stone.rotation =
        normalized(Quaternion{random_uniform(8, i), -2, 3, random_uniform(9, i)});
    s.scale_mm = std::abs(any_double(2, i));
    s.model_from_stone.translation_mm = {any_double(3, i), any_double(4, i), any_double(5, i)};
    s.embedded_depth_mm = any_double(6, i);
    s.shape.seed = random_bits(7, i);
    stones.push_back(s);
  }
  ASSERT_THAT(write_stone_plan(stones, folder / "stones.json"), Succeeds());
  const auto back = read_stone_plan(folder / "stones.json");
  ASSERT_THAT(back, Succeeds());
  ASSERT_EQ(*back, stones);
  EXPECT_TRUE(std::signbit((*back)[0].model_from_stone.translation_mm.x));  // -0.0 == 0.0
  ASSERT_THAT(write_stone_plan(*back, folder / "again.json"), Succeeds());
  EXPECT_EQ(sha256_file(folder / "stones.json").value(),
            sha256_file(folder / "again.json").value());
}

TEST(StonePlan, NoStonesAreAPlanToo) {
  const ScratchFolder folder;
  ASSERT_THAT(write_stone_plan({}, folder / "stones.json"), Succeeds());
  const auto back = read_stone_plan(folder / "stones.json");
  ASSERT_THAT(back, Succeeds());
  EXPECT_TRUE(back->empty());
}

TEST(StonePlan, WritesFiniteNumbersOnly) {
  const ScratchFolder folder;
  PlacedStone s = awkward_stone();
  s.embedded_depth_mm = NAN;
  EXPECT_THROW((void)write_stone_plan(std::vector{s}, folder / "stones.json"), CheckFailed);
  EXPECT_FALSE(std::filesystem::exists(folder / "stones.json"));
}

struct Mistake {
  const char* name;
  const char* from;  ///< text in the valid file, replaced by `to`
  const char* to;
  const char* message;
};
void PrintTo(const Mistake& m, std::ostream* out) {
  *out << m.name;
}

class StonePlanMistake : public ::testing::TestWithParam<Mistake> {};
INSTANTIATE_TEST_SUITE_P(
    Kinds, StonePlanMistake,
    ::testing::Values(
        Mistake{"syntax", "\"unit\": \"mm\",", "\"unit\": \"mm\"", "line 5, column 9: not JSON"},
        Mistake{"number_too_large", "1e+300", "1e+999", "not JSON"},
        Mistake{"nan", "1e+300", "NaN", "not JSON"},
        Mistake{"schema", "stones/1", "stones/2", "/schema: \"maquette.stones/1\" expected"},
        Mistake{"unit", "\"mm\"", "\"m\"", "/unit: \"mm\" expected"},
        Mistake{"missing", "\"scale_mm\"", "\"scale\"", "/stones/0/scale_mm: key is missing"},
        Mistake{"unknown", "\"frame\"", "\"colour\": 1, \"frame\"", "/colour: unknown key"},
        Mistake{"type", "\"number\": 7", "\"number\": \"7\"", "/stones/0/number: integer expected"},
        Mistake{"fraction", "\"number\": 7", "\"number\": 7.5",
                "/stones/0/number: integer expected"},
        Mistake{"number_zero", "\"number\": 7", "\"number\": 0", "/stones/0/number"},
        Mistake{"number_huge", "\"number\": 7", "\"number\": 99999999999", "/stones/0/number"},
        Mistake{"subdivisions", "\"subdivisions\": 5", "\"subdivisions\": 8",
                "/stones/0/shape/subdivisions: number within 0 .. 7"},
        Mistake{"seed", "18446744073709551615", "-1", "/stones/0/shape/seed: integer"},
        Mistake{"range", "0.30000000000000004", "1.5",
                "/stones/0/shape/angularity: number within 0 .. 1"},
        Mistake{"length", "-0.5", "-0.6", "/stones/0/rotation_wxyz: quaternion of length 1"},
        Mistake{"count", "\"translation_mm\": [", "\"translation_mm\": [1,",
                "/stones/0/translation_mm: array of 3 numbers"},
        Mistake{"array", "\"stones\": [", "\"stones\": 1, \"x\": [", "unknown key"}),
    [](const auto& kind) { return kind.param.name; });

TEST_P(StonePlanMistake, IsNamedWithItsPlace) {
  const ScratchFolder folder;
  ASSERT_THAT(write_stone_plan(std::vector{awkward_stone()}, folder / "stones.json"), Succeeds());
  std::string text = read_file(folder / "stones.json").value();
  const auto at = text.find(GetParam().from);
  ASSERT_NE(at, std::string::npos);
  text.replace(at, std::string(GetParam().from).size(), GetParam().to);
  ASSERT_THAT(write_file(folder / "stones.json", text), Succeeds());
  const auto read = read_stone_plan(folder / "stones.json");
  ASSERT_THAT(read, FailsWith(kStonePlanFormat));
  EXPECT_THAT(read.error().message,
              AllOf(HasSubstr("stones.json: "), HasSubstr(GetParam().message)));
}

TEST(StonePlan, MissingFile) {
  const ScratchFolder folder;
  EXPECT_THAT(read_stone_plan(folder / "none.json"), FailsWith(kFileNotFound));
}

TEST(StonePlan, WhateverTheBytesStonesOrAnError) {
  const ScratchFolder folder;
  ASSERT_THAT(write_stone_plan(std::vector{awkward_stone()}, folder / "stones.json"), Succeeds());
  const std::string valid = read_file(folder / "stones.json").value();
  int errors = 0;
  for (std::uint64_t i = 0; i < 2000; ++i) {
    std::string text = valid;
    for (std::uint64_t k = 0; k <= random_bits(1, i) % 3; ++k) {
      const std::uint64_t bits = random_bits(9, 4 * i + k);
      text[random_bits(2 + k, i) % text.size()] =
          i % 2 == 0 ? static_cast<char>(bits & 0xff) : "0123456789-.eE[]{},\":"[bits % 21];
    }
    if (i % 5 == 0) text.resize(random_bits(8, i) % text.size());
    std::ofstream(folder / "changed.json", std::ios::binary) << text;  // needs no fsync
    const auto read = read_stone_plan(folder / "changed.json");
    if (read) {
      // What was accepted must be good enough for stone_mesh.
      for (const PlacedStone& s : *read) {
        ASSERT_GT(s.scale_mm, 0.0);
        ASSERT_LE(s.shape.subdivisions, 7);
        ASSERT_TRUE(s.shape.flatness >= 0.3 && s.shape.flatness <= 1.0);
      }
    } else {
      ASSERT_THAT(read, FailsWith(kStonePlanFormat)) << "change " << i;
      ++errors;
    }
  }
  EXPECT_GT(errors, 1000);
}

TEST(StoneTable, HasOneLinePerStone) {
  const ScratchFolder folder;
  const PlacedStone s{.number = 3,
                      .shape = {},
                      .scale_mm = 4.25,
                      .model_from_stone = {.rotation = {0.5, -0.5, 0.5, 0.5},
                                           .translation_mm = {1.25, -2.00004, 1.0 / 3.0}},
                      .embedded_depth_mm = 0.75};
  ASSERT_THAT(write_stone_table(std::vector{s, s}, folder / "stones.csv"), Succeeds());
  const std::string line =
      "3,1.2500,-2.0000,0.3333,0.500000000,-0.500000000,0.500000000,0.500000000,4.2500,0.7500\n";
  EXPECT_EQ(read_file(folder / "stones.csv").value(),
            "number,x_mm,y_mm,z_mm,qw,qx,qy,qz,diameter_mm,embedded_depth_mm\n" + line + line);
}

}  // namespace
}  // namespace maquette::meshing
