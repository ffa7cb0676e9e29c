// SPDX-License-Identifier: GPL-3.0-or-later

// tools/pipeline.hpp:
//   a second run does nothing ........ work counted
//   what depends on a change is redone, nothing else ... input, parameter, output touched
//   a failing unit leaves no record .. and is done again
//   one run a folder, many shards .... locks tried from the same process
//   shards together are the whole .... every unit once
//   partial files of a killed run go . planted file removed

#include "tools/pipeline.hpp"

#include <fstream>

#include <fmt/format.h>
#include <gtest/gtest.h>

#include "core/files.hpp"
#include "support/matchers.hpp"

namespace maquette::tools {
namespace {

namespace fs = std::filesystem;
using testing_support::FailsWith;
using testing_support::ScratchFolder;
using testing_support::Succeeds;

class PipelineTest : public testing::Test {
 protected:
  ScratchFolder scratch;
  fs::path folder = scratch / "out";
  Console console{{.quiet = true, .json = false}};
  int first_runs = 0, second_runs = 0;
  bool fail_second = false;

  /// in.txt -> a.txt -> b.txt
  std::vector<Stage> chain(const std::string& parameters = "{}") {
    const auto copy = [](const fs::path& from, const fs::path& to) -> Result<JobResult> {
      MAQUETTE_TRY(const std::string text, read_file(from));
      MAQUETTE_TRY_VOID(write_file(to, text + "+"));
      return JobResult{{to}, "{}", "copied", ""};
    };
    return {{"first",
             {{"first",
               {scratch / "in.txt"},
               "{}",
               [=, this](const RunContext&) {
                 ++first_runs;
                 return copy(scratch / "in.txt", folder / "a.txt");
               }}}},
            {"second",
             {{"second",
               {folder / "a.txt"},
               parameters,
               [=, this](const RunContext&) -> Result<JobResult> {
                 ++second_runs;
                 if (fail_second) return fail(kInputMissing, "on purpose");
                 return copy(folder / "a.txt", folder / "b.txt");
               }}}}};
  }

  Result<void> run(const std::vector<Stage>& stages) {
    MAQUETTE_TRY(auto pipeline, Pipeline::open(folder, false, console));
    for (const Stage& s : stages) MAQUETTE_TRY_VOID(pipeline.run(s));
    return {};
  }

  void SetUp() override { ASSERT_TRUE(write_file(scratch / "in.txt", "x")); }
};

TEST_F(PipelineTest, DoesNothingTwice) {
  ASSERT_THAT(run(chain()), Succeeds());
  ASSERT_THAT(run(chain()), Succeeds());
  EXPECT_EQ(first_runs, 1);
  EXPECT_EQ(second_runs, 1);
  EXPECT_EQ(read_file(folder / "b.txt").value(), "x++");
}

TEST_F(PipelineTest, RedoesOnlyWhatDependsOnAChange) {
  ASSERT_THAT(run(chain()), Succeeds());
  ASSERT_THAT(run(chain(R"({"depth":2})")), Succeeds());
  EXPECT_EQ(first_runs, 1) << "a parameter of the second must not touch the first";
  EXPECT_EQ(second_runs, 2);
  ASSERT_TRUE(write_file(scratch / "in.txt", "y"));
  ASSERT_THAT(run(chain(R"({"depth":2})")), Succeeds());
  EXPECT_EQ(first_runs, 2);
  EXPECT_EQ(second_runs, 3);
}

TEST_F(PipelineTest, RedoesALostOrDamagedOutput) {
  ASSERT_THAT(run(chain()), Succeeds());
  std::ofstream(folder / "b.txt") << "dam";  // same size, other content
  ASSERT_THAT(run(chain()), Succeeds());
  EXPECT_EQ(read_file(folder / "b.txt").value(), "x++");
  fs::remove(folder / "b.txt");
  ASSERT_THAT(run(chain()), Succeeds());
  EXPECT_EQ(first_runs, 1);
  EXPECT_EQ(second_runs, 3);
}

TEST_F(PipelineTest, AFailedUnitIsDoneAgain) {
  fail_second = true;
  EXPECT_THAT(run(chain()), FailsWith(kInputMissing));
  fail_second = false;
  EXPECT_THAT(run(chain()), Succeeds());
  EXPECT_EQ(first_runs, 1);
  EXPECT_EQ(second_runs, 2);
}

TEST_F(PipelineTest, SaysWhichInputIsNotThereYet) {
  const auto result = run({chain()[1]});
  ASSERT_THAT(result, FailsWith(kInputMissing));
  EXPECT_THAT(result.error().message, testing::HasSubstr("a.txt"));
}

TEST_F(PipelineTest, OneRunAFolderButManyShards) {
  {
    const auto whole = Pipeline::open(folder, false, console);
    ASSERT_THAT(whole, Succeeds());
    EXPECT_THAT(Pipeline::open(folder, false, console), FailsWith(kDirectoryBusy));
    EXPECT_THAT(Pipeline::open(folder, true, console), FailsWith(kDirectoryBusy));
  }
  const auto shard = Pipeline::open(folder, true, console);
  ASSERT_THAT(shard, Succeeds());
  EXPECT_THAT(Pipeline::open(folder, true, console), Succeeds());
  EXPECT_THAT(Pipeline::open(folder, false, console), FailsWith(kDirectoryBusy));
}

TEST_F(PipelineTest, ShardsTogetherDoEveryUnitOnce) {
  std::vector<int> runs(7);
  Stage stage{"many", {}};
  for (int i = 0; i < 7; ++i)
    stage.units.push_back(
        {fmt::format("many.{}", i), {}, "{}", [&, i](const RunContext&) -> Result<JobResult> {
           ++runs[static_cast<std::size_t>(i)];
           return JobResult{};
         }});
  for (const char* text : {"1/3", "2/3", "3/3"}) {
    auto pipeline = Pipeline::open(folder, true, console);
    ASSERT_THAT(pipeline, Succeeds());
    ASSERT_THAT(pipeline->run(stage, parse_shard(text).value()), Succeeds());
  }
  ASSERT_THAT(run({stage}), Succeeds());  // the merge finds all of them done
  EXPECT_THAT(runs, testing::Each(1));
}

TEST_F(PipelineTest, RefusesAShardThatIsNone) {
  for (const char* text : {"", "1", "0/3", "4/3", "1/0", "a/b", "1/3x", "-1/3"})
    EXPECT_THAT(parse_shard(text), FailsWith(kShardRange)) << text;
}

TEST_F(PipelineTest, CleansUpAfterAKilledRun) {
  ASSERT_THAT(run({}), Succeeds());
  ASSERT_TRUE(write_file(folder / ".surface.partial-123.ply", "half"));
  ASSERT_THAT(run(chain()), Succeeds());
  EXPECT_FALSE(fs::exists(folder / ".surface.partial-123.ply"));
}

TEST_F(PipelineTest, SaysThatAFolderCannotBeMade) {
  EXPECT_THAT(Pipeline::open("/proc/maquette", false, console), FailsWith(kFileNotWritable));
}

}  // namespace
}  // namespace maquette::tools
