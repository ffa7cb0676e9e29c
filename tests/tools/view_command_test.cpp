// SPDX-License-Identifier: GPL-3.0-or-later

// maquette view as a user starts it: the address at once, Ctrl-C is a good end, each bad folder and
// a taken port one error with its exit code; without its page it says what to do.

#include <filesystem>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "heightmap/field_io.hpp"
#include "support/matchers.hpp"
#include "support/program.hpp"
#include "tools/view/view_page.hpp"
#include "tools/view/view_server.hpp"

namespace maquette::tools {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;
using testing::MatchesRegex;
using testing_support::Outcome;
using testing_support::run_program;
using testing_support::ScratchFolder;

class ViewCommand : public testing::Test {
 protected:
  ViewCommand() {
    fs::create_directories(scratch / "site");
    fs::create_directories(scratch / "empty");
    heightmap::ModelField field{Grid<float>(5, 5), Millimetres{1.0}, {}, {}};
    EXPECT_TRUE(heightmap::write_model_field(field, scratch / "site/design.tif"));
  }
  Outcome view(const std::string& arguments, const std::string& before = "") {
    return run_program(scratch.path(), "view " + arguments, before);
  }
  [[nodiscard]] std::string site() const { return (scratch / "site").string(); }
  ScratchFolder scratch;
};

TEST_F(ViewCommand, RefusesFoldersWithNothingToShow) {
  const Outcome nowhere = view((scratch / "nowhere").string());
  EXPECT_EQ(nowhere.exit_code, 2);
  EXPECT_THAT(nowhere.err, AllOf(HasSubstr("nowhere: no such folder"), HasSubstr("maquette run")));
  const Outcome empty = view((scratch / "empty").string() + " --json");
  EXPECT_EQ(empty.exit_code, 2);
  EXPECT_THAT(empty.out, HasSubstr("TOOLS_VIEW_NOTHING"));
  EXPECT_THAT(empty.err, HasSubstr("maquette lod"));
  EXPECT_EQ(view("").exit_code, 2);
  EXPECT_EQ(view(site() + " --port 70000").exit_code, 2);
}

TEST_F(ViewCommand, SaysThatAPortIsTaken) {
  const auto other = ViewServer::start(scratch / "site", 0, {});
  ASSERT_TRUE(other);
  const Outcome taken = view(fmt::format("{} --port {}", site(), other->port()));
  EXPECT_EQ(taken.exit_code, 3);
  EXPECT_THAT(taken.err,
              AllOf(HasSubstr(fmt::format("port {}", other->port())), HasSubstr("--port")));
}

TEST_F(ViewCommand, EndsWellByCtrlC) {
  // Without --foreground the signal comes twice, and the second one ends it at once.
  const Outcome seen =
      view(site() + " --port 0", "timeout --foreground --preserve-status -s INT 8");
  if (view_page().empty()) {  // built without node
    EXPECT_EQ(seen.exit_code, 3);
    EXPECT_THAT(seen.err, HasSubstr("tools/setup --web"));
    const Outcome coded = view(site() + " --port 0 --json");
    EXPECT_THAT(coded.out, HasSubstr("TOOLS_VIEW_PAGE_MISSING"));
    return;
  }
  EXPECT_EQ(seen.exit_code, 0);
  EXPECT_THAT(seen.out, MatchesRegex("http://127\\.0\\.0\\.1:[0-9]+/\n"));
  EXPECT_THAT(seen.err, HasSubstr("Ctrl-C"));
}

}  // namespace
}  // namespace maquette::tools
