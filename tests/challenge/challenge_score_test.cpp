// SPDX-License-Identifier: GPL-3.0-or-later

// What is counted as right, wrong, missed, claimed, from reports written here:
//   a name is right as itself or as an equivalent, each hidden effect once; all of them are asked
//   for nothing hidden: nothing may be named or left; outside: nothing named, something left sizes
//   against the stated standard error, only under the name that was hidden

#include <cmath>

#include <gmock/gmock.h>

#include "challenge/challenge_score.hpp"

namespace challenge {
namespace {

nlohmann::json cause(const std::string& name, std::vector<std::string> equivalent = {},
                     double value = 1.0) {
  return {{"effect", name},
          {"equivalent", std::move(equivalent)},
          {"share_of_excess_variance", 0.5},
          {"parameters", {{"size", {{"value", value}, {"sigma", 0.1}}}}}};
}
nlohmann::json report(const std::string& verdict, std::vector<nlohmann::json> causes) {
  return {{"verdict", verdict}, {"causes", std::move(causes)}};
}

TEST(ChallengeScore, NamesAndTheirEquivalents) {
  Confusion table;
  EXPECT_TRUE(judge("single", {"a"}, report("explained", {cause("a")}), table).right);
  EXPECT_TRUE(judge("single", {"a"}, report("explained", {cause("b", {"a"})}), table).right);
  const Verdict other = judge("single", {"a"}, report("explained", {cause("b", {"c"})}), table);
  EXPECT_FALSE(other.right);
  EXPECT_EQ(other.wrong, 1);
  EXPECT_EQ(other.missed, 1);
  EXPECT_STREQ(other.word(), "WRONG");
  // One hidden effect is not found twice, and of two both are asked for.
  EXPECT_EQ(
      judge("single", {"a"}, report("explained", {cause("a"), cause("b", {"a"})}), table).wrong, 1);
  const Verdict half = judge("double", {"a", "b"}, report("explained", {cause("b")}), table);
  EXPECT_EQ(half.wrong, 0);
  EXPECT_EQ(half.missed, 1);
  EXPECT_STREQ(half.word(), "missed");
  EXPECT_EQ((table[{"a", "a"}]), 3);
  EXPECT_EQ((table[{"a", "b"}]), 2);
  EXPECT_EQ((table[{"a", "nothing"}]), 2);
}

TEST(ChallengeScore, NothingHiddenAndThingsOutside) {
  Confusion table;
  EXPECT_TRUE(judge("null", {}, report("consistent", {}), table).right);
  EXPECT_FALSE(judge("null", {}, report("unexplained", {}), table).right);
  const Verdict claim = judge("null", {}, report("explained", {cause("a")}), table);
  EXPECT_EQ(claim.wrong, 1);
  EXPECT_FALSE(claim.none);
  EXPECT_TRUE(judge("outside", {"dust"}, report("unexplained", {}), table).right);
  EXPECT_FALSE(judge("outside", {"dust"}, report("consistent", {}), table).right);
  const Verdict named = judge("outside", {"dust"}, report("explained", {cause("a")}), table);
  EXPECT_FALSE(named.right);
  EXPECT_EQ(named.missed, 0);
  Count count;
  count.add(claim);
  count.add(named);
  EXPECT_EQ(count.cases, 2);
  EXPECT_EQ(count.claimed, 2);
  EXPECT_EQ(count.wrong, 2);
  EXPECT_EQ(count.right, 0);
}

TEST(ChallengeScore, SizesOverTheirStandardErrors) {
  Sizes sizes;
  const auto j = report("explained", {cause("a", {}, 1.3), cause("b", {"c"}, 2.0)});
  EXPECT_NE(compare_size(j, "a", "size", 1.2, sizes), "");
  EXPECT_EQ(sizes.all, 1);
  EXPECT_EQ(sizes.covered, 1);
  EXPECT_NEAR(sizes.squares, 1.0, 1e-12);
  EXPECT_NEAR(sizes.shares, 0.1 * 0.1 / (1.2 * 1.2), 1e-12);
  EXPECT_EQ(compare_size(j, "c", "size", 2.0, sizes), "");
  EXPECT_EQ(compare_size(j, "a", "length", 2.0, sizes), "");
  EXPECT_EQ(sizes.all, 1);
  compare_size(j, "b", "size", 3.0, sizes);
  EXPECT_EQ(sizes.all, 2);
  EXPECT_EQ(sizes.covered, 1);
}

TEST(ChallengeScore, GainsAreSharesOfWhatOneWhoKnowsGains) {
  Gains g;
  // Of 0.05 that is hidden over 0.05 of noise nine tenths are taken away.
  EXPECT_NEAR(g.add(std::sqrt(0.005), std::sqrt(0.00275), 0.05), 0.9, 1e-12);
  EXPECT_NEAR(g.add(0.1, 0.05, 0.05), 1.0, 1e-12);
  EXPECT_EQ(g.all, 2);
  EXPECT_NEAR(g.sum, 1.9, 1e-12);
  EXPECT_NEAR(g.least, 0.9, 1e-12);
}

}  // namespace
}  // namespace challenge
