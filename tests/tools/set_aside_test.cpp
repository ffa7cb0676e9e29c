// SPDX-License-Identifier: GPL-3.0-or-later

// tools/set_aside.hpp:
//   what is beyond moves ....... all of its kinds of files, with what they hold, and is said
//   what is not stays .......... other numbers, other names, folders; nothing beyond: no word
//   nothing is lost ............ a second time into a folder of its own

#include "tools/set_aside.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/files.hpp"
#include "support/matchers.hpp"

namespace maquette::tools {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::IsEmpty;
using testing_support::ScratchFolder;
using testing_support::Succeeds;

std::vector<std::string> files_in(const fs::path& folder) {
  std::vector<std::string> names;
  if (fs::exists(folder))
    for (const auto& entry : fs::directory_iterator(folder))
      if (entry.is_regular_file()) names.push_back(entry.path().filename().string());
  std::sort(names.begin(), names.end());
  return names;
}

TEST(SetAside, MovesWhatIsBeyondAndSaysSo) {
  const ScratchFolder scratch;
  std::vector<std::string> said;
  RunContext run;
  run.warn = [&](const std::string& text) { said.push_back(text); };
  for (const char* name : {"band_01.ply", "band_02.ply", "band_03.ply", "band_03.certificate.json",
                           "band_12.finish.ngc", "bands.json", "band_.txt", "my_band_07.ply"})
    ASSERT_THAT(write_file(scratch / name, name), Succeeds());
  fs::create_directory(scratch / "band_09");
  ASSERT_THAT(set_aside_beyond(scratch.path(), "band_", 12, run), Succeeds());
  EXPECT_THAT(said, IsEmpty());
  ASSERT_THAT(set_aside_beyond(scratch.path(), "band_", 2, run), Succeeds());
  EXPECT_THAT(files_in(scratch.path()), ElementsAre("band_.txt", "band_01.ply", "band_02.ply",
                                                    "bands.json", "my_band_07.ply"));
  EXPECT_TRUE(fs::is_directory(scratch / "band_09"));
  EXPECT_THAT(files_in(scratch / "earlier_1"),
              ElementsAre("band_03.certificate.json", "band_03.ply", "band_12.finish.ngc"));
  EXPECT_EQ(read_file(scratch / "earlier_1" / "band_03.ply").value(), "band_03.ply");
  ASSERT_EQ(said.size(), 1U);
  EXPECT_THAT(said[0], testing::AllOf(testing::HasSubstr("2 parts"), testing::HasSubstr("3 files"),
                                      testing::HasSubstr("earlier_1")));
  ASSERT_THAT(write_file(scratch / "band_03.ply", "newer"), Succeeds());
  ASSERT_THAT(set_aside_beyond(scratch.path(), "band_", 2, run), Succeeds());
  EXPECT_EQ(read_file(scratch / "earlier_1" / "band_03.ply").value(), "band_03.ply");
  EXPECT_EQ(read_file(scratch / "earlier_2" / "band_03.ply").value(), "newer");
  EXPECT_THAT(said[1], testing::HasSubstr("1 file of an earlier run"));
}

}  // namespace
}  // namespace maquette::tools
