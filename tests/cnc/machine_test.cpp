// SPDX-License-Identifier: GPL-3.0-or-later

// What machine.hpp and data_file.hpp claim, and how each claim is attacked:
//
//   machines of this project .... by name, all of them, plausible; the file says the same
//   every value has a source .... each key of each file ends in a comment
//   any other by its path ....... written, read, compared
//   every mistake is named ...... file, line, key, what is allowed, the nearest key; all at once
//   a tool stands free .......... just short enough, just too long
//   travel ...................... each axis, just within and just beyond

#include "cnc/machine.hpp"

#include <fstream>
#include <regex>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/files.hpp"
#include "support/matchers.hpp"

namespace maquette::cnc {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;
using testing_support::FailsWith;
using testing_support::ScratchFolder;
using testing_support::Succeeds;

std::string portal() {
  return std::string(built_in_data("machines", "portal_mill_2500"));
}

std::string replaced(std::string text, const std::string& what, const std::string& by) {
  const std::size_t at = text.find(what);
  EXPECT_NE(at, std::string::npos) << what;
  return text.replace(at, what.size(), by);
}

TEST(Machine, ThoseOfThisProjectAreFoundAndPlausible) {
  EXPECT_THAT(machine_names(),
              testing::ElementsAre("bench_router_600", "portal_mill_2500", "unlimited"));
  for (const std::string& name : machine_names()) {
    SCOPED_TRACE(name);
    const auto m = find_machine(name);
    ASSERT_THAT(m, Succeeds());
    EXPECT_EQ(m->name, name);
    for (const auto axis : {&Vec3::x, &Vec3::y, &Vec3::z}) {
      EXPECT_GE(m->rapid_mm_min.*axis, m->max_feed_mm_min.*axis);
      // It reaches its feed within its travel.
      const double v = m->max_feed_mm_min.*axis / 60.0;
      EXPECT_LT(v * v / m->acceleration_mm_s2.*axis, m->travel_mm.*axis);
    }
    EXPECT_LE(m->max_plunge_mm_min, m->max_feed_mm_min.z);
    EXPECT_GE(m->max_spindle_rpm, m->min_spindle_rpm);
  }
  const auto p = find_machine("portal_mill_2500");
  EXPECT_EQ(p->travel_mm, (Vec3{2500, 2500, 400}));
  EXPECT_EQ(p->look_ahead_blocks, 50);
}

TEST(Machine, EveryValueOfTheFilesHasItsSourceBesideIt) {
  for (const char* kind : {"machines", "materials"})
    for (const std::string& name : built_in_names(kind)) {
      std::istringstream lines{std::string(built_in_data(kind, name))};
      const std::regex value(R"re(^[a-z_0-9]+ = .*)re"), sourced(R"re(.*[\]0-9"] +# .{8,})re");
      for (std::string line; std::getline(lines, line);)
        if (std::regex_match(line, value) && !line.starts_with("name") &&
            !line.starts_with("description")) {
          EXPECT_TRUE(std::regex_match(line, sourced)) << name << ": " << line;
        }
    }
}

TEST(Machine, AnyOtherIsReadFromItsPath) {
  const ScratchFolder folder;
  const std::string path = (folder / "mine.toml").string();
  ASSERT_THAT(
      write_file(path, replaced(replaced(portal(), "2500.0, 2500.0, 400.0", "700, 800.5, 90"),
                                "jerk_mm_s3", "# jerk_mm_s3")),
      Succeeds());
  const auto m = find_machine(path);
  ASSERT_THAT(m, Succeeds());
  EXPECT_EQ(m->travel_mm, (Vec3{700, 800.5, 90}));
  EXPECT_EQ(m->jerk_mm_s3, (Vec3{0, 0, 0})) << "may be left out";
  EXPECT_THAT(find_machine((folder / "none.toml").string()), FailsWith(kFileNotFound));
}

TEST(Machine, EveryMistakeIsNamed) {
  const auto message = [](const std::string& text) {
    const auto m = parse_machine(text, "mine.toml");
    EXPECT_THAT(m, FailsWith(kDataFile));
    return m ? "" : m.error().message;
  };
  // Line 5 is travel_mm.
  EXPECT_THAT(message(replaced(portal(), "travel_mm", "travl_mm")),
              AllOf(HasSubstr("mine.toml:5: unknown key 'travl_mm'; did you mean 'travel_mm'?"),
                    HasSubstr("mine.toml: key 'travel_mm' is missing")));
  EXPECT_THAT(message("zzzzzzzz = 3\n" + portal()),
              HasSubstr("mine.toml:1: unknown key 'zzzzzzzz'; known are name,"));
  EXPECT_THAT(message(replaced(portal(), "[2500.0, 2500.0, 400.0]", "2500.0")),
              HasSubstr("mine.toml:5: key 'travel_mm' must be three numbers (x, y, z), 1 to"));
  EXPECT_THAT(message(replaced(portal(), "[2500.0, 2500.0, 400.0]", "[2500.0, 2500.0]")),
              HasSubstr("mine.toml:5: key 'travel_mm'"));
  EXPECT_THAT(message(replaced(portal(), "[2500.0, 2500.0, 400.0]", "[2500.0, \"a\", 400.0]")),
              HasSubstr("mine.toml:5: key 'travel_mm'"));
  EXPECT_THAT(message(replaced(portal(), "= 4000.0 ", "= -4000.0 ")),
              HasSubstr("key 'max_plunge_mm_min' must be a number, 1 to 1000000"));
  EXPECT_THAT(message(replaced(portal(), "= 4000.0 ", "= nan ")), HasSubstr("max_plunge_mm_min"));
  EXPECT_THAT(message(replaced(portal(), "= 4000.0 ", "= \"fast\" ")),
              HasSubstr("max_plunge_mm_min"));
  EXPECT_THAT(message(replaced(portal(), "look_ahead_blocks = 50", "look_ahead_blocks = 50.5")),
              HasSubstr("key 'look_ahead_blocks' must be a whole number"));
  EXPECT_THAT(message(replaced(portal(), "\"portal_mill_2500\"", "7")),
              HasSubstr("key 'name' must be a string"));
  EXPECT_THAT(message(replaced(portal(), "name =", "name")), HasSubstr("mine.toml:3:"));
  EXPECT_THAT(message(replaced(portal(), "= 24000.0", "= 2000.0")),
              HasSubstr("min_spindle_rpm 3000 is above max_spindle_rpm 2000"));
  // Two at once, by line.
  const std::string both =
      message(replaced(replaced(portal(), "= 0.001 ", "= 7.0 "), "travel_mm", "travl_mm"));
  EXPECT_LT(both.find("travl_mm"), both.find("cycle_s"));
  EXPECT_NE(both.find("cycle_s"), std::string::npos);
  // No machine of that name.
  const auto none = find_machine("portal_mill_250");
  ASSERT_THAT(none, FailsWith(kUnknownMachine));
  EXPECT_THAT(none.error().message,
              AllOf(HasSubstr("bench_router_600"), HasSubstr("did you mean 'portal_mill_2500'?")));
  EXPECT_THAT(find_machine("zzz").error().message, Not(HasSubstr("did you mean")));
}

TEST(Machine, AToolStandsFreeOrIsRefused) {
  const auto m = find_machine("portal_mill_2500");
  ASSERT_THAT(m, Succeeds());
  EXPECT_THAT(check_tool_length(*m, {}, 400.0, 200.0), Succeeds());
  const auto no = check_tool_length(*m, {}, 400.001, 200.0);
  ASSERT_THAT(no, FailsWith(kToolTooLong));
  EXPECT_THAT(no.error().message, AllOf(HasSubstr("400.0010 mm"), HasSubstr("400.0000 mm"),
                                        HasSubstr("ball nose 6 mm")));
}

TEST(Machine, TravelIsCheckedInEachAxis) {
  Machine m = *find_machine("portal_mill_2500");
  m.travel_mm = {5.0, 4.0, 3.0};
  EXPECT_THAT(check_travel(m, {}), Succeeds()) << "nothing moves";
  const Vec3 from{-10.0, 20.0, 7.0};
  EXPECT_THAT(check_travel(m, {from, from + Vec3{5.0, 4.0, 3.0}}), Succeeds());
  for (const auto& [axis, beyond] : {std::pair{"in x", Vec3{5.01, 4.0, 3.0}},
                                     {"in y", {5.0, 4.01, 3.0}},
                                     {"in z", {5.0, 4.0, 3.01}}}) {
    const auto no = check_travel(m, {from, from + beyond});
    ASSERT_THAT(no, FailsWith(kBeyondTravel)) << axis;
    EXPECT_THAT(no.error().message, AllOf(HasSubstr(axis), HasSubstr("portal_mill_2500")));
  }
}

}  // namespace
}  // namespace maquette::cnc
