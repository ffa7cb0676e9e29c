// SPDX-License-Identifier: GPL-3.0-or-later

// tools/schema.hpp, tools/site.hpp:
//   every mistake is named ........... one case a kind: line, key, what is allowed, nearest key
//   all findings at once ............. two mistakes, two lines
//   --set wins over the file ......... value compared; by index and by name in arrays
//   ${NAME} from the environment ..... set, unset, default, replaced by --set
//   the template is a valid site ..... written, read back, same values

#include "tools/schema.hpp"

#include <cstdlib>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/files.hpp"
#include "support/matchers.hpp"
#include "tools/site.hpp"

namespace maquette::tools {
namespace {

using testing::HasSubstr;
using testing_support::FailsWith;
using testing_support::ScratchFolder;
using testing_support::Succeeds;

class SiteFileTest : public testing::Test {
 protected:
  ScratchFolder folder;
  Result<SiteFile> read(const std::string& text, const std::vector<std::string>& set = {}) {
    EXPECT_TRUE(write_file(folder / "site.toml", text));
    return read_site(folder / "site.toml", set);
  }
};

/// Text of so many sources; kept for the tests' parameters.
const char* sources(int many) {
  static std::string text;
  for (int i = 0; i < many; ++i) text += "[[source]]\nname = \"s\"\npath = \"a\"\n";
  return text.c_str();
}

struct Mistake {
  const char* name;
  const char* text;
  std::vector<const char*> said;
};

class SiteMistakes : public SiteFileTest, public testing::WithParamInterface<Mistake> {};

TEST_P(SiteMistakes, AreNamedWithPlaceAndRemedy) {
  const auto result = read(GetParam().text);
  ASSERT_THAT(result, FailsWith(kConfigInvalid));
  for (const char* part : GetParam().said) EXPECT_THAT(result.error().message, HasSubstr(part));
}

INSTANTIATE_TEST_SUITE_P(
    All, SiteMistakes,
    testing::Values(
        Mistake{"unknown_key",
                "size_mm = 200.0\n[mill]\nstepovr_mm = 0.5\n",
                {"site.toml:3:", "mill.stepovr_mm", "did you mean 'mill.stepover_mm'"}},
        Mistake{"wrong_section",
                "[cutter]\nstepover_mm = 0.5\n",
                {"site.toml:2:", "did you mean 'mill.stepover_mm'"}},
        Mistake{"wrong_type", "\nsize_mm = \"big\"\n", {"site.toml:2:", "'size_mm'", "a number"}},
        Mistake{"whole_number", "[stones]\ncount = 1.5\n", {":2:", "a whole number"}},
        Mistake{"out_of_range",
                "[lamp]\nelevation_deg = 120.0\n",
                {":2:", "lamp.elevation_deg", "120", "1 to 90"}},
        Mistake{
            "not_a_choice", "body = \"mars2\"\n", {":1:", "moon, mars", "did you mean \"mars\""}},
        Mistake{"not_finite", "size_mm = nan\n", {":1:", "size_mm"}},
        Mistake{"missing_in_array", "[[source]]\nname = \"a\"\n", {"source[0].path", "missing"}},
        Mistake{"unknown_in_array",
                "[[source]]\nname = \"a\"\npath = \"b\"\nsigma = 1.0\n",
                {":4:", "source[0].sigma", "did you mean 'sigma_m'"}},
        Mistake{"array_as_table", "[source]\nname = \"a\"\n", {"[[source]]"}},
        Mistake{"not_a_multiple", "size_mm = 200.3\n", {"size_mm", "whole number", "spacing_mm"}},
        Mistake{"scales_ascend", "scales = [200.0, 1000.0]\n", {"scales", "descend"}},
        Mistake{
            "stepover_too_wide", "[mill]\nstepover_mm = 7.0\n", {"stepover_mm", "ball_diameter"}},
        Mistake{"other_body_to_be_aligned",
                "[[source]]\nname = \"lola\"\npath = \"a\"\n[[source]]\nname = \"dtm\"\npath = "
                "\"b\"\nbody = \"mars\"\n",
                {"source 'dtm' is of mars", "of moon", "fusion.combine = \"composite\""}},
        Mistake{"composite_of_one_body",
                "[fusion]\ncombine = \"composite\"\n[[source]]\nname = \"lola\"\npath = \"a\"\n",
                {"all sources are of moon", "same_body"}},
        Mistake{
            "composite_in_wrong_order",
            "[fusion]\ncombine = \"composite\"\ncrater_age_gyr = 3.5\n[[source]]\nname = "
            "\"dtm\"\npath = \"a\"\nbody = \"mars\"\n[[source]]\nname = \"lola\"\npath = \"b\"\n",
            {"'dtm' of mars stands first", "'lola' of moon stands after", "crater_age_gyr"}},
        Mistake{"more_sources_than_the_mask_can_tell", sources(101), {"101 sources", "100"}},
        Mistake{"stated_without_limit",
                "[mill]\nstated_stepover_mm = 0.5\n",
                {"mill.stated_stepover_mm", "mill.excess_limit_mm"}},
        Mistake{"stated_below_stepover",
                "[mill]\nstated_stepover_mm = 0.4\nexcess_limit_mm = 0.01\n",
                {"mill.stated_stepover_mm 0.4", "mill.stepover_mm 0.5"}},
        Mistake{"work_offset", "[mill]\nwork_offset = 60\n", {"mill.work_offset 60", "59, 591"}},
        Mistake{"too_many_bands",
                "[bands]\nmax_width_mm = 20.0\n[mill]\nwork_offset_per_band = true\n",
                {"10 bands", "bands.max_width_mm"}},
        Mistake{"rest_of_stones",
                "[stones]\nrest = \"setled\"\n",
                {":2:", "fitted, settled", "did you mean \"settled\""}},
        Mistake{"density_around_no_crater",
                "[stones]\ndensity = \"craters\"\n",
                {"stones.density craters", "[[crater]]"}},
        Mistake{"crater_without_a_rim_on_the_site",
                "[[crater]]\neast_m = 300.0\nnorth_m = 0.0\ndiameter_m = 100.0\n",
                {"crater at east_m 300", "does not cross the site of 200 m x 200 m"}},
        Mistake{"crater_without_diameter",
                "[[crater]]\neast_m = 0.0\nnorth_m = 0.0\n",
                {"crater[0].diameter_m", "missing"}},
        Mistake{"two_at_once",
                "sise_mm = 1.0\nspacing_mm = true\n",
                {"site.toml:1:", "site.toml:2:", "'size_mm'", "'spacing_mm'"}}),
    [](const auto& param) { return std::string(param.param.name); });

TEST_F(SiteFileTest, SyntaxErrorsHaveLineAndColumn) {
  const auto result = read("size_mm = 200.0\nspacing_mm = = 1\n");
  ASSERT_THAT(result, FailsWith(kConfigSyntax));
  EXPECT_THAT(result.error().message, HasSubstr("site.toml:2:"));
}

TEST_F(SiteFileTest, OverridesWinAndAreCheckedLikeTheFile) {
  const auto result =
      read("size_mm = 200.0\n[[source]]\nname = \"dtm\"\npath = \"a.img\"\n",
           {"size_mm=400", "name=crater", "source.dtm.sigma_m=2.5", "source.0.path=/data/b.img"});
  ASSERT_THAT(result, Succeeds());
  EXPECT_EQ(result->site->size_mm, 400.0);
  EXPECT_EQ(result->site->name, "crater");
  EXPECT_EQ(result->site->sources[0].sigma_m, 2.5);
  EXPECT_EQ(result->site->sources[0].path, "/data/b.img");
  const auto wrong = read("", {"size_m=400"});
  ASSERT_THAT(wrong, FailsWith(kConfigInvalid));
  EXPECT_THAT(wrong.error().message, HasSubstr("did you mean 'size_mm'"));
  EXPECT_THAT(read("", {"size_mm"}), FailsWith(kConfigInvalid));
}

TEST_F(SiteFileTest, PathsComeFromTheEnvironment) {
  const std::string text = "[[source]]\nname = \"a\"\npath = \"${MAQUETTE_TEST_DTM}\"\n";
  ::unsetenv("MAQUETTE_TEST_DTM");
  const auto unset = read(text);
  ASSERT_THAT(unset, FailsWith(kVariableNotSet));
  EXPECT_THAT(unset.error().message, HasSubstr("MAQUETTE_TEST_DTM"));
  EXPECT_THAT(read(text, {"source.a.path=/x.img"}), Succeeds());
  ::setenv("MAQUETTE_TEST_DTM", "dem/y.img", 1);
  const auto set = read(text);
  ASSERT_THAT(set, Succeeds());
  EXPECT_EQ(set->site->sources[0].path, folder / "dem/y.img");
  ::unsetenv("MAQUETTE_TEST_DTM");
  const auto fallback = read("[[source]]\nname = \"a\"\npath = \"${MAQUETTE_TEST_DTM:-/z.img}\"\n");
  ASSERT_THAT(fallback, Succeeds());
  EXPECT_EQ(fallback->site->sources[0].path, "/z.img");
}

TEST_F(SiteFileTest, TheTemplateIsASiteWithTheDefaults) {
  const SiteFile defaults = empty_site_file();
  const std::string expected = defaults.schema.values_json();
  const auto result = read(empty_site_file().schema.template_text());
  ASSERT_THAT(result, Succeeds());
  EXPECT_EQ(result->schema.values_json(), expected);
  EXPECT_TRUE(result->site->sources.empty());
}

TEST(NearestName, StaysSilentWhenNothingIsNear) {
  EXPECT_EQ(nearest_name("stepovr", {"stepover", "tolerance"}), "stepover");
  EXPECT_EQ(nearest_name("qqqqqq", {"stepover", "tolerance"}), "");
}

}  // namespace
}  // namespace maquette::tools
