// SPDX-License-Identifier: GPL-3.0-or-later

// Rows of summary.json: a stone of which no pose is stated has the reason, with what there is and
// what is needed; one that has a pose has none.

#include "tools/deviation_rows.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

namespace maquette::tools {
namespace {

using testing::HasSubstr;
using testing::Not;

TEST(StoneRows, SayWhyAStoneIsNotJudged) {
  scan::StoneFinding f;
  f.state = scan::StoneState::unseen;
  f.over = 3;
  f.width_mm = 1.6;
  const auto reason = [&](double beam) {
    return stones_json({f}, beam).at(0).at("reason").get<std::string>();
  };
  EXPECT_THAT(reason(0.0), HasSubstr("3 points over its middle, at least 5"));
  EXPECT_THAT(reason(0.0), Not(HasSubstr("beam")));
  EXPECT_THAT(reason(3.4), HasSubstr("the beam of 3.4 mm blurs a stone of 1.6 mm"));
  f.state = scan::StoneState::unclear;
  f.points = 11;
  EXPECT_THAT(reason(0.0), HasSubstr("11 points stand above the ground, a pose needs at least 25"));
  f.points = 400;
  f.noise_mm = 0.52;
  EXPECT_THAT(reason(0.0), HasSubstr("no pose of a planned stone fits: residuals of 0.52 mm"));
  f.state = scan::StoneState::as_planned;
  EXPECT_FALSE(stones_json({f}, 3.4).at(0).contains("reason"));
}

}  // namespace
}  // namespace maquette::tools
